"""How the crank of a record turns: senses, turns, held torques, and intervals of its angle.

Rows are averaged over the intervals. These span whole pitches of the pins, so that what repeats with the pitch is
averaged out and the middles of all of them stand alike in it: the model, which is asked at the middles, then shows none
of it either.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness
from pipeline.identification.measurement.branches import turning_points
from pipeline.identification.measurement.enough import FEWEST_COMPARED, LEAST_PART
from pipeline.model.units import TURN_DEG

MOST_INTERVALS: Fineness = 24
"""Intervals of a turn at most: each costs the model a position; orders up to half of them are seen."""
MOST_POSITIONS: Fineness = 96
"""Intervals of the record at most; of longer records turns are left out evenly."""
TURN_BACK_DEG = 5.0
"""Angle by which the crank must come back for its sense to have changed."""
LEVEL_SHARE = 0.05
"""Share of the largest torque within which two turns are of one held torque."""
HELD_SHARE = 0.1
"""Share of the largest torque by which a row may differ from the torque held."""
CENTRED_SHARE = 0.2
"""Share of an interval by which the mean angle of its rows may lie off its middle."""


@dataclass(frozen=True)
class Motion:
    """The motion of the crank, row by row in time order.

    Attributes
    ----------
    crank : (n,) [deg] from the drawing's zero, counted on over the turns; NaN where it is no number.
    sense : (n,) 1 where the crank turns forward, -1 backward.
    turn : (n,) number of the turn: rows of one cycle, one sense and one revolution at one held torque; -1 of rows in no
        whole turn, and of those whose torque is not the one held.
    level : (n,) number of the held torque.
    levels : (n_levels,) held torques [N m], ascending.
    interval : (n,) number of the interval of the crank over a turn of the output; -1 where the crank is unknown.
    pitches : pitches of the pins in an interval.
    width : of an interval [deg].
    left_out : turns that are left out, evenly, of a record that is too long.
    """

    crank: Real
    sense: Whole
    turn: Whole
    level: Whole
    levels: Real
    interval: Whole
    pitches: int
    width: float
    left_out: int


def unwrapped_crank(crank: Real, run: Whole) -> Real:
    """The crank (n,) [deg] counted on within each run (n,) of rows where it falls back by a turn."""
    counted_on = crank.copy()
    for number in np.unique(run):
        rows = np.flatnonzero((run == number) & np.isfinite(crank))
        step = np.diff(crank[rows], prepend=crank[rows[:1]])
        jumps = -np.sign(step) * (np.abs(step) > TURN_DEG / 2)  # of an angle that is counted from 0 to 360 degrees
        counted_on[rows] += TURN_DEG * np.cumsum(jumps)
    return counted_on


def motion(crank: Real, run: Whole, torque: Real, pins: int, lobes: int) -> Motion:
    """The motion of a record.

    Parameters
    ----------
    crank : (n,) [deg] counted on over the turns, in time order.
    run : (n,) number of the cycle and file of each row; -1 where that is unknown.
    torque : (n,) [N m] that the bench steers.
    """
    is_known = np.isfinite(crank) & np.isfinite(torque) & (run >= 0)
    largest_torque = float(np.max(np.abs(torque[is_known]), initial=0.0))
    sense, segment = stretches(crank, run, groups(torque, LEVEL_SHARE * largest_torque), is_known)
    held = held_torques(torque, segment)
    revolution = np.where(is_known, np.floor(np.where(is_known, crank, 0.0) / TURN_DEG), 0).astype(np.int64)
    keys = np.column_stack([segment, revolution])
    turn = np.full(len(crank), -1)
    turn[is_known] = _row_numbers(keys[is_known])
    level = groups(held, LEVEL_SHARE * largest_torque)
    levels = np.array([held[level == number].mean() for number in range(int(level.max(initial=-1)) + 1)])
    turn[np.abs(torque - held) > HELD_SHARE * largest_torque] = -1
    counts = np.bincount(turn[turn >= 0]) if np.any(turn >= 0) else np.ones(1, int)
    pitches = _pitches(float(np.median(counts[counts >= LEAST_PART * counts.max()])), pins, lobes)
    width = TURN_DEG * pitches / pins
    interval = np.full(len(crank), -1)
    interval[is_known] = np.floor(np.mod(crank[is_known], lobes * TURN_DEG) / width).astype(np.int64)
    left_out = _thin_revolutions(turn, revolution, pins / pitches)
    for number in np.unique(turn[turn >= 0]):
        of_turn = turn == number
        if len(np.unique(interval[of_turn])) < LEAST_PART * pins / pitches:
            turn[of_turn] = -1
    turn[turn >= 0] = np.unique(turn[turn >= 0], return_inverse=True)[1]
    return Motion(
        crank=crank,
        sense=sense,
        turn=turn,
        level=level,
        levels=levels,
        interval=interval,
        pitches=pitches,
        width=width,
        left_out=left_out,
    )


def stretches(crank: Real, run: Whole, level: Whole, is_known: Truth) -> tuple[Whole, Whole]:
    """Sense of each row (n,), and number of the stretch of one torque in which the crank turns on; -1 if unknown."""
    sense, segment, count = np.ones(len(crank), np.int64), np.full(len(crank), -1), 0
    rows = np.flatnonzero(is_known)
    changes = np.flatnonzero((np.diff(run[rows]) != 0) | (np.diff(level[rows]) != 0)) + 1
    for stretch in np.split(rows, changes):
        turns = turning_points(crank[stretch], TURN_BACK_DEG) if len(stretch) > 1 else np.zeros(1, np.int64)
        first_rows = [_first_row_of_angle(crank[stretch], int(last_turn)) for last_turn in turns]
        for number, (first_turn, last_turn) in enumerate(zip(turns[:-1], turns[1:], strict=True)):
            begin = first_turn + (number > 0 and first_rows[number] == first_turn)
            part = stretch[begin : first_rows[number + 1] + 1 if number + 2 < len(turns) else last_turn + 1]
            sense[part] = 1 if crank[stretch[last_turn]] >= crank[stretch[first_turn]] else -1
            segment[part], count = count, count + 1
    return sense, segment


def _first_row_of_angle(crank: Real, last_row: int) -> int:
    """First of the rows of one angle up to the row ``last_row``: one sense ends there, the other begins at the last."""
    first_row = last_row
    while first_row > 0 and crank[first_row - 1] == crank[last_row]:
        first_row -= 1
    return first_row


def held_torques(torque: Real, segment: Whole) -> Real:
    """Median torque (n,) [N m] of the stretch of each row; NaN outside of all."""
    held = np.full(len(torque), np.nan)
    for number in np.unique(segment[segment >= 0]):
        held[segment == number] = np.median(torque[segment == number])
    return held


def groups(values: Real, gap: float) -> Whole:
    """Number (n,) of each value's group, ascending: groups lie further apart than the ``gap``; -1 of no numbers."""
    group, finite = np.full(len(values), -1), np.isfinite(values)
    steps = np.unique(values[finite])
    if steps.size:
        of_step = np.concatenate([[0], np.cumsum(np.diff(steps) > gap)])
        group[finite] = of_step[np.searchsorted(steps, values[finite])]
    return group


def _row_numbers(keys: Whole) -> Whole:
    """Numbers (n,) of equal rows of ``keys``, in the order in which they come first."""
    _, first_row, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first_row))[number.ravel()], np.int64)


def fewest_pitches(pins: int) -> int:
    """Pitches of the pins in an interval where rows are plenty."""
    return -(-pins // MOST_INTERVALS)


def _pitches(rows: float, pins: int, lobes: int) -> int:
    """Fewest pitches in an interval with few enough intervals and enough of a turn's ``rows`` in each.

    A whole number of intervals fits into a turn of the output.
    """
    fewest = max(fewest_pitches(pins), int(np.ceil(FEWEST_COMPARED * pins / max(rows, 1.0))))
    return next((pitches for pitches in range(fewest, pins) if pins * lobes % pitches == 0), pins)


def _thin_revolutions(turn: Whole, revolution: Whole, per_turn: float) -> int:
    """Leave revolutions of a long record out of its turns (n,), evenly; how many."""
    revolutions = np.unique(revolution[turn >= 0])
    stride = int(np.ceil(len(revolutions) * per_turn / MOST_POSITIONS))
    remaining = revolutions[:: max(stride, 1)]
    turn[~np.isin(revolution, remaining)] = -1
    return len(revolutions) - len(remaining)

"""Monotone branches of the measured cycles.

A block is a position, a cycle and one monotone branch of the torque (of the commanded torque where it is known: a
motor that runs through the play shakes the measured one). A cycle may start anywhere and turn anywhere.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its filters are slow to import: they are where chatter turns the torque
from scipy.optimize import isotonic_regression

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.rows import Rows

TURN_SHARE = 0.05
"""Share of a position's torque range by which the torque must come back for a turn: smaller loops are no branches."""
TURN_NOISE = 6.0
"""Standard deviations of the torque by which it must come back: two extremes of noise differ by less."""
SMOOTHED_PARTS: Fineness = 40
"""Parts of a run of rows over which a torque that chatters is averaged: noise that is alike in neighbouring rows is
beyond what its scatter tells."""
EQUAL_SHARE = 0.1
"""Share of a position's torque range within which branches start alike."""
END_SHARE = 0.01
"""Share of a position's torque range from a branch's end over which the turning torque is averaged."""
END_NOISE = 3.0
"""The same in standard deviations of the torque."""


@dataclass(frozen=True)
class BranchBlocks:
    """Monotone branches in time order, position by position; each owns rows `start` to `stop` - 1.

    Attributes
    ----------
    position, cycle : (n_blocks,)
    direction : (n_blocks,) +1 where the torque rises, -1 where it falls.
    branch : (n_blocks,) number within the cycle, from 0.
    kind : (n_blocks,) alike for branches of one sense that start at about the same torque, at any position and in any
        cycle: these repeat each other, however the cycles are cut.
    start, stop : (n_blocks,) rows.
    threshold : (n_positions,) [N m] by which the torque came back at a turn.
    end_band : (n_positions,) [N m] from a branch's end over which the turning torque is averaged.
    """

    position: Whole
    cycle: Whole
    direction: Whole
    branch: Whole
    kind: Whole
    start: Whole
    stop: Whole
    threshold: Real
    end_band: Real

    def __len__(self) -> int:
        return len(self.start)

    @property
    def rows(self) -> list[slice]:
        """Rows of each block."""
        return [slice(int(start), int(stop)) for start, stop in zip(self.start, self.stop, strict=True)]


def turning_points(values: Real, threshold: float) -> Whole:
    """Indices of the first value, of each turn, and of the last value; a turn comes back by more than `threshold`.

    Of equal extremes the last counts, so that a hold belongs to the branch that leads to it.
    """
    turns = [0]
    low = high = 0
    sense = 0
    for i, value in enumerate(values):
        low = i if value <= values[low] else low
        high = i if value >= values[high] else high
        if sense >= 0 and values[high] - value > threshold:
            turns += [high] if sense else []  # the first excursion starts at the first value
            sense, low, high = -1, i, i
        elif sense <= 0 and value - values[low] > threshold:
            turns += [low] if sense else []
            sense, low, high = 1, i, i
    last_index = len(values) - 1
    return np.array([*turns, last_index] if turns[-1] != last_index else turns, dtype=np.int64)


def find_blocks(rows: Rows, usable: Truth, torque_noise: float, is_fitted: Truth) -> BranchBlocks:
    """The monotone branches of every cycle.

    Parameters
    ----------
    torque_noise : [N m] of a row; the commanded torque has none.
    usable : (n,) rows that count; a saturated row still tells where the torque is commanded, and only rows without a
        coordinate are passed over.
    is_fitted : (n,) rows whose branches say which start alike; others are held against them.
    """
    noise = torque_noise if rows.command is None else 0.0
    position_coordinates = [
        rows.coordinate[(rows.position == position) & usable] for position in range(len(rows.cranks))
    ]
    span = np.array([np.ptp(values) if values.size else np.inf for values in position_coordinates])
    threshold = np.maximum(TURN_SHARE * span, TURN_NOISE * noise)
    end_band = np.maximum(END_SHARE * span, END_NOISE * noise)
    block_rows: list[tuple[int, int, int, int, int, int]] = []
    for position, cycle, run in rows.runs():
        valid_rows = np.flatnonzero(np.isfinite(rows.coordinate[run]) & ~rows.is_misnumbered[run]) + run.start
        if valid_rows.size < 2:
            continue
        values = rows.coordinate[valid_rows]
        turns = _turns(values, threshold[position], noise)
        for number, (first_turn, last_turn) in enumerate(zip(turns[:-1], turns[1:], strict=True)):
            sense = 1 if values[last_turn] >= values[first_turn] else -1
            begin = valid_rows[first_turn] + (number > 0)  # the extreme itself ends the branch that leads to it
            block_rows.append((position, cycle, sense, number, int(begin), int(valid_rows[last_turn]) + 1))
    of_position, of_cycle, direction, branch, start, stop = np.array(block_rows, dtype=np.int64).reshape(-1, 6).T
    order = np.argsort(~is_fitted[start], kind="stable")
    kind = np.empty(len(start), np.int64)
    kind[order] = _kinds(of_position[order], direction[order], rows.coordinate[start][order], span)
    return BranchBlocks(
        position=of_position,
        cycle=of_cycle,
        direction=direction,
        branch=branch,
        kind=kind,
        start=start,
        stop=stop,
        threshold=threshold,
        end_band=end_band,
    )


def _turns(values: Real, threshold: float, noise: float) -> Whole:
    """Turning points (n_turns,) of a torque; of its mean over neighbouring rows where chatter alone turns it."""
    turns = turning_points(values, threshold)
    width = 2 * (len(values) // (2 * SMOOTHED_PARTS)) + 1
    if noise == 0.0 or width < FEWEST_COMPARED:
        return turns
    calm = turning_points(scipy.ndimage.uniform_filter1d(values, width, mode="nearest"), threshold)
    return calm if len(calm) < len(turns) else turns


def _kinds(position: Whole, direction: Whole, start: Real, span: Real) -> Whole:
    """Numbers (n_blocks,) of branches that start alike: by sense, and by torque within a share of the range."""
    known_kinds: list[tuple[int, float]] = []
    kinds = []
    for number, sense, torque in zip(position, direction, start, strict=True):
        matching_kinds = [
            k
            for k, (known_sense, known_torque) in enumerate(known_kinds)
            if known_sense == sense and abs(known_torque - torque) <= EQUAL_SHARE * span[number]
        ]
        kinds.append(matching_kinds[0] if matching_kinds else len(known_kinds))
        known_kinds += [] if matching_kinds else [(sense, torque)]
    return np.array(kinds, dtype=np.int64)


def monotone(values: Real, direction: int) -> Real:
    """Least-squares fit to `values` that never falls (`direction` +1) or never rises (-1)."""
    return np.asarray(isotonic_regression(values, increasing=bool(direction > 0)).x)

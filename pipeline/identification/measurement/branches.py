"""Monotone branches of the measured cycles, their rows averaged over cells of torque, and the turning torques.

A block is a position, a cycle and one monotone branch of the torque (of the commanded torque where it is known: a
motor that runs through the play shakes the measured one). A cycle may start anywhere and turn anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from pipeline.identification.measurement.rows import Rows
from pipeline.identification.measurement.scatter import torque_noise
from pipeline.identification.measurement.unit_file import UnitFile

Real = NDArray[np.float64]
Whole = NDArray[np.int64]
Truth = NDArray[np.bool_]

TURN_SHARE = 0.05
"""Share of a position's torque range by which the torque must come back for a turn: smaller loops are no branches."""
TURN_NOISE = 6.0
"""Standard deviations of the torque by which it must come back: two extremes of noise differ by less."""
CELLS_PER_SENSE = 24
CELL_POWER = 1.5
"""Edges of the cells at T_max (k/n)^1.5: the play and the knees of the curve are near zero torque."""
FEWEST_ROWS = 3
"""Rows in a cell: fewer give no scatter about a line."""
END_SHARE = 0.01
"""Share of a position's torque range from a branch's end over which the turning torque is averaged."""
END_NOISE = 3.0
"""The same in standard deviations of the torque."""


@dataclass(frozen=True)
class Blocks:
    """Monotone branches in time order, position by position; each owns rows `start` to `stop` - 1.

    Attributes
    ----------
    position, cycle : (n_blocks,)
    direction : (n_blocks,) +1 where the torque rises, -1 where it falls.
    branch : (n_blocks,) number within the cycle, from 0.
    start, stop : (n_blocks,) rows.
    threshold : (n_positions,) [N m] by which the torque came back at a turn.
    end_band : (n_positions,) [N m] from a branch's end over which the turning torque is averaged.
    """

    position: Whole
    cycle: Whole
    direction: Whole
    branch: Whole
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


@dataclass(frozen=True)
class Cells:
    """Averages of the usable rows of a block over neighbouring torques, in time order, block by block.

    Attributes
    ----------
    block, position, cycle, direction : (n_cells,)
    torque_mean, angle_mean : (n_cells,) [N m], [arcmin].
    count : (n_cells,) rows.
    angle_spread : (n_cells,) [arcmin] standard deviation of the angle about its line over the torque.
    time_mean, temperature_mean : (n_cells,) [s], [deg C]; NaN where not measured.
    first_row : (n_cells,)
    """

    block: Whole
    position: Whole
    cycle: Whole
    direction: Whole
    torque_mean: Real
    angle_mean: Real
    count: Whole
    angle_spread: Real
    time_mean: Real
    temperature_mean: Real
    first_row: Whole

    def __len__(self) -> int:
        return len(self.block)


@dataclass(frozen=True)
class History:
    """Turning torques of each position in time order, over all its cycles, from the first row's torque to the last's.

    Attributes
    ----------
    torque : per position (n_turns + 2,) [N m]; rises and falls in turn.
    leg : (n_blocks,) each block lies between torque[leg] and torque[leg + 1] of its position.
    """

    torque: tuple[Real, ...]
    leg: Whole


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
    last = len(values) - 1
    return np.array([*turns, last] if turns[-1] != last else turns, dtype=np.int64)


def find_blocks(unit: UnitFile, rows: Rows, usable: Truth) -> Blocks:
    """The monotone branches of every cycle.

    Parameters
    ----------
    usable : (n,) rows that count; a saturated row still tells where the torque is commanded, and only rows without a
        coordinate are passed over.
    """
    noise = torque_noise(unit, rows) if rows.command is None else 0.0
    known = [rows.coordinate[(rows.position == position) & usable] for position in range(len(rows.cranks))]
    span = np.array([np.ptp(values) if values.size else np.inf for values in known])
    threshold = np.maximum(TURN_SHARE * span, TURN_NOISE * noise)
    end_band = np.maximum(END_SHARE * span, END_NOISE * noise)
    found: list[tuple[int, int, int, int, int, int]] = []
    for position, cycle, run in rows.runs():
        there = np.flatnonzero(np.isfinite(rows.coordinate[run]) & ~rows.misnumbered[run]) + run.start
        if there.size < 2:
            continue
        values = rows.coordinate[there]
        turns = turning_points(values, threshold[position])
        for number, (first, last) in enumerate(zip(turns[:-1], turns[1:], strict=True)):
            sense = 1 if values[last] >= values[first] else -1
            begin = there[first] + (number > 0)  # the extreme itself ends the branch that leads to it
            found.append((position, cycle, sense, number, int(begin), int(there[last]) + 1))
    of_position, of_cycle, direction, branch, start, stop = np.array(found, dtype=np.int64).reshape(-1, 6).T
    return Blocks(of_position, of_cycle, direction, branch, start, stop, threshold, end_band)


def cells(rows: Rows, usable: Truth, blocks: Blocks, levels: int = CELLS_PER_SENSE) -> Cells:
    """Usable rows of each block averaged over cells of torque, at least three rows in each.

    Parameters
    ----------
    levels : cells in each sense of the torque, denser near zero; the same edges for all blocks of a position.

    Notes
    -----
    A row belongs to the cell of its place on the monotone (isotonic least-squares) fit of the torque over the block's
    rows: cells are then runs of rows in time, and noise of the torque does not bias their mean. A block with fewer than
    three usable rows has no cell.
    """
    owners: list[int] = []
    averages: list[tuple[float, ...]] = []
    for position in range(len(rows.cranks)):
        inside = usable & (rows.position == position)
        top = np.max(np.abs(rows.coordinate[inside]), initial=0.0)
        ladder = top * (np.arange(levels + 1) / levels) ** CELL_POWER
        edges = np.concatenate([-ladder[:0:-1], ladder])[1:-1]
        for block in np.flatnonzero(blocks.position == position).tolist():
            kept = np.flatnonzero(usable[blocks.rows[block]]) + blocks.start[block]
            if kept.size < FEWEST_ROWS:
                continue
            place = np.searchsorted(edges, monotone(rows.coordinate[kept], blocks.direction[block]))
            groups = _merged(place, levels - 1)
            owners += [block] * len(groups)
            averages += [_average(rows, kept[first:last]) for first, last in groups]
    block_of = np.array(owners, dtype=np.int64)
    torque, angle, count, spread, time, temperature, first_row = np.array(averages, float).reshape(-1, 7).T
    return Cells(
        block=block_of,
        position=blocks.position[block_of],
        cycle=blocks.cycle[block_of],
        direction=blocks.direction[block_of],
        torque_mean=torque,
        angle_mean=angle,
        count=count.astype(np.int64),
        angle_spread=spread,
        time_mean=time,
        temperature_mean=temperature,
        first_row=first_row.astype(np.int64),
    )


def history(rows: Rows, blocks: Blocks) -> History:
    """Turning torques over all cycles of each position: measured ones, averaged near each end of a branch."""
    torques: list[Real] = []
    leg = np.zeros(len(blocks), np.int64)
    for position in range(len(rows.cranks)):
        turns: list[float] = []
        for block in np.flatnonzero(blocks.position == position).tolist():
            start, end = _end_torques(rows, blocks, block)
            if not turns:
                turns = [start]
            elif abs(turns[-1] - start) > blocks.threshold[position]:
                _go_on(turns, start)  # between two cycles the bench went elsewhere
            _go_on(turns, end)
            leg[block] = len(turns) - 2
        torques.append(np.array(turns))
    return History(tuple(torques), leg)


def monotone(values: Real, direction: int) -> Real:
    """Least-squares fit to `values` that never falls (`direction` +1) or never rises (-1)."""
    return np.asarray(isotonic_regression(values, increasing=bool(direction > 0)).x)


def _go_on(turns: list[float], torque: float) -> None:
    """Add a torque to the sequence; one further in the same direction takes the place of the last."""
    if len(turns) > 1 and (torque - turns[-1]) * (turns[-1] - turns[-2]) >= 0:
        turns[-1] = torque
    else:
        turns.append(torque)


def _end_torques(rows: Rows, blocks: Blocks, block: int) -> tuple[float, float]:
    """Mean torque near the first and the last row of a block [N m]."""
    span = blocks.rows[block]
    known = np.isfinite(rows.coordinate[span]) & np.isfinite(rows.torque[span])
    torque = rows.torque[span][known]
    fit = monotone(rows.coordinate[span][known], blocks.direction[block])
    near = blocks.end_band[blocks.position[block]]
    start, end = (float(np.mean(torque[np.abs(fit - place) <= near])) for place in (fit[0], fit[-1]))
    return start, end


def _merged(place: Whole, zero: int) -> list[tuple[int, int]]:
    """First and last + 1 of each run of equal `place`, runs of fewer than three joined to the shorter neighbour.

    A run is joined across zero torque (from `zero` to `zero` + 1) only where it has no other neighbour: the play lies
    there.
    """
    cuts = np.flatnonzero(np.diff(place)) + 1
    bounds = [0, *cuts.tolist(), len(place)]
    while len(bounds) > 2:
        sizes = np.diff(bounds)
        small = int(np.argmin(sizes))
        if sizes[small] >= FEWEST_ROWS:
            break
        sides = []
        for neighbour, cut in ((small - 1, small), (small + 1, small + 1)):
            if 0 <= neighbour < len(sizes):
                ends = place[bounds[cut] - 1], place[bounds[cut]]
                across = min(ends) <= zero < max(ends)
                sides.append((across, sizes[neighbour], cut))
        del bounds[min(sides)[2]]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


def _average(rows: Rows, kept: Whole) -> tuple[float, ...]:
    """The averages of `Cells` over some rows, from `torque_mean` to `first_row`."""
    torque, angle = rows.torque[kept], rows.angle[kept]
    from_mean = torque - torque.mean()
    scatter = np.sum(from_mean**2)
    slope = np.sum(from_mean * angle) / scatter if scatter > 0 else 0.0
    rest = angle - angle.mean() - slope * from_mean
    return (
        torque.mean(),
        angle.mean(),
        kept.size,
        np.sqrt(np.sum(rest**2) / max(kept.size - 2, 1)),
        np.nan if rows.time is None else rows.time[kept].mean(),
        np.nan if rows.temperature is None else rows.temperature[kept].mean(),
        kept[0],
    )

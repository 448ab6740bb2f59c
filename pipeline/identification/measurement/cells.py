"""Rows of a branch averaged over cells of torque: what is fitted."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness
from pipeline.identification.measurement.branches import BranchBlocks, monotone
from pipeline.identification.measurement.enough import FEWEST_COMPARED, UNLOADED_SHARE
from pipeline.identification.measurement.rows import Rows

CELLS_PER_SENSE: Fineness = 24
"""Torque intervals of a branch of one sense whose rows are averaged."""
CELL_POWER = 1.5
"""Edges of the cells at T_max (k/n)^1.5: the play and the knees of the curve are near zero torque."""


@dataclass(frozen=True)
class Cells:
    """Averages of the usable rows of a block over neighbouring torques, in time order, block by block.

    Attributes
    ----------
    block, position, cycle, direction : (n_cells,)
    torque_mean, angle_mean : (n_cells,) [N m], [arcmin].
    count : (n_cells,) rows.
    angle_spread : (n_cells,) [arcmin] standard deviation of the angle about its line over the torque; NaN of a cell of
        one row.
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

    def some(self, chosen: Truth) -> "Cells":
        """The cells that are chosen (n_cells,)."""
        return Cells(**{name: values[chosen] for name, values in vars(self).items()})

    @property
    def are_rows(self) -> bool:
        """Whether each cell is one row."""
        return bool(np.all(self.count == 1))


def cell_edges(top: float) -> Real:
    """Torques [N m] (2 CELLS_PER_SENSE - 1,) between the cells of loops up to a torque ``top`` [N m]."""
    levels = top * (np.arange(CELLS_PER_SENSE + 1) / CELLS_PER_SENSE) ** CELL_POWER
    return np.concatenate([-levels[:0:-1], levels])[1:-1]


def are_rows_few(usable: Truth, blocks: BranchBlocks) -> bool:
    """Whether even the longest block has fewer than three usable rows for each interval of torque."""
    most_rows = max((np.count_nonzero(usable[of_block]) for of_block in blocks.rows), default=0)
    return bool(most_rows < FEWEST_COMPARED * (2 * CELLS_PER_SENSE - 1))


def cells(rows: Rows, usable: Truth, blocks: BranchBlocks, *, may_be_single: bool = False) -> Cells:
    """Usable rows of each block averaged over cells of torque, at least three rows in each.

    Parameters
    ----------
    may_be_single : whether each row is a cell of its own if even the longest block has fewer than three rows for each
        interval of torque: friction shows in the first rows after the torque has turned, which a mean would hide.

    Notes
    -----
    Cells are denser near zero torque; their edges are the same for all blocks of a position.

    A row belongs to the cell of its place on the monotone (isotonic least-squares) fit of the torque over the block's
    rows: cells are then runs of rows in time, and noise of the torque does not bias their mean. A block with fewer than
    three usable rows has no cell.

    The first branch of a position has no cells before the torque exceeds ``UNLOADED_SHARE`` of the largest one. Until
    then the angle depends on the position in the play and on the friction with which the record began, and both are
    unknown. The rows remain in the load history.
    """
    owners: list[int] = []
    averages: list[tuple[float, ...]] = []
    is_single = may_be_single and are_rows_few(usable, blocks)
    for position in range(len(rows.cranks)):
        in_position = usable & (rows.position == position)
        top = np.max(np.abs(rows.coordinate[in_position]), initial=0.0)
        edges = cell_edges(top)
        for number, block in enumerate(np.flatnonzero(blocks.position == position).tolist()):
            usable_rows = np.flatnonzero(usable[blocks.rows[block]]) + blocks.start[block]
            if number == 0:
                is_loaded = np.abs(rows.coordinate[usable_rows]) > UNLOADED_SHARE * top
                usable_rows = usable_rows[int(np.argmax(is_loaded)) if np.any(is_loaded) else 0 :]
            if usable_rows.size < FEWEST_COMPARED:
                continue
            if is_single:
                groups = [(row, row + 1) for row in range(usable_rows.size)]
            else:
                bin_index = np.searchsorted(edges, monotone(rows.coordinate[usable_rows], blocks.direction[block]))
                groups = _merged_runs(bin_index, CELLS_PER_SENSE - 1)
            owners += [block] * len(groups)
            averages += [_average(rows, usable_rows[group_start:group_end]) for group_start, group_end in groups]
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


def _merged_runs(bin_number: Whole, zero: int) -> list[tuple[int, int]]:
    """First and last + 1 of each run of equal `bin_number`, runs of fewer than three joined to the shorter neighbour.

    A run is joined across zero torque (from `zero` to `zero` + 1) only where it has no other neighbour: the play lies
    there.
    """
    cuts = np.flatnonzero(np.diff(bin_number)) + 1
    bounds = [0, *cuts.tolist(), len(bin_number)]
    while len(bounds) > 2:
        sizes = np.diff(bounds)
        small = int(np.argmin(sizes))
        if sizes[small] >= FEWEST_COMPARED:
            break
        sides = []
        for neighbour, cut in ((small - 1, small), (small + 1, small + 1)):
            if 0 <= neighbour < len(sizes):
                ends = bin_number[bounds[cut] - 1], bin_number[bounds[cut]]
                crosses_zero = min(ends) <= zero < max(ends)
                sides.append((crosses_zero, sizes[neighbour], cut))
        del bounds[min(sides)[2]]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


def _average(rows: Rows, row_numbers: Whole) -> tuple[float, ...]:
    """The averages of `Cells` over some rows, from `torque_mean` to `first_row`."""
    torque, angle = rows.torque[row_numbers], rows.angle[row_numbers]
    total = np.add.reduce  # of these few rows np.mean takes five times as long
    torque_mean, angle_mean = total(torque) / row_numbers.size, total(angle) / row_numbers.size
    from_mean = torque - torque_mean
    scatter = total(from_mean**2)
    slope = total(from_mean * angle) / scatter if scatter > 0 else 0.0
    line_residual = angle - angle_mean - slope * from_mean
    return (
        torque_mean,
        angle_mean,
        row_numbers.size,
        np.sqrt(total(line_residual**2) / max(row_numbers.size - 2, 1)) if row_numbers.size > 1 else np.nan,
        np.nan if rows.time is None else total(rows.time[row_numbers]) / row_numbers.size,
        np.nan if rows.temperature is None else total(rows.temperature[row_numbers]) / row_numbers.size,
        row_numbers[0],
    )

"""Branches that repeat each other: their angles held against each other at equal torque."""

from typing import NamedTuple

import numpy as np
from scipy import sparse

from pipeline.arrays import Index, Real, Truth, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import FEWEST_COMPARED, SURE
from pipeline.identification.measurement.estimate import high_frequency_scatter

STEEP = 3.0
"""Slopes beyond this multiple of a branch's chord are left out of repeats: in the play and on the steps of a cogging
motor the difference of two repeats is the noise of the torque times the slope, not that of the angle."""
PLAY_SHARE = 0.1
"""Height of a jump, over the range of the angle, from which it is a way through the play: a knee of the curve scatters
too."""
SAME_PLACE: Rounding = 0.02
"""Share of the torque between two rows within which a torque is that of the nearer one."""


class UsableRows(NamedTuple):
    """Rows that belong to cells.

    Attributes
    ----------
    number : (n,) among all rows, ascending.
    torque, angle : (n,) [N m], [arcmin].
    """

    number: Index
    torque: Real
    angle: Real

    def of_cells(self, cells: Cells, chosen_cells: Index) -> Index:
        """Places of the rows of chosen cells in these arrays, cell by cell."""
        starts = np.searchsorted(self.number, cells.first_row[chosen_cells])
        counts = cells.count[chosen_cells]
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return np.asarray(np.repeat(starts, counts) + within)


class Branch(NamedTuple):
    """Cells of a block, and their rows.

    Attributes
    ----------
    torque : (n,) ascending [N m].
    angle : (n,) [arcmin].
    row_count : (n,) rows of each cell.
    row_torque, row_angle : (n_rows,) [N m], [arcmin] of the rows, cell by cell.
    blur, row_blur : usual standard deviation of a cell's mean angle and of its rows, by their scatter [arcmin].
    """

    torque: Real
    angle: Real
    row_count: Whole
    row_torque: Real
    row_angle: Real
    blur: float
    row_blur: float

    @property
    def cell_of_row(self) -> Index:
        """Place of the cell of each row (n_rows,)."""
        return np.repeat(np.arange(len(self.row_count)), self.row_count)

    @property
    def by_torque(self) -> tuple[Real, Real, Whole]:
        """Different torques of the rows, ascending, their mean angle, and rows at each, each (n_torques,)."""
        torque, number, count = np.unique(self.row_torque, return_inverse=True, return_counts=True)
        return torque, np.bincount(number.ravel(), self.row_angle) / count, count


NO_BRANCH = Branch(np.empty(0), np.empty(0), np.empty(0, np.int64), np.empty(0), np.empty(0), 0.0, 0.0)
"""Of which no cell is known."""


def branch_of(cells: Cells, block: int, rows: UsableRows) -> Branch:
    """The cells of a block."""
    block_cells = _ascending(cells, block)
    of_rows = rows.of_cells(cells, block_cells)
    return Branch(
        cells.torque_mean[block_cells],
        cells.angle_mean[block_cells],
        cells.count[block_cells],
        rows.torque[of_rows],
        rows.angle[of_rows],
        *_blurs(cells, block_cells),
    )


def _ascending(cells: Cells, block: int) -> Index:
    """Cells of a block by ascending torque."""
    block_cells = np.flatnonzero(cells.block == block)
    return block_cells[np.argsort(cells.torque_mean[block_cells], kind="stable")]


def _blurs(cells: Cells, chosen_cells: Index) -> tuple[float, float]:
    """Usual standard deviation of a cell's mean angle and of its rows [arcmin], by the scatter of the rows.

    Of cells of one row by the scatter of these along the branch.
    """
    spread = cells.angle_spread[chosen_cells]
    known = np.isfinite(spread)
    if not np.any(known):
        scatter = high_frequency_scatter(cells.angle_mean[chosen_cells], [slice(None)])
        return (scatter, scatter) if np.isfinite(scatter) else (0.0, 0.0)
    count = np.maximum(cells.count[chosen_cells][known], 1)
    return float(np.median(spread[known] / np.sqrt(count))), float(np.median(spread[known]))


def mean_branch(branches: list[Branch]) -> Branch:
    """Mean angle over the repeats of a branch, at the torques of the first that all of them reach."""
    measured_branches = [branch for branch in branches if branch.torque.size]
    if not measured_branches:
        return NO_BRANCH
    low = max(branch.torque[0] for branch in measured_branches)
    high = min(branch.torque[-1] for branch in measured_branches)
    first = measured_branches[0]
    is_common = (first.torque >= low) & (first.torque <= high)
    row_torque = first.row_torque[is_common[first.cell_of_row]]
    row_angle = np.mean([np.interp(row_torque, *branch.by_torque[:2]) for branch in measured_branches], axis=0)
    blurs = np.mean([(branch.blur, branch.row_blur) for branch in measured_branches], axis=0)
    count = first.row_count[is_common]
    angle = np.bincount(np.repeat(np.arange(len(count)), count), row_angle, len(count)) / count
    blur, row_blur = (blurs / np.sqrt(len(measured_branches))).tolist()
    return Branch(first.torque[is_common], angle, count, row_torque, row_angle, blur, row_blur)


Loop = dict[int, Branch]
"""Mean branches of a position by their kind."""


def mean_loops(blocks: BranchBlocks, cells: Cells, rows: UsableRows) -> list[Loop]:
    """The branches of each position averaged over all cycles, but for its first branch."""
    loops: list[Loop] = []
    for position in np.unique(blocks.position):
        kinds: dict[int, list[int]] = {}
        for block in np.flatnonzero(blocks.position == position)[1:]:
            kinds.setdefault(int(blocks.kind[block]), []).append(block)
        branches = {kind: [branch_of(cells, block, rows) for block in members] for kind, members in kinds.items()}
        loops.append({kind: mean_branch(members) for kind, members in branches.items()})
    return loops


def loop_distance(loop: Loop, second: Loop) -> float:
    """Rms difference [arcmin] of two mean loops, their offset removed; NaN where they have nothing in common."""
    differences = loop_differences(loop, second)
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2))) if differences else np.nan


def loop_differences(loop: Loop, second: Loop) -> list[Real]:
    """Differences [arcmin] of two mean loops, a list entry per kind of branch that both have, their offset removed."""
    return centred_differences([angle_difference(loop[kind], second[kind]) for kind in loop if kind in second])


class Difference(NamedTuple):
    """What two branches that repeat each other differ by, at the torques of the first that both reach.

    Attributes
    ----------
    angle : (n,) [arcmin].
    variance : (n,) in that of the difference of two cells.
    """

    angle: Real
    variance: Real


def angle_difference(branch: Branch, second: Branch) -> Difference:
    """Angle of `second` less `branch` at its cells, steep places left out."""
    second_angle, variance = on_cells(second, branch)
    is_comparable = np.isfinite(second_angle)
    if np.any(is_comparable):
        is_steep = _is_steep(branch.torque, branch.angle, branch.blur)
        is_comparable &= ~is_steep & ~_meets_jump(branch, branch)
    return Difference((second_angle - branch.angle)[is_comparable], 0.5 * (1 + variance[is_comparable]))


def on_cells(branch: Branch, cells: Branch) -> tuple[Real, Real]:
    """Mean angle of a branch at the rows of another branch's cells, and its variance in that of a cell.

    Interpolated between rows, not between cells, because the curve is bent over a cell of few rows. NaN where the
    branch does not reach a cell, is steep or jumps. Between two rows whose angles differ by as much as a way through
    the play, as on a coarse staircase, only their own torques are compared.
    """
    if min(branch.torque.size, cells.torque.size) < FEWEST_COMPARED:
        return np.full(len(cells.torque), np.nan), np.ones(len(cells.torque))
    torque, angle, count = branch.by_torque
    upper = np.clip(np.searchsorted(torque, cells.row_torque), 1, torque.size - 1)
    share = (cells.row_torque - torque[upper - 1]) / (torque[upper] - torque[upper - 1])
    share = np.clip(share, 0, 1)
    may_jump = _rises(branch, angle)[upper - 1] > PLAY_SHARE * np.ptp(angle)
    is_between = may_jump & (np.abs(share - np.rint(share)) > SAME_PLACE)
    rows = np.tile(cells.cell_of_row, 2), np.append(upper - 1, upper)
    weights = sparse.csr_array((np.append(1 - share, share), rows), (len(cells.torque), len(torque)))
    is_known = _is_even(branch, cells.torque) & ~_meets_jump(branch, cells)
    is_known &= np.bincount(cells.cell_of_row, is_between, len(cells.torque)) == 0
    variance = weights**2 @ (1 / count) / cells.row_count
    return np.where(is_known, weights @ angle / cells.row_count, np.nan), variance


def _is_even(branch: Branch, level: Real) -> Truth:
    """Torques that a branch reaches and where it is not steep."""
    torque = branch.torque
    is_steep = _is_steep(torque, branch.angle, branch.blur)
    steep = is_steep[np.clip(np.searchsorted(torque, level), 0, torque.size - 1)]
    is_even: Truth = (level >= torque[0]) & (level <= torque[-1]) & ~steep
    return is_even


def _meets_jump(branch: Branch, cells: Branch) -> Truth:
    """Cells (n_cells,) within whose torques a branch jumps between two rows, as through the play.

    The slope between cells does not show such a jump where cells are wide.
    """
    torque, angle, _ = branch.by_torque
    rise, angle_range = _rises(branch, angle), np.ptp(angle)
    is_steep = rise * np.ptp(torque) > STEEP * angle_range * np.diff(torque)
    jumps = np.flatnonzero(is_steep & (rise > PLAY_SHARE * angle_range))
    starts = np.cumsum(cells.row_count) - cells.row_count
    lowest, highest = (extreme.reduceat(cells.row_torque, starts)[:, None] for extreme in (np.minimum, np.maximum))
    return np.asarray(np.any((torque[jumps] < highest) & (torque[jumps + 1] > lowest), axis=1))


def _rises(branch: Branch, angle: Real) -> Real:
    """Size of the steps between the angles (n_torques,) of a branch, less what the noise of its rows makes of them."""
    return np.asarray(np.abs(np.diff(angle)) - SURE * np.sqrt(2) * branch.row_blur)


def _is_steep(torque: Real, angle: Real, blur: float) -> Truth:
    """Whether the curve beside each cell is steeper than `STEEP` chords of the whole branch, and not by its noise."""
    rise, run = np.abs(np.diff(angle)) - SURE * np.sqrt(2) * blur, np.abs(np.diff(torque))
    steep = rise * np.ptp(torque) > STEEP * np.ptp(angle) * run
    is_steep: Truth = np.concatenate([[False], steep]) | np.concatenate([steep, [False]])
    return is_steep


def steep_cells(cells: Cells) -> Truth:
    """Cells (n_cells,) beside which the curve is steep: those that are not compared with their repeats."""
    steep = np.zeros(len(cells), bool)
    for block in np.unique(cells.block):
        of_block = _ascending(cells, block)
        steep[of_block] = _is_steep(cells.torque_mean[of_block], cells.angle_mean[of_block], _blurs(cells, of_block)[0])
    return steep


def centred_differences(differences: list[Difference]) -> list[Real]:
    """The differences of one pair of loops less their common mean, the offset of the pair, for equal variances.

    The mean takes one of their n degrees of freedom.
    """
    nonempty = [difference for difference in differences if difference.angle.size]
    n = sum(difference.angle.size for difference in nonempty)
    if n < 2:
        return []
    angle, variance = (np.concatenate(values) for values in zip(*nonempty, strict=True))
    offset = np.average(angle, weights=1 / variance)
    return [(values - offset) * np.sqrt(n / (n - 1) / variances) for values, variances in nonempty]

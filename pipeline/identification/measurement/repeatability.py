"""How well a measurement repeats: the noise floor that no model can go below, and the scatter within a branch.

All numbers are of cells (averages over neighbouring torques), which are what is fitted.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth
from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import FEWEST_COMPARED, FEWEST_SCATTERED
from pipeline.identification.measurement.estimate import (
    UNKNOWN_NOISE,
    NoiseEstimate,
    pooled_noise,
    rms,
    robust,
    scaled_estimate,
)
from pipeline.identification.measurement.repeated_branches import (
    NO_BRANCH,
    Branch,
    UsableRows,
    angle_difference,
    branch_of,
    centred_differences,
    loop_differences,
    mean_loops,
    on_cells,
    steep_cells,
)

SHARED_LEVEL = 0.01
"""Chance at which repeats without anything in common are taken to have something: every verdict rests on the floor, and
2 % of units without an effect may be judged wrongly at most."""


class Floor(NamedTuple):
    """The noise floor of a unit's cells [arcmin], and in words what it is."""

    value: float
    words: str


@dataclass(frozen=True)
class Noise:
    """Repeatability of a unit's cells.

    Attributes
    ----------
    repeats : rms difference of repeats (consecutive cycles) at equal position, branch and torque, the offset of each
        pair of cycles removed, over sqrt 2 [arcmin]. Drift and run-in between cycles are in it.
    random : the same less what all positions have in common from cycle to cycle, and what goes with the temperature:
        run-in, creep and thermal growth are effects and no noise. From two positions on.
    is_shared : whether what `random` lacks of `repeats` is more than chance: else `repeats` are the better known of the
        two, since what all positions might share takes up to nine tenths of the differences.
    within_branch : scatter of a cell about the line through its neighbours [arcmin], robust; no drift is in it, and no
        noise that neighbours share.
    between_positions : as `repeats`, between the mean loops of neighbouring positions; not divided by anything that the
        crank angle explains.
    row_scatter_arcmin : rms of the angle of rows about the line of their cell [arcmin], of cells that are not steep.
    torque_noise_Nm : of a row, declared or estimated.
    resolution_arcmin : standard deviation of a uniform error within a step of the angle; 0 where no step is declared.
    """

    repeats: NoiseEstimate
    random: NoiseEstimate
    is_shared: bool
    within_branch: NoiseEstimate
    between_positions: NoiseEstimate
    row_scatter_arcmin: float
    torque_noise_Nm: float
    resolution_arcmin: float = 0.0

    @property
    def floor(self) -> Floor:
        """The noise floor, the one that errors are counted in: what is known best, and no less than the resolution."""
        for estimate, words in (
            (
                self.random if self.is_shared else UNKNOWN_NOISE,
                "scatter of repeats beyond what all positions have in common",
            ),
            (self.repeats, "scatter of repeats"),
            (self.within_branch, "scatter within a branch"),
        ):
            if np.isfinite(estimate.value) and estimate.value > 0:
                if estimate.value < self.resolution_arcmin:
                    break
                return Floor(estimate.value, words)
        return Floor(self.resolution_arcmin, "resolution of the angle")


def measured_noise(
    blocks: BranchBlocks, cells: Cells, rows: UsableRows, torque_noise: float, resolution: float = 0.0
) -> Noise:
    """Noise of the cells of a unit, whose rows have a noise of the torque [N m] and an angle in steps [arcmin].

    Notes
    -----
    The first branch of a position starts from a state that nobody knows and is left out of repeats. Branches are
    compared by their kind (sense and first torque), over the cells of the earlier one, by linear interpolation
    between the rows of the other.
    """
    is_even = ~steep_cells(cells)
    count = np.maximum(cells.count - 2, 0) * is_even
    row_variance = np.sum(count * cells.angle_spread**2) / np.sum(count) if count.any() else np.nan
    row_scatter = float(np.sqrt(row_variance))
    random, is_shared = _random(blocks, cells, rows)

    def of_all_cells(estimate: NoiseEstimate) -> NoiseEstimate:
        """The estimate from cells that are not steep for all: independent noise of rows goes with their number."""
        if not (np.isfinite(row_scatter) and estimate.value > 0):
            return estimate
        share, usual_share = float(np.mean(1 / cells.count[is_even])), float(np.mean(1 / cells.count))
        of_rows = min(row_scatter**2 * share / estimate.value**2, 1.0)
        return scaled_estimate(estimate, float(np.sqrt(1 + of_rows * (usual_share / share - 1))))

    return Noise(
        repeats=of_all_cells(rms(_repeats(blocks, cells, rows), np.sqrt(2))),
        random=of_all_cells(random),
        is_shared=is_shared,
        within_branch=robust(_from_neighbours(cells)),
        between_positions=rms(_positions_apart(blocks, cells, rows), np.sqrt(2)),
        row_scatter_arcmin=row_scatter,
        torque_noise_Nm=torque_noise,
        resolution_arcmin=resolution / float(np.sqrt(12)),
    )


def restrict_to_training(blocks: BranchBlocks, cells: Cells, is_training: Truth) -> tuple[BranchBlocks, Cells]:
    """Branches that have a cell of the training data (n_cells,), numbered anew, and these cells."""
    trained_cells, of_blocks = cells.some(is_training), ("position", "cycle", "direction", "branch", "start", "stop")
    numbers = np.unique(trained_cells.block)
    trained_blocks = replace(blocks, **{name: getattr(blocks, name)[numbers] for name in of_blocks})
    return trained_blocks, replace(trained_cells, block=np.searchsorted(numbers, trained_cells.block))


def _repeats(blocks: BranchBlocks, cells: Cells, rows: UsableRows) -> list[Real]:
    """Differences between consecutive cycles, a list entry per pair of branches, each pair of cycles centred."""
    differences_of_repeats: list[Real] = []
    for position in np.unique(blocks.position):
        of_position = np.flatnonzero(blocks.position == position)
        order = list(dict.fromkeys(blocks.cycle[of_position].tolist()))
        for cycle_before, cycle_after in zip(order[:-1], order[1:], strict=True):
            differences = []
            for block in of_position[blocks.cycle[of_position] == cycle_before]:
                one = branch_of(cells, block, rows)
                for second in of_position[
                    (blocks.cycle[of_position] == cycle_after) & (blocks.kind[of_position] == blocks.kind[block])
                ]:
                    if block != of_position[0]:
                        differences.append(angle_difference(one, branch_of(cells, second, rows)))
            differences_of_repeats += centred_differences(differences)
    return differences_of_repeats


def _positions_apart(blocks: BranchBlocks, cells: Cells, rows: UsableRows) -> list[Real]:
    """Differences between the mean loops of neighbouring positions."""
    loops = mean_loops(blocks, cells, rows)
    return [
        part
        for first_loop, second_loop in zip(loops[:-1], loops[1:], strict=True)
        for part in loop_differences(first_loop, second_loop)
    ]


class Loops(NamedTuple):
    """Cycles of all positions at the torques of the longest branch of every kind.

    Attributes
    ----------
    position, cycle : (n_loops,)
    angle : (n_loops, n_nodes) [arcmin] less its mean over the nodes that all loops reach; NaN where a loop does not
        reach or is steep.
    variance : (n_loops, n_nodes) of the angle, in that of a cell.
    temperature : (n_loops,) [deg C]; NaN where not measured.
    n_centred : nodes of the mean.
    """

    position: Real
    cycle: Real
    angle: Real
    variance: Real
    temperature: Real
    n_centred: int


def _random(blocks: BranchBlocks, cells: Cells, rows: UsableRows) -> tuple[NoiseEstimate, bool]:
    """Scatter of loops beyond what position, cycle and temperature explain at equal torque; whether the last two do.

    A two-way layout of positions and cycles at every torque; an analysis of variance tells chance from what is shared.
    """
    loops = _loops(blocks, cells, rows)
    if loops.n_centred < 2 or len(np.unique(loops.position)) < 2:
        return UNKNOWN_NOISE, False
    of_position, of_cycle = (
        (number[:, None] == np.unique(number)).astype(float) for number in (loops.position, loops.cycle)
    )
    shared_columns = [of_cycle]
    if np.all(np.isfinite(loops.temperature)) and np.ptp(loops.temperature) > 0:
        shared_columns.append(loops.temperature[:, None] / np.ptp(loops.temperature))
    position_squares, position_expected = _unexplained_squares(loops, of_position)
    squares, expected_squares = _unexplained_squares(loops, np.hstack([of_position, *shared_columns]))
    freedom, shared_free = expected_squares.sum(), position_expected.sum() - expected_squares.sum()
    if min(freedom, shared_free) < 1 or not squares.sum() > 0:
        return UNKNOWN_NOISE, False
    ratio = (position_squares.sum() - squares.sum()) / shared_free / (squares.sum() / freedom)
    informative = expected_squares > 0
    return pooled_noise(squares[informative], expected_squares[informative], 1.0), bool(
        fdtrc(shared_free, freedom, ratio) < SHARED_LEVEL
    )


def _unexplained_squares(loops: Loops, columns: Real) -> tuple[Real, Real]:
    """What ``columns`` (n_loops, n_columns) leave of the angle at each node.

    Returns
    -------
    squares : (n_loops,) sum of its squares over the nodes [arcmin2].
    expected : (n_loops,) the same of cells of unit variance.
    """
    squares, expected_squares = np.zeros(len(columns)), np.zeros(len(columns))
    is_finite = np.isfinite(loops.angle)
    for pattern in np.unique(is_finite, axis=1).T:
        nodes = np.all(is_finite == pattern[:, None], axis=0)
        basis, sizes, _ = np.linalg.svd(columns[pattern], full_matrices=False)
        basis = basis[:, sizes > 1e-9 * np.max(sizes, initial=1.0)]
        leaving = np.eye(len(basis)) - basis @ basis.T
        squares[pattern] += np.sum((leaving @ loops.angle[np.ix_(pattern, nodes)]) ** 2, axis=1)
        expected_squares[pattern] += np.sum(leaving**2 @ loops.variance[np.ix_(pattern, nodes)], axis=1)
    return squares, expected_squares * (1 - 1 / loops.n_centred)


def _loops(blocks: BranchBlocks, cells: Cells, usable_rows: UsableRows) -> Loops:
    """The loops of all cycles; several branches of a kind within a cycle are told apart by their order."""
    branches: dict[tuple[int, int], dict[tuple[int, int], Branch]] = {}
    for position in np.unique(blocks.position).tolist():
        of_position = np.flatnonzero(blocks.position == position)
        for block in of_position.tolist():
            of_cycle = branches.setdefault((position, int(blocks.cycle[block])), {})
            kind = int(blocks.kind[block])
            number = sum(kind == kind_before for kind_before, _ in of_cycle)
            of_cycle[kind, number] = branch_of(cells, block, usable_rows) if block != of_position[0] else NO_BRANCH
    longest: dict[tuple[int, int], Branch] = {}
    for of_cycle in branches.values():
        for key, branch in of_cycle.items():
            longest[key] = max(longest.get(key, branch), branch, key=lambda one: len(one.torque))
    rows = []
    for (position, cycle), of_cycle in branches.items():
        parts = [on_cells(of_cycle.get(key, NO_BRANCH), nodes) for key, nodes in longest.items()]
        angle, variance = (np.concatenate(part) for part in zip(*parts, strict=True))
        temperature = _mean(cells.temperature_mean[(cells.position == position) & (cells.cycle == cycle)])
        if np.any(np.isfinite(angle)):
            rows.append((position, cycle, angle, variance, temperature))
    if not rows:
        return Loops(np.empty(0), np.empty(0), np.empty((0, 0)), np.empty((0, 0)), np.empty(0), 0)
    position_of, cycle_of, angles, variances, temperatures = (np.array(values) for values in zip(*rows, strict=True))
    in_all_loops = np.all(np.isfinite(angles), axis=0)  # offsets of loops over other torques would not compare
    if np.any(in_all_loops):
        angles = angles - angles[:, in_all_loops].mean(axis=1, keepdims=True)
    return Loops(position_of, cycle_of, angles, variances, temperatures, int(np.count_nonzero(in_all_loops)))


def _mean(values: Real) -> float:
    finite_values = values[np.isfinite(values)]
    return float(finite_values.mean()) if finite_values.size else np.nan


def _from_neighbours(cells: Cells) -> list[Real]:
    """Per block, each inner cell's angle less the line through its neighbours, for unit variance of a cell's noise."""
    neighbour_differences = []
    for block in np.unique(cells.block):
        block_cells = np.flatnonzero(cells.block == block)
        torque, angle = cells.torque_mean[block_cells], cells.angle_mean[block_cells]
        if block_cells.size < FEWEST_COMPARED or cells.count[block_cells].sum() < FEWEST_SCATTERED:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (torque[1:-1] - torque[:-2]) / (torque[2:] - torque[:-2])
        before = np.flatnonzero((share > 0) & (share < 1))
        share = share[before]
        residual = angle[before + 1] - (1 - share) * angle[before] - share * angle[before + 2]
        neighbour_differences.append(residual / np.sqrt(1 + share**2 + (1 - share) ** 2))
    return [values for values in neighbour_differences if values.size]

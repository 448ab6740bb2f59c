"""How well a measurement repeats: the noise floor that no model can go below, and the scatter within a branch.

All numbers are of cells (averages over neighbouring torques), which are what is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.estimate import UNKNOWN, NoiseEstimate, pooled, rms, robust
from pipeline.identification.measurement.repeated_branches import (
    FEWEST_CELLS,
    angle_difference,
    branch_of,
    centred,
    loop_differences,
    mean_loops,
    on_nodes,
)

Real = NDArray[np.float64]


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
    within_branch : scatter of a cell about the line through its neighbours [arcmin], robust; no drift is in it, and no
        noise that neighbours share.
    between_positions : as `repeats`, between the mean loops of neighbouring positions; not divided by anything that the
        crank angle explains.
    row_scatter_arcmin : rms of the angle of rows about the line of their cell [arcmin].
    torque_noise_Nm : of a row, declared or estimated.
    resolution_arcmin : standard deviation of a uniform error within a step of the angle; 0 where no step is declared.
    """

    repeats: NoiseEstimate
    random: NoiseEstimate
    within_branch: NoiseEstimate
    between_positions: NoiseEstimate
    row_scatter_arcmin: float
    torque_noise_Nm: float
    resolution_arcmin: float = 0.0

    @property
    def floor(self) -> Floor:
        """The noise floor, the one that errors are counted in: what is known best, and no less than the resolution."""
        for estimate, words in (
            (self.random, "scatter of repeats beyond what all positions have in common"),
            (self.repeats, "scatter of repeats"),
            (self.within_branch, "scatter within a branch"),
        ):
            if np.isfinite(estimate.value) and estimate.value > 0:
                if estimate.value < self.resolution_arcmin:
                    break
                return Floor(estimate.value, words)
        return Floor(self.resolution_arcmin, "resolution of the angle")


def measured_noise(blocks: BranchBlocks, cells: Cells, torque_noise: float, resolution: float = 0.0) -> Noise:
    """Noise of the cells of a unit, whose rows have a noise of the torque [N m] and an angle in steps [arcmin].

    Notes
    -----
    The first branch of a position starts from a state that nobody knows and is left out of repeats. Branches are
    compared by their kind (sense and first torque), at the torques of the earlier one, by linear interpolation.
    """
    count = np.maximum(cells.count - 2, 0)
    row_variance = np.sum(count * cells.angle_spread**2) / np.sum(count) if count.any() else np.nan
    return Noise(
        repeats=rms(_repeats(blocks, cells), np.sqrt(2)),
        random=_random(blocks, cells),
        within_branch=robust(_from_neighbours(cells)),
        between_positions=rms(_positions_apart(blocks, cells), np.sqrt(2)),
        row_scatter_arcmin=float(np.sqrt(row_variance)),
        torque_noise_Nm=torque_noise,
        resolution_arcmin=resolution / float(np.sqrt(12)),
    )


def restricted(blocks: BranchBlocks, cells: Cells, trained: NDArray[np.bool_]) -> tuple[BranchBlocks, Cells]:
    """Branches that have a cell ``trained`` (n_cells,), numbered anew, and these cells."""
    block_numbers = np.unique(cells.block[trained])
    of_block = {f.name: getattr(blocks, f.name) for f in fields(blocks)}
    of_block |= {
        name: of_block[name][block_numbers] for name in ("position", "cycle", "direction", "branch", "start", "stop")
    }
    of_cell = {f.name: getattr(cells, f.name)[trained] for f in fields(cells)}
    return BranchBlocks(**of_block), Cells(**of_cell | {"block": np.searchsorted(block_numbers, cells.block[trained])})


def _repeats(blocks: BranchBlocks, cells: Cells) -> list[Real]:
    """Differences between consecutive cycles, a list entry per pair of branches, each pair of cycles centred."""
    differences_of_repeats: list[Real] = []
    for position in np.unique(blocks.position):
        of_position = np.flatnonzero(blocks.position == position)
        order = list(dict.fromkeys(blocks.cycle[of_position].tolist()))
        for cycle_before, cycle_after in zip(order[:-1], order[1:], strict=True):
            differences = []
            for block in of_position[blocks.cycle[of_position] == cycle_before]:
                for second in of_position[
                    (blocks.cycle[of_position] == cycle_after) & (blocks.kind[of_position] == blocks.kind[block])
                ]:
                    if block != of_position[0]:
                        differences.append(angle_difference(branch_of(cells, block), branch_of(cells, second)))
            differences_of_repeats += centred(differences)
    return differences_of_repeats


def _positions_apart(blocks: BranchBlocks, cells: Cells) -> list[Real]:
    """Differences between the mean loops of neighbouring positions."""
    loops = mean_loops(blocks, cells)
    return [
        part
        for first_loop, second_loop in zip(loops[:-1], loops[1:], strict=True)
        for part in loop_differences(first_loop, second_loop)
    ]


def _random(blocks: BranchBlocks, cells: Cells) -> NoiseEstimate:
    """Repeats less what cycle number and temperature explain of their differences at equal torque."""
    pairs = _pairs(blocks, cells)
    if len({position for position, _ in pairs}) < 2:
        return UNKNOWN
    keys = sorted(pairs)
    difference = np.array([pairs[key][0] for key in keys])
    is_finite = np.isfinite(difference)
    in_all_pairs = np.all(is_finite, axis=0)  # offsets of pairs over other torques would not compare
    difference -= np.nanmean(
        difference[:, in_all_pairs if np.any(in_all_pairs) else slice(None)], axis=1, keepdims=True
    )
    warmed = np.array([pairs[key][1] for key in keys])
    cycle_before = np.array([cycle for _, cycle in keys])
    design = (cycle_before[:, None] == np.unique(cycle_before)).astype(float)
    if np.all(np.isfinite(warmed)) and np.ptp(warmed) > 0:
        design = np.column_stack([design, warmed / np.ptp(warmed)])
    random_part, free = np.full_like(difference, np.nan), np.full_like(difference, np.nan)
    for pattern in np.unique(is_finite, axis=1).T:
        nodes = np.all(is_finite == pattern[:, None], axis=0)
        basis, sizes, _ = np.linalg.svd(design[pattern], full_matrices=False)
        basis = basis[:, sizes > 1e-9]
        rows = difference[np.ix_(pattern, nodes)]
        random_part[np.ix_(pattern, nodes)] = rows - basis @ (basis.T @ rows)
        free[np.ix_(pattern, nodes)] = (1 - np.sum(basis**2, axis=1))[:, None]
    squares, weights = np.nansum(random_part**2, axis=1), np.nansum(free, axis=1)
    weighted = weights > 1e-6
    return pooled(squares[weighted], weights[weighted], np.sqrt(2))


def _pairs(blocks: BranchBlocks, cells: Cells) -> dict[tuple[int, int], tuple[Real, float]]:
    """By position and cycle: difference (n_nodes,) [arcmin] of the next cycle from it, and how much warmer it was [K].

    At the torques of the first position's branches; NaN where not both reach.
    """
    kinds: dict[int, Real] = {}
    pairs_by_kind = {}
    for position in np.unique(blocks.position):
        of_position = np.flatnonzero(blocks.position == position)
        for block in of_position[1:]:
            kinds.setdefault(int(blocks.kind[block]), branch_of(cells, block).torque)
    for position in np.unique(blocks.position):
        of_position = np.flatnonzero(blocks.position == position)
        loops = {}
        for cycle in dict.fromkeys(blocks.cycle[of_position].tolist()):
            branches_of_cycle = {
                int(blocks.kind[b]): branch_of(cells, b) for b in of_position[1:] if blocks.cycle[b] == cycle
            }
            loops[cycle] = [on_nodes(branches_of_cycle.get(kind), torque) for kind, torque in kinds.items()]
        temperature = {
            c: _mean(cells.temperature_mean[(cells.position == position) & (cells.cycle == c)]) for c in loops
        }
        order = list(loops)
        for cycle_before, cycle_after in zip(order[:-1], order[1:], strict=True):
            parts = [
                (second[0] - branch[0]) * np.sqrt(2 / (branch[1] + second[1]))
                for branch, second in zip(loops[cycle_before], loops[cycle_after], strict=True)
            ]
            joined = np.concatenate(parts)
            if np.any(np.isfinite(joined)):
                pairs_by_kind[int(position), int(cycle_before)] = (
                    joined,
                    temperature[cycle_after] - temperature[cycle_before],
                )
    return pairs_by_kind


def _mean(values: Real) -> float:
    finite_values = values[np.isfinite(values)]
    return float(finite_values.mean()) if finite_values.size else np.nan


def _from_neighbours(cells: Cells) -> list[Real]:
    """Per block, each inner cell's angle less the line through its neighbours, for unit variance of a cell's noise."""
    neighbour_differences = []
    for block in np.unique(cells.block):
        block_cells = np.flatnonzero(cells.block == block)
        torque, angle = cells.torque_mean[block_cells], cells.angle_mean[block_cells]
        if block_cells.size < FEWEST_CELLS:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (torque[1:-1] - torque[:-2]) / (torque[2:] - torque[:-2])
        residual = angle[1:-1] - (1 - share) * angle[:-2] - share * angle[2:]
        is_between = (share > 0) & (share < 1)
        neighbour_differences.append(
            residual[is_between] / np.sqrt(1 + share[is_between] ** 2 + (1 - share[is_between]) ** 2)
        )
    return [values for values in neighbour_differences if values.size]

"""Branches that repeat each other: their angles held against each other at equal torque."""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import FEWEST_COMPARED

STEEP = 3.0
"""Slopes beyond this multiple of a branch's chord are left out of repeats: in the play and on the steps of a cogging
motor the difference of two repeats is the noise of the torque times the slope, not that of the angle."""
SURE = 3.0
"""Standard deviations of a difference of two cells that a step must exceed the steep slope by: where cells are narrow,
noise alone looks steep, and to leave out what is noisy would make the noise too low."""


class Branch(NamedTuple):
    """Cells of a block.

    Attributes
    ----------
    torque : (n,) ascending [N m].
    angle : (n,) [arcmin].
    blur : scatter of a cell's angle by that of its rows [arcmin].
    """

    torque: Real
    angle: Real
    blur: float


NO_BRANCH = Branch(np.empty(0), np.empty(0), 0.0)
"""Of which no cell is known."""


def branch_of(cells: Cells, block: int) -> Branch:
    """The cells of a block."""
    block_cells = np.flatnonzero(cells.block == block)
    block_cells = block_cells[np.argsort(cells.torque_mean[block_cells], kind="stable")]
    finite_scatter = cells.angle_spread[block_cells] / np.sqrt(np.maximum(cells.count[block_cells], 1))
    finite_scatter = finite_scatter[np.isfinite(finite_scatter)]
    return Branch(
        cells.torque_mean[block_cells],
        cells.angle_mean[block_cells],
        float(np.median(finite_scatter)) if finite_scatter.size else 0.0,
    )


def mean_branch(branches: list[Branch]) -> Branch:
    """Mean angle over the repeats of a branch, at the torques of the first that all of them reach."""
    measured_branches = [branch for branch in branches if branch.torque.size]
    if not measured_branches:
        return NO_BRANCH
    low, high = (
        max(repeated_branch.torque[0] for repeated_branch in measured_branches),
        min(repeated_branch.torque[-1] for repeated_branch in measured_branches),
    )
    torque = measured_branches[0].torque
    torque = torque[(torque >= low) & (torque <= high)]
    angle = (
        np.mean(
            [np.interp(torque, repeated_branch.torque, repeated_branch.angle) for repeated_branch in measured_branches],
            axis=0,
        )
        if torque.size
        else torque
    )
    return Branch(
        torque,
        angle,
        float(
            np.mean([repeated_branch.blur for repeated_branch in measured_branches]) / np.sqrt(len(measured_branches))
        ),
    )


Loop = dict[int, Branch]
"""Mean branches of a position by their kind."""


def mean_loops(blocks: BranchBlocks, cells: Cells) -> list[Loop]:
    """The branches of each position averaged over all cycles, but for its first branch."""
    loops: list[Loop] = []
    for position in np.unique(blocks.position):
        kinds: dict[int, list[int]] = {}
        for block in np.flatnonzero(blocks.position == position)[1:]:
            kinds.setdefault(int(blocks.kind[block]), []).append(block)
        loops.append({kind: mean_branch([branch_of(cells, b) for b in members]) for kind, members in kinds.items()})
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
    """Angle of `second` less `branch`, steep places left out."""
    if min(branch.torque.size, second.torque.size) < FEWEST_COMPARED:
        return Difference(np.empty(0), np.empty(0))
    is_comparable = _is_even(second, branch.torque) & ~steep_places(branch)
    second_angle, variance = _interpolate(second, branch.torque)
    return Difference((second_angle - branch.angle)[is_comparable], 0.5 * (1 + variance[is_comparable]))


def _is_even(branch: Branch, level: Real) -> Truth:
    """Torques that a branch reaches and where it is not steep."""
    torque = branch.torque
    steep = steep_places(branch)[np.clip(np.searchsorted(torque, level), 0, torque.size - 1)]
    is_even: Truth = (level >= torque[0]) & (level <= torque[-1]) & ~steep
    return is_even


def _interpolate(branch: Branch, level: Real) -> tuple[Real, Real]:
    """Angle of a branch at torques, and its variance in that of a cell: two of them share in it."""
    torque, angle = branch.torque, branch.angle
    upper = np.clip(np.searchsorted(torque, level), 1, torque.size - 1)
    share = np.clip((level - torque[upper - 1]) / np.maximum(torque[upper] - torque[upper - 1], 1e-300), 0, 1)
    return (1 - share) * angle[upper - 1] + share * angle[upper], share**2 + (1 - share) ** 2


def on_nodes(branch: Branch, torque: Real) -> tuple[Real, Real]:
    """Angle and variance of a branch at torques; NaN where it does not reach or is steep."""
    if branch.torque.size < FEWEST_COMPARED:
        return np.full(len(torque), np.nan), np.ones(len(torque))
    angle, variance = _interpolate(branch, torque)
    return np.where(_is_even(branch, torque), angle, np.nan), variance


def steep_places(branch: Branch) -> Truth:
    """Whether the curve beside each cell is steeper than `STEEP` chords of the whole branch, and not by its noise."""
    torque, angle = branch.torque, branch.angle
    rise, run = np.abs(np.diff(angle)) - SURE * np.sqrt(2) * branch.blur, np.abs(np.diff(torque))
    steep = rise * np.ptp(torque) > STEEP * np.ptp(angle) * run
    is_steep: Truth = np.concatenate([[False], steep]) | np.concatenate([steep, [False]])
    return is_steep


def steep_cells(cells: Cells) -> Truth:
    """Cells (n_cells,) beside which the curve is steep: those that are not compared with their repeats."""
    steep = np.zeros(len(cells), bool)
    for block in np.unique(cells.block):
        block_cells = np.flatnonzero(cells.block == block)
        order = np.argsort(cells.torque_mean[block_cells], kind="stable")
        steep[block_cells[order]] = steep_places(branch_of(cells, block))
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

"""How well a measurement repeats: the noise floor that no model can go below, and the scatter within a branch.

All numbers are of cells (averages over neighbouring torques), which are what is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.measurement.branches import Blocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.scatter import MAD_TO_STD
from pipeline.statistics.blocks import resampled_counts, resampled_means

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

STEEP = 3.0
"""Slopes beyond this multiple of a branch's chord are left out of repeats: in the play and on the steps of a cogging
motor the difference of two repeats is the noise of the torque times the slope, not that of the angle."""
RESAMPLES = 1000
"""Of the block bootstrap of the noise."""
SURE = 3.0
"""Standard deviations of a difference of two cells that a step must exceed the steep slope by: where cells are narrow,
noise alone looks steep, and to leave out what is noisy would make the floor too low."""
SEED = 79
"""Of the bootstrap: equal data give an equal page."""
FEWEST_CELLS = 3
"""Cells of a branch that a line between neighbours needs."""


@dataclass(frozen=True)
class Estimate:
    """An rms [arcmin] with the 95 % interval of a block bootstrap; NaN where nothing determines it.

    `n` is the number of differences, `blocks` the number of independent pairs of branches that they come from.
    """

    value: float
    ci_low: float
    ci_high: float
    n: int
    blocks: int


@dataclass(frozen=True)
class Noise:
    """Repeatability of a unit's cells.

    Attributes
    ----------
    floor : rms difference of repeats (consecutive cycles) at equal position, branch and torque, the offset of each pair
        of cycles removed, over sqrt 2 [arcmin]. Drift and run-in between cycles are in it.
    random : the same less what all positions have in common from cycle to cycle, and what goes with the temperature:
        run-in, creep and thermal growth are effects and no noise. From two positions on.
    within_branch : scatter of a cell about the line through its neighbours [arcmin], robust; no drift is in it, and no
        noise that neighbours share.
    between_positions : as `floor`, between the mean loops of neighbouring positions; not divided by anything that the
        crank angle explains.
    row_scatter_arcmin : rms of the angle of rows about the line of their cell [arcmin].
    torque_noise_Nm : of a row, declared or estimated.
    """

    floor: Estimate
    random: Estimate
    within_branch: Estimate
    between_positions: Estimate
    row_scatter_arcmin: float
    torque_noise_Nm: float


def measured_noise(blocks: Blocks, cells: Cells, torque_noise: float) -> Noise:
    """Noise of the cells of a unit, whose rows have a noise of the torque [N m].

    Notes
    -----
    The first branch of a position starts from a state that nobody knows and is left out of repeats. Branches are
    compared by their kind (sense and first torque), at the torques of the earlier one, by linear interpolation.
    """
    count = np.maximum(cells.count - 2, 0)
    within = np.sum(count * cells.angle_spread**2) / np.sum(count) if count.any() else np.nan
    return Noise(
        floor=_rms(_repeats(blocks, cells), np.sqrt(2)),
        random=_random(blocks, cells),
        within_branch=_robust(_from_neighbours(cells)),
        between_positions=_rms(_positions_apart(blocks, cells), np.sqrt(2)),
        row_scatter_arcmin=float(np.sqrt(within)),
        torque_noise_Nm=torque_noise,
    )


def restricted(blocks: Blocks, cells: Cells, seen: NDArray[np.bool_]) -> tuple[Blocks, Cells]:
    """Branches that have a cell ``seen`` (n_cells,), numbered anew, and these cells."""
    kept = np.unique(cells.block[seen])
    of_block = {f.name: getattr(blocks, f.name) for f in fields(blocks)}
    of_block |= {name: of_block[name][kept] for name in ("position", "cycle", "direction", "branch", "start", "stop")}
    of_cell = {f.name: getattr(cells, f.name)[seen] for f in fields(cells)}
    return Blocks(**of_block), Cells(**of_cell | {"block": np.searchsorted(kept, cells.block[seen])})


def _repeats(blocks: Blocks, cells: Cells) -> list[Real]:
    """Differences between consecutive cycles, a list entry per pair of branches, each pair of cycles centred."""
    found: list[Real] = []
    for position in np.unique(blocks.position):
        mine = np.flatnonzero(blocks.position == position)
        order = list(dict.fromkeys(blocks.cycle[mine].tolist()))
        for earlier, later in zip(order[:-1], order[1:], strict=True):
            differences = []
            for first in mine[blocks.cycle[mine] == earlier]:
                for second in mine[(blocks.cycle[mine] == later) & (blocks.kind[mine] == blocks.kind[first])]:
                    if first != mine[0]:
                        differences.append(_difference(_branch(cells, first), _branch(cells, second)))
            found += _centred(differences)
    return found


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


def _branch(cells: Cells, block: int) -> Branch:
    """The cells of a block."""
    mine = np.flatnonzero(cells.block == block)
    mine = mine[np.argsort(cells.torque_mean[mine], kind="stable")]
    known = cells.angle_spread[mine] / np.sqrt(np.maximum(cells.count[mine], 1))
    known = known[np.isfinite(known)]
    return Branch(cells.torque_mean[mine], cells.angle_mean[mine], float(np.median(known)) if known.size else 0.0)


def _mean_branch(branches: list[Branch]) -> Branch:
    """Mean angle over the repeats of a branch, at the torques of the first that all of them reach."""
    there = [branch for branch in branches if branch.torque.size]
    if not there:
        return Branch(np.empty(0), np.empty(0), 0.0)
    low, high = max(one.torque[0] for one in there), min(one.torque[-1] for one in there)
    torque = there[0].torque
    torque = torque[(torque >= low) & (torque <= high)]
    angle = np.mean([np.interp(torque, one.torque, one.angle) for one in there], axis=0) if torque.size else torque
    return Branch(torque, angle, float(np.mean([one.blur for one in there]) / np.sqrt(len(there))))


Loop = dict[int, Branch]
"""Mean branches of a position by their kind."""


def mean_loops(blocks: Blocks, cells: Cells) -> list[Loop]:
    """The branches of each position averaged over all cycles, but for its first branch."""
    loops: list[Loop] = []
    for position in np.unique(blocks.position):
        kinds: dict[int, list[int]] = {}
        for block in np.flatnonzero(blocks.position == position)[1:]:
            kinds.setdefault(int(blocks.kind[block]), []).append(block)
        loops.append({kind: _mean_branch([_branch(cells, b) for b in members]) for kind, members in kinds.items()})
    return loops


def loop_distance(first: Loop, second: Loop) -> float:
    """Rms difference [arcmin] of two mean loops, their offset removed; NaN where they have nothing in common."""
    differences = _loop_differences(first, second)
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2))) if differences else np.nan


def _loop_differences(first: Loop, second: Loop) -> list[Real]:
    return _centred([_difference(first[kind], second[kind]) for kind in first if kind in second])


def _positions_apart(blocks: Blocks, cells: Cells) -> list[Real]:
    """Differences between the mean loops of neighbouring positions."""
    loops = mean_loops(blocks, cells)
    return [part for one, other in zip(loops[:-1], loops[1:], strict=True) for part in _loop_differences(one, other)]


def _difference(first: Branch, second: Branch) -> Real:
    """Angle of `second` less `first` [arcmin] at the torques of `first` that both reach, steep places left out."""
    if min(first.torque.size, second.torque.size) < FEWEST_CELLS:
        return np.empty(0)
    inside = _even(second, first.torque) & ~_steep(first)
    other, variance = _interpolated(second, first.torque)
    return ((other - first.angle) * np.sqrt(2 / (1 + variance)))[inside]


def _even(branch: Branch, at: Real) -> NDArray[np.bool_]:
    """Torques that a branch reaches and where it is not steep."""
    torque = branch.torque
    steep = _steep(branch)[np.clip(np.searchsorted(torque, at), 0, torque.size - 1)]
    return (at >= torque[0]) & (at <= torque[-1]) & ~steep


def _interpolated(branch: Branch, at: Real) -> tuple[Real, Real]:
    """Angle of a branch at torques, and its variance in that of a cell: two of them share in it."""
    torque, angle = branch.torque, branch.angle
    upper = np.clip(np.searchsorted(torque, at), 1, torque.size - 1)
    share = np.clip((at - torque[upper - 1]) / np.maximum(torque[upper] - torque[upper - 1], 1e-300), 0, 1)
    return (1 - share) * angle[upper - 1] + share * angle[upper], share**2 + (1 - share) ** 2


def _random(blocks: Blocks, cells: Cells) -> Estimate:
    """Repeats less what cycle number and temperature explain of their differences at equal torque."""
    pairs = _pairs(blocks, cells)
    if len({position for position, _ in pairs}) < 2:
        return Estimate(np.nan, np.nan, np.nan, 0, 0)
    keys = sorted(pairs)
    difference = np.array([pairs[key][0] for key in keys])
    known = np.isfinite(difference)
    everywhere = np.all(known, axis=0)  # offsets of pairs over other torques would not compare
    difference -= np.nanmean(difference[:, everywhere if np.any(everywhere) else slice(None)], axis=1, keepdims=True)
    warmed = np.array([pairs[key][1] for key in keys])
    earlier = np.array([cycle for _, cycle in keys])
    design = (earlier[:, None] == np.unique(earlier)).astype(float)
    if np.all(np.isfinite(warmed)) and np.ptp(warmed) > 0:
        design = np.column_stack([design, warmed / np.ptp(warmed)])
    left, free = np.full_like(difference, np.nan), np.full_like(difference, np.nan)
    for pattern in np.unique(known, axis=1).T:
        nodes = np.all(known == pattern[:, None], axis=0)
        basis, sizes, _ = np.linalg.svd(design[pattern], full_matrices=False)
        basis = basis[:, sizes > 1e-9]
        rows = difference[np.ix_(pattern, nodes)]
        left[np.ix_(pattern, nodes)] = rows - basis @ (basis.T @ rows)
        free[np.ix_(pattern, nodes)] = (1 - np.sum(basis**2, axis=1))[:, None]
    squares, weights = np.nansum(left**2, axis=1), np.nansum(free, axis=1)
    kept = weights > 1e-6
    return _pooled(squares[kept], weights[kept], np.sqrt(2))


def _pairs(blocks: Blocks, cells: Cells) -> dict[tuple[int, int], tuple[Real, float]]:
    """By position and cycle: difference (n_nodes,) [arcmin] of the next cycle from it, and how much warmer it was [K].

    At the torques of the first position's branches; NaN where not both reach.
    """
    kinds: dict[int, Real] = {}
    found = {}
    for position in np.unique(blocks.position):
        mine = np.flatnonzero(blocks.position == position)
        for block in mine[1:]:
            kinds.setdefault(int(blocks.kind[block]), _branch(cells, block).torque)
    for position in np.unique(blocks.position):
        mine = np.flatnonzero(blocks.position == position)
        loops = {}
        for cycle in dict.fromkeys(blocks.cycle[mine].tolist()):
            own = {int(blocks.kind[b]): _branch(cells, b) for b in mine[1:] if blocks.cycle[b] == cycle}
            loops[cycle] = [_on_nodes(own.get(kind), torque) for kind, torque in kinds.items()]
        temperature = {
            c: _mean(cells.temperature_mean[(cells.position == position) & (cells.cycle == c)]) for c in loops
        }
        order = list(loops)
        for earlier, later in zip(order[:-1], order[1:], strict=True):
            parts = [
                (second[0] - first[0]) * np.sqrt(2 / (first[1] + second[1]))
                for first, second in zip(loops[earlier], loops[later], strict=True)
            ]
            joined = np.concatenate(parts)
            if np.any(np.isfinite(joined)):
                found[int(position), int(earlier)] = joined, temperature[later] - temperature[earlier]
    return found


def _on_nodes(branch: Branch | None, torque: Real) -> tuple[Real, Real]:
    """Angle and variance of a branch at torques; NaN where it does not reach or is steep."""
    if branch is None or branch.torque.size < FEWEST_CELLS:
        return np.full(len(torque), np.nan), np.ones(len(torque))
    angle, variance = _interpolated(branch, torque)
    return np.where(_even(branch, torque), angle, np.nan), variance


def _mean(values: Real) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


def _steep(branch: Branch) -> NDArray[np.bool_]:
    """Whether the curve beside each cell is steeper than `STEEP` chords of the whole branch, and not by its noise."""
    torque, angle = branch.torque, branch.angle
    rise, run = np.abs(np.diff(angle)) - SURE * np.sqrt(2) * branch.blur, np.abs(np.diff(torque))
    steep = rise * np.ptp(torque) > STEEP * np.ptp(angle) * run
    return np.concatenate([[False], steep]) | np.concatenate([steep, [False]])


def _centred(differences: list[Real]) -> list[Real]:
    """The differences of one pair of loops less their common mean: the offset of the pair."""
    kept = [values for values in differences if values.size]
    offset = np.mean(np.concatenate(kept)) if kept else 0.0
    return [values - offset for values in kept]


def _from_neighbours(cells: Cells) -> list[Real]:
    """Per block, each inner cell's angle less the line through its neighbours, for unit variance of a cell's noise."""
    found = []
    for block in np.unique(cells.block):
        mine = np.flatnonzero(cells.block == block)
        torque, angle = cells.torque_mean[mine], cells.angle_mean[mine]
        if mine.size < FEWEST_CELLS:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (torque[1:-1] - torque[:-2]) / (torque[2:] - torque[:-2])
        rest = angle[1:-1] - (1 - share) * angle[:-2] - share * angle[2:]
        inside = (share > 0) & (share < 1)
        found.append(rest[inside] / np.sqrt(1 + share[inside] ** 2 + (1 - share[inside]) ** 2))
    return [values for values in found if values.size]


def _rms(groups: list[Real], divisor: float) -> Estimate:
    """Root mean square over `divisor`, bootstrapped over groups."""
    squares = np.array([np.sum(values**2) for values in groups])
    return _pooled(squares, np.array([float(values.size) for values in groups]), divisor)


def _pooled(squares: Real, counts: Real, divisor: float) -> Estimate:
    """Root of the sum of `squares` over that of `counts`, over `divisor`, bootstrapped over the groups."""
    if not counts.sum():
        return Estimate(np.nan, np.nan, np.nan, 0, 0)
    drawn = resampled_means(np.column_stack([squares, counts]), RESAMPLES, SEED)
    value = float(np.sqrt(squares.sum() / counts.sum()) / divisor)
    return _interval(value, np.sqrt(drawn[:, 0] / drawn[:, 1]) / divisor, round(counts.sum()), len(squares))


def _robust(groups: list[Real]) -> Estimate:
    """Standard deviation by the median absolute value, bootstrapped over groups."""
    if not groups:
        return Estimate(np.nan, np.nan, np.nan, 0, 0)
    sizes = np.abs(np.concatenate(groups))
    order = np.argsort(sizes)
    group = np.repeat(np.arange(len(groups)), [values.size for values in groups])
    below = np.cumsum(resampled_counts(len(groups), RESAMPLES, SEED)[:, group[order]], axis=1)
    medians = sizes[order][np.argmax(2 * below >= below[:, -1:], axis=1)]
    return _interval(float(MAD_TO_STD * np.median(sizes)), MAD_TO_STD * medians, sizes.size, len(groups))


def _interval(value: float, resampled: Real, n: int, blocks: int) -> Estimate:
    """95 % percentile interval; none from a single block, which says nothing about the spread between blocks."""
    if blocks < 2:
        return Estimate(value, np.nan, np.nan, n, blocks)
    low, high = np.quantile(resampled, [0.025, 0.975])
    return Estimate(value, float(low), float(high), n, blocks)

"""The covariance of cells beyond a model: noise, its correlation, and what every model of the library may miss.

The noise of a cell has the blur beside a jump through the play (``fitting.cells_in_noise``), a share of it is
correlated along a branch, and a discrepancy may be alike at all positions, at each, and in each cycle.

Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; autoregressive noise: Prais and Winsten (1954); beside
white noise: Box and Jenkins, Time Series Analysis (1970), sections 3.4 and A4.3.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import block_diag, csr_array, hstack
from scipy.special import ndtri

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.fitting.cells_in_noise import noise_between_rows
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.measurement.enough import FEWEST_COMPARED, SINGLE_GROUPS
from pipeline.identification.measurement.turning.motion import groups
from pipeline.statistics.resampling import CONFIDENCE

REACHES = (0.05, 0.15, 0.5)
"""Distances, in largest torques, over which a discrepancy is alike."""
SIZES = (1e-3, *(0.1 * 2.0 ** np.arange(10)).tolist())
"""Standard deviations of a discrepancy that are tried, in those of the median cell's noise."""


class Correlation(NamedTuple):
    """Share of the variance of the noise that is correlated, and its correlation between neighbouring cells.

    The correlated share is an autoregressive process of the first order along a branch; the rest is white.
    """

    share: float
    of_neighbours: float


CORRELATIONS = (
    Correlation(1.0, 0.0),
    Correlation(1.0, 0.3),
    Correlation(1.0, 0.6),
    Correlation(1.0, 0.85),
    Correlation(0.3, 0.9),
    Correlation(0.6, 0.9),
)
"""Correlations of the noise within a branch that are tried.

A bench usually has both kinds: rounding and the torque sensor add white noise to an angle that wanders."""
NO_WEIGHT: Rounding = 1e-12
"""Weight of an earlier cell in a whitened one, of unit noise, below which it counts as none."""
OFFSET: Rounding = 1e3
"""Prior standard deviation of the zero of an angle, in those of the median cell: equal in all models."""


def parts_of(data: Data, cells: Truth) -> Whole:
    """Number of what each cell (n_cells,) is left out with: a position, a cycle of a single one, or a lot of them."""
    group = data.held_out_parts(cells)
    numbers = np.unique(group[cells])
    rank = np.searchsorted(numbers, group)
    return rank if len(numbers) <= SINGLE_GROUPS else rank % FEWEST_COMPARED


@dataclass(frozen=True)
class Structure:
    """What is correlated beyond a model.

    Attributes
    ----------
    common, own_size : standard deviations in those of the median cell's noise: alike at all positions, and of each.
    reach : in largest torques.
    correlation : of the noise along a branch.
    cycle_size : as ``common``, of each cycle by itself, alike at all positions.
    """

    common: float
    own_size: float
    reach: float
    correlation: Correlation
    cycle_size: float = 0.0

    @property
    def size(self) -> float:
        """Standard deviation of all that is alike in neighbouring torques and in every cycle."""
        return float(np.hypot(self.common, self.own_size))

    @property
    def square(self) -> float:
        """Mean square of all that is correlated, what differs between cycles included."""
        return self.size**2 + self.cycle_size**2


class Covariance:
    """The covariance of some cells of a problem, as features of unit variance.

    Parameters
    ----------
    cells : (n_cells,) those that count.
    parts : (n_cells,) what is left out at once: cells of a branch are never apart.
    """

    def __init__(self, data: Data, cells: Truth, parts: Whole):
        self.data, self.cells = data, cells
        self.sigma, self.parts = data.sigma[cells], parts[cells]
        self.correlations = _possible_correlations(data, cells)
        self.whitening = {one: _whitening(data.block[cells], one) for one in self.correlations}
        self.unit = float(np.median(self.sigma))
        group = data.group[cells]
        self.fixed_features = np.hstack([OFFSET * self.unit * (group[:, None] == np.unique(group)), self._row_errors()])
        self._bumps = {reach: self._bumps_at(reach) for reach in REACHES}
        kinds, positions = self._kinds(), data.position[cells]
        self._of_kinds = [kinds == kind for kind in np.unique(kinds)]
        self._of_positions = [positions == position for position in self._distinct(positions)]
        cycles = data.cycle[cells]
        self._of_cycles = [cycles == cycle for cycle in self._distinct(cycles)]
        self._white_features: dict[tuple[float, Correlation, bytes], WhiteFeatures] = {}

    def rms(self, predicted_angle: Real) -> float:
        """Root mean square, in the noise of each cell, of what angles (n_cells,) [arcmin] predicted for all miss."""
        return float(np.sqrt(np.mean(((self.data.angle - predicted_angle)[self.cells] / self.sigma) ** 2)))

    def _row_errors(self) -> Real:
        """Errors of the place of the jump through play between two rows, alike on all branches of a sense (n, ...)."""
        senses, errors = self.data.senses[self.cells], self.data.row_error[self.cells]
        of_senses = errors[:, None] * (senses[:, None] == np.unique(senses))
        return np.asarray(of_senses[:, np.any(of_senses > 0, axis=0)])

    def _kinds(self) -> Real:
        """Number of the curve that each cell (n,) is on: its sense; of a turning crank its torque as well."""
        senses = self.data.senses[self.cells].astype(float)
        return senses * (1.0 + self.data.level[self.cells]) if isinstance(self.data, TurningData) else senses

    def _distinct(self, numbers: Whole) -> Whole:
        """The numbers whose curves may differ: none of a single one, and of a turning crank."""
        distinct_numbers = np.unique(numbers)
        return distinct_numbers[: 0 if isinstance(self.data, TurningData) or len(distinct_numbers) == 1 else None]

    def _bumps_at(self, reach: float) -> Real:
        """Features (n, n_bumps) of a curve over torque or crank angle, variances summing to one."""
        data = self.data
        if isinstance(data, TurningData):
            place = data.crank[self.cells]
            place = 2 * (place - place.min()) / max(float(np.ptp(place)), 1e-9) - 1
        else:
            place = known_torques(data.torque[self.cells], data.torque_noise)
            place = place / max(float(np.max(np.abs(place))), 1e-9)
        centres = np.arange(-1 - reach, 1 + 1.5 * reach, reach)
        bumps = np.exp(-(((place[:, None] - centres) / reach) ** 2))
        bumps[bumps < np.finfo(float).eps] = 0.0  # products of smaller ones are denormal, which takes ten times as long
        return np.asarray(bumps / np.linalg.norm(bumps, axis=1)[:, None])

    def whiten(self, columns: Real, correlation: Correlation) -> Real:
        """Columns (n, ...) over the noise, its correlation along a branch removed."""
        scaled_columns = columns / self.sigma.reshape(-1, *[1] * (columns.ndim - 1))
        return np.asarray(self.whitening[correlation] @ scaled_columns)

    def white_features(self, reach: float, correlation: Correlation, is_chosen: Truth) -> "WhiteFeatures":
        """The features, whitened, of chosen cells (n,)."""
        key = reach, correlation, is_chosen.tobytes()
        if key not in self._white_features:
            bumps = self.whiten(self._bumps[reach], correlation) * is_chosen[:, None]
            of_cycles = self.whiten(self._bumps[max(REACHES)], correlation) * is_chosen[:, None]
            fixed = self.whiten(self.fixed_features, correlation) * is_chosen[:, None]
            shared = [bumps * rows[:, None] for rows in self._of_kinds]
            shared += [of_cycles * (kind & cycle)[:, None] for cycle in self._of_cycles for kind in self._of_kinds]
            of_positions = [kind & position for position in self._of_positions for kind in self._of_kinds]
            self._white_features[key] = white_features(np.hstack([*shared, fixed]), bumps, of_positions)
        return self._white_features[key]

    def spreads(self, structure: Structure) -> Real:
        """Standard deviation of the amount of each shared feature."""
        n_bumps, n_of_cycle = (self._bumps[reach].shape[1] for reach in (structure.reach, max(REACHES)))
        counts = len(self._of_kinds) * np.array([n_bumps, len(self._of_cycles) * n_of_cycle])
        sizes = self.unit * np.array([structure.common, structure.cycle_size])
        return np.append(np.repeat(sizes, counts), np.ones(self.fixed_features.shape[1]))

    def own_variance(self, structure: Structure) -> float:
        """Variance of the amounts of the features that each position has by itself."""
        return (self.unit * structure.own_size) ** 2

    def log_scale(self, correlation: Correlation, is_chosen: Truth) -> float:
        """Logarithm of what turns the density of whitened cells into that of ``is_chosen`` ones (n,)."""
        return float(np.sum(np.log(self.whitening[correlation].diagonal() / self.sigma)[is_chosen]))

    def best_nearby(
        self, value: Callable[[Structure], float], start: Structure, largest: tuple[float, float, float]
    ) -> Structure:
        """The structure that steps along each number but the correlation lead to, until none helps."""
        positions_scatter, cycles_scatter = self.can_scatter
        (largest_shared, largest_size, largest_between_cycles), limit = largest, np.hypot(largest[1], SIZES[0])
        own_sizes = sizes_up_to(largest_size) if positions_scatter else [0.0]
        cycle_sizes = [0.0, *(sizes_up_to(largest_between_cycles)[1:] if cycles_scatter else [])]
        axes: tuple[Sequence[float], ...] = (sizes_up_to(largest_shared), own_sizes, REACHES, cycle_sizes)
        start_values = start.common, start.own_size, start.reach, start.cycle_size
        place = [
            max(int(np.searchsorted(axis, first, side="right")) - 1, 0)
            for axis, first in zip(axes, start_values, strict=True)
        ]

        def structure_at(place: Sequence[int]) -> Structure:
            common, own_size, reach, cycle_size = (axis[k] for axis, k in zip(axes, place, strict=True))
            return Structure(common, own_size, reach, start.correlation, cycle_size)

        best_value, has_improved = value(structure_at(place)), True
        while has_improved:
            has_improved = False
            for number, step in product(range(len(axes)), (-1, 1)):
                while 0 <= place[number] + step < len(axes[number]):
                    neighbour = [k + step * (n == number) for n, k in enumerate(place)]
                    structure = structure_at(neighbour)
                    neighbour_value = value(structure) if structure.size <= limit else -np.inf
                    if neighbour_value <= best_value:
                        break
                    place, best_value, has_improved = neighbour, neighbour_value, True
        return structure_at(place)

    @property
    def can_scatter(self) -> tuple[bool, bool]:
        """Whether positions can scatter, and whether cycles can."""
        return bool(self._of_positions), bool(self._of_cycles)


@dataclass(frozen=True)
class WhiteFeatures:
    """Whitened features of cells: those that positions share, and those that each position has by itself.

    The latter are in their principal axes. These are orthogonal, so that the part of other columns that they explain is
    removed without a system of equations, whatever their variance.

    Attributes
    ----------
    shared : (n, n_shared)
    own : (n, n_own), sparse.
    squares : (n_own,) sums of squares of the columns of ``own``.
    shared_products, own_products : (n_shared, n_shared) and (n_own, n_shared), products of both with ``shared``.
    """

    shared: Real
    own: csr_array
    squares: Real
    shared_products: Real
    own_products: Real

    def variances(self, variance: float) -> Real:
        """Posterior variances (n_own,) of the amounts of own features whose prior has ``variance``."""
        return variance / (1 + variance * self.squares)

    def left(self, white: Real, variance: float) -> Real:
        """Whitened columns (n, ...) less what own features of a prior variance most probably explain of them."""
        return np.asarray(white - self.own @ ((self.own.T @ white).T * self.variances(variance)).T)

    def log_size(self, variance: float) -> float:
        """Half the logarithm of the determinant of the own features' covariance beside the noise."""
        return 0.5 * float(np.sum(np.log1p(variance * self.squares)))


def sizes_up_to(largest: float) -> list[float]:
    """Sizes of a discrepancy that are tried up to a largest one, which is tried itself."""
    smaller_sizes = [size for size in SIZES if size < largest]
    return smaller_sizes if np.isinf(largest) else [*smaller_sizes, largest]


def white_features(shared: Real, bumps: Real, groups: Sequence[Truth]) -> WhiteFeatures:
    """Features of cells of which each group (n,) has an own curve, made of ``bumps`` (n, n_bumps)."""
    blocks = [csr_array((len(shared), 0))]
    for rows in (np.flatnonzero(group) for group in groups):
        axes, sizes, _ = np.linalg.svd(bumps[rows], full_matrices=False)
        axes = (axes * sizes)[:, sizes > np.finfo(float).eps * max(sizes.max(initial=0.0), 1.0)]
        places = np.repeat(rows, axes.shape[1]), np.tile(np.arange(axes.shape[1]), len(rows))
        blocks.append(csr_array((axes.ravel(), places), shape=(len(shared), axes.shape[1])))
    own = csr_array(hstack(blocks))
    return WhiteFeatures(shared, own, np.asarray(own.multiply(own).sum(axis=0)), shared.T @ shared, own.T @ shared)


def known_torques(torque: Real, noise: float) -> Real:
    """Torques (n,) in which those that may differ by their noise alone are replaced by their mean.

    All rows at one weight of a staircase then have one torque, so that the noise of the torque is not taken for a
    discrepancy. Torques that follow each other so closely over more than half of the shortest reach are a sweep and
    stay as they are.
    """
    number = groups(torque, noise_between_rows(noise))
    mean = np.bincount(number, torque) / np.bincount(number)
    least, largest = mean.copy(), mean.copy()
    np.minimum.at(least, number, torque)
    np.maximum.at(largest, number, torque)
    is_one = largest - least <= 0.5 * min(REACHES) * np.max(np.abs(torque))
    return np.where(is_one[number], mean[number], torque)


def _whitening(block: Whole, correlation: Correlation) -> csr_array:
    """Sparse matrix (n, n) that turns noise of unit variance, correlated within each block of cells (n,), into white.

    It consists of inverse Cholesky factors. The factor of a shorter block is the first part of that of the longest.
    """
    lengths = np.diff(np.append(np.flatnonzero(np.diff(block, prepend=np.nan) != 0), len(block)))
    places = np.arange(max(lengths, default=0))
    share, of_neighbours = correlation
    lags = np.abs(places[:, None] - places)
    factor = cholesky(share * of_neighbours**lags + (1 - share) * np.eye(len(places)), lower=True)
    longest = solve_triangular(factor, np.eye(len(places)), lower=True)
    longest[np.abs(longest) < NO_WEIGHT] = 0.0
    return csr_array(block_diag([longest[:length, :length] for length in lengths]))


def _possible_correlations(data: Data, cells: Truth) -> tuple[Correlation, ...]:
    """Correlations of neighbouring cells that the repeats of the branches do not exclude; all without repeats.

    The difference of a cycle from the mean of all is noise, whatever the model misses. Effects that differ between
    cycles make the bound too large, never too small.
    """
    products, squares = [], []
    for branch in np.unique(data.branch[cells]):
        of_branch = cells & (data.branch == branch)
        blocks = [np.flatnonzero(of_branch & (data.block == block)) for block in np.unique(data.block[of_branch])]
        places = np.array([block for block in blocks if len(block) == len(blocks[-1])])
        if len(places) > 1:
            white = (data.angle[places] - data.angle[places].mean(axis=0)) / data.sigma[places]
            products.append((white[:, 1:] * white[:, :-1]).ravel())
            squares.append(0.5 * (white[:, 1:] ** 2 + white[:, :-1] ** 2).ravel())
    if not products or not np.any(np.concatenate(squares)):
        return CORRELATIONS
    square = np.concatenate(squares)
    n_pairs = np.sum(square) ** 2 / np.sum(square**2)
    largest = np.sum(np.concatenate(products)) / np.sum(square) + float(ndtri(CONFIDENCE)) / np.sqrt(n_pairs)
    return tuple(one for one in CORRELATIONS if one.share * one.of_neighbours <= max(largest, 0.0))

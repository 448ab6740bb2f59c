"""The covariance of cells beyond a model: noise, its correlation, and what every model of the library may miss.

The noise of a cell has the blur beside a jump through the play (``fitting.cells_in_noise``), its neighbours of a branch
are correlated, and a discrepancy may be alike at all positions, at each, and in each cycle.

Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; autoregressive noise: Prais and Winsten (1954).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.statistics.resampling import CONFIDENCE

REACHES = (0.15, 0.5)
"""Distances, in largest torques, over which a discrepancy is alike."""
SIZES = (1e-3, *(0.1 * 2.0 ** np.arange(10)).tolist())
"""Standard deviations of a discrepancy that are tried, in those of the median cell's noise."""
CORRELATIONS = (0.0, 0.3, 0.6, 0.85)
"""Correlations of the noise of neighbouring cells of a branch."""
SINGLE_GROUPS = 6
"""Positions (or cycles) up to which each is left out by itself; more are left out in three lots, spread evenly over
them, so that the time grows as the rows do."""
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
    correlation : of the noise of neighbouring cells.
    cycle_size : as ``common``, of each cycle by itself, alike at all positions.
    """

    common: float
    own_size: float
    reach: float
    correlation: float
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
        self.is_first = np.append(True, np.diff(data.block[cells]) != 0)
        self.unit = float(np.median(self.sigma))
        group = data.group[cells]
        self.fixed_features = np.hstack(
            [OFFSET * self.unit * (group[:, None] == np.unique(group)), self._row_errors()]
        )
        common_features = {reach: self._common_features(reach) for reach in REACHES}
        of_cycles = self._by_number(common_features[max(REACHES)], data.cycle[cells])
        self._features = {
            reach: (common, self._by_number(common, data.position[cells]), of_cycles)
            for reach, common in common_features.items()
        }
        self._whitened_columns: dict[tuple[float, float], Real] = {}
        self._products: dict[tuple[float, float, bytes], Real] = {}

    def _row_errors(self) -> Real:
        """Errors of the place of the jump through play between two rows, alike on all branches of a sense (n, ...)."""
        senses, errors = self.data.senses[self.cells], self.data.row_error[self.cells]
        of_senses = errors[:, None] * (senses[:, None] == np.unique(senses))
        return np.asarray(of_senses[:, np.any(of_senses > 0, axis=0)])

    def _common_features(self, reach: float) -> Real:
        """Features (n, n_features) that all positions and cycles share, variances summing to one."""
        data = self.data
        if isinstance(data, TurningData):
            place, kind = data.crank[self.cells], data.senses[self.cells] * (1.0 + data.level[self.cells])
            place = 2 * (place - place.min()) / max(float(np.ptp(place)), 1e-9) - 1
        else:
            place, kind = data.torque[self.cells], data.senses[self.cells]
            place = place / max(float(np.max(np.abs(place))), 1e-9)
        centres = np.arange(-1 - reach, 1 + 1.5 * reach, reach)
        bumps = np.exp(-(((place[:, None] - centres) / reach) ** 2))
        bumps[bumps < np.finfo(float).eps] = 0.0  # products of smaller ones are denormal, which takes ten times as long
        bumps /= np.linalg.norm(bumps, axis=1)[:, None]
        return np.hstack([bumps * (kind == number)[:, None] for number in np.unique(kind)])

    def _by_number(self, features: Real, numbers: Whole) -> Real:
        """The features of each number (n,) by itself; none of a single one, and of a turning crank."""
        distinct_numbers = np.unique(numbers)
        if isinstance(self.data, TurningData) or len(distinct_numbers) == 1:
            return np.zeros((len(features), 0))
        return np.hstack([features * (numbers == number)[:, None] for number in distinct_numbers])

    def whiten(self, columns: Real, correlation: float) -> Real:
        """Columns (n, ...) over the noise, its correlation between neighbours of a branch removed."""
        scaled_columns = columns / self.sigma.reshape(-1, *[1] * (columns.ndim - 1))
        white = scaled_columns.copy()
        white[1:] = (scaled_columns[1:] - correlation * scaled_columns[:-1]) / np.sqrt(1 - correlation**2)
        white[self.is_first] = scaled_columns[self.is_first]
        return white

    def features(self, reach: float) -> Real:
        """Features of all kinds, zeros of angles and places between rows (n, n_features)."""
        return np.hstack([*self._features[reach], self.fixed_features])

    def whitened_features(self, reach: float, correlation: float) -> Real:
        """The features (n, n_features), whitened."""
        key = reach, correlation
        if key not in self._whitened_columns:
            self._whitened_columns[key] = self.whiten(self.features(reach), correlation)
        return self._whitened_columns[key]

    def products(self, reach: float, correlation: float, is_chosen: Truth) -> Real:
        """Products (n_features, n_features) of the whitened features over chosen cells (n,)."""
        key = reach, correlation, is_chosen.tobytes()
        if key not in self._products:
            of_chosen = self.whitened_features(reach, correlation)[is_chosen]
            self._products[key] = of_chosen.T @ of_chosen
        return self._products[key]

    def spreads(self, structure: Structure) -> Real:
        """Standard deviation of the amount of each feature."""
        counts = [features.shape[1] for features in self._features[structure.reach]]
        sizes = self.unit * np.array([structure.common, structure.own_size, structure.cycle_size])
        return np.append(np.repeat(sizes, counts), np.ones(self.fixed_features.shape[1]))

    def log_scale(self, correlation: float, is_chosen: Truth) -> float:
        """Logarithm of what turns the density of whitened cells into that of ``is_chosen`` ones (n,)."""
        n_correlated = np.sum(is_chosen & ~self.is_first)
        return float(-np.sum(np.log(self.sigma[is_chosen])) - 0.5 * n_correlated * np.log1p(-(correlation**2)))

    @property
    def can_scatter(self) -> tuple[bool, bool]:
        """Whether positions can scatter, and whether cycles can."""
        _, *of_numbers = self._features[REACHES[0]]
        positions, cycles = (features.shape[1] > 0 for features in of_numbers)
        return positions, cycles


def _possible_correlations(data: Data, cells: Truth) -> tuple[float, ...]:
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
    return tuple(correlation for correlation in CORRELATIONS if correlation <= max(largest, 0.0))

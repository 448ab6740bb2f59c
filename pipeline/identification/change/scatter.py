"""Scatter of mounting over the states and positions of a drive, and contrasts of states tested against it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from scipy.optimize import brentq

from pipeline.arrays import Real, Whole
from pipeline.constant_kinds import Rounding, Shown
from pipeline.statistics.differences import Family, family

POWER: Shown = 0.8
"""Chance with which a change of the detection limit is shown."""
LARGEST_NONCENTRALITY: Rounding = 1e3
"""Non-centrality beyond which no power is sought."""
FEWEST_FREEDOM = 2
"""Degrees of freedom below which the scatter is unknown: with one the t distribution has no mean."""
ESTIMABLE: Rounding = 1e-9
"""Distance of a contrast from what the rows determine, beyond which it is not estimable."""
LEAST_ERROR: Rounding = 1e-12
"""Standard error of tests of data without scatter."""


@dataclass(frozen=True)
class Contrast:
    """A linear combination of state levels with its standard error.

    Attributes
    ----------
    mean, error : (n_kinds,)
    size : standard deviation of the mean over that of a row.
    residuals : (n_rows, n_kinds) what mounting adds.
    freedom : degrees of freedom of the scatter.
    bias : (n_kinds,) largest error that all positions may share: means up to it are no difference.
    """

    mean: Real
    error: Real
    size: float
    residuals: Real
    freedom: int
    bias: Real

    @cached_property
    def family(self) -> Family:
        """Tests of all kinds together."""
        beyond = np.copysign(self._beyond_bias, self.mean)  # with its sign: rotations keep the products of the rows
        return family(beyond / self.size, self.residuals, self.freedom)

    @property
    def _beyond_bias(self) -> Real:
        """Size of each mean (n_kinds,) beyond its bias."""
        return np.maximum(np.abs(self.mean) - self.bias, 0.0)

    @property
    def p(self) -> Real:
        """Two-sided p (n_kinds,) of no difference, each kind by itself."""
        p: Real = 2 * scipy.stats.t.sf(self._beyond_bias / self.error, self.freedom)
        return p

    def reach(self, confidence: float) -> Real:
        """Half of the confidence interval (n_kinds,); NaN where the bias is unknown."""
        bias = np.where(np.isfinite(self.bias), self.bias, np.nan)
        return float(scipy.stats.t.ppf(0.5 + confidence / 2, self.freedom)) * self.error + bias

    def detectable(self, chance: float) -> Real:
        """Size (n_kinds,) that the tests of all kinds, of which any errs with ``chance``, show with ``POWER``.

        By the noncentral t distribution of the scatter as estimated: Cohen, Statistical Power Analysis (1988), ch. 2.
        """
        critical = float(scipy.stats.t.isf(self.family.level(chance) / 2, self.freedom))
        shift: float = brentq(
            lambda shift: scipy.stats.nct.sf(critical, self.freedom, shift) - POWER, critical / 4, LARGEST_NONCENTRALITY
        )
        return shift * self.error + self.bias


@dataclass(frozen=True)
class Layout:
    """Numbers of states at positions: a level for each state, a number of its own for each position, and scatter.

    Every state has a level, every position a number that all states share, and mounting adds to each: the interaction
    of a two-way layout (Scheffe, The Analysis of Variance (1959), ch. 4), here with any cells missing.

    Attributes
    ----------
    state, position : (n_rows,) number of each.
    values : (n_rows, n_kinds)
    """

    state: Whole
    position: Whole
    values: Real

    @cached_property
    def freedom(self) -> int:
        """Degrees of freedom that the scatter is known with."""
        return len(self.values) - int(np.linalg.matrix_rank(self._columns)) if len(self.values) else 0

    @cached_property
    def residuals(self) -> Real:
        """What mounting adds to each row (n_rows, n_kinds), as far as levels and positions do not explain it."""
        return np.asarray(self.values - self._columns @ (self._inverse @ self.values), float)

    @cached_property
    def scatter(self) -> Real:
        """Standard deviation (n_kinds,) of what mounting adds; NaN where it is unknown."""
        if self.freedom < FEWEST_FREEDOM:
            return np.full(self.values.shape[1], np.nan)
        return np.asarray(np.sqrt(np.sum(self.residuals**2, axis=0) / self.freedom), float)

    def contrast(self, weights: Sequence[float], bias: Real | float = 0.0) -> Contrast | None:
        """The contrast of the states' levels by ``weights`` (n_states,); None where it or the scatter is unknown.

        Parameters
        ----------
        bias : (n_kinds,) error of the contrast that all positions may share; none by default.
        """
        coefficients = np.zeros(self._columns.shape[1])
        coefficients[: len(weights)] = weights
        of_rows = coefficients @ self._inverse
        if self.freedom < FEWEST_FREEDOM or np.max(np.abs(of_rows @ self._columns - coefficients)) > ESTIMABLE:
            return None
        size = float(np.linalg.norm(of_rows))
        mean = of_rows @ self.values
        error = np.maximum(size * self.scatter, LEAST_ERROR)
        shared_bias = np.broadcast_to(np.asarray(bias, float), mean.shape)
        return Contrast(mean, error, size, self.residuals, self.freedom, shared_bias)

    def half_interval(self, confidence: float) -> Real:
        """Half of the confidence interval (n_kinds,) of what mounting adds to a single row; NaN where it is unknown."""
        return float(scipy.stats.t.ppf(0.5 + confidence / 2, max(self.freedom, 1))) * self.scatter

    def departure_p(self, columns: Real) -> Real:
        """F test (n_kinds,) of levels of the states that ``columns`` (n_rows, k) of theirs do not describe.

        Without columns: of no difference between the states. NaN where the scatter is unknown or nothing is left.
        """
        if self.freedom < FEWEST_FREEDOM:
            return np.full(self.values.shape[1], np.nan)
        reduced_columns = np.column_stack([columns, indicators(self.position)])
        residuals = self.values - reduced_columns @ np.linalg.lstsq(reduced_columns, self.values, rcond=None)[0]
        further_freedom = len(self.values) - int(np.linalg.matrix_rank(reduced_columns)) - self.freedom
        if further_freedom < 1:
            return np.full(self.values.shape[1], np.nan)
        departure = np.sum(residuals**2, axis=0) - np.sum(self.residuals**2, axis=0)
        ratio = departure / further_freedom / np.maximum(self.scatter**2, LEAST_ERROR**2)
        return np.asarray(scipy.stats.f.sf(ratio, further_freedom, self.freedom), float)

    @cached_property
    def _columns(self) -> Real:
        """Indicators (n_rows, n_states + n_positions) of state and position."""
        return np.column_stack([indicators(self.state), indicators(self.position)])

    @cached_property
    def _inverse(self) -> Real:
        return np.asarray(np.linalg.pinv(self._columns), float)


def indicators(values: Whole) -> Real:
    """Indicators (n, n_values) of values 0, 1, ..."""
    return np.asarray(values[:, None] == np.arange(values.max(initial=-1) + 1), float)

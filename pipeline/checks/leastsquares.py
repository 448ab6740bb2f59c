"""Least squares for positive numbers within bounds, with intervals by profile likelihood.

Numbers are fitted as logarithms: a stiffness known within a factor is as good as a length known within the same one.
The scatter of the data is not known beforehand, so it is estimated from the misfit itself: an interval holds the
values of a number at which the others can keep the sum of squares below (1 + F(1, freedom)/freedom) times its least.

Source: Seber and Wild, Nonlinear Regression (1989), 5.2.1 (asymptotic) and 5.4 (profile: likelihood ratio).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import f as f_distribution

from pipeline.arrays import Real

STEP = 1e-4
"""Of the forward differences, in logarithms: far above the solver's 1e-9, far below the numbers' intervals."""
TOLERANCE = 1e-9
"""Relative change of numbers, misfit and slope at which a fit ends."""
END_TOLERANCE = 1e-6
"""To which the ends of an interval are found, in logarithms."""
SMALLEST_SINGULAR = 1e-10
"""Singular value, relative to the largest, that stands for none: the numbers' combination changes nothing."""
HIGHEST_CORRELATION = 0.95
"""Correlation from which two numbers are reported as not separable."""

Residual = Callable[[Real], Real]


@dataclass(frozen=True)
class Fitted:
    """Numbers of least squares.

    Attributes
    ----------
    value, low, high : (k,) the numbers and their intervals; NaN: the data do not bound the number on that side.
    residual : (n,) relative misfits.
    correlation : (k, k) of the numbers' logarithms.
    singular_values : (k,) of the misfits' derivatives by the logarithms, largest first.
    """

    value: Real
    low: Real
    high: Real
    residual: Real
    correlation: Real
    singular_values: Real

    @property
    def freedom(self) -> int:
        """Degrees of freedom: data less numbers."""
        return len(self.residual) - len(self.value)

    def warnings(self, names: tuple[str, ...]) -> list[str]:
        """What the data do not determine, one sentence each."""
        texts = []
        for name, low, high in zip(names, self.low, self.high, strict=True):
            open_ends = [side for side, end in (("below", low), ("above", high)) if np.isnan(end)]
            if open_ends:
                texts.append(f"{name} is not determined: nothing in the data bounds it {' or '.join(open_ends)}")
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(self.correlation[i, j]) > HIGHEST_CORRELATION:
                texts.append(f"{names[i]} and {names[j]} are not separable: correlation {self.correlation[i, j]:+.3f}")
        return texts


def fit_numbers(residual: Residual, start: Real, lower: Real, upper: Real, confidence: float | None) -> Fitted:
    """Fit ``start`` (k,) within its bounds; ``residual`` maps numbers (k,) to misfits (n,).

    ``confidence`` None leaves the intervals out: NaN.
    """
    logs, low, high = np.log(start), np.log(lower), np.log(upper)
    optimum, misfit, slope = _solve(residual, logs, low, high)
    _, singular, rotation = np.linalg.svd(slope, full_matrices=False)
    spread = rotation.T / np.maximum(singular, SMALLEST_SINGULAR * singular[0])
    covariance = spread @ spread.T
    scale = np.sqrt(np.diag(covariance))
    ends = np.full((2, len(start)), np.nan)
    freedom = len(misfit) - len(start)
    if confidence is not None and freedom > 0:
        limit = np.sum(misfit**2) * (1 + f_distribution.ppf(confidence, 1, freedom) / freedom)
        for k in range(len(start)):
            for side, bound in enumerate((low[k], high[k])):
                ends[side, k] = _end(residual, optimum, low, high, k, bound, limit)
    return Fitted(
        np.exp(optimum), np.exp(ends[0]), np.exp(ends[1]), misfit, covariance / np.outer(scale, scale), singular
    )


def _solve(residual: Residual, start: Real, low: Real, high: Real) -> tuple[Real, Real, Real]:
    """Logarithms, misfits and their derivatives at the least sum of squares."""

    def misfit(logs: Real) -> Real:
        return residual(np.exp(logs))

    def slope(logs: Real) -> Real:
        base = misfit(logs)
        columns = []
        for k in range(len(logs)):
            step = np.zeros(len(logs))
            step[k] = STEP if logs[k] + STEP <= high[k] else -STEP
            columns.append((misfit(logs + step) - base) / step[k])
        return np.stack(columns, axis=1)

    interior_start = np.clip(start, low + STEP, high - STEP)
    solution = least_squares(misfit, interior_start, slope, (low, high), xtol=TOLERANCE, ftol=TOLERANCE, gtol=TOLERANCE)
    return solution.x, solution.fun, solution.jac


def _end(residual: Residual, optimum: Real, low: Real, high: Real, k: int, bound: float, limit: float) -> float:
    """Where the profile of the number k reaches ``limit`` between the best value and the bound; NaN if nowhere."""
    is_free = np.arange(len(optimum)) != k

    def excess(log: float) -> float:
        def profile_residual(values: Real) -> Real:
            parameters = np.exp(optimum)
            parameters[k], parameters[is_free] = np.exp(log), values
            return residual(parameters)

        if not np.any(is_free):
            return float(np.sum(profile_residual(np.empty(0)) ** 2)) - limit
        return float(np.sum(_solve(profile_residual, optimum[is_free], low[is_free], high[is_free])[1] ** 2)) - limit

    if abs(bound - optimum[k]) < END_TOLERANCE or excess(bound) <= 0:
        return np.nan
    return float(brentq(excess, optimum[k], bound, xtol=END_TOLERANCE))

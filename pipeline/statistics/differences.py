"""Differences of a mean, a share, a standard deviation or a quantile between two sets of samples, with intervals.

``paired`` sets have one value per draw in common, in the same order: what the draws share then cancels. Sets of
replicates (Sobol', hypercube) are compared by the spread between their independent randomisations.

The largest t of several tests of the same normal data: rotations give its distribution for any correlation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real, Truth
from pipeline.statistics.intervals import QUANTILES, mean_interval
from pipeline.statistics.resampling import FEWEST_BEYOND, Interval, by_replicate

RESAMPLES = 1000
"""Of the bootstrap: the ends of a 95 % interval stray by a tenth of its half width."""
RESAMPLED_VALUES = 500_000
"""Of resamples that are held together: 4 MB."""
Replicate = NDArray[np.integer] | None


def mean_difference(a: Real, b: Real, confidence: float, are_paired: bool) -> Interval:
    """Student's t interval of the mean of ``b`` less that of ``a``, (n,) each; Welch's where they are not paired."""
    return mean_interval(b - a, confidence) if are_paired else welch_interval(a, b, confidence)


def welch_interval(a: Real, b: Real, confidence: float) -> Interval:
    """Welch's interval of the mean of ``b`` (n_b,) less that of ``a`` (n_a,); unbounded for a single value.

    Source
    ------
    Welch, The generalization of Student's problem when several different population variances are involved, Biometrika
    34 (1947) 28.
    """
    if min(a.size, b.size) < 2:
        return -np.inf, np.inf
    if a.var() + b.var() == 0:
        return float(b.mean() - a.mean()), float(b.mean() - a.mean())
    ends = scipy.stats.ttest_ind(b, a, equal_var=False).confidence_interval(confidence)
    return float(ends.low), float(ends.high)


def share_difference(a: Truth, b: Truth, confidence: float, are_paired: bool) -> Interval:
    """Newcombe's interval of the share of ``b`` that is true less that of ``a``, from Wilson's of each.

    Notes
    -----
    d -+ sqrt(u^2 - 2 phi u v + v^2) with the distances u, v of the shares to the ends of their own intervals; phi is
    the correlation of pairs, less half a unit where it is positive, and 0 without pairs.

    Source
    ------
    Newcombe, Interval estimation for the difference between independent proportions, Stat. Med. 17 (1998) 873, and
    Improved confidence intervals for the difference between binomial proportions based on paired data, ibid. 2635;
    method 10 of each.
    """
    share_a, share_b = float(a.mean()), float(b.mean())
    (low_a, high_a), (low_b, high_b) = _wilson(a, confidence), _wilson(b, confidence)
    phi = _pair_correlation(a, b) if are_paired else 0.0
    downward = np.array([share_b - low_b, high_a - share_a])
    upward = np.array([high_b - share_b, share_a - low_a])
    value = share_b - share_a
    return value - _combined_distance(downward, phi), value + _combined_distance(upward, phi)


def _combined_distance(distances: Real, phi: float) -> float:
    return float(np.sqrt(max(np.sum(distances**2) - 2 * phi * np.prod(distances), 0.0)))


def _wilson(passes: Truth, confidence: float) -> Interval:
    ends = scipy.stats.binomtest(int(passes.sum()), passes.size).proportion_ci(confidence, method="wilson")
    return float(ends.low), float(ends.high)


def _pair_correlation(a: Truth, b: Truth) -> float:
    table = np.array([[np.sum(a & b), np.sum(a & ~b)], [np.sum(~a & b), np.sum(~a & ~b)]], float)
    margins = float(np.prod(table.sum(axis=0)) * np.prod(table.sum(axis=1)))
    if margins == 0:
        return 0.0
    product = float(table[0, 0] * table[1, 1] - table[0, 1] * table[1, 0])
    product = max(product - a.size / 2, 0.0) if product > 0 else product
    return product / float(np.sqrt(margins))


def order_differences(a: Real, b: Real, confidence: float, are_paired: bool, seed: int) -> dict[str, Interval]:
    """Bootstrap intervals of std and of the quantiles of `QUANTILES`, of ``b`` (n_b,) less those of ``a`` (n_a,).

    Unbounded where fewer than `FEWEST_BEYOND` samples of either set are expected beyond a quantile: a resample knows
    nothing beyond the largest value.

    Source
    ------
    Efron, Tibshirani, An Introduction to the Bootstrap (1993), chapter 13: percentile intervals.
    """
    rng = np.random.default_rng(seed)
    resamples = np.empty((RESAMPLES, 1 + len(QUANTILES)))
    at_once = max(1, RESAMPLED_VALUES // max(a.size, b.size))
    for start in range(0, RESAMPLES, at_once):
        sizes = [a.size] if are_paired else [a.size, b.size]
        draws = [[rng.integers(n, size=n) for n in sizes] for _ in range(min(at_once, RESAMPLES - start))]
        rows_a, rows_b = (np.stack([draw[side] for draw in draws]) for side in (0, -1))
        resamples[start : start + len(draws)] = _std_and_quantiles(b[rows_b]) - _std_and_quantiles(a[rows_a])
    ends = np.quantile(resamples, [(1 - confidence) / 2, (1 + confidence) / 2], axis=0).T
    intervals = {"std": (float(ends[0, 0]), float(ends[0, 1]))}
    for (name, level), (low, high) in zip(QUANTILES.items(), ends[1:], strict=True):
        is_known = enough_beyond(min(a.size, b.size), level)
        intervals[name] = (float(low), float(high)) if is_known else (-np.inf, np.inf)
    return intervals


def enough_beyond(n: int, level: float) -> bool:
    """Whether ``n`` samples leave `FEWEST_BEYOND` beyond the ``level`` quantile."""
    return round(n * min(level, 1 - level), 6) >= FEWEST_BEYOND


def _std_and_quantiles(values: Real) -> Real:
    """Of resamples (n_resamples, n), (n_resamples, 1 + n_quantiles)."""
    levels = list(QUANTILES.values())
    quantiles = np.quantile(values, levels, axis=1, method="median_unbiased").T
    spread = np.where(np.ptp(values, axis=1) > 0, np.std(values, axis=1, ddof=1), 0.0)
    return np.column_stack([spread, quantiles])


def replicated_difference(
    statistic: Callable[[Real], float],
    sets: tuple[Real, Real],
    replicate: tuple[NDArray[np.integer], NDArray[np.integer]],
    confidence: float,
    are_paired: bool,
) -> Interval:
    """Student's t interval of a statistic's difference from its values in the replicates of each set.

    Parameters
    ----------
    sets : (n_a,) and (n_b,) values.
    replicate : the randomisation of each value.
    are_paired : whether randomisation k of both sets has the same draws.

    Notes
    -----
    About the difference of the whole sets, whose bias is smaller.
    """
    parts_a, parts_b = (by_replicate(statistic, *pair_of_sets) for pair_of_sets in zip(sets, replicate, strict=True))
    low, high = mean_difference(parts_a, parts_b, confidence, are_paired)
    shift = statistic(sets[1]) - statistic(sets[0]) - 0.5 * (low + high)
    return low + shift, high + shift


ROTATIONS = 200_000
"""Rotations that are drawn: a p of 2 % is known to 0.03 %."""
SEED = 2005
"""Of the rotations: equal data give an equal answer."""
SMALLEST_SQUARE = 1e-300
"""Sum of squares below which a test has no data."""


@dataclass(frozen=True)
class Family:
    """Tests of the means of the same rows.

    Attributes
    ----------
    shares : (n_tests,) of each test, |contrast| over the root of all of its squares: |t| is sqrt(freedom) times its
        ratio to the root of the rest.
    largest_t : (ROTATIONS,) the largest share of all tests of rows without an effect, ascending.
    freedom : degrees of freedom of the scatter.
    """

    shares: Real
    largest_t: Real
    freedom: int

    @property
    def p(self) -> Real:
        """Two-sided p of no effect (n_tests,), all tests counted: never more than n_tests times that of one."""
        below = np.searchsorted(self.largest_t, self.shares * (1 - 1e-12))
        return (1 + len(self.largest_t) - below) / (1 + len(self.largest_t))

    def level(self, chance: float) -> float:
        """Level of each two-sided test by itself at which any of them errs with ``chance``."""
        share = float(np.quantile(self.largest_t, 1 - chance))
        t = np.sqrt(self.freedom) * share / np.sqrt(max(1 - share**2, SMALLEST_SQUARE))
        return 2 * float(scipy.stats.t.sf(t, self.freedom))


def family(contrast: Real, residuals: Real, freedom: int) -> Family:
    """Tests of contrasts against the scatter of independent normal rows, of any covariance between the tests.

    Parameters
    ----------
    contrast : (n_tests,) of the variance of a row where there is no effect.
    residuals : (n_rows, n_tests) whose squares sum to ``freedom`` times that variance.

    Notes
    -----
    Without an effect, contrast and residuals are ``freedom`` + 1 independent rows of one normal distribution, and any
    rotation of them is as likely: given their sums of squares and products the distribution of the largest t holds no
    unknown (Langsrud, Rotation tests, Statistics and Computing 15 (2005) 53; single step of Westfall and Young,
    Resampling-Based Multiple Testing (1993)). A single test is the t test.
    """
    size = np.sqrt(np.maximum(contrast**2 + np.sum(residuals**2, axis=0), SMALLEST_SQUARE))
    _, values, directions = np.linalg.svd(residuals / size, full_matrices=False)
    rows = np.vstack([contrast / size, (values[:, None] * directions)[:freedom]])
    rng = np.random.default_rng(SEED)
    direction = rng.standard_normal((ROTATIONS, freedom + 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    largest_t = np.abs(direction[:, : len(rows)] @ rows).max(axis=1)
    return Family(np.abs(contrast) / size, np.sort(largest_t), freedom)

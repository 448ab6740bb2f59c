"""Mean, standard deviation, quantiles and yield of a metric, each with a confidence interval.

Independent samples (Monte Carlo) have intervals without an assumed distribution. The points of a Sobol' sequence or a
Latin hypercube are not independent; their intervals come from the spread between independent randomisations
(module ``resampling``).

`units_for_yield` is the number of independent units that a wanted accuracy of the yield takes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # its functions are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real, Truth
from pipeline.statistics.resampling import (
    Interval,
    Statistic,
    by_replicate,
    replicated_interval,
    replicated_quantile_interval,
    replicated_share_interval,
)

QUANTILES = {"p01": 0.01, "p05": 0.05, "p25": 0.25, "p50": 0.50, "p75": 0.75, "p95": 0.95, "p99": 0.99}


@dataclass(frozen=True)
class Estimate:
    """A statistic with its confidence interval, from `n` samples.

    A bound that the samples do not determine is infinite: a 1 % quantile has no lower bound among 50 samples.
    """

    value: float
    ci_low: float
    ci_high: float
    n: int


def distribution(values: Real, confidence: float, replicate: NDArray[np.integer] | None = None) -> dict[str, Estimate]:
    """Mean, std and the quantiles of `QUANTILES`, by name.

    Parameters
    ----------
    values : (n_samples,) a metric, in any unit.
    confidence : level of the intervals, in (0, 1).
    replicate : (n_samples,) the randomisation of each sample; None for independent samples.

    Raises
    ------
    ValueError : a value is not finite, or there are no values.

    Notes
    -----
    Independent samples: mean by Student's t, std by Bonett, quantiles by order statistics. Replicates: mean and std by
    Student's t over the replicates' own statistics, about the statistic of all samples together, whose bias is smaller;
    quantiles by order statistics of all samples together (``replicated_quantile_interval``).
    """
    values = np.asarray(values, float)
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ValueError(f"{np.sum(~np.isfinite(values))} of {values.size} values are not finite; select them first")
    moments: dict[str, tuple[Statistic, Callable[[Real, float], Interval]]] = {
        "mean": (mean, mean_interval),
        "std": (standard_deviation, std_interval),
    }
    estimates = {}
    for name, (statistic, interval) in moments.items():
        point_estimate = statistic(values)
        ends = (
            interval(values, confidence)
            if replicate is None
            else replicated_interval(point_estimate, by_replicate(statistic, values, replicate), confidence)
        )
        estimates[name] = _estimate(point_estimate, ends, values.size)
    for name, level in QUANTILES.items():
        point_estimate = quantile(values, level)
        ends = (
            quantile_interval(values, confidence, level)
            if replicate is None
            else replicated_quantile_interval(point_estimate, values, confidence, level, replicate)
        )
        estimates[name] = _estimate(point_estimate, ends, values.size)
    return estimates


def pass_share(
    passes: Truth, confidence: float, replicate: NDArray[np.integer] | None = None, n_missing: int = 0
) -> Estimate:
    """Yield: the share of samples that keep a limit.

    Parameters
    ----------
    passes : (n_samples,) whether each sample keeps it.
    confidence, replicate : as in `distribution`.
    n_missing : samples beside these whose values are not known. The lower end of the interval is as if all of them
        failed: samples are often without a value because they are far from nominal.

    Notes
    -----
    Clopper-Pearson for independent samples. Replicates that all pass, or all fail, have no spread to tell how sure that
    is; they then get the interval of independent samples, which is wider than theirs.
    """
    counts = np.asarray(passes, float)
    if replicate is None or np.ptp(counts) == 0:
        ends = share_interval(counts, confidence)
    else:
        ends = replicated_share_interval(counts, confidence, replicate)
    return with_missing(_estimate(mean(counts), ends, counts.size), n_missing)


def with_missing(share: Estimate, n_missing: int) -> Estimate:
    """A share of samples that keep a limit, with a lower end as if ``n_missing`` further samples failed."""
    return replace(share, ci_low=share.ci_low * share.n / (share.n + n_missing)) if n_missing else share


def mean_interval(values: Real, confidence: float) -> Interval:
    """Student's t interval of the mean; unbounded for one value."""
    if values.size < 2:
        return -np.inf, np.inf
    half = scipy.stats.t.ppf((1 + confidence) / 2, values.size - 1) * standard_deviation(values) / np.sqrt(values.size)
    return mean(values) - half, mean(values) + half


def std_interval(values: Real, confidence: float) -> Interval:
    """Interval of the standard deviation that allows for the kurtosis of the values; unbounded below 5 values.

    Notes
    -----
    ln(c s^2) +- z c sqrt((k - (n-3)/n)/(n-1)), c = n/(n - z), k the kurtosis about the trimmed mean. The usual chi^2
    interval holds for normal values only and does not improve with n.

    Source
    ------
    Bonett, Approximate confidence interval for standard deviation of nonnormal distributions, Comput. Stat. Data Anal.
    50 (2006) 775.
    """
    n, variance = values.size, standard_deviation(values) ** 2
    if n < 5:
        return 0.0, np.inf
    if variance == 0:
        return 0.0, 0.0
    z = scipy.stats.norm.ppf((1 + confidence) / 2)
    centre = scipy.stats.trim_mean(values, 1 / (2 * np.sqrt(n - 4)) if n > 5 else 0.0)
    kurtosis = n * np.sum((values - centre) ** 4) / ((n - 1) * variance) ** 2
    small_sample = n / (n - z)
    half = z * small_sample * np.sqrt(max(kurtosis - (n - 3) / n, 0.0) / (n - 1))
    return float(np.sqrt(small_sample * variance * np.exp(-half))), float(
        np.sqrt(small_sample * variance * np.exp(half))
    )


def quantile_interval(values: Real, confidence: float, level: float) -> Interval:
    """Interval of the `level` quantile between two order statistics, exact for any continuous distribution.

    Notes
    -----
    The number of values below the quantile is binomial (n, level); the ranks are its quantiles, so that the coverage is
    at least `confidence`. A rank outside the sample leaves that side unbounded.
    """
    n, order_statistics = values.size, np.sort(values)
    low, high = _ranks(n, confidence, level)
    return (order_statistics[low - 1] if low >= 1 else -np.inf), (order_statistics[high] if high < n else np.inf)


def share_interval(passes: Real, confidence: float) -> Interval:
    """Clopper-Pearson interval of a share; `passes` holds 0 and 1."""
    return _share_ends(int(np.sum(passes)), passes.size, confidence)


@lru_cache
def _ranks(n: int, confidence: float, level: float) -> tuple[int, int]:
    """Ranks of the order statistics; all metrics of a study ask for the same."""
    low, high = scipy.stats.binom.ppf([(1 - confidence) / 2, (1 + confidence) / 2], n, level)
    return int(low), int(high)


@lru_cache
def _share_ends(passes: int, n: int, confidence: float) -> Interval:
    interval = scipy.stats.binomtest(passes, n).proportion_ci(confidence_level=confidence, method="exact")
    return float(interval.low), float(interval.high)


def _estimate(value: float, ends: Interval, n: int) -> Estimate:
    return Estimate(value, float(ends[0]), float(ends[1]), n)


def mean(values: Real) -> float:
    """Mean of values (n,)."""
    return float(np.mean(values))


def standard_deviation(values: Real) -> float:
    """Standard deviation of values (n,); 0 for equal ones, whose mean may be off by a rounding, and for a single."""
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0 else 0.0


def quantile(values: Real, level: float) -> float:
    """The `level` quantile of values (n,), median-unbiased for any distribution (Hyndman and Fan's eighth)."""
    return float(np.quantile(values, level, method="median_unbiased"))


GROWTH = 4
"""Times as many samples that a batch asks for at most: the share of few units may mislead, and looks are to be few."""


def units_for_yield(share: float, half_width: float, confidence: float) -> int:
    """Fewest units whose Clopper-Pearson interval of a share, at the share itself, is at most 2 ``half_width`` wide.

    Parameters
    ----------
    share : in [0, 1].
    half_width : in (0, 0.5].
    confidence : level of the interval, in (0, 1).

    Raises
    ------
    ValueError
        If a number lies outside of its range.

    Notes
    -----
    About z^2 share (1 - share)/half_width^2; at a share of 1 the interval is one-sided, ln(tail)/ln(1 - width).
    """
    if not (0 <= share <= 1 and 0 < half_width <= 0.5 and 0 < confidence < 1):
        raise ValueError(f"share {share}, half width {half_width}, confidence {confidence}: outside of their ranges")
    low, high = 1, 2
    while _width(share, high, confidence) > 2 * half_width:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _width(share, middle, confidence) <= 2 * half_width else (middle, high)
    return high


def next_units(share: float, units: int, samples: int, half_width: float, confidence: float) -> int:
    """Samples after which a yield may be known as well as is wanted, when ``samples`` of them did not do.

    Parameters
    ----------
    share : yield of the ``units`` among the samples that have a result.
    half_width, confidence : as in ``units_for_yield``.

    Notes
    -----
    What the share so far says, in proportion where samples have no result; `GROWTH` times as many at most, and one more
    at least.
    """
    target_units = units_for_yield(share, half_width, confidence) * samples / max(units, 1)
    return max(samples + 1, min(GROWTH * samples, math.ceil(target_units)))


def _width(share: float, units: int, confidence: float) -> float:
    """Width of the interval of ``units`` with the share; a count need not be a whole number."""
    tail, n_passes = (1 - confidence) / 2, share * units
    low = 0.0 if n_passes <= 0 else float(scipy.special.betaincinv(n_passes, units - n_passes + 1, tail))
    high = (
        1.0 if math.isclose(n_passes, units) else float(scipy.special.betainccinv(n_passes + 1, units - n_passes, tail))
    )
    return high - low

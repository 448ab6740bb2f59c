"""Intervals for data that are not independent, by resampling and by replicates.

Intervals from the spread between independent randomisations of a design of experiment.

The points of a Sobol' sequence or a Latin hypercube are not independent, the randomisations are. Of a share their
spread tells how many independent samples would know it as well; with that number follow the intervals of the share and
of the quantile that it cuts off. ``make coverage`` counts how often they hold the truth.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray
from scipy import special

from pipeline.arrays import Real, Whole


@lru_cache(maxsize=16)
def resampled_counts(n_blocks: int, resamples: int, seed: int) -> Whole:
    """How often each block is drawn (resamples, n_blocks), as many draws as blocks, with replacement."""
    counts = np.random.default_rng(seed).multinomial(n_blocks, np.full(n_blocks, 1 / n_blocks), size=resamples)
    counts.flags.writeable = False  # callers share it
    return counts


def resampled_means(values: Real, resamples: int, seed: int) -> Real:
    """Means (resamples, ...) of blocks drawn with replacement; ``values`` (n_blocks, ...) has one entry a block."""
    return np.tensordot(resampled_counts(len(values), resamples, seed), values, axes=1) / len(values)


def max_t(gains: Real, resamples: int, seed: int) -> tuple[Real, Real]:
    """Studentised mean gains of several models and their p-values, adjusted for the choice of the best.

    Parameters
    ----------
    gains : (n_blocks, n_models) gain of each model in each block.

    Returns
    -------
    t : (n_models,) mean over its standard error.
    p : (n_models,) one-sided, adjusted by the distribution of the largest t of models without gain (Westfall, Young,
        Resampling-Based Multiple Testing (1993), single step). Each resample has a standard error of its own (Davison,
        Hinkley, Bootstrap Methods and their Application (1997), section 4.4): with that of the data the test of eight
        blocks was rejected in 17 % at a level of 5 %.
    """
    n, mean = len(gains), gains.mean(axis=0)
    t = _t_values(mean, np.mean((gains - mean) ** 2, axis=0), n)
    resampled = resampled_means(gains - mean, resamples, seed)
    resampled_variance = resampled_means((gains - mean) ** 2, resamples, seed) - resampled**2
    largest_t = _t_values(resampled, resampled_variance, n).max(axis=1)
    p = (1 + np.sum(largest_t[:, None] >= t, axis=0)) / (resamples + 1)
    return t, p


def _t_values(mean: Real, variance: Real, n: int) -> Real:
    """Means of n values over their standard error by the values' own variance; 0 where they are equal."""
    error = np.sqrt(np.maximum(variance, 0.0) / (n - 1))
    t: Real = mean / np.where(error > 0, error, np.inf)
    return t


CONFIDENCE = 0.95
"""Of intervals and tests."""
LEVEL = 1 - CONFIDENCE
"""p, or posterior probability, below which a hypothesis is rejected."""


def jackknife_interval(value: float, left_out: Sequence[float], confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval of a value by the values without each group; NaN without any.

    Of logarithms where all values are positive and clear of zero; of a positive number that is not, it begins at zero.

    Source
    ------
    Efron and Tibshirani, An Introduction to the Bootstrap (1993), chapter 11.
    """
    if len(left_out) < 2:
        return float("nan"), float("nan")
    reach = _reach(np.array(left_out), confidence)
    if min(value, *left_out) <= 0:
        return value - reach, value + reach
    if reach >= value:
        return 0.0, value + reach
    factor = float(np.exp(_reach(np.log(left_out), confidence)))
    return value / factor, value * factor


def _reach(values: Real, confidence: float) -> float:
    """Half of the interval by values (n,) of fits that leave out a group each."""
    n = len(values)
    error = np.sqrt((n - 1) / n * np.sum((values - np.mean(values)) ** 2))
    return float(scipy.stats.t.ppf((1 + confidence) / 2, n - 1) * error)


Interval = tuple[float, float]
Statistic = Callable[[Real], float]

FEWEST_BEYOND = 10
"""Samples expected beyond a quantile below which it has no interval: replicates of one such sample tell no spread."""


def by_replicate(statistic: Statistic, values: Real, replicate: NDArray[np.integer]) -> Real:
    """The statistic of each replicate's own values, (n_replicates,)."""
    return np.array([statistic(values[replicate == r]) for r in np.unique(replicate)])


def replicated_interval(estimate: float, parts: Real, confidence: float) -> Interval:
    """Student's t interval about `estimate`, from the spread of one statistic per independent replicate."""
    half = scipy.stats.t.ppf((1 + confidence) / 2, parts.size - 1) * np.std(parts, ddof=1) / np.sqrt(parts.size)
    return estimate - float(half), estimate + float(half)


def effective_number(in_tail: Real, share: float, confidence: float, replicate: NDArray[np.integer]) -> float:
    """Number of independent samples that would know a share as well as the replicates do.

    Parameters
    ----------
    in_tail : (n_samples,) 1 for a sample that counts, 0 for another.
    share : at which the binomial variance is taken, in (0, 1).

    Notes
    -----
    share (1 - share) over the variance of the mean of the replicates' own shares, times (z/t)^2, which allows for the
    few replicates that this variance is known from. A replicate of m points rounds its share to 1/m, so that the
    variance between replicates is at least that of rounding, 1/(12 m^2).

    Source
    ------
    Korn and Graubard, Confidence intervals for proportions with small expected number of positive counts estimated from
    survey data, Survey Methodology 24 (1998) 193.
    """
    parts = by_replicate(np.mean, in_tail, replicate)
    count = parts.size
    rounding = (count / in_tail.size) ** 2 / 12
    variance = max(float(np.var(parts, ddof=1)), rounding) / count
    tail = (1 + confidence) / 2
    narrowing = scipy.stats.norm.ppf(tail) / scipy.stats.t.ppf(tail, count - 1)
    return float(share * (1 - share) / variance * narrowing**2)


def replicated_share_interval(passes: Real, confidence: float, replicate: NDArray[np.integer]) -> Interval:
    """Jeffreys' interval of a share for the effective number of samples; `passes` holds 0 and 1, and both of them.

    Source
    ------
    Brown, Cai, DasGupta, Interval estimation for a binomial proportion, Stat. Sci. 16 (2001) 101.
    """
    share = float(np.mean(passes))
    n = effective_number(passes, share, confidence, replicate)
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    low, high = scipy.stats.beta.ppf(tails, n * share + 0.5, n * (1 - share) + 0.5)
    return float(low), float(high)


def replicated_quantile_interval(
    estimate: float, values: Real, confidence: float, level: float, replicate: NDArray[np.integer]
) -> Interval:
    """Interval of the `level` quantile between two order statistics of all replicates together.

    Parameters
    ----------
    estimate : the quantile of all values.

    Notes
    -----
    As ``intervals.quantile_interval``, for the effective number of samples and with ranks that need not be whole:
    between two ranks values are interpolated. Unbounded where fewer than `FEWEST_BEYOND` samples are expected beyond.

    Source
    ------
    Woodruff, Confidence intervals for medians and other position measures, J. Am. Stat. Assoc. 47 (1952) 635; Beran,
    Hall, Interpolated nonparametric prediction intervals and confidence intervals, J. R. Stat. Soc. B 55 (1993) 643.
    """
    # The product is rounded: 200 samples have 10 beyond 5 %, not 9.999.
    if round(values.size * min(level, 1 - level), 6) < FEWEST_BEYOND:
        return -np.inf, np.inf
    is_below = np.asarray(values <= estimate, float)
    n = effective_number(is_below, level, confidence, replicate)
    ends = rank_share(n, level, confidence), 1 - rank_share(n, 1 - level, confidence)
    low, high = np.quantile(values, ends, method="weibull")
    rank = np.array(ends) * (values.size + 1)
    return (float(low) if rank[0] >= 1 else -np.inf), (float(high) if rank[1] <= values.size else np.inf)


def rank_share(n: float, level: float, confidence: float) -> float:
    """Rank k over n + 1 whose order statistic of n values lies below the `level` quantile as often as it should.

    The number of values below the quantile is at least k with probability I_level(k, n - k + 1), for any real k.
    """
    tail = (1 - confidence) / 2
    if (1 - level) ** n > tail:  # even the smallest value is too often above
        return 0.0
    return float((1 + special.bdtrik(tail, n, level)) / (n + 1))

"""Far tails from few expensive values: a cheap predictor of every unit decides which of them are worth the expense.

Phase 1 draws ``units`` independent units and predicts each one's value. Phase 2 finds the values of some of them; a
unit is taken or left independently of all others, with its own known probability (Poisson sampling). Every value counts
as the inverse of its probability (Horvitz and Thompson), so that a share is unbiased however bad the predictor: a bad
one only makes the interval wide. How many units the taken ones stand for is known; a share that the predictor takes to
be large is corrected by it (a difference estimator), or it would follow the number that happened to be taken.

Estimates from values that fall short of what is asked for, by units of which the shortfall is known.

Every unit has the worst value that a search found; of some, drawn at random, the worst over the whole turn is known,
and so the shortfall of the search. A unit's true value is its found one and a shortfall of the audited units, each of
which is as likely: the shortfall is taken to be independent of the value. Both samples enter the interval.

Source
------
Sarndal, Swensson, Wretman, Model Assisted Survey Sampling (1992), sections 3.5, 6.3 (differences) and 9.3.
Two-sample statistics: Lehmann, Nonparametrics (1975), app. 5; effective numbers of units: Korn and Graubard, Analysis
of Health Surveys (1999), sec. 2.6.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from scipy import special

from pipeline.arrays import Real, Truth
from pipeline.statistics.intervals import QUANTILES, Estimate
from pipeline.statistics.resampling import rank_share

TAIL_FREEDOM = 4.0
"""Degrees of freedom of Student's t for what a predictor misses: heavier tails than the normal's, whose failures far
below the limit would be taken too rarely."""


@dataclass(frozen=True)
class TailEstimate:
    """A statistic of the far tail with its confidence interval.

    Attributes
    ----------
    value, ci_low, ci_high : a bound that the values do not determine is infinite, of a share 0 or 1.
    units : units of phase 1.
    solved_units : values that it rests on.
    effective : independent units, all solved, that would know it as well; 0 where no value lies in the tail.
    """

    value: float
    ci_low: float
    ci_high: float
    units: int
    solved_units: int
    effective: float


def exceedance_chance(predicted_values: Real, limit: float, scale: float) -> Real:
    """Chance (n_units,) that a unit's value exceeds the limit, as far as its prediction tells.

    Parameters
    ----------
    predicted_values : (n_units,) in the value's unit.
    scale : typical size of what the prediction misses, in the same unit.
    """
    return np.asarray(special.stdtr(TAIL_FREEDOM, (predicted_values - limit) / scale))


def inclusion_probability(chance: Real, budget: float) -> Real:
    """Probability (n_units,) with which each unit is taken, of the least variance of the tail's share.

    Parameters
    ----------
    chance : (n_units,) that a unit lies in the tail, up to a common factor.
    budget : number of units that are taken on average.

    Notes
    -----
    Neyman's allocation: proportional to the root of the chance and at most 1, of sum ``budget``. What units at 1 cannot
    use is divided among the others.

    Raises
    ------
    ValueError
        If the budget is not above 0, or a chance is not.
    """
    if budget <= 0 or np.any(chance <= 0):
        raise ValueError(
            "every unit needs a chance above 0, and the budget too: what can never be taken is not counted"
        )
    weight = np.sqrt(chance)
    if budget >= weight.size:
        return np.ones_like(weight)
    descending = np.sort(weight)[::-1]
    weight_below = np.append(np.cumsum(descending[::-1])[::-1], 0.0)  # sum of all weights from each place on
    certain = np.arange(weight.size)  # number of units at 1
    factor = (budget - certain) / weight_below[:-1]
    first_certain = int(np.argmax(factor * descending <= 1))
    probability: Real = np.minimum(1.0, factor[first_certain] * weight)
    return probability


def count_slope(chance: Real, probability: Real) -> float:
    """What of the count of the taken units is to be taken off a share, by the chances (n_units,) to lie beyond.

    The slope of least variance of a share over the count, if units lie beyond with these chances; chosen before any
    unit is solved, it leaves the share unbiased.
    """
    spread = 1 / probability - 1
    total = float(np.sum(spread))
    return float(np.sum(chance * spread)) / total if total > 0 else 0.0


def tail_share(in_tail: Truth, probability: Real, units: int, confidence: float, slope: float = 0.0) -> TailEstimate:
    """Share of all units that lie beyond a limit.

    Parameters
    ----------
    in_tail : (n_solved,) whether each solved unit does.
    probability : (n_solved,) its inclusion probability.
    units : of phase 1.
    slope : of the share over the count of units that the solved ones stand for, see ``count_slope``.

    Notes
    -----
    The contributions slope + (beyond - slope)/probability of solved units, and the slope of all others, are independent
    among the units; so the variance of their mean is their own over ``units``, both phases included. It gives the
    effective number of units, and Jeffreys' interval follows with that number (Korn and Graubard). Where no solved unit
    lies beyond, the upper end is the share that units of the smallest probability would not show in ``confidence`` of
    all experiments; where all do although the count was taken off, the lower end is one less that share.
    """
    tail = (1 - confidence) / 2
    hidden = min(1.0, -np.log(tail) / (units * float(np.min(probability, initial=1.0))))
    if not np.any(in_tail):
        return TailEstimate(0.0, 0.0, hidden, units, in_tail.size, 0.0)
    share, effective = _share(in_tail, probability, units, slope)
    if np.all(in_tail) and slope:
        return TailEstimate(share, min(1 - hidden, share), 1.0, units, in_tail.size, 0.0)
    low, high = scipy.stats.beta.ppf([tail, 1 - tail], effective * share + 0.5, effective * (1 - share) + 0.5)
    return TailEstimate(share, float(low), float(high), units, in_tail.size, effective)


def tail_quantile(values: Real, probability: Real, units: int, level: float, confidence: float) -> TailEstimate:
    """Quantile of all units in their upper tail.

    Parameters
    ----------
    values : (n_solved,); of a metric of which little is bad its negative.
    probability, units : as in ``tail_share``.
    level : of the quantile, near 1.

    Notes
    -----
    The share beyond a value is the sum of the weights above it, half of its own included, over ``units``. The interval
    lies between two shares, those of the ranks that the effective number of units has at the quantile (Woodruff).
    """
    order = np.argsort(values)[::-1]
    descending, weight = values[order], 1 / probability[order]
    weight_above = np.cumsum(weight)
    value = _upper_quantile(1 - level, (weight_above - weight / 2) / units, descending)
    if not np.isfinite(value):
        return TailEstimate(np.nan, -np.inf, np.inf, units, values.size, 0.0)
    _, effective = _share(values >= value, probability, units)
    ends = 1 - rank_share(effective, level, confidence), rank_share(effective, 1 - level, confidence)
    low, high = (_upper_quantile(share, weight_above / (units + 1), descending) for share in ends)
    return TailEstimate(
        value, -np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high, units, values.size, effective
    )


def _share(in_tail: Truth, probability: Real, units: int, slope: float = 0.0) -> tuple[float, float]:
    """Share of the units beyond a limit, and the effective number of units that know it."""
    contributions = slope + (in_tail - slope) / probability
    other_units = units - in_tail.size
    mean = (float(np.sum(contributions)) + other_units * slope) / units
    square = (float(np.sum(contributions**2)) + other_units * slope**2) / units
    share, variance = min(max(mean, 0.0), 1.0), (square - mean**2) / (units - 1)
    return share, min(share * (1 - share) / variance, float(units)) if variance > 0 else float(units)


def _upper_quantile(share: float, shares: Real, descending: Real) -> float:
    """Value beyond which a share lies; NaN outside of the ascending shares."""
    if not shares[0] <= share <= shares[-1]:
        return np.nan
    return float(np.interp(share, shares, descending))


HALVINGS = 60
"""Of the range of values until a quantile is found to the last digit."""


def audited_share(passes: Iterable[Truth], confidence: float) -> Estimate:
    """Share of the units that pass, with the interval of both samples.

    Parameters
    ----------
    passes : of each audited unit (n_units,), whether each unit passes with its shortfall; not held all at once.

    Notes
    -----
    The variance is that of the units' own shares over their number and that of the audited ones' over theirs (the first
    projections of a two-sample statistic); Clopper and Pearson's interval follows with the effective number of units.
    """
    of_audited: list[float] = []
    counts: Real = np.zeros(())
    for is_passed in passes:
        counts = counts + is_passed
        of_audited.append(float(np.mean(is_passed)))
    n, share = len(counts), float(np.mean(of_audited))
    variance = _mean_variance(counts / len(of_audited)) + _mean_variance(np.array(of_audited))
    effective = min(n, share * (1 - share) / variance) if variance > 0 else n
    tail, hits = (1 - confidence) / 2, share * effective
    low = scipy.stats.beta.ppf(tail, hits, effective - hits + 1) if share > 0 else 0.0
    high = scipy.stats.beta.ppf(1 - tail, hits + 1, effective - hits) if share < 1 else 1.0
    return Estimate(share, float(low), float(high), n)


def audited_distribution(found_values: Real, shortfall: Real, confidence: float) -> dict[str, Estimate]:
    """Mean and the quantiles of `QUANTILES` of true values, by name.

    Parameters
    ----------
    found_values : (n_units,) values of the search.
    shortfall : (n_audited,) what is to be added to the found values of the audited units.

    Notes
    -----
    A quantile's interval lies between the quantiles of the levels that the interval of its share has (Woodruff).
    """
    mean = float(np.mean(found_values) + np.mean(shortfall))
    spread = np.sqrt(_mean_variance(found_values) + _mean_variance(shortfall))
    half = scipy.stats.t.ppf((1 + confidence) / 2, max(min(len(found_values), len(shortfall)) - 1, 1)) * spread
    estimates = {"mean": Estimate(mean, mean - half, mean + half, len(found_values))}
    ascending = np.sort(found_values)
    for name, level in QUANTILES.items():
        value = _quantile(ascending, shortfall, level)
        share = audited_share((found_values <= value - missed for missed in shortfall), confidence)
        low, high = (_quantile(ascending, shortfall, end) for end in (share.ci_low, share.ci_high))
        estimates[name] = Estimate(value, low, high, len(found_values))
    return estimates


def _quantile(ascending: Real, shortfall: Real, level: float) -> float:
    """Quantile of all sums of a found value and a shortfall, which are too many to be held."""
    rank = level * (len(ascending) * len(shortfall) - 1)
    below = _ranked_sum(ascending, shortfall, int(rank))
    above = _ranked_sum(ascending, shortfall, min(int(rank) + 1, len(ascending) * len(shortfall) - 1))
    return below + (rank - int(rank)) * (above - below)


def _ranked_sum(ascending: Real, shortfall: Real, rank: int) -> float:
    """The sum beside ``rank`` smaller ones, by bisection."""
    low, high = float(ascending[0] + np.min(shortfall)), float(ascending[-1] + np.max(shortfall))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        has_rank = np.sum(np.searchsorted(ascending, middle - shortfall, side="right")) > rank
        low, high = (low, middle) if has_rank else (middle, high)
    return high


def _mean_variance(values: Real) -> float:
    """Variance of the mean of independent values."""
    return float(np.var(values, ddof=1) / len(values)) if len(values) > 1 else 0.0

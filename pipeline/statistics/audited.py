"""Estimates from values that fall short of what is asked for, by units of which the shortfall is known.

Every unit has the worst value that a search found; of some, drawn at random, the worst over the whole turn is known,
and so the shortfall of the search. A unit's true value is its found one and a shortfall of the audited units, each of
which is as likely: the shortfall is taken to be independent of the value. Both samples enter the interval.

Source
------
Two-sample statistics: Lehmann, Nonparametrics (1975), app. 5; effective numbers of units: Korn and Graubard, Analysis
of Health Surveys (1999), sec. 2.6.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.statistics.intervals import QUANTILES, Estimate

HALVINGS = 60
"""Of the range of values until a quantile is found to the last digit."""


def audited_share(passes: Iterable[NDArray[np.bool_]], confidence: float) -> Estimate:
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

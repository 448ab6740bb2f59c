"""Which error drives a metric, and in which sense: rank correlations of errors that are one number per unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real

RANK_CORRELATION = "rank_correlation"
"""Name of this kind of index in tables."""
FEWEST_SAMPLES = 10
"""Fewer samples give no interval of a rank correlation: the normal approximation of Fisher's z is too sure of them."""


@dataclass(frozen=True)
class Indices:
    """One index per parameter and metric, with its confidence interval.

    Attributes
    ----------
    parameters : names (n_parameters,).
    value, ci_low, ci_high : (n_parameters, n_metrics) [-]; NaN where the samples do not determine the index.
    """

    parameters: tuple[str, ...]
    value: Real
    ci_low: Real
    ci_high: Real


def rank_correlation(
    parameters: Mapping[str, Real],
    metrics: Real,
    confidence: float,
    replicate: NDArray[np.integer] | None = None,
) -> Indices:
    """Spearman's rank correlation of each parameter with each metric.

    Parameters
    ----------
    parameters : (n_samples,) each, by name, in any unit.
    metrics : (n_samples, n_metrics).
    confidence : level of the intervals, in (0, 1).
    replicate : (n_samples,) the randomisation of each sample; None for independent samples.

    Returns
    -------
    Indices; NaN where a parameter or metric does not vary or there are fewer than 10 samples.

    Notes
    -----
    Independent samples: Fisher's z with the variance (1 + r^2/2)/(n - 3), which keeps its level up to |r| = 0.95 and,
    other than a bootstrap, is the same in every run. Replicates: Student's t over the replicates' own z.

    Source
    ------
    Bonett and Wright, Sample size requirements for estimating Pearson, Kendall and Spearman correlations, Psychometrika
    65 (2000) 23.
    """
    columns = np.column_stack(list(parameters.values()))
    correlation = _spearman(columns, metrics)
    z, n = _fisher(correlation), len(metrics)
    if replicate is None:
        too_few = n < FEWEST_SAMPLES
        deviation = np.full_like(correlation, np.nan) if too_few else np.sqrt((1 + correlation**2 / 2) / (n - 3))
        half = scipy.stats.norm.ppf((1 + confidence) / 2) * deviation
    else:
        parts = [_fisher(_spearman(columns[replicate == r], metrics[replicate == r])) for r in np.unique(replicate)]
        half = _student(np.stack(parts), confidence) / np.sqrt(len(parts))
    return Indices(tuple(parameters), correlation, np.tanh(z - half), np.tanh(z + half))


def _spearman(columns: Real, metrics: Real) -> Real:
    """Rank correlations (n_columns, n_metrics)."""
    ranks = [scipy.stats.rankdata(values, axis=0) for values in (columns, metrics)]
    centred_ranks = [rank - rank.mean(axis=0) for rank in ranks]
    with np.errstate(invalid="ignore", divide="ignore"):  # a column that does not vary has no correlation
        unit = [rank / np.linalg.norm(rank, axis=0) for rank in centred_ranks]
    return np.clip(unit[0].T @ unit[1], -1.0, 1.0)


def _fisher(correlation: Real) -> Real:
    # A perfect correlation has an infinite z; the last digit of 1 stands for it.
    return np.arctanh(np.clip(correlation, -1 + 1e-15, 1 - 1e-15))


def _student(parts: Real, confidence: float) -> Real:
    """Student's factor times the standard deviation over the first axis."""
    count = len(parts)
    return scipy.stats.t.ppf((1 + confidence) / 2, count - 1) * np.std(parts, axis=0, ddof=1)

"""Which error drives a metric: rank correlations, and the shares of the variance that groups of elements carry.

A rank correlation suits one scalar error. The 80 radial errors of the pins each have a small one; what matters is the
variance that they carry together, which is the share of their group.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

Real = NDArray[np.float64]

BLOCKS = 20
"""Blocks of independent samples in the jackknife: enough for Student's t, few enough to solve for each."""
FEWEST_SAMPLES = 10
"""Fewer samples give no interval of a rank correlation: the normal approximation of Fisher's z is too sure of them."""
RANK_TOLERANCE = 1e-9
"""Variance of a principal component, in units of an element's own, below which it is round-off."""
REMAINDER = "remainder"
"""Name of the share that no group carries linearly: curvature, interactions, numerical noise."""


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
    whole = _spearman(columns, metrics)
    z, n = _fisher(whole), len(metrics)
    if replicate is None:
        few = n < FEWEST_SAMPLES
        deviation = np.full_like(whole, np.nan) if few else np.sqrt((1 + whole**2 / 2) / (n - 3))
        half = stats.norm.ppf((1 + confidence) / 2) * deviation
    else:
        parts = [_fisher(_spearman(columns[replicate == r], metrics[replicate == r])) for r in np.unique(replicate)]
        half = _student(np.stack(parts), confidence) / np.sqrt(len(parts))
    return Indices(tuple(parameters), whole, np.tanh(z - half), np.tanh(z + half))


def variance_shares(
    groups: Mapping[str, Real],
    metrics: Real,
    confidence: float,
    replicate: NDArray[np.integer] | None = None,
) -> Indices:
    """Share of each metric's variance that each group of element errors carries linearly.

    Parameters
    ----------
    groups : (n_samples, n_elements) each, by name; independent between groups, of any correlation within one. Elements
        that do not vary are left out.
    metrics : (n_samples, n_metrics).
    confidence, replicate : as in `rank_correlation`.

    Returns
    -------
    Indices of the groups and of `REMAINDER`, the variance that no group carries linearly. All NaN with fewer than two
    samples per element, or where nothing varies.

    Notes
    -----
    One regression on all elements, y = b0 + sum_g X_g b_g. The share b_g' cov(X_g) b_g / var(y) is too large by what
    the regression fits to noise, on average s^2 tr(G_gg (G^-1)_gg)/(n - 1) with the residual variance s^2 and the
    elements' Gram matrix G; it is taken off, so that the share of an idle group may fall below 0. The interval is a
    jackknife over blocks of samples, or over replicates: Gram matrices are sums, and leaving out a block is a
    subtraction. Elements that depend on each other (a ring that is oval and nothing else) count with their rank.
    """
    names = (*groups, REMAINDER)
    n = len(metrics)
    block = np.arange(n) * BLOCKS // n if replicate is None else replicate
    grams, spans = _without_dependence(_gram_matrices([*groups.values(), metrics], block), list(groups.values()))
    if not 0 < 2 * spans[-1].stop < n - 2:
        unknown = np.full((len(names), metrics.shape[1]), np.nan)
        return Indices(names, unknown, unknown, unknown)
    total = grams.sum(axis=0)
    whole = _shares(total, spans)
    left_out = np.stack([_shares(total - gram, spans) for gram in grams])
    half = _student(left_out, confidence) * (len(grams) - 1) / np.sqrt(len(grams))
    return Indices(names, whole, whole - half, whole + half)


def _gram_matrices(columns: list[Real], block: NDArray[np.integer]) -> Real:
    """Gram matrix of (1, columns) for the samples of each block, (n_blocks, 1 + n_columns, 1 + n_columns).

    The columns are standardised first: deviations are small against allowances, and their squares would be lost.
    """
    centre = np.concatenate([group.mean(axis=0) for group in columns])
    # Round-off leaves a constant a spread of its own, by which it must not be divided.
    scale = np.concatenate([np.where(np.ptp(group, axis=0) > 0, group.std(axis=0), np.inf) for group in columns])
    grams = []
    for b in np.unique(block):
        mine = block == b
        data = (np.concatenate([group[mine] for group in columns], axis=1) - centre) / scale
        data = np.column_stack([np.ones(len(data)), data])
        grams.append(data.T @ data)
    return np.stack(grams)


def _without_dependence(grams: Real, groups: list[Real]) -> tuple[Real, list[slice]]:
    """The Gram matrices in each group's principal components, and the place of each group among them.

    A group's share is the same in any basis. Elements that do not vary, or follow from others of their group, have no
    component of their own, so that the matrix of all components can be factorised.
    """
    total = grams.sum(axis=0)
    bases, spans, first, start = [np.eye(1)], [], 1, 0
    for group in groups:
        size = group.shape[1]
        spread, directions = linalg.eigh(total[first : first + size, first : first + size])
        basis = directions[:, spread > RANK_TOLERANCE * total[0, 0]]
        bases.append(basis)
        spans.append(slice(start, start + basis.shape[1]))
        first, start = first + size, start + basis.shape[1]
    change = linalg.block_diag(*bases, np.eye(grams.shape[1] - first))
    return change.T @ grams @ change, spans


def _shares(gram: Real, spans: list[slice]) -> Real:
    """Shares (n_groups + 1, n_metrics) from the Gram matrix of (1, elements, metrics)."""
    n = gram[0, 0]
    scatter = gram[1:, 1:] - np.outer(gram[1:, 0], gram[0, 1:]) / n
    k = spans[-1].stop
    of_elements, cross, of_metrics = scatter[:k, :k], scatter[:k, k:], np.diagonal(scatter)[k:]
    factor = linalg.cho_factor(of_elements)
    slopes, inverse = linalg.cho_solve(factor, cross), linalg.cho_solve(factor, np.eye(k))
    residual = (of_metrics - np.sum(slopes * cross, axis=0)) / (n - k - 1)
    carried = []
    for span in spans:
        part = of_elements[span, span]
        fitted_noise = residual * np.sum(part * inverse[span, span])
        carried.append(np.sum(slopes[span] * (part @ slopes[span]), axis=0) - fitted_noise)
    with np.errstate(invalid="ignore"):  # a metric that does not vary has no shares
        return np.vstack([*carried, residual * (n - 1)]) / of_metrics


def _spearman(columns: Real, metrics: Real) -> Real:
    """Rank correlations (n_columns, n_metrics)."""
    ranks = [stats.rankdata(values, axis=0) for values in (columns, metrics)]
    centred = [rank - rank.mean(axis=0) for rank in ranks]
    with np.errstate(invalid="ignore", divide="ignore"):  # a column that does not vary has no correlation
        unit = [rank / np.linalg.norm(rank, axis=0) for rank in centred]
    return np.clip(unit[0].T @ unit[1], -1.0, 1.0)


def _fisher(correlation: Real) -> Real:
    # A perfect correlation has an infinite z; the last digit of 1 stands for it.
    return np.arctanh(np.clip(correlation, -1 + 1e-15, 1 - 1e-15))


def _student(parts: Real, confidence: float) -> Real:
    """Student's factor times the standard deviation over the first axis."""
    count = len(parts)
    return stats.t.ppf((1 + confidence) / 2, count - 1) * np.std(parts, axis=0, ddof=1)

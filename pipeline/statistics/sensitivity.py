"""Shares of a metric's variance that groups of errors cause, alone and together with others, from a pick-freeze design.

A group holds errors of any correlation among themselves (all pins' radial errors, an ovality's amplitude and phase);
errors of different groups are independent. Nothing is assumed of the metric: it may be curved, even, or discontinuous.

Which error drives a metric, and in which sense: rank correlations of errors that are one number per unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real, Truth
from pipeline.config.studies.study import FEWEST_BASE_SAMPLES
from pipeline.statistics.resampling import resampled_means

FIRST_ORDER, TOTAL = "first_order", "total"
"""Names of the two kinds of index in tables."""
SUM = "sum"
"""Name of the sum of all groups' indices in tables."""
RESAMPLES = 1000
"""Bootstrap resamples: the 2.5 % quantile rests on 25 of them."""
SEED = 20100317
"""Of the resamples, so that a run repeats itself."""


@dataclass(frozen=True)
class Shares:
    """Shares of the variance with their confidence intervals [-], one per group.

    A share that is not determined is NaN. An estimate may lie below 0 or above 1 by its error.
    """

    value: Real
    ci_low: Real
    ci_high: Real


@dataclass(frozen=True)
class VarianceIndices:
    """Variance-based indices of one metric.

    Attributes
    ----------
    first_order : (n_groups + 1,) what a group causes by itself, var(E[y | group]) / var(y); last, their sum, which
        falls short of 1 by what groups cause only together (interactions).
    total : (n_groups + 1,) what vanishes with the group, E[var(y | all others)] / var(y), interactions included; last,
        their sum, which exceeds 1 where groups interact.
    n : base samples that they rest on: those of which every unit has the metric.
    """

    first_order: Shares
    total: Shares
    n: int


def are_determined(index: Real, ci_low: Real, ci_high: Real) -> Truth:
    """Whether indices of any kind say something: their intervals are narrower than they are large."""
    return ci_high - ci_low < np.abs(index)  # an unknown index compares as false


def variance_indices(base: Real, second_base: Real, mixed_bases: Real, confidence: float) -> VarianceIndices:
    """First-order and total indices of every group on one metric.

    Parameters
    ----------
    base, second_base : (n_rows,) the metric of two independent sets of units; NaN where a unit has none.
    mixed_bases : (n_groups, n_rows) the metric of the units of ``base`` with one group's errors of ``second_base``.
    confidence : level of the intervals, in (0, 1).

    Returns
    -------
    VarianceIndices; NaN with fewer than 30 complete rows, or where the metric does not vary.

    Notes
    -----
    First order: mean(f_B (f_ABg - f_A)) / V with f centred, which takes most of the noise from small indices. Total:
    mean((f_A - f_ABg)^2) / 2V. V is the variance of both sets together. The intervals are percentiles of a bootstrap
    that draws whole rows, so that the indices of a resample belong together and their sum has an interval too.

    Source
    ------
    Saltelli, Annoni, Azzini, Campolongo, Ratto, Tarantola, Variance based sensitivity analysis of model output,
    Comput. Phys. Commun. 181 (2010) 259, table 2 (b) and (f); the total index is Jansen's, ibid. 117 (1999) 35.
    """
    rows = np.column_stack([base, second_base, mixed_bases.T])
    rows = rows[np.all(np.isfinite(rows), axis=1)]
    groups = len(mixed_bases)
    if len(rows) < FEWEST_BASE_SAMPLES or np.ptp(rows[:, :2]) == 0:
        return _unknown_indices(groups, len(rows))
    moments = _moments(_standardised_rows(rows))
    indices = _indices(moments.mean(axis=0), groups)
    resampled_indices = _indices(resampled_means(moments, RESAMPLES, SEED), groups)
    return _with_intervals(indices, resampled_indices, confidence, len(rows))


def two_fidelity_indices(low: Real, high: Real, confidence: float) -> VarianceIndices:
    """First-order and total indices of a metric that is expensive, with the help of a cheap one that follows it.

    Parameters
    ----------
    low : (2 + n_groups, n_rows) the cheap metric of the base set, the second base set, and the mixed units.
    high : (2 + n_groups, n_rows) the expensive one, missing but for rows that were chosen at random.
    confidence : level of the intervals, in (0, 1).

    Returns
    -------
    VarianceIndices of the expensive metric; ``n`` counts the rows that have it. NaN with fewer than 30 of these, or
    where it does not vary.

    Notes
    -----
    The means of the moments of `variance_indices` are those of the expensive metric, plus a coefficient times what the
    cheap one differs by between the other rows and these (control variate). The rows with both are halved, and the
    coefficient of each half comes from the other one, so that the means have no bias however bad the cheap metric is; a
    metric that it does not follow has a coefficient near 0. The bootstrap draws rows within the halves and the rest.

    Source
    ------
    Qian, Peherstorfer, O'Malley, Vesselinov, Willcox, Multifidelity Monte Carlo estimation of variance and sensitivity
    indices, SIAM/ASA J. Uncertainty Quantification 6 (2018) 683.
    """
    groups, complete = len(low) - 2, np.all(np.isfinite(low), axis=0)
    has_both = complete & np.all(np.isfinite(high), axis=0)
    if np.count_nonzero(has_both) < FEWEST_BASE_SAMPLES or np.ptp(high[:2, has_both]) == 0:
        return _unknown_indices(groups, int(np.count_nonzero(has_both)))
    of_high = _moments(_standardised_rows(high[:, has_both].T))
    of_low = _moments(_standardised_rows(low[:, complete].T))
    low_pairs, low_rest = of_low[has_both[complete]], of_low[~has_both[complete]]
    halves = np.arange(len(low_pairs)) % 2
    means, resampled_moments = np.zeros(of_high.shape[1:]), np.zeros((RESAMPLES, *of_high.shape[1:]))
    for half in range(2):
        in_half, in_other_half = halves == half, halves != half
        coefficient = _control_coefficient(of_high[in_other_half], low_pairs[in_other_half], len(low_rest))
        difference, share = of_high[in_half] - coefficient * low_pairs[in_half], np.mean(in_half)
        means = means + share * difference.mean(axis=0)
        resampled_moments = resampled_moments + share * resampled_means(difference, RESAMPLES, SEED + half)
        if len(low_rest):
            means = means + share * coefficient * low_rest.mean(axis=0)
            resampled_moments = resampled_moments + share * coefficient * resampled_means(low_rest, RESAMPLES, SEED + 2)
    return _with_intervals(_indices(means, groups), _indices(resampled_moments, groups), confidence, len(low_pairs))


def _control_coefficient(high: Real, low: Real, n_rest: int) -> Real:
    """Coefficient (n_moments,) of the cheap moments with the least variance, 0 of constant ones or without others."""
    spread = low - low.mean(axis=0)
    square = np.sum(spread**2, axis=0)
    slope: Real = np.divide(np.sum(spread * high, axis=0), square, out=np.zeros_like(square), where=square > 0)
    return slope * n_rest / (n_rest + 2 * len(low))


def _standardised_rows(rows: Real) -> Real:
    """Rows (n_rows, 2 + n_groups) less the mean of their base sets, over the standard deviation."""
    spread: float = rows[:, :2].std()
    standardised: Real = (rows - rows[:, :2].mean()) / (spread if spread > 0 else 1.0)
    return standardised


def _unknown_indices(groups: int, n: int) -> VarianceIndices:
    missing_shares = Shares(*np.full((3, groups + 1), np.nan))
    return VarianceIndices(missing_shares, missing_shares, n)


def _with_intervals(indices: Real, resampled_indices: Real, confidence: float, n: int) -> VarianceIndices:
    """Indices (2, n_groups + 1) with percentiles of resampled ones (2, n_resamples, n_groups + 1)."""
    tail = (1 - confidence) / 2
    low, high = np.quantile(resampled_indices, [tail, 1 - tail], axis=-2)
    first_order, total = (Shares(indices[i], low[i], high[i]) for i in range(2))
    return VarianceIndices(first_order, total, n)


def _moments(rows: Real) -> Real:
    """What each row adds to the estimators (n_rows, 2 + 2 n_groups): f and f^2 of the base sets, then both products."""
    base, second_base, mixed_bases = rows[:, :1], rows[:, 1:2], rows[:, 2:]
    base_pair = rows[:, :2]
    return np.hstack(
        [
            base_pair.mean(axis=1, keepdims=True),
            (base_pair**2).mean(axis=1, keepdims=True),
            second_base * (mixed_bases - base),
            (base - mixed_bases) ** 2 / 2,
        ]
    )


def _indices(means: Real, groups: int) -> Real:
    """Both indices and their sums (2, ..., n_groups + 1) from means of the moments (..., 2 + 2 n_groups)."""
    variance = means[..., 1:2] - means[..., :1] ** 2
    shares = np.stack([means[..., 2 : 2 + groups], means[..., 2 + groups :]]) / variance
    return np.concatenate([shares, shares.sum(axis=-1, keepdims=True)], axis=-1)


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
    parameters: Mapping[str, Real], metrics: Real, confidence: float, replicate: NDArray[np.integer] | None = None
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
    Independent samples: Fisher's z with the larger of two errors. (1 + r^2/2)/(n - 3) keeps its level up to |r| = 0.95
    where the metric rises or falls; the variance of the influence function also where it is even in the parameter, or
    scatters with it (86 % of intervals held the truth for |x|, 95 % with it). Replicates: Student's t over the
    replicates' own z.

    Source
    ------
    Bonett and Wright, Sample size requirements for estimating Pearson, Kendall and Spearman correlations, Psychometrika
    65 (2000) 23; Borkowf, Computing the nonnull asymptotic variance and the asymptotic relative efficiency of
    Spearman's rank correlation, Comput. Stat. Data Anal. 39 (2002) 271.
    """
    columns = np.column_stack(list(parameters.values()))
    correlation = _spearman(columns, metrics)
    z, n = _fisher(correlation), len(metrics)
    if replicate is None:
        too_few = n < FEWEST_SAMPLES
        deviation = np.full_like(correlation, np.nan) if too_few else np.sqrt((1 + correlation**2 / 2) / (n - 3))
        deviation = np.maximum(deviation, _influence_error(columns, metrics) / np.maximum(1 - correlation**2, 1e-15))
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
    correlation: Real = np.clip(unit[0].T @ unit[1], -1.0, 1.0)
    return correlation


def _influence_error(columns: Real, metrics: Real) -> Real:
    """Standard error (n_columns, n_metrics) of rank correlations by the spread of their influence function.

    With u and v the ranks over n less a half, the influence of a sample is 12 (u v + the means of v over the samples
    with a larger u, and of u over those with a larger v).
    """
    n = len(metrics)
    u, v = ((scipy.stats.rankdata(values, axis=0) - 0.5) / n - 0.5 for values in (columns, metrics))
    error = np.empty((u.shape[1], v.shape[1]))
    for k, of_column in enumerate(u.T):
        above_column = _sums_above(of_column, v) / n
        for m, of_metric in enumerate(v.T):
            above_metric = _sums_above(of_metric, of_column[:, None])[:, 0] / n
            influence = 12 * (of_column * of_metric + above_column[:, m] + above_metric)
            error[k, m] = np.std(influence, ddof=1) / np.sqrt(n)
    return error


def _sums_above(key: Real, values: Real) -> Real:
    """Sums (n, n_values) of values (n, n_values) over the samples with a larger key (n,); equal keys count half."""
    _, group = np.unique(key, return_inverse=True)
    of_group = np.zeros((int(group.max()) + 1, values.shape[1]))
    np.add.at(of_group, group, values)
    from_group = np.cumsum(of_group[::-1], axis=0)[::-1]
    sums: Real = (from_group - 0.5 * of_group)[group]
    return sums


def _fisher(correlation: Real) -> Real:
    # A perfect correlation has an infinite z; the last digit of 1 stands for it.
    return np.arctanh(np.clip(correlation, -1 + 1e-15, 1 - 1e-15))


def _student(parts: Real, confidence: float) -> Real:
    """Student's factor times the standard deviation over the first axis."""
    count = len(parts)
    half_width: Real = scipy.stats.t.ppf((1 + confidence) / 2, count - 1) * np.std(parts, axis=0, ddof=1)
    return half_width

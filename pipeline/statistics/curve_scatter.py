"""How much the curves of several groups differ beyond noise: a random effect and its size.

Each group has a smooth curve of its own about one that all share. Nothing is assumed of the shared curve: every state
has its own mean. What is left are contrasts between groups, whose restricted likelihood gives the size of the scatter
and its interval. Source: Patterson and Thompson, Biometrika 58 (1971) 545; the interval by the profile likelihood.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, qr
from scipy.special import gammaincinv  # the quantile of chi-square: scipy.stats is slow to import

from pipeline.arrays import Real, Whole

BINS = 12
"""Intervals of the range of the abscissa, of each branch, over which values are averaged."""
REACHES = np.geomspace(0.1, 2.0, 8)
"""Distances over which a group's curve is alike, in largest abscissas."""
SIZES = np.geomspace(0.02, 2e3, 40)
"""Sizes of the departures at which a correlation is judged, in standard deviations of a mean's noise."""
RANK_TOLERANCE = 1e-9
"""Share of the largest singular value below which a column says nothing new."""
CONFIDENCE = 0.95
"""Of the interval of the size."""


@dataclass(frozen=True)
class CurveScatter:
    """Scatter of curves between groups.

    Attributes
    ----------
    size, ci_low, ci_high : root mean square by which a group's curve departs from the shared one, its mean removed
        where each group has its own zero; with its 95 % interval, in the unit of the values.
    groups : their number.
    """

    size: float
    ci_low: float
    ci_high: float
    groups: int

    @property
    def significant_size(self) -> float:
        """The size where its interval excludes zero, else 0."""
        return self.size if self.ci_low > 0.0 else 0.0


@dataclass(frozen=True)
class _Means:
    """Means of the values of one group, branch and interval of the abscissa, each (n,); of states that groups share."""

    abscissa: Real
    branch: Whole
    state: Whole
    group: Whole
    value: Real
    noise: Real


def curve_scatter(
    abscissa: Real, branch: Whole, group: Whole, values: Real, sigma: Real, own_zero: bool = True, bins: int = BINS
) -> CurveScatter | None:
    """The scatter of values (n,) between groups; None where no state of two groups can be compared.

    Parameters
    ----------
    abscissa, branch, group : (n,) where each value belongs; values of one branch and like abscissa are compared.
    sigma : (n,) standard deviations of the values' noise; taken larger where values of one state scatter by more.
    own_zero : whether each group has a zero of its own, which then says nothing.

    Notes
    -----
    The likelihood is that of contrasts of the whitened means which no shared curve and no zero reaches; in the axes of
    each correlation it is a sum, so that all sizes are evaluated at once.
    """
    means = _group_means(abscissa, branch, group, values, sigma, bins)
    if not means.group.size:
        return None
    columns = [dummies(means.state), *([dummies(means.group)] if own_zero else [])]
    decomposition = np.linalg.svd(np.hstack(columns), full_matrices=False)
    basis = decomposition[0][:, decomposition[1] > RANK_TOLERANCE * decomposition[1].max()]
    if len(basis) == basis.shape[1]:
        return None
    freedom = len(basis) - len(np.unique(means.state))
    contrast = np.eye(len(basis)) - basis @ basis.T
    contrasts, noise = contrast @ means.value, contrast * means.noise**2
    square, of_noise = float(contrasts @ contrasts), float(np.trace(noise))
    correlation = _likeliest(means, basis, float(np.max(np.abs(abscissa))))
    departure = contrast @ correlation @ contrast
    departure *= freedom / np.trace(departure)  # of unit mean square about the mean of the groups
    size = max(square - of_noise, 0.0) / freedom
    total = size * departure + noise @ contrast
    independent = np.trace(total) ** 2 / np.sum(total**2)
    ends = square * independent / (2 * gammaincinv(0.5 * independent, [0.5 * (1 + CONFIDENCE), 0.5 * (1 - CONFIDENCE)]))
    low, high = np.sqrt(np.maximum(ends - of_noise, 0.0) / freedom).tolist()
    return CurveScatter(float(np.sqrt(size)), low, high, len(np.unique(means.group)))


def _likeliest(means: _Means, basis: Real, top: float) -> Real:
    """The correlation (n, n) of the departures, at whichever size, of the largest restricted likelihood."""
    complement = qr(basis / means.noise[:, None])[0][:, basis.shape[1] :]
    goal, unit = complement.T @ (means.value / means.noise), float(np.median(means.noise))
    likeliest: tuple[float, Real] = (-np.inf, np.eye(len(means.value)))
    for correlation in _correlations(means, top):
        spread, axes = eigh(complement.T @ (correlation / np.outer(means.noise, means.noise)) @ complement)
        variance = 1 + (unit * SIZES[:, None]) ** 2 * np.maximum(spread, 0.0)
        likelihood = float(np.max(-0.5 * np.sum(np.log(variance) + (axes.T @ goal) ** 2 / variance, axis=1)))
        if likelihood > likeliest[0]:
            likeliest = likelihood, correlation
    return likeliest[1]


def _group_means(abscissa: Real, branch: Whole, group: Whole, values: Real, sigma: Real, bins: int) -> _Means:
    """The values averaged, their noise no less than what they scatter by within a state."""
    edges = np.linspace(abscissa.min(), abscissa.max(), bins + 1)
    interval = np.clip(np.searchsorted(edges, abscissa, side="right") - 1, 0, bins - 1)
    places = np.column_stack([branch, interval, group])
    states, state = np.unique(places[:, :2], axis=0, return_inverse=True)
    pairs, pair = np.unique(np.column_stack([state.ravel(), group]), axis=0, return_inverse=True)
    pair, weight = pair.ravel(), 1 / sigma**2
    total = np.bincount(pair, weight)
    mean, middle = (np.bincount(pair, weight * column) / total for column in (values, abscissa))
    dx, dy = abscissa - middle[pair], values - mean[pair]
    slope = np.bincount(pair, weight * dx * dy) / np.maximum(np.bincount(pair, weight * dx**2), 1e-300)
    scatter = float(np.sum(weight * (dy - slope[pair] * dx) ** 2)) / max(len(values) - 2 * len(pairs), 1)
    has_partner = np.bincount(pairs[:, 0])[pairs[:, 0]] > 1
    state_of, group_of = pairs[has_partner].T
    noise = np.sqrt(max(scatter, 1.0) / total[has_partner])
    return _Means(middle[has_partner], states[state_of, 0], state_of, group_of, mean[has_partner], noise)


def _correlations(means: _Means, top: float) -> Iterator[Real]:
    """Correlations (n, n) of departures: of every branch by itself, then alike on all, for every reach."""
    same_group = (means.group[:, None] == means.group).astype(float)
    distance = means.abscissa[:, None] - means.abscissa
    for reach in top * REACHES:
        correlation = same_group * np.exp(-0.5 * (distance / reach) ** 2)
        yield correlation * (means.branch[:, None] == means.branch)
        yield correlation


def dummies(label: Whole) -> Real:
    """One column for each label (n, n_labels), 1 in its rows."""
    return np.equal.outer(label, np.unique(label)).astype(float)

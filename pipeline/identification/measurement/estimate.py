"""Root mean squares with the interval of a block bootstrap."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.measurement.scatter import MAD_TO_STD
from pipeline.statistics.resampling import resampled_counts, resampled_means

RESAMPLES = 1000
"""Of the block bootstrap of the noise."""
SEED = 79
"""Of the bootstrap: equal data give an equal page."""


@dataclass(frozen=True)
class NoiseEstimate:
    """An rms [arcmin] with the 95 % interval of a block bootstrap; NaN where nothing determines it.

    `n` is the number of differences, `blocks` the number of independent pairs of branches that they come from.
    """

    value: float
    ci_low: float
    ci_high: float
    n: int
    blocks: int


UNKNOWN_NOISE = NoiseEstimate(np.nan, np.nan, np.nan, 0, 0)
"""Where nothing determines it."""


def scaled_estimate(estimate: NoiseEstimate, factor: float) -> NoiseEstimate:
    """The estimate times a factor, with its interval."""
    return replace(
        estimate,
        value=factor * estimate.value,
        ci_low=factor * estimate.ci_low,
        ci_high=factor * estimate.ci_high,
    )


def rms(groups: list[Real], divisor: float) -> NoiseEstimate:
    """Root mean square over `divisor`, bootstrapped over groups."""
    squares = np.array([np.sum(values**2) for values in groups])
    return pooled_noise(squares, np.array([float(values.size) for values in groups]), divisor)


def pooled_noise(squares: Real, counts: Real, divisor: float) -> NoiseEstimate:
    """Root of the sum of `squares` over that of `counts`, over `divisor`, bootstrapped over the groups."""
    if not counts.sum():
        return UNKNOWN_NOISE
    resamples = resampled_means(np.column_stack([squares, counts]), RESAMPLES, SEED)
    value = float(np.sqrt(squares.sum() / counts.sum()) / divisor)
    return _interval(value, np.sqrt(resamples[:, 0] / resamples[:, 1]) / divisor, round(counts.sum()), len(squares))


def robust(groups: list[Real]) -> NoiseEstimate:
    """Standard deviation by the median absolute value, bootstrapped over groups."""
    if not groups:
        return UNKNOWN_NOISE
    sizes = np.abs(np.concatenate(groups))
    order = np.argsort(sizes)
    group = np.repeat(np.arange(len(groups)), [values.size for values in groups])
    rank_sum = np.cumsum(resampled_counts(len(groups), RESAMPLES, SEED)[:, group[order]], axis=1)
    medians = sizes[order][np.argmax(2 * rank_sum >= rank_sum[:, -1:], axis=1)]
    return _interval(float(MAD_TO_STD * np.median(sizes)), MAD_TO_STD * medians, sizes.size, len(groups))


def _interval(value: float, resampled_values: Real, n: int, blocks: int) -> NoiseEstimate:
    """95 % percentile interval; none from a single block, which says nothing about the spread between blocks."""
    if blocks < 2:
        return NoiseEstimate(value, np.nan, np.nan, n, blocks)
    low, high = np.quantile(resampled_values, [0.025, 0.975])
    return NoiseEstimate(value, float(low), float(high), n, blocks)

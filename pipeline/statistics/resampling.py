"""Block bootstrap and jackknife, for data that are not independent."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.arrays import Real


@lru_cache(maxsize=16)
def resampled_counts(n_blocks: int, resamples: int, seed: int) -> NDArray[np.int64]:
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
        Resampling-Based Multiple Testing (1993), single step).
    """
    n = len(gains)
    mean, spread = gains.mean(axis=0), gains.std(axis=0, ddof=1) / np.sqrt(n)
    scale = np.where(spread > 0, spread, np.inf)
    t = mean / scale
    resampled_gains = resampled_means(gains - mean, resamples, seed) / scale
    largest_t = resampled_gains.max(axis=1)
    p = (1 + np.sum(largest_t[:, None] >= t, axis=0)) / (resamples + 1)
    return t, p


def confidence_set(losses: Real, level: float, resamples: int, seed: int) -> NDArray[np.bool_]:
    """Models (n_models,) that hold the best one with confidence ``level``.

    Source
    ------
    Model confidence set with the range statistic of the worst, Hansen, Lunde, Nason, Econometrica 79 (2011) 453.

    Parameters
    ----------
    losses : (n_blocks, n_models)
    """
    members = np.ones(losses.shape[1], bool)
    resampled_gains = resampled_means(losses, resamples, seed)
    while members.sum() > 1:
        member_losses = losses[:, members]
        relative = member_losses.mean(axis=0) - member_losses.mean()
        noise = resampled_gains[:, members] - resampled_gains[:, members].mean(axis=1, keepdims=True) - relative
        spread = np.sqrt(np.mean(noise**2, axis=0))
        if np.all(spread <= 0):
            break
        scale = np.where(spread > 0, spread, np.inf)
        worst_t = np.max(relative / scale)
        if np.mean(np.max(noise / scale, axis=1) >= worst_t) >= 1 - level:
            break
        members[np.flatnonzero(members)[np.argmax(relative / scale)]] = False
    return members


CONFIDENCE = 0.95
"""Of intervals and tests."""


def jackknife_interval(value: float, left_out: Sequence[float]) -> tuple[float, float]:
    """Interval of a value by the values without each group; NaN without any.

    Of logarithms where all values are positive and clear of zero; of a positive number that is not, it begins at zero.

    Source
    ------
    Efron and Tibshirani, An Introduction to the Bootstrap (1993), chapter 11.
    """
    if len(left_out) < 2:
        return float("nan"), float("nan")
    reach = _reach(np.array(left_out))
    if min(value, *left_out) <= 0:
        return value - reach, value + reach
    if reach >= value:
        return 0.0, value + reach
    factor = float(np.exp(_reach(np.log(left_out))))
    return value / factor, value * factor


def _reach(values: NDArray[np.float64]) -> float:
    """Half of the interval by values (n,) of fits that leave out a group each."""
    n = len(values)
    error = np.sqrt((n - 1) / n * np.sum((values - np.mean(values)) ** 2))
    return float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * error)

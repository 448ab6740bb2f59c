"""Confidence intervals of estimates from the same estimates without each group of data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

CONFIDENCE = 0.95
"""Of the intervals."""


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

"""Deviations from uniform random numbers: inverse distribution functions, and correlation along a circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.special import ndtr, ndtri

from pipeline.config.tolerances import Fixed, Normal, Triangular, Uniform

Real = NDArray[np.float64]

SMALLEST_PROBABILITY = 2.0**-54
"""A generator may return 0, whose normal quantile is infinite; half of the smallest step stands for it."""


def deviation(tolerance: Fixed | Normal | Uniform | Triangular, probability: Real) -> Real:
    """Deviation within its limits whose distribution function is `probability`.

    Parameters
    ----------
    tolerance : distribution and limits; its allowance is not added.
    probability : any shape, in [0, 1].

    Returns
    -------
    Same shape [um].
    """
    lower, upper = tolerance.limits_um
    match tolerance:
        case Fixed():
            return np.full_like(probability, tolerance.value_um)
        case Normal():
            return np.clip(_truncated_normal(tolerance, probability), lower, upper)
        case Uniform():
            return lower + (upper - lower) * probability
        case Triangular():
            return _triangular(lower, tolerance.peak_um, upper, probability)


def _truncated_normal(tolerance: Normal, probability: Real) -> Real:
    location, scale = tolerance.location_um, tolerance.scale_um
    if scale == 0:
        return np.full_like(probability, location)
    below, above = ndtr((np.array(tolerance.limits_um) - location) / scale)
    return location + scale * ndtri(below + (above - below) * probability)


def _triangular(lower: float, peak: float, upper: float, probability: Real) -> Real:
    width = upper - lower
    rising = lower + np.sqrt(width * (peak - lower) * probability)
    falling = upper - np.sqrt(width * (upper - peak) * (1 - probability))
    return np.where(probability * width < peak - lower, rising, falling)


def correlated(probability: Real, circumference: float, length: float) -> Real:
    """Uniform numbers of equally spaced elements on a circle, correlated like a machining drift.

    Parameters
    ----------
    probability : (n_samples, n_elements) independent, in [0, 1].
    circumference : of the circle [mm].
    length : arc over which the correlation falls to 1/e [mm].

    Returns
    -------
    (n_samples, n_elements) in [0, 1], each uniform by itself.

    Notes
    -----
    Gaussian copula: normal scores with the correlation exp(-arc/length). On equally spaced elements its matrix is
    circulant, so that its symmetric square root is a filter of the discrete Fourier transform, exact for any length.
    """
    n = probability.shape[1]
    index = np.arange(n)
    arc = circumference / n * np.minimum(index, n - index)
    # Positive in theory; for lengths far beyond the circumference round-off may leave -1e-16.
    spectrum = np.maximum(rfft(np.exp(-arc / length)).real, 0.0)
    scores = ndtri(np.clip(probability, SMALLEST_PROBABILITY, 1 - 2 * SMALLEST_PROBABILITY))
    return ndtr(irfft(rfft(scores, axis=1) * np.sqrt(spectrum), n=n, axis=1))

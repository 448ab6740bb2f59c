"""Uniform random numbers correlated along a circle."""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, rfft
from scipy.special import ndtr, ndtri

from pipeline.arrays import Real

SMALLEST_PROBABILITY = 2.0**-54
"""A generator may return 0, whose normal quantile is infinite; half of the smallest step stands for it."""


def correlated_numbers(probability: Real, circumference: float, length: float) -> Real:
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

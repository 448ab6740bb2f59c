"""Designs of experiment: which uniform numbers belong to a draw, and how they are correlated along a circle."""

from copy import deepcopy
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.special import ndtr, ndtri

from pipeline.arrays import Real
from pipeline.config.studies.study import Samples

SMALLEST_PROBABILITY = 2.0**-54
"""A generator may return 0, whose normal quantile is infinite; half of the smallest step stands for it."""


def correlated_numbers(
    probability: Real, circumference: float, length: float | None, common_share: float = 0.0
) -> Real:
    """Uniform numbers of equally spaced elements on a circle, correlated like a machining drift or a batch.

    Parameters
    ----------
    probability : (n_samples, n_elements) independent, in [0, 1].
    circumference : of the circle [mm]; of no account without a length.
    length : arc over which the correlation falls to 1/e [mm], None where neighbours have nothing in common.
    common_share : of the variance of the normal scores, which all elements have in common beside the drift.

    Returns
    -------
    (n_samples, n_elements) in [0, 1], each uniform by itself.

    Notes
    -----
    Gaussian copula: normal scores with the correlation c + (1 - c) exp(-arc/length), c being the common share. On
    equally spaced elements its matrix is circulant, so that its symmetric square root is a filter of the discrete
    Fourier transform, exact for any length.
    """
    n = probability.shape[1]
    index = np.arange(n)
    arc = circumference / n * np.minimum(index, n - index)
    # Positive in theory; for lengths far beyond the circumference round-off may leave -1e-16.
    drift = np.exp(-arc / length) if length is not None else np.equal(index, 0)
    spectrum = np.maximum(rfft(common_share + (1 - common_share) * drift).real, 0.0)
    scores = ndtri(np.clip(probability, SMALLEST_PROBABILITY, 1 - 2 * SMALLEST_PROBABILITY))
    numbers: Real = ndtr(irfft(rfft(scores, axis=1) * np.sqrt(spectrum), n=n, axis=1))
    return numbers


BLOCK = 4
"""Numbers that Philox makes per step of its counter."""


def uniforms(samples: Samples, dimensions: int, start: int, stop: int) -> Real:
    """Uniform numbers of the draws [start, stop).

    Parameters
    ----------
    samples : experiment, seed, count and randomisations.
    dimensions : numbers per draw; draw k is the same only for the same dimensions.
    start, stop : first draw, and the one after the last; draw 0 is the first random one.

    Returns
    -------
    (stop - start, dimensions) in [0, 1).

    Raises
    ------
    ValueError : listed cases are not drawn.
    """
    match samples.experiment:
        case "monte_carlo":
            return independent_uniforms(samples.seed, dimensions, start, stop)
        case "sobol" | "latin_hypercube":
            return _interleaved_points(samples, dimensions, start, stop)
    raise ValueError(f"the experiment {samples.experiment!r} has no random numbers")


def replicates(samples: Samples, sample: NDArray[np.integer]) -> NDArray[np.integer] | None:
    """Independent randomisation to which each sample belongs; None where the samples themselves are independent.

    Parameters
    ----------
    samples : experiment and randomisations.
    sample : any shape, as numbered in the tables; the nominal sample is in no replicate and must be left out.

    Returns
    -------
    Same shape, 0 to randomisations - 1; or None.
    """
    return (sample - samples.nominal_first) % samples.randomisations if samples.has_replicates else None


def independent_uniforms(seed: int, dimensions: int, start: int, stop: int) -> Real:
    """Independent uniform numbers of the draws [start, stop), (stop - start, dimensions) in [0, 1)."""
    steps = -(-dimensions // BLOCK)
    stream = np.random.Philox(np.random.SeedSequence(seed))
    stream.advance(start * steps)
    numbers = np.random.Generator(stream).random((stop - start, steps * BLOCK))
    return numbers[:, :dimensions]


def _interleaved_points(samples: Samples, dimensions: int, start: int, stop: int) -> Real:
    """Draw k is point k // randomisations of the replicate k % randomisations."""
    draw = np.arange(start, stop)
    point, replicate = np.divmod(draw, samples.randomisations)
    numbers = np.empty((len(draw), dimensions))
    for r in np.unique(replicate):
        in_replicate = replicate == r
        first_point, last_point = int(point[in_replicate][0]), int(point[in_replicate][-1])
        if samples.experiment == "sobol":
            numbers[in_replicate] = _sobol(samples.seed, int(r), dimensions, first_point, last_point + 1)
        else:
            strata = samples.count // samples.randomisations
            numbers[in_replicate] = _hypercube(samples.seed, int(r), dimensions, strata)[first_point : last_point + 1]
    return numbers


def _generator(seed: int, replicate: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(replicate,)))


def _sobol(seed: int, replicate: int, dimensions: int, start: int, stop: int) -> Real:
    engine = deepcopy(_scrambled_sequence(seed, replicate, dimensions))
    if start > 0:
        engine.fast_forward(start)
    # SciPy warns of any other number than a power of two, for the sake of an error estimate that is not ours.
    numbers: Real = engine.random(1 << (stop - start - 1).bit_length())[: stop - start]
    return numbers


@lru_cache(maxsize=64)
def _scrambled_sequence(seed: int, replicate: int, dimensions: int) -> "scipy.stats.qmc.Sobol":
    """A Sobol' sequence at its first point; it moves on when it is drawn from, so only copies of it are."""
    return scipy.stats.qmc.Sobol(dimensions, scramble=True, rng=_generator(seed, replicate))


@lru_cache(maxsize=64)
def _hypercube(seed: int, replicate: int, dimensions: int, strata: int) -> Real:
    """One whole hypercube (strata, dimensions): no part of it can be had alone, so it is kept for the next chunk."""
    numbers: Real = scipy.stats.qmc.LatinHypercube(dimensions, rng=_generator(seed, replicate)).random(strata)
    numbers.flags.writeable = False
    return numbers

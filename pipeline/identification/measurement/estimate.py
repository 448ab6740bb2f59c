"""Noise: scatter between neighbouring rows, and root mean squares with the interval of a block bootstrap."""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.special import expit

from pipeline.arrays import Real
from pipeline.constant_kinds import Fineness, Rounding, Seed, Unit
from pipeline.identification.measurement.enough import SURE
from pipeline.identification.measurement.rows import Rows
from pipeline.identification.measurement.unit_sections import InstrumentSection
from pipeline.statistics.resampling import resampled_counts, resampled_means

MAD_TO_STD: Unit = 1.4826
"""Standard deviation over median absolute deviation of normal values."""
MIXTURE_STEPS: Fineness = 50
"""Steps in which noise and the steps of a staircase are told apart."""
STANDING_SHARE = 0.4
"""Of neighbouring rows that are at one torque on a staircase, at least: half of them, less what is left out."""
LEAST_SHARE: Rounding = 1e-9
"""Of differences that are noise or steps, and of their mean square that is noise: less is none."""
FEWEST_COUNTS: Fineness = 6
"""Different values of an instrument that counts, at least: fewer may be multiples of a step by chance."""
OFF_COUNT: Rounding = 0.02
"""Distance from a multiple of the step that a conversion between units leaves."""
RESAMPLES: Fineness = 1000
"""Of the block bootstrap of the noise."""
SEED: Seed = 79
"""Of the bootstrap: equal data give an equal page."""


def high_frequency_scatter(values: Real, runs: list[slice]) -> float:
    """Standard deviation of independent noise in a signal sampled along `runs` of rows, in its own unit.

    The smallest of the estimates, since what is no noise only enlarges each. Fourth differences (variance 70 s^2)
    remove a ramp that starts and ends gently; second differences (6 s^2) contain fewer corners and steps, most of which
    their median absolute value ignores; first differences (2 s^2) are noise where a staircase stands still, which are
    told from its steps by their sizes. Noise that is alike in neighbouring rows is not seen. NaN with fewer than three
    rows in a run.
    """
    estimates = [
        MAD_TO_STD * np.median(np.abs(differences)) / np.sqrt(comb(2 * order, order))
        for order in (1, 2, 4)
        if (differences := _differences(values, runs, order)).size
    ]
    if estimates:
        estimates.append(_scatter_beside_steps(_differences(values, runs, 1), smallest_step(values)) / np.sqrt(2))
    return float(min(estimates, default=np.nan))


def _scatter_beside_steps(differences: Real, resolution: float) -> float:
    """Standard deviation of the differences (n,) within steps of a staircase; infinite where there is none.

    The sizes of the differences are a mixture of two normal distributions: noise about zero, and steps about their
    height. Expectation and maximisation in turns: each size is shared between the two by their densities, and each
    distribution takes its moments from its shares.

    Source: Dempster, Laird and Rubin, J. R. Stat. Soc. B 39 (1977) 1.
    """
    sizes, height = np.abs(differences), np.sqrt(np.mean(differences**2))
    if height == 0:
        return np.inf
    least = max(resolution**2 / 6, LEAST_SHARE * height**2)  # a difference has two roundings, a twelfth each
    noise_square, step_square, share = max(np.quantile(sizes, 0.25) ** 2, least), max(height**2 / 4, least), 0.5
    for _ in range(MIXTURE_STEPS):
        log_ratio = 0.5 * (np.log(4 * step_square / noise_square) + (sizes - height) ** 2 / step_square)
        is_noise = expit(np.log(share / (1 - share)) + log_ratio - 0.5 * sizes**2 / noise_square)
        share = np.clip(np.mean(is_noise), LEAST_SHARE, 1 - LEAST_SHARE)
        noise_square = max(is_noise @ sizes**2 / is_noise.sum(), least)
        height = (1 - is_noise) @ sizes / (1 - is_noise).sum()
        step_square = max((1 - is_noise) @ (sizes - height) ** 2 / (1 - is_noise).sum(), least)
    is_staircase = share > STANDING_SHARE and height > SURE * np.sqrt(noise_square)
    return float(np.sqrt(noise_square)) if is_staircase else np.inf


def _differences(values: Real, runs: list[slice], order: int) -> Real:
    """Finite differences of an order along each run (n,)."""
    differences = np.concatenate([np.diff(values[run], order) for run in runs] or [np.empty(0)])
    return np.asarray(differences[np.isfinite(differences)])


def smallest_step(values: Real) -> float:
    """The smallest difference between two different values; 0 where all are equal."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    scale = np.nanmax(np.abs(values)) if steps.size else 0.0
    steps = steps[steps > 1e-9 * scale]  # a rounded decimal times a factor differs from itself in its last digits
    return float(steps.min()) if steps.size else 0.0


def counted_step(values: Real) -> float:
    """The step (the unit of the values) in which an instrument counts; 0 where values are no multiples of one."""
    places, step = np.unique(values[np.isfinite(values)]), smallest_step(values)
    if len(places) < FEWEST_COUNTS or step == 0:
        return 0.0
    counts = (places - places[0]) / step
    return step if np.max(np.abs(counts - np.round(counts))) < OFF_COUNT else 0.0


def torque_noise(rows: Rows, instrument: InstrumentSection, runs: list[slice] | None = None) -> float:
    """Standard deviation of the torque of a row [N m]: as declared, else its scatter; 0 if unknown.

    Parameters
    ----------
    runs : of rows whose scatter is taken, instead of all.
    """
    if instrument.torque_noise_Nm is not None:
        return instrument.torque_noise_Nm
    estimate = high_frequency_scatter(rows.torque, [run for *_, run in rows.runs()] if runs is None else runs)
    return estimate if np.isfinite(estimate) else 0.0


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
        estimate, value=factor * estimate.value, ci_low=factor * estimate.ci_low, ci_high=factor * estimate.ci_high
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

"""One measured dimension of a lot: distribution, correlation of neighbours, capability, drift and outliers.

Intervals of the moments and of the capability are over the parts: Student's of the parts' means, and the jackknife of
logarithms, which need no distribution. Source: Miller, Jackknifing variances, Ann. Math. Stat. 39 (1968) 567. That of
the correlation length is of a parametric bootstrap: lots of the same size are drawn from the fitted distribution with
its correlation. Source: Davison, Hinkley, Bootstrap Methods and their Application (1997), section 2.4.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension
from pipeline.config.distributions import Distribution, Spread
from pipeline.decisions.lots.fitted_distribution import FittedKind, fitted_kinds
from pipeline.decisions.lots.measured_lot import FEWEST_PARTS
from pipeline.sampling.designs import correlated_numbers
from pipeline.statistics.intervals import Estimate, mean_interval
from pipeline.statistics.resampling import jackknife_interval

REPLICATES = 399
"""Lots of the bootstrap: the ends of a 95 % interval are order statistics 10 and 390."""
LEVEL = 0.05
"""Level of the tests of drift and outliers over a dimension, and of the correlation."""
FEWEST_FOR_DRIFT = 8
"""Parts below which a drift over the order of production is not tested."""
LENGTHS_PER_DECADE = 24
"""Of trial correlation lengths; the best of them is refined."""
SMALLEST = 1e-9
"""Standard deviation [um] of equal values."""


@dataclass(frozen=True)
class Drift:
    """Change of a dimension over the order of production.

    Attributes
    ----------
    change_um : from the first to the last part [um], least squares, with Student's interval.
    p_value : Kendall's test of the parts' means against their order.
    """

    change_um: Estimate
    p_value: float


@dataclass(frozen=True)
class DimensionFit:
    """A measured dimension.

    Attributes
    ----------
    parts : labels of the parts that have it.
    values : (n_parts, n_elements) [um] of these parts.
    kinds : fitted distributions, the best first.
    tolerance : of a study of this lot: the best kind with the correlation of neighbours.
    mean, spread : mean and standard deviation [um] of the total deviation.
    correlation_mm : correlation length along the circle [mm]; None where elements lie on none or neighbours are
        independent by the test.
    cp, cpk : capability against the drawing's limits; None where the drawing has no such limits.
    drift : None for fewer than ``FEWEST_FOR_DRIFT`` parts.
    outliers : part and element of each value that lots of the best kind seldom hold. Skewed lots often have some.
    """

    dimension: Dimension
    parts: tuple[str, ...]
    values: Real
    kinds: tuple[FittedKind, ...]
    tolerance: Distribution
    mean: Estimate
    spread: Estimate
    correlation_mm: Estimate | None
    cp: Estimate | None
    cpk: Estimate | None
    drift: Drift | None
    outliers: tuple[tuple[int, int], ...]


def dimension_fit(
    dimension: Dimension,
    parts: Sequence[str],
    values: Real,
    drawing: Distribution,
    design: Design,
    confidence: float,
    seed: int,
) -> DimensionFit | None:
    """The fit of one dimension; None where too few parts have it or all are equal.

    Parameters
    ----------
    parts : label of each part.
    values : (n_parts, n_elements) [um], NaN where a part was not measured.
    drawing : tolerance of the study.
    confidence : level of the intervals.
    seed : of the bootstrap.
    """
    complete = np.all(np.isfinite(values), axis=1)
    parts, values = [label for label, is_known in zip(parts, complete, strict=True) if is_known], values[complete]
    flat = values.ravel()
    if len(flat) < FEWEST_PARTS or np.ptp(flat) == 0:
        return None
    kinds = fitted_kinds(flat, dimension, drawing)
    best_distribution, circle = kinds[0].distribution, _circumference(dimension, values, design)
    length = correlation_length(values, circle) if circle else None
    replicates = _replicates(best_distribution, values.shape, circle, length, np.random.default_rng(seed))
    mean, spread = _moments(values, confidence)
    of_length = None
    if length is not None and circle:
        trials = [correlation_length(lot, circle, with_test=False) or length for lot in replicates]
        ratios = np.quantile(np.array(trials) / length, _ends(confidence))
        of_length = Estimate(length, length / ratios[1], length / ratios[0], len(flat))
        best_distribution = best_distribution.model_copy(update={"correlation_length_mm": float(f"{length:.3g}")})
    cp, cpk = _capability(dimension, drawing, values, spread, confidence)
    return DimensionFit(
        dimension=dimension,
        parts=tuple(parts),
        values=values,
        kinds=tuple(kinds),
        tolerance=best_distribution,
        mean=mean,
        spread=spread,
        correlation_mm=of_length,
        cp=cp,
        cpk=cpk,
        drift=_drift(values.mean(axis=1), confidence),
        outliers=_outliers(values, replicates),
    )


def _circumference(dimension: Dimension, values: Real, design: Design) -> float | None:
    """Of the circle [mm] along which the measured elements were machined; None without one."""
    elements = dimension.elements
    if elements is None or elements.radius_mm is None or values.shape[1] < 3:
        return None
    return 2 * np.pi * elements.radius_mm(design)


def correlation_length(values: Real, circumference: float, with_test: bool = True) -> float | None:
    """Correlation length [mm] of neighbours on circles (n_circles, n_elements), by maximum likelihood.

    Parameters
    ----------
    with_test : whether None is returned where the likelihood ratio does not reject independence.

    Notes
    -----
    Normal scores of the ranks have the correlation exp(-arc/length), as the sampling has it; its circulant matrix is
    diagonal over the waves of the circle, so a trial length costs a sum. Independence is the limit of length zero, on
    the edge of its range: the likelihood ratio is zero half of the time and chi-square with one degree of freedom else.
    Source: Self, Liang, J. Am. Stat. Assoc. 82 (1987) 605.
    """
    n = values.shape[1]
    scores = scipy.special.ndtri((scipy.stats.rankdata(values).reshape(values.shape) - 0.5) / values.size)
    power = np.mean(np.abs(np.fft.fft(scores, axis=1)) ** 2, axis=0) / n
    arc = circumference / n * np.minimum(np.arange(n), n - np.arange(n))

    def cost(log_length: float) -> float:
        spectrum = np.maximum(np.fft.fft(np.exp(-arc / np.exp(log_length))).real, 1e-12)
        return float(np.sum(power / spectrum + np.log(spectrum))) * len(values)

    low, high = np.log(0.1 * circumference / n), np.log(circumference)
    trials = np.linspace(low, high, int(LENGTHS_PER_DECADE * (high - low) / np.log(10)) + 2)
    k = int(np.argmin([cost(trial) for trial in trials]))
    bracket = trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]
    optimum = scipy.optimize.minimize_scalar(cost, bounds=bracket, method="bounded")
    independent = float(np.sum(power)) * len(values)
    if with_test and independent - optimum.fun < scipy.stats.chi2.ppf(1 - 2 * LEVEL, 1):
        return None
    return float(np.exp(optimum.x))


def _replicates(
    distribution: Distribution,
    shape: tuple[int, ...],
    circumference: float | None,
    length: float | None,
    rng: np.random.Generator,
) -> list[Real]:
    """Lots of the shape of the measured one, drawn from the fit [um]."""
    lots = []
    for _ in range(REPLICATES):
        probability = rng.random(shape)
        if circumference and length:
            probability = correlated_numbers(probability, circumference, length)
        lots.append(distribution.allowance_um + distribution.deviation(probability))
    return lots


def _ends(confidence: float) -> Real:
    return np.array([(1 - confidence) / 2, (1 + confidence) / 2])


def independent_parts(values: Real) -> Real:
    """Rows of values that are independent of each other: the parts, or of a single part its elements."""
    return values if len(values) > 1 else values.T


def _moments(values: Real, confidence: float) -> tuple[Estimate, Estimate]:
    """Mean and standard deviation [um] of values (n_parts, n_elements), with intervals over the parts.

    Elements of one part are alike, so that the number of parts counts, not that of elements.
    """
    low, high = mean_interval(independent_parts(values).mean(axis=1), confidence)
    spread, (_, left_out) = float(np.std(values, ddof=1)), moments_without_each(values)
    ends = jackknife_interval(spread, left_out.tolist(), confidence)
    return Estimate(float(np.mean(values)), low, high, values.size), Estimate(spread, *ends, values.size)


def moments_without_each(values: Real) -> tuple[Real, Real]:
    """Mean and standard deviation (n_rows,) of the values without each of their independent rows."""
    rows, middle = independent_parts(values), np.mean(values)
    rest = values.size - rows.shape[1]
    left_sum, left_square = (np.sum(power) - power.sum(axis=1) for power in (rows - middle, (rows - middle) ** 2))
    variance = (left_square - left_sum**2 / rest) / max(rest - 1, 1)
    return middle + left_sum / rest, np.sqrt(np.maximum(variance, 0.0))


def _capability(
    dimension: Dimension, drawing: Distribution, values: Real, spread: Estimate, confidence: float
) -> tuple[Estimate | None, Estimate | None]:
    """C_p and C_pk of values (n_parts, n_elements) against the limits of the drawing."""
    if not drawing.varies:
        return None, None
    lower, upper = (drawing.allowance_um + limit for limit in drawing.limits_um)
    two_sided = isinstance(drawing, Spread) and not dimension.one_sided
    n, cp = values.size, None
    if two_sided:
        width = (upper - lower) / 6
        cp = Estimate(width / spread.value, width / spread.ci_high, width / max(spread.ci_low, SMALLEST), n)

    def cpk(mean: Real, spread: Real) -> Real:
        room = np.minimum(upper - mean, mean - lower) if two_sided else upper - mean
        return np.asarray(room / np.maximum(3 * spread, SMALLEST), float)

    value = float(cpk(np.asarray(np.mean(values)), np.asarray(spread.value)))
    left_out = cpk(*moments_without_each(values)).tolist()
    return cp, Estimate(value, *jackknife_interval(value, left_out, confidence), n)


def _drift(part_means: Real, confidence: float) -> Drift | None:
    n = len(part_means)
    if n < FEWEST_FOR_DRIFT or np.ptp(part_means) == 0:
        return None
    order = np.arange(n)
    line = scipy.stats.linregress(order, part_means)
    half = scipy.stats.t.ppf((1 + confidence) / 2, n - 2) * line.stderr
    span = n - 1
    change = Estimate(span * line.slope, span * (line.slope - half), span * (line.slope + half), n)
    return Drift(change, float(scipy.stats.kendalltau(order, part_means).pvalue))


def _outliers(values: Real, replicates: list[Real]) -> tuple[tuple[int, int], ...]:
    """Part and element of each value farther from the median than any of 95 % of the lots drawn from the fit.

    Distances are counted in median absolute deviations, which a few outliers do not move.
    """
    distance = _robust_distances(values)
    limit = float(np.quantile([np.max(_robust_distances(lot)) for lot in replicates], 1 - LEVEL))
    return tuple((int(part), int(element)) for part, element in np.argwhere(distance > limit))


def _robust_distances(values: Real) -> Real:
    distance = np.abs(values - np.median(values))
    scale = np.median(distance)
    return distance / scale if scale > 0 else np.zeros_like(distance)

"""How the yield of a study follows the scale of each of its tolerances, from some of its units solved at every scale.

Unit k keeps its random numbers at any scale, so that the metrics at two scales differ by the scale alone. What a metric
changes by at some angles is added to its value over the whole turn. A transmission error grows in proportion instead,
since some angles show a part of its range.

Source
------
Common random numbers: Owen, Monte Carlo theory, methods and examples (2013), section 8.6.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.arrays import Real, Truth
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.config.studies.tolerances import Tolerances
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.populations.tails import Population
from pipeline.sampling.errors import Errors, draw, joined_errors
from pipeline.statistics.differences import share_difference
from pipeline.statistics.intervals import Estimate, with_missing

Solve = Callable[[Errors], Mapping[str, Real]]

SCALES = (0.25, 0.5, 0.75, 1.25, 1.5, 2.0)
"""Factors on the limits of a tolerance about nominal, beside 1."""
FEWEST_PAIRS = 10
"""Units of which variances are compared."""
RESAMPLES, RESAMPLE_SEED = 1000, 20100317
"""Of the bootstrap, which repeats itself."""
AS_STATED = ""
"""In place of a tolerance: the study as it is."""


@dataclass(frozen=True)
class ScaledYield:
    """Yield at one scale of one tolerance, against one limit or all.

    Attributes
    ----------
    tolerance, scale : the factor on its limits about nominal; its allowance stays.
    metric : of the limit, or `ALL_LIMITS`.
    value, ci_low, ci_high : the yield of the study plus the paired difference of its first units; the lower end counts
        units that have a result as stated and none at the scale as failed.
    n : units of the difference.
    """

    tolerance: str
    scale: float
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n: int


@dataclass(frozen=True)
class RemovedVariance:
    """Share of a metric's variance that goes if the limits of a tolerance are scaled to the least of `SCALES`.

    Attributes
    ----------
    value, ci_low, ci_high : below 0 where the variance grows.
    n : units that were solved at both scales.
    """

    tolerance: str
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n: int


def scaled_tolerances(study: Study) -> list[str]:
    """Tolerances that vary from unit to unit; none where there is no yield."""
    if study.samples.experiment == "cases" or not study.limits.of_metrics:
        return []
    return [name for name, tolerance in study.tolerances if tolerance.varies]


def scaled_points(study: Study) -> list[tuple[str, float]]:
    """Tolerances and the factors on their limits at which units are looked at, first the study as it is."""
    return [(AS_STATED, 1.0), *((name, scale) for name in scaled_tolerances(study) for scale in SCALES)]


def scaled_values(study: Study, start: int, stop: int, solve: Solve) -> dict[str, NDArray[np.generic]]:
    """Metrics over the turn of the samples from ``start`` to ``stop`` at every scale of every tolerance.

    Parameters
    ----------
    solve : units to their metrics (n,) over the turn as the limits mean it, and their metrics of the turn.

    Returns
    -------
    Columns by name: ``sample``, ``tolerance`` (`AS_STATED` once), ``scale`` and each metric.
    """
    points, count = scaled_points(study), stop - start
    units = solve(joined_errors(*(draw(_population(study, name, scale), start, stop) for name, scale in points)))
    columns: dict[str, NDArray[np.generic]] = {
        "sample": np.tile(np.arange(start, stop, dtype=np.int64), len(points)),
        "tolerance": np.repeat(np.array([name for name, _ in points], object), count),
        "scale": np.repeat([scale for _, scale in points], count),
    }
    columns |= units
    order = np.argsort(columns["sample"], kind="stable")
    return {name: values[order] for name, values in columns.items()}


def _population(study: Study, name: str, scale: float) -> Population:
    """The study with one tolerance times a scale, its allowance as it is."""
    tolerances: Tolerances = study.tolerances
    if name != AS_STATED:
        tolerances = tolerances.model_copy(update={name: getattr(tolerances, name).scaled_by(scale)})
    return Population(study.samples, tolerances, study.design)


def scaled_yields(
    study: Study, scaled_units: pd.DataFrame, stated_values: pd.DataFrame, stated_yields: Mapping[str, Estimate]
) -> Iterator[ScaledYield]:
    """Yield at every scale of every tolerance, by limit and against all.

    Parameters
    ----------
    scaled_units : the columns of `scaled_values`.
    stated_values : metrics over the turn as the limits mean it, by sample; the worst as it was found.
    stated_yields : yields of the whole study by metric and of `ALL_LIMITS`.
    """
    metrics = list(study.limits.of_metrics)
    ranges = [name for name in metrics if name in turn_library() and turn_library()[name].angles]
    by_sample = scaled_units.set_index("sample")
    here = by_sample[by_sample["tolerance"] == AS_STATED][metrics]
    stated_values = stated_values[metrics].reindex(here.index).astype(float)
    for (tolerance, scale), part in by_sample.groupby(["tolerance", "scale"], sort=False):
        moved_values = stated_values + part[metrics] - here
        moved_values[ranges] = stated_values[ranges] * part[ranges] / here[ranges]
        has_both = (moved_values.notna() & stated_values.notna()).all(axis=1).to_numpy()
        if tolerance == AS_STATED or not has_both.any():
            continue
        n_lost = int(np.count_nonzero(stated_values.notna().all(axis=1) & ~has_both))
        passes_before = study.limits.pass_flags(stated_values[has_both])
        passes_after = study.limits.pass_flags(moved_values[has_both])
        for name, estimate in stated_yields.items():
            if name in (*metrics, ALL_LIMITS) and name in passes_before:
                shifted_yield = _shifted_yield(
                    estimate, passes_before[name], passes_after[name], study.metrics.confidence
                )
                yield ScaledYield(str(tolerance), float(scale), name, **vars(with_missing(shifted_yield, n_lost)))


def removed_variances(scaled_units: pd.DataFrame, confidence: float) -> Iterator[RemovedVariance]:
    """What each tolerance at the least scale takes off the variance of each metric over the turn.

    Parameters
    ----------
    scaled_units : the columns of `scaled_values`.

    Notes
    -----
    Both variances are of the same units, and so are their bootstrap resamples (percentile interval; Efron and
    Tibshirani, An introduction to the bootstrap, 1993, section 13.3).
    """
    by_sample = scaled_units.set_index("sample")
    here = by_sample[by_sample["tolerance"] == AS_STATED]
    for tolerance, part in by_sample[by_sample["scale"] == min(SCALES)].groupby("tolerance", sort=False):
        for metric in [name for name in (*library(), *turn_library()) if name in here]:
            pairs = pd.DataFrame({"stated": here[metric], "tightened": part[metric]}).dropna().to_numpy(float)
            if len(pairs) < FEWEST_PAIRS or not np.ptp(pairs[:, 0]) > 0:
                continue
            drawn = np.random.default_rng(RESAMPLE_SEED).integers(0, len(pairs), (RESAMPLES, len(pairs)))
            ratios = np.array([_variance_ratio(pairs[rows]) for rows in drawn])
            low, high = 1 - np.nanquantile(ratios, [(1 + confidence) / 2, (1 - confidence) / 2])
            value = 1 - _variance_ratio(pairs)
            yield RemovedVariance(str(tolerance), metric, float(value), float(low), float(high), len(pairs))


def _variance_ratio(pairs: Real) -> float:
    """Variance of the second column of (n, 2) over that of the first; NaN where that does not vary."""
    variances = np.var(pairs, axis=0)
    return float(variances[1] / variances[0]) if variances[0] > 0 else np.nan


def _shifted_yield(stated_yield: Estimate, passes_before: Truth, passes_after: Truth, confidence: float) -> Estimate:
    """A yield plus the difference of pairs; its interval from both, which are taken to be independent."""
    passes_before, passes_after = np.asarray(passes_before), np.asarray(passes_after)
    difference = float(np.mean(passes_after) - np.mean(passes_before))
    low, high = share_difference(passes_before, passes_after, confidence, are_paired=True)
    value = float(np.clip(stated_yield.value + difference, 0.0, 1.0))
    lower_half = np.hypot(stated_yield.value - stated_yield.ci_low, difference - low)
    upper_half = np.hypot(stated_yield.ci_high - stated_yield.value, high - difference)
    ends = np.clip([value - lower_half, value + upper_half], 0.0, 1.0)
    return replace(stated_yield, value=value, ci_low=float(ends[0]), ci_high=float(ends[1]), n=len(passes_before))

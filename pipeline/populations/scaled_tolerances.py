"""How the yield of a study follows the scale of each of its tolerances, estimated without a load solve.

Unit k keeps its random numbers at any scale. The rough model of `prediction`, fitted to the loaded metrics of the same
units, gives how each metric of a unit changes; the change is added to the value that was load-solved.

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
from pipeline.populations.prediction import Tail, predicted_turn
from pipeline.populations.tails import Population
from pipeline.sampling.errors import Errors, draw, joined_errors
from pipeline.statistics.differences import share_difference
from pipeline.statistics.intervals import Estimate

Rough = Callable[[Errors], Mapping[str, Real]]

SCALES = (0.25, 0.5, 0.75, 1.25, 1.5, 2.0)
"""Factors on the limits of a tolerance about nominal, beside 1."""
AS_STATED = ""
"""In place of a tolerance: the study as it is."""


@dataclass(frozen=True)
class ScaledYield:
    """Yield at one scale of one tolerance, against one limit or all.

    Attributes
    ----------
    tolerance, scale : the factor on its limits about nominal; its allowance stays.
    metric : of the limit, or `ALL_LIMITS`.
    value, ci_low, ci_high : the yield of the study plus the paired difference of its first units.
    n : units of the difference.
    explained : squared correlation of the rough model with the load-solved metric; of all limits the least of them.
    """

    tolerance: str
    scale: float
    metric: str
    value: float
    ci_low: float
    ci_high: float
    n: int
    explained: float


def scaled_tolerances(study: Study) -> list[str]:
    """Tolerances that vary from unit to unit; none where there is no yield of a loop's metric."""
    loop_limits = [name for name in study.limits.of_metrics if name in library()]
    if study.samples.experiment == "cases" or not loop_limits:
        return []
    return [name for name, tolerance in study.tolerances if tolerance.varies]


def scaled_points(study: Study) -> list[tuple[str, float]]:
    """Tolerances and the factors on their limits at which units are looked at, first the study as it is."""
    return [(AS_STATED, 1.0), *((name, scale) for name in scaled_tolerances(study) for scale in SCALES)]


def surrogate_values(
    study: Study, start: int, stop: int, rough: Rough, loaded_values: Mapping[str, Real], pilot: Mapping[str, Real]
) -> dict[str, NDArray[np.generic]]:
    """Metrics over the turn of the samples from ``start`` to ``stop`` at every scale of every tolerance.

    Parameters
    ----------
    rough : metrics (n, n_angles) of the rough model.
    loaded_values, pilot : metrics (n_pilot, n_angles) of the pilot under load, and by the rough model.

    Returns
    -------
    Columns by name: ``sample``, ``tolerance`` (`AS_STATED` once), ``scale`` and each metric, by the limits' side of it.
    """
    points = scaled_points(study)
    units = rough(joined_errors(*(draw(_population(study, name, scale), start, stop) for name, scale in points)))
    columns: dict[str, NDArray[np.generic]] = {
        "tolerance": np.repeat(np.array([name for name, _ in points], object), stop - start),
        "scale": np.repeat([scale for _, scale in points], stop - start),
    }
    for name in library():
        tail = Tail(name, study.limits.over, -1.0 if library()[name].smaller_is_worse else 1.0, 0.0)
        columns[name] = tail.sign * tail.over_turn(predicted_turn(loaded_values[name], pilot, units)[1])
    order = np.argsort(np.tile(np.arange(stop - start), len(points)), kind="stable")
    sample = np.repeat(np.arange(start, stop, dtype=np.int64), len(points))
    return {"sample": sample} | {name: values[order] for name, values in columns.items()}


def _population(study: Study, name: str, scale: float) -> Population:
    """The study with one tolerance times a scale, its allowance as it is."""
    tolerances: Tolerances = study.tolerances
    if name != AS_STATED:
        tolerances = tolerances.model_copy(update={name: getattr(tolerances, name).scaled_by(scale)})
    return Population(study.samples, tolerances, study.design)


def scaled_yields(
    study: Study, surrogate: pd.DataFrame, solved_values: pd.DataFrame, stated_yields: Mapping[str, Estimate]
) -> Iterator[ScaledYield]:
    """Yield at every scale of every tolerance, by limit and against all.

    Parameters
    ----------
    surrogate : the columns of `surrogate_values`.
    solved_values : load-solved metrics over the turn as the limits mean it, by sample.
    stated_yields : yields of the whole study by metric and of `ALL_LIMITS`.
    """
    metrics = [name for name in study.limits.of_metrics if name in library()]
    by_sample = surrogate.set_index("sample")
    here = by_sample[by_sample["tolerance"] == AS_STATED][metrics]
    solved_values = solved_values[list(study.limits.of_metrics)].reindex(here.index).astype(float)
    correlations = {name: _squared_correlation(solved_values[name], here[name]) for name in metrics}
    correlations[ALL_LIMITS] = float(np.nanmin([*correlations.values(), 1.0]))
    for (tolerance, scale), part in by_sample.groupby(["tolerance", "scale"], sort=False):
        moved_values = solved_values.copy()
        moved_values[metrics] += part[metrics] - here
        has_both = (moved_values.notna() & solved_values.notna()).all(axis=1).to_numpy()
        if tolerance == AS_STATED or not has_both.any():
            continue
        passes_before = study.limits.pass_flags(solved_values[has_both])
        passes_after = study.limits.pass_flags(moved_values[has_both])
        for name, estimate in stated_yields.items():
            if name in correlations and name in passes_before:
                shifted_yield = _shifted_yield(
                    estimate, passes_before[name], passes_after[name], study.metrics.confidence
                )
                yield ScaledYield(
                    str(tolerance), float(scale), name, **vars(shifted_yield), explained=correlations[name]
                )


def _squared_correlation(values: pd.Series, predictions: pd.Series) -> float:
    """Squared correlation of values and their predictions; NaN of fewer than three values or equal ones."""
    pairs = pd.DataFrame({"solved": values, "predicted": predictions}).dropna()
    varies = len(pairs) > 2 and (pairs.std() > 0).all()
    return float(pairs["solved"].corr(pairs["predicted"]) ** 2) if varies else np.nan


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

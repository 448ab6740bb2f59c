"""The yield of a study made from measured lots, and which dimension costs most of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.distributions.distribution import Distribution
from pipeline.config.distributions.fixed import Fixed
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.fresh_units import Solve, fresh_values, yields
from pipeline.decisions.lots.dimension_fit import DimensionFit
from pipeline.errors import InputError
from pipeline.statistics import Estimate
from pipeline.statistics.differences import share_difference

Real = NDArray[np.float64]

MIDPOINTS = 512
"""Of the range of a probability, over which the mean of a tolerance is taken."""


@dataclass(frozen=True)
class DimensionCost:
    """What the spread and the offset of one dimension cost.

    Attributes
    ----------
    yield_at_target : yield of the lot if every part had the drawing's mean in this dimension.
    gain : difference to the yield of the lot, on the same units.
    """

    name: str
    yield_at_target: float
    gain: Estimate


@dataclass(frozen=True)
class LotYield:
    """Yields of fresh load-solved units.

    Attributes
    ----------
    as_drawn, as_made : by metric and against all limits, with the tolerances of the study and with those of the lot.
    costs : of the measured dimensions, the largest gain first.
    values : of each metric of the units as made (n,), as the limits count them.
    """

    as_drawn: Mapping[str, Estimate]
    as_made: Mapping[str, Estimate]
    costs: tuple[DimensionCost, ...]
    values: Mapping[str, Real]


def study_of_lot(study: Study, fits: Sequence[DimensionFit]) -> Study:
    """The study with the fitted distributions in place of its tolerances."""
    return _with_tolerances(study, {fit.dimension.name: fit.tolerance for fit in fits})


def _with_tolerances(study: Study, replaced: Mapping[str, Distribution]) -> Study:
    return study.model_copy(update={"tolerances": study.tolerances.model_copy(update=dict(replaced))})


def lot_yield(study: Study, fits: Sequence[DimensionFit], solve: Solve, units: int, jobs: int) -> LotYield:
    """Yields of ``units`` fresh units of the study and of the lot; all of them share their random numbers.

    Raises
    ------
    InputError
        If the study sets no limits, or lists cases.
    """
    if not study.limits.of_metrics:
        raise InputError(f"study {study.name}: [limits] is empty; a yield needs a limit")
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases are not drawn; give a study with tolerances")
    made = study_of_lot(study, fits)
    start = study.samples.count

    def values(variant: Study) -> Mapping[str, Real]:
        return fresh_values(variant, start, units, solve, jobs)

    drawn_values, made_values = values(study), values(made)
    confidence, passes = study.metrics.confidence, passed(study, made_values)
    costs = []
    for fit in fits:
        drawing = getattr(study.tolerances, fit.dimension.name)
        perfect = _with_tolerances(made, {fit.dimension.name: _target(drawing)})
        perfect_passes = passed(study, values(perfect))
        low, high = share_difference(passes, perfect_passes, confidence, True)
        gain = Estimate(float(perfect_passes.mean() - passes.mean()), low, high, units)
        costs.append(DimensionCost(fit.dimension.name, float(perfect_passes.mean()), gain))
    costs.sort(key=lambda cost: -cost.gain.value)
    return LotYield(yields(study, drawn_values), yields(study, made_values), tuple(costs), made_values)


def _target(drawing: Distribution) -> Fixed:
    """The mean of a tolerance in every part."""
    probability = (np.arange(MIDPOINTS) + 0.5) / MIDPOINTS
    mean = float(np.mean(drawing.deviation(probability)))
    return Fixed(distribution="fixed", allowance_um=drawing.allowance_um, value_um=mean)


def passed(study: Study, values: Mapping[str, Real]) -> NDArray[np.bool_]:
    """Whether each unit (n,) keeps all limits; one without a value keeps none."""
    known = np.all([np.isfinite(values[name]) for name in study.limits.limited(ALL_LIMITS, values)], axis=0)
    return study.limits.kept(values)[ALL_LIMITS] & known

"""The tolerances of a study that have a cost, and the study with some of them scaled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.config.studies.costs import Cost
from pipeline.config.studies.study import Study
from pipeline.errors import InputError
from pipeline.model.metrics import library

SCALES = (0.2, 5.0)
"""Scales of a tolerance that are looked at."""


@dataclass(frozen=True)
class Priced:
    """A tolerance that varies and has a cost: its zone [um] in the study, and its cost for the whole reducer."""

    name: str
    width_um: float
    cost: Cost
    count: int

    def cost_at(self, scale: Real) -> Real:
        """Cost at scales (any shape); missing where it is not known."""
        return self.count * self.cost.of_one(self.width_um * np.asarray(scale))

    @property
    def bounds(self) -> tuple[float, float]:
        """Scales between which it can be moved."""
        known_scales = [width / self.width_um for width in self.cost.widths_um]
        return max(SCALES[0], known_scales[0]), min(SCALES[1], known_scales[1])

    def price_per_um(self, scale: float) -> float:
        """What an um of the zone more saves."""
        ends = np.array([0.999, 1.001]) * scale
        cost = self.cost_at(np.clip(ends, *self.bounds))
        return float((cost[0] - cost[1]) / np.ptp(np.clip(ends, *self.bounds)) / self.width_um)


def priced_tolerances(study: Study) -> tuple[tuple[Priced, ...], dict[str, str]]:
    """The tolerances that can be moved, and why the others of the study cannot.

    Raises
    ------
    InputError
        If there is none, the study sets no limit, or its samples are listed cases.
    """
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases have no yield; an allocation needs random samples")
    if not study.limits.of_metrics:
        raise InputError(f"study {study.name}: [limits] names no metric; set one, as lost_motion_arcmin")
    of_turn = [name for name in study.limits.of_metrics if name not in library()]
    if of_turn:
        raise InputError(
            f"study {study.name}: limits.{name}: an allocation uses metrics of a loop, {name} is one of the turn; "
            "take it out of a copy of the study"
            for name in of_turn
        )
    costs, priced_dimensions, unmoved_reasons = study.costs.of_dimensions, [], {}
    for name, tolerance in study.tolerances:
        low, high = tolerance.limits_um
        if not tolerance.varies:
            if name in costs:
                unmoved_reasons[name] = "does not vary"
        elif name not in costs:
            unmoved_reasons[name] = f"no cost is stated ([costs.{name}])"
        else:
            priced_dimensions.append(Priced(name, high - low, costs[name], costs[name].count(name, study.design)))
    if not priced_dimensions:
        raise InputError(f"study {study.name}: no tolerance that varies has a cost; state one, as [costs.pin_radial]")
    empty = [
        priced_tolerance.name
        for priced_tolerance in priced_dimensions
        if not priced_tolerance.bounds[0] < priced_tolerance.bounds[1]
    ]
    if empty:
        raise InputError(
            f"study {study.name}: costs.{name}: its table lies beyond the scales 0.2 to 5" for name in empty
        )
    return tuple(priced_dimensions), unmoved_reasons


def with_scaled_tolerances(study: Study, names: Sequence[str], scale: Real) -> Study:
    """The study with tolerances ``names`` times ``scale`` (n,), their allowances as they are."""
    factors = dict(zip(names, scale, strict=True))
    tolerances = {name: getattr(study.tolerances, name).scaled_by(float(factor)) for name, factor in factors.items()}
    return study.model_copy(update={"tolerances": study.tolerances.model_copy(update=tolerances)})

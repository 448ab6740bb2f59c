"""The cheapest tolerances of a linear model of units: each unit's badness against limits is linear in the scales.

Badness is how far a metric lies beyond its limit, in units of its spread; a unit is good where no badness is above 0.

The tolerances of a study that have a cost, and the study with some of them scaled.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Real
from pipeline.config.studies.costs import Cost
from pipeline.config.studies.study import Study
from pipeline.decisions.fresh_units import refuse_limits_of_turn
from pipeline.errors import InputError

CostOfScale = Callable[[Real], Real]
"""Scales of one tolerance (any shape) to its cost."""

SOFTNESS = 0.15
"""Of the limits, in spreads of a metric: units this near to one tell the slope of the yield, else too few would."""
ROUNDS = 4
"""In which the soft yield that is asked for is set by the hard one that is meant."""
STEP = 1e-4
"""In the logarithm of a scale, for the slope of its cost."""
HALVINGS = 40
"""Of the common factor: to 1e-12."""
REACH = 1.5
"""Factor by which all scales are moved at most to meet the hard yield."""


@dataclass(frozen=True)
class LinearUnits:
    """Badness of ``n`` units near the scales of ``n_dims`` tolerances.

    Attributes
    ----------
    scale : (n_dims,) about which it is linear.
    value : (n, n_limits) badness there.
    slope : (n, n_limits, n_dims) by the scales.
    """

    scale: Real
    value: Real
    slope: Real

    def badness(self, scale: Real) -> Real:
        """(n, n_limits) at other scales."""
        return np.asarray(self.value + self.slope @ (scale - self.scale))

    def pass_share(self, scale: Real) -> float:
        """Share of the units that keep all limits."""
        return float(np.mean(self.badness(scale).max(axis=1) <= 0))

    def excess(self, scale: Real, target: float) -> float:
        """Quantile of the units' worst badness that must not exceed 0 for a yield of ``target``."""
        return float(np.quantile(self.badness(scale).max(axis=1), target, method="median_unbiased"))

    def soft(self, scale: Real) -> tuple[float, Real]:
        """Yield with limits softened by `SOFTNESS`, and its slope (n_dims,) by the scales."""
        badness = self.badness(scale)
        worst_limit = np.argmax(badness, axis=1)
        units = np.arange(len(worst_limit))
        soft_pass = scipy.special.expit(-badness[units, worst_limit] / SOFTNESS)
        slope = -(soft_pass * (1 - soft_pass) / SOFTNESS) @ self.slope[units, worst_limit] / len(units)
        return float(soft_pass.mean()), np.asarray(slope)


@dataclass(frozen=True)
class Best:
    """Scales (n_dims,), and whether they reach the yield; if not, they come nearest to it."""

    scale: Real
    meets_yield: bool


def cheapest(units: LinearUnits, costs: Sequence[CostOfScale], target: float, low: Real, high: Real) -> Best:
    """Scales of least cost at which the share ``target`` of the units keeps all limits.

    Parameters
    ----------
    costs : of each tolerance.
    low, high : (n_dims,) bounds of the scales.

    Notes
    -----
    Sequential quadratic programming in the logarithms of the scales, the yield softened at the limits. Of its scales
    those are taken that one common factor brings to the hard yield; the soft yield there is what the next round asks.
    """
    total = sum(
        float(cost(np.clip(scale_factors, a, b)))
        for cost, scale_factors, a, b in zip(costs, units.scale, low, high, strict=True)
    )

    def cost(logs: Real) -> tuple[float, Real]:
        ends = np.clip(np.stack([logs - STEP, logs + STEP]), np.log(low), np.log(high))
        values = np.array([cost_law(np.exp(pair)) for cost_law, pair in zip(costs, ends.T, strict=True)])
        slope = (values[:, 1] - values[:, 0]) / (ends[1] - ends[0])
        return float(values.mean(axis=1).sum()) / total, slope / total

    best_scales = _scales_of_largest_yield(units, np.clip(units.scale, low, high), target, low, high)
    if not best_scales.meets_yield:
        return best_scales
    soft_target, scale, feasible = target, best_scales.scale, [best_scales.scale]
    for _ in range(ROUNDS):
        logs = _minimum(cost, partial(_soft_yield, units, soft_target), np.log(scale), np.log(low), np.log(high))
        meeting_scale = _meeting(units, np.exp(logs), target, low, high)
        if meeting_scale is None:
            break
        feasible.append(meeting_scale)
        scale, soft_target = meeting_scale, units.soft(meeting_scale)[0]
    return Best(min(feasible, key=lambda scale_factors: cost(np.log(scale_factors))[0]), True)


def _minimum(cost: Callable[..., Any], spare: Callable[..., Any], logs: Real, low: Real, high: Real) -> Real:
    constraint = {"type": "ineq", "fun": lambda x: spare(x)[0], "jac": lambda x: spare(x)[1]}
    bounds = list(zip(low, high, strict=True))
    options = {"maxiter": 200, "ftol": 1e-9}
    optimum = scipy.optimize.minimize(
        cost, logs, jac=True, method="SLSQP", bounds=bounds, constraints=[constraint], options=options
    )
    scale: Real = np.clip(optimum.x, low, high)
    return scale


def _soft_yield(units: LinearUnits, soft_target: float, logs: Real) -> tuple[float, Real]:
    """What the soft yield has to spare, and its slope by the logarithms of the scales."""
    scale = np.exp(logs)
    value, slope = units.soft(scale)
    return value - soft_target, slope * scale


def _log_loss(units: LinearUnits, logs: Real) -> tuple[float, Real]:
    """Mean of -log(soft pass) of the units' worst badness, and its slope by the logarithms of the scales."""
    scale = np.exp(logs)
    badness = units.badness(scale)
    worst_limit, rows = np.argmax(badness, axis=1), np.arange(len(badness))
    steepness = badness[rows, worst_limit] / SOFTNESS
    slope = (scipy.special.expit(steepness) / SOFTNESS) @ units.slope[rows, worst_limit] / len(rows)
    return float(np.mean(np.logaddexp(0.0, steepness))), slope * scale


def _scales_of_largest_yield(units: LinearUnits, scale: Real, target: float, low: Real, high: Real) -> Best:
    """Scales of the largest soft yield within the bounds; a log loss first leads there where every unit fails."""

    def lost(logs: Real) -> tuple[float, Real]:
        spare, slope = _soft_yield(units, target, logs)
        return -spare, -slope

    logs, bounds = np.log(scale), list(zip(np.log(low), np.log(high), strict=True))
    for objective in (partial(_log_loss, units), lost):
        logs = scipy.optimize.minimize(objective, logs, jac=True, method="L-BFGS-B", bounds=bounds).x
    best_scale = np.clip(np.exp(logs), low, high)
    return Best(best_scale, units.excess(best_scale, target) <= 0)


def _meeting(units: LinearUnits, scale: Real, target: float, low: Real, high: Real) -> Real | None:
    """The scales times the one factor, within `REACH`, at which the quantile meets 0; None where none does."""

    def clipped_scale(factor: float) -> Real:
        return np.clip(factor * scale, low, high)

    small, large = (1.0, REACH) if units.excess(scale, target) <= 0 else (1 / REACH, 1.0)
    if units.excess(clipped_scale(small), target) > 0:
        return None
    if units.excess(clipped_scale(large), target) <= 0:
        return clipped_scale(large)
    for _ in range(HALVINGS):
        middle = np.sqrt(small * large)
        small, large = (middle, large) if units.excess(clipped_scale(middle), target) <= 0 else (small, middle)
    return clipped_scale(small)


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
    refuse_limits_of_turn(study, "an allocation")
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
    empty = [priced.name for priced in priced_dimensions if not priced.bounds[0] < priced.bounds[1]]
    if empty:
        raise InputError(
            f"study {study.name}: costs.{name}: its table lies beyond the scales 0.2 to 5" for name in empty
        )
    return tuple(priced_dimensions), unmoved_reasons


def with_scaled_tolerances(study: Study, names: Sequence[str], scale: Real) -> Study:
    """The study with tolerances ``names`` times ``scale`` (n,), their allowances as they are."""
    factors = dict(zip(names, scale, strict=True))
    tolerances = {name: getattr(study.tolerances, name).scaled_by(float(factor)) for name, factor in factors.items()}
    return study.with_section("tolerances", **tolerances)

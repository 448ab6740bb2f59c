"""The cheapest tolerances of a linear model of units: each unit's badness against limits is linear in the scales.

Badness is how far a metric lies beyond its limit, in units of its spread; a unit is good where no badness is above 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from pipeline.arrays import Real

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
        soft_pass = expit(-badness[units, worst_limit] / SOFTNESS)
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


def _minimum(cost: Callable, spare: Callable, logs: Real, low: Real, high: Real) -> Real:
    constraint = {"type": "ineq", "fun": lambda x: spare(x)[0], "jac": lambda x: spare(x)[1]}
    bounds = list(zip(low, high, strict=True))
    options = {"maxiter": 200, "ftol": 1e-9}
    optimum = minimize(cost, logs, jac=True, method="SLSQP", bounds=bounds, constraints=[constraint], options=options)
    return np.clip(optimum.x, low, high)


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
    slope = (expit(steepness) / SOFTNESS) @ units.slope[rows, worst_limit] / len(rows)
    return float(np.mean(np.logaddexp(0.0, steepness))), slope * scale


def _scales_of_largest_yield(units: LinearUnits, scale: Real, target: float, low: Real, high: Real) -> Best:
    """Scales of the largest soft yield within the bounds; a log loss first leads there where every unit fails."""

    def lost(logs: Real) -> tuple[float, Real]:
        spare, slope = _soft_yield(units, target, logs)
        return -spare, -slope

    logs, bounds = np.log(scale), list(zip(np.log(low), np.log(high), strict=True))
    for objective in (partial(_log_loss, units), lost):
        logs = minimize(objective, logs, jac=True, method="L-BFGS-B", bounds=bounds).x
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

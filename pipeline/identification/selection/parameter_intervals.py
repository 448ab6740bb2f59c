"""Fitted parameters of effects with their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri  # quantiles: scipy.stats is slow to import

from pipeline.arrays import Real
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import values_at_shares
from pipeline.identification.selection.criteria import FORM, Trial
from pipeline.statistics.resampling import CONFIDENCE


@dataclass(frozen=True)
class FittedParameter:
    """A parameter of a named effect with its interval; NaN limits where the data give none, and why."""

    effect: str
    name: str
    unit: str
    value: float
    ci_low: float
    ci_high: float
    note: str = ""


def intervals(fitter: Fitter, trial: Trial) -> tuple[FittedParameter, ...]:
    """Parameters of a fitted model with intervals of their posterior, and what the form of the model adds.

    Notes
    -----
    The posterior holds noise, the structure beside the model and the priors of calibrated numbers and tolerances
    (``evidence``); a share ``FORM`` of its own size is added to the deviation of what grows with an effect. The
    interval reaches over those of other solutions that are nearly as probable.
    """
    fit, bounds = trial.fit, fitter.bounds(trial.fit.model)
    low_ends, high_ends = zip(*(_ends(solution, bounds) for solution in (trial, *trial.other_solutions)), strict=True)
    ends = np.min(low_ends, axis=0), np.max(high_ends, axis=0)
    values = [values_at_shares(bounds, np.clip(vector, 0, 1)) for vector in (fit.unknowns.shares, *ends)]
    parameters = [(effect.name, parameter) for effect in fit.model.effects for parameter in effect.parameters]
    estimates = []
    for number, (effect_name, parameter) in enumerate(parameters):
        at_bound = not 1e-6 < fit.unknowns.shares[number] < 1 - 1e-6
        note = "at the bound of what the library allows: no interval" if at_bound else ""
        value, ci_low, ci_high = (float(vector[number]) for vector in values)
        if at_bound:
            ci_low = ci_high = float("nan")
        estimates.append(FittedParameter(effect_name, parameter.name, parameter.unit, value, ci_low, ci_high, note))
    return tuple(estimates)


def _ends(trial: Trial, bounds: Sequence[tuple[float, float]]) -> tuple[Real, Real]:
    """Ends of the intervals (n_parameters,) as shares of the bounds.

    Those of sizes that cannot be negative, and would reach zero, are taken in the logarithm of the size: where a size
    and a time constant trade in a valley of the misfit, it is wide upwards and never reaches zero.
    """
    unknowns = trial.fit.unknowns
    shares, first_share = unknowns.shares, len(unknowns.scales)
    deviation = trial.evidence.deviations[first_share : first_share + len(shares)]
    size = [
        share + low / (high - low) if low <= 0 <= high else 0.0
        for share, (low, high) in zip(shares, bounds, strict=True)
    ]
    step = float(ndtri(0.5 * (1 + CONFIDENCE))) * np.hypot(deviation, FORM * np.array(size))
    low_end, high_end = shares - step, shares + step
    for k, (lower, _) in enumerate(bounds):
        if lower == 0 < shares[k] and low_end[k] <= 0:
            high_end[k] = max(high_end[k], np.exp(min(np.log(shares[k]) + step[k] / shares[k], 0.0)))
            low_end[k] = shares[k] * np.exp(-step[k] / shares[k])
    return low_end, high_end

"""The numbers of a fit with their intervals: parameters of effects, and calibrated numbers in their ranges."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth
from pipeline.config.studies.study import LAW_FACTORS
from pipeline.constant_kinds import Shown
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import SCALE_REACH, Fit, shares_of_zero, values_at_shares
from pipeline.identification.selection.criteria import FORM, Trial
from pipeline.identification.selection.evidence import Evidence
from pipeline.statistics.resampling import CONFIDENCE

ENTANGLED_SHARE: Shown = 0.9
"""Correlation from which only a combination of two numbers is determined."""
LEARNT: Shown = 0.7
"""Standard deviation over that of the prior up to which the data have determined a number."""


@dataclass(frozen=True)
class CalibratedNumber:
    """A refitted number of the design, as a factor of the declared one.

    Attributes
    ----------
    key : dotted name in the design file, or what a scale of a force law is.
    factor, ci_low, ci_high : fitted, with its 95 % interval.
    plausible_low, plausible_high : factors between which it is plausible.
    leaves : whether it stands at an end of that range, or beyond it.
    note : what the data leave open of it, or "".
    """

    key: str
    factor: float
    ci_low: float
    ci_high: float
    plausible_low: float
    plausible_high: float
    leaves: bool
    note: str


def calibrated_numbers(fitter: Fitter, fit: Fit, evidence: Evidence) -> tuple[CalibratedNumber, ...]:
    """All scales of a fit, with intervals and what is determined of them."""
    n, problem = len(fit.unknowns.scales), fitter.problem
    if not n:
        return ()
    deviation, covariance = evidence.deviations[:n], evidence.unknowns[1][:n, :n]
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    keys, (low, high) = [*problem.calibrated_keys, *(factor.title for factor in LAW_FACTORS)], problem.scale_range
    leaves = replace(fit.unknowns, reach=problem.scale_range).at_reach
    reach = float(ndtri(0.5 * (1 + CONFIDENCE))) * deviation
    numbers = []
    for k, scale in enumerate(fit.unknowns.scales):
        note = ""
        if deviation[k] > LEARNT * problem.scale_spread[k]:
            note = "not determined by these data: its range alone holds it"
        partners = [j for j in range(n) if j != k and abs(correlation[k, j]) > ENTANGLED_SHARE]
        if partners:
            note = f"only a combination with {' and '.join(keys[j] for j in partners)} is determined"
        factor, ci_low, ci_high = np.exp([scale, scale - reach[k], scale + reach[k]]).tolist()
        plausible = float(np.exp(low[k])), float(np.exp(high[k]))
        numbers.append(CalibratedNumber(keys[k], factor, ci_low, ci_high, *plausible, bool(leaves[k]), note))
    return tuple(numbers)


def refit_with_free_numbers(fitter: Fitter, fit: Fit, cells: Truth) -> Fit | None:
    """The model refitted with its numbers free.

    None where no number is at an end of its range, or where the refit finds no equilibrium.
    """
    if not np.any(fit.unknowns.at_reach):
        return None
    reach = SCALE_REACH * np.array([[-1.0], [1.0]])
    refit = fitter.fit(fit.model, cells, replace(fit.unknowns, reach=reach))
    return refit if refit.sound and np.isfinite(refit.cost) else None


def implausible(numbers: Sequence[CalibratedNumber]) -> str:
    """The numbers that leave their ranges, in words."""
    return " and ".join(
        f"{number.key} x {number.factor:.3g} (plausible {number.plausible_low:.3g} to {number.plausible_high:.3g})"
        for number in numbers
        if number.leaves
    )


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

    A size that cannot be negative and was fitted as zero has the interval of half a normal density from zero up. That
    is too wide where the misfit falls steeply towards zero.
    """
    fit, bounds = trial.fit, fitter.bounds(trial.fit.model)
    low_ends, high_ends = zip(*(_ends(solution, bounds) for solution in (trial, *trial.other_solutions)), strict=True)
    ends = np.min(low_ends, axis=0), np.max(high_ends, axis=0)
    values = [values_at_shares(bounds, np.clip(vector, 0, 1)) for vector in (fit.unknowns.shares, *ends)]
    parameters = [(effect.name, parameter) for effect in fit.model.effects for parameter in effect.parameters]
    estimates = []
    for number, (effect_name, parameter) in enumerate(parameters):
        if parameter.of_position:
            continue
        is_none = bounds[number][0] == 0 and fit.unknowns.shares[number] == 0
        at_bound = not is_none and not 1e-6 < fit.unknowns.shares[number] < 1 - 1e-6
        note = "at the bound of what the library allows: no interval" if at_bound else ""
        value, ci_low, ci_high = (float(vector[number]) for vector in values)
        if at_bound:
            ci_low = ci_high = float("nan")
        estimates.append(FittedParameter(effect_name, parameter.name, parameter.unit, value, ci_low, ci_high, note))
    return tuple(estimates)


def _ends(trial: Trial, bounds: Sequence[tuple[float, float]]) -> tuple[Real, Real]:
    """Ends of the intervals (n_parameters,) as shares of the bounds.

    Zero is excluded of what is named. The end of an interval that would reach zero is therefore taken in the logarithm
    of the size, if this is the only one of its effect. So is the other end of one that cannot be negative: where a size
    and a time constant trade in a valley of the misfit, it is wide upwards.
    """
    unknowns = trial.fit.unknowns
    shares, first_share = unknowns.shares, len(unknowns.scales)
    deviation = trial.evidence.deviations[first_share : first_share + len(shares)]
    is_size = np.array([low <= 0 <= high for low, high in bounds])
    zero = shares_of_zero(bounds, shares)
    size = shares - zero
    step = float(ndtri(0.5 * (1 + CONFIDENCE))) * np.hypot(deviation, FORM * size)
    low_end, high_end = shares - step, shares + step
    for _, place in trial.fit.model.places:
        sizes = [k for k in range(place.start, place.stop) if is_size[k]]
        if len(sizes) == 1 and 0 < abs(size[k := sizes[0]]) <= step[k]:
            ratio = step[k] / abs(size[k])
            factors = np.exp(-ratio), np.exp(ratio) if bounds[k][0] == 0 else 1 + ratio
            low_end[k], high_end[k] = np.sort(zero[k] + size[k] * np.array(factors))
    return low_end, high_end

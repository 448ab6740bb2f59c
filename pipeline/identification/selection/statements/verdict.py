"""The verdict on a unit: what the rule (``criteria``) says, in one of seven terms, with parameters."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Truth
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.selection.criteria import UNLIKELY, Selection
from pipeline.identification.selection.fitted_numbers import (
    CalibratedNumber,
    FittedParameter,
    calibrated_numbers,
    implausible,
    intervals,
    refit_with_free_numbers,
)

ADEQUATE = "adequate"
IDENTIFIED = "identified"
EQUIVALENT = "equivalent"
WITHIN_TOLERANCE = "within tolerance"
UNEXPLAINED = "not explained by the library"
NOT_TESTABLE = "not testable with these data"
FAULT = "data fault"
VERDICT_FILE = "verdict.json"


@dataclass(frozen=True)
class Verdict:
    """What is said of a unit.

    Attributes
    ----------
    verdict : one of the seven terms.
    named_effects : the effect (several joined by + act together), or the class of effects that the data do not tell
        apart.
    parameters : of the named effects.
    calibrated_numbers : refitted numbers of the model that is named, or of the one without effects.
    findings : what else must be known to sign: numbers outside of their plausible ranges, tolerances that no unit has.
    structure : misfit of the named model, or of the one without effects, in noise.
    """

    verdict: str
    named_effects: tuple[str, ...] = ()
    parameters: tuple[FittedParameter, ...] = ()
    calibrated_numbers: tuple[CalibratedNumber, ...] = ()
    findings: tuple[str, ...] = ()
    structure: float = float("nan")


def judge(fitter: Fitter, selection: Selection, cells: Truth) -> Verdict:
    """The verdict of a selection over ``cells`` (n_cells,)."""
    chosen_trial = selection.chosen_trial
    share = selection.base.evidence.tolerance_share
    if selection.members:
        verdict = _of_class(fitter, selection)
    else:
        is_structured = selection.base.evidence.structure.size > selection.limit or selection.best_model
        verdict = ADEQUATE if share >= UNLIKELY and not is_structured else UNEXPLAINED
    parameters = tuple(p for name in selection.members for p in intervals(fitter, selection.trials[name]))
    numbers = calibrated_numbers(fitter, chosen_trial.fit, chosen_trial.evidence)
    findings = _findings(fitter, selection, cells, verdict, share)
    return Verdict(verdict, selection.members, parameters, numbers, findings, chosen_trial.rms)


def _of_class(fitter: Fitter, selection: Selection) -> str:
    """The term for what is named: tolerances stand for it, one effect or several alike."""
    fits = [selection.trials[name].fit for name in selection.members]
    if any(fitter.problem.within_tolerance(fit.model, fit.values.tolist()) for fit in fits):
        return WITHIN_TOLERANCE
    return IDENTIFIED if len(selection.members) == 1 else EQUIVALENT


def verdict_without_test(verdict: Verdict, reason: str, testable: bool) -> Verdict:
    """What ``adequate`` becomes where the test of unused data does not pass, or cannot be made."""
    word = UNEXPLAINED if testable else NOT_TESTABLE
    return replace(verdict, verdict=word, findings=(*verdict.findings, reason))


def _findings(fitter: Fitter, selection: Selection, cells: Truth, verdict: str, share: float) -> tuple[str, ...]:
    """Findings beside the verdict: tolerances that few units have, why the nearest is not named, other refits."""
    findings = []
    if not selection.members and share < UNLIKELY:
        findings.append(f"The fit needs tolerances found in only {share:.1g} of the study's units")
    if selection.best_model and not selection.members:
        findings.append(
            f"The most probable, {selection.best_model}, is not named: {selection.reasons[selection.best_model]}"
        )
    if verdict == UNEXPLAINED:
        free_fit = refit_with_free_numbers(fitter, selection.chosen_trial.fit, cells)
        covariance = selection.base.evidence.covariance
        if free_fit and covariance.rms(free_fit.predicted_angle) <= np.hypot(1.0, selection.limit):
            numbers = implausible(calibrated_numbers(fitter, free_fit, selection.chosen_trial.evidence))
            findings.append(f"The unit would be explained only by {numbers}")
    return tuple(findings)

"""The verdict on a unit: what the selection says in one of six words, with parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.judgement import MOST_NAMED, Selection
from pipeline.identification.selection.parameter_intervals import FittedParameter, intervals
from pipeline.identification.selection.recalibration import (
    UNLIKELY,
    CalibratedNumber,
    calibrated_numbers,
    implausible,
    released,
    tolerance_share,
)

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

ADEQUATE, IDENTIFIED, EQUIVALENT, MOSTLY, UNEXPLAINED, FAULT = (
    "adequate",
    "identified",
    "equivalent",
    "mostly explained",
    "unexplained",
    "data fault",
)
LARGEST_CLASS = 3
"""Effects in a class beyond which it counts as unresolved."""
MOSTLY_REMOVED = 0.7
"""Share of the error that claimed effects must remove where structure is left. Chosen: on the printed drive friction
removes 0.8 to 0.85 of it, on blind units the nearest effect of the library to one outside of it less than 0.6."""


@dataclass(frozen=True)
class Verdict:
    """What is said of a unit.

    Attributes
    ----------
    verdict : one of the six words.
    named : the effect (several joined by + act together), or the class of effects that the data do not tell apart.
    traced : effects of the best model, then those that explain a significant part alone, named or not.
    parameters : of the named effects.
    calibrated : refitted numbers of the model that is claimed, or of the one without effects.
    findings : what else must be known to sign: numbers outside of their plausible ranges, tolerances that no unit has.
    structure : held-out rms of the best model in noise floors.
    """

    verdict: str
    named: tuple[str, ...] = ()
    traced: tuple[str, ...] = ()
    parameters: tuple[FittedParameter, ...] = ()
    calibrated: tuple[CalibratedNumber, ...] = ()
    findings: tuple[str, ...] = ()
    structure: float = float("nan")


def judge(fitter: Fitter, selection: Selection, cells: Truth) -> Verdict:
    """The verdict of a selection over ``cells`` (n_cells,)."""
    chosen = selection.chosen
    share = tolerance_share(fitter, chosen.fit, cells)
    possible, findings = share >= UNLIKELY, _beside(fitter, selection, cells, share)
    members = selection.members if possible else ()
    structured = chosen.rms > selection.limit or chosen.fit.model.n_effects > MOST_NAMED
    if structured:
        claimed = selection.trials.get(selection.claimed) if possible else None
        free = released(fitter, claimed or selection.base, cells)
        explains = free is not None and free.rms <= selection.limit
        if free is not None and explains:
            implausible_numbers = implausible(calibrated_numbers(fitter, free.fit, cells))
            findings.append(
                f"{'What is left' if claimed else 'The unit'} would be explained only by {implausible_numbers}"
            )
        members = (selection.claimed,) if claimed and (explains or _mostly(claimed, selection.base)) else ()
        chosen = claimed if claimed and members else chosen
        verdict = MOSTLY if members else UNEXPLAINED
    elif members:
        verdict = IDENTIFIED if len(members) == 1 else EQUIVALENT
    else:
        verdict = ADEQUATE if possible else UNEXPLAINED
    parameters = tuple(
        p for name in members for p in intervals(fitter, selection.trials[name].fit, cells, selection.base.rms)
    )
    corrected = chosen if members else selection.base
    numbers = calibrated_numbers(fitter, corrected.fit, cells)
    return Verdict(verdict, members, _traced(selection), parameters, numbers, tuple(findings), chosen.rms)


def withdrawn(verdict: Verdict, fitter: Fitter, selection: Selection, cells: Truth) -> Verdict:
    """What a verdict becomes whose model predicts held-out cells worse than the refitted one: it claims nothing.

    A selection's fits start from one to all cells; those of the folds know nothing of the cells that they predict.
    """
    names = " or ".join(verdict.named)
    finding = f"Cells held out are predicted worse with {names} than without: it is not claimed"
    numbers = calibrated_numbers(fitter, selection.base.fit, cells)
    findings = (*verdict.findings, finding)
    return replace(verdict, verdict=UNEXPLAINED, named=(), parameters=(), calibrated=numbers, findings=findings)


def _beside(fitter: Fitter, selection: Selection, cells: Truth, share: float) -> list[str]:
    """Findings beside the verdict: tolerances that a small ``share`` of units has, unsupported claims, other refits."""
    findings = []
    if share < UNLIKELY:
        findings.append(
            f"The tolerances that were not measured would have to lie where {share:.1g} of the study's units do"
        )
    nearest = min(selection.unsupported, key=lambda name: selection.trials[name].rms, default="")
    if nearest and not selection.best:
        reason = selection.unsupported[nearest]
        findings.append(f"The nearest, {nearest}, is not claimed ({reason})")
    if selection.best and selection.stretched:
        free = released(fitter, selection.base, cells)
        if free is not None and free.rms <= selection.chosen.rms:
            implausible_numbers = implausible(calibrated_numbers(fitter, free.fit, cells))
            findings.append(f"Without any effect {implausible_numbers} would do as well; it is not believed")
    return findings


def _mostly(claimed: Trial, base: Trial) -> bool:
    """Whether effects are claimed although structure is left."""
    return claimed.rms <= (1 - MOSTLY_REMOVED) * base.rms


def _traced(selection: Selection) -> tuple[str, ...]:
    single_effects = [name for name in selection.survivors if "+" not in name]
    return tuple(dict.fromkeys([*filter(None, selection.best.split("+")), *single_effects]))

"""The verdict in a sentence that an engineer would sign, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.identification.fitting.problem import candidates
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.judgement import FEWEST_BLOCKS, Selection
from pipeline.identification.selection.parameter_intervals import CONFIDENCE, FittedParameter
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    EQUIVALENT,
    IDENTIFIED,
    LARGEST_CLASS,
    MOSTLY,
    UNEXPLAINED,
    Verdict,
)

EXPECTED = 1.1
"""Expected error in noise floors beyond which it is said."""
MEASURE_MORE = {
    "loop": "Measure the same cycle at least three times, and at two or more other crank angles: whole positions can "
    f"then be held out, and with {FEWEST_BLOCKS} branches or more an effect can be accepted.",
    "turn": "Turn the crank at least twice in both senses, at two or more held torques: whole turns can then be held "
    f"out, and with {FEWEST_BLOCKS} of them or more an effect can be accepted.",
}
"""What to do where nothing can be held out, by what was measured."""


@dataclass(frozen=True)
class Statement:
    """What the verdict says.

    Attributes
    ----------
    sentence : for an engineer to sign; its errors are those of the cards, figures and tables.
    advice : what to measure next, or "".
    """

    sentence: str
    advice: str


def fault_statement(fatal: Sequence[Fault]) -> Statement:
    """The statement on data with which nothing can be fitted."""
    reasons = "; ".join(fault.message for fault in fatal)
    return Statement(f"The data do not support a verdict: {reasons}", "")


def stated(
    verdict: Verdict,
    selection: Selection,
    refitted: AngleError,
    best: AngleError,
    remainder: Remainder,
    in_sample: str,
) -> Statement:
    """The statement of a verdict.

    Parameters
    ----------
    refitted, best : errors of the refitted model, and of the best one whether it is claimed or not.
    remainder : what the best one leaves.
    in_sample : "loop" or "turn" where nothing but that was measured, so that nothing is held out; else "".
    """
    if in_sample:
        return Statement(_in_sample(selection, refitted, in_sample), MEASURE_MORE[in_sample])
    findings = "".join(f" {finding}." for finding in verdict.findings)
    return Statement(_sentence(verdict, selection, refitted, best, remainder) + findings, _advice(verdict))


def title_of(name: str) -> str:
    """Title of an effect, or of several joined by +."""
    return " and ".join(candidates()[part].title for part in name.split("+"))


def _error(error: AngleError) -> str:
    return f"{error.rms_arcmin:.3g} arcmin ({error.to_noise:.3g} noise floors)"


def _open(error: AngleError) -> str:
    """What a right model would leave, where that is clearly more than noise."""
    if not error.expected_to_noise > EXPECTED:
        return ""
    unknown = "the training data leave open and positions scatter by"
    return f", where {error.expected_to_noise:.3g} floors are expected of what {unknown}"


def _in_sample(selection: Selection, refitted: AngleError, measured: str) -> str:
    """One loop or turn: a description, nothing more."""
    nearest = min(selection.trials, key=lambda name: selection.trials[name].rms, default="")
    described = ""
    if nearest:
        title, floors = title_of(nearest), selection.trials[nearest].rms
        described = f" Beside it {title} describes the {measured} to {floors:.3g} floors, and is not claimed."
    return (
        f"One {measured}, fitted in sample: the model with its calibrated numbers refitted leaves {_error(refitted)}."
        f"{described} Nothing is held out, so that nothing is confirmed."
    )


def _sentence(
    verdict: Verdict, selection: Selection, refitted: AngleError, best: AngleError, remainder: Remainder
) -> str:
    if verdict.verdict == ADEQUATE:
        return (
            f"The model with its calibrated numbers refitted explains the unit: held-out error {_error(refitted)}"
            f"{_open(refitted)}."
        )
    if verdict.verdict == UNEXPLAINED and not selection.best and verdict.structure <= selection.limit:
        return f"The model explains the unit, held-out error {_error(refitted)}, but not by plausible numbers."
    if verdict.verdict == UNEXPLAINED:
        nearest = selection.answer.fit.model.name
        nearest_text = f"; the nearest, {title_of(nearest)}, leaves {_error(best)}" if nearest else ""
        return (
            f"The unit departs from the model, held-out error {_error(refitted)}, and no effect of the library "
            f"explains it{nearest_text}; nothing is claimed."
        )
    gain = f"held-out error {_error(refitted)} before and {_error(best)} after{_open(best)}"
    names = verdict.named
    numbers = ", ".join(_number(p) for p in verdict.parameters)
    if verdict.verdict == MOSTLY:
        scatter = remainder.scatter
        spread = f" ({scatter.size:.2g} arcmin of it from position to position)" if scatter and scatter.shown else ""
        return (
            f"The unit is mostly explained by {title_of(names[0])} ({numbers}): {gain}, {remainder.removed:.0%} "
            f"removed; what is left{spread} is not traced."
        )
    if verdict.verdict == IDENTIFIED:
        return f"The unit shows {title_of(names[0])} ({numbers}): {gain}."
    if len(names) > LARGEST_CLASS:
        return f"An effect is there ({gain}), but {len(names)} of the library explain it equally well: unresolved."
    titles = "; ".join(title_of(name) for name in names)
    return f"The unit shows one of these, which the data do not tell apart: {titles} ({gain})."


def _number(p: FittedParameter) -> str:
    unit = f" {p.unit}" if p.unit != "1" else ""
    if np.isnan(p.ci_low):
        return f"{p.name} = {p.value:.3g}{unit}, no interval"
    return f"{p.name} = {p.value:.3g}{unit}, {CONFIDENCE:.0%} interval {p.ci_low:.3g} to {p.ci_high:.3g}"


def _advice(verdict: Verdict) -> str:
    """What to measure next."""
    if verdict.verdict == EQUIVALENT:
        parts = [part for name in verdict.named for part in name.split("+")]
        measurements = [candidates()[part].told_apart_by for part in dict.fromkeys(parts)]
        return f"To tell them apart, measure {'; or '.join(measurements)}."
    if verdict.verdict in (MOSTLY, UNEXPLAINED):
        return "Look at the residual over torque, angle, time and crank angle: its shape names what the library lacks."
    return ""

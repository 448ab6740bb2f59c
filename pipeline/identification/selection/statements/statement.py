"""The verdict in a sentence that an engineer would sign, what to measure next, and the answer at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.selection.criteria import FEWEST_BLOCKS, LARGEST_CLASS, Selection
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.parameter_intervals import CONFIDENCE, FittedParameter
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    IDENTIFIED,
    NOT_TESTABLE,
    WITHIN,
    Verdict,
)

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

EXPECTED = 1.1
"""Expected error in noise from which it is said."""
ZONES = 12
"""Intervals of the torque, for each sense of loading, by which it is said where a misfit is largest."""
MEASURE_MORE = {
    "loop": "Measure the same cycle at least three times, and at two or more other crank angles: whole positions can "
    f"then be held out, and with {FEWEST_BLOCKS} branches or more an effect can be accepted.",
    "turn": "Turn the crank at least twice in both senses, at two or more held torques: whole turns can then be held "
    f"out, and with {FEWEST_BLOCKS} of them or more an effect can be accepted.",
}
"""What to do where nothing can be held out, by what was measured."""
CONFIRM = "To confirm it, measure two crank positions that were not used, and compare them with the corrected study."
LOWER_LIMITS = "To find smaller effects, measure more crank positions: the table of detection limits says how small."


@dataclass(frozen=True)
class Statement:
    """What the verdict says.

    Attributes
    ----------
    sentence : for an engineer to sign; its errors are those of the cards, figures and tables.
    advice : what to measure next, or "" of data with a fault.
    glance : title and text of what is read first: cause, how sure, how large, where, next candidate.
    """

    sentence: str
    advice: str
    glance: tuple[tuple[str, str], ...] = ()


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
    where: str = "",
) -> Statement:
    """The statement of a verdict.

    Parameters
    ----------
    refitted, best : errors of the refitted model, and of the best one whether it is named or not.
    remainder : what the best one leaves.
    in_sample : "loop" or "turn" where nothing but that was measured, so that nothing is held out; else "".
    where : in the loop what is named shows, or what is left.
    """
    findings = "".join(f" {finding}." for finding in verdict.findings)
    if in_sample:
        sentence = _in_sample(selection, refitted, in_sample)
    else:
        sentence = _sentence(verdict, selection, refitted, best, remainder)
    advice = MEASURE_MORE[in_sample] if in_sample else _advice(verdict, selection)
    return Statement(sentence + findings, advice, _glance(verdict, selection, remainder, where))


def title_of(name: str) -> str:
    """Title of an effect, or of several joined by +."""
    return " and ".join(candidates()[part].title for part in name.split("+"))


def place_of_largest(data: Data, change: Real, cells: Truth) -> str:
    """Where in the loop a change (n_cells,) [arcmin] of some cells (n_cells,) is largest, in words."""
    use = cells & np.isfinite(change)
    if isinstance(data, TurningData) or not np.any(use):
        return ""
    torque, sense = data.torque[use], data.senses[use] > 0
    edges = np.linspace(torque.min(), torque.max(), ZONES + 1)[1:-1]
    zone = 2 * np.searchsorted(edges, torque) + sense
    size = np.bincount(zone, (change[use] / data.sigma[use]) ** 2) / np.maximum(np.bincount(zone), 1)
    largest = int(np.argmax(size))
    at = zone == largest
    branch = "rising" if largest % 2 else "falling"
    return f"largest near {np.mean(torque[at]):.2g} N m on the branch of {branch} torque"


def _error(error: AngleError) -> str:
    return f"{error.rms_arcmin:.3g} arcmin ({error.to_noise:.3g} times the measurement noise)"


def _expected(error: AngleError) -> str:
    """What a right model would leave, where that is clearly more than noise."""
    if not error.expected_to_noise > EXPECTED:
        return ""
    return f"; a correct model would be expected to leave {error.expected_to_noise:.3g} times the noise here"


def _in_sample(selection: Selection, refitted: AngleError, measured: str) -> str:
    """One loop or turn: a description, nothing more."""
    nearest = max(selection.odds, key=lambda name: selection.odds[name], default="")
    described = ""
    if nearest:
        rms = selection.trials[nearest].rms
        described = (
            f" {title_of(nearest).capitalize()} would fit to {rms:.3g} times the noise, but one {measured} cannot"
        )
        described += " confirm it."
    return (
        f"One {measured}, fitted in sample: the model with its calibrated numbers refitted leaves {_error(refitted)}."
        f"{described} No data are left to test the fit."
    )


def _sentence(
    verdict: Verdict, selection: Selection, refitted: AngleError, best: AngleError, remainder: Remainder
) -> str:
    before = f"prediction error on unused data {_error(refitted)}"
    if verdict.verdict == ADEQUATE:
        return f"The model with refitted numbers explains the unit: {before}{_expected(refitted)}."
    if verdict.verdict == NOT_TESTABLE:
        return f"These data do not decide whether the model explains the unit: {before}{_expected(refitted)}."
    if not verdict.named:
        nearest = selection.best or selection.nearest
        share = f"removes {remainder.removed:.0%} of this error and " if remainder.removed > 0 else ""
        text = f" The nearest, {title_of(nearest)}, {share}leaves {_error(best)}." if selection.best else ""
        return (
            f"No cause named. The unit departs from the refitted model, {before}{_expected(refitted)}, and no effect "
            f"of the library explains it.{text}"
        )
    gain = f"{before} before and {_error(best)} after{_expected(best)}"
    names = verdict.named
    numbers = ", ".join(_number(p) for p in verdict.parameters)
    titles = "; ".join(title_of(name) for name in names)
    if verdict.verdict == WITHIN:
        return f"The data call for a change that the tolerances allow. Within tolerance: {titles} ({gain})."
    if verdict.verdict == IDENTIFIED:
        return f"The unit shows {titles} ({numbers}): {gain}."
    if len(names) > LARGEST_CLASS:
        return f"An effect is there ({gain}), but {len(names)} of the library explain it equally well: unresolved."
    return f"The unit shows one of these, which the data do not tell apart: {titles} ({gain})."


def _number(p: FittedParameter) -> str:
    effect = candidates().get(p.effect)
    meanings = {parameter.name: parameter.meaning for parameter in effect.parameters} if effect else {}
    size = f"{meanings.get(p.name, p.name)} {p.value:.3g}{f' {p.unit}' if p.unit != '1' else ''}"
    if np.isnan(p.ci_low):
        return f"{size}, no interval"
    return f"{size}, {100 * CONFIDENCE:g} % interval {p.ci_low:.3g} to {p.ci_high:.3g}"


def _advice(verdict: Verdict, selection: Selection) -> str:
    """What to measure next."""
    names = verdict.named
    if len(names) > 1 or verdict.verdict == WITHIN:
        return f"To tell them apart, measure {_measurements(names)}."
    if verdict.verdict == IDENTIFIED:
        return f"{CONFIRM} Independent evidence: {_measurements(names)}."
    if verdict.verdict == ADEQUATE:
        return LOWER_LIMITS
    nearest = names[0] if names else selection.best or selection.nearest
    check = f"Check first: {_measurements((nearest,))}. " if nearest else ""
    return f"{check}Measure two more crank positions: they show whether the rest is the same at each of them."


def _measurements(names: Sequence[str]) -> str:
    parts = [part for name in names for part in name.split("+")]
    return "; or ".join(candidates()[part].told_apart_by for part in dict.fromkeys(parts))


def _glance(verdict: Verdict, selection: Selection, remainder: Remainder, where: str) -> tuple[tuple[str, str], ...]:
    """What is read first."""
    names = verdict.named
    cause = "; or ".join(title_of(name) for name in names) if names else "no cause named"
    rows = [("Cause", cause)]
    if names:
        rows.append(("How sure", _sureness(selection.odds[names[0]])))
        rows.append(("How large", "; ".join(_number(p) for p in verdict.parameters)))
    if where:
        rows.append(("Where in the loop", where))
    if not names and selection.best:
        share = (
            f"removes {remainder.removed:.0%} of the error" if remainder.removed > 0 else "removes none of the error"
        )
        reason = selection.reasons[selection.best]
        rows.append(("Nearest effect", f"{title_of(selection.best)}: {share}. It is not named, because {reason}"))
    nearest = selection.nearest
    if nearest and (names or nearest != selection.best):
        rows.append(("Next candidate", f"{title_of(nearest)}: {_comparison(selection, nearest)}"))
    return tuple(rows)


def _sureness(log_odds: float) -> str:
    """Probability of "no effect" in words."""
    decades = max(log_odds, 0.0) / np.log(10)
    chance = "1 in a million" if decades >= 6 else f"1 in {10**decades:.2g}"
    return f"probability of no effect {'below ' if decades >= 6 else ''}{chance}"


def _comparison(selection: Selection, name: str) -> str:
    """How near a model came to the one that is named, or to being named."""
    reference = selection.odds[selection.claimed] if selection.claimed else 0.0
    decades = (reference - selection.odds[name]) / np.log(10)
    other = "the cause named" if selection.claimed else "no effect"
    if abs(decades) >= 6:
        return f"more than a million times {'less' if decades > 0 else 'more'} probable than {other}"
    return f"{10 ** abs(decades):.2g} times {'less' if decades > 0 else 'more'} probable than {other}"

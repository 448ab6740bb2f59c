"""The verdict in a sentence that an engineer would sign, what to measure next, and the answer at a glance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Shown
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.selection.criteria import LARGEST_CLASS, NAMED_ODDS, Selection
from pipeline.identification.selection.fitted_numbers import FittedParameter
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.statements.remainder import TORQUE_BINS, Remainder
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    IDENTIFIED,
    NOT_TESTABLE,
    WITHIN_TOLERANCE,
    Verdict,
)
from pipeline.statistics.resampling import CONFIDENCE

EXPECTED_RATIO: Shown = 1.1
"""Expected error in noise from which it is said."""
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
    first_of_kinds = {fault.kind: fault.message for fault in reversed(fatal)}
    reasons = "; ".join(reversed(first_of_kinds.values()))
    return Statement(f"The data do not support a verdict: {reasons}", "")


def statement_of_verdict(
    verdict: Verdict,
    selection: Selection,
    refit_error: AngleError,
    best_error: AngleError,
    remainder: Remainder,
    in_sample: str,
    where: str = "",
) -> Statement:
    """The statement of a verdict.

    Parameters
    ----------
    refitted, best_model : errors of the refitted model, and of the best one whether it is named or not.
    remainder : what the best one leaves.
    in_sample : "loop" or "turn" where nothing but that was measured, so that nothing is held out; else "".
    where : in the loop what is named shows, or what is left.
    """
    findings = "".join(f" {finding[0].upper()}{finding[1:]}." for finding in verdict.findings)
    if in_sample:
        sentence, advice = _in_sample(selection, refit_error, in_sample), MEASURE_MORE[in_sample]
    else:
        sentence, advice = _sentence(verdict, selection, refit_error, best_error), _advice(verdict, selection)
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
    edges = np.linspace(torque.min(), torque.max(), TORQUE_BINS + 1)[1:-1]
    zone = 2 * np.searchsorted(edges, torque) + sense
    size = np.bincount(zone, (change[use] / data.sigma[use]) ** 2) / np.maximum(np.bincount(zone), 1)
    largest_zone = int(np.argmax(size))
    in_zone = zone == largest_zone
    branch = "rising" if largest_zone % 2 else "falling"
    return f"largest near {_in_figures(float(np.mean(torque[in_zone])), 2)} N m on the branch of {branch} torque"


def _in_figures(value: float, count: int = 3) -> str:
    """A value with so many figures, in full where it is large: 13600 for 1.36e+04."""
    return f"{float(f'{value:.{count}g}'):.9g}"


def _error(error: AngleError) -> str:
    return f"{error.rms_arcmin:.3g} arcmin ({error.to_noise:.3g} times the measurement noise)"


def _expected_clause(error: AngleError) -> str:
    """What a right model would leave, where that and what is left are clearly more than noise."""
    if not min(error.expected_to_noise, error.to_noise) > EXPECTED_RATIO:
        return ""
    why = " since these data do not settle its numbers" if error.to_noise <= error.expected_to_noise else ""
    return f"; a correct model would be expected to leave {error.expected_to_noise:.3g} times the noise here{why}"


def _in_sample(selection: Selection, refit_error: AngleError, measured_text: str) -> str:
    """One loop or turn: a description, nothing more."""
    nearest_model = max(selection.odds, key=lambda name: selection.odds[name], default="")
    description = ""
    if nearest_model:
        rms = selection.trials[nearest_model].rms
        title = title_of(nearest_model).capitalize()
        description = f" {title} would fit to {rms:.3g} times the noise, but one {measured_text} cannot confirm it."
    return (
        f"One {measured_text}, fitted in sample: the model with its calibrated numbers refitted leaves "
        f"{_error(refit_error)}.{description} No data are left to test the fit."
    )


def _sentence(verdict: Verdict, selection: Selection, refit_error: AngleError, best_error: AngleError) -> str:
    error_text = f"prediction error on unused data {_error(refit_error)}"
    if verdict.verdict == ADEQUATE:
        return f"The model with refitted numbers explains the unit: {error_text}{_expected_clause(refit_error)}."
    if verdict.verdict == NOT_TESTABLE:
        expected_text = _expected_clause(refit_error)
        return f"These data do not decide whether the model explains the unit: {error_text}{expected_text}."
    if not verdict.named_effects:
        best = selection.best_model
        text = f" The nearest, {title_of(best)}, leaves {_error(best_error)}." if best else ""
        return (
            f"No cause named. The unit departs from the refitted model, {error_text}{_expected_clause(refit_error)}, "
            f"and no effect of the library explains it.{text}"
        )
    gain = f"{error_text} before and {_error(best_error)} after{_expected_clause(best_error)}"
    names = verdict.named_effects
    numbers = ", ".join(_number(p) for p in verdict.parameters)
    titles = "; ".join(title_of(name) for name in names)
    if verdict.verdict == WITHIN_TOLERANCE:
        return f"The data call for a change that the tolerances allow. Within tolerance: {titles} ({gain})."
    if verdict.verdict == IDENTIFIED:
        return f"The unit shows {titles} ({numbers}): {gain}."
    if len(names) > LARGEST_CLASS:
        return f"An effect is there ({gain}), but {len(names)} of the library are about as probable: unresolved."
    titles = "; ".join([title_of(names[0]), *(_less_probable(name, names[0], selection) for name in names[1:])])
    return f"The unit shows one of these, which the data do not distinguish: {titles} ({gain})."


def _less_probable(name: str, best_name: str, selection: Selection) -> str:
    """The title of a further member of a class, and how much less probable than the first it is."""
    ratio = np.exp(selection.odds[best_name] - selection.odds[name])
    return f"{title_of(name)}, {_rounded(ratio)} times less probable" if ratio >= 2 else title_of(name)


def _number(p: FittedParameter) -> str:
    effect = candidates().get(p.effect)
    meanings = {parameter.name: parameter.meaning for parameter in effect.parameters} if effect else {}
    size = f"{meanings.get(p.name, p.name)} {_in_figures(p.value)}{f' {p.unit}' if p.unit != '1' else ''}"
    if np.isnan(p.ci_low):
        return f"{size}, no interval"
    return f"{size}, {100 * CONFIDENCE:g} % interval {_in_figures(p.ci_low)} to {_in_figures(p.ci_high)}"


def _advice(verdict: Verdict, selection: Selection) -> str:
    """What to measure next."""
    names = verdict.named_effects
    if len(names) > 1 or verdict.verdict == WITHIN_TOLERANCE:
        return f"To distinguish them, measure {_measurements(names)}."
    if verdict.verdict == IDENTIFIED:
        return f"{CONFIRM} Independent evidence: {_measurements(names)}."
    if verdict.verdict == ADEQUATE:
        return LOWER_LIMITS
    nearest_model = names[0] if names else selection.best_model
    check = f"Check first: {_measurements((nearest_model,))}. " if nearest_model else ""
    return f"{check}Measure two more crank positions: they show whether the rest is the same at each of them."


def _measurements(names: Sequence[str]) -> str:
    """What tells the effects of a class apart, or the effects of its only member from others."""
    parts = list(dict.fromkeys(part for name in names for part in name.split("+")))
    in_all = [part for part in parts if all(part in name.split("+") for name in names)] if len(names) > 1 else []
    return "; or ".join(candidates()[part].told_apart_by for part in parts if part not in in_all)


def _glance(verdict: Verdict, selection: Selection, remainder: Remainder, where: str) -> tuple[tuple[str, str], ...]:
    """What is read first."""
    names = verdict.named_effects
    cause = "; or ".join(title_of(name) for name in names) if names else "no cause named"
    rows = [("Cause", cause)]
    if names:
        rows.append(("How sure", _sureness(selection.odds[names[0]])))
        rows.append(("How large", "; ".join(_number(p) for p in verdict.parameters)))
    if where:
        rows.append(("Where in the loop", where))
    if not names and selection.best_model:
        share = (
            f"removes {remainder.removed:.0%} of the error in measures of the noise"
            if remainder.removed > 0
            else "removes none of the error"
        )
        reason = selection.reasons[selection.best_model]
        rows.append(("Nearest effect", f"{title_of(selection.best_model)}: {share}. It is not named, because {reason}"))
    nearest_model = selection.nearest_model
    if nearest_model and (names or nearest_model != selection.best_model):
        rows.append(("Next candidate", f"{title_of(nearest_model)}: {_comparison(selection, nearest_model)}"))
    return tuple(rows)


def _sureness(log_odds: float) -> str:
    """Probability of "no effect" in words."""
    decades = max(log_odds, 0.0) / np.log(10)
    chance = "1 in a million" if decades >= 6 else f"1 in {_rounded(10**decades)}"
    return f"probability of no effect {'below ' if decades >= 6 else ''}{chance}"


def _comparison(selection: Selection, name: str) -> str:
    """How near a model came to the one that is named, or to being named."""
    reference = selection.odds[selection.claimed_model] if selection.claimed_model else 0.0
    decades = (reference - selection.odds[name]) / np.log(10)
    other_model = "the cause named" if selection.claimed_model else "no effect"
    if abs(decades) >= 6:
        return f"more than a million times {'less' if decades > 0 else 'more'} probable than {other_model}"
    if decades < 0 and not selection.claimed_model:
        other_model += f"; a name takes {np.exp(NAMED_ODDS):.0f} times"
    return f"{_rounded(10 ** abs(decades))} times {'less' if decades > 0 else 'more'} probable than {other_model}"


def _rounded(ratio: float) -> str:
    """A ratio to two digits, without an exponent."""
    return f"{float(f'{ratio:.2g}'):,.10g}"

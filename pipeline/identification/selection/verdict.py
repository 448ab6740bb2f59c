"""The verdict on a unit: what the selection says in one of six words, with parameters, errors and a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.selection.model_selection import MOST_NAMED, Selection
from pipeline.identification.selection.parameter_intervals import CONFIDENCE, FittedParameter, intervals
from pipeline.identification.selection.remainder import Remainder, remainder

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
    structure : held-out rms of the best model in noise floors.
    remainder : what the model leaves that is claimed, or the best one.
    sentence : for an engineer to sign.
    advice : what to measure next, or "".
    """

    verdict: str
    named: tuple[str, ...]
    traced: tuple[str, ...]
    parameters: tuple[FittedParameter, ...]
    structure: float
    remainder: Remainder | None
    sentence: str
    advice: str


def judge(fitter: Fitter, selection: Selection, cells: Truth) -> Verdict:
    """The verdict of a selection over ``cells`` (n_cells,)."""
    chosen, members = selection.chosen, selection.members
    left = chosen.rms > selection.limit or chosen.fit.model.n_effects > MOST_NAMED
    if left:
        chosen = selection.trials[selection.claimed] if selection.claimed else chosen
        members = (selection.claimed,) if _mostly(selection) else ()
        verdict = MOSTLY if members else UNEXPLAINED
    elif members:
        verdict = IDENTIFIED if len(members) == 1 else EQUIVALENT
    else:
        verdict = ADEQUATE
    named, structure = members, chosen.rms
    parameters = tuple(
        p for name in named for p in intervals(fitter, selection.trials[name].fit, cells, selection.base.rms)
    )
    return Verdict(
        verdict,
        named,
        _traced(selection),
        parameters,
        structure,
        rest := remainder(fitter.problem.data, chosen.fit.predicted, cells, structure, selection.base.rms),
        _sentence(verdict, named, parameters, rest, selection),
        _advice(verdict, named, selection),
    )


def _mostly(selection: Selection) -> bool:
    """Whether effects are claimed although structure is left."""
    if not selection.claimed:
        return False
    return selection.trials[selection.claimed].rms <= (1 - MOSTLY_REMOVED) * selection.base.rms


def _traced(selection: Selection) -> tuple[str, ...]:
    alone = [name for name in selection.survivors if "+" not in name]
    return tuple(dict.fromkeys([*filter(None, selection.best.split("+")), *alone]))


def _titles(named: Sequence[str]) -> list[str]:
    known = candidates()
    return [" and ".join(known[part].title for part in name.split("+")) for name in named]


def _sentence(
    verdict: str, named: Sequence[str], parameters: Sequence[FittedParameter], rest: Remainder, selection: Selection
) -> str:
    """One sentence that an engineer would sign."""
    before, structure = selection.base.rms, rest.structure
    if verdict == ADEQUATE:
        return f"The model with its calibrated numbers refitted explains the unit to {structure:.2f} noise floors."
    if verdict == UNEXPLAINED:
        traced = f" (the nearest, {_titles([selection.best])[0]}, is not enough)" if selection.best else ""
        return (
            f"The unit departs from the model by {before:.2f} noise floors and no effect of the library explains it"
            f"{traced}: {structure:.2f} floors of structure are left; nothing is claimed."
        )
    numbers = ", ".join(_number(p) for p in parameters)
    if verdict == MOSTLY:
        apart = f", {rest.by_position_arcmin:.2g} arcmin of it from position to position"
        return (
            f"The unit is mostly explained by {_titles(named)[0]} ({numbers}): {rest.removed:.0%} of the error is "
            f"removed; what is left ({structure:.1f} noise floors, {rest.rms_arcmin:.2g} arcmin"
            f"{apart if np.isfinite(rest.by_position_arcmin) else ''}) is not traced."
        )
    gain = f"held-out error {before:.2f} before and {structure:.2f} noise floors after"
    if verdict == IDENTIFIED:
        return f"The unit shows {_titles(named)[0]} ({numbers}): {gain}."
    if len(named) > LARGEST_CLASS:
        return f"An effect is there ({gain}), but {len(named)} of the library explain it equally well: unresolved."
    return f"The unit shows one of these, which the data do not tell apart: {'; '.join(_titles(named))} ({gain})."


def _number(p: FittedParameter) -> str:
    unit = f" {p.unit}" if p.unit != "1" else ""
    if np.isnan(p.ci_low):
        return f"{p.name} = {p.value:.3g}{unit}, no interval"
    return f"{p.name} = {p.value:.3g}{unit}, {CONFIDENCE:.0%} interval {p.ci_low:.3g} to {p.ci_high:.3g}"


def _advice(verdict: str, named: Sequence[str], selection: Selection) -> str:
    """What to measure next."""
    if verdict == EQUIVALENT:
        parts = [part for name in named for part in name.split("+")]
        measurements = [candidates()[part].told_apart_by for part in dict.fromkeys(parts)]
        return f"To tell them apart, measure {'; or '.join(measurements)}."
    if verdict in (MOSTLY, UNEXPLAINED):
        return "Look at the residual over torque, angle, time and crank angle: its shape names what the library lacks."
    return ""

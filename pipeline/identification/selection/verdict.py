"""The verdict on a unit: what the selection says in one of six words, with parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.selection.model_selection import MOST_NAMED, Selection
from pipeline.identification.selection.parameter_intervals import FittedParameter, intervals

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
    """

    verdict: str
    named: tuple[str, ...]
    traced: tuple[str, ...]
    parameters: tuple[FittedParameter, ...]
    structure: float


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
    return Verdict(verdict, named, _traced(selection), parameters, structure)


def _mostly(selection: Selection) -> bool:
    """Whether effects are claimed although structure is left."""
    if not selection.claimed:
        return False
    return selection.trials[selection.claimed].rms <= (1 - MOSTLY_REMOVED) * selection.base.rms


def _traced(selection: Selection) -> tuple[str, ...]:
    alone = [name for name in selection.survivors if "+" not in name]
    return tuple(dict.fromkeys([*filter(None, selection.best.split("+")), *alone]))

"""The verdict on a unit: what the selection says in one of five words, with parameters, errors and a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, mapped
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.selection.model_selection import FORM, MOST_NAMED, Selection
from pipeline.statistics.blocks import resampled_means

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

ADEQUATE, IDENTIFIED, EQUIVALENT, UNEXPLAINED, FAULT = (
    "adequate",
    "identified",
    "equivalent",
    "unexplained",
    "data fault",
)
LARGEST_CLASS = 3
"""Effects in a class beyond which it counts as unresolved."""
RESAMPLES = 400
CONFIDENCE = 0.95
SEED = 79


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


@dataclass(frozen=True)
class Verdict:
    """What is said of a unit.

    Attributes
    ----------
    verdict : one of the five words.
    named : the effect (several joined by + act together), or the class of effects that the data do not tell apart.
    traced : effects of the best model, then those that explain a significant part alone, named or not.
    parameters : of the named effects.
    structure : held-out rms of the best model in noise floors.
    sentence : for an engineer to sign.
    advice : what to measure next, or "".
    """

    verdict: str
    named: tuple[str, ...]
    traced: tuple[str, ...]
    parameters: tuple[FittedParameter, ...]
    structure: float
    sentence: str
    advice: str


def judge(fitter: Fitter, selection: Selection, cells: Truth) -> Verdict:
    """The verdict of a selection over ``cells`` (n_cells,)."""
    chosen = selection.chosen
    structure = chosen.rms
    left = structure > selection.limit or chosen.fit.model.n_effects > MOST_NAMED
    members = selection.members
    if left or len(members) > LARGEST_CLASS:
        verdict = UNEXPLAINED if left else EQUIVALENT
    elif members:
        verdict = IDENTIFIED if len(members) == 1 else EQUIVALENT
    else:
        verdict = ADEQUATE
    named = () if verdict in (UNEXPLAINED, ADEQUATE) else members
    parameters = tuple(
        p for name in named for p in intervals(fitter, selection.trials[name].fit, cells, selection.base.rms)
    )
    return Verdict(
        verdict,
        named,
        _traced(selection),
        parameters,
        structure,
        _sentence(verdict, named, parameters, structure, selection),
        _advice(verdict, named, selection),
    )


def _traced(selection: Selection) -> tuple[str, ...]:
    alone = [name for name in selection.survivors if "+" not in name]
    return tuple(dict.fromkeys([*filter(None, selection.best.split("+")), *alone]))


def intervals(fitter: Fitter, fit: Fit, cells: Truth, before: float) -> tuple[FittedParameter, ...]:
    """Parameters of a fit with intervals of a bootstrap of the score, each resample one Newton step from the optimum.

    Notes
    -----
    Drawn are branches with all their cycles: a fault of the model's form is the same in every cycle of a branch, and
    more cycles tell no more of it. What the priors hold (tolerances, calibrated numbers) is drawn from them.
    """
    data, bounds = fitter.problem.data, fitter.bounds(fit.model)
    penalty = fitter.penalty(fit.unknowns)
    rows = fit.jacobian[cells] / fit.sigma[cells][:, None]
    misfit = ((data.angle - fit.predicted) / fit.sigma)[cells]
    _, block = np.unique(data.branch[cells], return_inverse=True)
    n_blocks, k = int(block.max()) + 1, rows.shape[1]
    products = np.zeros((n_blocks, k, k + 1))
    for b in range(n_blocks):
        mine = rows[block == b]
        products[b, :, :k], products[b, :, k] = mine.T @ mine, mine.T @ misfit[block == b]
    drawn = n_blocks * resampled_means(products, RESAMPLES, SEED)
    drawn[:, :, k] += penalty * np.random.default_rng(SEED).standard_normal((RESAMPLES, k))
    whole = products[:, :, :k].sum(axis=0)
    hessian = whole + np.diag(penalty**2) + 1e-9 * np.trace(whole) / max(k, 1) * np.eye(k)
    steps = np.linalg.solve(hessian, (drawn[:, :, k] - penalty**2 * fit.unknowns.flat).T).T
    first = len(fit.unknowns.scales)
    own = slice(first, first + len(fit.unknowns.shares))
    tails = 50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)
    # about the median step, which is not zero where a bound or the last steps of the fit hold it;
    # few branches: their spread is widened as Student's t is over the normal distribution
    spread = (steps - np.median(steps, axis=0))[:, own] * _student(n_blocks)
    form = norm.ppf(0.5 * (1 + CONFIDENCE)) * FORM * before
    form = form * np.sqrt(len(misfit) * np.diag(np.linalg.inv(hessian))[own])
    low, high = (
        fit.unknowns.shares + sense * np.hypot(np.percentile(spread, tail, axis=0), form)
        for sense, tail in zip((-1, 1), tails, strict=True)
    )
    values = [mapped(bounds, np.clip(one, 0, 1)) for one in (fit.unknowns.shares, low, high)]
    found = []
    number = -1
    for effect in fit.model.effects:
        for parameter in effect.parameters:
            number += 1
            at_bound = not 1e-6 < fit.unknowns.shares[number] < 1 - 1e-6
            note = "at the bound of what the library allows: no interval" if at_bound else ""
            value, ci_low, ci_high = (float(one[number]) for one in values)
            if at_bound:
                ci_low = ci_high = float("nan")
            found.append(FittedParameter(effect.name, parameter.name, parameter.unit, value, ci_low, ci_high, note))
    return tuple(found)


def _student(n_blocks: int) -> float:
    """How much wider an interval is for the few blocks that it rests on."""
    tail = 0.5 * (1 + CONFIDENCE)
    return float(student.ppf(tail, max(n_blocks - 1, 2)) / norm.ppf(tail))


def _titles(named: Sequence[str]) -> list[str]:
    known = candidates()
    return [" and ".join(known[part].title for part in name.split("+")) for name in named]


def _sentence(
    verdict: str, named: Sequence[str], parameters: Sequence[FittedParameter], structure: float, selection: Selection
) -> str:
    """One sentence that an engineer would sign."""
    before = selection.base.rms
    if verdict == ADEQUATE:
        return f"The model with its calibrated numbers refitted explains the unit to {structure:.2f} noise floors."
    if verdict == UNEXPLAINED:
        traced = f" (the nearest, {_titles([selection.best])[0]}, is not enough)" if selection.best else ""
        return (
            f"The unit departs from the model by {before:.2f} noise floors and no effect of the library explains it"
            f"{traced}: {structure:.2f} floors of structure are left; nothing is claimed."
        )
    gain = f"held-out error {before:.2f} before and {structure:.2f} noise floors after"
    if verdict == IDENTIFIED:
        numbers = ", ".join(_number(p) for p in parameters)
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
    if verdict == UNEXPLAINED:
        return "Look at the residual over torque, angle, time and crank angle: its shape names what the library lacks."
    return ""

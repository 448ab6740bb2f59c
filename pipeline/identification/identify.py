"""The loop on one unit: read, judge the data, refit, try the effects, judge, report errors on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.study import Study
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, Problem, candidates
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.selection.cross_validation import conditioned, groups, predicted_by_folds
from pipeline.identification.selection.model_selection import MOST_EFFECTS, MOST_NAMED, Selection, Selector
from pipeline.identification.selection.verdict import FAULT, Verdict, judge

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]
Condensed = Callable[[Study, Sequence[float]], Sequence[Real]]
"""Compliances of a study's design at crank angles [deg]: each (n_contacts, n_contacts) [mm/N]."""


@dataclass(frozen=True)
class Curves:
    """Predictions of the cells [arcmin] (n_cells,), each by a fit that has not seen it; NaN where there is none."""

    declared: Real
    recalibrated: Real
    after: Real


@dataclass(frozen=True)
class FaultyUnit:
    """A unit whose data have a fatal fault: nothing is known of it but its rows and what is wrong with them."""

    measurement: Measurement
    verdict: Verdict


@dataclass(frozen=True)
class Identification:
    """All that is known of a unit at the end.

    Attributes
    ----------
    why_not : by name of each effect that the data cannot test, why.
    held_out : (n_cells,) cells on which the errors are reported.
    curves : predictions there: declared, recalibrated, with the chosen model.
    """

    measurement: Measurement
    verdict: Verdict
    problem: Problem
    selection: Selection
    why_not: Mapping[str, str]
    held_out: Truth
    curves: Curves


def identify(unit: UnitFile, condensed: Condensed, nested: bool = True) -> Identification | FaultyUnit:
    """From a unit's files to its verdict.

    Parameters
    ----------
    condensed : compliances of the unit's design at its crank angles.
    nested : choose the model anew in every outer fold, so that the errors reported know nothing of the cells they are
        of; else the folds refit the model that was chosen on all cells.

    Raises
    ------
    InputError : as ``read_rows`` and ``training_rows``.
    """
    measurement = Measurement.read(unit)
    if measurement.fatal:
        return FaultyUnit(measurement, _fault_verdict(measurement))
    fitter = Fitter(build_problem(measurement, condensed(unit.study, measurement.rows.cranks.tolist())))
    everything = np.ones(len(fitter.problem.data), bool)
    split, given = measurement.training_cells, bool(unit.settings.held_out.train)
    seen = split if given else everything
    selector = Selector(fitter, seen, MOST_EFFECTS if nested else MOST_NAMED)
    selection = _selected(selector, seen)
    held_out, curves = _held_out(selector, selection, seen, everything, nested)
    reasons = {name: fitter.problem.why_not(effect, seen) for name, effect in candidates().items()}
    return Identification(
        measurement,
        judge(fitter, selection, seen),
        fitter.problem,
        selection,
        {name: reason for name, reason in reasons.items() if reason},
        held_out,
        curves,
    )


def _selected(selector: Selector, seen: Truth) -> Selection:
    """The selection on some cells; with further effects where one leaves structure."""
    return selector.extended(selector.select(seen), seen)


def _held_out(
    selector: Selector, selection: Selection, seen: Truth, everything: Truth, nested: bool
) -> tuple[Truth, Curves]:
    """Cells that judge, and their predictions by fits without them."""
    fitter, data = selector.fitter, selector.problem.data
    plain = fitter.predict(Model(), fitter.start(Model())).angle
    if not np.all(seen):
        left = everything & ~seen
        declared = plain + fitter.offsets(plain, seen, data.sigma)
        return left, Curves(declared, selection.base.fit.predicted, selection.chosen.fit.predicted)
    declared, after = np.full(len(data), np.nan), np.full(len(data), np.nan)
    group = groups(data, seen)
    for one in np.unique(group):
        left = group == one
        declared[left] = (plain + fitter.offsets(plain, ~left, data.sigma))[left]
        if nested:
            inner = selector.select(~left, tuple(selection.trials))
            after[left] = conditioned(fitter, inner.chosen.fit, ~left, left)
    recalibrated = predicted_by_folds(fitter, selection.base.fit, everything)
    chosen = after if nested else predicted_by_folds(fitter, selection.chosen.fit, everything)
    return everything, Curves(declared, recalibrated, chosen)


def _fault_verdict(measurement: Measurement) -> Verdict:
    why = "; ".join(fault.message for fault in measurement.fatal)
    return Verdict(FAULT, (), (), (), float("nan"), None, f"The data do not support a verdict: {why}", "")

"""The loop on one unit: read, judge the data, refit, try the effects, judge, report errors on held-out data."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline.arrays import Real, Truth
from pipeline.identification.fitting.condensed_problem import Condensed, condensed_problem, error_between_cranks
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import Problem, candidates
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import read_measurement
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.measurement.unit_sections import NEITHER
from pipeline.identification.selection.baselines import METHODS, TURN_METHODS, Cycles, baselines
from pipeline.identification.selection.criteria import (
    NAMED_ODDS,
    NO_EFFECT_LEFT,
    ODDS,
    Selection,
    Trial,
    prior_log_odds,
    without_names,
)
from pipeline.identification.selection.held_out import (
    AngleError,
    Folds,
    angle_error,
    failed_test,
    predicted_folds,
    splits_of,
)
from pipeline.identification.selection.model_selection import LARGEST_GAIN, Selector
from pipeline.identification.selection.statements.detection import DetectionLimit, detection_limits
from pipeline.identification.selection.statements.discrepancy import Discrepancy, discrepancy_of
from pipeline.identification.selection.statements.remainder import Remainder, remainder
from pipeline.identification.selection.statements.statement import (
    Statement,
    fault_statement,
    place_of_largest,
    statement_of_verdict,
)
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    FAULT,
    UNEXPLAINED,
    Verdict,
    judge,
    verdict_without_test,
)
from pipeline.model.compiled import Decorator

SENSE = (
    "torque and angle are taken with the other sign, which is more probable by {gain:.0f} (natural logarithm of the "
    "odds); check which sense the bench counts as positive and, at a locked output, the sign of the ratio; then "
    "reverse both columns"
)
"""Note on data whose sense is the other one."""

one_thread: Decorator = threadpool_limits.wrap(limits=1)
"""Matrices are small: threads would wait for each other, and move last digits."""


@dataclass(frozen=True)
class FaultyUnit:
    """A unit whose data have a fatal fault: nothing is known of it but its rows and what is wrong with them."""

    measurement: Measurement
    verdict: Verdict
    statement: Statement


@dataclass(frozen=True)
class Identification:
    """All that is known of a unit at the end.

    Attributes
    ----------
    why_not : by name of each effect that the data cannot test, why.
    folds : predictions of held-out cells.
    errors : of these, by stage: declared, recalibrated, after.
    baselines : errors on the same cells of predictions that ask no reducer, by title.
    between_cranks : where the crank turns within the loops, the largest error of the angle in the middle between two
        crank angles that the model was condensed at [arcmin]; None where it is held.
    could_hide : where nothing is named, the sizes of each effect that would be noticed, and named.
    remainder : what the most probable model leaves on these cells.
    discrepancy : structure in what the most probable model leaves of the cells fitted; None where nothing is left.
    """

    measurement: Measurement
    verdict: Verdict
    statement: Statement
    problem: Problem
    selection: Selection
    why_not: Mapping[str, str]
    folds: Folds
    errors: Mapping[str, AngleError]
    baselines: Mapping[str, AngleError]
    remainder: Remainder
    discrepancy: Discrepancy | None
    could_hide: tuple[DetectionLimit, ...]
    between_cranks: float | None

    @property
    def curves(self) -> dict[str, Real]:
        """Predictions (n_cells,) [arcmin] of the held-out cells by stage."""
        return {stage: curve for stage, (curve, _) in self.folds.curves(bool(self.verdict.named_effects)).items()}


def identify(unit: UnitFile, condense: Condensed) -> Identification | FaultyUnit:
    """From a unit's files to its verdict; see ``identify_measured``."""
    return identify_measured(read_measurement(unit), condense)


@one_thread
def identify_measured(measurement: Measurement, condense: Condensed) -> Identification | FaultyUnit:
    """From a measurement to the verdict on its unit.

    Parameters
    ----------
    condense : compliances of the unit's design at its crank angles.

    Raises
    ------
    InputError : as ``training_rows``.
    """
    if measurement.fatal:
        return FaultyUnit(measurement, Verdict(FAULT), fault_statement(measurement.fatal))
    measurement, is_training, selector, selection = _selected(measurement, condense)
    fitter, data, cranks = selector.fitter, selector.problem.data, measurement.rows.cranks
    baseline_curves = _baseline_curves(measurement, fitter, is_training)
    selection, verdict, folds = _tested_on_unused_data(selector, selection, is_training, baseline_curves)
    verdict = replace(verdict, findings=(*verdict.findings, *(note.message for note in measurement.notes)))
    recalibration_error = angle_error(data, cranks, *folds.curves(False)["recalibrated"], folds.cells)
    best_error = angle_error(data, cranks, folds.best_curve, folds.open_best, folds.cells)
    turns, answer = isinstance(data, TurningData), selection.answer.fit
    has_names = bool(verdict.named_effects)
    errors = {stage: angle_error(data, cranks, *curve, folds.cells) for stage, curve in folds.curves(has_names).items()}
    structure_left = remainder(data, folds.best_curve, folds.cells, best_error.to_noise, recalibration_error.to_noise)
    has_limits = not has_names and not folds.in_sample
    in_sample = ("turn" if turns else "loop") if folds.in_sample else ""
    shown_curve = (folds.best_curve if has_names else data.angle) - folds.recalibrated_curve
    where = place_of_largest(data, shown_curve, folds.cells)
    known_curves = {title: (curve, np.zeros(len(data))) for title, curve in baseline_curves.items()}
    reasons = {name: fitter.problem.why_not(effect, is_training) for name, effect in candidates().items()}
    return Identification(
        measurement=measurement,
        verdict=verdict,
        statement=statement_of_verdict(
            verdict, selection, recalibration_error, best_error, structure_left, in_sample, where
        ),
        problem=fitter.problem,
        selection=selection,
        why_not={name: reason for name, reason in reasons.items() if reason},
        folds=folds,
        errors=errors,
        baselines={title: angle_error(data, cranks, *curve, folds.cells) for title, curve in known_curves.items()},
        remainder=structure_left,
        discrepancy=discrepancy_of(fitter, answer, measurement.cells.direction, is_training)
        if verdict.verdict == UNEXPLAINED and not turns
        else None,
        could_hide=_sizes_that_could_hide(selector, selection, verdict) if has_limits else (),
        between_cranks=error_between_cranks(measurement, condense, fitter, answer.model, answer.unknowns),
    )


def _sizes_that_could_hide(selector: Selector, selection: Selection, verdict: Verdict) -> tuple[DetectionLimit, ...]:
    """The sizes of each effect that would be noticed and named; none would be named beside structure that is left.

    What no effect of the library explains refuses every name: a discrepancy describes it as well, and unused data fail.
    """
    limits = detection_limits(selector.fitter, selection.base, selector.testable)
    return tuple(replace(limit, named=np.nan) for limit in limits) if verdict.verdict == UNEXPLAINED else limits


def _problem_of(measurement: Measurement, condense: Condensed) -> tuple[Truth, Problem]:
    """Cells (n_cells,) that a fit may see, and the problem of a measurement."""
    has_training = bool(measurement.unit.settings.held_out.train)
    is_training = measurement.training_cells if has_training else np.ones(len(measurement.cells), bool)
    return is_training, condensed_problem(measurement, condense, is_training)


def _selected(measurement: Measurement, condense: Condensed) -> tuple[Measurement, Truth, Selector, Selection]:
    """The measurement with the more probable sign of torque and angle, and the selection on it.

    Between them the cells (n_cells,) to which models are fitted, and the selector that made the selection. The signs
    are compared after the selection: an effect may be more probable with the declared sign than none with the other.
    """
    cells, problem = _problem_of(measurement, condense)
    selector, selection = _best_selection(Selector(Fitter(problem), cells), cells)
    sense = _other_sense(measurement, condense, selection)
    if sense:
        return _selected(measurement.in_other_sense(sense), condense)
    return measurement, cells, selector, selection


def _other_sense(measurement: Measurement, condense: Condensed, selection: Selection) -> Fault | None:
    """A note that torque and angle have the other sign, if the models of a selection say so; else None.

    The most probable model and that without effects are fitted with the other sign. The two signs can be distinguished
    if the dimensions were measured, or if the crank turns within the loops, because errors of the parts act on one side
    of a flank. Like a name, the other sign takes odds of 999 to 1, and the model may then leave no more than its form:
    if neither sign fits, the errors of the model would decide.
    """
    settings = measurement.unit.settings
    differ = measurement.unit.dimensions is not None or settings.crank.moves != "fixed"
    if settings.locked == NEITHER or measurement.notes or not differ:
        return None
    cells, problem = _problem_of(measurement.in_other_sense(), condense)
    other = Selector(Fitter(problem), cells)
    models = {trial.fit.model.name: trial.fit for trial in (selection.base, selection.answer)}
    fits = [fit for fit in (_fit_from(known, other.fitter, cells) for known in models.values()) if fit.sound]
    if not fits:
        return None
    trials = [other.trial(fit, other.tries(cells).covariance) for fit in fits]
    there = [replace(trial, evidence=trial.evidence.without_promise()) for trial in trials]
    best = max(there, key=lambda trial: _log_posterior(trial, other))
    gain = _log_posterior(best, other) - _log_posterior(selection.answer, other)
    is_explained = best.evidence.structure.size <= NO_EFFECT_LEFT
    return Fault("sense", SENSE.format(gain=gain), "note") if is_explained and gain > NAMED_ODDS else None


def _fit_from(known: Fit, fitter: Fitter, cells: Truth) -> Fit:
    """The model of a fit to torque and angle of the other sign, fitted from the same numbers."""
    model, unknowns = known.model, known.unknowns
    zero = fitter.centre(model, unknowns)[len(unknowns.scales) :][: len(unknowns.shares)]
    starts = [
        replace(fitter.start(model, np.clip(zero + sign * (unknowns.shares - zero), 0, 1)), scales=unknowns.scales)
        for sign in ((1, -1) if model.effects else (1,))
    ]
    return fitter.fit_from_best(model, cells, starts)


def _log_posterior(trial: Trial, selector: Selector) -> float:
    """Logarithm of the probability of a trial's model beside those of other numbers of effects, up to a constant."""
    return trial.evidence.value + prior_log_odds(trial.fit.model.n_effects, len(selector.testable))


def _best_selection(selector: Selector, cells: Truth) -> tuple[Selector, Selection]:
    """The selection on cells (n_cells,), and the selector that made it.

    Where contacts on a part of the width make the answer, or the model without effects, more probable, everything is
    tried again with their ranges, so that no compliance is named in their place.
    """
    selection, problem = selector.select(cells), selector.problem
    base, answer = selection.base, selection.answer
    is_close = bool(selection.members) and selection.odds[selection.claimed_model] <= LARGEST_GAIN
    if not is_close and not any(_is_held_by_range(problem, trial.fit) for trial in (base, answer)):
        return selector, selection
    short_contacts = Selector(Fitter(problem.with_short_contacts()), cells)
    start = replace(answer.fit.unknowns, reach=problem.short_range)
    fits = short_contacts.recalibrate(cells), short_contacts.fitter.fit(answer.fit.model, cells, start)
    rivals = [
        (short_contacts.trial(fit, base.evidence.covariance, known), known)
        for fit, known in zip(fits, (base, answer), strict=True)
        if fit.sound
    ]
    is_better = any(
        short_contacts.at_most_probable(rival).evidence.value - known.evidence.without_promise().value > ODDS
        for rival, known in rivals
    )
    return (short_contacts, short_contacts.select(cells)) if is_better else (selector, selection)


def _is_held_by_range(problem: Problem, fit: Fit) -> bool:
    """Whether wider ranges, as of contacts on a part of the width, could make a fit more probable by half of ``ODDS``.

    That is what the priors of the factors with such ranges cost a fit. A factor at the end of its range costs more.
    """
    is_wider = np.any(problem.short_range != problem.scale_range, axis=0)
    deviations = (fit.unknowns.scales / problem.scale_spread)[is_wider]
    return float(deviations @ deviations) > ODDS


def _tested_on_unused_data(
    selector: Selector, selection: Selection, is_training: Truth, baseline_curves: Mapping[str, Real]
) -> tuple[Selection, Verdict, Folds]:
    """Verdict and folds of a selection; names and ``adequate`` are withdrawn where unused data are missed."""
    verdict = judge(selector.fitter, selection, is_training)
    folds = predicted_folds(selector, selection, is_training)
    if not (verdict.named_effects or verdict.verdict == ADEQUATE):
        return selection, verdict, folds
    reason = failed_test(selector.problem.data, folds, baseline_curves, selection.limit)
    if reason and verdict.named_effects:
        selection = without_names(selection, reason)
        verdict = judge(selector.fitter, selection, is_training)
        folds = predicted_folds(selector, selection, is_training)
    elif reason:
        verdict = verdict_without_test(verdict, reason, testable=not folds.in_sample)
    return selection, verdict, folds


def _baseline_curves(measurement: Measurement, fitter: Fitter, is_training: Truth) -> Mapping[str, Real]:
    """Predictions (n_cells,) [arcmin] without a reducer, by title, at the cells that judge."""
    data, cells = fitter.problem.data, measurement.cells
    cycles = Cycles(cells.direction, measurement.branches.kind[cells.block])
    methods = TURN_METHODS if isinstance(data, TurningData) else METHODS
    return baselines(data, cycles, splits_of(data, is_training), fitter.offsets, methods)

"""A model that was chosen is fitted to a fold as well as it can be, whatever stands in for its effect beside it."""

import numpy as np
import pytest
from synthetic_unit import CRANKS, Bench, exactly_known, make_unit, problem_of

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Vector, shares_of_values
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection.held_out import _from_fit_of_all, failed_test, predicted_folds
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.screening import _by_sense


@pytest.mark.parametrize(
    ("name", "values", "position"),
    [
        ("preload", (9.0,), 1),
        pytest.param("ovality_3", (-8.0, 8.0), 2, marks=pytest.mark.attack),
        ("flank_wear", (15.0,), 0),
    ],
)
@pytest.mark.long
def test_a_fold_ends_where_a_fit_from_the_truth_does(name, values, position, tmp_path, condensed):
    """Numbers and tolerances of the base take up much of the first two: from there alone fits end at several times."""
    unit = make_unit(tmp_path / "u", {name: values}, Bench(cranks=CRANKS, noise=0.005), condensed)
    problem = problem_of(unit, condensed)
    training, model = problem.data.position != position, Model((candidates()[name],))
    fold = Selector(Fitter(problem), np.ones(len(problem.data), bool)).trained_on(training)
    fitter = fold.fitter
    base = fitter.fit(Model(), training, fitter.start(Model()))
    reference = fitter.fit(model, training, fitter.start(model, shares_of_values(fitter.bounds(model), values)))
    assert base.cost > 2 * reference.cost
    refit = fold.refit(model, training, base)
    assert refit.cost < 1.05 * reference.cost
    np.testing.assert_allclose(refit.values, reference.values, rtol=0.1)


@pytest.mark.long
def test_of_two_solutions_that_a_fold_does_not_tell_apart_that_of_all_cells_is_taken(tmp_path, condensed):
    """Two positions hold two phases of a second harmonic equally well, and the other one misses the third by far."""
    effects = {"crank_compliance_2": (0.009, 0.025)}
    unit = make_unit(tmp_path / "u", effects, Bench(cranks=CRANKS, noise=0.01), condensed)
    problem = problem_of(unit, condensed)
    everything = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), everything)
    selector.testable = {"crank_compliance_2": selector.testable["crank_compliance_2"]}
    selection = selector.select(everything)
    assert selection.members == ("crank_compliance_2",)
    assert selection.trials["crank_compliance_2"].is_refined
    folds = predicted_folds(selector, selection, everything)
    assert failed_test(problem.data, folds, {}, selection.limit) == ""


@pytest.mark.long
def test_positions_that_are_left_out_are_predicted_with_their_own_phase_of_a_ripple(tmp_path, condensed):
    effects = {"motor_cogging": (0.1, 0.05, 40_000.0, 4.5, 8.0)}
    unit = make_unit(tmp_path / "u", effects, Bench(cranks=CRANKS, rows=100, noise=0.01), condensed)
    problem = exactly_known(problem_of(unit, condensed))
    everything = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), everything)
    selector.testable = {"motor_cogging": selector.testable["motor_cogging"]}
    selection = selector.select(everything)
    assert selection.members == ("motor_cogging",)
    folds = predicted_folds(selector, selection, everything)
    error = (problem.data.angle - folds.tested_curve) / problem.data.sigma
    is_beside_play = np.abs(problem.data.torque) < 0.3  # the ripple, of 0.11 N m, decides on which side of it a row is
    assert np.sqrt(np.mean(error[folds.cells & ~is_beside_play] ** 2)) < 1.2
    assert folds.open_square < 10  # by the tolerances; 300 if the phase were left open


def test_a_fit_of_all_cells_keeps_its_values_in_a_fold_of_other_bounds(tmp_path, condensed):
    """The waves of a ripple are bounded by the range of the angle and by the rows that resolve them."""
    values = (0.1, 0.05, 40_000.0, 4.5, 8.0)
    unit = make_unit(tmp_path / "u", {"motor_cogging": values}, Bench(cranks=CRANKS, rows=100, noise=0.01), condensed)
    problem = exactly_known(problem_of(unit, condensed))
    everything, torque = np.ones(len(problem.data), bool), np.abs(problem.data.torque)
    selector, training = Selector(Fitter(problem), everything), torque < 0.7 * np.max(torque)
    effect = selector.testable["motor_cogging"]
    model, fold = Model((effect,)), selector.trained_on(training)
    assert fold.fitter.bounds(model)[2][1] < 0.9 * selector.fitter.bounds(model)[2][1]
    truth = selector.fitter.start(model, shares_of_values(selector.fitter.bounds(model), values))
    fit_of_all = selector.fitter.fit(model, everything, truth, 0)
    fit = _from_fit_of_all(fold, fit_of_all, training, None)
    np.testing.assert_allclose(fit.values[2:], values[2:], rtol=0.01)
    assert fit.cost < 1.2 * np.sum(training)


def test_the_best_start_of_each_sense_comes_before_the_others():
    bounds = ((-1.0, 1.0), (-1.0, 1.0))
    places = [(0.1, 0.2), (0.2, 0.1), (-0.3, 0.1), (0.4, 0.4), (-0.1, -0.2), (0.0, 0.3)]
    starts = [Vector(np.zeros(0), shares_of_values(bounds, place), np.zeros(0)) for place in places]
    ranks = {id(start): rank for rank, start in enumerate(starts)}
    assert [ranks[id(start)] for start in _by_sense(starts, bounds)] == [0, 2, 4, 1, 3, 5]

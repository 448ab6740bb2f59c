"""The test that ``adequate`` and every name have to pass."""

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_unit import CRANKS, Bench, make_unit, problem_of

from pipeline.identification.bench import simulator
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model
from pipeline.identification.selection.covariance import Covariance, parts_of
from pipeline.identification.selection.criteria import Selection
from pipeline.identification.selection.held_out import (
    _added_squares,
    _fold,
    _left_open,
    failed_test,
    precision_of,
    splits_of,
)
from pipeline.identification.selection.model_selection import Selector

RNG = np.random.default_rng(4)
BLOCKS, CELLS, SIGMA, LEVEL = 24, 20, 0.2, 3.0
N = BLOCKS * CELLS


def outcome(missed, curves=None, open_share=0.0, in_sample=False, form=0.3):
    """Why a model fails whose predictions miss by so much [noise] beside a variance that was left open [noise^2]."""
    block = np.repeat(np.arange(BLOCKS), CELLS)
    data = SimpleNamespace(angle=LEVEL + SIGMA * missed, sigma=np.full(N, SIGMA), block=block)
    folds = SimpleNamespace(
        cells=np.ones(N, bool),
        tested_curve=np.full(N, LEVEL),
        added_squares=float(missed @ missed) / (1 + open_share),
        open_square=open_share,
        in_sample=in_sample,
    )
    return failed_test(data, folds, curves or {}, form)


def test_noise_passes_and_what_no_right_model_leaves_does_not():
    noise = RNG.standard_normal(N)
    assert outcome(noise) == ""
    assert "1.5 times what a right model" in outcome(1.5 * noise / np.std(noise))
    assert outcome(1.5 * noise / np.std(noise), open_share=1.5) == ""
    assert outcome(np.full(N, np.nan))


def test_the_form_of_the_model_may_add_its_own_square_and_no_more():
    noise = RNG.standard_normal(N)
    assert outcome(1.2 * noise / np.std(noise), form=0.75) == ""
    assert outcome(1.15 * noise / np.std(noise), form=0.3)


def test_noise_alone_fails_in_few_draws():
    failures = sum(bool(outcome(RNG.standard_normal(N), form=0.0)) for _ in range(300))
    assert 3 <= failures <= 30


def test_a_baseline_that_is_ahead_is_said():
    wave = 0.5 * np.sin(np.arange(N) / 7.0)
    noise = RNG.standard_normal(N)
    reason = outcome(noise + wave, {"replay": LEVEL + SIGMA * wave}, form=1.0)
    assert reason == "replay predicts unused data better"
    assert outcome(noise, {"replay": LEVEL + SIGMA * wave}) == ""


def test_a_baseline_that_is_ahead_by_what_is_left_open_is_not_ahead_of_a_right_model():
    noise, missed = RNG.standard_normal(N), 0.45
    replay = {"replay": np.full(N, LEVEL + SIGMA * missed)}
    assert outcome(noise + missed, replay, form=1.0) == "replay predicts unused data better"
    assert outcome(noise + missed, replay, open_share=1.2 * missed**2, form=1.0) == ""


def test_what_holds_nothing_out_is_not_tested():
    assert "nothing is held out" in outcome(RNG.standard_normal(N), in_sample=True)


def problem_without_effects(folder, condensed, **bench):
    """A selector of a unit without effects, and its selection of the model without effects."""
    problem = problem_of(make_unit(folder, {}, Bench(cranks=CRANKS, **bench), condensed), condensed)
    everything = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), everything)
    covariance = Covariance(problem.data, everything, parts_of(problem.data, everything))
    return selector, Selection(selector.trial(selector.recalibrate(everything), covariance)), everything


@pytest.mark.long
def test_cells_left_out_add_the_square_of_their_error_under_its_covariance(tmp_path, condensed):
    """An identity of the linear model, which that of a unit of measured dimensions nearly is."""
    selector, selection, everything = problem_without_effects(tmp_path / "u", condensed, noise=0.02)
    data = selector.problem.data
    for training, left_out in splits_of(data, everything):
        fold = selector.trained_on(training)
        fitter, sigma = fold.fitter, fold.problem.data.sigma
        fit = fitter.fit(Model(), training, fitter.start(Model()))
        at_all = fitter.fit_at(fit, fit.unknowns.flat, everything)  # a position has its own zero of the angle
        rows = fitter.centred_values(at_all.jacobian, 1 / sigma**2)[left_out]
        error = (data.angle - fit.predicted_angle)[left_out]
        open_covariance = np.linalg.inv(precision_of(fitter, fit, training))
        square = error @ np.linalg.solve(np.diag(sigma[left_out] ** 2) + rows @ open_covariance @ rows.T, error)
        added = _added_squares(fold, selection, fit, everything)
        assert added == pytest.approx(square, rel=0.02)


@pytest.mark.long
def test_a_right_model_passes_where_its_derivatives_do_not_hold(tmp_path, condensed, monkeypatch):
    """Unknown tolerances, little noise, curves of few nodes, so that contacts close at kinks.

    A fold misses by 50 times the noise, in the square three times what it may.
    """
    monkeypatch.setattr(simulator, "LEVELS", 22)
    bench = {"noise": 0.001, "known": False, "sample": 9}
    selector, selection, everything = problem_without_effects(tmp_path / "u", condensed, **bench)
    training, left_out = splits_of(selector.problem.data, everything)[2]
    fold = selector.trained_on(training)
    fit, *_ = _fold(fold, selection, training, left_out)
    data = fold.problem.data
    error_in_noise = ((data.angle - fit.predicted_angle) / data.sigma)[left_out]
    left_open = (_left_open(fold.fitter, fit, training) / data.sigma)[left_out]
    assert np.mean(error_in_noise**2) > 3 * np.mean(1 + left_open**2)
    assert _added_squares(fold, selection, fit, everything) < 1.3 * left_out.sum()

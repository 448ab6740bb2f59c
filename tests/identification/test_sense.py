"""Benches that count the other sense as positive: torque and angle of both signs are compared with the model."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_unit import CRANKS, ROOT, Bench, Condensed, make_unit

from pipeline.identification import identify
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.identify import _other_sense, _problem_of
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.criteria import Selection
from pipeline.identification.selection.model_selection import Selector

FRICTION, ZERO = {"coulomb": [0.4]}, {"torque_zero": [0.5]}


def noted(measurement: Measurement, condensed: Condensed, effects: tuple[str, ...] = (), gain: float = 0.0):
    """The note on the sense of a measurement by a model with effects, and none, fitted beside numbers as declared.

    The model with effects is taken as more probable than it is by ``gain``.
    """
    cells, problem = _problem_of(measurement, condensed)
    selector, models = Selector(Fitter(problem), cells), (Model(), Model(tuple(candidates()[n] for n in effects)))
    fits = [selector.fitter.fit(model, cells, selector.fitter.start(model)) for model in models]
    base, answer = (selector.trial(fit, selector.tries(cells).covariance) for fit in fits)
    answer.evidence.value += gain
    name = answer.fit.model.name
    return _other_sense(measurement, condensed, Selection(base, {name: answer}, best_model=name if effects else ""))


def test_an_effect_with_the_declared_sign_can_be_more_probable_than_the_other_sign(tmp_path, condensed):
    """An effect that acts on one side of a flank looks like the other sign to the model without effects."""
    folder = make_unit(tmp_path / "u", {}, Bench(cranks=CRANKS[:2], rows=24), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT)).in_other_sense()
    assert noted(measurement, condensed, tuple(FRICTION)) is not None
    assert noted(measurement, condensed, tuple(FRICTION), gain=1e4) is None


def test_both_the_answer_and_the_model_without_effects_are_tried_with_the_other_sign(tmp_path, condensed, monkeypatch):
    folder = make_unit(tmp_path / "u", {}, Bench(cranks=CRANKS[:2], rows=24), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT)).in_other_sense()
    fit_from, tried = identify._fit_from, []

    def recorded(known, *rest):
        tried.append(known.model.name)
        return fit_from(known, *rest)

    monkeypatch.setattr(identify, "_fit_from", recorded)
    assert noted(measurement, condensed, tuple(FRICTION)) is not None
    assert tried == ["", "coulomb"]


def test_an_effect_is_one_of_many_before_the_data():
    """The other sign without effects is not compared with one effect as if no other had been tried."""
    selector = SimpleNamespace(testable=range(20))
    trials = [
        SimpleNamespace(fit=SimpleNamespace(model=SimpleNamespace(n_effects=n)), evidence=SimpleNamespace(value=3.0))
        for n in (0, 1, 2)
    ]
    values = [identify._log_posterior(trial, selector) for trial in trials]
    np.testing.assert_allclose(values, 3.0 - np.log([1, 20, 190]))


@pytest.mark.long
@pytest.mark.parametrize("effects", [{}, FRICTION, ZERO])
def test_a_bench_of_the_other_sense_is_noted_and_one_of_the_right_sense_is_not(tmp_path, condensed, effects):
    """Errors of the parts act on one side of a flank; beside friction the answer's model says so, not the base."""
    folder = make_unit(tmp_path / "u", effects, Bench(cranks=CRANKS), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    assert noted(measurement, condensed, tuple(effects)) is None
    note = noted(measurement.in_other_sense(), condensed, tuple(effects))
    assert (note.kind, note.severity) == ("sense", "note")
    assert note.message.endswith("reverse both columns")
    again = measurement.in_other_sense().in_other_sense(note)
    assert again.faults == (*measurement.faults, note)
    np.testing.assert_array_equal(again.rows.torque, measurement.rows.torque)


def test_a_commanded_torque_has_the_other_sign_too(tmp_path, condensed):
    folder = make_unit(tmp_path / "u", {}, Bench(rows=24), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    rows = replace(measurement.rows, command=2 * measurement.rows.torque)
    other = Measurement(measurement.unit, rows).in_other_sense().rows
    np.testing.assert_array_equal(other.command, -rows.command)
    np.testing.assert_array_equal(other.angle, -rows.angle)
    assert measurement.in_other_sense().rows.command is None


def test_of_unknown_dimensions_and_a_crank_that_is_held_no_sense_is_sought(tmp_path, condensed):
    folder = make_unit(tmp_path / "u", {}, Bench(known=False), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT))

    def nothing_condensed(*_):
        pytest.fail("the other sense is not to be solved")

    assert _other_sense(measurement, nothing_condensed, None) is None


def test_what_misses_more_than_noise_in_both_senses_is_left_as_it_is(tmp_path, condensed, monkeypatch):
    """Where neither sense fits, the more probable one says nothing: the errors of the model are larger than both."""
    folder = make_unit(tmp_path / "u", {}, Bench(cranks=CRANKS[:2], rows=24), condensed)
    measurement = Measurement.read(load_measured_unit(folder, ROOT)).in_other_sense()
    assert noted(measurement, condensed) is not None
    rows = measurement.rows
    distorted = Measurement(measurement.unit, replace(rows, angle=rows.angle + 0.006 * np.cos(rows.torque)))
    assert noted(distorted, condensed) is None
    monkeypatch.setattr(identify, "NO_EFFECT_LEFT", np.inf)
    assert noted(distorted, condensed) is not None
    monkeypatch.setattr(identify, "NAMED_ODDS", np.inf)
    assert noted(measurement, condensed) is None

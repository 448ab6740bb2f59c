"""Every effect is put into a unit at a clearly visible size, and its parameters are found by screening and fit."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_unit import CRANKS, Bench, exactly_known, make_unit, problem_of

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection import model_selection
from pipeline.identification.selection.model_selection import Selector
from pipeline.model.effects.effect import FLANGE, MOVES

TWO, THREE = Bench(), Bench(cranks=CRANKS)
CASES = {
    "bearing_clearance": ((8.0,), THREE, 0.05),
    "contact_friction": ((0.1,), replace(TWO, cycles=1, rows=160), 0.05),
    "coulomb": ((0.3,), TWO, 0.03),
    "crank_compliance_2": ((0.02, -0.01), THREE, 0.1),
    "creep": ((0.02, 40.0), replace(TWO, rows=100), 0.1),
    "eccentricity_error": ((6.0,), THREE, 0.03),
    "flank_wear": ((5.0,), replace(TWO, rows=160), 0.03),
    "output_torsion": ((0.05,), THREE, 0.05),
    "ovality_2": ((6.0, -4.0), THREE, 0.05),
    "ovality_3": ((4.0, 6.0), THREE, 0.05),
    "pin_circle_error": ((6.0,), THREE, 0.05),
    "pin_radius_error": ((-5.0,), THREE, 0.05),
    "preload": ((9.0,), replace(TWO, rows=150), 0.03),
    "presliding": ((0.6, 0.4), TWO, 0.1),
    "run_in": ((6.0, 1.5), replace(TWO, cycles=5), 0.1),
    "seat_compliance": ((0.01,), THREE, 0.15),
    "softening_compliance": ((0.2, 1.5), THREE, 0.15),
    "thermal_growth": ((12.0,), replace(TWO, cycles=3, warming=10.0), 0.05),
    "torque_zero": ((0.4,), TWO, 0.03),
    "torque_gain": ((0.1,), THREE, 0.2),
    "torque_creep": ((0.03, 40.0), replace(TWO, rows=100), 0.1),
    "angle_drift": ((3.0,), replace(TWO, seconds=5.0), 0.03),
    "encoder_eccentricity": ((0.8, -0.6), replace(THREE, locked="output", common=True), 0.03),
    "directional_load_friction": ((0.15, 0.05), replace(TWO, cycles=1), 0.15),
    "modulus_temperature": ((0.01,), replace(TWO, cycles=3, warming=10.0), 0.05),
    "rayleigh": ((0.01,), replace(TWO, rows=100, noise=0.03), 0.05),
    "load_friction": ((0.1,), replace(TWO, cycles=1), 0.05),
    "motor_cogging": ((0.3, 0.2, 40_000.0, 4.5, 8.0), replace(THREE, rows=400, noise=0.03), 0.1),
    "encoder_interpolation": ((0.03, 0.02, 40_000.0, 4.5, 8.0), replace(THREE, rows=400, noise=0.01), 0.1),
}
LONG = {"contact_friction"}
"""Every state of its path is solved by itself: half a minute; `make attack`."""


def test_every_effect_has_a_case():
    assert set(CASES) == {name for name, effect in candidates().items() if not effect.needs & {FLANGE, MOVES}}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.attack) if name in LONG else name for name in CASES]
)
def test_an_effect_is_found_again(name, tmp_path, condensed):
    values, bench, tolerance_range = CASES[name]
    fit = fit_of(name, values, bench, tmp_path / "u", condensed)
    reported = len(candidates()[name].parameters)
    np.testing.assert_allclose(fit.values[:reported], values[:reported], rtol=tolerance_range)
    phases = fit.values[reported:] - values[reported:]  # of further positions
    np.testing.assert_allclose(np.cos(phases), 1.0, atol=0.02)


def fit_of(name, values, bench, folder, condensed):
    """The fit of the effect that was put into a unit, from what its screening promises."""
    problem = exactly_known(problem_of(make_unit(folder, {name: values}, bench, condensed), condensed))
    fitter = Fitter(problem)
    selector = Selector(fitter, np.ones(len(problem.data), bool))
    selector.testable = {name: selector.testable[name]}
    all_cells = np.ones(len(problem.data), bool)
    base = fitter.fit(Model(), all_cells, fitter.start(Model()))
    promises = selector.screen(all_cells, base)
    assert promises[name].misfit < 0.98
    (fit,) = selector.fits(base, all_cells, promises)
    assert fit.sound
    assert np.sqrt(np.mean(((problem.data.angle - fit.predicted_angle) / problem.data.sigma) ** 2)) < 1.25
    return fit


@pytest.mark.long
@pytest.mark.parametrize(("measured_to_um", "is_named"), [(0.02, True), (0.3, False)])
def test_the_uncertainty_of_dimensions_decides_on_effects_of_their_size(tmp_path, condensed, measured_to_um, is_named):
    """Pins that are all 0.6 um thicker: with 0.3 um at each of several dimensions that is no more than was measured."""
    bench = replace(TWO, more=f"measured_to_um = {measured_to_um}")
    folder = make_unit(tmp_path / "u", {"pin_radius_error": (0.6,)}, bench, condensed)
    problem = problem_of(folder, condensed)
    all_cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), all_cells)
    selector.testable = {name: selector.testable[name] for name in ("pin_radius_error", "coulomb")}
    selection = selector.select(all_cells)
    assert selection.members == (("pin_radius_error",) if is_named else ())


@pytest.mark.long
def test_a_second_effect_is_found_beside_the_best_one_where_no_pair_was_promised(tmp_path, condensed, monkeypatch):
    """A drift of the angle differs between cycles alone, which the limit of the form of the model does not count."""
    monkeypatch.setattr(model_selection, "promising_pairs", lambda *_: [])
    effects = {"coulomb": (0.8,), "angle_drift": (0.4,)}
    bench = replace(TWO, cycles=3, seconds=5.0)
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", effects, bench, condensed), condensed))
    all_cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), all_cells)
    selector.testable = {name: selector.testable[name] for name in (*effects, "torque_zero")}
    selection = selector.select(all_cells)
    assert selection.odds["coulomb"] > selection.odds["angle_drift"]
    assert selection.trials["coulomb"].evidence.structure.size <= selection.limit
    assert selection.members == ("angle_drift+coulomb",)


@pytest.mark.long
def test_what_looks_like_a_member_of_the_best_pair_takes_its_place(tmp_path, condensed, monkeypatch):
    """Of two effects that curves hardly tell apart the pair with either is fitted, though one was not promised."""
    monkeypatch.setattr(model_selection, "promising_pairs", lambda *_: [])
    monkeypatch.setattr(model_selection, "ADDITIONS", 1)
    effects = {"coulomb": (0.3,), "pin_radius_error": (8.0,)}
    bench = replace(TWO, cycles=3)
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", effects, bench, condensed), condensed))
    all_cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), all_cells)
    selector.testable = {name: selector.testable[name] for name in (*effects, "preload", "pin_circle_error")}
    selection = selector.select(all_cells)
    pairs = {name for name in selection.trials if "coulomb" in name.split("+") and "+" in name}
    assert pairs == {"coulomb+pin_radius_error", "coulomb+preload", "coulomb+pin_circle_error"}


def test_what_looks_like_the_best_effect_is_fitted_from_its_numbers_too(tmp_path, condensed):
    """A fit that ended early does not leave the class to the effect whose fit did not."""
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", {"preload": (8.0,)}, TWO, condensed), condensed))
    cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), cells)
    fitter, tries = selector.fitter, selector.tries(cells)
    selector.testable = {name: selector.testable[name] for name in ("preload", "pin_radius_error")}
    base = selector.trial(fitter.fit(Model(), cells, fitter.start(Model())), tries.covariance)
    models = {name: Model((effect,)) for name, effect in selector.testable.items()}
    early = fitter.fit(models["pin_radius_error"], cells, fitter.start(models["pin_radius_error"]), 0)
    fits = {"preload": fitter.fit(models["preload"], cells, fitter.start(models["preload"])), early.model.name: early}
    trials = {name: selector.trial(fit, tries.covariance, base) for name, fit in fits.items()}
    selection = tries.judge.select(base, trials, {})
    assert selection.members == ("preload",)
    with_twins = selector._with_twins(selection, tries)
    assert set(with_twins.members) == {"preload", "pin_radius_error"}
    assert with_twins.trials["pin_radius_error"].fit.values == pytest.approx([8.0], rel=0.03)


def test_beside_each_member_of_the_best_pair_what_explains_most_is_tried(tmp_path, condensed, monkeypatch):
    """Though neither curves nor single effects promised the other pair."""
    monkeypatch.setattr(model_selection, "twins", lambda _: ())
    effects = {"coulomb": (0.3,), "pin_radius_error": (8.0,)}
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", effects, TWO, condensed), condensed))
    cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), cells)
    fitter, tries = selector.fitter, selector.tries(cells)
    selector.testable = {name: selector.testable[name] for name in (*effects, "torque_zero", "torque_gain")}
    base = selector.trial(fitter.fit(Model(), cells, fitter.start(Model())), tries.covariance)
    pair = Model((selector.testable["pin_radius_error"], selector.testable["torque_zero"]))
    trials = {pair.name: selector.trial(fitter.fit(pair, cells, fitter.start(pair)), tries.covariance, base)}
    selection = tries.judge.select(base, trials, {})
    assert selection.best_model == pair.name
    exchanged = selector._with_twins(selection, tries)
    assert exchanged.best_model == "coulomb+pin_radius_error"
    assert "coulomb+torque_zero" in exchanged.trials  # beside the other member, too
    assert "coulomb+torque_gain" in exchanged.trials  # and beside those of the pair that it led to

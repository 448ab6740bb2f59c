"""What effects promise before they are fitted: the one that is there, where it starts, and those that are not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of
from synthetic_unit import CRANKS, Bench, exactly_known, make_unit, problem_of

from pipeline.identification.bench.load_path import Instrument
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Vector, shares_of_values, values_at_shares
from pipeline.identification.fitting.problem import Model, candidates, limit_cases, with_limit_cases
from pipeline.identification.selection import ripples
from pipeline.identification.selection import screening as screening_module
from pipeline.identification.selection.fitted_numbers import intervals
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.ripples import OwnPhases, _Search, _with_phase
from pipeline.identification.selection.screening import (
    BEST_DIRECTIONS,
    PHASES,
    RADII,
    REACH,
    STEPS,
    Screening,
    promising_effects,
    screen_effects,
    start_from_declared,
)

TWO, THREE = Bench(), Bench(cranks=CRANKS)
UNITS = {
    "coulomb": ((0.3,), replace(TWO, rows=150), ("preload", "seat_compliance", "torque_gain", "flank_wear")),
    "pin_radius_error": ((-5.0,), THREE, ("coulomb", "bearing_clearance")),
    "ovality_2": ((3.0, -2.0), THREE, ("coulomb", "output_torsion", "bearing_clearance")),
    "ovality_3": ((2.0, 3.0), THREE, ("coulomb", "output_torsion", "bearing_clearance")),
}


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.long
def test_the_effect_of_a_unit_promises_most_and_starts_near_the_truth(name, tmp_path, condensed):
    values, bench, rivals = UNITS[name]
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", {name: values}, bench, condensed), condensed))
    fitter, all_cells = Fitter(problem), np.ones(len(problem.data), bool)
    selector = Selector(fitter, all_cells)
    selector.testable = {item: selector.testable[item] for item in (name, *rivals)}
    base = fitter.fit(Model(), all_cells, fitter.start(Model()))
    promises = selector.screen(all_cells, base)
    start = values_at_shares(problem.bounds(candidates()[name]), promises[name].starts[0].shares)
    assert np.linalg.norm(start - values) < 0.5 * np.linalg.norm(values)
    assert promises[name].misfit < 0.2
    # numbers at the ends of their plausible ranges leave others something too
    minimum = min(promises[name_left].misfit for name_left in rivals)
    assert minimum > max(0.6, 15 * promises[name].misfit)


SCALE, EFFECT = 0.2, candidates()["coulomb"]
SPREAD = 0.5


def looked(share, confused=0.6, seed=0):
    """A linear unit with an effect of some size, of which a scale explains a part, and its screening."""
    rng, data = np.random.default_rng(seed), linear_data(sigma=0.1)
    design = rng.normal(size=(len(data), 2))
    design[:, 1] = confused * design[:, 0] + np.sqrt(1 - confused**2) * design[:, 1]
    angle = design @ [SCALE, share] + 4.0 * data.position + 0.1 * rng.normal(size=len(data))
    fitter = LinearFitter(replace(data, angle=angle), design, (SPREAD,))
    all_cells = np.ones(len(data), bool)
    base = fitter.fit(model_of(0), all_cells, fitter.start(model_of(0)))
    return fitter, Screening(fitter, all_cells, base, data.sigma), base


def least(fitter, columns):
    """Least sum of squares over the scale, effects and offsets, the scale held by its prior."""
    data = fitter.problem.data
    offsets = (data.position[:, None] == [0, 1]).astype(float)
    rows = np.hstack([fitter.design[:, :columns], offsets]) / data.sigma[:, None]
    rows = np.vstack([rows, np.eye(1, columns + 2) / SPREAD])
    right = np.append(data.angle / data.sigma, 0.0)
    return np.sum((right - rows @ np.linalg.lstsq(rows, right, rcond=None)[0]) ** 2)


def test_promise_of_a_linear_effect_is_what_its_fit_leaves():
    fitter, look, _ = looked(0.3)
    misfit, start = min(look.starts(EFFECT), key=lambda one: one[0])
    assert look.base_misfit == pytest.approx(least(fitter, 1), rel=1e-6)
    assert misfit == pytest.approx(least(fitter, 2), rel=1e-6)
    assert start.shares[0] == pytest.approx(0.3, abs=0.03)


def promised(look):
    """Share of the misfit that the effect leaves at least."""
    return min(misfit for misfit, _ in look.starts(EFFECT)) / look.base_misfit


def test_secants_of_a_linear_effect_leave_what_its_fit_leaves():
    fitter, look, _ = looked(0.3)
    assert look.misfit_by_secants(EFFECT) == pytest.approx(least(fitter, 2), rel=1e-6)


def test_what_the_base_can_follow_or_goes_the_other_way_promises_nothing():
    assert promised(looked(0.3, confused=1.0)[1]) > 0.99
    assert promised(looked(-0.3)[1]) > 0.99
    assert promised(looked(0.0)[1]) > 0.9


def test_secants_reach_no_further_than_they_may():
    shares = [start.shares[0] for _, start in looked(0.9)[1].starts(EFFECT)]
    assert max(shares) == pytest.approx(REACH * max(STEPS))


def test_an_effect_of_one_sense_is_looked_at_from_several_sizes_as_one_of_both_senses_is():
    shares = [start.shares[0] for _, start in looked(0.9)[1].starts(EFFECT)]
    assert set(RADII) <= set(np.round(shares, 12))


def test_effects_without_an_equilibrium_promise_nothing_at_all():
    fitter, look, base = looked(0.3)
    cells = np.ones(len(fitter.problem.data), bool)
    assert screen_effects(fitter, cells, [base], [EFFECT]).keys() == {EFFECT.name}
    base_prediction = fitter.predict
    fitter.predict = lambda model, *arguments, **options: base_prediction(model, *arguments, **options)._replace(
        sound=model.n_effects == 0
    )
    assert look.starts(EFFECT) == []
    assert screen_effects(fitter, cells, [base], [EFFECT]) == {}


def test_promises_beside_several_bases_are_shares_of_the_first():
    fitter, _, base = looked(0.3)
    cells = np.ones(len(fitter.problem.data), bool)
    distant = fitter.fit(base.model, cells, replace(base.unknowns, scales=np.array([1.5])), 0)
    stiff = replace(distant, jacobian=0.0 * base.jacobian, sigma=base.sigma)  # cannot move back: it leaves more
    (from_one_base,) = screen_effects(fitter, cells, [base], [EFFECT]).values()
    (worst,) = screen_effects(fitter, cells, [stiff], [EFFECT]).values()
    (pair,) = screen_effects(fitter, cells, [stiff, base], [EFFECT]).values()
    residuals = [Screening(fitter, cells, item, base.sigma).base_misfit for item in (base, stiff)]
    assert residuals[1] > 1.01 * residuals[0]
    assert pair.misfit < worst.misfit
    assert pair.misfit == pytest.approx(from_one_base.misfit * residuals[0] / residuals[1])
    np.testing.assert_array_equal(pair.starts[0].flat, from_one_base.starts[0].flat)
    failed_fit = replace(base, cost=np.inf)
    (from_failed_base,) = screen_effects(fitter, cells, [base, failed_fit], [EFFECT]).values()
    assert from_failed_base.misfit == from_one_base.misfit


class EnoughSeenError(Exception):
    """Ends a search whose first looks are asked for alone."""


def test_the_waves_the_size_and_the_phases_of_a_ripple_are_found_by_linear_least_squares(tmp_path, condensed):
    """In the loaded cells, though in the play the ripple moves the angle by far more than the slope there tells."""
    values = {"motor_cogging": (0.3, 0.2, 40_000.0, 4.5, 8.0)}
    bench = replace(THREE, rows=200, noise=0.01)
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", values, bench, condensed), condensed))
    fitter, cells = Fitter(problem), np.ones(len(problem.data), bool)
    base = fitter.fit(Model(), cells, fitter.start(Model()))
    effect = candidates()["motor_cogging"].of_positions(3)
    search = _Search(Screening(fitter, cells, base, base.sigma), effect)
    falls = [search.ripple(wave)[0] for wave in search.waves]
    best = search.waves[np.argmax(falls)]
    assert abs(best - 40_000.0) <= search.step
    waves, shares = 40_000.0, search.start_near(best).shares
    found = values_at_shares(problem.bounds(effect), shares)
    assert abs(found[2] - waves) <= 0.2 * search.step
    assert np.hypot(*found[:2]) == pytest.approx(np.hypot(0.3, 0.2), rel=0.15)
    _, size, phases = search.ripple(waves)
    assert size == pytest.approx(np.hypot(0.3, 0.2), rel=0.15)
    first = np.arctan2(0.3, 0.2)
    turned = np.array([phases[0] - first, phases[1] - first - 4.5, phases[2] - first - 8.0])
    np.testing.assert_allclose(np.cos(turned), 1.0, atol=0.02)


def test_a_ripple_starts_with_the_phases_and_the_size_that_it_was_looked_at_with(tmp_path, condensed):
    problem = exactly_known(problem_of(make_unit(tmp_path / "u", {"coulomb": (0.3,)}, THREE, condensed), condensed))
    fitter, effect = Fitter(problem), candidates()["motor_cogging"].of_positions(3)
    asked_phases = {0: 0.4, 1: 2.9, 2: -1.7}
    for cells in (np.ones(len(problem.data), bool), problem.data.position > 0):
        base = fitter.fit(Model(), cells, fitter.start(Model()), 1)
        look = Screening(fitter, cells, base, problem.data.sigma)
        phases = {position: asked_phases[position] for position in look.positions}
        start = _Search(look, effect).start(20_000.0, 0.2, phases)
        instrument = effect.apply(Instrument(), values_at_shares(problem.bounds(effect), start.shares).tolist())
        for position, phase in phases.items():
            ripple = instrument.ripple_at(position)
            assert ripple.amplitude == pytest.approx(200.0)  # N mm
            assert np.cos(ripple.phase - phase) == pytest.approx(1.0)


def test_a_ripple_without_a_wave_starts_from_none(tmp_path, condensed, monkeypatch):
    """The numbers as declared may lead to no balance anywhere."""
    monkeypatch.setattr(screening_module, "ripple_starts", lambda *_: [])
    problem = problem_of(make_unit(tmp_path / "u", {}, TWO, condensed), condensed)
    fitter, cells = Fitter(problem), np.ones(len(problem.data), bool)
    model = Model((candidates()["motor_cogging"].of_positions(2),))
    start = start_from_declared(fitter, model, cells, fitter.start(Model()))
    np.testing.assert_array_equal(start.shares, 0.5)
    np.testing.assert_array_equal(start.reach, fitter.start(model).reach)


@pytest.mark.parametrize(("positions", "is_fitted"), [([0], True), ([0, 1, 2], False)])
def test_what_is_faint_grows_with_the_phases_that_noise_may_choose(positions, is_fitted, monkeypatch):
    """Noise exceeds 15 with one phase as often as 23 with those of three positions."""

    def fitted_on(wave):
        raise EnoughSeenError

    search = SimpleNamespace(
        waves=[1e5], ripple=lambda _: (20.0, 0.1, {}), start=lambda *_: "start", start_near=fitted_on, in_noise=float
    )
    monkeypatch.setattr(ripples, "_Search", lambda *_: search)
    screening = SimpleNamespace(positions=positions, base_misfit=100.0)
    if is_fitted:
        with pytest.raises(EnoughSeenError):
            ripples.ripple_starts(screening, None)
    else:
        assert ripples.ripple_starts(screening, None) == [(80.0, "start")]


def test_a_fall_counts_in_the_mean_square_that_it_leaves():
    search = SimpleNamespace(goal=np.full(4, 5.0), loaded=SimpleNamespace(root=np.ones(50)))
    assert _Search.in_noise(search, 60.0) == pytest.approx(60.0 / (40.0 / 50))


@pytest.mark.parametrize("left_out", [0, 2])
def test_a_position_that_is_left_out_has_its_own_phase_of_a_ripple(left_out, tmp_path, condensed):
    """As it has its own zero of the angle; the other positions keep their phases."""
    values = (0.1, 0.05, 40_000.0, 4.5, 8.0)
    bench = replace(THREE, rows=100, noise=0.01)
    problem = exactly_known(
        problem_of(make_unit(tmp_path / "u", {"motor_cogging": values}, bench, condensed), condensed)
    )
    fitter, data = Fitter(problem), problem.data
    training, model = data.position != left_out, Model((candidates()["motor_cogging"].of_positions(3),))
    start = fitter.start(model, shares_of_values(fitter.bounds(model), values))
    fit = fitter.fit(model, np.ones(len(data), bool), start)

    def misses(fit):
        return float(np.sqrt(np.mean(((data.angle - fit.predicted_angle) / data.sigma)[~training] ** 2)))

    phases = OwnPhases(fitter, fit, training)
    right_phase = np.arctan2(*fit.values[:2]) + np.append(0.0, fit.values[3:])[left_out]
    turned = _with_phase(fit.unknowns, phases.ripples[0], left_out, right_phase + np.pi)
    angle = fitter.predict(model, turned).angle
    wrong = replace(fit, unknowns=turned, predicted_angle=angle + fitter.offsets(angle, training, fit.sigma))
    own = OwnPhases(fitter, wrong, training).fitted()
    assert misses(wrong) > 3 * misses(fit)
    assert misses(own) < 1.1 * misses(fit)
    np.testing.assert_allclose(own.predicted_angle[training], fit.predicted_angle[training], atol=1e-3)
    jacobian = OwnPhases(fitter, own, training).removed_from(own.jacobian)
    np.testing.assert_array_equal(jacobian[training], own.jacobian[training])
    assert OwnPhases(fitter, own, np.ones(len(data), bool)).fitted() is own
    first = len(own.unknowns.scales)
    columns, size = jacobian[~training][:, first : first + 5], np.max(np.abs(own.jacobian))
    by_phase = columns[:, 2 + left_out] if left_out else own.values[1] * columns[:, 0] - own.values[0] * columns[:, 1]
    assert np.max(np.abs(by_phase)) < 1e-9 * size
    assert np.max(np.abs(columns)) > 1e-3 * size

def test_phases_of_positions_are_no_numbers_of_a_page():
    effect = candidates()["motor_cogging"].of_positions(3)
    unknowns = Vector(np.zeros(0), np.full(5, 0.4), np.zeros(0))
    fit = SimpleNamespace(model=Model((effect,)), unknowns=unknowns)
    trial = SimpleNamespace(fit=fit, evidence=SimpleNamespace(deviations=np.full(5, 0.01)), other_solutions=())
    turns = np.pi, 5 * np.pi
    fitter = SimpleNamespace(bounds=lambda _: ((-1.0, 1.0), (-1.0, 1.0), (1e4, 4e4), turns, turns))
    assert [number.name for number in intervals(fitter, trial)] == ["cosine_Nm", "sine_Nm", "waves_per_turn"]


def test_an_effect_is_looked_at_in_all_directions_and_further_in_the_best_two():
    """A quadratic misfit is least towards one phase; shares beyond the bounds are not looked at."""
    looked, goal = [], np.array([0.9, 0.1])

    def misfit(model, start):
        looked.append(start.shares)
        return float(np.sum((start.shares - goal) ** 2))

    base = SimpleNamespace(unknowns=Vector(np.zeros(0), np.zeros(0), np.zeros(0)))
    screening = SimpleNamespace(base=base, misfit_at=misfit)
    screening._start_at = lambda model, shares: Screening._start_at(screening, model, shares)
    grows, zero = np.ones(2, bool), np.full(2, 0.5)
    starts = Screening._directional_starts(screening, None, zero, grows)
    assert len(looked) == PHASES + BEST_DIRECTIONS * (len(RADII) - 1)
    step = min(starts, key=lambda start: start[0])[1].shares - zero
    np.testing.assert_allclose(step, 0.35 * np.array([1.0, -1.0]) / np.sqrt(2))
    one_sided = Screening._directional_starts(screening, None, np.array([0.1]), np.ones(1, bool))
    assert [np.isfinite(cost) for cost, _ in one_sided] == [True, False, True, True, True, False]


def test_effects_that_promise_the_least_fall_are_looked_at_the_best_first(monkeypatch):
    misfits = {"coulomb": 60.0, "preload": 91.0, "creep": 20.0, "torque_gain": 89.0}
    effects = {name: candidates()[name] for name in misfits}
    look = SimpleNamespace(base_misfit=100.0, misfit_by_secants=lambda effect: misfits[effect.name])
    monkeypatch.setattr(screening_module, "Screening", lambda *_: look)
    base = SimpleNamespace(sigma=None, cost=200.0)  # in the noise, twice as large
    assert promising_effects(None, None, base, effects, 20.0) == ["creep", "coulomb", "torque_gain"]
    monkeypatch.setattr(screening_module, "LOOKED_AT", 1)
    assert promising_effects(None, None, base, effects, 20.0) == ["creep"]


def test_an_effect_and_the_simpler_one_that_it_becomes_are_one_as_far_as_they_are_tried():
    for name, simpler in limit_cases().items():
        assert {name, simpler} <= with_limit_cases([name])
        assert {name, simpler} <= with_limit_cases([simpler])
    assert with_limit_cases([]) == set()


@pytest.mark.parametrize(
    ("name", "share", "is_refined"),
    [("motor_cogging", 2.0, True), ("motor_cogging", 1.05, False), ("coulomb", 2.0, False)],
)
def test_a_ripple_that_misses_more_than_noise_is_refined_from_each_of_its_starts(name, share, is_refined):
    cells = np.ones(50, bool)
    fit = SimpleNamespace(model=Model((candidates()[name],)), cost=50 * share, unknowns="where it ends")
    fitter = SimpleNamespace(refine=lambda fit, cells, start: ("refined", start))
    assert ripples.refined_ripple(fitter, fit, cells) == (("refined", "where it ends") if is_refined else fit)

"""Fits: bounds and shares, offsets, scales and tolerances, and that nothing held out is looked at."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_unit import CRANKS, ROOT, Bench, exactly_known, make_unit, problem_of, with_angles

from pipeline import assembly
from pipeline.config import load_study
from pipeline.config.designs.problems import study_effect_problems
from pipeline.config.files.section import with_value
from pipeline.identification.bench.instrument_effects import MOST_WAVES
from pipeline.identification.fitting.build import POPULATION
from pipeline.identification.fitting.fitter import STEP, Fitter
from pipeline.identification.fitting.parameters import WIDE, shares_of_values, values_at_shares
from pipeline.identification.fitting.problem import LIMIT, Model, PriorModes, candidates
from pipeline.identification.identify import identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.covariance import Covariance
from pipeline.identification.selection.criteria import ODDS, Judge, Selection
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.fitted_numbers import calibrated_numbers, implausible, refit_with_free_numbers
from pipeline.identification.selection.model_selection import Selector, Tries
from pipeline.model.effects import Conditions
from pipeline.model.load_history.backbone import backbone, torque_levels
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

TWO = Bench()
COULOMB = Model((candidates()["coulomb"],))


@pytest.fixture(scope="module")
def exact_unit(tmp_path_factory, condensed):
    """A unit with known dimensions and friction."""
    folder = make_unit(tmp_path_factory.mktemp("known") / "u", {"coulomb": [0.3]}, Bench(cranks=CRANKS), condensed)
    return problem_of(folder, condensed)


@pytest.fixture(scope="module")
def unknown(tmp_path_factory, condensed):
    """A unit whose dimensions are not measured."""
    folder = make_unit(tmp_path_factory.mktemp("unknown") / "u", {}, Bench(cranks=CRANKS, known=False), condensed)
    return problem_of(folder, condensed)


def everything(problem):
    return np.ones(len(problem.data), bool)


def rms(problem, predicted):
    """Rms misfit [arcmin] and in sigmas."""
    misfit = problem.data.angle - predicted
    return np.sqrt(np.mean(misfit**2)), np.sqrt(np.mean((misfit / problem.data.sigma) ** 2))


@given(
    st.lists(
        st.tuples(st.one_of(st.just(0.0), st.floats(0.01, 5), st.floats(-5, -0.01)), st.floats(0.1, 5)),
        min_size=1,
        max_size=4,
    ),
    st.data(),
)
def test_shares_and_values_are_inverse(pairs, data):
    bounds = [(low, low + width) for low, width in pairs]
    shares = np.array([data.draw(st.floats(0, 1)) for _ in bounds])
    values = values_at_shares(bounds, shares)
    assert all(low - 1e-9 <= value <= high + 1e-9 for (low, high), value in zip(bounds, values, strict=True))
    np.testing.assert_allclose(shares_of_values(bounds, values), shares, atol=1e-9)


def test_tolerances_of_a_unit_move_what_a_study_can_state(exact_unit):
    """Dimensions that were not measured, and do not vary in the study, are none of what a fit may move."""
    moved = vars(exact_unit.modes_of_errors(np.ones(exact_unit.n_modes)))
    names = {name for name, values in moved.items() if np.any(values)}
    assert {"lobe", "roller_diameter", "pin_radial"} <= names
    assert not names & {"bore_runout", "pin_roundness", "pin_off_hole", "displacement"}


def test_positive_bounds_far_apart_are_shared_by_the_logarithm():
    np.testing.assert_allclose(values_at_shares([(0.05, 5e4)], np.array([0.5])), 50.0)
    assert values_at_shares([(1.0, WIDE)], np.array([0.5])) == pytest.approx(0.5 * (1 + WIDE))
    np.testing.assert_allclose(shares_of_values([(0.05, 5e4)], [50.0]), 0.5)


def test_kept_gaps_are_those_of_the_effects_at_their_values(exact_unit):
    """Of one effect at two values, of two in either order, and at another scale of the calibrated numbers."""
    kept, library = Fitter(exact_unit), candidates()
    n_scales = len(kept.start(Model()).scales)
    names = ("ovality_2", "ovality_3")  # which have the same bounds
    for order in (names, names[::-1]):
        model = Model(tuple(library[name] for name in order))
        for share, scale in ((0.55, 0.0), (0.6, 0.0), (0.55, 0.1)):
            unknowns = replace(kept.start(model, np.array([share, 0.5, 0.5, 0.5])), scales=np.full(n_scales, scale))
            for fresh_drives, drives in zip(
                *(fitter.drives(model, unknowns)[0].values() for fitter in (Fitter(exact_unit), kept)), strict=True
            ):
                np.testing.assert_array_equal(drives[0].gap, fresh_drives[0].gap)
    assert len({drive.gap.tobytes() for drive, _ in kept._known_gaps.values()}) > 2


def test_waves_are_no_finer_than_the_rows_of_a_branch_resolve(exact_unit):
    """With two rows over each; where that leaves fewer waves than a staircase has, the effect is not testable."""
    cogging, data = candidates()["motor_cogging"], exact_unit.data
    cells = np.median(np.bincount(data.block))
    for rows, waves in ((4, 2 * cells), (1, cells / 2)):
        problem = replace(exact_unit, data=replace(data, count=np.full(len(data), rows)))
        assert problem.waves[1] == pytest.approx(waves)
        waves_per_turn = problem.bounds(cogging)[2][1]
        assert waves_per_turn * problem.span / 21600 == pytest.approx(min(waves, MOST_WAVES))
    play = np.where(data.torque > 0, 30.0, 0.0)  # the loaded parts keep their range, of which two waves are
    wide = replace(exact_unit, data=replace(data, angle=data.angle + play))
    loaded = [np.abs(data.torque) > 0.2 * np.max(np.abs(data.torque)), data.position == 0]
    both = sum(np.ptp(data.angle[np.all([*loaded, sense * data.torque > 0], axis=0)]) for sense in (1, -1))
    assert wide.bounds(cogging)[2][0] * both / 21600 == pytest.approx(2.0, rel=0.1)
    third = replace(exact_unit, data=replace(data, count=(np.arange(len(data)) % 12 == 0).astype(np.int64)))
    assert third.why_not(cogging) == "a branch has too few rows"


def test_a_clearance_of_the_bearings_of_two_disks_is_that_of_the_design():
    """As an effect and as declared, in a study that is valid."""
    study = load_study("two_disks", ROOT)
    sampled, curves = draw(study, 0, 1), []
    loose = {"bearing_clearance": {"clearance_um": 7.0}}
    declared = with_value(study.design, "bearing.clearance_um", study.design.bearing.clearance_um + 7.0)
    for design in (study.design, study.design.model_copy(update={"effects": loose}), declared):
        assert not list(study_effect_problems(design.effects, 0.0))
        clearance = assembly.bearing_clearance(design, sampled.bearing_clearance)
        drive = drive_of(study.model_copy(update={"design": design}), 0.0, None, assembly.errors(sampled), clearance)
        curves.append(backbone(drive, torque_levels(8, 1.0)))
    tight, with_effect, as_declared = curves
    assert np.max(with_effect.states.residual) < 1e-6
    np.testing.assert_allclose(with_effect.angle, as_declared.angle, rtol=1e-9, atol=1e-15)
    assert np.ptp(with_effect.limits.motion[0, :, -1]) > 1.05 * np.ptp(tight.limits.motion[0, :, -1])


def test_an_eccentric_encoder_takes_a_position_more_than_its_wave_has_numbers(exact_unit):
    """Zero, amplitude and phase follow the offsets of any three positions; on the crank a loop shows the slope, too."""
    encoder, data = candidates()["encoder_eccentricity"], exact_unit.data
    for n_positions, reason in ((3, "offsets of 3 positions lie on some wave; 4 can test one"), (4, "")):
        shared = replace(data, common_offset=True, position=np.arange(len(data)) % n_positions)
        problem = replace(exact_unit, data=shared)
        vars(problem)["hours"] = 1.0  # of a record with a course for each position
        assert problem.why_not(encoder) == reason
    assert exact_unit.why_not(encoder) == "every position has its own zero of the angle"
    courses = [replace(course, encoder_turns=39.0) for course in exact_unit.forward.courses]
    on_crank = replace(exact_unit, data=replace(data, common_offset=True), forward=SimpleNamespace(courses=courses))
    assert on_crank.why_not(encoder) == ""


def test_offsets_are_of_the_cells_fitted_in_their_group(exact_unit):
    data = exact_unit.data
    fitted = (np.arange(len(data)) % 3 > 0) & (data.position != 2)
    for common in (False, True):
        fitter = Fitter(replace(exact_unit, data=replace(data, common_offset=common)))
        predicted = data.angle - np.where(data.position == 0, 5.0, -2.0) - np.where(data.position == 2, 7.0, 0.0)
        disturbed = np.where(fitted | (data.position == 2), predicted, predicted + 100.0)
        result = fitter.offsets(disturbed, fitted, data.sigma)
        if not common:
            np.testing.assert_allclose(result, np.array([5.0, -2.0, 5.0])[data.position])
        else:
            weight = fitted / data.sigma**2
            mean = np.sum(weight * np.where(data.position == 0, 5.0, -2.0)) / weight.sum()
            np.testing.assert_allclose(result, mean)


def test_centred_values_have_no_mean_over_the_cells_fitted_of_a_group(exact_unit):
    fitter, data = Fitter(exact_unit), exact_unit.data
    weight = (data.position < 2) / data.sigma**2
    values = np.random.default_rng(0).normal(size=(len(data), 2)) + data.position[:, None]
    centred = fitter.centred_values(values, weight)
    for position in (0, 1):
        in_position = data.position == position
        np.testing.assert_allclose(weight[in_position] @ centred[in_position], 0.0, atol=1e-9 * weight.max())
        np.testing.assert_allclose(
            np.diff(centred[in_position], axis=0), np.diff(values[in_position], axis=0), atol=1e-12
        )
    np.testing.assert_array_equal(centred[data.position == 2], values[data.position == 2])


def test_a_fit_at_its_own_unknowns_is_the_same_fit(exact_unit):
    fitter, cells = Fitter(exact_unit), everything(exact_unit)
    fit = fitter.fit(COULOMB, cells, fitter.start(COULOMB, [0.1]))
    there = fitter.fit_at(fit, fit.unknowns.flat, cells)
    np.testing.assert_allclose(there.predicted_angle, fit.predicted_angle, atol=1e-9)
    np.testing.assert_allclose(there.values, fit.values)
    assert there.cost == pytest.approx(fit.cost, rel=1e-6)
    scale = np.abs(fit.jacobian).max(axis=0)
    difference = np.abs(there.jacobian - fit.jacobian) / scale
    assert np.sqrt(np.mean(difference**2)) < 0.01  # those by the scales are taken over in a fit
    assert there.sound


def test_a_shift_of_each_position_changes_nothing_but_its_offset(exact_unit):
    shift = np.array([40.0, -7.0, 3.0])[exact_unit.data.position]
    fits = [
        Fitter(problem).fit(COULOMB, everything(exact_unit), Fitter(problem).start(COULOMB, [0.1]))
        for problem in (exact_unit, with_angles(exact_unit, exact_unit.data.angle + shift))
    ]
    np.testing.assert_allclose(fits[1].values, fits[0].values, rtol=1e-6)
    np.testing.assert_allclose(fits[1].predicted_angle - fits[0].predicted_angle, shift, atol=1e-6)


def test_calibrated_scales_are_found_again(exact_unit):
    exact_unit = exactly_known(exact_unit)
    fitter, truth = Fitter(exact_unit), np.log([0.5, 1.01, 1.15, 1.0, 1.0, 1.0, 1.0])
    assert exact_unit.calibrated_keys == (
        "bearing.stiffness_N_per_mm_power",
        "output.outer_station_mm",
        "output.roller_length_mm",
    )
    true_unknowns = replace(fitter.start(Model()), scales=truth)
    prediction = fitter.predict(Model(), true_unknowns)
    angle = prediction.angle
    assert prediction.sound
    noise = exact_unit.data.noise * np.random.default_rng(0).standard_normal(len(angle))
    variant = Fitter(with_angles(exact_unit, angle + noise))
    fit = variant.fit(Model(), everything(exact_unit), variant.start(Model()))
    np.testing.assert_allclose(fit.unknowns.scales[1:], truth[1:], atol=0.02)
    np.testing.assert_allclose(fit.unknowns.scales[0], truth[0], atol=0.25)  # a stiff bearing hardly shows
    assert rms(variant.problem, fit.predicted_angle)[0] < 1.1 * exact_unit.data.noise


def test_contacts_of_another_power_of_the_force_are_found_and_need_no_effect(exact_unit):
    """Contacts whose deflection goes with a power of 0.8 of the force, not 0.9, on a bench with a 20th of the noise."""
    number, ranges = len(exact_unit.calibrated_keys) + 2, exact_unit.scale_range
    data = replace(exact_unit.data, sigma=0.05 * exact_unit.data.sigma)
    exact_unit = replace(exactly_known(exact_unit), data=data, scale_range=ranges)
    fitter = Fitter(exact_unit)
    start = fitter.start(Model())
    is_curvature = np.arange(len(start.scales)) == number
    truth = replace(start, scales=np.where(is_curvature, np.log(2.0), 0.0))
    variant = Fitter(with_angles(exact_unit, fitter.predict(Model(), truth).angle))
    starts = {"curved": start, "as declared": replace(start, reach=start.reach * ~is_curvature)}
    fits = {name: variant.fit(Model(), everything(exact_unit), unknowns) for name, unknowns in starts.items()}
    left = {name: rms(variant.problem, fit.predicted_angle)[1] for name, fit in fits.items()}
    assert left["as declared"] > 5 * left["curved"]
    found = calibrated_numbers(variant, fits["curved"], evidence_of(variant, fits["curved"]))[number]
    assert found.key == "curvature of the laws of all contacts"
    assert found.ci_low < 2.0 < found.ci_high


def evidence_of(fitter, fit):
    """The evidence of a fit to all cells."""
    data, cells = fitter.problem.data, everything(fitter.problem)
    return Evidence(Covariance(data, cells, data.position), fitter, fit)


def test_means_over_draws_of_tolerances_are_those_of_the_predictions(unknown):
    """No draw changes nothing; of draws the mean curve is that of their predictions, but for cells within the play."""
    fitter, size = Fitter(unknown), 0.7
    start = fitter.start(Model())
    prediction = fitter.predict(Model(), start, modes=True)
    draws = size * np.random.default_rng(0).standard_normal((6, unknown.n_modes))
    nothing, change = (
        fitter.mean_of_draws(Model(), start, prediction, of_modes, fitter.positions) for of_modes in (0 * draws, draws)
    )
    np.testing.assert_allclose(nothing[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(nothing[1], prediction.influence, atol=1e-9)
    predictions = [fitter.predict(Model(), replace(start, modes=draw), modes=True) for draw in draws]
    expected = np.mean([one.angle for one in predictions], axis=0) - prediction.angle
    assert np.max(np.abs(expected)) > 0.1
    torque = np.abs(unknown.data.torque)
    loaded = torque > 0.1 * torque.max()
    np.testing.assert_allclose(change[0][loaded], expected[loaded], atol=0.02 * np.max(np.abs(expected)))
    influence = np.mean([one.influence for one in predictions], axis=0)
    assert np.max(np.abs(influence - prediction.influence)) > 0.2 * np.max(np.abs(influence))
    np.testing.assert_allclose(change[1][loaded], influence[loaded], atol=0.02 * np.max(np.abs(influence)))


def test_curves_of_as_many_states_are_kept_whatever_the_states_of_a_drive(unknown):
    """A unit whose drive differs from cycle to cycle must not take as many times the memory."""
    drive, forward = unknown.nominal[0], copy(unknown.forward)
    states = len(drive.gap)
    assert states > 1
    forward._kept_drives, forward._most_kept = {}, 4 * states
    for number in range(12):
        forward.backbone(drive.with_added_gap(np.full(drive.gap.shape[1], 1e-4 * number)))
        assert 0 < len(forward._kept_drives) <= 5


@pytest.mark.long
def test_a_unit_far_from_the_declared_one_is_found_by_averaged_derivatives(unknown, monkeypatch):
    """All numbers and tolerances drawn, a twentieth of the noise: a descent to all cells ends where contacts close."""
    data, random = replace(unknown.data, sigma=0.05 * unknown.data.sigma), np.random.default_rng(16)
    unit = replace(unknown, data=data)
    start, spread = Fitter(unit).start(Model()), unit.scale_spread
    drawn = start.like(np.concatenate([spread, np.ones(len(start.modes))]) * random.standard_normal(len(start.flat)))
    truth = replace(drawn, scales=np.clip(drawn.scales, *unit.scale_range))
    angle = Fitter(unit).predict(Model(), truth).angle + data.sigma * random.standard_normal(len(data))
    fitter, cells = Fitter(with_angles(unit, angle)), everything(unit)
    plain, averaged = fitter.fit(Model(), cells, start), fitter.fit_averaged(Model(), cells, start)
    selector = Selector(fitter, cells)
    passes = selector.recalibrate(cells)
    assert plain.cost > 2.5 * averaged.cost
    assert passes.cost <= averaged.cost
    assert rms(fitter.problem, passes.predicted_angle)[1] < 0.5 * rms(fitter.problem, plain.predicted_angle)[1]

    known = selector.trial(plain, Covariance(data, cells, data.position))
    selection = Selection(known, {"coulomb": known}, odds={"coulomb": 60.0}, members=("coulomb",))
    refined = selector._without_effects(selection, cells).fit.cost
    assert refined < 0.2 * plain.cost
    assert selector._without_effects(replace(selection, members=()), cells).fit.cost > 2 * refined

    monkeypatch.setattr(selector.fitter, "refine", lambda fit, *_: fit)
    assert selector._without_effects(selection, cells).fit.cost > 2 * refined
    far_along = selector.trial(passes, Covariance(data, cells, data.position))
    trials = {"coulomb": known, "preload": known, "ovality_2": far_along, "creep": known}
    selection = replace(selection, trials=trials, odds={**dict.fromkeys(trials, -3.0), "coulomb": 60.0})
    assert selector._without_effects(selection, cells).fit.cost < 1.1 * passes.cost


@pytest.mark.long
def test_a_fit_with_an_effect_is_refined_too_where_it_could_then_be_named(unknown):
    """As above, with friction, a fifth of the noise: a fit from the base ends at 1.4 times the misfit."""
    data, random = replace(unknown.data, sigma=0.2 * unknown.data.sigma), np.random.default_rng(9)
    unit, cells = replace(unknown, data=data), everything(unknown)
    friction = Fitter(unit).start(COULOMB, shares_of_values(Fitter(unit).bounds(COULOMB), (0.15,)))
    sizes = np.concatenate([unit.scale_spread, [0.0], np.ones(unit.n_modes)])
    drawn = friction.like(sizes * random.standard_normal(len(sizes)))
    truth = replace(drawn, scales=np.clip(drawn.scales, *unit.scale_range), shares=friction.shares)
    angle = Fitter(unit).predict(COULOMB, truth).angle + data.sigma * random.standard_normal(len(data))
    selector = Selector(Fitter(with_angles(unit, angle)), cells)
    selector.testable = {"coulomb": candidates()["coulomb"]}
    base = selector.recalibrate(cells)
    (from_base,) = selector.fits(base, cells, selector.screen(cells, base))
    assert from_base.cost > 1.3 * len(data)
    assert selector.fitter.refine(from_base, cells, from_base.unknowns).cost < 1.2 * len(data)

    covariance, judge = Covariance(data, cells, data.position), Judge(selector.fitter, cells, 1)
    base_trial, trial = (selector.trial(fit, covariance) for fit in (base, from_base))
    value = base_trial.evidence.value - 3 * ODDS
    far_behind = SimpleNamespace(value=value, log_evidence_up_to=lambda *_: value)
    far_behind.without_promise = lambda: far_behind
    for cost, is_refined in ((from_base.cost, True), (len(data), False)):  # of the latter noise alone is left
        known = replace(trial, fit=replace(from_base, cost=cost), evidence=far_behind)
        odds = judge.odds(base_trial.evidence.value, {"coulomb": value})
        selection = Selection(base_trial, {"coulomb": known}, odds=odds)
        refined = selector._with_refined_fits(selection, Tries(cells, covariance, judge)).trials["coulomb"]
        assert refined.is_refined == is_refined


@pytest.mark.long
def test_all_is_tried_again_beside_a_better_fit_without_effects(exact_unit, monkeypatch):
    """From a base that was never fitted the fit of an effect leads to numbers that need no effect of their own."""
    unit, cells = exactly_known(exact_unit), everything(exact_unit)
    start = Fitter(unit).start(Model())
    truth = replace(start, scales=np.where(np.arange(len(start.scales)) == 3, np.log(1.3), 0.0))
    noise = unit.data.noise * np.random.default_rng(0).standard_normal(len(unit.data))
    fitter = Fitter(with_angles(unit, Fitter(unit).predict(Model(), truth).angle + noise))
    selector = Selector(fitter, cells)
    selector.testable = {"coulomb": candidates()["coulomb"]}
    declared = fitter.fit(Model(), cells, start, 0)
    monkeypatch.setattr(selector, "recalibrate", lambda _: declared)
    selection = selector.select(cells)
    assert declared.cost > 3 * selection.base.fit.cost
    assert selection.base.rms < 1.3
    assert not selection.members


@pytest.mark.parametrize(("friction_Nm", "names"), [(0.1, ("coulomb",)), (0.0, ())])
@pytest.mark.long
def test_what_is_named_is_still_so_beside_a_better_fit_without_effects(exact_unit, monkeypatch, friction_Nm, names):
    """A name stays beside the better fit, without a second search; so does none where no effect is close to one."""
    unit, cells = exactly_known(exact_unit), everything(exact_unit)
    fitter, start = Fitter(unit), Fitter(unit).start(Model())
    share = friction_Nm / unit.bounds(COULOMB.effects[0])[0][1]
    truth = replace(start, scales=np.where(np.arange(len(start.scales)) == 3, np.log(1.3), 0.0), shares=[share])
    noise = unit.data.noise * np.random.default_rng(0).standard_normal(len(unit.data))
    selector = Selector(Fitter(with_angles(unit, fitter.predict(COULOMB, truth).angle + noise)), cells)
    selector.testable = {"coulomb": candidates()["coulomb"]}
    declared, beside, bases = selector.fitter.fit(Model(), cells, start, 0), selector._beside, []
    better = selector.trial(selector.recalibrate(cells), Covariance(unit.data, cells, unit.data.position))
    monkeypatch.setattr(selector, "recalibrate", lambda _: declared)
    monkeypatch.setattr(selector, "_beside", lambda base, *known: bases.append(base) or beside(base, *known))
    monkeypatch.setattr(selector, "_without_effects", lambda selection, _: selection.base if bases[1:] else better)
    selection = selector.select(cells)
    assert selection.members == names
    assert len(bases) == 1
    assert selection.base.fit.cost == better.fit.cost < 0.9 * declared.cost


@pytest.mark.parametrize(("fall", "passes"), [(1.0, 1), (5.0, 1), (400.0, 4)])
def test_a_fit_that_misses_much_is_refined_while_passes_take_a_share_of_it(fall, passes):
    """Of 100 cells with a sum of squares of 10,100 a pass goes on if it takes more than 2 % of 10,000."""
    fitter, done = Fitter.__new__(Fitter), []

    def further(*_):
        done.append(1)
        return SimpleNamespace(cost=10_100 - 0.5 * fall * len(done), sound=True, unknowns=None, model=None)

    fitter.fit_averaged = fitter.fit_by_load = further
    start = SimpleNamespace(cost=10_100.0, sound=True, unknowns=None, model=None)
    fitter.refine(start, np.ones(100, bool), None)
    assert len(done) == 2 * passes


@pytest.mark.long
def test_of_fits_without_effects_that_miss_as_much_the_most_probable_counts(unknown):
    """One where contacts hold the numbers more closely is less probable by what they may then be."""
    selector, cells = Selector(Fitter(unknown), everything(unknown)), everything(unknown)
    fit = selector.recalibrate(cells)
    narrow = replace(fit, jacobian=20 * fit.jacobian)
    covariance = Covariance(unknown.data, cells, unknown.data.position)
    base, wide = (selector.trial(one, covariance) for one in (narrow, fit))
    assert wide.evidence.without_promise().value > base.evidence.without_promise().value + 5
    selection = Selection(base, {"coulomb": wide}, odds={"coulomb": 9.0}, members=())
    found = selector._without_effects(selection, cells)
    assert found.evidence.value > base.evidence.value + 5
    again = selector._without_effects(replace(selection, base=found, trials={"coulomb": found}), cells)
    assert again.evidence.value >= found.evidence.value
    assert selector._without_effects(replace(selection, base=again, trials={"coulomb": again}), cells) is again


@pytest.mark.long
def test_a_fit_without_effects_is_refined_from_two_starts_and_singles_from_pairs(exact_unit, monkeypatch):
    unit, cells, starts, reduced = exactly_known(exact_unit), everything(exact_unit), [], []
    selector = Selector(Fitter(unit), cells)
    selector.testable = {"coulomb": candidates()["coulomb"]}
    monkeypatch.setattr(selector, "_with_reductions", lambda selection, _: reduced.append(selection) or selection)
    selector._beside(selector.fitter.fit(Model(), cells, selector.fitter.start(Model()), 0), cells)
    assert len(reduced) == 1
    monkeypatch.setattr(selector.fitter, "refine", lambda fit, _, start: starts.append(start) or fit)
    fit = selector.recalibrate(cells)
    assert not np.any(starts[0].flat)
    assert starts[1] is fit.unknowns


def test_a_single_effect_is_fitted_from_where_a_pair_led(exact_unit):
    """A fit that has ended far off goes on from the pair; numbers of a pair that is no better lead to nothing."""
    unit, cells = exactly_known(exact_unit), everything(exact_unit)
    share = 0.2 / unit.bounds(COULOMB.effects[0])[0][1]
    angle = Fitter(unit).predict(COULOMB, Fitter(unit).start(COULOMB, np.array([share]))).angle
    noise = unit.data.noise * np.random.default_rng(0).standard_normal(len(unit.data))
    selector = Selector(Fitter(with_angles(unit, angle + noise)), cells)
    tries = selector.tries(cells)
    pair_model = Model((COULOMB.effects[0], candidates()["torque_zero"]))
    shares = {COULOMB: [4 * share], pair_model: [share, 0.5]}
    fits = [selector.fitter.fit(m, cells, selector.fitter.start(m, np.array(v)), 0) for m, v in shares.items()]
    far_single, pair = (selector.trial(fit, tries.covariance) for fit in fits)
    declared = selector.fitter.fit(Model(), cells, selector.fitter.start(Model()), 0)
    base = selector.trial(declared, tries.covariance)
    for trials, is_better in (((far_single, pair), True), ((far_single, replace(pair, fit=far_single.fit)), False)):
        known = dict(zip(("coulomb", pair_model.name), trials, strict=True))
        selection = tries.judge.select(base, known, {})
        single = selector._with_reductions(selection, tries).trials["coulomb"]
        assert (single.fit.cost < 1.2 * len(cells)) == is_better


def test_a_calibrated_number_stops_at_the_end_of_its_plausible_range_unless_released(exact_unit):
    """A bearing 11 times as stiff and a roller half as long were silent before."""
    exact_unit = exactly_known(exact_unit)
    fitter, truth = Fitter(exact_unit), np.log([1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 1.0])
    angle = fitter.predict(Model(), replace(fitter.start(Model()), scales=truth)).angle
    variant = Fitter(with_angles(exact_unit, angle))
    bounded_fit = variant.fit(Model(), everything(exact_unit), variant.start(Model()))
    low, high = exact_unit.scale_range
    assert np.exp([low[2], high[2]]) == pytest.approx([2.1 / 2.584, 3.1 / 2.584])
    assert bounded_fit.unknowns.scales[2] == pytest.approx(low[2])
    assert bounded_fit.unknowns.at_reach[2]
    assert np.all((bounded_fit.unknowns.scales >= low) & (bounded_fit.unknowns.scales <= high))
    free = refit_with_free_numbers(variant, bounded_fit, everything(exact_unit))
    assert free.unknowns.scales[2] == pytest.approx(truth[2], abs=0.05)
    assert rms(variant.problem, free.predicted_angle)[0] < 0.5 * rms(variant.problem, bounded_fit.predicted_angle)[0]
    assert refit_with_free_numbers(variant, free, everything(exact_unit)) is None
    law = replace(bounded_fit, unknowns=replace(bounded_fit.unknowns, scales=high * (np.arange(len(high)) == 4)))
    assert law.unknowns.at_reach[4]
    numbers = {
        calibrated_number.key: calibrated_number
        for calibrated_number in calibrated_numbers(variant, free, evidence_of(variant, free))
    }
    roller = numbers["output.roller_length_mm"]
    assert roller.leaves
    assert roller.ci_low < np.exp(free.unknowns.scales[2]) < roller.ci_high
    assert "output.roller_length_mm x 0.5" in implausible(list(numbers.values()))


def test_numbers_of_which_the_curve_shows_the_sum_alone_say_so(exact_unit):
    """Two scales whose columns are alike, and one that nothing shows."""
    fitter = Fitter(exactly_known(exact_unit))
    fit = fitter.fit(Model(), everything(exact_unit), fitter.start(Model()))
    dependent = fit.jacobian.copy()
    dependent[:, 0], dependent[:, 1] = 0.0, dependent[:, 2] * 1.0001
    spread = 1 / fitter.penalty(fit.unknowns)
    rows = dependent * spread / exact_unit.data.sigma[:, None]
    covariance = np.linalg.inv(rows.T @ rows + np.eye(len(spread)))
    evidence = SimpleNamespace(deviations=spread * np.sqrt(np.diag(covariance)), unknowns=(None, covariance))
    numbers = calibrated_numbers(fitter, fit, evidence)
    assert "its range alone holds it" in numbers[0].note
    assert numbers[1].note == "only a combination with output.roller_length_mm is determined"
    assert numbers[0].ci_high / numbers[0].ci_low > 0.8 * np.exp(np.ptp(exact_unit.scale_range[:, 0]))


def test_unknown_dimensions_are_fitted_by_their_modes_to_the_noise(unknown):
    assert 3 <= unknown.n_modes < POPULATION
    fitter = Fitter(unknown)
    start = fitter.start(Model())
    fit = fitter.fit(Model(), everything(unknown), start)
    declared = fitter.predict(Model(), start).angle
    rms_before = rms(unknown, declared + fitter.offsets(declared, everything(unknown), unknown.data.sigma))[0]
    assert rms_before > 10 * unknown.data.noise
    assert rms(unknown, fit.predicted_angle)[1] < 1.5
    assert np.max(np.abs(fit.unknowns.modes)) <= LIMIT
    assert np.sqrt(np.mean(fit.unknowns.modes**2)) < 1.5  # of unit variance


def test_dimensions_that_a_file_does_not_state_were_not_measured(unknown, tmp_path, condensed):
    """They have the study's distributions as if nothing was measured; those stated do not, and are as stated."""
    folder = make_unit(tmp_path / "u", {}, Bench(cranks=CRANKS), condensed)
    stated = (folder / "dimensions.toml").read_text().splitlines()
    whole = problem_of(folder, condensed)
    (folder / "dimensions.toml").write_text("\n".join(line for line in stated if not line.startswith("pin_")))
    partial = problem_of(folder, condensed)
    sizes = [np.sqrt(np.mean(np.concatenate([mode.sum(axis=0) ** 2 for mode in p.modes]))) for p in (whole, partial)]
    assert sizes[1] > 1.5 * sizes[0]
    errors = partial.nominal[0].errors
    np.testing.assert_allclose(errors.lobe, whole.nominal[0].errors.lobe)
    np.testing.assert_allclose(errors.pin_radius, -0.5e-3)  # the mean of 0 to -1 um
    np.testing.assert_allclose(errors.pin_radial, 0.0, atol=1e-9)


def test_influence_of_modes_is_the_difference_of_predictions(unknown):
    fitter = Fitter(unknown)
    start = fitter.start(Model())
    influence = fitter.predict(Model(), start, modes=True).influence
    for mode in (0, 1, 4):
        ends = []
        for step in (1e-3, -1e-3):
            shifted_modes = start.modes.copy()
            shifted_modes[mode] = step
            ends.append(fitter.predict(Model(), replace(start, modes=shifted_modes)).angle)
        result = (ends[0] - ends[1]) / 2e-3
        misfit = np.abs(influence[:, mode] - result)
        assert np.median(misfit) < 0.01 * np.max(np.abs(result))
        assert np.quantile(misfit, 0.9) < 0.1 * np.max(np.abs(result))


def test_a_ripple_answers_the_influence_of_modes_but_for_the_zero_of_the_angle(unknown):
    fitter, model = Fitter(unknown), Model((candidates()["motor_cogging"],))
    start = fitter.start(model, np.array([0.53, 0.5, 0.3]))
    influence = fitter.predict(model, start, modes=True).influence[:, 0]
    ends = [
        fitter.predict(model, replace(start, modes=step * np.eye(len(start.modes))[0])).angle for step in (0.01, -0.01)
    ]
    result = (ends[0] - ends[1]) / 0.02
    assert np.median(np.abs(influence - result)) < 0.03 * np.median(np.abs(result))


OTHERS = [("creep",), ("torque_gain",)]  # not by the forces: predicted anew


@pytest.mark.parametrize("names", [(), ("pin_radius_error",), ("coulomb", "eccentricity_error"), *OTHERS])
def test_derivatives_by_springs_and_gaps_are_those_of_predictions(exact_unit, names):
    fitter, model = Fitter(exact_unit), Model(tuple(candidates()[name] for name in names))
    current = fitter.start(model, np.full(model.n_parameters, 0.6))
    positions, weight = list(fitter.positions), 1 / exact_unit.data.sigma**2
    prediction = fitter.predict(model, current, modes=True)
    derivative, _ = fitter.jacobian(model, current, prediction, positions, weight, None)
    for k in range(len(current.scales) + len(current.shares)):
        flat, step = current.flat, STEP
        flat[k] += step
        angle_there = fitter.predict(model, current.like(flat)).angle
        truth = fitter.centred_values((angle_there - prediction.angle) / step, weight)
        misfit = np.abs(derivative[:, k] - truth)
        assert np.median(misfit) < 0.02 * np.max(np.abs(truth))
        assert np.quantile(misfit, 0.9) < 0.1 * np.max(np.abs(truth))


def test_modes_have_unit_variance_over_their_population_and_span_its_curves():
    rng = np.random.default_rng(0)
    gaps = [rng.normal(size=(300, 2)) @ rng.normal(size=(2, 6)) * 1e-3 for _ in range(2)]
    gaps[1] = gaps[0] @ rng.normal(size=(6, 6))
    influence = [rng.normal(size=(9, 6)) for _ in range(2)]
    modes = PriorModes.from_population(gaps, influence).above(1e-9)
    assert [len(mode) for mode in modes] == [2, 2]
    curves = ARCMIN * np.hstack([(mode - mode.mean(0)) @ i.T for mode, i in zip(gaps, influence, strict=True)])
    basis = ARCMIN * np.hstack([mode @ i.T for mode, i in zip(modes, influence, strict=True)])
    coefficients, *_ = np.linalg.lstsq(basis.T, curves.T, rcond=None)
    np.testing.assert_allclose(basis.T @ coefficients, curves.T, atol=1e-9 * np.abs(curves).max())
    np.testing.assert_allclose(np.cov(coefficients), np.eye(2), atol=1e-9)
    assert [len(mode) for mode in PriorModes.from_population(gaps, influence).above(1e9)] == [0, 0]


def test_modes_that_are_left_out_change_the_curves_together_by_less_than_the_resolution():
    rng = np.random.default_rng(1)
    gaps, influence = [rng.normal(size=(192, 40)) * 1e-3], [rng.normal(size=(60, 40))]
    population = PriorModes.from_population(gaps, influence)
    curves = ARCMIN * (gaps[0] - gaps[0].mean(0)) @ influence[0].T
    resolution = 0.3 * float(np.sqrt(np.mean(curves**2)))

    def left_out(n_modes):
        spanned = population.units[:, :n_modes]
        return np.sqrt(np.mean((curves - spanned @ (spanned.T @ curves)) ** 2))

    n_modes = len(population.above(resolution)[0])
    assert 0 < n_modes < 40
    assert left_out(n_modes) <= resolution < left_out(n_modes - 1)


def test_held_out_cells_have_no_influence_on_a_fit(exact_unit):
    fitted = exact_unit.data.position < 2
    fit = Fitter(exact_unit).fit(COULOMB, fitted, Fitter(exact_unit).start(COULOMB, [0.1]))
    angle = np.where(fitted, exact_unit.data.angle, np.random.default_rng(0).normal(size=len(fitted)))
    variant = Fitter(with_angles(exact_unit, angle))
    repeat = variant.fit(COULOMB, fitted, variant.start(COULOMB, [0.1]))
    np.testing.assert_array_equal(repeat.unknowns.flat, fit.unknowns.flat)
    np.testing.assert_array_equal(repeat.predicted_angle[fitted], fit.predicted_angle[fitted])


@pytest.mark.long
def test_a_split_that_the_unit_gives_is_honoured(tmp_path, condensed, monkeypatch):
    """The angles held out are replaced on disk: model and parameters stay, the name falls with unused data."""
    names = ("coulomb", "torque_zero")
    patched_name = "pipeline.identification.selection.model_selection.candidates"
    monkeypatch.setattr(patched_name, lambda: {n: candidates()[n] for n in names})
    held_out_section = '[held_out]\nby = "position"\ntrain = [0.0, 40.0]'
    bench = Bench(cranks=CRANKS, cycles=3, rows=40, more=held_out_section)
    folder = make_unit(tmp_path / "u", {"coulomb": [0.3]}, bench, condensed)
    identifications = [identify(load_measured_unit(folder, ROOT), condensed)]
    rows = pd.read_csv(folder / "rows.csv")
    is_held_out = rows["crank_deg"] == CRANKS[2]
    rows.loc[is_held_out, "angle_arcmin"] = (
        1.1 * rows.loc[is_held_out, "angle_arcmin"] + 0.2 * rows.loc[is_held_out, "torque_Nm"]
    )
    rows.to_csv(folder / "rows.csv", index=False)
    identifications.append(identify(load_measured_unit(folder, ROOT), condensed))
    for identification_of_rows in identifications:
        np.testing.assert_array_equal(
            identification_of_rows.folds.cells, identification_of_rows.problem.data.position == 2
        )
        assert np.all(np.isfinite(identification_of_rows.curves["after"][identification_of_rows.folds.cells]))
    assert identifications[0].verdict.named_effects == ("coulomb",)
    assert identifications[1].verdict.named_effects == ()
    first_order, second = (identification_of_rows.selection.answer.fit for identification_of_rows in identifications)
    np.testing.assert_allclose(second.values, first_order.values, rtol=0.02)
    error_before, error_after = (
        identification_of_rows.errors["after"].to_noise for identification_of_rows in identifications
    )
    assert error_before < 2.0
    assert error_after > 10.0


def test_folds_leave_out_positions_else_cycles(exact_unit):
    data = exact_unit.data
    np.testing.assert_array_equal(data.held_out_parts(everything(exact_unit)), data.position)
    np.testing.assert_array_equal(data.held_out_parts(data.position == 1), data.cycle)


def test_a_dimension_is_an_effect_only_beyond_its_tolerance(exact_unit):
    """Pins measured to 0.3 um may be 0.5 um thinner, not 3 um; friction moves no gap, and is never a tolerance."""
    thinner = Model((candidates()["pin_radius_error"],))
    assert exact_unit.within_tolerance(thinner, [-0.5])
    assert exact_unit.within_tolerance(thinner, [0.5])
    assert not exact_unit.within_tolerance(thinner, [-3.0])
    assert not exact_unit.within_tolerance(COULOMB, [0.01])
    pair = Model((*COULOMB.effects, *thinner.effects))
    assert exact_unit.within_tolerance(pair, [0.5, -0.5])
    assert not exact_unit.within_tolerance(pair, [0.5, -3.0])


def test_a_pattern_that_no_measured_unit_has_is_an_effect_though_its_mean_gap_is_small(exact_unit):
    """Two lobes over the pins are no error of each pin by itself, though no larger on average."""
    lobes = Model((candidates()["ovality_2"],))
    assert exact_unit.within_tolerance(lobes, [0.1, 0.0])
    assert not exact_unit.within_tolerance(lobes, [-1.7, -1.2])
    nominal = exact_unit.nominal[0].first_state
    shifted = lobes.effects[0].apply(nominal, [-1.7, -1.2], Conditions.run_in(1)).gap - nominal.gap
    assert 1e3 * np.mean(np.abs(shifted[:, : nominal.reducer.n_pins])) < 1.5


def test_frictions_that_are_not_solved_together_have_no_prediction(exact_unit):
    """Friction at the contacts beside one that differs between drive and backdrive: no number, not one of chance."""
    fitter = Fitter(exact_unit)
    model = Model((candidates()["contact_friction"], candidates()["directional_load_friction"]))
    prediction = fitter.predict(model, fitter.start(model))
    assert not prediction.sound
    assert np.all(np.isnan(prediction.angle))
    assert not np.isfinite(fitter.fit(model, everything(exact_unit), fitter.start(model)).cost)

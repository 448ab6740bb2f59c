"""Fits of a design whose crank turns within the loops of a locked output, against the held crank and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from locked_unit import write_locked_unit
from measured_bench import ROOT
from synthetic_unit import exactly_known

from pipeline.errors import InputError
from pipeline.identification.bench import locked_output
from pipeline.identification.bench.course import CrankMotion
from pipeline.identification.bench.load_path import Instrument, Ripple
from pipeline.identification.bench.simulator import Forward
from pipeline.identification.fitting import condensed_problem as condensed_problem_module
from pipeline.identification.fitting import stations
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.condensed_problem import MOST_HALVINGS, condensed_problem, error_between_cranks
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import shares_of_values
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.fitting.stations import stations_of
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.screening import Screening, start_from_declared
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.load_history.turning_crank import CurvesOverCrank
from pipeline.model.units import NMM_PER_NM
from tests.validation.blind.catalogue import no_compliance

RUNOUT = (60.0, -30.0)  # [um]
TWO_CRANKS = (15.0, 2475.0)


def problem_of(folder: Path):
    unit = load_measured_unit(folder, ROOT)
    measurement = Measurement.read(unit)
    return condensed_problem(measurement, no_compliance)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A unit with a run-out of the pin circle, at two positions a quarter of an output turn from each other."""
    path = tmp_path_factory.mktemp("locked") / "unit"
    return write_locked_unit(path, {"pin_circle_runout": RUNOUT}, noise=0.1, cranks=TWO_CRANKS, per_branch=40)


@pytest.fixture(scope="module")
def problem(folder):
    return exactly_known(problem_of(folder))


@pytest.mark.parametrize("instrument", [Instrument(), Instrument(ripple=Ripple(200.0, 500.0, 0.3))])
def test_where_nothing_depends_on_the_crank_the_reading_is_that_of_the_crank_that_is_held(problem, instrument):
    """The same drive at every station, with friction, a spring and creep in series."""
    drive = problem.nominal[0].with_elements(KelvinVoigt(2e-7, 40.0))
    course = problem.forward.courses[0]
    course = replace(course, time=np.arange(len(course.leg), dtype=float))
    moving, held = Forward([course], problem.rated_torque * 1e3), Forward([replace(course, crank=None)], 1.0)
    held.shares = moving.shares * problem.rated_torque * 1e3 / drive.rated_torque
    moving.shares = held.shares
    drives = (drive,) * len(course.crank.stations)
    turning, reference = (
        forward.read(given, 0, instrument) for forward, given in ((moving, drives), (held, (drive,)))
    )
    assert turning.sound
    assert np.any(turning.response != 1) == bool(instrument.ripple.amplitude)
    np.testing.assert_allclose(turning.angle, reference.angle, atol=1e-10)
    np.testing.assert_allclose(turning.carried_torque, reference.carried_torque, rtol=1e-12, atol=1e-9)


def test_between_two_states_that_are_alike_creep_turns_the_crank_as_in_one(problem):
    course = problem.forward_by_state.courses[0]
    course = replace(course, time=np.arange(len(course.leg), dtype=float))
    stations = tuple(problem.nominal[k].with_elements(KelvinVoigt(2e-7, 40.0)) for k in problem.stations[0])
    courses = [replace(course, state=np.full(len(course.leg), share)) for share in (0, 0.25)]
    forward = Forward(courses, problem.rated_torque * 1e3)
    first, between = (forward.read(stations, number, Instrument()) for number in range(2))
    assert between.sound
    np.testing.assert_allclose(between.angle, first.angle, atol=1e-9)


@pytest.mark.parametrize(("count", "degree"), [(3, 2), (4, 3), (9, 3)])
def test_values_between_stations_are_those_of_a_cubic(count, degree):
    """Of a parabola where there are three; those of the end beyond it, and of a station at it."""
    crank = np.linspace(1.0, 2.0, count)
    cells = np.array([0.5, 1.0, 1.07, 1.5, 1.81, 2.0, 2.3])
    shares = CrankMotion(stations=crank, ratio=13.0, cells=cells, at_input=False).shares
    values = np.polynomial.Polynomial(np.arange(1.0, degree + 2))
    np.testing.assert_allclose(shares @ values(crank), values(np.clip(cells, 1.0, 2.0)), rtol=1e-12)
    assert np.max(np.count_nonzero(np.abs(shares) > 1e-12, axis=1)) <= degree + 1
    nearest = set(range(np.searchsorted(crank, 1.81) - 2, np.searchsorted(crank, 1.81) + 2)) & set(range(count))
    assert nearest <= set(np.flatnonzero(shares[4]))


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(("side", "in_range"), [(1, True), (-1, False)])
def test_the_crank_must_stay_between_the_stations_on_the_side_to_which_it_turns(problem, side, in_range, sense):
    """A loop of one side, most of its cells near the largest torque: few lie far below the mean crank angle."""
    drive, course = problem.nominal[0], problem.forward.courses[0]
    torque = sense * np.array([1.0, *np.linspace(12.0, 18.0, len(course.leg) - 1)])
    first = np.zeros(len(torque), int)
    course = replace(course, torque=sense * np.array([0.0, 20.0]), leg=first, state=first)
    course = replace(course, cell_torques=np.column_stack([torque - 0.5, torque + 0.5]))
    held = Forward([replace(course, crank=None)], 20e3).read((drive,), 0, Instrument()).angle
    turned = 13 * np.radians(held - held.mean()) / 60
    assert -np.min(turned * sense) > 3 * np.max(turned * sense)
    reached = 1.2 * np.array([turned.min(), turned.max()])
    stations = course.crank.cells.mean() + np.linspace(*np.sort(side * reached), len(course.crank.stations))
    moving = replace(course, crank=replace(course.crank, stations=stations))
    forward = Forward([moving], 20e3)
    reading = forward.read((drive,) * len(stations), 0, Instrument())
    assert reading.sound
    assert reading.is_in_range == in_range
    curves = [forward.backbone(drive)] * len(stations)
    elastic = locked_output.ElasticOverCrank((drive,) * len(stations), moving, curves)
    expected = moving.crank.ratio * np.radians(held / 60).mean()
    assert elastic.first_start - moving.crank.cells.mean() == pytest.approx(expected, rel=0.05)


def test_a_search_may_pass_where_the_crank_turns_further_than_measured_but_no_fit_there_is_sound(problem):
    """A drive as soft as is plausible turns its crank beyond the angles at which drives were made."""
    cells, model, effect = np.ones(len(problem.data), bool), Model(), candidates()["pin_circle_runout"]
    fitter = Fitter(problem)
    start, softest = fitter.start(model), np.append(problem.scale_range[0, :1], problem.scale_range[1, 1:])
    for scales, in_range in ((start.scales, True), (softest, False)):
        base = fitter.fit(model, cells, replace(start, scales=scales), 0)
        prediction = fitter.predict(model, base.unknowns)
        assert prediction.sound
        assert prediction.is_in_range == base.sound == in_range
        assert fitter.fit_at(base, base.unknowns.flat, cells).sound == in_range
        assert len(Screening(fitter, cells, base, base.sigma).starts(effect)) > 4


def test_no_position_may_be_beyond_the_crank_angles_measured(problem, monkeypatch):
    fitter, read = Fitter(problem), problem.forward.read

    def first_beyond(drives, position, instrument):
        return replace(read(drives, position, instrument), is_in_range=position > 0)

    monkeypatch.setattr(problem.forward, "read", first_beyond)
    start = fitter.start(Model())
    assert not fitter.predict(Model(), start).is_in_range
    assert fitter.predict(Model(), start, [1]).is_in_range


def test_the_error_between_the_crank_angles_is_stated_of_every_position(problem):
    """None where nothing depends on the crank, and what every second crank angle misses where pins pass."""
    numbers, motion = problem.stations[0], problem.forward.courses[0].crank
    count = len(numbers) + (len(numbers) + 1) % 2
    cranks = motion.stations[0] + np.linspace(0.0, 1.0, max(count, 5)) * np.ptp(motion.stations)
    assert problem.forward.interpolation_error((problem.nominal[0],) * len(cranks), 0, cranks) < 1e-9
    drives = tuple(problem.nominal[station] for station in numbers)
    assert 1e-3 < problem.forward.interpolation_error(drives, 0, motion.stations) < 1.0


def test_the_error_between_crank_angles_is_that_of_every_state_of_the_course(problem):
    """A second state whose gaps vary over the crank angle, while those of the first do not."""
    course = problem.forward_by_state.courses[0]
    course = replace(course, state=np.ones(len(course.leg)))
    forward = Forward([course], problem.rated_torque * NMM_PER_NM)
    cranks = np.linspace(course.crank.stations[0], course.crank.stations[-1], 5)
    drive = problem.nominal[0].some(np.array([0, 0]))
    growth = np.stack([np.zeros(drive.gap.shape[1]), np.ones(drive.gap.shape[1])])
    drives = tuple(drive.with_added_gap(0.01 * (1 + np.sin(7 * crank)) * growth) for crank in cranks)
    assert forward.interpolation_error(drives, 0, cranks) > 1e-3
    firsts = tuple(one.some(np.array([0, 0])) for one in drives)
    assert forward.interpolation_error(firsts, 0, cranks) < 1e-9


def test_the_distance_between_stations_is_halved_only_where_the_noise_is_small(problem, folder, monkeypatch):
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    coarse, fine = (stations_of(measurement, halvings) for halvings in (0, 1))
    for few, many in zip(coarse.of_position, fine.of_position, strict=True):
        np.testing.assert_allclose(coarse.cranks[few], fine.cranks[many][::2], atol=1e-9)
        assert len(many) == 2 * len(few) - 1
    monkeypatch.setattr(condensed_problem_module, "LARGEST_ERROR", 1e6)
    assert condensed_problem(measurement, no_compliance).halvings == 0 < problem.halvings


def test_the_error_between_crank_angles_is_that_of_the_numbers_and_tolerances_fitted(folder):
    """By drives made at twice as many crank angles, of other scales and tolerances, over both positions."""
    unit = load_measured_unit(folder, ROOT)
    measurement = Measurement.read(unit)
    problem, finer = (
        build_problem(measurement, no_compliance(unit.study, stations_of(measurement, h).cranks.tolist()), None, h)
        for h in (0, 1)
    )
    fitter, rng = Fitter(problem), np.random.default_rng(1)
    start = fitter.start(Model())
    unknowns = replace(start, scales=0.5 * start.reach[1], modes=rng.normal(size=problem.n_modes))
    deviations = vars(problem.modes_of_errors(unknowns.modes))
    scales, cranks = tuple(np.exp(unknowns.scales)), np.radians(stations_of(measurement, 1).cranks)
    errors = []
    for position, numbers in enumerate(finer.stations):
        drives = [finer.drives(scales, k).first_state.with_added_errors(**deviations) for k in numbers]
        curves = [problem.forward.backbone(drive) for drive in drives]
        at_cranks = cranks[list(numbers)]
        every = CurvesOverCrank.from_drives(drives, curves, at_cranks)
        second = CurvesOverCrank.from_drives(drives[::2], curves[::2], at_cranks[::2])
        between = np.abs(second.spline(at_cranks[1::2]) - every.angle[1::2])
        errors.append(np.degrees(between.max()) * 60)
        assert problem.forward.interpolation_error(tuple(drives), position, at_cranks) == pytest.approx(errors[-1])
    assert abs(errors[0] - errors[1]) > 0.01 * errors[0]
    stated = error_between_cranks(measurement, no_compliance, fitter, Model(), unknowns)
    assert stated == pytest.approx(max(errors))
    assert stated != pytest.approx(error_between_cranks(measurement, no_compliance, fitter, Model(), start), rel=0.01)


def test_more_crank_angles_change_the_prediction_by_less_than_the_noise(problem, folder, monkeypatch):
    """Twice as many, over a wider range; the printed drive with few pins takes the most that are allowed."""
    assert problem.halvings == MOST_HALVINGS
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    monkeypatch.setattr(stations, "MARGIN", 2 * stations.MARGIN)
    cranks = stations_of(measurement, problem.halvings + 1).cranks
    compliances = no_compliance(measurement.unit.study, cranks.tolist())
    denser = exactly_known(build_problem(measurement, compliances, None, problem.halvings + 1))
    unknowns = Fitter(problem).start(Model())
    angles = [Fitter(case).predict(Model(), unknowns).angle for case in (problem, denser)]
    difference = angles[1] - angles[0]
    for group in problem.data.spans:
        difference[group] -= difference[group].mean()
    assert np.sqrt(np.mean((difference / problem.data.sigma) ** 2)) < 0.3


def test_a_whole_turn_of_the_output_changes_nothing(problem, folder):
    unit = load_measured_unit(folder, ROOT)
    turned = Measurement.read(unit)
    turned.rows.cranks[:] = turned.rows.cranks + 360.0 * unit.study.design.cycloid.lobes
    again = exactly_known(condensed_problem(turned, no_compliance))
    angles = [Fitter(p).predict(Model(), Fitter(p).start(Model())).angle for p in (problem, again)]
    np.testing.assert_allclose(angles[1], angles[0], atol=1e-6)


def test_two_simulators_read_the_same_loops_with_a_run_out_and_no_other(problem):
    """Model and second simulator share no code; the model is linear in the pose, which is worth a part in fifty."""
    fitter, model = Fitter(problem), Model((candidates()["pin_circle_runout"],))
    left = {}
    for values in (RUNOUT, (0.0, 0.0), (60.0, 30.0)):
        unknowns = fitter.start(model, shares_of_values(fitter.bounds(model), values))
        angle = fitter.predict(model, unknowns).angle
        residual = problem.data.angle - angle
        for group in problem.data.spans:
            residual[group] -= residual[group].mean()
        left[values] = np.sqrt(np.mean(residual**2))
    assert left[RUNOUT] < 0.02 * problem.span
    assert min(left[0.0, 0.0], left[60.0, 30.0]) > 3 * left[RUNOUT]


def test_the_size_of_a_run_out_is_found_again(problem):
    fitter, model = Fitter(problem), Model((candidates()["pin_circle_runout"],))
    every = np.ones(len(problem.data), bool)
    base = fitter.fit(Model(), every, fitter.start(Model()))
    start = start_from_declared(fitter, model, every, base.unknowns)  # from no run-out a fit ends at a kink
    fit = fitter.fit(model, every, start)
    assert fit.sound
    np.testing.assert_allclose(fit.values, RUNOUT, atol=5.0)
    far = fitter.start(model, shares_of_values(fitter.bounds(model), (100.0, 100.0)))
    assert fitter.predict(model, far).sound  # curves of close nodes cross there, by less than cubics are off


CHANGES = {
    "a wider circle of the pins": lambda drive: drive.with_added_errors(pin_radial=np.array(1e-3)),
    "a spring in series": lambda drive: drive.with_elements(LinearSpring(1e-8)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_derivatives_of_gaps_and_springs_are_those_of_readings(problem, name):
    """To first order, and by another reading."""
    drives, course = problem.nominal[: len(problem.stations[0])], problem.forward.courses[0]
    changed = tuple(CHANGES[name](drive) for drive in drives)
    reading, moved = (problem.forward.read(given, 0, Instrument()) for given in (drives, changed))
    change = moved.angle - reading.angle
    derived = problem.forward.change(drives, changed, 0, reading.carried_torque)
    change, derived = change - change.mean(), derived - derived.mean()
    assert np.std(change) > 0.05
    assert np.median(np.abs(derived - change)) < 0.05 * np.std(change)
    assert len(course.crank.cells) == len(change)


def test_derivatives_count_that_the_crank_turns_on_with_the_drive_that_is_asked_for(problem):
    """With a run-out the angle changes over the crank angle, so that a change of the curve turns the crank on."""
    fitter, model = Fitter(problem), Model((candidates()["pin_circle_runout"],))
    start, forward, courses = problem.nominal[: len(problem.stations[0])], problem.forward, problem.forward.courses
    shares = shares_of_values(fitter.bounds(model), (100.0, -50.0))
    drives = fitter.drives(model, fitter.start(model, shares), [0])[0][0]
    softer = tuple(drive.with_elements(LinearSpring(1e-9)) for drive in drives)
    reading, moved = (forward.read(given, 0, Instrument()) for given in (drives, softer))
    without_run_out = forward.change(start, softer, 0, reading.carried_torque)
    derived = forward.change(drives, softer, 0, reading.carried_torque)
    np.testing.assert_allclose(derived, moved.angle - reading.angle, rtol=0.02, atol=1e-3)
    fresh = Forward(courses, problem.rated_torque * NMM_PER_NM)
    np.testing.assert_array_equal(fresh.change(drives, softer, 0, reading.carried_torque), derived)
    assert np.median(np.abs(without_run_out / derived - 1)) > 0.05


@pytest.fixture
def elastic(problem) -> locked_output.ElasticOverCrank:
    """Curves of the first position, whose drive has a wider gap everywhere in its second state."""
    course = problem.forward_by_state.courses[0]
    course = replace(course, state=np.full(len(course.leg), 0.25))
    drives = [problem.nominal[k] for k in problem.stations[0]]
    gaps = [np.where(np.arange(len(drive.gap))[:, None] == 1, 5e-3, 0.0) * np.ones_like(drive.gap) for drive in drives]
    drives = [drive.with_added_gap(gap) for drive, gap in zip(drives, gaps, strict=True)]
    return locked_output.ElasticOverCrank(drives, course, [problem.forward_by_state.backbone(d) for d in drives])


def test_each_state_keeps_its_own_curve_at_a_start(elastic):
    kept = [elastic.from_start(state, elastic.start) for state in (0, 1, 0, 1)]
    for state in (0, 1):
        solved = elastic.by_state[state].locked_curve(elastic.start, elastic.motion.ratio)
        for curve in kept[state::2]:
            np.testing.assert_array_equal(curve.angle, solved.angle)
    assert np.ptp(kept[1].angle) > 1.01 * np.ptp(kept[0].angle)


def test_the_search_for_the_crank_without_twist_takes_the_run_out_into_account(problem):
    """The run-out turns the output further than the torques do."""
    model, course = Model((candidates()["pin_circle_runout"],)), problem.forward.courses[0]
    fitter = Fitter(problem)
    shares = shares_of_values(fitter.bounds(model), RUNOUT)
    drives = fitter.drives(model, fitter.start(model, shares))[0][0]
    curves = [problem.forward.backbone(drive) for drive in drives]
    elastic = locked_output.ElasticOverCrank(drives, course, curves)
    *_, place, is_sound = locked_output.locked_path(elastic, (1000.0 * course.torque, 1000.0 * course.cell_torques))
    assert is_sound
    assert abs(place - elastic.first_start) < 0.3 * abs(place - elastic.mean_crank)


def test_a_way_that_jumps_does_not_move_the_start_of_the_next(elastic, monkeypatch):
    """The second round of the first way starts where its curve is refused; the same way elsewhere is found."""
    course, solve = elastic.course, elastic.from_start
    refused_start = 0.0

    def refuse(state, start):
        if start == refused_start:
            raise ValueError("jumps")
        return solve(state, start)

    expected = locked_output.locked_path(elastic, (1000.0 * course.torque, 1000.0 * course.cell_torques))
    first_start, refused_start, *_ = dict.fromkeys(start for _, start in elastic._known_curves)
    assert first_start == elastic.first_start
    elastic.start = first_start
    monkeypatch.setattr(elastic, "from_start", refuse)
    *_, is_sound = locked_output.locked_path(elastic, (1000.0 * course.torque, 1000.0 * course.cell_torques))
    path, angle, place, _ = locked_output.locked_path(elastic, (990.0 * course.torque, 990.0 * course.cell_torques))
    assert expected[3]
    assert not is_sound
    assert np.all(np.isfinite(angle))
    assert place == pytest.approx(expected[2], rel=0.02)


def test_the_reducer_carries_the_torque_of_the_motor_less_the_work_over_the_crank(problem):
    course = problem.forward.courses[0]
    course = replace(course, crank=replace(course.crank, at_input=True))
    drives = [problem.nominal[k].without_elements for k in problem.stations[0]]
    elastic = locked_output.ElasticOverCrank(drives, course, [problem.forward.backbone(drive) for drive in drives])
    edges = 1000.0 * course.cell_torques
    path, *_, is_sound = locked_output.locked_path(elastic, (1000.0 * course.torque, edges))
    curve = elastic.curve_of_state(0)
    assert is_sound
    expected = np.interp(edges.mean(axis=1), curve.torque, curve.carried_torque)
    np.testing.assert_allclose(path.carried_torque, expected, rtol=1e-6, atol=0.1)
    assert np.max(np.abs(path.carried_torque - edges.mean(axis=1))) > 10.0


def test_memory_turns_the_crank_on(problem):
    """A twist m in series starts the curve at phi_0 - i m: exact by one start for each cell."""
    course = problem.forward.courses[0]
    drives = problem.nominal[: len(problem.stations[0])]
    curves = [problem.forward.backbone(drive) for drive in drives]
    elastic = locked_output.ElasticOverCrank(drives, course, curves)
    elastic.start = float(np.mean(course.crank.cells))
    torque = np.linspace(-15e3, 15e3, len(course.leg))
    twist = 1e-3 * np.sin(np.arange(len(torque)))
    found = elastic.turned_by_memory(torque, twist)
    for k in (3, 20, 41):
        curve = elastic.from_start(0, elastic.start + 13.0 * twist[k])
        held = elastic.curve_of_state(0)
        exact = np.interp(torque[k], curve.torque, curve.angle) - np.interp(torque[k], held.torque, held.angle)
        assert found[k] == pytest.approx(exact, abs=0.02 * np.max(np.abs(found)))
    assert np.max(np.abs(found)) > 1e-6


def test_effects_of_a_turning_crank_are_offered_and_those_of_a_standing_one_are_not(problem, folder):
    assert not problem.why_not(candidates()["crank_compliance_2"]).count("stands still")
    positions = "fewer than 3 crank positions of known angle to fit"
    assert problem.why_not(candidates()["pin_circle_runout"]) == positions
    assert "half a pitch" in problem.why_not(candidates()["contact_friction"])
    text = (folder / "unit.toml").read_text()
    wrong = text.replace("ratio = -13.0", "ratio = 13.0")
    other = folder.parent / "other"
    other.mkdir()
    for file in folder.iterdir():
        (other / file.name).write_bytes(file.read_bytes())
    (other / "unit.toml").write_text(wrong)
    with pytest.raises(InputError, match=r"crank.ratio = 13.0; the design has 13 lobes; give -13"):
        load_measured_unit(other, ROOT)

"""What the model says that a bench reads: kept curves, the instrument, the history of legs, and delayed elasticity."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_unit import ROOT

from pipeline import assembly
from pipeline.config import load_study
from pipeline.identification.bench.course import Course
from pipeline.identification.bench.load_path import Ripple, _nearest_root
from pipeline.identification.bench.simulator import Forward, Instrument
from pipeline.identification.fitting.fitter import answered
from pipeline.model.effects import Conditions, library
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.load_history.backbone import backbone
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import NMM_PER_NM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from tests.validation.blind.true_unit import turned_in_small_steps

TURNS = np.array([0.0, 12.0, -12.0, 12.0, 0.0])
ROWS = 40
FIRST_AND_LAST = Conditions(np.array([0.0, np.inf]), np.zeros(2))


def points(torque):
    """Cells (n, 2) without width."""
    return np.column_stack([torque, torque])


def course_of(turns=TURNS, time=None, encoder_turns=1.0, position=0.0):
    torque = np.concatenate([np.linspace(a, b, ROWS + 2)[1:-1] for a, b in zip(turns[:-1], turns[1:], strict=True)])
    leg = np.repeat(np.arange(len(turns) - 1), ROWS)
    states = np.zeros(len(leg), np.int64)
    return Course(turns, leg, states, points(torque), leg * 0.0 if time is None else time, encoder_turns, position)


@pytest.fixture(scope="module")
def drive(condensed):
    study = load_study("quick", ROOT)
    sampled = draw(study, 3, 4)
    loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    return drive_of(study, 0.0, condensed(study, [0.0])[0], assembly.errors(sampled), loose)


def read(drive, instrument=None, course=None):
    course = course or course_of()
    return Forward([course], drive.rated_torque).read((drive,), 0, instrument or Instrument())


def test_torsion_counts_once_whichever_drive_was_seen_first(drive):
    course = course_of()
    twisted = drive.with_elements(LinearSpring(5e-9))
    forward = Forward([course], drive.rated_torque)
    twisted_angle, reference = (forward.read((one,), 0, Instrument()).angle for one in (twisted, drive))
    twist = ARCMIN * 5e-9 * 1e3 * course.cell_torques[:, 0]
    np.testing.assert_allclose(twisted_angle - reference, twist, atol=1e-9)
    np.testing.assert_allclose(reference, read(drive).angle, atol=1e-12)


def test_frictionless_reading_is_the_backbone_at_its_nodes(drive):
    forward = Forward([course_of()], drive.rated_torque)
    curve = backbone(drive, forward.shares)
    course = replace(course_of(), leg=np.full(len(curve.torque), 1), cell_torques=points(1e-3 * curve.torque[::-1]))
    course = replace(course, time=np.zeros(len(curve.torque)), state=0 * course.leg, torque=1.05 * TURNS)
    reading = Forward([course], drive.rated_torque / 1.05).read((drive,), 0, Instrument())
    fine = np.interp(1e-3 * curve.torque[::-1], 1e-3 * curve.torque, ARCMIN * curve.angle[0])
    np.testing.assert_allclose(reading.angle, fine, atol=5e-3)


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_the_angle_of_a_cell_is_the_mean_over_its_rows(drive, friction):
    rubbing = library()["coulomb"].apply(drive, [friction], Conditions.run_in(1))
    fine = np.linspace(-0.45, 1.05, 4001)
    edges = np.array([[-0.45, 0.3, 1.05]])
    short_course = Course(TURNS, np.array([2]), np.zeros(1, np.int64), edges, np.zeros(1), 1.0, 0.0)
    long_course = Course(TURNS, np.full(4001, 2), np.zeros(4001, np.int64), points(fine), np.zeros(4001), 1.0, 0.0)
    (mean,) = read(rubbing, course=short_course).angle
    every = read(rubbing, course=long_course).angle
    assert np.ptp(every) > 0.5  # through the play
    assert mean == pytest.approx(np.mean(0.5 * (every[1:] + every[:-1])), abs=2e-3 * np.ptp(every))


@pytest.mark.parametrize("is_output_locked", [False, True])
@pytest.mark.parametrize("friction", ["coulomb", "load_friction", "contact_friction"])
def test_a_loaded_output_twists_what_is_in_series_by_all_of_its_torque(drive, friction, is_output_locked):
    """A flange and its lever lie beyond the friction; at a locked output they carry what friction leaves."""
    rubbing = library()[friction].apply(drive, [0.1], Conditions.run_in(1))
    course = replace(course_of(time=np.linspace(0, 400, 4 * ROWS)), is_output_locked=is_output_locked)
    plain = read(rubbing, course=course)
    torque = plain.carried_torque if is_output_locked else 1e3 * course.cell_torques[:, 0]
    forward, sprung = Forward([course], drive.rated_torque), rubbing.with_elements(LinearSpring(1e-9))
    twisted = forward.read((sprung,), 0, Instrument())
    np.testing.assert_allclose(twisted.angle - plain.angle, ARCMIN * 1e-9 * torque, atol=1e-9)
    np.testing.assert_allclose(twisted.slope - plain.slope, 1e3 * ARCMIN * 1e-9)
    change = forward.change((sprung,), (sprung.with_elements(LinearSpring(1e-10)),), 0, twisted.carried_torque)
    np.testing.assert_allclose(change, ARCMIN * 1e-10 * torque, atol=1e-9)
    creeping = read(rubbing.with_elements(KelvinVoigt(1e-9, 1e-3)), course=course)  # so fast that it is a spring
    np.testing.assert_allclose(creeping.angle - plain.angle, ARCMIN * 1e-9 * torque, atol=0.01)


@pytest.mark.parametrize(("friction", "size"), [("coulomb", 1.5), ("load_friction", 0.2)])
def test_after_a_turn_friction_holds_the_output_to_a_few_thousandths_of_an_arcmin(drive, friction, size):
    rubbing = library()[friction].apply(drive, [size], Conditions.run_in(1))
    torque = course_of().cell_torques[:, 0]
    is_held = (torque > 9.5) & (np.arange(len(torque)) >= ROWS) & (np.arange(len(torque)) < 2 * ROWS)
    assert is_held.sum() > 3
    assert np.ptp(read(rubbing).angle[is_held]) < 0.003


def test_instrument_reads_torque_and_angle_with_its_errors(drive):
    course = course_of(time=np.linspace(0, 7200, 4 * ROWS), encoder_turns=79.0, position=0.4)
    reference = read(drive, course=course).angle
    np.testing.assert_allclose(
        read(drive, Instrument(drift=1.5), course).angle - reference, np.linspace(0, 3, 4 * ROWS)
    )
    encoder_angle = 79 * reference / ARCMIN + 0.4
    computed_angle = read(drive, Instrument(encoder=(0.8, -0.6)), course).angle - reference
    np.testing.assert_allclose(computed_angle, 0.8 * np.cos(encoder_angle) - 0.6 * np.sin(encoder_angle), atol=1e-9)
    stretched = replace(course, torque=1.1 * course.torque + 0.5, cell_torques=1.1 * course.cell_torques + 0.5)
    computed_angle = read(drive, Instrument(torque_gain=0.1, torque_zero=0.5), stretched).angle
    np.testing.assert_allclose(computed_angle, reference, atol=0.02)  # at nodes of another ladder


STEEP, ZERO, ANGLE_NOISE = Ripple(400.0, 40_000.0, 0.7), 2.0, 0.01
"""A ripple [N mm] that throws the output back, zero of the angle read and its noise [arcmin]."""


def rippled(torque_read, angle, course, noise=0.0):
    """The course on which ``angle`` (n_cells,) [arcmin] was measured, from another zero, with the torque read."""
    turns = course.torque + (torque_read - course.cell_torques[:, 0])[course.edges_beside_turns[0]]
    rows = points(torque_read), points(angle + ZERO + noise * np.random.default_rng(0).standard_normal(len(angle)))
    return replace(course, torque=turns, cell_torques=points(torque_read), rows=rows)


def read_with_ripple(drive, torque_read, angle, course, noise=0.0, ripple=STEEP):
    """Prediction on such a course."""
    in_space = replace(ripple, phase=ripple.phase - ripple.waves * ZERO / ARCMIN)  # the angle is that from its zero
    return read(drive, Instrument(ripple=in_space), rippled(torque_read, angle, course, noise))


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_bench_that_turns_the_output_passes_every_balance_of_a_ripple(drive, friction):
    """The torque that it reads goes back where the ripple falls faster than the torque in the drive rises."""
    rubbing = library()["coulomb"].apply(drive, [friction], Conditions.run_in(1))
    course = course_of()
    plain = read(rubbing, course=course)
    torque_read = course.cell_torques[:, 0] + 1e-3 * STEEP.value(plain.angle / ARCMIN)
    rising = slice(2 * ROWS, 3 * ROWS)
    assert np.any(np.diff(torque_read[rising]) < 0)
    for noise, tolerance in ((0.0, 1e-3), (ANGLE_NOISE, 0.15 * ANGLE_NOISE)):
        reading = read_with_ripple(rubbing, torque_read, plain.angle, course, noise)
        assert reading.sound
        assert np.any(reading.response < 0)  # where the torque falls with the angle
        error = reading.angle - plain.angle
        assert np.median(np.abs(error - np.median(error))) < tolerance
        if not noise:  # friction holds the output where the torque in the drive turned, not the torque read
            after_turns = np.concatenate([np.arange(ROWS, ROWS + 3), np.arange(2 * ROWS, 2 * ROWS + 3)])
            assert np.median(np.abs(error - np.median(error))[after_turns]) < 2e-3
    steeper = replace(STEEP, amplitude=3 * STEEP.amplitude)  # than the drive at most cells: any angle has a balance
    assert not read_with_ripple(rubbing, torque_read, plain.angle, course, ripple=steeper).sound
    missed = read(rubbing, course=replace(course, cell_torques=points(torque_read))).angle - plain.angle
    assert np.std(missed) > 5 * ANGLE_NOISE


def test_a_bench_that_raises_the_torque_jumps_over_some_balances_of_a_ripple(drive):
    course = course_of()
    curve = backbone(drive, Forward([course], drive.rated_torque).shares)
    torque_read = course.cell_torques[:, 0]
    angle, _ = turned_in_small_steps(1e3 * torque_read, curve.torque, curve.angle[0], drive.sliders, STEEP)
    jumps = np.abs(np.diff(angle[2 * ROWS : 3 * ROWS]))
    assert np.max(jumps) > 3 * np.median(jumps)
    reading = read_with_ripple(drive, torque_read, ARCMIN * angle, course)
    error = reading.angle - ARCMIN * angle
    assert np.quantile(np.abs(error - np.median(error)), 0.9) < 0.01


def test_what_a_ripple_answers_to_a_change_of_the_curve_is_its_derivative(drive):
    """A spring in series moves the angle by less where the ripple rises with the angle, and by more where it falls."""
    course, gentle = course_of(), replace(STEEP, amplitude=100.0)
    torque = course.cell_torques[:, 0]
    plain = read(drive, course=course)
    torque_read = torque + 1e-3 * gentle.value(plain.angle / ARCMIN)
    reading, softer = (
        read_with_ripple(unit, torque_read, plain.angle, course, ripple=gentle)
        for unit in (drive, drive.with_elements(LinearSpring(1e-10)))
    )
    is_loaded = np.abs(torque) > 2.0
    assert np.ptp(reading.response[is_loaded]) > 0.5
    change, twist = softer.angle - reading.angle, ARCMIN * 1e-10 * reading.carried_torque
    by_zero = np.column_stack([np.ones(len(torque)), 1 - reading.response])[is_loaded]  # the zero of the angle moves
    differences = []
    for expected in (reading.response * twist, twist):
        difference = (change - expected)[is_loaded]
        moved = np.linalg.lstsq(by_zero, difference, rcond=None)[0]
        differences.append(np.median(np.abs(difference - by_zero @ moved)))
    assert differences[0] < 0.02 * np.median(np.abs(twist))
    assert differences[1] > 5 * differences[0]


@pytest.mark.parametrize("change", [{"amplitude": 102.0}, {"phase": 0.72}, {"waves": 40_010.0}])
def test_the_change_by_a_ripple_is_that_of_predictions(drive, change):
    course, gentle = course_of(), replace(STEEP, amplitude=100.0)
    angle = read(drive, course=course).angle
    course = rippled(course.cell_torques[:, 0] + 1e-3 * gentle.value((angle + ZERO) / ARCMIN), angle, course)
    forward = Forward([course], drive.rated_torque)
    before, after = (Instrument(ripple=ripple) for ripple in (gentle, replace(gentle, **change)))
    readings = [forward.read((drive,), 0, instrument) for instrument in (before, after)]
    curve_slope = readings[0].slope / readings[0].response
    computed = answered(forward.change_by_ripple(0, before, after, curve_slope), readings[0].response)
    balances = before.ripple.balances(curve_slope / ARCMIN / NMM_PER_NM)
    np.testing.assert_allclose(readings[0].balances, balances)
    assert np.max(forward.read((drive,), 0, Instrument(ripple=STEEP)).balances) > 1.2
    is_loaded = np.abs(course.cell_torques[:, 0]) > 2.0
    by_zero = np.column_stack([np.ones(len(angle)), 1 - readings[0].response])[is_loaded]  # the zero of the angle moves
    difference = (readings[1].angle - readings[0].angle - computed)[is_loaded]
    difference -= by_zero @ np.linalg.lstsq(by_zero, difference, rcond=None)[0]
    assert np.median(np.abs(difference)) < 0.05 * np.median(np.abs(computed[is_loaded]))
    assert forward.change_by_ripple(0, before, replace(after, drift=1.0), readings[0].slope) is None
    assert forward.change_by_ripple(0, before, before, readings[0].slope) == 0.0


def test_an_interpolation_error_is_a_wave_of_the_angle_measured_at_every_torque(drive):
    course = course_of()
    plain = read(drive, course=course).angle
    course = replace(course, rows=(course.cell_torques, points(plain + ZERO)))
    error = Ripple(0.05, 16_000.0, 0.4)
    expected = 0.05 * np.sin(16_000.0 * (plain + ZERO) / ARCMIN + 0.4)
    erring, forward = Instrument(interpolation=error), Forward([course, course], drive.rated_torque)
    np.testing.assert_allclose(forward.read((drive,), 0, erring).angle - plain, expected, atol=1e-9)
    change = forward.change_by_ripple(0, Instrument(), erring, np.zeros(len(plain)))
    np.testing.assert_allclose(change, expected, atol=1e-12)
    of_positions = replace(erring, interpolation_phases=(1.1,))
    expected = 0.05 * np.sin(16_000.0 * (plain + ZERO) / ARCMIN + 1.5)
    np.testing.assert_allclose(forward.read((drive,), 1, of_positions).angle - plain, expected, atol=1e-9)


def test_the_nearest_of_several_roots_is_found_and_none_where_the_function_has_none():
    phase, lift = np.array([0.3, -0.3, 3.0, 0.0]), np.array([0.0, 0.0, 0.0, 2.0])

    def function(x):
        return np.sin(4 * x - phase) + lift, 4 * np.cos(4 * x - phase)

    places = np.linspace(-1.0, 1.0, 11)
    root, is_found = _nearest_root(function, places, np.array([function(np.full(4, place))[0] for place in places]))
    np.testing.assert_array_equal(is_found, [True, True, True, False])
    np.testing.assert_allclose(root, [0.075, -0.075, (3.0 - np.pi) / 4, 0.0], atol=1e-7)


def test_beside_a_turn_is_the_end_of_the_cell_before_it():
    course = course_of()
    torque = course.cell_torques[:, 0]
    course = replace(course, cell_torques=np.column_stack([torque - 0.1, torque, torque + 0.1]))
    last = torque[[0, ROWS - 1, 2 * ROWS - 1, 3 * ROWS - 1, 4 * ROWS - 1]]
    np.testing.assert_allclose(course.cell_torques[course.edges_beside_turns], last + [-0.1, 0.1, -0.1, 0.1, -0.1])


@pytest.mark.parametrize("ripple", [(-1.0, 1.0), (1.0, 0.0)])
def test_a_ripple_of_negative_amplitude_or_without_waves_is_refused(ripple):
    with pytest.raises(ValueError, match="must be positive"):
        Ripple(*ripple)


def test_creep_after_a_step_is_that_of_spring_and_damper(drive):
    """Ramp within a millisecond, hold, and release: (1 - exp(-t/tau)) and its superposition."""
    compliance, tau = 2e-9, 40.0
    hold = np.linspace(0.001, 200, 60)
    turns = np.array([0.0, 12.0, 6.0])
    sample_times = np.concatenate([[0.0], np.full(60, 12.0), np.full(60, 6.0)])
    leg = np.concatenate([[0], np.zeros(60, np.int64), np.ones(60, np.int64)])
    time = np.concatenate([[0.0], hold, 200 + hold])
    course = Course(turns, leg, np.zeros(121, np.int64), points(sample_times), time, 1.0, 0.0)
    variant = drive.with_elements(KelvinVoigt(compliance, tau))
    computed_angle = read(variant, course=course).angle - read(drive, course=course).angle

    def rise(t):
        return np.where(t > 0, -np.expm1(-np.maximum(t, 0) / tau), 0.0)

    expected = ARCMIN * compliance * 1e3 * (12 * rise(time) - 6 * rise(time - 200))
    np.testing.assert_allclose(computed_angle, expected, atol=1e-9 + 1e-4 * expected.max())


def delayed(torque, time, creep):
    """Rotation [rad] of spring and damper under a torque [N mm], by fine trapezoids."""
    passes = np.exp((time - time[-1]) / creep.time_constant)
    rate = creep.compliance * torque / creep.time_constant
    sums = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (passes[1:] * rate[1:] + passes[:-1] * rate[:-1]))])
    return sums / passes


@pytest.mark.parametrize("time_constant", [8.0, 40.0, 300.0])
@pytest.mark.parametrize("per_leg", [2, 3, 5])
def test_creep_read_at_few_cells_is_that_of_the_whole_course(drive, per_leg, time_constant):
    """No cell is at a turn: the turns lie between the cells."""
    period, creep = 60.0, KelvinVoigt(2e-9, time_constant)
    leg = np.repeat(np.arange(len(TURNS) - 1), per_leg)
    shares = np.tile((np.arange(per_leg) + 0.5) / per_leg, len(TURNS) - 1)
    start, end = TURNS[leg], TURNS[leg + 1]
    length = np.where(np.abs(end - start) > 12, 2.0, 1.0)  # one speed of the torque
    start_times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(TURNS)) / 12.0)]) * period
    time = start_times[leg] + period * length * shares
    torque = start + shares * (end - start)
    course = Course(TURNS, leg, np.zeros(len(leg), np.int64), points(torque), time, 1.0, 0.0)
    computed_angle = read(drive.with_elements(creep), course=course).angle - read(drive, course=course).angle
    fine = np.linspace(0.0, start_times[-1], 40001)
    whole = ARCMIN * delayed(1e3 * np.interp(fine, start_times, TURNS), fine, creep)
    np.testing.assert_allclose(computed_angle, np.interp(time, fine, whole), atol=0.01 * np.ptp(whole))


@pytest.mark.parametrize(("share", "time_constant"), [(0.05, 8.0), (-0.03, 40.0)])
def test_torque_that_a_creeping_sensor_reads_is_that_of_the_drive(drive, share, time_constant):
    """Read is the torque and a share of it with a first-order delay, here by fine trapezoids."""
    period, per_leg = 60.0, 60
    turn_times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(TURNS)) / 12.0)]) * period
    fine = np.linspace(0.0, turn_times[-1], 40001)
    torque = np.interp(fine, turn_times, TURNS)
    torque_read = torque + share * delayed(torque, fine, KelvinVoigt(1.0, time_constant))
    leg = np.repeat(np.arange(len(TURNS) - 1), per_leg)
    time = turn_times[leg] + np.diff(turn_times)[leg] * np.tile((np.arange(per_leg) + 0.5) / per_leg, len(TURNS) - 1)
    course = Course(
        np.interp(turn_times, fine, torque_read),
        leg,
        np.zeros(len(leg), np.int64),
        points(np.interp(time, fine, torque_read)),
        time,
        1.0,
        0.0,
    )
    turns, edges = Instrument(torque_creep=(share, time_constant)).torques(course)
    crept = np.ptp(torque_read - torque)
    np.testing.assert_allclose(edges[:, 0] / 1e3, np.interp(time, fine, torque), atol=0.005 * crept)
    np.testing.assert_allclose(turns[:-1] / 1e3, TURNS[:-1], atol=0.03 * crept)


def test_a_sensor_creeps_on_while_the_play_is_crossed_at_no_torque():
    """The reading goes back there, and the rows of the play are in no cell: all rows tell the delay."""
    times = np.array([0.0, 20.0, 40.0, 70.0, 90.0, 110.0])
    fine = np.linspace(0.0, times[-1], 11_001)
    torque = np.interp(fine, times, [0.0, 12.0, 0.0, 0.0, -12.0, 0.0])
    torque_read = torque + 0.1 * delayed(torque, fine, KelvinVoigt(1.0, 10.0))
    time = np.concatenate([np.arange(1.0, 20.0), np.arange(21.0, 40.0), np.arange(71.0, 90.0), np.arange(91.0, 110.0)])
    leg = np.repeat([0, 1, 1, 2], 19)
    turns = np.interp([0.0, 20.0, 90.0, 110.0], fine, torque_read)
    cell_torques = points(np.interp(time, fine, torque_read))
    course = Course(turns, leg, np.zeros(len(leg), np.int64), cell_torques, time, 1.0, 0.0)
    every_row = fine[::100], torque_read[::100]
    errors = []
    for known in (course, replace(course, readings=every_row, edge_times=np.repeat(time[:, None], 2, axis=1))):
        at_turns, edges = Instrument(torque_creep=(0.1, 10.0)).torques(known)
        enlarged = replace(
            known,
            torque=1.2 * known.torque,
            cell_torques=1.2 * known.cell_torques,
            readings=None if known.readings is None else (known.readings[0], 1.2 * known.readings[1]),
        )
        of_gain = Instrument(torque_gain=0.2, torque_creep=(0.1, 10.0)).torques(enlarged)
        np.testing.assert_allclose(of_gain[1], edges)
        errors.append(np.max(np.abs(edges[:, 0] / 1e3 - np.interp(time, fine, torque))))
    np.testing.assert_allclose(at_turns[1:3] / 1e3, [12.0, -12.0], atol=0.06)  # the last row is a second before
    assert errors[1] < 0.003
    assert errors[0] > 10 * errors[1]


def test_friction_at_the_contacts_shifts_the_branches_apart_with_the_load(drive):
    usual = Conditions.run_in(1)
    rubbing = library()["contact_friction"].apply(drive, [0.02], usual)
    reading = read(rubbing)
    assert reading.sound
    falling, rising = slice(ROWS, 2 * ROWS), slice(2 * ROWS, 3 * ROWS)
    separation = reading.angle[falling][::-1] - reading.angle[rising]  # at equal torques
    torque = course_of().cell_torques[rising, 0]
    middle = np.interp([2.0, 8.0], torque, separation)
    assert middle[1] > 1.5 * middle[0] > 0
    repeated = read(rubbing, course=course_of(np.append(TURNS[:-1], [-12.0, 12.0, 0.0])))
    np.testing.assert_allclose(repeated.angle[3 * ROWS : 4 * ROWS], reading.angle[falling], atol=0.02)


def test_influence_of_a_shift_of_all_gaps_is_the_difference_of_readings(drive):
    course, step = course_of(), 1e-5
    forward = Forward([course], drive.rated_torque)
    pattern = np.zeros((1, len(drive.laws)))
    pattern[0, : drive.reducer.n_pins] = 1.0
    carried_torque = forward.read((drive,), 0, Instrument()).carried_torque
    derivative = forward.influence((drive,), 0, carried_torque, (pattern,))[:, 0]
    ends = [read(replace(drive, shift=drive.shift + sign * step * pattern)).angle for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(derivative, expected, atol=0.05 * np.abs(expected).max())
    assert np.median(np.abs(derivative - expected)) < 0.01 * np.abs(expected).max()


def test_changes_at_other_torques_and_of_other_drives_are_their_own_whatever_was_asked_before(drive):
    """Weights of nodes are kept for the torques and the drive of the latest question alone."""
    other = drive.with_added_gap(np.full_like(drive.gap, 2e-3))
    patterns = np.eye(drive.gap.shape[1])[:3]
    course = course_of()
    torque = NMM_PER_NM * course.cell_torques.mean(axis=1)
    asked = [(one, scale * torque) for one in (drive, other) for scale in (1.0, 0.5)]
    forward = Forward([course], drive.rated_torque)
    answers = [forward.influence((one,), 0, carried, (patterns,)) for one, carried in [*asked, *asked[::-1]]]
    fresh = [Forward([course], drive.rated_torque).influence((one,), 0, carried, (patterns,)) for one, carried in asked]
    for answer, alone in zip(answers, [*fresh, *fresh[::-1]], strict=True):
        np.testing.assert_array_equal(answer, alone)
    assert np.max(np.abs(fresh[0] - fresh[1])) > 0.1 * np.max(np.abs(fresh[0]))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_cycle_that_ends_on_the_way_between_two_turns_ends_there(drive, friction):
    """From 0 over both turns to 0 again, and on: cells of one leg belong to two cycles."""
    worn = library()["coulomb"].apply(drive, [friction], Conditions.run_in(1))
    both, course = library()["run_in"].apply(worn.some(np.array([0, 0])), [3.0, 1.0], FIRST_AND_LAST), course_of()
    second = np.arange(len(course.leg)) >= 2.5 * ROWS
    readings = [read(both, course=replace(course, state=state)).angle for state in (0 * second, 0 * second + 1)]
    mixed = read(both, course=replace(course, state=second.astype(int)))
    assert mixed.sound
    np.testing.assert_allclose(mixed.angle, np.where(second, readings[1], readings[0]), atol=1e-12)
    assert np.max(np.abs(readings[1] - readings[0])) > 0.1


@pytest.mark.parametrize(
    ("effect", "size"), [("", 0.0), ("coulomb", 0.3), ("contact_friction", 0.05), ("sliding", 0.3)]
)
def test_between_two_states_the_angle_lies_on_a_line(drive, effect, size):
    """A quarter of the way from the new drive to the worn one; with friction, and where the output slides all along."""
    name = "coulomb" if effect == "sliding" else effect
    rubbing = library()[name].apply(drive, [size], Conditions.run_in(1)) if name else drive
    both, course = library()["run_in"].apply(rubbing.some(np.array([0, 0])), [3.0, 1.0], FIRST_AND_LAST), course_of()
    if effect == "sliding":
        course = replace(course, sliding=np.where(course.cell_torques[:, 0] > 0, 1, -1))
    courses = [replace(course, state=np.full(len(course.leg), share)) for share in (0, 1, 0.25)]
    forward = Forward(courses, drive.rated_torque)
    new, worn, between = (forward.read((both,), number, Instrument()) for number in range(3))
    for values in ("angle", "slope", "carried_torque"):
        expected = 0.75 * getattr(new, values) + 0.25 * getattr(worn, values)
        np.testing.assert_allclose(getattr(between, values), expected, rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(worn.angle - new.angle)) > 0.1
    gaps = (1e-3 * np.ones((1, len(drive.laws))),)
    at_new, at_worn, at_place = (forward.influence((both,), number, new.carried_torque, gaps) for number in range(3))
    np.testing.assert_allclose(at_place, 0.75 * at_new + 0.25 * at_worn, atol=1e-9)


@pytest.mark.parametrize("steepness", [0.5, 1.0, 1.3, 2.0, 6.0])
def test_a_ripple_has_as_many_balances_as_sign_changes_are_counted(steepness):
    """x + b sin(x + phase) over 400 phases; a drive of 2e-6 rad/(N mm) and 20,000 waves a turn."""
    ripple = Ripple(steepness / 2e-6 / 20_000, 20_000.0)
    x = np.linspace(-8, 8, 20_001)
    phases = 2 * np.pi * (np.arange(400) + 0.5) / 400
    counts = [np.count_nonzero(np.diff(np.sign(x + steepness * np.sin(x + phase)))) for phase in phases]
    assert ripple.balances(np.array([2e-6]))[0] == pytest.approx(np.mean(counts), abs=0.02)
    assert Ripple().balances(np.array([2e-6])) == 1

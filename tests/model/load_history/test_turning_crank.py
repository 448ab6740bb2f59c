"""The curve of a drive whose output is locked while its crank turns, against closed forms and the held crank."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, history, small_drive
from scipy.interpolate import CubicSpline, PchipInterpolator

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.load_history.backbone import backbone, torque_levels
from pipeline.model.load_history.friction.output_path import output_path
from pipeline.model.load_history.turning_crank import CurvesOverCrank, stored_energy

TORQUE = np.concatenate([-np.linspace(30, 0.01, 60), np.linspace(0.01, 30, 60)])
RATIO = -13.0
SOFT = 2e-3
"""[rad/(N mm)]"""


def curves(error=0.0, softer=0.0, order=1.0, period=2 * np.pi, count=48, play=0.01) -> CurvesOverCrank:
    """An angle error [rad] and a compliance that vary with an order of the crank angle."""
    crank = np.arange(count) / count * period
    wave = np.cos(order * crank)[:, None]
    angle = SOFT * TORQUE * (1 + softer * wave) + 0.5 * play * np.sign(TORQUE) + error * wave
    return CurvesOverCrank(crank, TORQUE, angle, period=period)


def test_a_sinusoidal_angle_error_alone_has_a_closed_form_with_its_factor_of_the_torque():
    start, error = 0.8, 0.008
    locked = curves(error).locked_curve(start, RATIO)
    crank = start - RATIO * locked.angle
    np.testing.assert_allclose(locked.crank, crank, atol=1e-12)
    strain = SOFT * TORQUE + 0.005 * np.sign(TORQUE)
    np.testing.assert_allclose(locked.angle, strain + error * np.cos(crank), atol=1e-7)
    factor = 1 + RATIO * -error * np.sin(crank)  # i tau = T (1 + i dte/dphi)
    assert np.ptp(factor) > 0.09
    np.testing.assert_allclose(locked.torque, TORQUE * factor, rtol=1e-4)


@pytest.mark.parametrize("extended", [False, True])
def test_each_node_is_read_off_its_own_curve(extended):
    """Angle and slope against those of all curves at all crank angles; beyond the known ones they go on straight."""
    case = curves(0.008, softer=0.2)
    if extended:
        case = CurvesOverCrank(case.crank, TORQUE, case.angle, extended=True)
    crank, nodes = np.linspace(-1.0, 8.0, len(TORQUE)), np.arange(len(TORQUE))
    angle, slope = case._at_nodes(crank)
    placed = case.crank_in_range(crank)
    assert extended == np.any(placed != np.mod(crank, 2 * np.pi))
    beyond = crank - placed if extended else 0.0
    of_all, slopes = (case.spline(placed, order)[nodes, nodes] for order in (0, 1))
    np.testing.assert_allclose(angle, of_all + beyond * slopes, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(slope, slopes, rtol=1e-12, atol=1e-14)


def test_the_torque_of_the_motor_is_the_derivative_of_the_energy():
    """V(a) of a spring whose compliance varies: a^2 / (2 c(phi)), without play."""
    start, softer = 2.1, 0.2
    locked = curves(softer=softer, play=0.0).locked_curve(start, RATIO)

    def energy(twist):
        return twist**2 / (2 * SOFT * (1 + softer * np.cos(start - RATIO * twist)))

    step = 1e-6
    derivative = (energy(locked.angle + step) - energy(locked.angle - step)) / (2 * step)
    np.testing.assert_allclose(locked.torque, derivative, rtol=2e-4, atol=1e-4)
    assert np.max(np.abs(locked.torque / TORQUE - 1)) > 0.05


def test_where_nothing_depends_on_the_crank_the_loop_is_that_of_the_crank_that_is_held():
    locked = curves().locked_curve(0.3, RATIO)
    held = curves().angle[0]
    np.testing.assert_allclose(locked.torque, TORQUE, rtol=1e-13)
    np.testing.assert_allclose(locked.angle, held, atol=1e-13)
    sliders = Sliders(np.ones((1, 1)), np.array([1e5]), np.array([1.0]), np.array([0.1]), np.array([-1]))
    turns = history(0.0, 20.0, -20.0, 20.0, steps=3)
    paths = [
        output_path(turns, torque, angle, sliders)
        for torque, angle in ((TORQUE, held), (locked.torque, locked.angle))
    ]
    np.testing.assert_allclose(paths[1].corners, paths[0].corners, atol=1e-10)


def test_a_whole_turn_changes_nothing_and_one_of_the_crank_only_what_belongs_to_a_lobe():
    pin_circle = curves(0.006)
    lobe = curves(0.006, order=14 / 13, period=2 * np.pi * 13, count=400)
    for case, turn in ((pin_circle, 2 * np.pi), (lobe, 2 * np.pi * 13)):
        np.testing.assert_allclose(
            case.locked_curve(0.4 + turn, RATIO).angle, case.locked_curve(0.4, RATIO).angle, atol=1e-12
        )
    changed = lobe.locked_curve(0.4 + 2 * np.pi, RATIO).angle - lobe.locked_curve(0.4, RATIO).angle
    assert np.max(np.abs(changed)) > 1e-3


def test_the_error_of_interpolation_is_stated_and_falls_sixteenfold():
    errors = []
    for count in (12, 24, 48):
        case = curves(0.006, count=count)
        between = case.crank + np.pi / count
        true = case.angle[0] - 0.006 + 0.006 * np.cos(between)[:, None]
        assert np.max(np.abs(case.spline(between) - true)) < case.error
        errors.append(case.error)
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.4)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.4)
    with pytest.raises(ValueError, match="4 crank angles"):
        _ = curves(count=4).error


def test_a_jump_and_an_unknown_crank_angle_are_refused():
    with pytest.raises(ValueError, match="jumps"):
        curves(0.006, order=14.0, count=400).locked_curve(0.0, RATIO)
    window = CurvesOverCrank(curves().crank[:10], TORQUE, curves().angle[:10])
    with pytest.raises(ValueError, match="the crank turns from"):
        window.locked_curve(0.3, RATIO)


def test_an_angle_that_rises_with_the_crank_is_no_jump_but_one_that_falls_as_fast_is():
    """With a(T, phi) = T / k + s phi the locked output turns by T / k / (1 + i s)."""
    crank, spring = np.linspace(-1.0, 1.0, 9), 1e-4 * TORQUE / TORQUE[-1]
    angle = spring + 2.0 / RATIO * crank[:, None]
    locked = CurvesOverCrank(crank, TORQUE, angle).locked_curve(0.0, RATIO)
    np.testing.assert_allclose(locked.angle, spring / 3, atol=1e-12)
    with pytest.raises(ValueError, match="jumps"):
        CurvesOverCrank(crank, TORQUE, spring - 2.0 / RATIO * crank[:, None]).locked_curve(0.0, RATIO)


def test_curves_that_cross_between_the_stations_are_no_jump():
    """Close to the play two nodes differ by less than what is interpolated between the stations is off by."""
    known = curves()
    angle = known.angle.copy()
    angle[:, -1] = angle[:, -2] - 1e-9
    locked = CurvesOverCrank(known.crank, TORQUE, angle, period=known.period).locked_curve(0.0, RATIO)
    assert np.all(np.diff(locked.angle) >= 0)


def test_a_reducer_reaches_the_gaps_of_the_crank_angle_that_it_turns_to():
    """Curves of the reducer itself: the locked angle is that of the crank held where the locked drive has come to."""
    cranks = 0.4 + np.linspace(-0.2, 0.2, 9)
    shares = torque_levels(8, 1.0)
    drives = [small_drive(crank=crank, seed=3) for crank in cranks]
    case = CurvesOverCrank.from_drives(drives, [backbone(drive, shares) for drive in drives], cranks)
    locked = case.locked_curve(0.4, -9.0)
    last = backbone(small_drive(crank=float(locked.crank[-1]), seed=3), shares)
    assert abs(locked.crank[-1] - 0.4) > 1e-3
    assert last.angle[0, -1] == pytest.approx(locked.angle[-1], abs=2 * case.error + 1e-10)
    assert locked.carried_torque[-1] == pytest.approx(RATED)


def test_the_motor_of_a_preloaded_drive_feels_its_energy_over_the_crank_angle():
    """The torque is the derivative of all that is stored, found from the poses of one crank angle after the other."""
    cranks, shares = 0.4 + np.linspace(-0.25, 0.25, 21), torque_levels(12, 1.0)
    drives = [small_drive(crank=crank, seed=3, play=-4e-3) for crank in cranks]
    solved = [backbone(drive, shares) for drive in drives]
    case = CurvesOverCrank.from_drives(drives, solved, cranks)
    assert np.ptp(case.elastic_energy) > 1e-3 * np.mean(case.elastic_energy) > 0
    node = len(case.torque) // 2 + 8
    stored = [case.elastic_energy[k, 1] + stored_with(solved[k], node) for k in range(len(cranks))]
    angle = CubicSpline(cranks, case.angle[:, node])
    work = CubicSpline(cranks, stored)(0.4, 1) - case.torque[node] * angle(0.4, 1)  # dV/dphi at the angle that is held
    start = 0.4 - 9.0 * angle(0.4)
    locked = case.locked_curve(float(start), -9.0)
    assert locked.crank[node] == pytest.approx(0.4, abs=1e-9)
    assert locked.torque[node] == pytest.approx(case.torque[node] + 9.0 * work, rel=5e-4)
    assert abs(locked.torque[node] / case.torque[node] - 1) > 0.004


def test_the_energy_of_preload_falls_with_each_gap_by_the_force_there():
    """Whatever the laws of contacts, bodies and bearings: dU/dgap = -F at equilibrium without torque."""
    drive, shares = small_drive(1, play=-4e-3), torque_levels(4, 1.0)
    curve = backbone(drive, shares)
    force = curve.limits.force[0, 0]
    assert np.count_nonzero(force) > 3
    for contact in np.argsort(-force)[:3]:
        step = np.zeros_like(drive.shift)
        step[0, contact] = 1e-6
        wider, closer = (drive.with_added_gap(sign * step) for sign in (1.0, -1.0))
        energies = [stored_energy(one, backbone(one, shares), 0)[1] for one in (wider, closer)]
        assert (energies[0] - energies[1]) / 2e-6 == pytest.approx(-force[contact], rel=2e-3)


def test_the_energy_without_torque_acts_on_its_own_side_of_the_play():
    """What is stored above no torque alone moves the motor at positive torques alone."""
    case = curves()
    wave = np.column_stack([np.zeros(len(case.crank)), 2.0 * np.sin(case.crank)])  # [N mm]
    plain, stored = case.locked_curve(0.5, RATIO), replace(case, elastic_energy=wave).locked_curve(0.5, RATIO)
    np.testing.assert_array_equal(stored.angle, plain.angle)
    expected = np.where(TORQUE > 0, -RATIO * 2.0 * np.cos(plain.crank), 0.0)
    np.testing.assert_allclose(stored.torque - plain.torque, expected, atol=1e-3)


def stored_with(curve, node):
    """Energy that the torque adds from its limit to a node: T a less the integral of a over T."""
    middle = len(curve.torque) // 2
    torque, angle = curve.torque[middle : node + 1], curve.angle[0, middle : node + 1]
    return float(PchipInterpolator(angle, torque).integrate(angle[0], angle[-1]))

"""Sliding, pressure times speed, shear, life and efficiency against exact kinematics and closed forms."""

import numpy as np
import pytest
from reducers import PAPER, SMALL, laws_of, pins_in_holes, reducer_at

from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import nominal_reducer
from pipeline.model.metrics.turn import RunningConditions, TurnReadings, turn_library
from pipeline.model.metrics.turn.life import equivalent_load, rating_life
from pipeline.model.turn import Running, sliding_speed

SPEED = 157.0  # rad/s


def placed(profile, crank, point):
    """Where points of the disk stand in the housing: turned about its centre, which the crank carries."""
    return profile.eccentricity * np.exp(1j * crank) + point * np.exp(1j * disk_rotation(profile, crank))


@pytest.mark.parametrize("profile", [PAPER, SMALL])
def test_sliding_at_the_pins_by_finite_differences_of_the_exact_motion(profile):
    step = 1e-6
    for crank in (0.3, 2.0, 4.4):
        reducer = reducer_at(profile, crank)
        pins = reducer.pins
        lever = (pins.point - profile.eccentricity * np.exp(1j * crank)) * np.exp(-1j * disk_rotation(profile, crank))
        velocity = SPEED * (placed(profile, crank + step, lever) - placed(profile, crank - step, lever)) / (2 * step)
        normal_part = np.imag(np.conj(pins.normal) * velocity)
        normal_slip = np.real(np.conj(pins.normal) * velocity)
        speed = sliding_speed(profile, reducer, SPEED)[: reducer.n_pins]
        np.testing.assert_allclose(speed, np.abs(normal_part), rtol=1e-6)
        assert np.abs(normal_slip).max() < 1e-6 * speed.max()  # surfaces that touch neither part nor overlap


def test_sliding_in_the_holes_by_finite_differences_of_the_exact_motion():
    mechanism = pins_in_holes(SMALL, 6, phase_deg=20.0)
    step, crank = 1e-6, 0.7
    reducer = nominal_reducer(SMALL, mechanism, crank)
    holes = reducer.contacts.hole >= 0
    point, rotation = reducer.contacts.point[holes], np.exp(-1j * disk_rotation(SMALL, crank))
    lever = (point - SMALL.eccentricity * np.exp(1j * crank)) * rotation

    def apart(angle):  # the disk's point of the contact from the output's
        return placed(SMALL, angle, lever) - point * rotation * np.exp(1j * disk_rotation(SMALL, angle))

    velocity = SPEED * (apart(crank + step) - apart(crank - step)) / (2 * step)
    normal_part = np.imag(np.conj(reducer.contacts.normal[holes]) * velocity)
    np.testing.assert_allclose(sliding_speed(SMALL, reducer, SPEED)[holes], np.abs(normal_part), rtol=1e-6)
    assert np.all(sliding_speed(PAPER, reducer_at(PAPER, 0.3), SPEED)[PAPER.pins :] == 0)  # rollers roll


def test_depth_of_the_shear_by_the_half_width_of_the_contact():
    reducer = reducer_at(PAPER, 0.2)
    laws, force = laws_of(PAPER, reducer, length=2.0), np.full(len(reducer.contacts), 100.0)
    radius = 1 / (1 / PAPER.pin_radius + reducer.pins.flank_curvature)
    half_width = np.sqrt(4 * (100.0 / 2.0) * radius / (np.pi * 103e3 / (1 - 0.3**2)))  # plane strain
    running = Running(np.full(len(force), 2.0), np.zeros(len(force)), np.ones(len(force)), np.ones(len(force)))
    np.testing.assert_allclose(running.shear_depth(laws, force)[: reducer.n_pins], 0.786 * half_width, rtol=1e-9)
    assert np.all(running.shear_depth(laws, 0 * force) == 0)


def test_pressure_speed_and_friction_of_sliding_and_rolling_pins():
    reducer = reducer_at(PAPER, 0.2)
    laws, n = laws_of(PAPER, reducer), len(reducer.contacts)
    force, speed = np.full(n, 50.0), np.full(n, 300.0)
    fixed = Running(np.full(n, 2.0), np.zeros(n), speed, np.full(n, 0.05))
    rolling = Running(np.full(n, 2.0), np.full(n, 3.2), speed, np.full(n, 0.05))
    np.testing.assert_allclose(fixed.pressure_speed(laws, force), 0.3 * laws.pressure * np.sqrt(50.0))
    np.testing.assert_allclose(rolling.pressure_speed(laws, force), 0.3 * 50.0 / 3.2)
    assert fixed.friction_power(force) == pytest.approx(n * 0.05 * 50.0 * 0.3)  # W


def test_life_of_a_bearing_by_hand():
    assert rating_life(np.array(1000.0), 10_000.0, 3.0, 1000.0) == pytest.approx(1e9 / 60e3)  # 1000 million turns
    assert rating_life(np.array(1000.0), 10_000.0, 10 / 3, 1000.0) == pytest.approx(10 ** (10 / 3) * 1e6 / 60e3)
    assert np.isnan(rating_life(np.array(5001.0), 10_000.0, 3.0, 1000.0))
    assert equivalent_load(np.full(7, 300.0), 10 / 3) == pytest.approx(300.0)
    assert equivalent_load(np.array([100.0, 200.0]), 3.0) == pytest.approx((0.5 * (1e6 + 8e6)) ** (1 / 3))


def readings(force, friction, **conditions):
    angles = len(force)
    unit_array = np.ones((1, 2, angles))
    even_angles = np.ones(angles, bool)
    thrust = np.stack([force, 0.5 * force])[None, :, :, None] + 0j
    by_angle = np.ones((1, angles))
    return TurnReadings(
        unit_array,
        unit_array,
        thrust,
        unit_array,
        by_angle,
        by_angle,
        by_angle,
        friction * unit_array,
        RunningConditions(**conditions),
        even_angles,
        even_angles,
    )


def test_life_and_efficiency_of_a_turn_by_hand():
    force = np.array([100.0, 200.0] * 5)
    run = {"bearing_speed_rpm": 1000.0, "load_rating_N": 2000.0, "life_exponent": 3.0, "output_power_W": 95.0}
    turn = readings(force, 2.0, bearing_friction_mm=0.01, **run)
    load = (0.5 * (1e6 + 8e6)) ** (1 / 3)
    life = turn_library()["bearing_life_h"].metric_values(turn)
    assert life == pytest.approx(1e6 / 60e3 * (2000 / load) ** 3)
    bearing = 1e-3 * 0.01 * 150.0 * 1000 * 2 * np.pi / 60  # W, at the mean force of 150 N
    efficiency = turn_library()["efficiency_percent"].metric_values(turn)
    assert efficiency == pytest.approx(100 * 95 / (95 + 2 + bearing))
    assert np.isnan(
        turn_library()["efficiency_percent"].metric_values(readings(force, 40.0, bearing_friction_mm=0.01, **run))
    )


def test_nothing_is_said_of_what_the_design_does_not_state():
    turn = readings(np.full(9, 100.0), np.nan)
    assert np.isnan(turn_library()["bearing_life_h"].metric_values(turn))
    assert np.isnan(turn_library()["efficiency_percent"].metric_values(turn))

"""Delayed rotation of a Kelvin-Voigt element against its differential equation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.elements import merged_path

COMPLIANCE, CONSTANT = 2e-9, 25.0
TURNS = np.array([0.0, 900.0, -600.0, 300.0])
SPEED = 30.0


def crept(torque, time, leg, turns, constant):
    path, points = merged_path(turns, torque, leg, time)
    return KelvinVoigt(COMPLIANCE, constant).twist(path)[points]


def passed(torque_from, torque_to):
    return abs(torque_to - torque_from) / SPEED


def course(per_leg):
    """Times, torques and legs of readings within each leg, at one speed from rest at time 0."""
    start_time, time, torque, leg = 0.0, [], [], []
    for k, (start, end) in enumerate(zip(TURNS[:-1], TURNS[1:], strict=True)):
        sample_times = (np.arange(per_leg) + 0.5) / per_leg
        time.append(start_time + sample_times * passed(start, end))
        torque.append(start + sample_times * (end - start))
        leg.append(np.full(per_leg, k))
        start_time += passed(start, end)
    return np.concatenate(time), np.concatenate(torque), np.concatenate(leg)


@pytest.mark.parametrize("per_leg", [2, 7, 40])
@pytest.mark.parametrize("constant", [0.5, CONSTANT, 1e4])
def test_readings_however_few_are_those_of_the_whole_course(per_leg, constant):
    time, torque, leg = course(per_leg)
    corners = np.cumsum([0.0, *(passed(a, b) for a, b in zip(TURNS[:-1], TURNS[1:], strict=True))])

    def rate(t, angle):
        return (COMPLIANCE * np.interp(t, corners, TURNS) - angle) / constant

    whole = solve_ivp(rate, (0, time[-1]), [0.0], t_eval=time, rtol=1e-10, atol=1e-18, max_step=0.2)
    computed_angle = crept(torque, time, leg, TURNS, constant)
    np.testing.assert_allclose(computed_angle, whole.y[0], atol=1e-7 * COMPLIANCE * 900)


def test_a_load_put_on_at_once_creeps_exponentially():
    time = np.linspace(5.0, 100.0, 20)
    computed_angle = crept(np.full(20, 800.0), time, np.zeros(20, int), np.array([0.0, 800.0]), CONSTANT)
    np.testing.assert_allclose(
        computed_angle, COMPLIANCE * 800 * -np.expm1(-(time - 5.0) / CONSTANT), rtol=1e-12, atol=1e-20
    )


def test_time_that_stands_still_moves_nothing():
    time = np.array([1.0, 1.0, 2.0, 2.0])
    computed_angle = crept(np.full(4, 800.0), time, np.zeros(4, int), np.array([0.0, 800.0]), CONSTANT)
    np.testing.assert_allclose(computed_angle[[0, 2]], computed_angle[[1, 3]], rtol=1e-12)


def test_a_path_begins_as_long_before_its_first_reading_as_it_takes_at_the_speed_of_the_first_two():
    turns, torque = np.array([100.0, 900.0]), np.array([500.0, 700.0])
    time = np.array([30.0, 40.0])
    path, points = merged_path(turns, torque, np.zeros(2, int), time)
    np.testing.assert_allclose(path.time[:3], [10.0, 30.0, 40.0])
    assert points.tolist() == [1, 2]

"""The transmission error and the forces under a torque held, against closed forms and balances."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive
from exact_play import exact_disk_play
from reducers import PAPER, SMALL, errors_of, reducer_at

from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.response import respond
from pipeline.model.metrics import Definitions
from pipeline.model.metrics.turn import RunningConditions, TurnReadings, turn_library
from pipeline.model.turn import bearing_force, crank_torque, orders

HELD = Definitions(lost_motion=0.03e-3 * RATED, rigidity_low=0.5e-3 * RATED, rigidity_high=1e-3 * RATED)
FIRST_ORDER = {"method": "first_order", "disk_reading": "normal", "roller_reading": "diameter"}
CRANKS = np.linspace(0, 2 * np.pi, 23, endpoint=False)


def ends(profile, crank, **errors):
    reducer = reducer_at(profile, crank)
    return separated_play(reducer, gaps(profile, reducer, errors_of(profile, reducer, **errors), **FIRST_ORDER)).ends[
        :, 0
    ]


def held(drive):
    """Response of a drive to a cycle with the torques of the definitions alone."""
    return respond(drive, LoadCycle.evenly(RATED, 0, 1.0, (0.03, 0.5, 1.0)))


def loaded_angle(drive, share=1.0):
    """Angle [rad] of the output at plus and minus a share of the rated torque."""
    response = respond(drive, LoadCycle.evenly(RATED, 0, share, (share,)))
    levels = [np.flatnonzero(response.torque == sense * share * RATED)[0] for sense in (1, -1)]
    return response.angle[:, levels]


def test_a_rigid_reducer_without_gaps_has_no_error():
    for crank in CRANKS:
        reducer = reducer_at(PAPER, crank)
        exact = gaps(
            PAPER, reducer, errors_of(PAPER, reducer), method="exact", disk_reading="radial", roller_reading="diameter"
        )
        assert np.abs(separated_play(reducer, exact).ends).max() < 1e-9


def test_one_displaced_pin_in_a_uniform_gap():
    """First order: the disk turns until the first of gap/arm, with the displaced pin's gap less its approach."""
    gap, outward, pin = 8e-3, -5e-3, 3  # mm; the pin stands inwards by less than the gap
    k, ratio = SMALL.shortening, SMALL.lobes
    for crank in CRANKS:
        beta = -2 * np.pi * np.arange(SMALL.pins) / SMALL.pins - crank
        s = np.sqrt(1 + k * k - 2 * k * np.cos(beta))
        arm = -SMALL.eccentricity * ratio * np.sin(beta) / s
        room = np.full(SMALL.pins, gap)
        room[pin] += outward * (1 - k * np.cos(beta[pin])) / s[pin]
        plus = np.min(room[arm < -1e-9] / -arm[arm < -1e-9])
        minus = -np.min(room[arm > 1e-9] / arm[arm > 1e-9])
        radial = np.where(np.arange(SMALL.pins) == pin, outward, 0.0)
        result = ends(SMALL, crank, lobe=gap, pin_radial=radial)
        np.testing.assert_allclose(result, [plus, minus], rtol=1e-9)


def test_the_end_of_the_play_by_exact_rotation_of_the_real_flank():
    rng = np.random.default_rng(5)
    for crank in CRANKS[::5]:
        reducer = reducer_at(SMALL, crank)
        errors = errors_of(SMALL, reducer, lobe=8e-3, pin_radial=1e-3 * rng.uniform(-2, 2, SMALL.pins))
        room = gaps(SMALL, reducer, errors, method="exact", disk_reading="normal", roller_reading="diameter")
        exact = np.array(exact_disk_play(SMALL, reducer, errors, "normal"))
        np.testing.assert_allclose(separated_play(reducer, room).ends, exact, rtol=0.01)


def test_the_error_of_a_perfect_unit_repeats_with_the_pitch_of_the_pins():
    angles = []
    for turn in range(3):
        drive = small_drive(crank=0.4 + turn * 2 * np.pi / SMALL.pins, scale=0.0, floats=True)
        angles.append(loaded_angle(replace(drive, compliance=np.zeros_like(drive.compliance))))
    np.testing.assert_allclose(angles[1:], [angles[0]] * 2, rtol=1e-9)
    assert np.ptp(loaded_angle(small_drive(crank=0.55, scale=0.0, floats=True)) - angles[0]) > 1e-9


def test_the_error_under_a_small_torque_tends_to_the_end_of_the_play():
    drive = small_drive(4, seed=3)
    end = separated_play(drive.reducer, drive.gap).ends.T
    distance = [np.abs(loaded_angle(drive, share) - end).max() for share in (1e-2, 1e-4, 1e-6)]
    assert distance[0] > 10 * distance[1] > 100 * distance[2]
    assert distance[2] < 1e-3 * np.abs(end).max()


def test_the_bearing_turns_the_crank_with_the_torque_over_the_ratio():
    """Virtual work: whatever the errors, the disk pushes the crank with the torque over the ratio at every angle."""
    for crank in CRANKS[::4]:
        drive = small_drive(3, crank=crank, floats=True, seed=2)
        thrust = bearing_force(drive, held(drive), HELD)[:, :, None]
        torque = crank_torque(SMALL.eccentricity, np.array([crank]), 1, thrust)[..., 0]
        np.testing.assert_allclose(torque, np.tile(np.array([1, -1]) * RATED / SMALL.lobes, (3, 1)), rtol=1e-8)


def test_a_plate_that_only_rotates_leaves_the_bearing_what_one_that_floats_does():
    """The crank is turned by the torque over the ratio too; the forces differ by how far the slides hold the disk."""
    for crank in CRANKS[::4]:
        forces = []
        for floats in (True, False):
            drive = small_drive(3, crank=crank, floats=floats, seed=2)
            forces.append(bearing_force(drive, held(drive), HELD))
        torque = crank_torque(SMALL.eccentricity, np.array([crank]), 1, forces[1][:, :, None])[..., 0]
        np.testing.assert_allclose(torque, np.tile(np.array([1, -1]) * RATED / SMALL.lobes, (3, 1)), rtol=1e-8)
        np.testing.assert_allclose(np.abs(forces[1]), np.abs(forces[0]), rtol=0.06)


def test_forces_of_the_disk_balance():
    drive = small_drive(3, seed=8, floats=True)
    response = held(drive)
    force = bearing_force(drive, response, HELD)
    contacts = drive.reducer.contacts
    step = [np.flatnonzero(response.torque == sense * RATED)[-1] for sense in (1, -1)]
    states = response.equilibria.force[:, response.state[step]]
    sign = (contacts.body_b == "disk").astype(float) - (contacts.body_a == "disk")
    np.testing.assert_allclose(force[..., 0], states @ (sign * contacts.normal), atol=1e-9 * np.abs(force).max())


def test_orders_of_known_waves():
    crank = 2 * np.pi * np.arange(31) / 31
    error = np.stack([3 + 2 * np.cos(4 * crank + 0.3), 0.5 * np.cos(15 * crank - 1.0)])
    result = orders(error)
    np.testing.assert_allclose(result.order, np.arange(1, 16))
    np.testing.assert_allclose([result.amplitude[0, 3], result.phase[0, 3]], [2, 0.3])
    np.testing.assert_allclose([result.amplitude[1, 14], result.phase[1, 14]], [0.5, -1.0])
    assert np.sum(result.amplitude) == pytest.approx(2.5)
    over_three_turns = orders(np.cos(2 * np.pi * np.arange(33) * 2 / 33)[None], turns=3)
    assert over_three_turns.order[np.argmax(over_three_turns.amplitude)] == pytest.approx(2 / 3)


def readings(loaded_values, free, force, share=1.0):
    even_angles = np.ones(np.shape(loaded_values)[2], bool), np.ones(np.shape(free)[2], bool)
    shares, by_angle = np.full(loaded_values.shape, share), loaded_values[:, 0]
    return TurnReadings(
        loaded_values, free, force, shares, by_angle, by_angle, by_angle, shares, RunningConditions(), *even_angles
    )


def test_metrics_of_a_turn_take_the_larger_sense_and_say_nothing_from_few_angles():
    rng = np.random.default_rng(0)
    loaded_values, free = rng.normal(size=(3, 2, 9)), rng.normal(size=(3, 2, 20))
    force = rng.normal(size=(3, 2, 9, 1)) + 1j
    values = {
        name: metric.metric_values(readings(loaded_values, free, force)) for name, metric in turn_library().items()
    }
    np.testing.assert_allclose(values["transmission_error_arcsec"], 60 * np.ptp(loaded_values, axis=2).max(axis=1))
    np.testing.assert_allclose(values["unloaded_transmission_error_arcsec"], 60 * np.ptp(free, axis=2).max(axis=1))
    np.testing.assert_allclose(values["bearing_force_peak_N"], np.abs(force).max(axis=(1, 2, 3)))
    np.testing.assert_allclose(values["bearing_force_mean_N"], np.abs(force).mean(axis=2).max(axis=(1, 2)))
    small_case = {
        name: metric.metric_values(readings(loaded_values, free, force).with_stride(2))
        for name, metric in turn_library().items()
    }
    unbalanced = readings(loaded_values, free, force, share=0.94)
    assert np.isnan(turn_library()["bearing_force_peak_N"].metric_values(unbalanced)).all()
    assert np.isnan(small_case["transmission_error_arcsec"]).all()
    np.testing.assert_allclose(
        small_case["unloaded_transmission_error_arcsec"], 60 * np.ptp(free[..., ::2], axis=2).max(axis=1)
    )

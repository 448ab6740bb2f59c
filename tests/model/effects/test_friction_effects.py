"""Effects of friction against the width and the area of their loops."""

import numpy as np
import pytest
from drives import RATED, small_drive
from drives_with_effects import LIBRARY, put
from reducers import ARCMIN

from pipeline.model.effects.effect import STILL
from pipeline.model.effects.hysteresis import Rayleigh
from pipeline.model.elements import Path
from pipeline.model.elements.sliding_friction import carried_torque
from pipeline.model.load_history.backbone import backbone, torque_levels
from pipeline.model.load_history.friction.output_path import output_path


def twist_along(torque, coefficient):
    return Rayleigh(coefficient).twist(Path(torque, None))


def turned(drive, torques, nodes):
    curve = backbone(drive, nodes)
    return output_path(torques, curve.torque, curve.angle[0], drive.sliders).at_turns[0]


def legs(*turns, steps=100):
    parts = [np.linspace(a, b, steps + 1)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True)]
    return np.concatenate([[turns[0]], *parts])


def test_coulomb_parts_the_branches_by_twice_its_torque():
    drive, torque = small_drive(), 0.7  # [N m]
    nodes = torque_levels(60, 1.2)
    rubbing, torques = put(drive, "coulomb", torque), legs(0.0, RATED, -RATED, RATED)
    angle, curve = turned(rubbing, torques, nodes), backbone(drive, nodes)
    for part, sense in ((slice(120, 201), -1), (slice(220, 301), 1)):
        net_torque = torques[part] - sense * 1e3 * torque
        expected = np.interp(net_torque, curve.torque, curve.angle[0])
        np.testing.assert_allclose(angle[part], expected, atol=1e-12)


def test_presliding_slides_in_full_beyond_its_distance():
    drive, torque, distance = small_drive(), 0.7, 0.4
    variant = put(drive, "presliding", torque, distance).sliders
    slip = np.array([0.05, 0.25, 0.4, 0.8]) * distance / ARCMIN
    resisted = np.sum(np.minimum(variant.stiffness * slip[:, None], variant.limit), axis=1)
    parts = np.array([[0.05 / 0.25, 0.05 / 0.5, 0.05 / 0.75, 0.05], [1, 0.5, 1 / 3, 0.25], [1, 0.8, 0.4 / 0.75, 0.4]])
    np.testing.assert_allclose(resisted[:3], 1e3 * torque * parts.mean(axis=1), rtol=1e-12)
    full = np.sum(np.minimum(variant.stiffness * distance / ARCMIN, variant.limit))
    np.testing.assert_allclose(full, 1e3 * torque, rtol=1e-12)


def test_load_friction_parts_the_branches_in_proportion_to_the_torque():
    drive, share = small_drive(), 0.15
    nodes = torque_levels(60, 1.2)
    rubbing, torques = put(drive, "load_friction", share), legs(0.0, RATED, -RATED, RATED)
    angle, curve = turned(rubbing, torques, nodes), backbone(drive, nodes)
    is_loaded = np.abs(torques) > 0.01 * RATED
    for leg_start, leg_end, sense in ((120, 201, -1), (220, 301, 1)):
        leg_rows = np.arange(leg_start, leg_end)
        leg_rows = leg_rows[is_loaded[leg_rows]]
        carried_torque = torques[leg_rows] / (1 + share * sense * np.sign(torques[leg_rows]))
        np.testing.assert_allclose(angle[leg_rows], np.interp(carried_torque, curve.torque, curve.angle[0]), atol=1e-12)
        assert np.sum(sense * torques[leg_rows] < 0) > 20


def test_friction_at_the_pins_alone_needs_pins_that_stand_still():
    assert [name for name in LIBRARY if STILL in LIBRARY[name].needs] == ["contact_friction"]
    assert STILL not in LIBRARY["load_friction"].needs


def test_friction_of_contacts_is_at_the_pins_alone():
    drive = small_drive()
    variant = put(drive, "contact_friction", 0.08).sliders
    np.testing.assert_array_equal(variant.contact, np.arange(drive.reducer.n_pins))
    np.testing.assert_array_equal(variant.coefficient, 0.08)
    assert not np.any(variant.limit)


def test_rayleigh_loops_have_their_closed_area_and_forget_inner_loops():
    """Area 4/3 eta T^3 (Rayleigh 1887); a minor loop closes and leaves no trace; the remanent twist is eta T^2 / 2."""
    eta, top = 3e-9, 12e3
    ramp = np.linspace(0.0, top, 4001)
    cycle = np.concatenate([ramp, ramp[-2::-1], -ramp[1:], -ramp[-2::-1], ramp[1:]])
    twist = twist_along(cycle, eta)
    loop = slice(len(ramp) - 1, None)
    area = abs(np.trapezoid(twist[loop], cycle[loop]))
    assert area == pytest.approx(4 / 3 * eta * top**3, rel=1e-6)
    assert twist[len(ramp) - 1] == twist[-1] == pytest.approx(eta * top**2)
    assert twist[2 * len(ramp) - 2] == pytest.approx(0.5 * eta * top**2)
    inner = twist_along(np.array([0.0, top, -0.5 * top, 0.3 * top, -0.2 * top, 0.3 * top, -0.5 * top, 0.8 * top]), eta)
    direct = twist_along(np.array([0.0, top, -0.5 * top, 0.8 * top]), eta)
    assert inner[-1] == pytest.approx(direct[-1], rel=1e-12)


def test_rayleigh_is_the_sum_of_plays_of_every_width():
    """Preisach's model of constant density, along random torques, by brute force."""
    eta, torque = 2e-9, np.cumsum(np.random.default_rng(3).normal(0, 4e3, 60))
    half = np.max(np.abs(torque)) * (np.arange(4000) + 0.5) / 4000
    play_positions, summed = np.zeros(4000), []
    for load in torque:
        play_positions = np.clip(play_positions, load - half, load + half)
        summed.append(2 * eta * (half[1] - half[0]) * play_positions.sum())
    np.testing.assert_allclose(twist_along(torque, eta), summed, rtol=1e-4, atol=1e-5 * np.max(np.abs(summed)))


def test_friction_resists_the_rising_load_by_one_share_and_the_falling_by_another():
    """While the load rises T = (1 + a) carried, while it falls (1 - b) carried; alike, it is load_friction."""
    drive, loading, unloading = small_drive(play=0.0), 0.3, 0.1
    variant = put(drive, "directional_load_friction", loading, unloading)
    leaning = 1 + variant.lean
    nodes, angles = np.linspace(-2, 2, 41) * RATED, np.linspace(-2, 2, 41) * 1e-3
    torque = RATED * np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0.2, 50)])
    path = output_path(torque, leaning * nodes, angles, variant.sliders.of_scaled_load(leaning))
    carried_torque = path.at_turns[1] / leaning
    assert carried_torque[49] == pytest.approx(RATED / (1 + loading), rel=1e-2)
    assert carried_torque[-1] == pytest.approx(0.2 * RATED / (1 - unloading), rel=1e-2)
    equal_directions = put(drive, "directional_load_friction", 0.2, 0.2)
    reference = put(drive, "load_friction", 0.2)
    assert equal_directions.lean == 0.0
    np.testing.assert_array_equal(equal_directions.sliders.coefficient, reference.sliders.coefficient)


def test_friction_of_a_constant_and_a_share_of_the_load_has_its_closed_loop():
    """1 N m and a quarter: (T - 1) / 1.25 while it grows, then 8 until T is 5, then (T + 1) / 0.75; each run anew."""
    rising, falling = np.arange(12.0), np.arange(11.0, -12.0, -1.0)
    torque, runs = np.concatenate([rising, falling, rising]), np.repeat([0, 0, 1], [12, 23, 12])
    carried = np.where(falling >= 5, 8.0, (falling + 1) / np.where(falling > -1, 0.75, 1.25))
    loaded = np.maximum(rising - 1, 0.0) / 1.25
    for sign in (1, -1):
        found = carried_torque.py_func(sign * torque, runs, 1.0, 0.25)
        np.testing.assert_allclose(found, sign * np.concatenate([loaded, carried, loaded]), atol=1e-12)

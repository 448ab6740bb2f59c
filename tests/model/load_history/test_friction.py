"""Friction on the output along a load history against closed forms and Masing's rule."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, area, history, small_drive

from pipeline.model.contact.friction_elements import Sliders, load_slider
from pipeline.model.load_history.friction.output_path import output_path

STIFFNESS = 5e6  # [N mm/rad] of the linear backbone
NODES = np.linspace(-2 * RATED, 2 * RATED, 40)
LINE = NODES / STIFFNESS
LIMIT, DISTANCE = 900.0, 1e-4  # [N mm], [rad]


def slider(limit, distance):
    """Sliders on a single motion, the output's."""
    limit, distance = np.atleast_1d(limit).astype(float), np.atleast_1d(distance)
    n = len(limit)
    return Sliders(np.ones((n, 1)), limit / distance, limit, np.zeros(n), np.full(n, -1))


def jenkins(torques, stiffness, limit, distance):
    """Angles of a spring beside one elastic-slip element, step by step in closed form."""
    angle, anchor, values = 0.0, 0.0, []
    own_value = limit / distance
    for torque in torques:
        stuck = (torque + own_value * anchor) / (stiffness + own_value)
        if abs(own_value * (stuck - anchor)) <= limit:
            angle = stuck
        else:
            sense = np.sign(stuck - anchor)
            angle = (torque - sense * limit) / stiffness
            anchor = angle - sense * distance
        values.append(angle)
    return np.array(values)


def on_line(torques, sliders):
    return output_path(torques, NODES, LINE, sliders).at_turns


def test_jenkins_element_follows_its_closed_form_at_every_step():
    rng = np.random.default_rng(3)
    torques = np.concatenate([history(0, RATED, -RATED, RATED), rng.uniform(-RATED, RATED, 100)])
    angle, carried_torque = on_line(torques, slider(LIMIT, DISTANCE))
    np.testing.assert_allclose(angle, jenkins(torques, STIFFNESS, LIMIT, DISTANCE), atol=1e-12)
    np.testing.assert_allclose(carried_torque, STIFFNESS * angle, atol=1e-7)


def test_loop_has_its_corners_width_and_tangents():
    top = STIFFNESS * 10 * DISTANCE + LIMIT
    turn = 2 * (STIFFNESS + LIMIT / DISTANCE) * DISTANCE  # torque by which the slider is turned round
    torques = np.array([0.0, top, top - 0.5 * turn, top - turn, 0.0, -top, -top + turn, 0.0, top])
    angle, _ = on_line(torques, slider(LIMIT, DISTANCE))
    np.testing.assert_allclose(angle[[1, 3, 5]], np.array([10, 8, -10]) * DISTANCE, rtol=1e-10)
    np.testing.assert_allclose(angle[4] - angle[7], 2 * LIMIT / STIFFNESS, rtol=1e-10)
    slopes = np.diff(torques) / np.diff(angle)
    np.testing.assert_allclose(slopes[[1, 2, 5]], STIFFNESS + LIMIT / DISTANCE, rtol=1e-9)
    np.testing.assert_allclose(slopes[[3, 4, 6, 7]], STIFFNESS, rtol=1e-9)


FOUR = slider(np.full(4, LIMIT / 4), DISTANCE * np.array([0.25, 0.5, 0.75, 1.0]))


def test_unloading_of_maxwell_slip_is_the_virgin_curve_twice_as_large():
    virgin_torque = history(0, RATED, steps=400)
    virgin, _ = on_line(virgin_torque, FOUR)
    descent = history(0, RATED, -RATED, steps=400)[400:]
    unloading, _ = on_line(np.concatenate([virgin_torque[:-1], descent]), FOUR)
    unloading = unloading[len(virgin_torque) - 1 :]
    doubled = unloading[0] - 2 * np.interp((RATED - descent) / 2, virgin_torque, virgin)
    np.testing.assert_allclose(unloading, doubled, atol=1e-9)
    assert np.ptp(np.diff(virgin)) > 0.1 * np.diff(virgin).max()  # it is curved


def test_minor_loop_closes_and_the_big_loop_returns():
    turns = (0, RATED, -RATED, RATED, -RATED, 0.3 * RATED, -0.2 * RATED, 0.3 * RATED, RATED)
    torques = history(*turns, steps=50)
    angle, _ = on_line(torques, FOUR)
    np.testing.assert_allclose(angle[50:101], angle[150:201], atol=1e-12)  # unloading again
    assert abs(angle[250] - angle[350]) < 1e-12  # the minor loop closes
    assert np.max(np.abs(angle[250:301] - angle[300:351][::-1])) > 0.01 * DISTANCE  # and is open between
    outer = np.interp(torques[350:], torques[100:151], angle[100:151])
    np.testing.assert_allclose(angle[350:], outer, atol=1e-12)  # as if it had never been


HALF_PLAY = 3e-4
WITH_PLAY_NODES = np.concatenate([-np.linspace(2, 1e-6, 20), np.linspace(1e-6, 2, 20)]) * RATED
WITH_PLAY = WITH_PLAY_NODES / STIFFNESS + HALF_PLAY * np.sign(WITH_PLAY_NODES)


def test_play_is_stuck_until_the_friction_is_exceeded():
    sliders = slider(LIMIT, 1e-7)
    torques = history(0, 0.99 * LIMIT, -0.99 * LIMIT, RATED, -0.99 * LIMIT, -RATED, 0.0, RATED)
    angle, carried_torque = output_path(torques, WITH_PLAY_NODES, WITH_PLAY, sliders).at_turns
    stuck_steps = slice(0, 121)
    assert np.max(np.abs(angle[stuck_steps])) < 1.1e-7
    at_top, resistance, return_value = 180, 240, 360
    np.testing.assert_allclose(angle[at_top], HALF_PLAY + (RATED - LIMIT) / STIFFNESS, rtol=1e-6)
    assert angle[resistance] > HALF_PLAY - 1.1e-7  # stuck to the flank that was loaded
    np.testing.assert_allclose(angle[return_value], -HALF_PLAY - LIMIT / STIFFNESS, rtol=1e-3)
    np.testing.assert_allclose(carried_torque[return_value], -LIMIT, rtol=1e-3)


def test_loop_of_play_with_friction_is_as_wide_as_both():
    torques = history(0, RATED, -RATED, RATED, steps=100)
    angle, _ = output_path(torques, WITH_PLAY_NODES, WITH_PLAY, slider(LIMIT, 1e-7)).at_turns
    np.testing.assert_allclose(angle[150] - angle[250], 2 * (HALF_PLAY + LIMIT / STIFFNESS), rtol=1e-3)


SHARE, STIFF = 0.2, 1e4 * STIFFNESS  # friction over the torque carried, [N mm/rad] of an all but rigid slider


def load_share(stiffness, share=SHARE):
    """Friction in proportion to the torque on a single motion, the output's."""
    return Sliders(np.ones((1, 1)), np.array([stiffness]), np.zeros(1), np.array([share]), np.array([-1]))


def test_load_slider_raises_the_friction_of_the_rated_torque_over_its_distance():
    reducer = small_drive().reducer
    slider_of = load_slider(reducer, SHARE, RATED, DISTANCE)
    np.testing.assert_allclose(slider_of.stiffness * DISTANCE, SHARE * RATED, rtol=1e-12)
    assert (slider_of.limit, slider_of.coefficient, slider_of.contact) == (0.0, SHARE, -1)
    np.testing.assert_array_equal(slider_of.direction, np.eye(len(reducer.motions))[[reducer.output_motion]])


@pytest.mark.parametrize("steps", [1, 7, 300])
@pytest.mark.parametrize("stiffness", [2 * STIFFNESS, STIFF], ids=["elastic", "rigid"])
def test_loop_of_friction_in_proportion_to_the_torque(stiffness, steps):
    torques = history(0, RATED, 0, -RATED, 0, RATED, steps=steps)
    angle, carried_torque = on_line(torques, load_share(stiffness))
    np.testing.assert_allclose(carried_torque, STIFFNESS * angle, atol=1e-8)
    stiffness_of_friction = SHARE * STIFFNESS
    top = RATED / (STIFFNESS + stiffness_of_friction)
    corner = (
        top * (stiffness - stiffness_of_friction) / (stiffness + stiffness_of_friction)
    )  # where the slider has been turned round
    return_value = (STIFFNESS - stiffness_of_friction) * corner  # [N mm] at the corner
    loading, size = np.abs(torques) / (STIFFNESS + stiffness_of_friction), np.abs(torques)
    unloading = np.where(
        size > return_value, top - (RATED - size) / (STIFFNESS + stiffness), size / (STIFFNESS - stiffness_of_friction)
    )
    falls = (np.arange(len(torques)) - 1) // steps % 2 == 1
    np.testing.assert_allclose(angle, np.sign(torques) * np.where(falls, unloading, loading), atol=1e-10 * top)


def test_angle_stays_after_a_reversal_until_the_friction_is_turned_round():
    held_value = RATED * (1 - SHARE) / (1 + SHARE)
    minor = 0.5 * RATED
    repeat = minor * (1 + SHARE) / (1 - SHARE)
    torques = np.array(
        [0, RATED, 0.9 * RATED, held_value, 0.9 * held_value, minor, 0.9 * repeat, repeat, 1.1 * repeat, RATED, 0.0]
    )
    angle, carried_torque = on_line(torques, load_share(STIFF))
    top = RATED / (1 + SHARE)
    at_minor = minor / (1 - SHARE)
    expected = [0, top, top, top, 0.9 * top, at_minor, at_minor, at_minor, 1.1 * at_minor, top, 0]
    np.testing.assert_allclose(carried_torque, expected, atol=1e-3 * RATED)  # the slider gives way by its stiffness
    np.testing.assert_allclose(np.abs(np.diff(angle))[[1, 2, 5, 6]], 0.0, atol=1e-3 * top / STIFFNESS)
    assert np.all(np.abs(np.diff(angle))[[0, 3, 4, 7, 8, 9]] > 0.02 * top / STIFFNESS)
    assert abs(angle[-1]) < 1e-12  # no width without torque


def test_loop_of_load_friction_dissipates_with_the_square_of_the_torque():
    for top in (RATED, 0.5 * RATED):
        torques = history(0, top, 0, steps=4000)
        angle, _ = on_line(torques, load_share(STIFF))
        turned_to = top / (1 + SHARE) / STIFFNESS
        np.testing.assert_allclose(area(torques, angle), SHARE * STIFFNESS * turned_to**2, rtol=1e-3)


def test_constant_friction_adds_to_that_of_the_load():
    pair = load_share(STIFF).with_others(slider(LIMIT, LIMIT / STIFF))
    torques = history(0, RATED, -RATED, RATED, steps=400)
    angle, carried_torque = on_line(torques, pair)
    for part, sense in ((slice(550, 801), -1), (slice(950, 1201), 1)):
        net = torques[part] - sense * LIMIT
        expected = net / np.where(net * sense > 0, 1 + SHARE, 1 - SHARE)
        np.testing.assert_allclose(carried_torque[part], expected, atol=1e-9 * RATED)
        np.testing.assert_allclose(angle[part], expected / STIFFNESS, atol=1e-12)


def test_sliders_at_contacts_are_refused_on_the_output():
    sliders = replace(slider(LIMIT, DISTANCE), contact=np.array([0]))
    with pytest.raises(ValueError, match="contact"):
        on_line(history(0, RATED), sliders)

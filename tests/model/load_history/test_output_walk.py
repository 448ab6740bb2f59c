"""The way led by the angle against the one that looks for a balance at every torque."""

import numpy as np
import pytest

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.load_history.friction.output_path import Ripple, condensed_path
from pipeline.model.load_history.friction.output_walk import WAVE, walked

HALF = np.geomspace(1e-2, 1e3, 20)
NODES = np.concatenate([-HALF[::-1], HALF])
PLAY = 3e-3
ANGLES = np.sign(NODES) * (PLAY + 1e-5 * np.abs(NODES) ** 0.9)
TURNS = np.array([900.0, -900.0, 900.0, -300.0, 500.0, -900.0, 900.0])
FINE = 2000
STEEP = 100.0
"""Torque below which the output may stand anywhere in the play."""


def sliders(stiffness, limit, coefficient):
    n = len(stiffness)
    values = (np.array(item, float) for item in (stiffness, limit, coefficient))
    return Sliders(np.ones((n, 1)), *values, np.full(n, -1))


NONE = sliders([], [], [])
SLOW, FAST, THROWING = Ripple(5.0, 3e3, 0.3), Ripple(5.0, 2e4, 0.3), Ripple(60.0, 5e3, 0.3)
WAYS = {
    "nothing": (NONE, Ripple(), 1e-12),
    "one_slider": (sliders([1e6], [50.0], [0.0]), Ripple(), 1e-12),
    "sliders": (sliders([1e5, 2e4], [50.0, 40.0], [0.0, 0.0]), Ripple(), 1e-12),
    "load_slider": (sliders([1e6], [0.0], [0.2]), Ripple(), 3e-6),
    "soft_load_slider": (sliders([2e4], [5.0], [0.3]), Ripple(), 2e-5),  # steps know its limit at their ends only
    "ripple": (NONE, SLOW, 4e-5),
    "ripple_and_sliders": (sliders([1e5, 1e6], [50.0, 0.0], [0.0, 0.1]), SLOW, 4e-5),
}


def stepped(friction, ripple):
    """Legs of the stepwise way: torque, angle, torque in the reducer."""
    parts = [np.linspace(start, end, FINE + 1)[1:] for start, end in zip(TURNS[:-1], TURNS[1:], strict=True)]
    torque = np.concatenate([np.linspace(0, TURNS[0], FINE + 1), *parts])
    angle, carried_torque = condensed_path(torque, NODES, ANGLES, friction, ripple)
    for leg in range(1, len(TURNS)):
        part = slice(leg * FINE, (leg + 1) * FINE + 1)
        yield torque[part], angle[part], carried_torque[part]


def legs(friction, ripple):
    """Legs of the walked way, their torque ascending."""
    corners, first_corners = walked(TURNS, NODES, ANGLES, friction, ripple)
    for leg in range(len(TURNS) - 1):
        part = corners[:, first_corners[leg] : first_corners[leg + 1] + 1]
        yield part if TURNS[leg + 1] > TURNS[leg] else part[:, ::-1]


@pytest.mark.parametrize("name", WAYS)
def test_both_ways_are_one(name):
    friction, ripple, tolerance_range = WAYS[name]
    for (x, rotation, friction_held), (torque, angle, carried_torque) in zip(
        legs(friction, ripple), stepped(friction, ripple), strict=True
    ):
        np.testing.assert_allclose(
            np.interp(torque, x, friction_held), carried_torque, atol=tolerance_range * np.ptp(TURNS), rtol=0
        )
        is_loaded = np.abs(torque) > STEEP
        distance = np.abs(np.interp(torque, x, rotation) - angle)[is_loaded]
        assert np.max(distance) < tolerance_range * np.ptp(ANGLES)


def test_a_ripple_that_throws_the_output_back_makes_the_angle_jump():
    distance = []
    for (x, rotation, _), (torque, angle, _) in zip(legs(NONE, THROWING), stepped(NONE, THROWING), strict=True):
        assert np.all(np.diff(x) >= 0)
        assert np.all(np.diff(rotation) >= 0)
        assert np.any((np.diff(x) == 0) & (np.diff(rotation) > 0.5 * 2 * np.pi / THROWING.waves))
        distance.append(np.abs(np.interp(torque, x, rotation) - angle) > 1e-3 * np.ptp(ANGLES))
    assert np.mean(distance) < 2e-3  # a jump comes at a torque that a chord shifts a little


def test_the_walk_at_rest_in_a_ripple_obeys_its_torque():
    corners, first_corners = walked(TURNS, NODES, ANGLES, NONE, FAST)
    torque, angle, carried_torque = corners[:, first_corners[0] : first_corners[1]]
    resisted = carried_torque + FAST.amplitude * np.sin(FAST.waves * angle + FAST.phase)
    on_the_way = torque[1:] < torque[:-1]  # not at the end of a jump, between two corners
    chord = FAST.amplitude * (1 - np.cos(np.pi / WAVE))
    assert np.max(np.abs(resisted - torque)[1:][on_the_way]) < 1.01 * chord


def test_turns_are_corners():
    corners, first_corners = walked(TURNS, NODES, ANGLES, WAYS["sliders"][0], SLOW)
    np.testing.assert_array_equal(corners[0, first_corners], TURNS)
    assert len(corners[0]) == first_corners[-1] + 1


def test_a_torque_beyond_the_backbone_is_found_on_its_continuation():
    corners, first_corners = walked(np.array([1500.0, -1500.0]), NODES, ANGLES, NONE, Ripple())
    slope = (ANGLES[-1] - ANGLES[-2]) / (NODES[-1] - NODES[-2])
    np.testing.assert_allclose(corners[1, first_corners], [ANGLES[-1] + 500 * slope, ANGLES[0] - 500 * slope])


def test_room_for_corners_grows_with_what_the_way_asks():
    gentle = Ripple(1e-3, 1e6, 0.0)
    corners, first_corners = walked(TURNS, NODES, ANGLES, NONE, gentle)
    waves = (np.ptp(corners[1]) - 2 * PLAY) * gentle.waves / (2 * np.pi)
    assert np.max(np.diff(first_corners)) > 0.9 * WAVE * waves


@pytest.mark.parametrize("backbone", [np.where(NODES > 900, np.nan, ANGLES), 1e9 * ANGLES])
def test_a_backbone_that_was_not_solved_leads_nowhere(backbone):
    corners, first_corners = walked(TURNS, NODES, backbone, NONE, FAST)
    assert np.all(np.isnan(corners))
    np.testing.assert_array_equal(first_corners, np.arange(len(TURNS)))

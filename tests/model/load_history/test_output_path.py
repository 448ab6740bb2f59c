"""Friction and ripple on the output against stop operators that are turned in small steps, and its own corners."""

import math
from bisect import bisect_left

import numpy as np
import pytest

from pipeline.identification.measurement.enough import UNLOADED_SHARE
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.load_history.friction.output_path import WAVE, Ripple, output_path

HALF = np.geomspace(1e-2, 1e3, 20)
NODES = np.concatenate([-HALF[::-1], HALF])
PLAY = 3e-3
ANGLES = np.sign(NODES) * (PLAY + 1e-5 * np.abs(NODES) ** 0.9)
TURNS = np.array([900.0, -900.0, 900.0, -300.0, 500.0, -900.0, 900.0])
COARSE = np.linspace(-1000.0, 1000.0, 8), np.linspace(-0.01, 0.01, 8)
"""A backbone with no torque in the middle of a segment."""
PRELOADED = np.array([-1500.0, -530.0, 530.0, 1500.0]), np.array([-0.05, -0.0033, 0.0033, 0.05])
"""A backbone so stiff at low torques that limits fall faster there than a soft slider is turned round."""
ANGLE_STEPS = 40_000
"""Steps of the reference over the range of the angle."""


def sliders(stiffness, limit, coefficient):
    n = len(stiffness)
    values = (np.array(item, float) for item in (stiffness, limit, coefficient))
    return Sliders(np.ones((n, 1)), *values, np.full(n, -1))


NONE = sliders([], [], [])
SLOW, FAST, THROWING = Ripple(5.0, 3e3, 0.3), Ripple(5.0, 2e4, 0.3), Ripple(60.0, 5e3, 0.3)
RESISTANCES = {  # and the share of the range that the steps of the reference leave
    "nothing": (NONE, Ripple(), 1e-12),
    "slider": (sliders([1e6], [50.0], [0.0]), Ripple(), 1e-12),
    "sliders": (sliders([1e5, 2e4], [50.0, 40.0], [0.0, 0.0]), Ripple(), 1e-12),
    "load_slider": (sliders([1e6], [0.0], [0.2]), Ripple(), 1e-12),
    "soft_load_slider": (sliders([2e4], [5.0], [0.3]), Ripple(), 1.5e-6),  # its limit grows faster than its resistance
    "ripple": (NONE, SLOW, 1e-8),
    "ripple_and_sliders": (sliders([1e5, 1e6], [50.0, 0.0], [0.0, 0.1]), SLOW, 1e-8),
    "ripple_that_throws_back": (NONE, THROWING, 3e-6),
    "all": (sliders([1e5, 2e4], [50.0, 5.0], [0.0, 0.3]), THROWING, 8e-6),
}


def rows(count):
    """Torques of so many steps to each turn."""
    starts = np.concatenate([[0.0], TURNS[:-1]])
    parts = [np.linspace(start, end, count + 1)[1:] for start, end in zip(starts, TURNS, strict=True)]
    return np.concatenate([[0.0], *parts])


def turned_in_small_steps(torques, backbone, friction, ripple):
    """Angle and torque in the reducer where a torque is first met, each slider a stop operator of the angle.

    A stop operator adds stiffness times the angle to its resistance and cuts it off at the limit of the moment.
    """
    nodes, angles = (values.tolist() for values in backbone)  # numbers of numpy take three times as long
    step = (angles[-1] - angles[0]) / ANGLE_STEPS
    columns = (friction.stiffness, friction.limit, friction.coefficient)
    elements = list(zip(*(column.tolist() for column in columns), strict=True))

    def taken(angle, resistance, rotation):
        j = min(max(bisect_left(angles, angle) - 1, 0), len(angles) - 2)
        carried = nodes[j] + (angle - angles[j]) * (nodes[j + 1] - nodes[j]) / (angles[j + 1] - angles[j])
        resistance = [
            min(max(tau + k * rotation, -limit - c * abs(carried)), limit + c * abs(carried))
            for tau, (k, limit, c) in zip(resistance, elements, strict=True)
        ]
        rippled = ripple.amplitude * math.sin(ripple.waves * angle + ripple.phase)
        return carried + sum(resistance) + rippled, carried, resistance

    angle, points = 0.0, []
    total, carried, resistance = taken(angle, [0.0] * len(elements), 0.0)
    for torque in torques.tolist():
        sense = math.copysign(1.0, torque - total)
        while sense * (torque - total) > 0:
            rotation = sense * step
            ahead = taken(angle + rotation, resistance, rotation)
            if sense * (ahead[0] - torque) >= 0:
                rotation *= (torque - total) / (ahead[0] - total)
                ahead = torque, *taken(angle + rotation, resistance, rotation)[1:]
            angle += rotation
            total, carried, resistance = ahead
        points.append((angle, carried))
    return np.array(points).T


def legs(path):
    """Corners of each leg between the turns, their torque ascending."""
    for leg in range(len(TURNS) - 1):
        part = path.corners[:, path.turns[leg] : path.turns[leg + 1] + 1]
        yield part if TURNS[leg + 1] > TURNS[leg] else part[:, ::-1]


PATHS = [*((name, (NODES, ANGLES)) for name in RESISTANCES), ("load_slider", COARSE), ("soft_load_slider", COARSE)]
CONTAINED = ("nothing", "slider", "ripple")
"""Resistances that others of them contain."""


@pytest.mark.parametrize(
    ("name", "backbone"),
    [pytest.param(*path, marks=[pytest.mark.attack] if path[0] in CONTAINED else []) for path in PATHS],
)
def test_the_path_is_that_of_stop_operators_turned_in_small_steps(name, backbone):
    friction, ripple, steps_error = RESISTANCES[name]
    path = output_path(rows(25), *backbone, friction, ripple)
    references = turned_in_small_steps(rows(25), backbone, friction, ripple)
    for values, reference in zip(path.at_turns, references, strict=True):
        np.testing.assert_allclose(values, reference, atol=steps_error * np.ptp(reference), rtol=0)


@pytest.mark.parametrize("name", RESISTANCES)
def test_turns_on_the_way_leave_the_path_as_it_is(name):
    friction, ripple, _ = RESISTANCES[name]
    path, fine = (output_path(turns, NODES, ANGLES, friction, ripple) for turns in (TURNS, rows(400)))
    for values, reference in zip(fine.at_turns[:, 400::400], path.at_turns, strict=True):
        np.testing.assert_allclose(values, reference, atol=1e-13 * np.ptp(reference), rtol=0)


def test_a_ripple_that_throws_the_output_back_makes_the_angle_jump():
    for torque, angle, _ in legs(output_path(TURNS, NODES, ANGLES, NONE, THROWING)):
        assert np.all(np.diff(torque) >= 0)
        assert np.all(np.diff(angle) >= 0)
        assert np.any((np.diff(torque) == 0) & (np.diff(angle) > 0.5 * 2 * np.pi / THROWING.waves))


def test_the_output_is_thrown_back_at_the_peaks_of_the_torque():
    """Of a linear reducer these are where its stiffness is the ripple's slope downwards."""
    nodes, angles = np.linspace(-1000.0, 1000.0, 8), np.linspace(-0.01, 0.01, 8)
    stiffness, steepest = 1e5, 1.25e5
    ripple = Ripple(steepest / 5e3, 5e3, 0.3)
    torque, angle, _ = output_path(TURNS[:1], nodes, angles, NONE, ripple).corners
    jumps = np.flatnonzero((np.diff(torque) == 0) & (np.diff(angle) > 1e-5))
    phase = np.mod(ripple.waves * angle[jumps] + ripple.phase, 2 * np.pi)
    assert len(jumps) >= 4
    np.testing.assert_allclose(phase, np.arccos(-stiffness / steepest), atol=1e-9)


def test_corners_in_a_ripple_obey_their_torque():
    path = output_path(TURNS, NODES, ANGLES, NONE, FAST)
    torque, angle, carried_torque = path.corners
    resisted = carried_torque + FAST.amplitude * np.sin(FAST.waves * angle + FAST.phase)
    np.testing.assert_allclose(resisted, torque, atol=1e-11 * np.ptp(TURNS))
    middle = 0.5 * (path.corners[:, 1:] + path.corners[:, :-1])[:, np.diff(torque) != 0]
    resisted = middle[2] + FAST.amplitude * np.sin(FAST.waves * middle[1] + FAST.phase)
    chord = FAST.amplitude * (1 - np.cos(np.pi / WAVE))
    assert 0.5 * chord < np.max(np.abs(resisted - middle[0])) < 1.01 * chord


def test_turns_are_corners():
    path = output_path(TURNS, NODES, ANGLES, RESISTANCES["sliders"][0], SLOW)
    np.testing.assert_array_equal(path.corners[0, path.turns], TURNS)
    assert len(path.corners[0]) == path.turns[-1] + 1


def test_a_torque_beyond_the_backbone_is_found_on_its_continuation():
    path = output_path(np.array([1500.0, -1500.0]), NODES, ANGLES, NONE, Ripple())
    slope = (ANGLES[-1] - ANGLES[-2]) / (NODES[-1] - NODES[-2])
    np.testing.assert_allclose(path.at_turns[0], [ANGLES[-1] + 500 * slope, ANGLES[0] - 500 * slope])


def test_room_for_corners_grows_with_what_the_path_asks():
    gentle = Ripple(1e-3, 1e6, 0.0)
    path = output_path(TURNS, NODES, ANGLES, NONE, gentle)
    waves = (np.ptp(path.corners[1]) - 2 * PLAY) * gentle.waves / (2 * np.pi)
    assert np.max(np.diff(path.turns)) > 0.9 * WAVE * waves


@pytest.mark.parametrize("backbone", [np.where(NODES > 900, np.nan, ANGLES), 1e9 * ANGLES])
def test_a_backbone_that_was_not_solved_leads_nowhere(backbone):
    path = output_path(TURNS, NODES, backbone, NONE, FAST)
    assert np.all(np.isnan(path.corners))
    np.testing.assert_array_equal(path.turns, np.arange(len(TURNS)))


@pytest.mark.parametrize("ripple", [(-1.0, 1.0), (1.0, 0.0)])
def test_a_ripple_of_negative_amplitude_or_without_waves_is_refused(ripple):
    with pytest.raises(ValueError, match="must be positive"):
        Ripple(*ripple)


@pytest.mark.parametrize("last_turn", [900.0, 300.0, 100.0])
def test_beyond_a_fifth_of_the_load_friction_has_forgotten_where_the_record_began(last_turn):
    """Friction of a tenth of the load; below, a torque that was taken off before the record matters as much as it."""
    friction, torques = sliders([1e7], [90.0], [0.0]), [0.0, 50.0, UNLOADED_SHARE * 900.0, 500.0, 900.0]
    pasts = [], [last_turn]
    paths = (output_path(np.array([*past, *torques]), NODES, ANGLES, friction, Ripple()) for past in pasts)
    first, later = (path.at_turns[0, -4:] for path in paths)
    np.testing.assert_allclose(later[-2:], first[-2:], rtol=1e-9)
    assert abs(later[1] - first[1]) < 0.01 * np.ptp(ANGLES)
    assert abs(later[0] - first[0]) > 0.01 * np.ptp(ANGLES)

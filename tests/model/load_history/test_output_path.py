"""Friction on the output against stop operators that are turned in small steps, and its own corners."""

import numpy as np
import pytest

from pipeline.identification.measurement.enough import UNLOADED_SHARE
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.load_history.friction.output_path import output_path
from tests.validation.blind.true_unit import turned_in_small_steps

HALF = np.geomspace(1e-2, 1e3, 20)
NODES = np.concatenate([-HALF[::-1], HALF])
PLAY = 3e-3
ANGLES = np.sign(NODES) * (PLAY + 1e-5 * np.abs(NODES) ** 0.9)
TURNS = np.array([900.0, -900.0, 900.0, -300.0, 500.0, -900.0, 900.0])
COARSE = np.linspace(-1000.0, 1000.0, 8), np.linspace(-0.01, 0.01, 8)
"""A backbone with no torque in the middle of a segment."""
PRELOADED = np.array([-1500.0, -530.0, 530.0, 1500.0]), np.array([-0.05, -0.0033, 0.0033, 0.05])
"""A backbone so stiff at low torques that limits fall faster there than a soft slider is turned round."""


def sliders(stiffness, limit, coefficient):
    n = len(stiffness)
    values = (np.array(item, float) for item in (stiffness, limit, coefficient))
    return Sliders(np.ones((n, 1)), *values, np.full(n, -1))


NONE = sliders([], [], [])
RESISTANCES = {  # and the share of the range that the steps of the reference leave
    "nothing": (NONE, 1e-12),
    "slider": (sliders([1e6], [50.0], [0.0]), 1e-12),
    "sliders": (sliders([1e5, 2e4], [50.0, 40.0], [0.0, 0.0]), 1e-12),
    "load_slider": (sliders([1e6], [0.0], [0.2]), 1e-12),
    "soft_load_slider": (sliders([2e4], [5.0], [0.3]), 1.5e-6),  # its limit grows faster than its resistance
}


def rows(count):
    """Torques of so many steps to each turn."""
    starts = np.concatenate([[0.0], TURNS[:-1]])
    parts = [np.linspace(start, end, count + 1)[1:] for start, end in zip(starts, TURNS, strict=True)]
    return np.concatenate([[0.0], *parts])


PATHS = [*((name, (NODES, ANGLES)) for name in RESISTANCES), ("load_slider", COARSE), ("soft_load_slider", COARSE)]
CONTAINED = ("nothing", "slider")
"""Resistances that others of them contain."""


@pytest.mark.parametrize(
    ("name", "backbone"),
    [pytest.param(*path, marks=[pytest.mark.attack] if path[0] in CONTAINED else []) for path in PATHS],
)
def test_the_path_is_that_of_stop_operators_turned_in_small_steps(name, backbone):
    friction, steps_error = RESISTANCES[name]
    path = output_path(rows(25), *backbone, friction)
    references = turned_in_small_steps(rows(25), *backbone, friction)
    for values, reference in zip(path.at_turns, references, strict=True):
        np.testing.assert_allclose(values, reference, atol=steps_error * np.ptp(reference), rtol=0)


@pytest.mark.parametrize("name", RESISTANCES)
def test_turns_on_the_way_leave_the_path_as_it_is(name):
    friction, _ = RESISTANCES[name]
    path, fine = (output_path(turns, NODES, ANGLES, friction) for turns in (TURNS, rows(400)))
    for values, reference in zip(fine.at_turns[:, 400::400], path.at_turns, strict=True):
        np.testing.assert_allclose(values, reference, atol=1e-13 * np.ptp(reference), rtol=0)


def test_turns_are_corners():
    path = output_path(TURNS, NODES, ANGLES, RESISTANCES["sliders"][0])
    np.testing.assert_array_equal(path.corners[0, path.turns], TURNS)
    assert len(path.corners[0]) == path.turns[-1] + 1


def test_a_torque_beyond_the_backbone_is_found_on_its_continuation():
    path = output_path(np.array([1500.0, -1500.0]), NODES, ANGLES, NONE)
    slope = (ANGLES[-1] - ANGLES[-2]) / (NODES[-1] - NODES[-2])
    np.testing.assert_allclose(path.at_turns[0], [ANGLES[-1] + 500 * slope, ANGLES[0] - 500 * slope])


def test_a_backbone_that_was_not_solved_leads_nowhere():
    path = output_path(TURNS, NODES, np.where(NODES > 900, np.nan, ANGLES), NONE)
    assert np.all(np.isnan(path.corners))
    np.testing.assert_array_equal(path.turns, np.arange(len(TURNS)))


@pytest.mark.parametrize("last_turn", [900.0, 300.0, 100.0])
def test_beyond_a_fifth_of_the_load_friction_has_forgotten_where_the_record_began(last_turn):
    """Friction of a tenth of the load; below, a torque that was taken off before the record matters as much as it."""
    friction, torques = sliders([1e7], [90.0], [0.0]), [0.0, 50.0, UNLOADED_SHARE * 900.0, 500.0, 900.0]
    pasts = [], [last_turn]
    paths = (output_path(np.array([*past, *torques]), NODES, ANGLES, friction) for past in pasts)
    first, later = (path.at_turns[0, -4:] for path in paths)
    np.testing.assert_allclose(later[-2:], first[-2:], rtol=1e-9)
    assert abs(later[1] - first[1]) < 0.01 * np.ptp(ANGLES)
    assert abs(later[0] - first[0]) > 0.01 * np.ptp(ANGLES)

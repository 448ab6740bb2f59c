"""What every effect of the library must do: one loop in a study and in a fit, and no energy from nowhere.

The fit solves a ladder of torques and goes along its chords, the study each of its torques: they share the equilibria
and the elements, not the way along the loop.
"""

from functools import cache

import clamped_flange
import numpy as np
import pytest
from drives import RATED, small_drive
from drives_with_effects import LIBRARY as SHIPPED
from reducers import ARCMIN

from pipeline.identification.bench import load_path, simulator
from pipeline.identification.bench.course import Course
from pipeline.model.effects import Conditions
from pipeline.model.effects.compliance import DeadZone
from pipeline.model.elements import Path, RoundedPlay, Spring, same
from pipeline.model.load_history.backbone import NO_LOAD
from pipeline.model.load_history.load_cycle import BRANCHES, LoadCycle
from pipeline.model.load_history.response import respond

LIBRARY = {**SHIPPED, clamped_flange.EFFECT.name: clamped_flange.EFFECT}
CYCLE = LoadCycle.evenly(RATED, 12, 1.0, (0.03, 0.5, 1.0))
TURNS = np.array([0.0, RATED, -RATED, RATED])
LEG = np.array([0, 1, 1, 2, 2])
"""Leg of the turns on which each branch lies."""
TIMELESS = [name for name, effect in LIBRARY.items() if "time" not in effect.needs]
BESIDE = {"alone": (), "coulomb": (("coulomb", 0.5),), "spring": (("coulomb", 0.5), ("output_torsion", 0.05))}
"""What else a drive has: friction and springs, which pass the torque on to each other."""
WARM = Conditions(np.array([3.0]), np.array([10.0]))
CLOSE = 0.03
"""Largest difference of the two loops, over what the effect changes: a chord of the ladder is off by less."""


def put(drive, name, *values, conditions=None):
    """The drive with an effect of the library, or with the one that the recipe's reader wrote."""
    return LIBRARY[name].apply(drive, values, conditions or Conditions.run_in(len(drive.gap)))


def sizes(name, share=0.3):
    """Numbers of an effect well within its bounds, but for twists, which are looked for up to the pins' tenfold."""
    pairs = LIBRARY[name].bounds(small_drive())
    share += 0.23 * (name == "crank_compliance_2")  # else the drive's crank stands in the trough of its wave
    soft = {
        "clamped_flange",
        "output_torsion",
        "creep",
        "rayleigh",
        "softening_compliance",
        "seat_compliance",
        "loose_flange",
    }
    return [low + share * (0.02 if name in soft and low == 0 else 1.0) * (high - low) for low, high in pairs]


@cache
def drive_with(name, beside):
    drive = small_drive()
    for other, *values in BESIDE[beside]:
        drive = put(drive, other, *values)
    return put(drive, name, *sizes(name), conditions=WARM) if name else drive


@cache
def loops(name, beside):
    """Angle [rad] of the loop in a study and in a fit, at the steps of the study, from the middle of its play."""
    drive = drive_with(name, beside)
    if drive.modulus is not None and len(drive.sliders.acting):
        pytest.skip("friction is not known at another modulus")
    response = respond(drive, CYCLE)
    assert response.converged.all()
    at_zero = np.array([1, 1, -1, -1, 1])[response.branch] * NO_LOAD * RATED
    torque = np.where(response.torque == 0, at_zero, response.torque)
    points = 1e-3 * np.repeat(torque[:, None], 2, axis=1)
    leg, nothing = LEG[response.branch], np.zeros(len(torque))
    course = Course(1e-3 * TURNS, leg, nothing.astype(int), points, nothing, 1.0, 0.0)
    with pytest.MonkeyPatch.context() as finer:
        finer.setattr(simulator, "LEVELS", 110)
        reading = simulator.Forward([course], RATED).read((drive,), 0, simulator.Instrument())
    assert reading.sound
    return response, reading.angle / ARCMIN


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("name", TIMELESS)
def test_a_study_and_a_fit_go_along_the_same_loop(name, beside):
    response, fitted = loops(name, beside)
    reference = respond(drive_with(None, beside), CYCLE)
    change = np.max(np.abs(response.angle[0] - reference.angle[0]))
    assert change > 0
    sliders = drive_with(name, beside).sliders
    compared = (response.torque != 0) | (not np.any(sliders.coefficient))  # friction by load is none there
    scale = np.ptp(response.angle) if sliders.at_contacts else change  # its path depends on its steps
    np.testing.assert_allclose(fitted[compared], response.angle[0, compared], atol=CLOSE * scale)


@pytest.mark.parametrize("coefficient", [0.005, 0.02])
def test_friction_at_contacts_is_followed_closely_after_a_turn(coefficient, monkeypatch):
    """Pins let go one by one within a few hundredths of the torque, and two nodes of the ladder are a seventh apart.

    A chord from the turn to the next node misses by half of what friction changes, and more.
    """
    drive = put(small_drive(), "contact_friction", coefficient)
    torque = np.concatenate([side * np.linspace(1.0, 0.6, 81)[1:] for side in (1.0, -1.0)])
    points = 1e-3 * RATED * np.repeat(torque[:, None], 2, axis=1)
    course = Course(1e-3 * TURNS, np.repeat([1, 2], 80), np.zeros(160, int), points, np.zeros(160), 1.0, 0.0)

    def change():
        """Of the angle by friction; the chords of the ladder miss both loops alike."""
        loops = (
            simulator.Forward([course], RATED).read((d,), 0, simulator.Instrument()) for d in (drive, small_drive())
        )
        with_friction, without = (reading.angle for reading in loops)
        return with_friction - without

    followed = change()
    monkeypatch.setattr(load_path, "AFTER_TURNS", (1e9,))
    by_nodes = change()
    monkeypatch.setattr(simulator, "LEVELS", 880)
    finely = change()
    missed = [np.max(np.abs(one - finely)) / np.max(np.abs(finely)) for one in (followed, by_nodes)]
    assert missed[0] < 0.1
    assert missed[1] > 0.15


def test_friction_resists_constant_torques_and_shares_of_the_load():
    drive = put(put(put(small_drive(), "contact_friction", 0.02), "load_friction", 0.1), "coulomb", 0.5)
    np.testing.assert_allclose(drive.sliders.resisted(np.array([0.0, -RATED])), [500.0, 500.0 + 0.12 * RATED])


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("name", TIMELESS)
def test_a_closed_loop_takes_energy_or_none(name, beside):
    response, fitted = loops(name, beside)
    top = np.flatnonzero(response.branch == BRANCHES.index("loading+"))[-1]
    closed = slice(top, None)
    for angle in (response.angle[0], fitted):
        taken = -np.trapezoid(angle[closed], response.torque[closed])
        assert taken >= -1e-6 * RATED * np.ptp(angle)


@pytest.mark.parametrize("name", LIBRARY)
def test_an_effect_without_memory_has_none_after_a_cycle(name):
    drive = drive_with(name, "alone")
    if drive.hystereses or len(drive.sliders.acting):
        pytest.skip("claims a memory")
    response, fitted = loops(name, "alone")
    for angle in (response.angle[0], fitted):
        first, last = (angle[response.branch == BRANCHES.index(branch)] for branch in ("loading+", "reloading+"))
        np.testing.assert_allclose(last, first, rtol=1e-12)


@pytest.mark.parametrize("name", [name for name in LIBRARY if drive_with(name, "alone").hystereses])
def test_memory_is_the_state_alone(name):
    """A path in two parts is the whole one, and a state that was used may be used again."""
    (element,) = drive_with(name, "alone").hystereses
    torque = RATED * np.cumsum(np.random.default_rng(1).normal(0, 0.3, 40))
    time = np.cumsum(np.random.default_rng(2).uniform(0, 30, 40))
    parts = [slice(None), slice(0, 17), slice(17, None)]
    whole, first, second = (Path(torque[part], time[part]) for part in parts)
    begun, state = element.advance(element.start(), first)
    for _ in range(2):
        np.testing.assert_allclose(
            np.concatenate([begun, element.advance(state, second)[0]]), element.twist(whole), rtol=1e-12
        )


@pytest.mark.parametrize("name", [name for name in LIBRARY if drive_with(name, "alone").springs])
def test_a_spring_follows_the_torque_from_either_limit(name):
    (spring,) = drive_with(name, "alone").springs
    torque = RATED * np.array([-1.0, -0.3, -1e-8, -0.0, 0.0, 1e-8, 0.3, 1.0])
    twist = spring.twist(torque)
    assert np.all(np.diff(twist) >= 0)
    np.testing.assert_allclose(twist, -twist[::-1])
    np.testing.assert_allclose(spring.twist(torque[3:5]), twist[[2, 5]], atol=1e-6 * np.ptp(twist))
    _check_energy(spring, RATED * np.array([-1.0, -0.3, 0.3, 1.0]))


def test_a_rounded_play_becomes_a_dead_zone_and_its_twist_is_the_derivative_of_its_energy():
    torque = np.array([-12.0, -0.5, 0.5, 12.0])
    _check_energy(RoundedPlay(3.0, 0.7), torque)
    np.testing.assert_allclose(RoundedPlay(3.0, 1e-9).twist(torque), DeadZone(3.0).twist(torque))


def _check_energy(spring, torque):
    step = 1e-5 * np.abs(torque)
    slope = (spring.energy(torque + step) - spring.energy(torque - step)) / (2 * step)
    np.testing.assert_allclose(slope, spring.twist(torque), rtol=1e-4)


def test_an_effect_that_needs_time_has_no_load_cycle():
    names = [name for name in LIBRARY if name not in TIMELESS and drive_with(name, "alone").hystereses]
    assert names
    for name in names:
        with pytest.raises(ValueError, match="no time"):
            respond(drive_with(name, "alone"), CYCLE)


@pytest.mark.parametrize("name", LIBRARY)
def test_the_same_effect_is_the_same_element(name):
    drive = small_drive()
    once, again, larger = (put(drive, name, *sizes(name, share), conditions=WARM).elements for share in (0.3, 0.3, 0.4))
    assert same(once, again)
    assert not once or not same(once, larger)
    assert all(isinstance(element, Spring) or element.some(slice(1)) is not None for element in once)


def angles_of(response, branch):
    return response.angle[0, response.branch == BRANCHES.index(branch)]


CLOSED_FORMS = {
    "output_torsion": lambda response, reference, size: (
        angles_of(response, "loading+")[-1] - angles_of(reference, "loading+")[-1],
        1e-3 * RATED * size[0] / ARCMIN,
    ),
    "loose_flange": lambda response, reference, size: (
        response.clearance_backlash[0] - reference.clearance_backlash[0],
        size[0] / ARCMIN,
    ),
    "clamped_flange": lambda response, reference, size: (
        response.zero_torque_width[0] - reference.zero_torque_width[0],
        size[0] / ARCMIN,
    ),
    "rayleigh": lambda response, reference, size: (
        response.zero_torque_width[0] - reference.zero_torque_width[0],
        (1e-3 * RATED) ** 2 * size[0] / ARCMIN,
    ),
    "softening_compliance": lambda response, reference, size: (
        (angles_of(response, "loading+")[-1] - angles_of(reference, "loading+")[-1]) * ARCMIN / size[0] / size[1],
        np.roots([1.0, 0.0, 1.0, -1e-3 * RATED / size[1]])[-1].real,
    ),
}
"""What a loop of the study must show of a size, by the effect: found, expected."""


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_a_loop_shows_the_size_that_was_asked_for(name):
    response, reference = (respond(drive_with(given, "alone"), CYCLE) for given in (name, None))
    found, expected = CLOSED_FORMS[name](response, reference, sizes(name))
    assert found == pytest.approx(expected, rel=1e-6)

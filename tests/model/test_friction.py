"""Friction along a load history against closed forms, Masing's rule, energy, balance and reciprocity."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import MICROMETRE, SMALL

from pipeline.model.drive import backbone, ladder
from pipeline.model.equilibrium import solve
from pipeline.model.friction import Sliders, load_slider, output_sliders, pin_sliders
from pipeline.model.output_path import Ripple, condensed_path
from pipeline.model.path import solve_path

STIFFNESS = 5e6  # [N mm/rad] of the linear backbone
NODES = np.linspace(-2 * RATED, 2 * RATED, 40)
LINE = NODES / STIFFNESS
NO_RIPPLE = Ripple()
LIMIT, DISTANCE = 900.0, 1e-4  # [N mm], [rad]


def slider(limit, distance):
    """Sliders on a single motion, the output's."""
    limit, distance = np.atleast_1d(limit).astype(float), np.atleast_1d(distance)
    n = len(limit)
    return Sliders(np.ones((n, 1)), limit / distance, limit, np.zeros(n), np.full(n, -1))


def history(*turns, steps=60):
    """Torques from turn to turn, every turn once."""
    legs = [np.linspace(a, b, steps + 1)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True)]
    return np.concatenate([[turns[0]], *legs])


def jenkins(torques, stiffness, limit, distance):
    """Angles of a spring beside one elastic-slip element, step by step in closed form."""
    angle, anchor, found = 0.0, 0.0, []
    own = limit / distance
    for torque in torques:
        stuck = (torque + own * anchor) / (stiffness + own)
        if abs(own * (stuck - anchor)) <= limit:
            angle = stuck
        else:
            sense = np.sign(stuck - anchor)
            angle = (torque - sense * limit) / stiffness
            anchor = angle - sense * distance
        found.append(angle)
    return np.array(found)


def on_line(torques, sliders, ripple=NO_RIPPLE):
    return condensed_path(torques, NODES, LINE, sliders, ripple)


def test_jenkins_element_follows_its_closed_form_at_every_step():
    rng = np.random.default_rng(3)
    torques = np.concatenate([history(0, RATED, -RATED, RATED), rng.uniform(-RATED, RATED, 100)])
    angle, carried = on_line(torques, slider(LIMIT, DISTANCE))
    np.testing.assert_allclose(angle, jenkins(torques, STIFFNESS, LIMIT, DISTANCE), atol=1e-12)
    np.testing.assert_allclose(carried, STIFFNESS * angle, atol=1e-7)


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
    down = history(0, RATED, -RATED, steps=400)[400:]
    unloading, _ = on_line(np.concatenate([virgin_torque[:-1], down]), FOUR)
    unloading = unloading[len(virgin_torque) - 1 :]
    doubled = unloading[0] - 2 * np.interp((RATED - down) / 2, virgin_torque, virgin)
    np.testing.assert_allclose(unloading, doubled, atol=1e-9)
    assert np.ptp(np.diff(virgin)) > 0.1 * np.diff(virgin).max()  # it is curved


def test_minor_loop_closes_and_the_big_loop_returns():
    turns = (0, RATED, -RATED, RATED, -RATED, 0.3 * RATED, -0.2 * RATED, 0.3 * RATED, RATED)
    torques = history(*turns, steps=50)
    angle, _ = on_line(torques, FOUR)
    np.testing.assert_allclose(angle[50:101], angle[150:201], atol=1e-13)  # unloading again
    assert abs(angle[250] - angle[350]) < 1e-13  # the minor loop closes
    assert np.max(np.abs(angle[250:301] - angle[300:351][::-1])) > 0.01 * DISTANCE  # and is open between
    outer = np.interp(torques[350:], torques[100:151], angle[100:151])
    np.testing.assert_allclose(angle[350:], outer, atol=1e-12)  # as if it had never been


HALF_PLAY = 3e-4
WITH_PLAY_NODES = np.concatenate([-np.linspace(2, 1e-6, 20), np.linspace(1e-6, 2, 20)]) * RATED
WITH_PLAY = WITH_PLAY_NODES / STIFFNESS + HALF_PLAY * np.sign(WITH_PLAY_NODES)


def test_play_is_stuck_until_the_friction_is_exceeded():
    sliders = slider(LIMIT, 1e-7)
    torques = history(0, 0.99 * LIMIT, -0.99 * LIMIT, RATED, -0.99 * LIMIT, -RATED, 0.0, RATED)
    angle, carried = condensed_path(torques, WITH_PLAY_NODES, WITH_PLAY, sliders, NO_RIPPLE)
    before = slice(0, 121)
    assert np.max(np.abs(angle[before])) < 1.1e-7
    at_top, held, back = 180, 240, 360
    np.testing.assert_allclose(angle[at_top], HALF_PLAY + (RATED - LIMIT) / STIFFNESS, rtol=1e-6)
    assert angle[held] > HALF_PLAY - 1.1e-7  # stuck to the flank that was loaded
    np.testing.assert_allclose(angle[back], -HALF_PLAY - LIMIT / STIFFNESS, rtol=1e-3)
    np.testing.assert_allclose(carried[back], -LIMIT, rtol=1e-3)


def test_loop_of_play_with_friction_is_as_wide_as_both():
    torques = history(0, RATED, -RATED, RATED, steps=100)
    angle, _ = condensed_path(torques, WITH_PLAY_NODES, WITH_PLAY, slider(LIMIT, 1e-7), NO_RIPPLE)
    np.testing.assert_allclose(angle[150] - angle[250], 2 * (HALF_PLAY + LIMIT / STIFFNESS), rtol=1e-3)


@given(st.floats(0.5, 50), st.floats(0, 6))
@settings(max_examples=20, deadline=None)
def test_small_ripple_shifts_the_angle_by_its_torque(cycles, phase):
    waves = 2 * np.pi * cycles * STIFFNESS / RATED
    torques = history(0, RATED, -RATED)
    shifts = []
    for amplitude in (1e-3 * STIFFNESS / waves, 1e-4 * STIFFNESS / waves):
        angle, carried = on_line(torques, Sliders.none(1), Ripple(amplitude, waves, phase))
        np.testing.assert_allclose(carried + amplitude * np.sin(waves * angle + phase), torques, atol=1e-8)
        expected = -amplitude / STIFFNESS * np.sin(waves * torques / STIFFNESS + phase)
        shifts.append(np.max(np.abs(angle - torques / STIFFNESS - expected)))
    assert shifts[0] < 2e-6 / waves  # second order in the amplitude
    assert shifts[1] < 0.011 * shifts[0] + 1e-14


def test_steep_ripple_jumps_to_the_first_balance_on_the_way():
    waves = 2 * np.pi * 10 * STIFFNESS / RATED
    amplitude = 4 * STIFFNESS / waves
    ripple = Ripple(amplitude, waves, 0.7)
    torques = history(0, RATED, -RATED, steps=400)
    angle, _ = on_line(torques, Sliders.none(1), ripple)
    fine = np.linspace(-2, 2, 400001) * RATED / STIFFNESS
    balance = STIFFNESS * fine + amplitude * np.sin(waves * fine + ripple.phase)
    up = fine[np.searchsorted(np.maximum.accumulate(balance), torques[60:401])]
    down = fine[::-1][np.searchsorted(-np.minimum.accumulate(balance[::-1]), -torques[460:801])]
    # from the first jump on no memory of the start is left
    np.testing.assert_allclose(angle[60:401], up, atol=2 * (fine[1] - fine[0]))
    np.testing.assert_allclose(angle[460:801], down, atol=2 * (fine[1] - fine[0]))
    assert np.max(np.diff(angle[60:401])) > 0.3 * 2 * np.pi / waves  # a jump
    assert np.all(np.diff(angle[60:401]) > 0)


SHARE, STIFF = 0.2, 1e4 * STIFFNESS  # friction over the torque carried, [N mm/rad] of an all but rigid slider


def load_share(stiffness, share=SHARE):
    """Friction in proportion to the torque on a single motion, the output's."""
    return Sliders(np.ones((1, 1)), np.array([stiffness]), np.zeros(1), np.array([share]), np.array([-1]))


def test_load_slider_raises_the_friction_of_the_rated_torque_over_its_distance():
    at = small_drive().reducer
    slider_of = load_slider(at, SHARE, RATED, DISTANCE)
    np.testing.assert_allclose(slider_of.stiffness * DISTANCE, SHARE * RATED, rtol=1e-15)
    assert (slider_of.limit, slider_of.coefficient, slider_of.contact) == (0.0, SHARE, -1)
    np.testing.assert_array_equal(slider_of.direction, np.eye(len(at.motions))[[at.output_motion]])


@pytest.mark.parametrize("steps", [1, 7, 300])
@pytest.mark.parametrize("stiffness", [2 * STIFFNESS, STIFF], ids=["elastic", "rigid"])
def test_loop_of_friction_in_proportion_to_the_torque(stiffness, steps):
    torques = history(0, RATED, 0, -RATED, 0, RATED, steps=steps)
    angle, carried = on_line(torques, load_share(stiffness))
    np.testing.assert_allclose(carried, STIFFNESS * angle, atol=1e-8)
    own = SHARE * STIFFNESS
    top = RATED / (STIFFNESS + own)
    corner = top * (stiffness - own) / (stiffness + own)  # where the slider has been turned round
    back = (STIFFNESS - own) * corner  # [N mm] at the corner
    loading, size = np.abs(torques) / (STIFFNESS + own), np.abs(torques)
    unloading = np.where(size > back, top - (RATED - size) / (STIFFNESS + stiffness), size / (STIFFNESS - own))
    falls = (np.arange(len(torques)) - 1) // steps % 2 == 1
    np.testing.assert_allclose(angle, np.sign(torques) * np.where(falls, unloading, loading), atol=1e-10 * top)


def test_angle_stays_after_a_reversal_until_the_friction_is_turned_round():
    held = RATED * (1 - SHARE) / (1 + SHARE)
    minor = 0.5 * RATED
    again = minor * (1 + SHARE) / (1 - SHARE)
    torques = np.array([0, RATED, 0.9 * RATED, held, 0.9 * held, minor, 0.9 * again, again, 1.1 * again, RATED, 0.0])
    angle, carried = on_line(torques, load_share(STIFF))
    top = RATED / (1 + SHARE)
    at_minor = minor / (1 - SHARE)
    expected = [0, top, top, top, 0.9 * top, at_minor, at_minor, at_minor, 1.1 * at_minor, top, 0]
    np.testing.assert_allclose(carried, expected, atol=1e-3 * RATED)  # the slider gives way by its stiffness
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
    both = load_share(STIFF).joined(slider(LIMIT, LIMIT / STIFF))
    torques = history(0, RATED, -RATED, RATED, steps=400)
    angle, carried = on_line(torques, both)
    for part, sense in ((slice(550, 801), -1), (slice(950, 1201), 1)):
        net = torques[part] - sense * LIMIT
        expected = net / np.where(net * sense > 0, 1 + SHARE, 1 - SHARE)
        np.testing.assert_allclose(carried[part], expected, atol=1e-9 * RATED)
        np.testing.assert_allclose(angle[part], expected / STIFFNESS, atol=1e-12)


def test_sliders_at_contacts_are_refused_on_the_output():
    sliders = replace(slider(LIMIT, DISTANCE), contact=np.array([0]))
    with pytest.raises(ValueError, match="contact"):
        on_line(history(0, RATED), sliders)


# --- contacts, motions and sliders at once --------------------------------------------------------------------------


def followed(drive, torques, sliders):
    """Motions, forces of the only state of a drive along a history."""
    curve = backbone(drive, ladder(14, 1.1))
    motion, force, worst = solve_path(
        drive.reducer,
        drive.bearing,
        drive.laws,
        drive.compliance,
        drive.gap[0],
        float(drive.bearing_clearance[0]),
        sliders,
        torques,
        (curve.torque, curve.states.motion[0], curve.states.force[0]),
    )
    assert worst <= 1e-9
    return motion, force


def of_output(drive, motion):
    return motion[:, drive.reducer.output_motion]


@pytest.mark.parametrize("given", [{}, {"floats": True}, {"clearance": 3 * MICROMETRE}, {"scale": 0.0, "play": 0.0}])
def test_path_without_friction_is_the_equilibrium(given):
    drive = small_drive(seed=4, **given)
    torques = history(0.01 * RATED, RATED, -RATED, 0.3 * RATED, steps=15)
    motion, force = followed(drive, torques, Sliders.none(len(drive.reducer.motions)))
    for sense in (1, -1):
        mine = np.flatnonzero(sense * torques > 0)
        mine = mine[np.argsort(np.abs(torques[mine]), kind="stable")]
        states = solve(
            drive.reducer,
            drive.bearing,
            drive.laws,
            drive.compliance,
            drive.gap,
            drive.bearing_clearance,
            np.zeros((1, len(drive.reducer.motions))),
            torques[mine],
        )
        assert np.all(states.converged)
        range_of = np.ptp(of_output(drive, motion))
        there = states.motion[0, :, drive.reducer.output_motion]
        np.testing.assert_allclose(of_output(drive, motion)[mine], there, atol=1e-8 * range_of)
        np.testing.assert_allclose(force[mine], states.force[0], atol=1e-7 * force.max())


def constant(reducer):
    return output_sliders(reducer, np.array([300.0, 500.0]), np.array([2e-5, 3e-4]))


ON_THE_OUTPUT = {
    "constant": constant,
    "load": lambda reducer: load_slider(reducer, 0.2, RATED, 1e-5),
    "large_load": lambda reducer: load_slider(reducer, 0.5, RATED, 1e-4),
    "both": lambda reducer: load_slider(reducer, 0.2, RATED, 1e-5).joined(constant(reducer)),
}


@pytest.mark.parametrize("floats", [False, True], ids=["fixed", "floats"])
@pytest.mark.parametrize("kind", ON_THE_OUTPUT)
def test_path_with_friction_on_the_output_is_the_condensed_one(kind, floats):
    drive = small_drive(seed=2, floats=floats)
    sliders = ON_THE_OUTPUT[kind](drive.reducer)
    torques = history(0, RATED, -RATED, RATED, 0.2 * RATED, 0.5 * RATED, steps=20)
    motion, force = followed(drive, torques, sliders)
    curve = backbone(drive, ladder(800, 1.2))
    angle, carried = condensed_path(torques, curve.torque, curve.angle[0], sliders, NO_RIPPLE)
    start = curve.angle[0, 799:801].mean()  # the middle of the play, where the condensed path rests at first
    away = np.abs(torques) > 0
    assert abs(start) < np.ptp(angle)
    loop = np.arange(len(torques)) >= 20  # the anchors have been dragged from wherever they rested
    np.testing.assert_allclose(of_output(drive, motion)[loop & away], angle[loop & away], atol=2e-5 * np.ptp(angle))
    to_output = force @ drive.reducer.closing[:, drive.reducer.output_motion]
    np.testing.assert_allclose(to_output[loop & away], carried[loop & away], atol=1e-4 * RATED)


def rubbing(drive, coefficient):
    return pin_sliders(drive.reducer, drive.laws, coefficient, drive.rated_torque)


@pytest.mark.parametrize("crank", [0.0, 0.4, 2.0])
def test_slip_of_a_pin_is_the_tangential_motion_of_the_disk_at_it(crank):
    drive = small_drive(crank=crank)
    at, step = drive.reducer, 1e-6
    sliders = rubbing(drive, 0.1)
    centre = SMALL.eccentricity * np.exp(1j * crank)
    for motion, moved in {
        "disk_x": lambda p: p + step,
        "disk_y": lambda p: p + 1j * step,
        "disk_phi": lambda p: centre + (p - centre) * np.exp(1j * step),
    }.items():
        travel = (moved(at.pins.point) - at.pins.point) / step
        slip = np.real(travel * np.conj(1j * at.pins.normal))
        np.testing.assert_allclose(sliders.direction[:, at.motions.index(motion)], slip, atol=1e-5)
    others = [i for i, motion in enumerate(at.motions) if not motion.startswith("disk")]
    assert not np.any(sliders.direction[:, others])


def resistances(drive, sliders, motion, force):
    """Resistance and anchor of every slider (n_steps, n_sliders), from motions and forces by the rule of each."""
    slip, anchor = motion @ sliders.direction.T, np.zeros(len(sliders))
    pressed = np.where(sliders.contact >= 0, force[:, sliders.contact], 0.0)
    largest = sliders.limit + sliders.coefficient * pressed
    held, anchors = [], []
    for u, most in zip(slip, largest, strict=True):
        held.append(np.clip(sliders.stiffness * (u - anchor), -most, most))
        anchor = u - held[-1] / sliders.stiffness
        anchors.append(anchor)
    return np.array(held), np.array(anchors)


def loops(count, steps=60):
    """Cycles 0, +T, -T, 0, zero reached and left within a millionth: the play is crossed at no torque."""
    parts = []
    for sense in [1, -1] * count:
        parts.append(sense * np.concatenate([[1e-6 * RATED], history(0, RATED, 0, steps=steps)[1:-1], [1e-6 * RATED]]))
    return np.concatenate(parts)


PATH = loops(2)
SECOND = slice(len(PATH) // 4 - 60, len(PATH) * 3 // 4 - 59)  # from top to top


def area(torques, angle):
    return float(np.sum(0.5 * (torques[1:] + torques[:-1]) * np.diff(angle)))


@pytest.mark.parametrize("play", [0.0, 6 * MICROMETRE])
def test_loop_of_rubbing_pins_dissipates_what_the_sliders_do(play):
    drive = small_drive(seed=1, play=play)
    areas = []
    for coefficient in (0.2, 0.02, 1e-9):
        sliders = rubbing(drive, coefficient)
        motion, force = followed(drive, PATH, sliders)
        held, anchor = resistances(drive, sliders, motion, force)
        own = area(PATH[SECOND], of_output(drive, motion)[SECOND])
        middle = 0.5 * (held[SECOND][1:] + held[SECOND][:-1])
        lost = np.sum(middle * np.diff(anchor[SECOND], axis=0))
        if coefficient > 1e-3:
            assert own > 0
            np.testing.assert_allclose(own, lost, rtol=0.05)
        areas.append(own)
    assert areas[0] > areas[1] > abs(areas[2])
    assert abs(areas[2]) < 1e-4 * areas[0]


def test_forces_and_friction_balance_at_every_step():
    drive = small_drive(seed=1, floats=True)
    sliders = rubbing(drive, 0.15).joined(output_sliders(drive.reducer, np.array([190.0]), np.array([1e-5])))
    motion, force = followed(drive, PATH, sliders)
    held, _ = resistances(drive, sliders, motion, force)
    total = force @ drive.reducer.closing + held @ sliders.direction
    total[:, :2] += drive.bearing.stiffness * motion[:, :2]
    total[:, drive.reducer.output_motion] -= PATH
    arms = np.maximum(np.abs(drive.reducer.closing).max(axis=0), 1.0)
    assert np.max(np.abs(total) / arms) < 1e-6 * force.max()
    room = drive.gap + force @ drive.compliance - motion @ drive.reducer.closing.T
    closed = force > 0
    assert np.max(np.abs(room + drive.laws.deflection(force))[closed]) < 1e-9
    assert np.min(room[~closed]) > -1e-9


def test_no_torque_is_the_limit_from_the_side_it_is_reached_from():
    drive = small_drive(seed=1, play=6 * MICROMETRE)
    through, before = history(0, RATED, 0, -RATED, steps=10), history(0, RATED, 1e-6 * RATED, -RATED, steps=10)
    (zero, _), (near, _) = (followed(drive, torques, rubbing(drive, 0.2)) for torques in (through, before))
    width = np.ptp(of_output(drive, zero)[[20, 21]])
    np.testing.assert_allclose(of_output(drive, zero)[20:], of_output(drive, near)[20:], atol=1e-4 * width)


def test_friction_shifts_loading_by_its_virtual_work_to_first_order():
    drive = small_drive(scale=0.0, play=0.0, seed=5)
    at = drive.reducer
    torques = history(0, RATED, steps=120)
    free, pressed = followed(drive, torques, Sliders.none(len(at.motions)))
    rate = np.gradient(free, torques, axis=0)  # = d angle / d load of every motion, by reciprocity
    direction = rubbing(drive, 1.0).direction
    slip = free @ direction.T
    there = torques > 0.3 * RATED
    onward = np.sign(np.diff(slip, axis=0))
    carrying = pressed[1:, : at.n_pins] > 0
    assert np.all(np.where(carrying, onward == np.sign(slip[1:]), True))  # every pin that carries slides on
    friction = (np.sign(slip) * pressed[:, : at.n_pins]) @ direction  # per unit of the coefficient
    expected = -np.sum(rate * friction, axis=1)
    found = []
    for coefficient in (1e-3, 1e-4):
        rubbed, _ = followed(drive, torques, rubbing(drive, coefficient))
        found.append((of_output(drive, rubbed) - of_output(drive, free)) / coefficient)
    assert np.all(expected[there] < 0)
    np.testing.assert_allclose(found[1][there], expected[there], rtol=5e-3)
    errors = [np.max(np.abs(one - expected)[there]) for one in found]
    assert errors[1] < 0.5 * errors[0]

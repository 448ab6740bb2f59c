"""The drive whose crank turns within a loop, against closed forms, an energy, and the drive whose crank is fixed."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from pipeline.identification.change.kinds import KINDS
from pipeline.identification.change.loops import POINTS, Loop
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS
from pipeline.identification.generic.generic_drive import LoopModel
from pipeline.identification.generic.shared_fit import fitted_together

TURNED = 2 * np.pi * 13 / 21600
"""Of a drive of 13 lobes whose housing is held [rad/arcmin]."""
SPRING = {
    "play_arcmin": 60.0,
    "knee_Nm": 1.5,
    "compliance_arcmin_per_Nm": 5.0,
    "friction_Nm": 0.0,
    "load_friction": 0.0,
}
LINEAR = SPRING | {"play_arcmin": 0.0}
LOOP = np.concatenate([np.linspace(0, 30, 40), np.linspace(30, -30, 80), np.linspace(-30, 30, 80)])


def loops(torque, crank=0.4, start=0.0, **changes) -> CrankLoops:
    n, settings = len(torque), {"crank_per_output": TURNED, "ratio": -13.0} | changes
    alike = np.zeros(n), np.ones(n), np.full(n, crank), np.full(n, start)
    return CrankLoops(np.zeros(n, int), np.asarray(torque, float)[:, None], *alike, **settings)


def curve(torque, values, crank=0.4, angle=None, **changes):
    """Predicted angle; the measured one, which fixes its zero, is found with it by default."""
    case = loops(torque, crank, **changes)
    if angle is None:
        angle = np.zeros(len(case.angle))
        for _ in range(30):
            twist = LoopModel(CrankLoops(**vars_of(case) | {"angle": angle})).predict_angle(values)
            angle = twist - twist[0]
    return LoopModel(CrankLoops(**vars_of(case) | {"angle": np.asarray(angle, float)})).predict_angle(values)


def vars_of(case: CrankLoops) -> dict:
    return {name: getattr(case, name) for name in CrankLoops.__dataclass_fields__}


def test_a_sinusoidal_angle_error_alone_in_closed_form_with_its_factor_of_the_torque():
    """i tau = T (1 + i dte/dphi): read backwards, each angle has one torque."""
    cosine, sine, crank = 14.0, 21.0, 0.7
    angle = np.linspace(-160, 160, 101)
    phi = crank + TURNED * angle
    strain = angle - cosine * np.cos(phi) - sine * np.sin(phi)
    slope = TURNED * (sine * np.cos(phi) - cosine * np.sin(phi))
    assert np.ptp(slope) > 0.1
    torque = strain / 5.0 * (1 - slope)
    order = np.argsort(torque)
    values = LINEAR | {"pin_circle_runout_cos_arcmin": cosine, "pin_circle_runout_sin_arcmin": sine}
    predicted = curve(torque[order], values, crank, angle[order])
    np.testing.assert_allclose(predicted, angle[order], atol=0.02)
    at_output = curve(strain[order] / 5.0, values, crank, angle[order], at_input=False)
    np.testing.assert_allclose(at_output, angle[order], atol=0.02)
    without = curve(torque[order], values, crank, angle[order], at_input=False)
    assert np.sqrt(np.mean((without - angle[order]) ** 2)) > 3.0


@pytest.mark.parametrize("effect", ["pin_circle_runout", "flank_runout", "play_once", "compliance_once"])
def test_the_torque_at_the_motor_is_the_derivative_of_the_energy(effect):
    """V(a) = max over T of T a - W(T, phi(a)), with W by quadrature."""
    cosine, sine = (12.0, -8.0) if effect.endswith("runout") else (0.25, -0.15)
    amplitudes = dict(zip(CRANK_EFFECTS[effect].numbers(effect), (cosine, sine), strict=True))
    crank, order = 0.9, 14 / 13 if effect == "flank_runout" else 1.0

    def angle_of(torque, phi):
        wave = cosine * np.cos(order * phi) + sine * np.sin(order * phi)
        play, compliance, error = 30.0, 5.0, 0.0
        if effect == "play_once":
            play *= 1 + wave
        elif effect == "compliance_once":
            compliance *= 1 + wave
        else:
            error = wave
        return np.sign(torque) * play * (1 - np.exp(-abs(torque) / 1.5)) + compliance * torque + error

    def energy(angle):
        phi = crank * 14 / 13 / order + TURNED * angle if order > 1 else crank + TURNED * angle
        torque = brentq(lambda t: angle_of(t, phi) - angle, -200, 200, xtol=1e-13)
        return torque * angle - quad(angle_of, 0, torque, args=(phi,), epsabs=1e-11, limit=200)[0]

    angles = np.concatenate([np.linspace(-150, -40, 12), np.linspace(40, 150, 12)])
    torque = np.array([(energy(a + 1e-3) - energy(a - 1e-3)) / 2e-3 for a in angles])
    predicted = curve(torque, SPRING | amplitudes, crank, angles)
    np.testing.assert_allclose(predicted, angles, atol=0.05)


def test_without_effects_of_the_crank_it_is_the_drive_of_a_fixed_crank():
    numbers = LINEAR | {"friction_Nm": 1.1, "load_friction": 0.2}
    known, carried = [], 0.0
    for torque in LOOP:  # the friction of what is carried holds it: T = c + Tc + mu |c| while it grows
        while torque - carried > 1.1 + 0.2 * abs(carried) + 1e-12:
            carried += (torque - carried - 1.1 - 0.2 * abs(carried)) / 1.2
        while carried - torque > 1.1 + 0.2 * abs(carried) + 1e-12:
            carried -= (carried - torque - 1.1 - 0.2 * abs(carried)) / 1.2
        known.append(5.0 * carried)
    known, angle = np.array(known), curve(LOOP, numbers)
    np.testing.assert_allclose(angle - angle.mean(), known - known.mean(), atol=1e-10)
    soft = SPRING | {"friction_Nm": 1.1, "load_friction": 0.2, "friction_spread": 0.6, "first_loading": 0.4}
    turning, fixed = curve(LOOP, soft), curve(LOOP, soft, crank_per_output=0.0)
    np.testing.assert_allclose(turning - turning[0], fixed - fixed[0], atol=1e-10)


def test_a_whole_turn_of_the_output_changes_nothing_and_one_of_the_crank_only_what_belongs_to_a_lobe():
    pin = SPRING | {"pin_circle_runout_cos_arcmin": 10.0, "pin_circle_runout_sin_arcmin": 6.0}
    lobe = SPRING | {"flank_runout_cos_arcmin": 10.0, "flank_runout_sin_arcmin": 6.0}
    for values in (pin, lobe):
        turned = curve(LOOP, values, 0.4 + 2 * np.pi * 13)
        np.testing.assert_allclose(turned, curve(LOOP, values, 0.4), atol=1e-9)
    np.testing.assert_allclose(curve(LOOP, pin, 0.4 + 2 * np.pi), curve(LOOP, pin), atol=1e-9)
    assert np.max(np.abs(curve(LOOP, lobe, 0.4 + 2 * np.pi) - curve(LOOP, lobe))) > 1.0


def test_a_quarter_turn_of_the_output_separates_pin_circle_from_flank():
    """A quarter of the output is 13/4 turns of the crank: their phases differ by 90 degrees more than before."""
    both = [curve(LOOP, SPRING | {f"{name}_runout_cos_arcmin": 10.0}, 0.0) for name in ("pin_circle", "flank")]
    apart = [
        curve(LOOP, SPRING | {f"{name}_runout_cos_arcmin": 10.0}, -2 * np.pi * 13 / 4)
        for name in ("pin_circle", "flank")
    ]
    assert np.std(apart[0] - apart[1]) > 3 * np.std(both[0] - both[1])


def test_the_disk_that_stays_with_its_pins_sees_the_crank_as_the_housing_does():
    """All twist before the disk: it does not turn within the loop, so a flank's order is 1 there."""
    flank = curve(LOOP, SPRING | {"flank_runout_cos_arcmin": 10.0}, 0.0, behind_disk=0.0)
    pin = curve(LOOP, SPRING | {"pin_circle_runout_cos_arcmin": 10.0}, 0.0)
    np.testing.assert_allclose(flank, pin, atol=1e-9)


def test_an_encoder_is_off_where_it_is_read_and_moves_no_torque():
    values = LINEAR | {"encoder_once_cos_arcmin": 9.0, "encoder_once_sin_arcmin": 4.0}
    torque, crank = np.linspace(-30, 30, 61), 0.3
    true_angle = 5.0 * torque
    phi = crank + TURNED * (true_angle - true_angle[0])
    read = true_angle + 9.0 * np.cos(phi) + 4.0 * np.sin(phi)
    np.testing.assert_allclose(curve(torque, values, crank, read, start=read[0]), read, atol=0.01)


def test_friction_in_stages_follows_masing_and_the_first_loading_is_remembered_by_side():
    spread = LINEAR | {"friction_Nm": 4.0, "friction_spread": 0.8}
    first = curve(LOOP, spread, crank_per_output=0.0)
    virgin = np.interp(np.linspace(0, 30, 31), LOOP[:40], first[:40] - first[0])
    down = np.interp(30 - 2 * np.linspace(0, 30, 31), LOOP[119:40:-1], first[119:40:-1])
    np.testing.assert_allclose(down.max() - down, 2 * virgin, atol=2.0)  # Masing: twice the virgin curve
    softer = LINEAR | {"first_loading": 0.5}
    one_side = np.concatenate([np.linspace(0, 30, 31), np.linspace(30, 0, 31), np.linspace(0, -30, 31)])
    angle = curve(one_side, softer, crank_per_output=0.0)
    angle = angle - angle[0]
    assert angle[31 + 15] == pytest.approx(1.2 * angle[15])  # at half the torque: after its first loading, and on it
    np.testing.assert_allclose(-angle[62:], angle[:31], atol=1e-9)  # the other side is as new


def test_several_states_share_what_belongs_to_the_parts():
    rng, states = np.random.default_rng(4), []
    te = {"pin_circle_runout_cos_arcmin": 12.0, "pin_circle_runout_sin_arcmin": -20.0}
    for play, friction in ((90.0, 1.0), (50.0, 2.0), (120.0, 1.5)):
        values = SPRING | te | {"play_arcmin": play, "friction_Nm": friction, "load_friction": 0.2}
        parts = [curve(LOOP[::2], values, crank) for crank in (0.2, 1.9, 4.0)]
        n = len(LOOP[::2])
        states.append(
            CrankLoops(
                np.repeat([0, 1, 2], n),
                np.tile(LOOP[::2], 3)[:, None],
                np.concatenate(parts) + 0.3 * rng.standard_normal(3 * n),
                np.ones(3 * n),
                np.repeat([0.2, 1.9, 4.0], n),
                np.zeros(3 * n),
                TURNED,
                True,
                -13.0,
            )
        )
    fit = fitted_together(states, ["pin_circle_runout"])
    assert fit.rms < 0.4
    assert not fit.at_bound
    for values, (play, friction) in zip(fit.values, ((90.0, 1.0), (50.0, 2.0), (120.0, 1.5)), strict=True):
        assert values["play_arcmin"] == pytest.approx(play, rel=0.03)
        assert values["friction_Nm"] == pytest.approx(friction, rel=0.05)
        assert {name: values[name] for name in te} == {name: pytest.approx(te[name], abs=0.5) for name in te}
    held = fitted_together([states[0].some(states[0].position == 0)], [])
    assert held.rms < 5.0
    known = {name: fit.values[0][name] for name in te}
    beside = fitted_together([states[0].some(states[0].position == 0)], ["pin_circle_runout"], held=known)
    unused = states[0].position > 0
    assert not np.any(states[0].some(~unused).weight[unused])
    errors = [np.sqrt(np.mean((f.predicted_angles[0] - states[0].angle)[unused] ** 2)) for f in (held, beside)]
    assert errors[1] < 0.5 < 5 * errors[1] < errors[0]


def test_creep_follows_the_load_with_its_delay_and_the_zero_of_the_torque_moves_the_loop():
    """At a constant torque the delayed twist comes to its compliance times the torque as 1 - exp(-t / 20 s)."""
    time = np.concatenate([[0.0], np.linspace(1e-6, 100.0, 51)])
    values = LINEAR | {"creep_arcmin_per_Nm": 2.0, "creep_s": 20.0}
    torque = np.where(time > 0, 10.0, 0.0)
    angle = curve(torque, values, crank_per_output=0.0, time=time[:, None])
    np.testing.assert_allclose(angle - angle[0], 5.0 * torque + 20.0 * (1 - np.exp(-time / 20.0)), atol=1e-4)
    moved = curve(LOOP + 0.7, SPRING | {"friction_Nm": 1.0, "torque_zero_Nm": 0.7}, crank_per_output=0.0)
    np.testing.assert_allclose(moved, curve(LOOP, SPRING | {"friction_Nm": 1.0}, crank_per_output=0.0), atol=1e-9)


@pytest.mark.parametrize("zero", [0.0, 0.7])
def test_the_numbers_that_two_states_are_compared_by_are_those_of_the_elements(zero):
    """A loop of play, spring and constant friction has each of them, and 2 c Tc more width at zero torque."""
    play, compliance, friction = 60.0, 5.0, 1.5
    torque = np.concatenate([np.linspace(0, 30, 600), np.linspace(30, -30, 1200), np.linspace(-30, 30, 1200)])
    values = SPRING | {"knee_Nm": 0.05, "friction_Nm": friction, "torque_zero_Nm": zero}
    angle = curve(torque, values, crank_per_output=0.0)
    grid = np.linspace(-30, 30, POINTS)
    falling = np.interp(grid, torque[1799:599:-1], angle[1799:599:-1])
    rising = np.interp(grid, torque[1800:], angle[1800:])
    found = {kind.name: kind.value(Loop(grid, rising, falling)) for kind in KINDS}
    expected = {"play": play, "friction": friction, "compliance": compliance, "torque_zero": zero}
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=0.02, abs=0.02)
    if not zero:
        assert found["width"] == pytest.approx(play + 2 * compliance * friction, rel=0.01)

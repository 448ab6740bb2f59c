"""The flank as drawn and as measured: exact gaps against an independent search, first order and published formulas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import MICROMETRE, PAPER, SMALL, errors_of, random_errors, reducer_at

from pipeline.model.geometry.clearance import exact_gaps, first_order_gaps, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, FlankModification, MeasuredFlank
from pipeline.model.geometry.drawn_flank import deviation_table, drawn_flank, lobe_length, phase_of_arc
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play

PROFILES = pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
DELTA = 5e-4


def modified(profile, *args, **values):
    return replace(profile, modification=FlankModification(*args, **values))


def waves(profile, lobes, size=2e-3):
    """Waves that vanish in the roots, of every lobe apart or of all alike."""
    phase = 2 * np.pi * (np.arange(90) + 0.3) / 90
    shift = np.arange(lobes)[:, None]
    return MeasuredFlank(phase, wave(phase, shift, size))


def wave(phase, shift, size=2e-3):
    return size * np.sin(phase / 2) ** 2 * (np.sin(3 * phase + shift) + 0.3 * np.cos(7 * phase - shift))


def written_flank(profile, lobe, beta):
    """The flank of the textbooks with each modification written out, points (n,) of phases ``beta`` of one lobe."""
    m, n, e = profile.modification, profile.pins, profile.eccentricity
    circle, psi = profile.pin_circle_radius + m.moved_distance, -(lobe + beta / (2 * np.pi)) * profile.lobe_pitch
    k = e * n / circle
    s = np.sqrt(1 + k * k - 2 * k * np.cos(beta))
    offset = profile.pin_radius + m.equidistant + m.rotation * e * (n - 1) * np.abs(np.sin(beta)) / s
    if m.measured_flank is not None:
        offset = offset - wave(beta, lobe if len(m.measured_flank.material) > 1 else 0)
    inward = (k * np.exp(1j * n * psi) - np.exp(1j * psi)) / s
    return circle * np.exp(1j * psi) - e * np.exp(1j * n * psi) + offset * inward


def searched_gaps(profile, crank, errors=None):
    """Distance of each pin from all lobes by a search that narrows from every point of a dense scan."""
    theta = -2 * np.pi * np.arange(profile.pins) / profile.pins
    outward = 0 if errors is None else errors.pin_radial[0] + 1j * errors.pin_tangential[0]
    e = profile.eccentricity + (0 if errors is None else errors.eccentricity[0])
    centre = (np.exp(1j * theta) * (profile.pin_circle_radius + outward) - e * np.exp(1j * crank)) * np.exp(
        1j * crank / profile.lobes
    )
    minimum = np.full(profile.pins, np.inf)
    middle_radius = np.abs(written_flank(profile, 0, np.array([0, np.pi]))).mean()  # of root and tip
    for lobe in range(profile.lobes):
        middle = -(lobe + 0.5) * profile.lobe_pitch
        near_samples = np.flatnonzero(np.abs(np.angle(centre * np.exp(-1j * middle))) < 1.2 * profile.lobe_pitch)
        low, high = np.zeros((len(near_samples), 1)), np.full((len(near_samples), 1), 2 * np.pi)
        turn = 1 if errors is None else np.exp(1j * errors.lobe_pitch[0, lobe] / middle_radius)
        for points in (1001, *[21] * 7):
            beta = low + (high - low) * np.linspace(0, 1, points)
            distance = np.abs(centre[near_samples, None] - turn * written_flank(profile, lobe, beta))
            best = np.take_along_axis(beta, np.argmin(distance, axis=1)[:, None], 1)
            step = (high - low) / (points - 1)
            low, high = np.maximum(best - step, 0), np.minimum(best + step, 2 * np.pi)
        minimum[near_samples] = np.minimum(minimum[near_samples], distance.min(axis=1))
    return minimum - profile.pin_radius - (0 if errors is None else errors.pin_radius[0])


@PROFILES
@pytest.mark.parametrize("crank", [0.0, 0.9])
@pytest.mark.parametrize(
    "modification",
    [
        FlankModification(8e-3, -3e-3),
        FlankModification(rotation=DELTA),
        FlankModification(12e-3, 5e-3, DELTA),
    ],
    ids=["dr and dR", "rotation", "all"],
)
def test_exact_gap_is_the_distance_from_the_drawn_flank(profile, crank, modification):
    drawn_profile = replace(profile, modification=modification)
    reducer = reducer_at(drawn_profile, crank)
    errors = random_errors(drawn_profile, reducer, 1, 3e-3, np.random.default_rng(1), 0.0)
    np.testing.assert_allclose(
        exact_gaps(drawn_profile, reducer, errors, "radial")[0], searched_gaps(drawn_profile, crank, errors), atol=1e-9
    )
    assert reducer_at(profile, crank).pins.arm == pytest.approx(reducer.pins.arm, abs=0)


@pytest.mark.parametrize("lobes", [1, SMALL.lobes])
@pytest.mark.parametrize("crank", [0.0, 0.9, 4.0])
def test_exact_gap_is_the_distance_from_the_measured_flank(lobes, crank):
    """The search knows the waves, the model 90 points of them: the interpolation is up to 10 nm off."""
    drawn_profile = modified(SMALL, 3e-3, -1e-3, DELTA, waves(SMALL, lobes))
    reducer = reducer_at(drawn_profile, crank)
    gap = exact_gaps(drawn_profile, reducer, errors_of(drawn_profile, reducer), "radial")[0]
    np.testing.assert_allclose(gap, searched_gaps(drawn_profile, crank), atol=1e-5)
    assert np.ptp(gap) > 2e-3
    assert deviation_table(drawn_profile).flags.c_contiguous  # as of any other flank: compiled once for both


@pytest.mark.parametrize("crank", [0.0, 0.02, 2.5])
@pytest.mark.parametrize("rotation", [0.0, DELTA], ids=["cycloid", "turned flank"])
def test_exact_gap_is_the_distance_from_lobes_with_pitch_errors(crank, rotation):
    """Lobes turned counterclockwise about the disk's axis, with the pins in the roots and off them."""
    drawn_profile = modified(SMALL, rotation=rotation)
    reducer = reducer_at(drawn_profile, crank)
    errors = random_errors(drawn_profile, reducer, 1, 3e-3, np.random.default_rng(1), 0.0)
    errors = replace(errors, lobe_pitch=np.random.default_rng(2).uniform(-20e-3, 20e-3, (1, SMALL.lobes)))
    gap = exact_gaps(drawn_profile, reducer, errors, "radial")[0]
    np.testing.assert_allclose(gap, searched_gaps(drawn_profile, crank, errors), atol=1e-9)


@pytest.mark.parametrize("crank", [0.02, 7.0, 40.0])
def test_run_out_of_the_bore_shifts_the_flank_in_the_disk_which_turns_backwards(crank):
    """Crank turns apart the disk has turned on: distances in its frame, from the flank shifted in it."""
    reducer, runout = reducer_at(SMALL, crank), np.array([3e-3, -5e-3])
    errors = errors_of(SMALL, reducer, bore_runout=runout)
    reading = {"disk_reading": "radial", "roller_reading": "half_diameter"}
    exact, first_order = (gaps(SMALL, reducer, errors, method=m, **reading)[0] for m in ("exact", "first_order"))
    theta = -2 * np.pi * np.arange(SMALL.pins) / SMALL.pins
    in_disk = (SMALL.pin_circle_radius * np.exp(1j * theta) - SMALL.eccentricity * np.exp(1j * crank)) * np.exp(
        1j * crank / SMALL.lobes
    )
    beta = np.linspace(0, 2 * np.pi, 20001)
    flank = np.concatenate([written_flank(SMALL, lobe, beta) for lobe in range(SMALL.lobes)]) + complex(*runout)
    searched = np.array([np.abs(pin - flank).min() for pin in in_disk]) - SMALL.pin_radius
    np.testing.assert_allclose(exact[: SMALL.pins], searched, atol=1e-7)
    off_root = np.abs(reducer.pins.phase) > np.radians(30)
    np.testing.assert_allclose(first_order[: SMALL.pins][off_root], searched[off_root], atol=1e-4)
    np.testing.assert_array_equal(exact[SMALL.pins :], reducer.contacts.gap[SMALL.pins :])


@PROFILES
def test_pitch_error_of_a_lobe_opens_a_gap_by_its_tangential_part(profile):
    """A lobe moved by t along a circle of radius r moves at the contact by t |p| / r across p, from the disk's axis."""
    reducer = reducer_at(profile, 0.9)
    pitch = np.random.default_rng(3).uniform(-1, 1, (1, profile.lobes))
    centre = profile.eccentricity * np.exp(0.9j)
    radius, arm = profile.pin_circle_radius - profile.pin_radius, reducer.pins.point - centre
    # The lobe of a pin by its angle in the disk's frame, clockwise from the root at 0.
    lobe = np.floor(-np.angle(arm * np.exp(0.9j / profile.lobes)) / profile.lobe_pitch).astype(int) % profile.lobes
    opening = pitch[0, lobe] / radius * np.real(np.conj(reducer.pins.normal) * 1j * arm)
    off_root = np.abs(reducer.pins.phase) > np.radians(30)
    for method, size, misses in ((first_order_gaps, 1.0, 1e-12), (exact_gaps, 1e-4, 2e-4)):
        gap = method(profile, reducer, errors_of(profile, reducer, lobe_pitch=size * pitch), "radial")[0]
        np.testing.assert_allclose((gap / size)[off_root], opening[off_root], atol=misses)
    assert np.abs(opening[off_root]).max() > 0.3


@PROFILES
@pytest.mark.parametrize("method", [exact_gaps, first_order_gaps])
def test_modifications_are_the_errors_of_the_same_size(profile, method):
    """An equidistant is a uniform lobe error along the normal, a moved distance one of the pin circle."""
    for reading, drawn_profile, size in (
        ("normal", modified(profile, equidistant=6e-3), 6e-3),
        ("radial", modified(profile, moved_distance=-6e-3), 6e-3),
    ):
        reducer = reducer_at(drawn_profile, 0.4)
        by_drawing = method(drawn_profile, reducer, errors_of(drawn_profile, reducer), reading)
        by_error = method(profile, reducer, errors_of(profile, reducer, lobe=size), reading)
        np.testing.assert_allclose(by_drawing, by_error, atol=1e-13, rtol=0)


@pytest.mark.parametrize("method", [exact_gaps, first_order_gaps])
def test_a_constant_measured_deviation_is_an_equidistant(method):
    phase = 2 * np.pi * np.arange(12) / 12
    excess = modified(SMALL, measured_flank=MeasuredFlank(phase, np.full((SMALL.lobes, 12), -4e-3)))
    drawn_profile, reducer = modified(SMALL, equidistant=4e-3), reducer_at(SMALL, 1.3)
    errors = random_errors(SMALL, reducer, 3, 2e-3, np.random.default_rng(0))
    gap = method(excess, reducer, errors, "normal")
    np.testing.assert_allclose(gap, method(drawn_profile, reducer, errors, "normal"), atol=1e-12)


def test_a_deviation_of_one_lobe_opens_its_own_pins_only():
    phase = 2 * np.pi * np.arange(24) / 24
    material = np.zeros((SMALL.lobes, 24))
    material[4, 3:-3] = -5e-3  # nothing at its roots, which it shares with its neighbours
    drawn_profile, reducer = modified(SMALL, measured_flank=MeasuredFlank(phase, material)), reducer_at(SMALL, 0.3)
    for method in (exact_gaps, first_order_gaps):
        gap = method(drawn_profile, reducer, errors_of(drawn_profile, reducer), "radial")[0]
        lobe = np.mod(np.floor(-reducer.pins.flank_parameter / SMALL.lobe_pitch), SMALL.lobes)
        opening = (lobe == 4) & (np.abs(reducer.pins.phase) > np.radians(60))
        assert np.all(gap[opening] > 4e-3)
        assert np.any(opening)
        np.testing.assert_allclose(gap[lobe != 4], 0, atol=1e-9)


@PROFILES
def test_first_order_is_the_textbooks_and_misses_a_second_order_away_from_the_roots(profile):
    crank = 0.35
    misses = []
    for size in (1.0, 0.1):
        dr, dR, delta = 4e-3 * size, -3e-3 * size, 1e-4 * size
        drawn_profile = modified(profile, dr, dR, delta)
        reducer = reducer_at(drawn_profile, crank)
        first_order = first_order_gaps(drawn_profile, reducer, errors_of(drawn_profile, reducer), "radial")[0]
        k, phi = profile.shortening, reducer.pins.phase
        s = np.sqrt(1 + k * k - 2 * k * np.cos(phi))
        arm = profile.eccentricity * profile.lobes * np.abs(np.sin(phi)) / s
        np.testing.assert_allclose(first_order, dr - dR * (1 - k * np.cos(phi)) / s + delta * arm, atol=1e-3 * abs(dR))
        off_root = np.abs(phi) > np.radians(40)
        misses.append(
            np.abs(exact_gaps(drawn_profile, reducer, errors_of(drawn_profile, reducer), "radial")[0] - first_order)[
                off_root
            ].max()
        )
    assert misses[0] < 0.1e-3
    assert misses[0] / misses[1] == pytest.approx(100, rel=0.1)


def turned_gaps(profile):
    """First-order gaps over the phase (0, pi), after the disk was turned until the first pin touched."""
    phases, gaps, arms = [], [], []
    for crank in 2 * np.pi / profile.pins * np.arange(120) / 120:
        reducer = reducer_at(profile, crank)
        is_loaded = reducer.pins.arm < 0
        phases.append(reducer.pins.phase[is_loaded])
        arms.append(np.abs(reducer.pins.arm[is_loaded]))
        gaps.append(first_order_gaps(profile, reducer, errors_of(profile, reducer), "radial")[0][is_loaded])
    phase, gap, arm = map(np.concatenate, (phases, gaps, arms))
    return phase, gap - arm * np.min(gap / arm)


@settings(max_examples=6)
@given(share=st.floats(-1.0, 0.9), dr=st.floats(2.0, 10.0))
def test_gaps_after_turning_to_the_first_contact_are_li_and_guans(share, dr):
    """Where dr sqrt(1 - K^2) >= dR the first is the pin of the longest arm, cos phi = K."""
    dr, limit = MICROMETRE * dr, np.sqrt(1 - SMALL.shortening**2)
    dR = share * dr * limit
    phase, gap = turned_gaps(modified(SMALL, dr, dR))
    k, phi = SMALL.shortening, np.abs(phase)
    s = np.sqrt(1 + k * k - 2 * k * np.cos(phi))
    published = dr * (1 - np.sin(phi) / s) - dR * (1 - k * np.cos(phi) - limit * np.sin(phi)) / s
    np.testing.assert_allclose(gap, published, atol=2e-3 * dr)  # K is that of the nominal pin circle
    assert np.degrees(np.abs(phi[np.argmin(gap)] - np.arccos(k))) < 1.0


@PROFILES
def test_play_of_a_rotation_is_twice_its_angle(profile):
    """Gaps |a| delta: the first pin of either sense touches after delta, whichever it is."""
    for crank in (0.0, 0.2, 3.0):
        drawn_profile = modified(profile, rotation=DELTA)
        reducer = reducer_at(drawn_profile, crank)
        rollers = np.zeros((1, len(reducer.contacts) - reducer.n_pins))
        first_order = np.hstack(
            [first_order_gaps(drawn_profile, reducer, errors_of(drawn_profile, reducer), "radial"), rollers]
        )
        assert separated_play(reducer, first_order).backlash[0] == pytest.approx(2 * DELTA, rel=1e-6)
    slight = modified(SMALL, rotation=1e-6)
    exact = (
        np.hstack([exact_gaps(slight, reducer, errors_of(slight, reducer), "radial"), rollers])
        if profile is SMALL
        else None
    )
    if exact is not None:
        assert separated_play(reducer, exact).backlash[0] == pytest.approx(2e-6, rel=1e-3)


def test_root_and_tip_keep_the_parallel_under_a_rotation():
    drawn_profile, parallel = modified(SMALL, 5e-3, 0.0, DELTA), modified(SMALL, 5e-3)
    beta = np.array([0.0, np.pi, 2 * np.pi])
    np.testing.assert_allclose(drawn_flank(drawn_profile, 3, beta), drawn_flank(parallel, 3, beta), atol=1e-15)
    step_value = drawn_flank(drawn_profile, 3, 1.2) - drawn_flank(parallel, 3, 1.2)
    k = SMALL.shortening
    arm = SMALL.eccentricity * SMALL.lobes * np.sin(1.2) / np.sqrt(1 + k * k - 2 * k * np.cos(1.2))
    assert abs(step_value) == pytest.approx(DELTA * arm, rel=1e-9)


def test_arc_length_of_a_lobe_finds_its_phases():
    """A circle of radius R - r has lobes of equal length where the eccentricity vanishes: phase and arc agree."""
    round_disk = CycloidProfile(9, 20.0, 2.0, 1e-9)
    assert lobe_length(round_disk) == pytest.approx(2 * np.pi * 18 / 8, rel=1e-6)
    np.testing.assert_allclose(
        phase_of_arc(round_disk, np.array([0.0, 0.25, 0.5]) * lobe_length(round_disk)),
        np.pi * np.array([0, 0.5, 1.0]),
        atol=1e-6,
    )

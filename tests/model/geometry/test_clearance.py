"""Gaps of actual pins and flanks: first order against exact, exact against brute force, signs, published slopes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import ARCMIN, MICROMETRE, PAPER, SMALL, errors_of, random_errors, reducer_at

from pipeline.model.geometry.clearance import Errors, _first_order_gaps, exact_gaps, first_order_gaps, gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation, pin_lobes
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play

METHODS = {"exact": exact_gaps, "first_order": first_order_gaps}
PROFILES = pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
IN_A_ROOT, OFF_ROOT = 0.0, np.radians(1.3)


def brute_force_gaps(profile, crank, errors, reading):
    """Distance of each actual pin from every sampled lobe nearby, less its radius: an independent construction.

    Lobe j lies between the roots at -j and -(j+1) pitches of the disk frame; each is sampled on its own flank.
    """
    theta = -2 * np.pi * np.arange(profile.pins) / profile.pins
    pin = np.exp(1j * theta) * (profile.pin_circle_radius + errors.pin_radial + 1j * errors.pin_tangential)
    eccentricity = profile.eccentricity + errors.eccentricity[:, None]
    centre = (pin - eccentricity * np.exp(1j * crank)) * np.exp(1j * crank / (profile.pins - 1))
    distance = np.full(centre.shape, np.inf)
    for sample, lobe in np.ndindex(errors.lobe.shape):
        offset = errors.lobe[sample, lobe]
        if reading == "normal":
            flank = replace(profile, pin_radius=profile.pin_radius + offset)
        else:
            factor = {"radial": 1.0, "radial_on_diameter": 0.5}[reading]
            flank = replace(profile, pin_circle_radius=profile.pin_circle_radius - factor * offset)
        low_angle, high_angle = -(lobe + 1) * profile.lobe_pitch, -lobe * profile.lobe_pitch
        is_close = (
            np.abs(np.angle(centre[sample] * np.exp(-0.5j * (low_angle + high_angle)))) < 1.6 * profile.lobe_pitch
        )
        centres = centre[sample, is_close][:, None]
        low, high = np.full(centres.shape, low_angle), np.full(centres.shape, high_angle)
        for points in (301, *[21] * 7):
            psi = low + (high - low) * np.linspace(0, 1, points)
            distances = np.abs(centres - flank.flank(psi))
            best = np.take_along_axis(psi, np.argmin(distances, axis=1)[:, None], 1)
            step = (high - low) / (points - 1)
            low, high = np.maximum(best - step, low_angle), np.minimum(best + step, high_angle)
        distance[sample, is_close] = np.minimum(distance[sample, is_close], distances.min(axis=1))
    return distance - profile.pin_radius - errors.pin_radius


@PROFILES
@pytest.mark.parametrize("crank", [IN_A_ROOT, OFF_ROOT])
@pytest.mark.parametrize("method", METHODS)
def test_no_errors_no_gaps(profile, crank, method):
    reducer = reducer_at(profile, crank)
    np.testing.assert_allclose(METHODS[method](profile, reducer, errors_of(profile, reducer), "radial"), 0, atol=1e-12)


@PROFILES
@pytest.mark.parametrize("reading", ["radial", "radial_on_diameter", "normal"])
@pytest.mark.parametrize("size", [40e-3, 10e-3, 1e-3])
@pytest.mark.parametrize("crank", [IN_A_ROOT, 2.0])
def test_exact_gap_is_the_distance_from_equal_lobes(profile, reading, size, crank):
    reducer = reducer_at(profile, crank)
    errors = random_errors(profile, reducer, 3, size, np.random.default_rng(1))
    errors = replace(errors, lobe=np.repeat(errors.lobe[:, :1], profile.lobes, axis=1))
    gap = exact_gaps(profile, reducer, errors, reading)
    np.testing.assert_allclose(gap, brute_force_gaps(profile, crank, errors, reading), atol=1e-9)


@PROFILES
@pytest.mark.parametrize(("size", "lobe_size"), [(10e-3, 10e-3), (1e-3, 1e-3), (0.1e-3, 1e-3)])
@pytest.mark.parametrize("crank", [IN_A_ROOT, OFF_ROOT])
def test_exact_gap_is_the_distance_from_unequal_lobes(profile, size, lobe_size, crank):
    """Also in and near a root, where the pin may touch the lobe next to its nominal one."""
    reducer = reducer_at(profile, crank)
    errors = random_errors(profile, reducer, 4, size, np.random.default_rng(2), lobe_size)
    gap = exact_gaps(profile, reducer, errors, "normal")
    np.testing.assert_allclose(gap, brute_force_gaps(profile, crank, errors, "normal"), atol=1e-9)


def random_profile(rng):
    """A design without undercut, with 8 to 80 pins, whose roots are anything from wide to sharper than a pin."""
    while True:
        pins = int(rng.integers(8, 81))
        circle = rng.uniform(8.0, 60.0)
        eccentricity = rng.uniform(0.3, 0.9) * circle / pins
        radius = rng.uniform(0.15, 0.4) * np.pi * circle / pins
        profile = CycloidProfile(pins, circle, radius, eccentricity)
        if profile.smallest_convex_locus_radius() > 1.2 * radius:
            return profile


def dense_scan_gaps(profile, crank, errors, reading):
    """Distance from a dense scan of both flanks of each pin's valley and over its tips, zoomed at the nearest point."""
    pins = reducer_at(profile, crank).pins
    turn = np.exp(1j * crank / profile.lobes)
    outward = errors.pin_radial + 1j * errors.pin_tangential
    eccentricity = (profile.eccentricity + errors.eccentricity[:, None]) * np.exp(1j * crank)
    centre = (pins.centre * (1 + outward / profile.pin_circle_radius) - eccentricity) * turn
    root = pins.flank_parameter + pins.phase / profile.lobes
    half = 1.25**2 / 2 * profile.lobe_pitch
    factor = {"radial": 1.0, "radial_on_diameter": 0.5, "normal": 1.0}[reading]
    best = np.full(centre.shape, np.inf)
    for lobes, side in zip(pin_lobes(profile, reducer_at(profile, crank).pins), (1, -1), strict=True):
        offset = factor * errors.lobe[:, lobes]
        circle = profile.pin_circle_radius - (0 * offset if reading == "normal" else offset)
        radius = profile.pin_radius + (offset if reading == "normal" else 0 * offset)
        low, high = np.zeros(centre.shape), np.full(centre.shape, half)
        for points in (501, *[41] * 6):
            arc = low[..., None] + (high - low)[..., None] * np.linspace(0, 1, points)
            psi = root[:, None] + side * arc
            slow, fast = np.exp(1j * psi), profile.eccentricity * np.exp(1j * profile.pins * psi)
            tangent = circle[..., None] * slow - profile.pins * fast
            flank = circle[..., None] * slow - fast - radius[..., None] * tangent / np.abs(tangent)
            distance = np.abs(centre[..., None] - flank)
            nearest = np.take_along_axis(arc, np.argmin(distance, axis=-1)[..., None], -1)[..., 0]
            step = (high - low) / (points - 1)
            low, high = np.maximum(nearest - step, 0), np.minimum(nearest + step, half)
        best = np.minimum(best, distance.min(axis=-1))
    return best - profile.pin_radius - errors.pin_radius


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[] if 0 < k < 6 else pytest.mark.attack) for k in range(12)])
def test_exact_gap_is_that_of_a_dense_scan_of_the_valley(seed):
    """Whichever way a foot is found: pins in roots, on tips and between, moved by 0.1 to 40 um, lobes equal or not."""
    rng = np.random.default_rng(seed)
    profile, crank = (PAPER if seed < 3 else random_profile(rng)), rng.uniform(0, 7)
    reducer = reducer_at(profile, crank)
    for size in (0.1e-3, 1e-3, 5e-3, 15e-3, 40e-3):
        errors = random_errors(profile, reducer, 3, size, rng, lobe_scale=size)
        errors = replace(errors, lobe=np.concatenate([errors.lobe[:2], 0 * errors.lobe[2:] + size]))
        for reading in ("radial", "radial_on_diameter", "normal"):
            gap = exact_gaps(profile, reducer, errors, reading)
            np.testing.assert_allclose(gap, dense_scan_gaps(profile, crank, errors, reading), atol=1e-12, rtol=0)


@PROFILES
@pytest.mark.parametrize("reading", ["radial", "radial_on_diameter", "normal"])
def test_first_order_misses_a_second_order_away_from_the_roots(profile, reading):
    crank = np.radians(20.0)
    reducer = reducer_at(profile, crank)
    errors = random_errors(profile, reducer, 5, 1.0, np.random.default_rng(3))
    off_root = np.abs(reducer.pins.phase) > np.radians(30)
    misses = []
    for size in (1e-3, 1e-4):
        scaled = Errors(**{name: size * value for name, value in vars(errors).items()})
        difference = exact_gaps(profile, reducer, scaled, reading) - first_order_gaps(profile, reducer, scaled, reading)
        misses.append(np.abs(difference[:, off_root]).max())
    assert misses[0] < 0.1e-3
    assert misses[0] / misses[1] == pytest.approx(100, rel=0.05)


def test_gaps_of_first_order_are_compiled_for_one_layout_of_the_errors():
    reducer = reducer_at(PAPER, 0.3)
    errors = errors_of(PAPER, reducer, 4)
    packed = first_order_gaps(PAPER, reducer, errors, "normal")
    compiled = set(_first_order_gaps.signatures)
    every_second = Errors(**{name: np.repeat(values, 2, axis=0)[::2] for name, values in vars(errors).items()})
    turned = Errors(**{name: np.asfortranarray(values) for name, values in vars(errors).items()})
    for strided in (every_second, turned):
        np.testing.assert_array_equal(first_order_gaps(PAPER, reducer, strided, "normal"), packed)
    assert set(_first_order_gaps.signatures) == compiled


def test_first_order_fails_in_the_roots_where_the_pin_lies_close_to_the_evolute():
    reducer = reducer_at(PAPER, IN_A_ROOT)
    errors = errors_of(PAPER, reducer, lobe=10e-3)
    pin = int(np.argmin(np.abs(reducer.pins.phase - np.radians(4.5))))
    first_order, exact = (METHODS[m](PAPER, reducer, errors, "radial")[0, pin] for m in ("first_order", "exact"))
    assert first_order == pytest.approx(9.0e-3, abs=0.05e-3)
    assert abs(exact - first_order) == pytest.approx(0.9e-3, abs=0.05e-3)


@PROFILES
def test_first_order_counts_the_nearer_lobe_in_a_root(profile):
    reducer = reducer_at(profile, IN_A_ROOT)
    for side in (0, -1):  # pin 0 stands in the root between the first and the last lobe
        lobe = np.zeros((1, profile.lobes))
        lobe[0, side] = -1e-3
        assert first_order_gaps(profile, reducer, errors_of(profile, reducer, lobe=lobe), "normal")[
            0, 0
        ] == pytest.approx(-1e-3)
        lobe[0, side] = 1e-3
        assert first_order_gaps(profile, reducer, errors_of(profile, reducer, lobe=lobe), "normal")[0, 0] == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("error", "reading", "per_um"),
    [
        (
            "pin_radial",
            "radial",
            lambda contacts, n, outward: -np.real(np.conj(n) * outward),
        ),  # outwards: away from the disk
        (
            "pin_tangential",
            "radial",
            lambda contacts, n, outward: -np.real(np.conj(n) * 1j * outward),
        ),  # counterclockwise
        ("pin_radius", "radial", lambda contacts, n, outward: -np.ones(len(n))),  # a thicker pin closes
        ("lobe", "normal", lambda contacts, n, outward: np.ones(len(n))),  # material taken off opens
        ("lobe", "radial", lambda contacts, n, outward: -np.real(np.conj(n) * outward)),
        ("lobe", "radial_on_diameter", lambda contacts, n, outward: -0.5 * np.real(np.conj(n) * outward)),
        ("eccentricity", "radial", lambda contacts, n, outward: np.real(np.conj(n) * np.exp(1j * contacts.crank))),
    ],
)
def test_sign_and_size_of_each_error(method, error, reading, per_um):
    crank = 0.7
    reducer = reducer_at(PAPER, crank)
    gap = METHODS[method](PAPER, reducer, errors_of(PAPER, reducer, **{error: 0.1e-3}), reading)[0]
    theta = -2 * np.pi * np.arange(PAPER.pins) / PAPER.pins
    to_pitch_point = PAPER.eccentricity * PAPER.pins * np.exp(1j * crank) - PAPER.pin_circle_radius * np.exp(1j * theta)
    expected = per_um(reducer, to_pitch_point / np.abs(to_pitch_point), np.exp(1j * theta))
    off_root = np.abs(reducer.pins.phase) > np.radians(20)
    np.testing.assert_allclose(gap[off_root] / 0.1e-3, expected[off_root], atol=2e-3)


@pytest.mark.parametrize(("reading", "share"), [("diameter", 1.0), ("half_diameter", 0.5)])
def test_a_smaller_roller_opens_its_own_contact_only(reading, share):
    reducer = reducer_at(SMALL, 0.4)
    rollers = len(reducer.contacts) - SMALL.pins
    diameter = -1e-3 * np.eye(rollers)
    gap = gaps(
        SMALL,
        reducer,
        errors_of(SMALL, reducer, rollers, roller_diameter=diameter),
        method="first_order",
        disk_reading="radial",
        roller_reading=reading,
    )
    np.testing.assert_array_equal(gap[:, : SMALL.pins], 0)
    np.testing.assert_allclose(gap[:, SMALL.pins :], -share * diameter)
    with pytest.raises(ValueError, match="1 roller errors for 16 rollers"):
        gaps(
            SMALL,
            reducer,
            replace(errors_of(SMALL, reducer), roller_diameter=np.zeros((1, 1))),
            method="exact",
            disk_reading="radial",
            roller_reading=reading,
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size_um", [1.0, 10.0])
def test_uniform_radial_disk_error_gives_the_published_slope_at_any_crank_angle(method, size_um):
    """0.0632 arcmin per um on the diameter, with no fitted number (mechanics, section 2)."""
    for crank in np.radians([0.0, 1.0, 4.5, 45.0, 123.4, 300.0]):
        reducer = reducer_at(PAPER, crank)
        errors = errors_of(PAPER, reducer, lobe=size_um * MICROMETRE)
        gap = gaps(
            PAPER, reducer, errors, method=method, disk_reading="radial_on_diameter", roller_reading="half_diameter"
        )
        assert 0.0631 < ARCMIN * separated_play(reducer, gap).backlash[0] / size_um < 0.0633


def test_normal_disk_error_of_10_um_alone_exceeds_the_published_total():
    reducer = reducer_at(PAPER, IN_A_ROOT)
    gap = gaps(
        PAPER,
        reducer,
        errors_of(PAPER, reducer, lobe=10e-3),
        method="exact",
        disk_reading="normal",
        roller_reading="diameter",
    )
    assert ARCMIN * separated_play(reducer, gap).backlash[0] == pytest.approx(2.487, abs=1e-3)


@settings(max_examples=15)
@given(pitches=st.integers(1, 11), crank=st.floats(0.05, 0.45), method=st.sampled_from(sorted(METHODS)))
def test_turning_crank_and_errors_by_pin_pitches_turns_the_gaps(pitches, crank, method):
    """A pin pitch of the crank brings the next pin into the place of this one, and the next lobe too."""
    errors = random_errors(SMALL, reducer_at(SMALL, 0.0), 2, 2e-3, np.random.default_rng(pitches))
    turned_unit = Errors(
        **{
            name: np.roll(value, pitches, axis=1)
            if name in ("pin_radial", "pin_tangential", "pin_radius", "lobe")
            else value
            for name, value in vars(errors).items()
        }
    )
    gap = METHODS[method](SMALL, reducer_at(SMALL, crank), errors, "radial")
    shifted = reducer_at(SMALL, crank - 2 * np.pi * pitches / SMALL.pins)
    np.testing.assert_allclose(
        METHODS[method](SMALL, shifted, turned_unit, "radial"), np.roll(gap, pitches, axis=1), atol=1e-11
    )


@PROFILES
def test_each_pin_stands_between_the_two_lobes_at_its_sides(profile):
    for crank in (0.3, 2.0, 40.0):
        reducer = reducer_at(profile, crank)
        lobe_before, lobe_behind = pin_lobes(profile, reducer.pins)
        psi = reducer.pins.centre - profile.eccentricity * np.exp(1j * crank)
        turn = (
            np.angle(psi) - disk_rotation(profile, crank)
        ) / profile.lobe_pitch  # valley = nearest root, counterclockwise
        assert np.all(
            np.abs(np.angle(np.exp(2j * np.pi * (turn + lobe_behind) / profile.lobes))) < 2 * np.pi / profile.lobes
        )
        np.testing.assert_array_equal((lobe_before + 1) % profile.lobes, lobe_behind)

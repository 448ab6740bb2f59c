"""The flank against the envelope of its pins, numerical differentiation, published formulas and brute force."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from reducers import PAPER, SMALL

from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation, pin_contacts


@st.composite
def geometries(draw):
    """Valid designs: K1 < 1, pins apart, no undercut."""
    pins, circle = draw(st.integers(4, 90)), draw(st.floats(5, 80))
    bare = CycloidProfile(pins, circle, 0.0, draw(st.floats(0.02, 0.95)) * circle / pins)
    largest = min(bare.smallest_convex_locus_radius(), circle * np.sin(np.pi / pins))
    profile = CycloidProfile(pins, circle, draw(st.floats(0.1, 0.95)) * largest, bare.eccentricity)
    assume(profile.smallest_convex_locus_radius() > profile.pin_radius)
    return profile


def distance_from_flank(profile, centre):
    """Brute force: distance of points (disk frame) from the flank sampled within a lobe pitch of each, zoomed in."""
    middle, reach = np.angle(centre)[..., None], profile.lobe_pitch
    for points in (200, *[21] * 7):
        psi = middle + reach * np.linspace(-1, 1, points)
        distance = np.abs(profile.flank(psi) - centre[..., None])
        middle = np.take_along_axis(psi, np.argmin(distance, axis=-1)[..., None], -1)
        reach *= 2.0 / (points - 1)
    return distance.min(axis=-1)


def envelope_error(profile, cranks):
    """Largest |distance| of a nominal pin from the nominal disk, turned by -alpha/(N-1) about e exp(i alpha)."""
    crank = np.asarray(cranks)[:, None]
    pins = profile.pin_circle_radius * np.exp(-2j * np.pi * np.arange(profile.pins) / profile.pins)
    in_disk = (pins - profile.eccentricity * np.exp(1j * crank)) * np.exp(1j * crank / (profile.pins - 1))
    return np.abs(distance_from_flank(profile, in_disk) - profile.pin_radius).max()


@pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
def test_every_pin_touches_the_disk_at_every_crank_angle(profile):
    assert envelope_error(profile, 2 * np.pi * np.arange(64) / 64) < 1e-9


@settings(max_examples=25)
@given(profile=geometries(), crank=st.floats(-10, 10))
def test_every_pin_touches_the_disk_of_any_design(profile, crank):
    assert envelope_error(profile, [crank]) < 1e-9


@settings(max_examples=25)
@given(profile=geometries(), crank=st.floats(-10, 10))
def test_contacts_lie_on_the_flank_and_their_normals_turn_the_disk_by_the_arm(profile, crank):
    contacts = pin_contacts(profile, crank)
    centre, turn = profile.eccentricity * np.exp(1j * crank), np.exp(1j * disk_rotation(profile, crank))
    size = profile.pin_circle_radius
    np.testing.assert_allclose(
        contacts.point, centre + turn * profile.flank(contacts.flank_parameter), atol=1e-12 * size
    )
    np.testing.assert_allclose(contacts.normal, turn * profile.normal(contacts.flank_parameter), atol=1e-10)
    np.testing.assert_allclose(
        contacts.point - contacts.centre, profile.pin_radius * contacts.normal, atol=1e-12 * size
    )
    clockwise = size * np.exp(-2j * np.pi * np.arange(profile.pins) / profile.pins)
    np.testing.assert_allclose(contacts.centre, clockwise, atol=1e-12 * size)
    phase = np.exp(1j * (np.angle(clockwise) - crank))
    np.testing.assert_allclose(np.exp(1j * contacts.phase), phase, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * profile.phase(contacts.flank_parameter)), phase, atol=1e-9)
    moment = np.imag(np.conj(contacts.point - centre) * contacts.normal)
    shape = np.sqrt(1 + profile.shortening**2 - 2 * profile.shortening * np.cos(contacts.phase))
    np.testing.assert_allclose(contacts.arm, moment, atol=1e-9 * size)
    np.testing.assert_allclose(
        contacts.arm, -profile.eccentricity * (profile.pins - 1) * np.sin(contacts.phase) / shape, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        contacts.flank_curvature, profile.flank_curvature(profile.phase(contacts.flank_parameter))
    )


def test_arm_is_largest_where_the_cosine_of_the_phase_is_the_shortening():
    arms = np.array([np.abs(pin_contacts(PAPER, crank).arm) for crank in np.linspace(0, 2 * np.pi / 80, 200)])
    phases = np.array([pin_contacts(PAPER, crank).phase for crank in np.linspace(0, 2 * np.pi / 80, 200)])
    assert arms.max() == pytest.approx(27.65, rel=1e-6)
    assert np.cos(phases.ravel()[arms.argmax()]) == pytest.approx(PAPER.shortening, abs=1e-3)
    reducer = {round(float(np.degrees(b)), 1): a for b, a in zip(phases[0], arms[0], strict=True)}
    assert (reducer[-4.5], reducer[-9.0]) == pytest.approx((13.9, 21.5), abs=0.05)  # mechanics of the roots, section 4


@settings(max_examples=25)
@given(profile=geometries(), start=st.floats(-4, 4))
def test_flank_closes_after_all_of_its_equal_lobes_without_crossing_itself(profile, start):
    lobe = start + profile.lobe_pitch * np.linspace(0, 1, 400)
    whole = start + 2 * np.pi * np.arange(profile.lobes + 1) / profile.lobes
    np.testing.assert_allclose(profile.flank(whole[-1]), profile.flank(start), atol=1e-12 * profile.pin_circle_radius)
    np.testing.assert_allclose(
        profile.flank(lobe + profile.lobe_pitch),
        np.exp(1j * profile.lobe_pitch) * profile.flank(lobe),
        atol=1e-11 * profile.pin_circle_radius,
    )
    bearing = np.unwrap(np.angle(profile.flank(lobe)))
    assert bearing[-1] - bearing[0] == pytest.approx(2 * np.pi / (profile.pins - 1), rel=1e-9)  # once around


def derivative(profile, curve, points=2048):
    """Spectral derivative by psi of ``curve``, whose values times exp(-i psi) have the period of a lobe."""
    psi = profile.lobe_pitch * np.arange(points) / points
    order = 1j * (1 + profile.lobes * np.fft.fftfreq(points, 1 / points))
    return np.fft.ifft(np.fft.fft(curve(psi) * np.exp(-1j * psi)) * order) * np.exp(1j * psi), psi


@settings(max_examples=25)
@given(profile=geometries() | st.just(PAPER))
def test_normals_and_curvature_agree_with_numerical_differentiation(profile):
    normal_part, psi = derivative(profile, profile.flank)
    normal = profile.normal(psi)
    np.testing.assert_allclose(
        normal, 1j * normal_part / np.abs(normal_part), atol=1e-8
    )  # to the left of a counterclockwise curve
    turning, _ = derivative(profile, profile.normal)
    curvature = np.imag(np.conj(normal) * turning) / np.abs(normal_part)
    np.testing.assert_allclose(profile.flank_curvature(profile.phase(psi)), curvature, rtol=1e-8, atol=1e-8)


@settings(max_examples=25)
@given(profile=geometries())
def test_flank_is_the_published_parametric_form(profile):
    """Shin and Kwon, Mech. Mach. Theory 41 (2006) 596, eq. 6: x and y with psi = atan2(...)."""
    n, circle, r, e = profile.pins, profile.pin_circle_radius, profile.pin_radius, profile.eccentricity
    t = np.linspace(0, 2 * np.pi, 500)
    turn = np.arctan2(np.sin((1 - n) * t), circle / (e * n) - np.cos((1 - n) * t))
    x = circle * np.cos(t) - r * np.cos(t + turn) - e * np.cos(n * t)
    y = -circle * np.sin(t) + r * np.sin(t + turn) + e * np.sin(n * t)
    np.testing.assert_allclose(profile.flank(-t), x + 1j * y, atol=1e-12 * circle)


@settings(max_examples=40)
@given(pins=st.integers(4, 90), shortening=st.floats(0.005, 0.99))
def test_smallest_convex_radius_is_the_smallest_found_by_sampling(pins, shortening):
    profile = CycloidProfile(pins, 30.0, 0.1, shortening * 30.0 / pins)
    radius = profile.locus_radius(np.linspace(0, np.pi, 200_001))
    sampled = np.min(-radius[radius < 0])
    assert profile.smallest_convex_locus_radius() == pytest.approx(sampled, rel=1e-7)


def test_smallest_convex_radius_of_the_paper():
    assert PAPER.smallest_convex_locus_radius() == pytest.approx(1.0453, abs=5e-5)
    largest_curvature = PAPER.flank_curvature(np.linspace(0, np.pi, 100_001)).max()
    assert 1 / largest_curvature == pytest.approx(0.245, abs=5e-4)
    assert PAPER.locus_radius(0.0) == pytest.approx(9.2e-3, abs=5e-5)  # concave root: 9.2 um from the evolute
    assert -1 / PAPER.flank_curvature(0.0) == pytest.approx(0.809, abs=5e-4)

"""Pins out of round: gaps against the least distance of two dense contours, and first order where it holds."""

import numpy as np
import pytest
from reducers import MICROMETRE, PAPER, SMALL, errors_of, reducer_at
from scipy.spatial import KDTree

from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.cycloid_profile import disk_rotation

READING = {"disk_reading": "radial", "roller_reading": "half_diameter"}
LOOSE = 0.02
"""By which the pins are thinner [mm], so that no contour cuts another."""


def waves_of(amplitude, phase):
    """Waves of order 2 and 3 from amplitudes and directions (n, n_pins, 2)."""
    return amplitude * np.exp(-1j * np.array([2, 3]) * phase)


def contour_distance(profile, reducer, errors, pin):
    """Least distance of the flank from the contour of a pin out of round, both as dense points."""
    radial, tangential = errors.pin_radial[0, pin], errors.pin_tangential[0, pin]
    theta = profile.pin_angle()[pin]
    centre = (profile.pin_circle_radius + radial + 1j * tangential) * np.exp(1j * theta)
    eccentric = (profile.eccentricity + errors.eccentricity[0]) * np.exp(1j * reducer.crank)
    circumference = np.angle(reducer.pins.normal[pin]) + np.linspace(-1.4, 1.4, 12001)
    second_run, three_effects = errors.pin_roundness[0, pin]
    radius = profile.pin_radius + errors.pin_radius[0, pin]
    radius = radius + np.real(second_run * np.exp(2j * circumference) + three_effects * np.exp(3j * circumference))
    contour = centre + radius * np.exp(1j * circumference)
    reach = 1.5 * profile.pin_radius / profile.pin_circle_radius
    psi = reducer.pins.flank_parameter[pin] + np.linspace(-reach, reach, 12001)
    flank = eccentric + profile.flank(psi) * np.exp(1j * disk_rotation(profile, reducer.crank))
    tree = KDTree(np.stack([flank.real, flank.imag], axis=1))
    return tree.query(np.stack([contour.real, contour.imag], axis=1))[0].min()


@pytest.mark.parametrize(("profile", "crank", "step"), [(SMALL, 0.3, 3), (PAPER, 0.0, 23), (PAPER, 2.1, 29)])
@pytest.mark.long
def test_the_gap_is_the_distance_of_the_contours_roots_included(profile, crank, step):
    reducer, rng = reducer_at(profile, crank), np.random.default_rng(4)
    shape = (1, profile.pins)
    errors = errors_of(
        profile,
        reducer,
        pin_radius=-LOOSE,
        pin_radial=3 * MICROMETRE * rng.uniform(-1, 1, shape),
        pin_tangential=3 * MICROMETRE * rng.uniform(-1, 1, shape),
        eccentricity=2 * MICROMETRE,
        pin_roundness=waves_of(2 * MICROMETRE, rng.uniform(0, 2 * np.pi, (*shape, 2))),
    )
    exact = gaps(profile, reducer, errors, method="exact", **READING)[0, : profile.pins]
    nearest_root, worst = np.argsort(np.abs(reducer.pins.phase))[:3], 0.0
    for pin in {*range(0, profile.pins, step), *nearest_root.tolist()}:
        rotation = 5 * 2 * MICROMETRE / profile.pin_radius  # the direction of the least gap against the normal, at most
        distance = contour_distance(profile, reducer, errors, pin)
        assert exact[pin] == pytest.approx(distance, abs=rotation**2 * distance + 1e-7), pin
        worst = max(worst, abs(exact[pin] - distance))
    assert worst < 3e-6


def test_first_order_misses_a_hundredth_at_a_tenth_of_the_wave():
    reducer, rng = reducer_at(PAPER, 0.7), np.random.default_rng(1)
    phase = rng.uniform(0, 2 * np.pi, (1, PAPER.pins, 2))
    off_root = np.abs(reducer.pins.phase) > np.radians(50)
    misses = []
    for amplitude in (4 * MICROMETRE, 0.4 * MICROMETRE):
        errors = errors_of(PAPER, reducer, pin_roundness=waves_of(amplitude, phase))
        exact, first_order = (
            gaps(PAPER, reducer, errors, method=method, **READING)[0] for method in ("exact", "first_order")
        )
        misses.append(np.abs(exact - first_order)[: PAPER.pins][off_root].max())
        assert np.abs(first_order[: PAPER.pins]).max() < 2 * amplitude + 1e-12
        np.testing.assert_array_equal(exact[PAPER.pins :], first_order[PAPER.pins :])
    assert 60 < misses[0] / misses[1] < 140


def test_an_oval_pin_is_thick_in_its_direction_and_thin_across_it():
    reducer = reducer_at(SMALL, 0.3)
    normal = np.angle(reducer.pins.normal)
    for turn, order, sign in ((0, 0, 1), (np.pi / 2, 0, -1), (np.pi, 0, 1), (np.pi / 3, 1, -1), (2 * np.pi / 3, 1, 1)):
        amplitude = np.zeros(2)
        amplitude[order] = MICROMETRE
        errors = errors_of(
            SMALL, reducer, pin_roundness=waves_of(amplitude, (normal - turn)[None, :, None] + np.zeros(2))
        )
        closing_values = -gaps(SMALL, reducer, errors, method="first_order", **READING)[0, : SMALL.pins]
        np.testing.assert_allclose(closing_values, sign * MICROMETRE, atol=1e-12)

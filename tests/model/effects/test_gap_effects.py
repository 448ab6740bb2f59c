"""Effects on gaps and errors against exact gaps, rigid play and symmetry over a turn of the crank."""

from dataclasses import replace

import numpy as np
import pytest
from drives import small_drive
from drives_with_effects import MIDDLE, SHARES, put
from reducers import MICROMETRE, SMALL

from pipeline.model.effects import Conditions
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, separated_play
from pipeline.model.load_history.backbone import backbone


def ends(drive):
    """Poses of the output at the ends of the rigid play (n,), minus and plus."""
    play = separated_play(drive.reducer, drive.gap)
    output = drive.reducer.output_motion
    return play.pose_minus[:, output], play.pose_plus[:, output]


@pytest.mark.parametrize("depth_um", [5.0, -5.0])
def test_flank_wear_moves_one_end_of_the_play(depth_um):
    drive = small_drive(4, scale=1 * MICROMETRE)
    worn = put(drive, "flank_wear", depth_um)
    (minus, plus), (worn_minus, worn_plus) = ends(drive), ends(worn)
    kept_items, shifted = (
        ((minus, worn_minus), worn_plus - plus) if depth_um > 0 else ((plus, worn_plus), worn_minus - minus)
    )
    np.testing.assert_array_equal(*kept_items)
    arm, depth = drive.reducer.pins.arm, 1e-3 * abs(depth_um)
    is_loaded = arm < 0 if depth_um > 0 else arm > 0
    of_pins = drive.gap[:, : drive.reducer.n_pins][:, is_loaded] / np.abs(arm[is_loaded])
    expected = np.min(of_pins + depth / np.abs(arm[is_loaded]), axis=1) - np.min(of_pins, axis=1)
    np.testing.assert_allclose(np.sign(depth_um) * shifted, expected, rtol=1e-12)


def test_run_in_wears_over_the_cycles():
    drive = small_drive(4)
    cycles = np.array([0.0, 1.0, 5.0, np.inf])
    variant = put(drive, "run_in", 8.0, 2.5, conditions=Conditions(cycles, np.zeros(4)))
    n = drive.reducer.n_pins
    worn = 8e-3 * (1 - np.exp(-cycles / 2.5))
    np.testing.assert_allclose((variant.gap - drive.gap)[:, :n], np.repeat(worn[:, None], n, axis=1), atol=1e-15)
    np.testing.assert_array_equal((variant.gap - drive.gap)[:, n:], 0.0)


def test_thermal_growth_is_an_error_of_the_pin_circle():
    drive = small_drive(3)
    rise = np.array([0.0, 10.0, 40.0])
    variant = put(drive, "thermal_growth", 12.0, conditions=Conditions(np.zeros(3), rise))
    growth_um = 12.0 * SMALL.pin_circle_radius * 1e-3 * rise  # um/(m K) x m x K
    for state, um in enumerate(growth_um):
        np.testing.assert_allclose(variant.gap[state], put(drive, "pin_circle_error", um).gap[state], atol=1e-15)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_turned_with_the_crank_is_the_same_reducer(lobes):
    pitch = 2 * np.pi / SMALL.pins
    drives = [small_drive(crank=0.4 + turn * pitch, scale=0.0) for turn in range(SMALL.pins)]
    gap_at_start = put(drives[0], f"ovality_{lobes}", 10.0, 0.0).gap[0, : SMALL.pins]
    assert np.ptp(gap_at_start) > 5e-3
    for turn, drive in enumerate(drives):
        phase = lobes * turn * pitch
        variant = put(drive, f"ovality_{lobes}", 10 * np.cos(phase), 10 * np.sin(phase)).gap[0, : SMALL.pins]
        np.testing.assert_allclose(np.roll(variant, turn), gap_at_start, atol=1e-12)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_opens_as_much_as_it_closes_over_a_turn_of_the_crank(lobes):
    pitch, changes = 2 * np.pi / SMALL.pins, []
    for turn in range(SMALL.pins):
        drive = small_drive(crank=0.4 + turn * pitch, scale=0.0)
        drive = replace(drive, reading=replace(drive.reading, method="first_order"))
        variant = put(drive, f"ovality_{lobes}", 10.0, 0.0)
        changes.append(np.roll((variant.gap - drive.gap)[0, : SMALL.pins], turn))
    waves = np.abs(np.fft.rfft(changes, axis=0))  # over the crank, at every place of the flank
    assert np.all(waves[lobes] > 0.1 * SMALL.pins / 2 * 1e-3)
    waves[lobes] = 0.0
    np.testing.assert_allclose(waves, 0.0, atol=1e-12)


@pytest.mark.parametrize("lobes", [2, 3])
def test_ovality_displaces_every_pin_along_its_radius(lobes):
    drive = small_drive(scale=0.0)
    variant = put(drive, f"ovality_{lobes}", 3.0, -4.0)
    angle = np.angle(drive.reducer.pins.centre)
    expected = 5e-3 * np.cos(lobes * angle - np.arctan2(-4.0, 3.0))
    np.testing.assert_allclose(variant.errors.pin_radial[0], expected, atol=1e-15)


def test_clearance_of_the_bearing_widens_the_play():
    drive = small_drive(3, scale=1 * MICROMETRE)
    variant = put(drive, "bearing_clearance", 4.0)
    expected = general_play(drive.reducer, drive.gap, np.full(3, 4e-3)).backlash
    curve = backbone(variant, SHARES)
    np.testing.assert_allclose(curve.angle[:, MIDDLE] - curve.angle[:, MIDDLE - 1], expected, rtol=1e-3)
    assert np.all(expected > 1.05 * separated_play(drive.reducer, drive.gap).backlash)


@pytest.mark.parametrize(
    ("name", "error"),
    [("eccentricity_error", "eccentricity"), ("pin_circle_error", "pin_radial"), ("pin_radius_error", "pin_radius")],
)
def test_error_of_a_dimension_gives_its_exact_gaps(name, error):
    drive = small_drive(2)
    error_before = getattr(drive.errors, error)
    errors = replace(drive.errors, **{error: error_before + 6e-3})
    expected = gaps(drive.profile, drive.reducer, errors, **vars(drive.reading))
    np.testing.assert_allclose(put(drive, name, 6.0).gap, expected, atol=1e-15)


def test_preload_closes_every_gap_of_the_pins():
    drive, n = small_drive(2), SMALL.pins
    increment = put(drive, "preload", 3.0).gap - drive.gap
    np.testing.assert_allclose(increment[:, :n], -3e-3, atol=1e-15)
    np.testing.assert_array_equal(increment[:, n:], 0.0)
    thicker = put(drive, "pin_radius_error", 3.0).gap - drive.gap  # the same to the pins' gaps
    np.testing.assert_allclose(increment[:, :n], thicker[:, :n], atol=1e-12)


def test_a_runout_moves_every_pin_or_the_flank_by_the_length_of_its_two_numbers():
    drive = small_drive()
    of_pins, of_flank = (put(drive, name, 3.0, 4.0).errors for name in ("pin_circle_runout", "flank_runout"))
    radial = of_pins.pin_radial - drive.errors.pin_radial
    tangential = of_pins.pin_tangential - drive.errors.pin_tangential
    np.testing.assert_allclose(np.hypot(radial, tangential), 5e-3)
    angle = drive.profile.pin_angle()
    np.testing.assert_allclose(radial, 1e-3 * (3 * np.cos(angle) + 4 * np.sin(angle))[None], atol=1e-12)
    np.testing.assert_allclose(np.squeeze(of_flank.bore_runout), [3e-3, 4e-3])

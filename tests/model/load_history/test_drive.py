"""The frictionless curve of a drive: its ladder, its ends of play, its torsion, and what each gap does to it."""

from dataclasses import replace

import numpy as np
import pytest
from drives import LINEAR, RATED, small_drive
from reducers import MICROMETRE

from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.geometry.reducer import Bearing
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, separated_play
from pipeline.model.load_history import load_cycle
from pipeline.model.load_history.backbone import NO_LOAD, backbone, torque_levels

SHARES = torque_levels(40, 1.05)
MIDDLE = len(SHARES) + 1  # the positive end of play


def test_ladder_ascends_from_no_load_to_its_reach():
    for levels, reach in ((11, 1.05), (22, 0.4), (40, 3.0)):
        shares = torque_levels(levels, reach)
        assert len(shares) == levels
        assert np.all(np.diff(shares) > 0)
        assert shares[0] == NO_LOAD
        np.testing.assert_allclose(shares[-1], reach)
        assert np.all(np.diff(shares, 2) > 0)  # denser towards zero


def test_ends_of_play_are_those_of_rigid_bodies():
    drive = small_drive(6, seed=3)
    curve = backbone(drive, SHARES)
    assert np.all(curve.states.converged)
    play = separated_play(drive.reducer, drive.gap)
    width = curve.angle[:, MIDDLE] - curve.angle[:, MIDDLE - 1]
    assert np.all(play.backlash > 1e-5)
    np.testing.assert_allclose(width, play.backlash, rtol=1e-12)
    assert np.all(curve.states.force[:, MIDDLE - 1 : MIDDLE + 1] == 0)
    np.testing.assert_allclose(curve.torque, -curve.torque[::-1])
    assert np.all(np.diff(curve.torque) > 0)
    assert np.all(np.diff(curve.angle, axis=1) > 0)


def test_torsion_adds_its_twist():
    drive = small_drive(2, seed=1)
    reference, twisted = backbone(drive, SHARES), backbone(replace(drive, elements=(LinearSpring(2e-8),)), SHARES)
    np.testing.assert_allclose(
        twisted.angle - reference.angle, 2e-8 * np.tile(reference.torque, (2, 1)), rtol=1e-9, atol=1e-18
    )
    np.testing.assert_array_equal(twisted.states.force, reference.states.force)


def test_clearance_of_the_bearing_widens_the_play_as_the_general_program_says():
    drive = small_drive(4, seed=2, clearance=3 * MICROMETRE)
    curve = backbone(drive, SHARES)
    assert np.all(curve.states.converged)
    play = general_play(drive.reducer, drive.gap, drive.bearing_clearance)
    width = curve.angle[:, MIDDLE] - curve.angle[:, MIDDLE - 1]
    np.testing.assert_allclose(width, play.backlash, rtol=1e-9)
    assert np.all(play.backlash > 1.1 * separated_play(drive.reducer, drive.gap).backlash)


@pytest.mark.parametrize("clearance_um", [1.0, 3.0, 10.0])
def test_ends_of_play_are_found_with_any_clearance_of_the_bearing(clearance_um):
    for seed in range(8):
        drive = small_drive(4, seed=seed, play=6 * MICROMETRE, clearance=clearance_um * MICROMETRE)
        assert np.all(backbone(drive, SHARES).states.converged)


STIFF = Bearing(4e6, 1.5)
LOOSE = {
    "loose": {"play": 20 * MICROMETRE},
    "interfering": {"play": 0.0},
    "interfering_and_stiff": {"play": 0.0, "bearing": STIFF, "floats": True},
    "far": {"play": 20 * MICROMETRE, "bearing": STIFF, "floats": True},
    "far_at_another_crank": {"play": 20 * MICROMETRE, "bearing": STIFF, "floats": True, "crank": 3.5},
}


PRELOADED = {f"preloaded_by_{depth}_um": {"play": -2 * depth * MICROMETRE} for depth in (2, 10, 30)}


def both_ways(monkeypatch, drive):
    """The curve of the drive, and that with each sample solved in the other direction first."""
    curve, way = backbone(drive, SHARES), load_cycle._solve_direction

    def reversed_way(drive, pose, levels, preloaded, downward, limit=None):
        return way(drive, pose, levels, preloaded, not downward, limit)

    monkeypatch.setattr(load_cycle, "_solve_direction", reversed_way)
    return curve, backbone(drive, SHARES)


@pytest.mark.parametrize("name", {**LOOSE, **PRELOADED})
def test_curve_is_the_same_upwards_and_downwards(name, monkeypatch):
    options = {**LOOSE, **PRELOADED}[name]
    drive = small_drive(6, clearance=30 * MICROMETRE if name in LOOSE else 0.0, **options)
    drive = drive.with_added_gap(np.random.default_rng(3).uniform(-5, 5, drive.gap.shape) * MICROMETRE)
    curve, reverse = both_ways(monkeypatch, drive)
    assert np.all(curve.states.converged)
    assert np.all(reverse.states.converged)
    np.testing.assert_allclose(curve.angle, reverse.angle, rtol=0, atol=1e-9)
    np.testing.assert_allclose(curve.states.force, reverse.states.force, rtol=0, atol=1e-7 * curve.states.force.max())


@pytest.mark.parametrize("name", ["loose", "preloaded_by_10_um"])
def test_samples_that_are_lost_on_their_way_are_solved_on_the_other(name, monkeypatch):
    drive = small_drive(6, **{**LOOSE, **PRELOADED}[name])
    expected, way, solves = backbone(drive, SHARES), load_cycle._solve_direction, []

    def losing(drive, pose, levels, preloaded, downward, limit=None):
        states = way(drive, pose, levels, preloaded, downward, limit)
        if not downward:
            states.motion[2], states.converged[2, 1] = np.nan, False
        solves.append((downward, len(pose)))
        return states

    monkeypatch.setattr(load_cycle, "_solve_direction", losing)
    curve = backbone(drive, SHARES)
    assert solves == 2 * [(False, 6), (True, 1)]  # of either sense, and no other sample
    assert np.all(curve.states.converged)
    np.testing.assert_allclose(curve.angle, expected.angle, rtol=0, atol=1e-10)


def test_an_end_of_a_preloaded_sample_is_the_limit_or_the_small_torque_where_that_is_lost():
    states = backbone(small_drive(3), SHARES).states[:, :4]
    states.converged[1, 0] = False
    ends = load_cycle._from_limit(states)
    assert np.all(ends.converged)
    for sample, end in enumerate((0, 1, 0)):
        np.testing.assert_array_equal(ends.motion[sample], states.motion[sample, [end, 2, 3]])


def test_preloaded_drive_has_no_play_and_carries_force_without_torque():
    curve = backbone(small_drive(3, play=-8 * MICROMETRE), SHARES)
    assert np.all(curve.states.converged)
    width = curve.angle[:, MIDDLE] - curve.angle[:, MIDDLE - 1]
    assert np.all(width < 1e-4 * np.ptp(curve.angle, axis=1))
    assert np.all(curve.states.force[:, MIDDLE].max(axis=1) > 10)
    stiffness = np.diff(curve.torque[[MIDDLE, -1]]) / np.diff(curve.angle[:, [MIDDLE, -1]], axis=1)
    loose = backbone(small_drive(3), SHARES)
    assert np.all(stiffness > np.diff(loose.torque[[MIDDLE, -1]]) / np.diff(loose.angle[:, [MIDDLE, -1]], axis=1))


@pytest.mark.parametrize("distance", [0.01, 30])
def test_preload_that_is_sought_from_a_neighbour_is_that_of_the_drive_alone(distance):
    drive = small_drive(6, **PRELOADED["preloaded_by_10_um"])
    change = np.random.default_rng(3).uniform(-distance, distance, drive.gap.shape) * MICROMETRE
    neighbour = backbone(drive.with_added_gap(change), SHARES)
    alone, beside = backbone(drive, SHARES), backbone(drive, SHARES, neighbour)
    assert np.all(beside.states.converged)
    np.testing.assert_allclose(beside.angle, alone.angle, rtol=0, atol=1e-9 * np.ptp(alone.angle))
    np.testing.assert_allclose(beside.states.force, alone.states.force, rtol=0, atol=1e-8 * alone.states.force.max())
    if distance < 1:
        assert beside.limits.iterations.sum() < alone.limits.iterations.sum()


def test_shifted_drive_has_the_gaps_of_one_whose_shift_was_replaced():
    drive = small_drive(3, seed=4)
    gap_before, rng = drive.gap.copy(), np.random.default_rng(1)
    single_change, double_change = (rng.uniform(-5, 5, drive.gap.shape) * MICROMETRE for _ in range(2))
    variant = drive.with_added_gap(single_change).with_added_gap(double_change)
    rebuilt = replace(drive, shift=drive.shift + single_change + double_change)
    np.testing.assert_allclose(variant.shift, rebuilt.shift, atol=1e-16)
    np.testing.assert_allclose(variant.gap, rebuilt.gap, atol=1e-15)
    np.testing.assert_array_equal(drive.gap, gap_before)
    assert not np.any(drive.shift)
    error = {"eccentricity": np.array(3 * MICROMETRE)}  # the gaps of a change after it are found anew
    np.testing.assert_allclose(
        variant.with_added_errors(**error).gap, rebuilt.with_added_errors(**error).gap, atol=1e-15
    )
    assert np.max(np.abs(variant.with_added_errors(**error).gap - variant.gap)) > MICROMETRE


def test_first_is_the_drive_of_its_first_state():
    drive = replace(
        small_drive(4, seed=3),
        bearing_clearance=np.array([2.0, 0.0, 5.0, 1.0]) * MICROMETRE,
        elements=(LinearSpring(1e-8),),
    )
    drive = drive.with_added_gap(np.random.default_rng(2).uniform(0, 3, drive.gap.shape) * MICROMETRE)
    first_drive = drive.first_state
    np.testing.assert_allclose(first_drive.gap, drive.gap[:1], atol=1e-15)
    np.testing.assert_array_equal(first_drive.bearing_clearance, [2 * MICROMETRE])
    np.testing.assert_array_equal(first_drive.shift, drive.shift[:1])
    for name, values in vars(drive.errors).items():
        np.testing.assert_array_equal(getattr(first_drive.errors, name), values[:1])
    curve = backbone(drive, SHARES)
    np.testing.assert_allclose(backbone(first_drive, SHARES).angle, curve.angle[:1], atol=1e-12)
    assert np.max(np.abs(curve.angle[1:] - curve.angle[0])) > 1e-6


def difference(drive, contact, step):
    """Central difference of the angle (n, n_nodes) over the gap of one contact."""
    ends = []
    for sign in (1, -1):
        shift = drive.shift.copy()
        shift[:, contact] += sign * step
        ends.append(backbone(replace(drive, shift=shift), SHARES).angle)
    return (ends[0] - ends[1]) / (2 * step)


@pytest.mark.parametrize(
    ("bearing", "clearance"),
    [(LINEAR, 0.0), (LINEAR, 3 * MICROMETRE), (Bearing(4e6, 1.5), 0.0)],
    ids=["linear", "clearance", "hertzian"],
)
def test_influence_of_a_gap_is_the_difference_of_curves(bearing, clearance):
    drive = small_drive(2, seed=6, bearing=bearing, clearance=clearance)
    curve = backbone(drive, SHARES)
    influence, in_contact = curve.influence, curve.states.force > 0
    changes = np.any(in_contact[:, 1:] != in_contact[:, :-1], axis=2)
    smooth = np.broadcast_to(np.abs(curve.torque) > 0.05 * RATED, curve.angle.shape).copy()
    smooth[:, [0, -1]] = False  # where the slope is one-sided
    for sample, interval in zip(*np.nonzero(changes), strict=True):
        # the slope of a force that a contact just took over is steep: two nodes on either side are left out
        smooth[sample, max(interval - 2, 0) : interval + 4] = False
    assert np.all(smooth.sum(axis=1) > 30)
    for contact in np.argsort(-curve.states.force.max(axis=(0, 1)))[:8]:
        misfit = influence[..., contact] - difference(drive, contact, 1e-3 * MICROMETRE)
        assert np.max(np.abs(misfit[smooth])) < 3e-4 * np.abs(influence).max()


def test_influence_at_the_ends_of_play_is_that_of_the_first_pin():
    drive = small_drive(5, seed=6, scale=1 * MICROMETRE)
    curve, arm = backbone(drive, SHARES), drive.reducer.pins.arm
    for node, sense in ((MIDDLE, 1), (MIDDLE - 1, -1)):
        influence = curve.influence[:, node, : drive.reducer.n_pins]
        first_pin = np.argmax(np.abs(influence), axis=1)
        result = influence[np.arange(5), first_pin]
        np.testing.assert_allclose(result, sense / np.abs(arm[first_pin]), rtol=2e-3)
        np.testing.assert_allclose(np.abs(influence).sum(axis=1), np.abs(result), rtol=1e-2)


CHANGES = {
    "compliance": lambda drive: {"compliance": 1.001 * drive.compliance},
    "laws": lambda drive: {"laws": replace(drive.laws, linear=1.001 * drive.laws.linear)},
    "gaps": lambda drive: {"shift": drive.shift + np.linspace(-1e-6, 2e-6, drive.gap.shape[1])},
    "bearing": lambda drive: {"bearing": replace(drive.bearing, stiffness=0.999 * drive.bearing.stiffness)},
    "clearance": lambda drive: {"bearing_clearance": drive.bearing_clearance + 2e-6},
}


@pytest.mark.parametrize("name", CHANGES)
def test_small_change_of_springs_and_gaps_moves_the_curve_as_the_forces_say(name):
    drive = small_drive(3, seed=6, clearance=10 * MICROMETRE)
    base_unknowns = replace(drive, **CHANGES[name](drive), known_gap=None)
    shares = torque_levels(160, 1.05)  # the slope of the forces is taken over the nodes
    curve = backbone(drive, shares)
    truth = backbone(base_unknowns, shares).angle - curve.angle
    result = curve.change(base_unknowns)
    is_loaded = np.abs(curve.torque) > 0.02 * RATED
    assert np.max(np.abs(truth[:, is_loaded])) > 1e-10
    offset = np.abs(result - truth)[:, is_loaded] / np.max(np.abs(truth[:, is_loaded]))
    assert np.quantile(offset, 0.97) < 0.03
    assert np.max(offset) < 0.3  # where a contact closes between two nodes

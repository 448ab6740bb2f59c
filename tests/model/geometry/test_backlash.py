"""Rigid play: the separated form, the general program, an independent polygon program and closed forms."""

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import ARCMIN, PAPER, SMALL, reducer_at
from scipy.optimize import linprog

from pipeline.model.geometry.rigid_play.rigid_backlash import coupled_play, general_play, rigid_play, separated_play

PLATES = pytest.mark.parametrize("floats", [False, True], ids=["rotates", "floats"])
CRANK = 0.37


@pytest.fixture(autouse=True)
def _few_programs(monkeypatch):
    """A general program that goes on cutting for ever fails instead of hanging the tests."""
    program_counts = []

    def counted(*arguments, **options):
        program_counts.append(1)
        assert len(program_counts) < 1000, "the cuts of the bearing's disc do not end"
        return linprog(*arguments, **options)

    monkeypatch.setattr(scipy.optimize, "linprog", counted)


def random_gaps(reducer, n, seed, low=1e-3, high=12e-3):
    return np.random.default_rng(seed).uniform(low, high, (n, len(reducer.contacts)))


def parts(reducer):
    """Contacts of each part of the chain: the pins, and the two slides."""
    return [reducer.contacts.interface == number for number in (-1, 0, 1)]


def penetration(reducer, gap, pose):
    return (pose @ reducer.contact_jacobian.T - gap).max(axis=1)


@PLATES
@pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
def test_separated_form_is_the_general_program(profile, floats):
    reducer = reducer_at(profile, CRANK, floats=floats)
    gap = random_gaps(reducer, 25, 1)
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, np.zeros(len(gap)))
    np.testing.assert_allclose(separated.backlash, general.backlash, rtol=1e-9)
    np.testing.assert_array_equal(separated.overlap, 0)
    np.testing.assert_array_equal(general.overlap, 0)
    assert not separated.preloaded.any()
    assert np.all(separated.backlash > 0)


@PLATES
@pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
def test_overlap_of_interfering_gaps_is_the_general_programs(profile, floats):
    reducer = reducer_at(profile, CRANK, floats=floats)
    gap = random_gaps(reducer, 30, 2, low=-4e-3, high=4e-3)
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, np.zeros(len(gap)))
    assert np.count_nonzero(general.preloaded) > 20
    np.testing.assert_array_equal(separated.preloaded, general.preloaded)
    np.testing.assert_allclose(separated.overlap, general.overlap, rtol=1e-9, atol=1e-14)
    tight = general.preloaded
    np.testing.assert_array_equal(general.backlash[tight], 0)
    for play in (separated, general):
        for pose in (play.pose_plus, play.pose_minus):
            np.testing.assert_allclose(penetration(reducer, gap, pose)[tight], play.overlap[tight], rtol=1e-6)


@PLATES
@pytest.mark.parametrize("tight", [0, 1, 2])
def test_an_interfering_part_leaves_the_play_of_the_others(floats, tight):
    reducer = reducer_at(SMALL, CRANK, floats=floats)
    gap = random_gaps(reducer, 20, 3)
    isolated = []
    for part in parts(reducer):
        isolated.append(
            separated_play(reducer, gap).backlash - separated_play(reducer, np.where(part, 0.0, gap)).backlash
        )
    closing_values = gap - np.where(parts(reducer)[tight], 15e-3, 0.0)
    play = separated_play(reducer, closing_values)
    assert play.preloaded.all()
    np.testing.assert_allclose(play.backlash, sum(isolated) - isolated[tight], rtol=1e-9)


@PLATES
def test_both_ends_are_reached_and_penetrate_nothing(floats):
    reducer = reducer_at(PAPER, CRANK, floats=floats)
    gap = random_gaps(reducer, 10, 4)
    clearance = np.array([0.0, 3e-3] * 5)
    play = rigid_play(reducer, gap, clearance)
    for pose in (play.pose_plus, play.pose_minus):
        np.testing.assert_allclose(penetration(reducer, gap, pose), 0, atol=1e-12)
        reach = np.hypot(pose[:, 0], pose[:, 1])
        assert np.all(reach <= clearance * (1 + 1e-9) + 1e-12)  # the program's own tolerance, in mm
        assert np.all(reach[clearance > 0] > 1e-6)
    assert np.all(play.pose_plus[:, reducer.output_motion] > play.pose_minus[:, reducer.output_motion])


def test_play_of_equal_gaps_is_the_gap_over_the_longest_arms():
    reducer = reducer_at(SMALL, CRANK)
    pins, slide = reducer.pins.arm, 4.5
    expected = 5e-3 * (1 / pins.max() - 1 / pins.min() + 2 * 2 / slide)
    assert separated_play(reducer, np.full((1, len(reducer.contacts)), 5e-3)).backlash[0] == pytest.approx(
        expected, rel=1e-12
    )
    floating = reducer_at(SMALL, CRANK, floats=True)
    assert separated_play(floating, np.full((1, len(reducer.contacts)), 5e-3)).backlash[0] == pytest.approx(
        expected, rel=1e-12
    )


def test_a_floating_plate_shifts_out_of_the_way_of_one_face():
    """Gaps on one face only: the tongue shifts by half of them, so both faces let it turn; a fixed one cannot turn."""
    gap = np.zeros((1, len(reducer_at(SMALL, CRANK).contacts)))
    for floats, expected in ((False, 0.0), (True, 2 * 4e-3 / (2 * 4.5))):
        reducer = reducer_at(SMALL, CRANK, floats=floats)
        gap[:] = np.where((reducer.contacts.interface == 1) & (reducer.contacts.face == 0), 4e-3, 0.0)
        assert separated_play(reducer, gap).backlash[0] == pytest.approx(expected, rel=1e-12, abs=1e-18)


def polygon_backlash(reducer, gap, clearance, sides, factor):
    """Independent program in the relative scale of um: the disc replaced by a polygon of ``factor`` its apothem."""
    angle = 2 * np.pi * np.arange(sides) / sides
    walls = np.zeros((sides, len(reducer.motions)))
    walls[:, 0], walls[:, 1] = np.cos(angle), np.sin(angle)
    rows = np.vstack([reducer.contact_jacobian, walls])
    limits = 1e3 * np.append(gap, np.full(sides, factor * clearance))
    ends = []
    for sense in (1, -1):
        objective = np.zeros(len(reducer.motions))
        objective[reducer.output_motion] = -sense
        ends.append(-linprog(objective, rows, limits, bounds=(None, None), method="highs").fun)
    return sum(ends) / 1e3


@PLATES
def test_a_bearing_clearance_is_a_disc(floats):
    """The play lies between those of the polygons inside and around the disc, which differ by 2e-5 in size."""
    reducer, sides = reducer_at(SMALL, CRANK, floats=floats), 720
    for gap, clearance in zip(random_gaps(reducer, 4, 5), [1e-3, 3e-3, 10e-3, 1.0], strict=True):
        play = general_play(reducer, gap[None], np.array([clearance])).backlash[0]
        inner_play = polygon_backlash(reducer, gap, clearance, sides, np.cos(np.pi / sides))
        circumference = polygon_backlash(reducer, gap, clearance, sides, 1.0)
        assert inner_play * (1 - 1e-9) <= play <= circumference * (1 + 1e-9)
        assert play > separated_play(reducer, gap[None]).backlash[0]


@PLATES
def test_play_rises_steadily_with_the_bearing_clearance_from_that_of_a_tight_bearing(floats):
    reducer = reducer_at(SMALL, CRANK, floats=floats)
    gap = np.repeat(random_gaps(reducer, 1, 6), 8, axis=0)
    clearance = np.array([0.0, 1e-10, 1e-7, 1e-5, 1e-4, 1e-3, 3e-3, 10e-3])  # [mm]: well below a nanometre too
    play = rigid_play(reducer, gap, clearance)
    assert np.all(np.diff(play.backlash) > 0)
    assert play.backlash[1] == pytest.approx(play.backlash[0], rel=1e-6)
    assert np.all(
        np.hypot(play.pose_plus[:, 0], play.pose_plus[:, 1]) <= clearance * (1 + 1e-9) + 1e-12
    )  # the program's own tolerance, in mm


def test_a_bearing_clearance_relieves_an_interference():
    reducer = reducer_at(SMALL, CRANK, floats=True)
    gap = np.full((1, len(reducer.contacts)), 1e-3)
    gap[0, : SMALL.pins] += 5e-3 * np.real(reducer.pins.normal)  # the disk sits 5 um off along x: it would fit there
    assert separated_play(reducer, gap).preloaded[0]
    play = general_play(reducer, gap, np.array([6e-3]))
    assert not play.preloaded[0]
    assert play.backlash[0] > 0
    play_small = general_play(reducer, gap, np.array([1e-3]))
    assert play_small.preloaded[0]
    assert 0 < play_small.overlap[0] < separated_play(reducer, gap).overlap[0]


@PLATES
def test_an_interference_that_the_disk_cannot_relieve_takes_few_programs(floats, monkeypatch):
    """Between plate and output the disk's centre decides nothing: each of its places within the clearance is optimal.

    The tangents alone lead from corner to corner of their polygon, more than a thousand times with 5 pins.
    """
    reducer, calls = reducer_at(SMALL, CRANK, floats=floats), []

    def counted(*arguments, **options):
        calls.append(1)
        return linprog(*arguments, **options)

    monkeypatch.setattr(scipy.optimize, "linprog", counted)
    for seed, clearance in enumerate([0.3e-3, 3e-3, 30e-3]):
        gap = random_gaps(reducer, 1, seed) - np.where(parts(reducer)[2], 20e-3, 0.0)
        play = general_play(reducer, gap, np.array([clearance]))
        assert play.overlap[0] == pytest.approx(separated_play(reducer, gap).overlap[0], rel=1e-9)
        assert penetration(reducer, gap, play.pose_plus)[0] == pytest.approx(play.overlap[0], rel=1e-9)
        assert np.hypot(*play.pose_plus[0, :2]) <= clearance * (1 + 1e-9) + 1e-12
    assert len(calls) < 3 * 60


@PLATES
@pytest.mark.parametrize("tight", [None, 0, 1, 2])
@pytest.mark.long
def test_compiled_programs_of_loose_bearings_are_those_of_highs(floats, tight):
    """Interference (``tight``) that the disk can relieve or not, and discs from far below the gaps to beyond them."""
    reducer = reducer_at(SMALL, CRANK, floats=floats)
    gap = random_gaps(reducer, 12, 9) - (0.0 if tight is None else np.where(parts(reducer)[tight], 8e-3, 0.0))
    clearance = np.geomspace(1e-7, 50e-3, 12)
    play, expected = coupled_play(reducer, gap, clearance[:, None]), general_play(reducer, gap, clearance)
    np.testing.assert_array_equal(play.preloaded, expected.preloaded)
    np.testing.assert_allclose(play.overlap, expected.overlap, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(play.backlash, expected.backlash, rtol=1e-8, atol=1e-14)
    for pose in (play.pose_plus, play.pose_minus):
        np.testing.assert_allclose(penetration(reducer, gap, pose)[play.preloaded], play.overlap[play.preloaded])
        assert np.all(penetration(reducer, gap, pose) <= play.overlap + 1e-12)
        assert np.all(np.hypot(pose[:, 0], pose[:, 1]) <= clearance * (1 + 1e-9) + 1e-12)


def test_samples_with_and_without_bearing_clearance_are_solved_each_in_its_own_way():
    reducer = reducer_at(SMALL, CRANK, floats=True)
    gap, clearance = random_gaps(reducer, 6, 7, low=-1e-3), np.array([0.0, 2e-3, 0.0, 4e-3, 1e-3, 0.0])
    combined = rigid_play(reducer, gap, clearance)
    for sample in range(6):
        isolated = rigid_play(reducer, gap[sample : sample + 1], clearance[sample : sample + 1])
        for name in ("pose_plus", "pose_minus", "overlap"):
            np.testing.assert_array_equal(getattr(combined, name)[sample], getattr(isolated, name)[0])
    loose = clearance > 0
    np.testing.assert_array_equal(combined.backlash[~loose], separated_play(reducer, gap).backlash[~loose])
    np.testing.assert_allclose(
        combined.backlash[loose], general_play(reducer, gap[loose], clearance[loose]).backlash, rtol=1e-9
    )


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), contact=st.integers(0, 27), increment=st.floats(0, 10e-3), floats=st.booleans())
def test_play_grows_with_every_gap_and_scales_with_all_of_them(seed, contact, increment, floats):
    reducer = reducer_at(SMALL, CRANK, floats=floats)
    gap = random_gaps(reducer, 1, seed, low=-2e-3)
    play = separated_play(reducer, gap)
    scaled = separated_play(reducer, 3.5 * gap)
    np.testing.assert_allclose(scaled.backlash, 3.5 * play.backlash, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(scaled.overlap, 3.5 * play.overlap, rtol=1e-9, atol=1e-18)
    wider = gap.copy()
    wider[0, contact] += increment
    assert separated_play(reducer, wider).backlash[0] >= play.backlash[0] - 1e-15
    assert separated_play(reducer, wider).overlap[0] <= play.overlap[0] + 1e-15


def test_zero_gaps_leave_no_play():
    for floats in (False, True):
        reducer = reducer_at(PAPER, CRANK, floats=floats)
        play = separated_play(reducer, np.zeros((1, len(reducer.contacts))))
        assert ARCMIN * play.backlash[0] == 0
        assert not play.preloaded[0]

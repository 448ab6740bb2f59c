"""Rows at rest before the first load of a position, and rows within the play."""

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, UNIT, loop, measured, path_of, write_unit

from pipeline.identification.fitting.measured_loops import readings
from pipeline.identification.measurement import row_filters
from pipeline.identification.measurement.enough import SURE
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit

NOISE = 0.1  # [N m], declared
DECLARED = UNIT + f"[instrument]\ntorque_noise_Nm = {NOISE}\n"
STEP = 0.15  # [N m] from row to row


def read(folder, table, text=DECLARED):
    unit = load_measured_unit(write_unit(folder / "u", {"rows.csv": table}, text), ROOT)
    return Measurement.read(unit)


def at_rest(measurement):
    """Rows before the first load."""
    return row_filters.at_rest(measurement.rows, measurement.smallest_torque)


def cycle(start=0.0, number=0, crank=0.0):
    """A cycle from a torque to 6, -6 and 0 N m in steps of ``STEP``."""
    turns = [start, 6.0, -6.0, 0.0]
    legs = [np.arange(a, b, np.sign(b - a) * STEP) for a, b in zip(turns[:-1], turns[1:], strict=True)]
    torque = np.concatenate(legs)
    return pd.DataFrame({"cycle": number, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": loop(torque)})


@pytest.mark.parametrize("sense", [1, -1])
def test_rows_within_four_deviations_of_no_torque_at_the_start_are_not_usable(tmp_path, sense):
    table = pd.concat([cycle(0.0, number, crank) for crank in (0.0, 90.0) for number in (0, 1)], ignore_index=True)
    table[["torque_Nm", "angle_arcmin"]] *= sense
    measurement = read(tmp_path, table)
    expected = np.zeros(len(table), bool)
    for start in (0, len(table) // 2):
        expected[start : start + 3] = True  # 0, 0.15, 0.30, and not 0.45 N m
    np.testing.assert_array_equal(at_rest(measurement), expected)
    np.testing.assert_array_equal(measurement.usable, ~expected)
    is_later = (np.abs(measurement.rows.torque) < SURE * NOISE) & ~expected
    assert is_later.sum() > 20  # passes through zero that stay


def test_a_position_that_starts_loaded_loses_no_row(tmp_path):
    table = pd.concat([cycle(0.45), cycle(0.0, 1), cycle(-3.0, crank=90.0), cycle(0.0, 1, 90.0)], ignore_index=True)
    measurement = read(tmp_path, table)
    assert not at_rest(measurement).any()
    assert measurement.usable.all()


def test_the_digit_of_the_torque_adds_to_its_noise(tmp_path):
    measurement = read(tmp_path, cycle(), DECLARED + "torque_resolution_Nm = 0.4\n")
    assert np.flatnonzero(at_rest(measurement)).tolist() == [0, 1, 2, 3, 4, 5]  # up to 0.75 of 0.8 N m


def test_a_hold_before_the_load_is_left_out_by_the_scatter_of_its_torque(tmp_path):
    hold, rng = 300, np.random.default_rng(4)
    torque = np.concatenate([np.zeros(hold), path_of([0.0, 12.0, -12.0, 0.0], 200)])
    table = pd.DataFrame({"cycle": 0, "crank_deg": 0.0, "angle_arcmin": loop(torque)})
    table["torque_Nm"] = torque + 0.02 * rng.standard_normal(torque.size)
    measurement = read(tmp_path, table, UNIT)
    result = np.flatnonzero(at_rest(measurement))
    assert result.tolist() == list(range(len(result)))
    assert hold <= len(result) <= hold + 3  # 0.08 N m are less than two steps of the ramp


def test_without_noise_only_rows_of_no_torque_at_all_are_at_rest(tmp_path):
    table = measured()
    measurement = read(tmp_path, table, UNIT)
    np.testing.assert_array_equal(at_rest(measurement), ~table.duplicated("crank_deg"))


def staircase(levels, held, noise=0.05, seed=0):
    """Three cycles of torques that are held, each over some rows with noise [N m]."""
    torque = np.repeat(np.concatenate([levels, *[levels[-2::-1], levels[1:]] * 2, levels[-2::-1]]), held)
    read = torque + noise * np.random.default_rng(seed).standard_normal(len(torque))
    number = np.arange(len(torque)) // (2 * held * (len(levels) - 1) + 1)
    return torque, pd.DataFrame({"cycle": number, "crank_deg": 0.0, "torque_Nm": read, "angle_arcmin": loop(torque)})


@pytest.mark.parametrize("held", [1, 2, 6])
def test_rows_held_at_no_torque_are_not_usable(tmp_path, held):
    torque, table = staircase(np.linspace(-6.0, 6.0, 13), held)
    measurement = read(tmp_path, table)
    np.testing.assert_array_equal(measurement.usable, torque != 0)
    assert np.sum(torque == 0) == 6 * held


def held_on_its_side(levels, held):
    """A staircase of a drive that stays on its side of a play of 2 arcmin without torque."""
    torque, table = staircase(levels, held)
    side = pd.Series(np.where(torque, np.sign(torque), np.nan)).ffill()
    return torque, table.assign(angle_arcmin=0.25 * torque + side)


@pytest.mark.parametrize(("rising", "falling"), [(0.7, 0.7), (-0.7, -0.7), (-0.7, 0.7)])
def test_rows_held_at_no_torque_are_not_usable_if_the_sensor_reads_another_torque(tmp_path, rising, falling):
    """A row on the old side of the play, read as 0.7 N m, kept a creep of the sensor below half of the one put in."""
    torque, table = held_on_its_side(np.linspace(-12.0, 12.0, 7), 4)
    is_rising = pd.Series(np.sign(np.diff(torque, append=-8.0))).replace(0.0, np.nan).bfill() > 0
    error = np.where(is_rising, rising, falling)
    measurement = read(tmp_path, table.assign(torque_Nm=table["torque_Nm"] + error))
    np.testing.assert_array_equal(measurement.usable, torque != 0)


def test_rows_at_no_torque_at_the_end_of_a_cycle_are_not_usable_if_the_sensor_creeps(tmp_path):
    """Each cycle begins with the first load after them; a coulomb friction was named for such rows beside the creep."""
    up = np.array([4.0, 8.0, 12.0, 8.0, 4.0, 0.0])
    torque = np.tile(np.repeat(np.concatenate([up, -up]), 4), 3)
    side = pd.Series(np.where(torque, np.sign(torque), np.nan)).ffill()
    creep = 0.7 * side * (np.abs(torque) < 12)
    angle, number = 0.25 * torque + side, np.repeat(np.arange(3), 48)
    table = pd.DataFrame({"cycle": number, "crank_deg": 0.0, "torque_Nm": torque + creep, "angle_arcmin": angle})
    np.testing.assert_array_equal(read(tmp_path, table).usable, torque != 0)


def test_steps_that_are_all_loaded_stay_if_the_sensor_reads_another_torque(tmp_path):
    """Also where the sensor of another position reads 2 N m more: its last row in one sense is ours in the other."""
    _, table = held_on_its_side(np.linspace(-7.0, 7.0, 8), 4)
    other = table.assign(crank_deg=90.0, torque_Nm=table["torque_Nm"] + 2.0)
    both = pd.concat([table.assign(torque_Nm=table["torque_Nm"] + 0.5), other.assign(crank_deg=90.0)])
    assert read(tmp_path, both).usable.all()


def test_the_first_load_of_a_position_shows_no_play(tmp_path):
    """From 1 to 3 N m the angle rises most on the way from no torque; the play is crossed from 1 to -1 N m."""
    levels = np.arange(1.0, 8.0, 2.0)
    torque = np.repeat(np.concatenate([levels, levels[-2::-1], -levels, -levels[-2::-1], levels]), 4)
    angle = torque / 4 + np.sign(torque)
    table = pd.DataFrame({"cycle": 0, "crank_deg": 0.0, "torque_Nm": torque, "angle_arcmin": angle})
    assert read(tmp_path, table).usable.all()


def test_a_single_row_at_no_torque_is_left_out_if_the_sensor_reads_another_torque(tmp_path):
    """Friction of 0.05 N m was named for such rows, beside a zero of 15 N m."""
    torque, table = held_on_its_side(np.linspace(-6.0, 6.0, 13), 1)
    usable = read(tmp_path, table.assign(torque_Nm=table["torque_Nm"] + 0.7)).usable
    np.testing.assert_array_equal(usable, torque != 0)


def test_a_hold_beside_no_torque_and_a_sweep_through_it_stay(tmp_path):
    torque, table = staircase(np.linspace(-6.5, 6.5, 14), 4)
    assert np.min(np.abs(torque)) > SURE * NOISE
    assert read(tmp_path / "held", table).usable.all()
    sweeps = pd.concat([cycle(0.45, number) for number in range(3)], ignore_index=True)
    assert read(tmp_path / "swept", sweeps).usable.all()


@pytest.mark.parametrize("levels", [(4.0, 8.0, 12.0), (6.0, 12.0)])
def test_repeats_of_a_coarse_staircase_are_not_compared_across_the_play(tmp_path, levels):
    """A play of two thirds of the range lies between two levels; one cycle in three has levels of its own."""
    rng, parts = np.random.default_rng(5), []
    for number, steps in enumerate([(4.0, 8.0, 12.0), levels, (4.0, 8.0, 12.0)]):
        up = np.array(steps)
        cycle = np.concatenate([up, up[-2::-1], [0.0], -up, -up[-2::-1], [0.0]])
        torque = np.repeat(cycle, 8)
        angle = 0.05 * torque + 2.0 * np.sign(torque) + 0.01 * rng.standard_normal(len(torque))
        reading = torque + 0.05 * rng.standard_normal(len(torque))
        parts.append(pd.DataFrame({"cycle": number, "crank_deg": 0.0, "torque_Nm": reading, "angle_arcmin": angle}))
    measurement = read(tmp_path, pd.concat(parts, ignore_index=True), UNIT)
    assert measurement.repeatability.floor.value == pytest.approx(0.01, rel=0.25)


PLAY, STIFFNESS = 2.0, 4.0
"""Play [arcmin], and stiffness [N m/arcmin] on both sides of it."""


def turned_steadily(friction=0.0, noise=0.05, softness=0.0, seed=0, per_branch=40):
    """Three cycles on a bench that turns the output at a constant speed; the rows in the play.

    The torque follows the angle. ``softness`` is the stiffness within the play, as a share of that beyond it.
    """
    angle = path_of([0.0, 3.0, -3.0, 3.0, -3.0, 3.0, -3.0, 0.0], per_branch)
    beyond = angle - np.clip(angle, -PLAY / 2, PLAY / 2)
    is_in_play = np.abs(angle) < PLAY / 2
    torque = STIFFNESS * (beyond + softness * np.clip(angle, -PLAY / 2, PLAY / 2))
    torque += friction * np.sign(np.gradient(angle)) + noise * np.random.default_rng(seed).standard_normal(len(angle))
    number = np.minimum(np.arange(len(angle)) // (2 * per_branch), 2)
    table = pd.DataFrame({"cycle": number, "crank_deg": 0.0, "torque_Nm": torque, "angle_arcmin": angle})
    return table, is_in_play


def test_the_sensor_is_followed_over_the_rows_within_the_play_too(tmp_path):
    table, _ = turned_steadily()
    measurement = read(tmp_path, table.assign(time_s=np.arange(len(table), dtype=float)))
    times, torques = readings(measurement, 0)
    assert measurement.is_in_play.sum() > 50
    np.testing.assert_array_equal(times, np.flatnonzero(measurement.is_readable))
    np.testing.assert_array_equal(torques, measurement.rows.torque[measurement.is_readable])
    assert readings(read(tmp_path / "untimed", table), 0) is None


def test_the_loaded_rows_of_a_coarse_record_stay(tmp_path):
    """16 rows a branch, of which 5 are within the play and 6 on each side."""
    table, is_in_play = turned_steadily(per_branch=16)
    measurement = read(tmp_path, table)
    is_loaded = np.abs(measurement.rows.torque) > 0.3 * np.max(measurement.rows.torque)
    assert np.all(measurement.usable[is_loaded])
    assert np.mean(measurement.usable[is_in_play]) < 0.5  # those at both ends stay: at no torque they tell little


def test_the_play_says_nothing_of_a_drive_whose_crank_turns_either(tmp_path):
    """Rows held at no torque by a motor made an empty unit miss by 5 times the noise."""
    table, is_in_play = turned_steadily()
    turning = UNIT.replace('locked = "input"', 'locked = "output"')
    crank = '[crank]\nmoves = "follows_angle"\nratio = -79.0\n'
    measurement = read(tmp_path, table, f"{turning}{crank}[instrument]\ntorque_noise_Nm = {NOISE}\n")
    assert np.mean(measurement.is_in_play[is_in_play & (np.arange(len(table)) > 40)]) > 0.98


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_rows_within_the_play_are_not_usable_and_no_others_are_lost(tmp_path, friction):
    table, is_in_play = turned_steadily(friction)
    measurement = read(tmp_path, table)
    is_later = np.arange(len(table)) > 40  # before that it is not known where the record began
    assert np.mean(measurement.is_in_play[is_in_play & is_later]) > 0.98
    step = 3.0 / 40
    is_beyond = np.abs(measurement.rows.angle) > PLAY / 2 + 2.5 * step
    assert not np.any(measurement.is_in_play & is_beyond)
    np.testing.assert_array_equal(measurement.usable[is_beyond], measurement.is_readable[is_beyond])


def test_no_row_of_a_cycle_that_ends_within_the_play_is_usable(tmp_path):
    table, is_in_play = turned_steadily(noise=0.3)
    number = np.minimum((np.arange(len(table)) + 62) // 80, 3)  # two of its ends lie within the play
    measurement = read(tmp_path, table.assign(cycle=number))
    is_beside_end = is_in_play & (np.abs(np.gradient(number)) > 0)
    assert is_beside_end.sum() >= 4
    assert not np.any(measurement.usable & is_beside_end)


def test_a_bench_that_sets_the_torque_has_no_rows_within_the_play(tmp_path):
    """The drive may well be steep beside the play, where its contacts only just carry."""
    table = pd.concat([cycle(0.0, number) for number in range(3)], ignore_index=True)
    assert not read(tmp_path / "coarse", table).is_in_play.any()
    torque = path_of([0.0, *[12.0, -12.0] * 3, 0.0], 400) + 0.01  # no row is at no torque
    angle = np.sign(torque) * (0.7 + np.abs(torque) ** (1 / 3))  # as of a point contact, six tenths are the play
    cycles = np.minimum(np.arange(len(torque)) // 800, 2)
    fine = pd.DataFrame({"cycle": cycles, "crank_deg": 0.0, "torque_Nm": torque, "angle_arcmin": angle})
    assert not read(tmp_path / "fine", fine).is_in_play.any()


def test_a_play_that_gives_way_under_a_fifth_of_the_stiffness_is_part_of_the_curve(tmp_path):
    table, _ = turned_steadily(softness=0.2)
    assert not read(tmp_path, table).is_in_play.any()


def test_the_play_of_a_drive_without_a_design_is_a_knee_whose_rows_count(tmp_path):
    table, _ = turned_steadily()
    generic = UNIT
    for line in ('design = "pham2017"\n', 'study = "quick"\n', 'as_measured = "unknown"\n'):
        generic = generic.replace(line, "")
    text = f"{generic}[generic]\nratio = 49.0\nrated_torque_Nm = 20.0\n[instrument]\ntorque_noise_Nm = {NOISE}\n"
    measurement = read(tmp_path, table, text)
    assert measurement.unit.design_study is None
    assert not measurement.is_in_play.any()


@pytest.mark.parametrize(("width", "is_left_out"), [(1, True), (2, True), (3, True), (4, False)])
def test_outliers_of_up_to_three_rows_are_left_out(tmp_path, width, is_left_out):
    table = measured()
    table.loc[99 : 98 + width, "angle_arcmin"] += 40.0
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": table}), ROOT))
    assert np.flatnonzero(measurement.spikes).tolist() == (list(range(99, 99 + width)) if is_left_out else [])


@pytest.mark.parametrize(
    "course",
    [
        (30.0,),
        (-98.0, -47.0, 3.0, 17.5, 5.6, -0.3),  # the printed drive, arcmin beyond the level on which it then stays
        (-56.7, -2.0, 20.8, 10.2, -0.7),
        (32.0, 4.0, -9.0, 9.8, 14.4, 10.8),
    ],
)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_overshoot_of_a_drive_that_lands_is_no_outlier(tmp_path, sense, course):
    """A fast crossing of the play: rows beyond the level on which the drive then stays, one back at the row before."""
    table = measured()
    table.loc[99:, "angle_arcmin"] += 130.0 * sense
    table.loc[99 : 98 + len(course), "angle_arcmin"] += sense * np.array(course)
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": table}), ROOT))
    assert not measurement.spikes[:200].any()


def test_two_outliers_beside_a_good_row_are_left_out(tmp_path):
    table = measured()
    table.loc[[99, 101], "angle_arcmin"] += 40.0
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": table}), ROOT))
    assert measurement.spikes[[99, 101]].all()
    assert np.flatnonzero(measurement.spikes).size <= 3


def test_the_loops_of_the_printed_drive_have_no_outlier():
    """Twenty rows on which it overshoots behind the play were taken for jumps of the encoder."""
    assert not Measurement.read(load_measured_unit("base_pccf_runin", ROOT)).spikes.any()

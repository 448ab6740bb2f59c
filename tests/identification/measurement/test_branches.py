"""Branches, cells and turning torques of cycles that start and turn anywhere."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_bench import ROOT, UNIT, loop, measured, path_of, write_unit

from pipeline.identification.fitting.measured_loops import followed_torques
from pipeline.identification.measurement.branches import turning_points
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit


def taken(folder, table, text=UNIT):
    unit = load_measured_unit(write_unit(folder / "u", {"rows.csv": table}, text), ROOT)
    return Measurement.read(unit)


def path_table(turns, per_branch=60, noise=0.0, seed=0):
    torque = path_of(turns, per_branch)
    measured_torque = torque + noise * np.random.default_rng(seed).standard_normal(torque.size)
    return pd.DataFrame({"cycle": 0, "crank_deg": 0.0, "torque_Nm": measured_torque, "angle_arcmin": loop(torque)})


@st.composite
def turns(draw):
    """Turning torques that rise and fall in turn by at least a fifth of the range."""
    size = draw(st.integers(1, 6))
    steps = draw(st.lists(st.floats(2.5, 10.0), min_size=size, max_size=size))
    sense = draw(st.sampled_from([1, -1]))
    start = draw(st.floats(-3, 3))
    return [start, *(start + np.cumsum([sense * (-1) ** i * step for i, step in enumerate(steps)])).tolist()]


@given(turns(), st.integers(20, 60))
def test_turning_points_are_those_of_the_path(expected, per_branch):
    result = turning_points(path_of(expected, per_branch), 0.05 * np.ptp(expected))
    assert result.tolist() == [i * per_branch for i in range(len(expected))]


@given(turns(), st.integers(0, 100))
@settings(max_examples=30)
def test_noise_makes_no_turns(expected, seed):
    path = path_of(expected, 50)
    noisy = path + np.clip(0.05 * np.random.default_rng(seed).standard_normal(path.size), -0.15, 0.15)
    assert len(turning_points(noisy, 0.4)) == len(expected)


def test_of_equal_extremes_the_last_turns():
    assert turning_points(np.array([0, 1, 2, 2, 2, 1, 0.0]), 0.5).tolist() == [0, 4, 6]


def test_a_cycle_with_a_minor_loop(tmp_path):
    table = path_table([2.0, 12.0, 4.0, 9.0, -12.0, 1.0])
    measurement = taken(tmp_path, table)
    assert measurement.branches.direction.tolist() == [1, -1, 1, -1, 1]
    assert measurement.branches.branch.tolist() == [0, 1, 2, 3, 4]
    assert measurement.branches.start.tolist() == [0, 61, 121, 181, 241]
    assert measurement.branches.stop.tolist() == [61, 121, 181, 241, 301]
    steps = measurement.history
    np.testing.assert_allclose(steps.torque[0], [2, 12, 4, 9, -12, 1], atol=0.3)
    assert steps.leg.tolist() == [0, 1, 2, 3, 4]


def test_history_goes_on_over_cycles(tmp_path):
    measurement = taken(tmp_path, measured((0.0,), 2))
    steps = measurement.history
    np.testing.assert_allclose(steps.torque[0], [0, 12, -12, 12, -12, 0], atol=0.3)
    assert steps.leg.tolist() == [0, 1, 2, 2, 3, 4]


def test_history_through_a_bench_that_unloads_between_cycles(tmp_path):
    table = pd.concat([path_table([0, 12, -12, 12]), path_table([0, 12, -12, 12]).assign(cycle=1)])
    measurement = taken(tmp_path, table)
    np.testing.assert_allclose(measurement.history.torque[0], [0, 12, -12, 12, 0, 12, -12, 12], atol=0.3)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_cells_follow_the_curve_without_bias(tmp_path, noise):
    table = path_table([0.0, 12.0, -12.0, 0.0], per_branch=2000, noise=noise)
    table["angle_arcmin"] = 0.2 * path_of([0.0, 12.0, -12.0, 0.0], 2000)
    measurement = taken(tmp_path, table)
    taken_cells = measurement.cells
    assert np.all(taken_cells.count >= 3)
    assert np.all(np.diff(taken_cells.first_row) > 0)
    assert np.bincount(taken_cells.block).tolist() == [16, 48, 24]  # none before a fifth of the load at first
    np.testing.assert_allclose(taken_cells.angle_mean, 0.2 * taken_cells.torque_mean, atol=0.02 + 0.02 * (noise > 0))
    narrow = np.abs(taken_cells.torque_mean) < 2
    assert np.median(taken_cells.count[narrow]) < np.median(taken_cells.count[~narrow])


@pytest.mark.parametrize(("start", "lost"), [(0.0, 400), (-2.0, 629), (-2.5, 0), (12.0, 0)])
def test_the_first_branch_has_no_cells_before_the_load_decides_where_friction_holds(start, lost, tmp_path):
    """A fifth of 12 N m is 2.4 N m; other branches have cells at all torques, and the load history is whole."""
    end = 12.0 if start < 12.0 else -12.0
    measurement = taken(tmp_path, path_table([start, end, -end], per_branch=2000))
    first_row = measurement.cells.first_row[0]
    assert first_row == pytest.approx(lost, abs=2)
    assert measurement.cells.count.sum() == len(measurement.rows) - first_row
    assert measurement.history.torque[0][0] == pytest.approx(start, abs=0.02)


def test_a_first_branch_that_is_never_loaded_keeps_its_cells(tmp_path):
    measurement = taken(tmp_path, path_table([-2.0, 2.0, -12.0, 12.0], 60))
    assert measurement.cells.first_row[0] == 0


def test_cells_have_three_rows_but_not_across_the_play(tmp_path):
    measurement = taken(tmp_path, path_table([-12.0, 12.0, -12.0], per_branch=160))
    taken_cells = measurement.cells
    assert np.all(taken_cells.count >= 3)
    last_value = np.append(taken_cells.first_row[1:], len(measurement.rows)) - 1
    assert np.all(measurement.rows.torque[taken_cells.first_row] * measurement.rows.torque[last_value] > -1e-9)


@pytest.mark.parametrize(("per_branch", "rows_of_cell"), [(31, 1), (140, 1), (141, 3)])
def test_each_row_is_a_cell_where_a_branch_has_fewer_than_three_for_each_interval(per_branch, rows_of_cell, tmp_path):
    """The first rows after a turn show friction. A jump through the play between two rows is no noise."""
    table = path_table([-12.0, 12.0, -12.0, 12.0], per_branch=per_branch).iloc[1:]
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(table))
    table["angle_arcmin"] = 0.5 * table["torque_Nm"] + 2.0 * np.sign(table["torque_Nm"] - 0.01) + noise
    measurement = taken(tmp_path, table)
    cells = measurement.cells
    assert cells.count.min() == rows_of_cell
    assert measurement.repeatability.floor.value == pytest.approx(0.02 / np.sqrt(np.median(cells.count)), rel=0.3)
    if rows_of_cell == 1:
        np.testing.assert_array_equal(cells.torque_mean, table["torque_Nm"][np.abs(table["torque_Nm"]) > 1e-9])
        followed, noise = followed_torques(measurement), measurement.torque_noise
        np.testing.assert_allclose(np.median(np.std(followed, axis=1)), noise * np.sqrt(0.96), rtol=1e-6, atol=1e-12)
        is_inner = np.abs(cells.torque_mean) < 11.5
        np.testing.assert_allclose(followed[is_inner].mean(axis=1), cells.torque_mean[is_inner], atol=1e-9)
        assert np.all(np.abs(followed) <= np.max(np.abs(measurement.history.torque[0])) + 1e-9)


def test_a_row_beside_the_play_is_expected_between_both_sides_as_its_torque_may_be(tmp_path):
    """At the torque of the jump itself half of the way, and none of it two standard deviations away."""
    table = path_table([-12.0, 12.0, -12.0, 12.0], per_branch=61, noise=0.2)
    measurement = taken(tmp_path, table)
    followed, noise = followed_torques(measurement), measurement.torque_noise
    assert noise == pytest.approx(0.2, rel=0.3)
    for jump in np.arange(-6.0, 6.0, 0.1):
        distance = (measurement.cells.torque_mean - jump) / noise
        share = np.mean(followed > jump, axis=1)
        np.testing.assert_allclose(share, np.clip(0.5 + distance / np.sqrt(12), 0, 1), atol=0.11)
    assert np.max(np.abs(followed)) <= np.max(np.abs(measurement.history.torque[0])) + 2 * noise
    last = measurement.cells.torque_mean > 11.5
    assert np.max(followed[last]) < 12.0 + noise


def test_angle_spread_is_the_noise_about_the_line(tmp_path):
    rng = np.random.default_rng(5)
    table = path_table([0.0, 12.0, -12.0, 0.0], per_branch=3000)
    table["angle_arcmin"] = 0.5 * table["torque_Nm"] + 0.3 * rng.standard_normal(len(table))
    measurement = taken(tmp_path, table)
    taken_cells = measurement.cells
    weight = taken_cells.count - 2
    assert np.sqrt(np.sum(weight * taken_cells.angle_spread**2) / weight.sum()) == pytest.approx(0.3, rel=0.03)


def test_the_command_steers_where_it_is_known(tmp_path):
    table = path_table([0.0, 12.0, -12.0, 0.0], per_branch=200)
    table["command_torque_Nm"] = table["torque_Nm"]
    table["torque_Nm"] += 3 * np.sin(np.arange(len(table))) * (table["torque_Nm"].abs() < 3)
    measurement = taken(tmp_path, table)
    assert measurement.branches.direction.tolist() == [1, -1, 1]


def test_rows_that_may_not_be_fitted_are_in_no_cell(tmp_path):
    text = UNIT + "[instrument]\ntorque_saturation_Nm = 6.0\n"
    measurement = taken(tmp_path, measured(), text)
    taken_cells = measurement.cells
    is_first = np.isin(np.arange(len(measurement.rows)) % 723, np.arange(8))  # below 1.2 N m on the first way up
    assert taken_cells.count.sum() == np.sum(measurement.usable & ~is_first) < len(measurement.rows)
    assert np.abs(taken_cells.torque_mean).max() < 6
    np.testing.assert_allclose(measurement.history.torque[0][1], 12.0, atol=0.3)


def test_noise_of_rows_that_are_cells_makes_no_branch_steep(tmp_path):
    """Rows differ by their noise more than by the slope; such rows must still be compared with their repeats."""
    table = pd.concat([path_table([-12.0, 12.0, -12.0], 120).assign(cycle=cycle) for cycle in range(3)])
    noise = np.random.default_rng(7).standard_normal(len(table))
    measurement = taken(tmp_path, table.assign(angle_arcmin=0.05 * table["torque_Nm"] + 0.3 * noise))
    assert measurement.cells.are_rows
    assert measurement.repeatability.repeats.n > 0.9 * 3 * 120  # the first branch of all is left out
    assert measurement.repeatability.repeats.value == pytest.approx(0.3, rel=0.15)

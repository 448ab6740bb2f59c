"""Rows at rest before the first load of a position."""

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, UNIT, loop, measured, path_of, write_unit

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
    instrument = measurement.unit.settings.instrument
    return row_filters.at_rest(measurement.rows, instrument, measurement.torque_noise)


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

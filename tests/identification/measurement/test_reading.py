"""Rows of measured files: names, units, order and selection."""

import gzip

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_bench import ROOT, UNIT, measured, write_unit

from pipeline.errors import InputError
from pipeline.identification.measurement.columns import ANGLE_UNITS, AngleColumn, TemperatureColumn, TorqueColumn
from pipeline.identification.measurement.rows import read_rows, training_rows
from pipeline.identification.measurement.unit_file import load_measured_unit


def rows_of(folder):
    unit = load_measured_unit(folder, ROOT)
    return unit, read_rows(unit)


def test_standard_files_are_read_in_time_order_by_position(tmp_path):
    table = measured(positions=(180.0, 0.0)).assign(note="a")
    _, rows = rows_of(write_unit(tmp_path / "u", {"rows.csv": table}))
    assert rows.cranks.tolist() == [0.0, 180.0]
    is_later = table["crank_deg"] == 0.0
    expected = pd.concat([table[is_later], table[~is_later]])
    np.testing.assert_array_equal(rows.torque, expected["torque_Nm"])
    np.testing.assert_array_equal(rows.angle, expected["angle_arcmin"])
    np.testing.assert_array_equal(rows.line, expected.index + 2)
    assert rows.time is rows.temperature is rows.command is None
    assert list(rows.extra) == ["note"]
    assert rows.where(np.arange(len(rows)) == 0) == (f"rows.csv:{is_later.idxmax() + 2}",)


def test_gzip_gives_the_same_rows(tmp_path):
    _, reference = rows_of(write_unit(tmp_path / "a"))
    folder = write_unit(tmp_path / "b", {})
    (folder / "rows.csv.gz").write_bytes(gzip.compress((tmp_path / "a/rows.csv").read_bytes()))
    _, packed = rows_of(folder)
    np.testing.assert_array_equal(packed.angle, reference.angle)


FOREIGN = (
    UNIT
    + """
[columns.torque_Nm]
name = "Moment [Nmm]"
unit = "N mm"
factor = -1.0

[columns.angle_arcmin]
name = "Winkel [°]"
unit = "deg"
offset = 2.0

[columns.time_s]
name = "t"
unit = "ms"

[columns.temperature_C]
name = "T"
unit = "K"

[columns.cycle]
name = "Zyklus"

[[files]]
path = "export.csv"
separator = ";"
decimal = ","
crank_deg = 45.0
where = { Zyklus = [1, 2] }
"""
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_a_foreign_export_is_mapped_by_its_columns(tmp_path, encoding):
    folder = write_unit(tmp_path / "u", {}, FOREIGN)
    lines = [
        "Zyklus;t;Moment [Nmm];Winkel [°];T",
        "0;0;1,5;0,1;293,15",
        "1;1;-1500,5;0,25;293,15",
        "2;2;2000;-0,5;303,15",
    ]
    (folder / "export.csv").write_text("\n".join(lines), encoding=encoding)
    _, rows = rows_of(folder)
    np.testing.assert_allclose(rows.torque, [1.5005, -2.0])
    np.testing.assert_allclose(rows.angle, [17.0, -28.0])
    np.testing.assert_allclose(rows.time, [0.001, 0.002])
    np.testing.assert_allclose(rows.temperature, [20.0, 30.0])
    assert rows.cycle.tolist() == [1, 2]
    assert rows.line.tolist() == [3, 4]
    assert rows.cranks.tolist() == [45.0]


def test_a_wrong_cell_is_nan_and_spares_the_others(tmp_path):
    folder = write_unit(tmp_path / "u", {}, FOREIGN)
    (folder / "export.csv").write_text(
        "Zyklus;t;Moment [Nmm];Winkel [°];T\n1;1;OVERLOAD;0,25;293\n\n1;2;2000,5;0,5;293\n", encoding="utf-8"
    )
    _, rows = rows_of(folder)
    np.testing.assert_allclose(rows.torque, [np.nan, -2.0005])
    assert rows.line.tolist() == [2, 4]  # the blank line counts


def test_settings_that_the_files_contradict_are_reported_together(tmp_path):
    text = UNIT + "".join(f'[[files]]\npath = "rows.csv"\nwhere = {{ {w} }}\n' for w in ("cycel = [1]", "cycle = [9]"))
    with pytest.raises(InputError) as error:
        rows_of(write_unit(tmp_path / "u", text=text))
    assert "did you mean 'cycle'" in error.value.problems[0]
    assert "no row that its where selects" in error.value.problems[1]


def test_a_missing_column_is_kept_for_the_faults(tmp_path):
    _, rows = rows_of(write_unit(tmp_path / "u", {"rows.csv": measured().drop(columns="torque_Nm")}))
    assert rows.missing == (("rows.csv", "torque_Nm", "torque_Nm", ("cycle", "crank_deg", "angle_arcmin")),)
    assert np.isnan(rows.torque).all()


def test_whole_positions_or_whole_cycles_are_held_out(tmp_path):
    unit, rows = rows_of(write_unit(tmp_path / "a"))
    train = training_rows(unit, rows)
    assert [np.unique(train[rows.position == p]).tolist() for p in range(3)] == [[True], [False], [True]]
    unit, rows = rows_of(write_unit(tmp_path / "b", {"rows.csv": measured((0.0,), 4)}))
    np.testing.assert_array_equal(training_rows(unit, rows), rows.cycle % 2 == 0)
    text = UNIT + '[held_out]\nby = "cycle"\ntrain = [1]\n'
    unit, rows = rows_of(write_unit(tmp_path / "c", text=text))
    np.testing.assert_array_equal(training_rows(unit, rows), rows.cycle == 1)
    unit, rows = rows_of(write_unit(tmp_path / "d", text=text.replace("[1]", "[7]")))
    with pytest.raises(InputError, match=r"train = 7; measured are 0, 1, 2"):
        training_rows(unit, rows)
    unit, rows = rows_of(write_unit(tmp_path / "e", text=text.replace("[1]", "[0, 1, 2]")))
    with pytest.raises(InputError, match="nothing to judge"):
        training_rows(unit, rows)


@given(st.sampled_from(sorted(ANGLE_UNITS)), st.floats(-10, 10))
def test_a_revolution_is_one_in_every_unit(unit, turns):
    per_revolution = {"arcmin": 21600, "deg": 360, "rad": 2 * np.pi, "rev": 1, "mrad": 2000 * np.pi, "arcsec": 1296000}
    scale, shift = AngleColumn(name="a", unit=unit).to_standard
    assert scale * turns * per_revolution[unit] + shift == pytest.approx(21600 * turns)


def test_factors_of_units_are_the_published_ones():
    assert TorqueColumn(name="t", unit="lbf in").to_standard[0] == pytest.approx(4.4482216152605 * 0.0254)
    scale, shift = TemperatureColumn(name="t", unit="F").to_standard
    assert scale * 212 + shift == pytest.approx(100)
    assert scale * 32 + shift == pytest.approx(0, abs=1e-12)

"""The workbook holds the tables of a folder with their units."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.cli import handover
from pipeline.cli.handover import write_workbook
from pipeline.engine.table import Column, Table
from pipeline.errors import InputError

TABLE = Table(
    "play", "unit", (Column("unit", "label", "", "label"), Column("play_arcmin", "float64", "arcmin", "play"))
)


def folder_with(tmp_path, rows: int, name: str = "play"):
    data = {"unit": np.array([f"u{k}" for k in range(rows)], object), "play_arcmin": np.arange(rows, dtype=float)}
    (tmp_path / f"{name}.parquet").write_bytes(TABLE.part(data).data)


def shared_strings(path) -> str:
    import zipfile

    with zipfile.ZipFile(path) as book:
        return "".join(book.read(name).decode() for name in book.namelist() if name.endswith(".xml"))


def test_each_table_is_a_sheet_with_units_in_its_header(tmp_path):
    folder_with(tmp_path, 3)
    (tmp_path / "stage").mkdir()
    folder_with(tmp_path / "stage", 2, "a_table_with_a_name_that_no_sheet_can_have")
    written, left_out = write_workbook(tmp_path, tmp_path / "book.xlsx")
    assert written == ["play", "stage a_table_with_a_name_that_no_sheet_can_have"]
    assert left_out == []
    text = shared_strings(tmp_path / "book.xlsx")
    assert "play_arcmin (arcmin)" in text
    assert 'name="stage a_table_with_a_name_that_"' in text
    assert "<v>2</v>" in text


def test_a_table_too_long_for_a_sheet_is_left_out_with_a_reason(tmp_path, monkeypatch):
    folder_with(tmp_path, 5)
    monkeypatch.setattr(handover, "MOST_ROWS", 4)
    written, left_out = write_workbook(tmp_path, tmp_path / "book.xlsx")
    assert written == []
    assert left_out[0].startswith("play: 5 rows")


def test_a_file_that_is_no_table_is_left_out_and_no_other_kind_of_file_is_overwritten(tmp_path):
    folder_with(tmp_path, 3)
    (tmp_path / "broken.parquet").write_bytes(b"no table" * 100)
    assert write_workbook(tmp_path, tmp_path / "book.xlsx") == (["play"], ["broken: broken.parquet is no Parquet file"])
    measured = tmp_path / "measured.csv"
    measured.write_text("kept")
    for file in (measured, tmp_path):
        with pytest.raises(InputError, match="must be a file that ends in .xlsx"):
            handover.write_spreadsheet(SimpleNamespace(folder=tmp_path, out=file))
    assert measured.read_text() == "kept"


def test_a_folder_without_tables_is_refused(tmp_path):
    with pytest.raises(InputError, match="no table"):
        write_workbook(tmp_path, tmp_path / "book.xlsx")

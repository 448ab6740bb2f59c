"""The tables beside a page as one workbook: a sheet for each table, the unit of each column in its header."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow.dataset as ds

from pipeline.engine.store import write_atomic
from pipeline.errors import InputError

MOST_ROWS = 1_048_575
"""Rows of a sheet below its header, by the file format."""
LONGEST_NAME = 31
"""Characters of a sheet's name, by the file format."""


def write_workbook(folder: Path, file: Path) -> tuple[list[str], list[str]]:
    """Write the Parquet tables of a folder of results as a workbook.

    Parameters
    ----------
    folder : of a page, or of a run, whose stages' tables are then taken.

    Returns
    -------
    Names of the tables written, and a sentence for each that was left out.

    Raises
    ------
    InputError
        If the folder has no table.
    """
    tables = dict(_tables(folder))
    if not tables:
        raise InputError(
            f"{folder}: no table; give a folder of results, as data/runs/quick or data/runs/allocate/paper"
        )
    sink = io.BytesIO()
    written_tables: list[str] = []
    left_out: list[str] = []
    with pd.ExcelWriter(sink, engine="xlsxwriter") as book:
        for name, path in tables.items():
            dataset = ds.dataset(path, format="parquet")
            rows = dataset.count_rows()
            if rows > MOST_ROWS:
                left_out.append(
                    f"{name}: {rows:,} rows; a sheet has at most {MOST_ROWS:,}; read {path.name} with pandas"
                )
                continue
            frame = dataset.to_table().to_pandas()
            frame.columns = [_header(dataset.schema.field(column)) for column in frame]
            frame.to_excel(book, sheet_name=_sheet_name(name, written_tables), index=False, freeze_panes=(1, 0))
            written_tables.append(name)
    write_atomic(file, sink.getvalue())
    return written_tables, left_out


def _tables(folder: Path) -> Iterator[tuple[str, Path]]:
    """Tables of a folder, by ``table`` or ``stage table``."""
    for path in sorted(folder.glob("*.parquet")):
        yield path.stem, path
    for path in sorted(folder.glob("*/*.parquet")):
        yield f"{path.parent.name} {path.stem}", path


def _header(field: ds.pyarrow.Field) -> str:
    """Name of a column with its unit."""
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    return f"{field.name} ({unit})" if unit and unit not in ("1", "") else field.name


def _sheet_name(name: str, taken_names: list[str]) -> str:
    """A name that the format allows and no other table has."""
    short = re.sub(r"[\[\]:*?/\\]", "_", name)[:LONGEST_NAME]
    return short if short not in taken_names else f"{short[: LONGEST_NAME - 3]}{len(taken_names)}"

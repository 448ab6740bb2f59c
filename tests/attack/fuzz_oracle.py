"""What a naive reader makes of a fuzzed input: what must be refused or named, and the values that stay."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Real

LARGEST = 1e12
BLANK = ("", "NA", "N/A", "NaN", "nan", "null")


@dataclass(frozen=True)
class Reading:
    """What the program made of a table.

    Attributes
    ----------
    values : (n, n_columns) of its columns of numbers, in any order of rows; NaN where it has none.
    named : whether it said of these values what it does not say of the sound ones.
    """

    values: Real
    named: bool


@dataclass(frozen=True)
class Naive:
    """Columns of a comma-separated text as Python's own reader has them; ``unsound`` says what no reader may accept."""

    values: Real
    unsound: str


def naively_read(text: str, columns: tuple[str, ...], optional: bool) -> Naive:
    """The columns of a text (n, n_columns), NaN where there is no number, and what is wrong with it.

    Columns that are ``optional`` may be missing, and their cells blank.
    """
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.lstrip("\ufeff").splitlines())]
    rows = [row for row in rows if any(row)]
    header, *rows = rows or [[]]
    wrong = [f"no column {name}" for name in columns if name not in header and not optional]
    wrong += [f"row {number}: {len(row)} fields" for number, row in enumerate(rows) if len(row) != len(header)]
    if wrong:
        return Naive(np.empty((0, len(columns))), wrong[0])
    cells = [[row[header.index(name)] if name in header else "" for name in columns] for row in rows]
    values = np.array([[_number(cell) for cell in row] for row in cells]).reshape(-1, len(columns))
    blank = np.array([[cell in BLANK for cell in row] for row in cells]).reshape(-1, len(columns))
    no_number = np.isnan(values) & ~(blank & optional)
    return Naive(values, "a cell that is no number" if no_number.any() else "")


def _number(cell: str) -> float:
    try:
        value = float(cell) if "_" not in cell else np.nan
    except ValueError:
        return np.nan
    return value if abs(value) <= LARGEST else np.nan


def silence(reading: Reading, naive: Naive) -> str:
    """What the program accepted without a word and should not have; empty if nothing."""
    if reading.named:
        return ""
    if naive.unsound:
        return f"silent on {naive.unsound}"
    found, expected = (_in_order(values) for values in (reading.values, naive.values))
    if found.shape != expected.shape or not np.array_equal(found, expected, equal_nan=True):
        return f"other values than the file's: {found.shape} for {expected.shape}"
    return ""


def _in_order(values: Real) -> Real:
    values = values[~np.all(np.isnan(values), axis=1)]
    return values[np.lexsort(np.nan_to_num(values, nan=np.inf).T)]


def ignored_settings(text: str, read: Mapping[str, Any], same: frozenset[str]) -> list[str]:
    """Keys of a settings file whose plain values are not those that were read, of the keys that are read as written."""
    loaded = dict(leaves(read))
    text = text.replace("\r\n", "\n").replace("\r", "\n")  # a file is read with the line ends of any system
    return [
        f"{key} = {value!r} was read as {loaded.get(key)!r}"
        for key, value in leaves(tomllib.loads(text))
        if (key in same or not any(name == key or name.startswith(f"{key}.") for name in loaded))
        and not _is_same(loaded.get(key), value)
    ]


def _is_same(read: Any, written: Any) -> bool:
    """Whether a value was read as written; an integer beyond 2^53 as the nearest number."""
    numbers = all(type(value) in (int, float) for value in (read, written))
    return float(read) == float(written) if numbers else read == written


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and plain values of nested tables; a list is one value."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from leaves(item, f"{key}.{name}" if key else str(name))
    else:
        yield key, list(value) if isinstance(value, list | tuple) else value

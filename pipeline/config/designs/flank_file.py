"""A measured flank read from a CSV file, which a design names beside its drawn flank."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config.files.section import nearest_name, shown_value
from pipeline.config.files.table_file import read_table, shortened_list
from pipeline.errors import InputError

DEVIATION, LOBE, PLACES = "deviation_um", "lobe", ("phase_deg", "arc_mm")
LARGEST_TABLE = 2_000_000
"""Rows: a thousand lobes with two thousand points each."""


def with_flank_file(raw: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The design ``raw`` with the content of the flank file that it names, a path from its own ``folder``.

    Raises
    ------
    InputError : there is no such file, or it is no table of a flank.
    """
    flank = raw.get("flank")
    if not isinstance(flank, Mapping) or not isinstance(flank.get("measured"), str):
        return dict(raw)
    path = folder / flank["measured"]
    if path.suffix.lower() != ".csv" or not path.is_file():
        reason = "is no CSV file" if path.is_file() else "no such file beside the design"
        shown_text = shown_value(flank["measured"])
        raise InputError(
            [f"flank.measured = {shown_text}; {reason}; name a CSV file, its path from the design's folder"]
        )
    return {**raw, "flank": {**flank, "measured": flank_table(path)}}


def flank_table(path: Path) -> dict[str, Any]:
    """The columns of a flank file as the section ``flank.measured`` has them.

    Raises
    ------
    InputError : a column is missing or unknown, rows are no numbers, or lobes are not one after the other.
    """
    name = path.name
    table = read_table(path, name)
    station_column = _checked_columns(list(table.cells), name)
    if not 0 < len(table.cells) <= LARGEST_TABLE:
        raise InputError([f"{name}: {len(table.cells) or 'no'} rows; must be 1 to {LARGEST_TABLE} measured points"])
    numbers = pd.DataFrame({column: table.numbers(column) for column in table.cells}, index=table.cells.index)
    problems = [
        line
        for column in numbers
        for line in table.faults(column, ~np.isfinite(numbers[column].to_numpy(float)), "must be a number")
    ]
    if problems:
        raise InputError(shortened_list(problems, name))
    lists = _lobes(numbers, station_column, name)
    return {station_column: lists[0][0], DEVIATION: tuple(deviation for _, deviation in lists), "file": name}


def _columns() -> str:
    return f"{' or '.join(PLACES)}, {DEVIATION}, and {LOBE} where each lobe was measured"


def _checked_columns(columns: list[str], name: str) -> str:
    places = [column for column in PLACES if column in columns]
    known_columns = (*PLACES, DEVIATION, LOBE)
    for column in columns:
        if column not in known_columns:
            advice = nearest_name(column, known_columns)
            raise InputError([f"{name}: column {shown_value(column)} is unknown; {advice}; columns are {_columns()}"])
    if len(places) != 1 or DEVIATION not in columns:
        raise InputError([f"{name}: columns {', '.join(columns)}; must be {_columns()}"])
    return places[0]


def _lobes(numbers: pd.DataFrame, place_column: str, name: str) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Places and deviations of each lobe."""
    if LOBE not in numbers:
        return [(tuple(numbers[place_column].astype(float)), tuple(numbers[DEVIATION].astype(float)))]
    lobe = numbers[LOBE].to_numpy(float)
    count = int(np.argmax(lobe != lobe[0])) or len(lobe)
    expected_lobe = np.arange(len(lobe)) // count
    if wrong_rows := np.flatnonzero(lobe != expected_lobe).tolist():
        requirement = (
            f"must be {expected_lobe[wrong_rows[0]]}: {count} rows a lobe as of the first, lobes from 0, clockwise"
        )
        raise InputError(
            [f"{name}: lobe = {lobe[wrong_rows[0]]:g} in row {numbers.index[wrong_rows[0]]}; {requirement}"]
        )
    values = (
        [numbers[column].to_numpy(float).reshape(-1, count) for column in (place_column, DEVIATION)]
        if (len(lobe) % count == 0)
        else []
    )
    if not values:
        raise InputError([f"{name}: the last lobe has {len(lobe) % count} rows; must have {count} as the first"])
    places, deviations = values
    if len(differing := np.argwhere(places != places[0])):
        k, point = differing[0]
        shown_text = f"{place_column} = {places[k, point]:g} in row {numbers.index[k * count + point]}"
        requirement = (
            f"must be {places[0, point]:g} as in row {numbers.index[point]}: all lobes are measured at the same points"
        )
        raise InputError([f"{name}: {shown_text}; {requirement}"])
    return [
        (tuple(stations.tolist()), tuple(deviations_of_lobe.tolist()))
        for stations, deviations_of_lobe in zip(places, deviations, strict=True)
    ]

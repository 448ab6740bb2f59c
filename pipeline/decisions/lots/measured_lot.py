"""Measured parts as deviations of toleranced dimensions, and the ovalities of measured pin circles."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.files.section import LARGEST_UM, nearest_name, shown_value
from pipeline.config.files.table_file import TableFile, shortened_list
from pipeline.config.studies.study import Study
from pipeline.errors import InputError

PART = "part"
"""Column that labels a part; rows of one label are the elements of one part, in their order."""
UNIT = re.compile(r"_(um|\u03bcm|mm|nm|m|in|inch|mil|microns?)(?=_\d+$|$)")
"""A unit behind the name of a dimension, or between it and the number of an element."""
FEWEST_PARTS = 5
"""Values of a dimension below which no distribution is fitted."""


@dataclass(frozen=True)
class MeasuredLot:
    """Parts in the order of production.

    Attributes
    ----------
    name : of the lot, for messages and pages.
    parts : label of each part (n_parts,).
    values : of each measured dimension (n_parts, n_elements) [um], total deviations with the signs of the dimensions;
        NaN where a part has no value. Dimensions without elements have one column.
    ignored_columns : columns of the table that are no dimension.
    """

    name: str
    parts: tuple[str, ...]
    values: Mapping[str, Real]
    ignored_columns: tuple[str, ...]


def measured_lot(name: str, table: TableFile, design: Design) -> MeasuredLot:
    """The lot in a table of parts.

    Parameters
    ----------
    name : of the lot.
    table : a column is named after a dimension, as ``disk_profile`` or ``disk_profile_um``, or after one of its
        elements, as ``pin_radial_0`` to ``pin_radial_79``. ``part`` labels the parts; a label that is repeated
        continues its part with the next element.
    design : of the reducer; it states how many elements a part has.

    Raises
    ------
    InputError
        If a value is no deviation, a part lacks elements, a dimension has none in this reducer, none is measured, a
        column is named after one in another spelling, or rows of one part lie apart.
    """
    read, ignored_columns = _read_columns(table, design)
    n_rows = len(table.cells)
    if n_rows == 0:
        raise InputError(f"{table.name}: no part; give a row for each")
    labels = table.texts(PART) if PART in table.cells else None
    gaps = np.flatnonzero(np.diff(table.cells.index) != 1)
    if labels is None and len(gaps):  # parts are numbered by their rows
        line = table.cells.index[gaps[0]] + 1
        raise InputError(f"{table.name}:{line}: no value; remove the line, or give its part a value")
    starts = _starts(labels, n_rows)
    if labels is not None:
        _check_labels(table, labels, starts)
    values_of = {
        key: _by_part(table.name, dimension_library()[key], design, parts, starts, n_rows)
        for key, parts in read.items()
    }
    part_labels = tuple(labels[k] if labels else str(k + 1) for k in starts)
    return MeasuredLot(name, part_labels, values_of, ignored_columns)


def _read_columns(table: TableFile, design: Design) -> tuple[dict[str, dict[int | None, Real]], tuple[str, ...]]:
    """Values (n_rows,) [um] of each dimension by the number of the element, and the columns that are none."""
    problems: list[str] = []
    read: dict[str, dict[int | None, Real]] = {}
    ignored_columns = []
    for column in table.cells:
        if column == PART:
            continue
        match = _dimension_of(column, design)
        if match is None and (meant := _meant_column(column, design)):
            problems.append(f"{table.name}: column {shown_value(column)}; write {meant}; values are deviations in um")
            continue
        if match is None:
            ignored_columns.append(column)
            continue
        dimension, element = match
        if dimension.count(design) == 0:
            problems.append(f"{table.name}: column {column}: {dimension.refusal(design)}")
            continue
        values = table.numbers(column)
        problems += table.faults(column, ~table.is_blank(column) & np.isnan(values), "must be a deviation in um")
        too_large = np.flatnonzero(np.abs(values) > LARGEST_UM)
        problems += table.faults(
            column,
            np.isin(np.arange(len(values)), too_large[:1]),
            f"must be a deviation from the nominal size in um, {-LARGEST_UM} to {LARGEST_UM}; {len(too_large)} of "
            f"{len(values)} rows are beyond. Subtract the nominal size and write micrometres",
        )
        read.setdefault(dimension.name, {})[element] = values
    if not read and not problems:
        hints = [f"{column!r}: {nearest_name(column, tuple(dimension_library()))}" for column in ignored_columns[:3]]
        problems.append(
            f"{table.name}: no column is named after a toleranced dimension "
            f"({'; '.join(hints) or 'the table is empty'})"
        )
    if problems:
        raise InputError(shortened_list(problems, table.name))
    return read, tuple(ignored_columns)


def _dimension_of(column: str, design: Design) -> tuple[Dimension, int | None] | None:
    """Dimension and number of the element that a column is named after."""
    bare = column.strip().removesuffix("_um")
    library = dimension_library()
    if bare in library:
        return library[bare], None
    match = re.fullmatch(r"(.+)_(\d+)", bare)
    if match and match[1] in library and library[match[1]].elements:
        return library[match[1]], int(match[2])
    return None


def _meant_column(column: str, design: Design) -> str:
    """The name that a column should have which is one but for case, blanks and a unit; empty where there is none."""
    plain = UNIT.sub("", re.sub(r"[\W_]+", "_", column.casefold()).strip("_"))
    if plain == PART:
        return PART
    match = _dimension_of(plain, design)
    if match is None:
        return ""
    dimension, element = match
    return f"{dimension.name}_um" if element is None else f"{dimension.name}_{element}"


def _check_labels(table: TableFile, labels: Sequence[str], starts: Sequence[int]) -> None:
    """Refuse a label whose rows do not follow each other: they may be two parts, or one."""
    first_rows: dict[str, int] = {}
    problems = []
    for row in starts:
        first_row = first_rows.setdefault(labels[row], row)
        if first_row != row:
            problems.append(
                f"{table.place(row)}: part = {labels[row]}; line {table.cells.index[first_row]} has it already, with "
                "other parts between; put the rows of a part together, and give each part a label of its own"
            )
    if problems:
        raise InputError(shortened_list(problems, table.name))


def _starts(labels: Sequence[str] | None, n_rows: int) -> list[int]:
    """First row of each part."""
    if labels is None:
        return list(range(n_rows))
    return [row for row in range(n_rows) if row == 0 or labels[row] != labels[row - 1]]


def _by_part(
    name: str,
    dimension: Dimension,
    design: Design,
    parts: Mapping[int | None, Real],
    starts: Sequence[int],
    n_rows: int,
) -> Real:
    """Values (n_parts, n_elements) of one dimension."""
    ends = [*starts[1:], n_rows]
    of_one_part = dimension.elements.count(design) if dimension.elements else 1
    if None not in parts:
        if sorted(number for number in parts if number is not None) != list(range(of_one_part)):
            raise InputError(
                f"{name}: columns of {dimension.name} have {len(parts)} numbers; give {dimension.name}_0 to "
                f"{dimension.name}_{of_one_part - 1}"
            )
        return np.column_stack([parts[number] for number in range(of_one_part)])[list(starts)]
    rows = parts[None]
    groups = [rows[start:end] for start, end in zip(starts, ends, strict=True)]
    groups = [group[np.isfinite(group)] for group in groups]
    sizes = {len(group) for group in groups if len(group)}
    if dimension.elements is None and sizes - {1}:
        raise InputError(f"{name}: a part has several values of {dimension.name}; a part has one")
    if sizes <= {1}:
        return np.array([group[0] if len(group) else np.nan for group in groups])[:, None]
    if sizes != {of_one_part}:
        raise InputError(
            f"{name}: parts have {', '.join(map(str, sorted(sizes)))} values of {dimension.name}; "
            f"a part has {of_one_part}"
        )
    return np.array([group if len(group) else np.full(of_one_part, np.nan) for group in groups])


FIRST_FREE_ORDER, FREE_ORDERS = 4, 14
"""Orders beyond the ovalities from whose power the chance part is extrapolated: 4 to 17."""


def with_separate_ovalities(lot: MeasuredLot, study: Study) -> MeasuredLot:
    """The lot with ovalities taken out of the pins' radial positions, where the study varies them.

    A lot whose rings are not measured whole, or that states the ovalities itself, is returned as it is.
    """
    name = "pin_radial"
    library, values = dimension_library(), lot.values.get(name)
    orders = {
        other_name: int(other_name.rsplit("_", 1)[1])
        for other_name, dimension in library.items()
        if dimension.acts_on == name and getattr(study.tolerances, other_name).varies
    }
    if values is None or values.shape[1] < 2 * (FIRST_FREE_ORDER + FREE_ORDERS) or set(orders) & set(lot.values):
        return lot
    measured_values = {**lot.values, name: values.copy()}
    coefficients = 2 * np.fft.rfft(values, axis=1) / values.shape[1]
    free_orders = np.arange(FIRST_FREE_ORDER, FIRST_FREE_ORDER + FREE_ORDERS)
    power_of_pins = np.nanmean(np.abs(coefficients[:, free_orders]) ** 2, axis=0)
    slope, offset = np.polyfit(free_orders**2, 1 / power_of_pins, 1, w=power_of_pins)
    largest_power = float(power_of_pins.max())
    turn = 2j * np.pi * np.arange(values.shape[1]) / values.shape[1]
    for other_name, order in orders.items():
        wave = coefficients[:, order]
        inverse = offset + slope * order**2
        chance = 1 / inverse if inverse > 0 else largest_power
        size = np.abs(wave)
        amplitude = np.sqrt(np.maximum(size**2 - chance, 0.0))
        remainder = wave * (1 - np.divide(amplitude, size, out=np.zeros_like(size), where=size > 0))
        power = np.nanmean(np.abs(remainder) ** 2)
        kept_wave = remainder * np.sqrt(chance / power) if power > 0 else remainder
        measured_values[name] -= ((wave - kept_wave)[:, None] * np.exp(order * turn)).real
        measured_values[other_name] = amplitude[:, None]
    return replace(lot, values=measured_values)

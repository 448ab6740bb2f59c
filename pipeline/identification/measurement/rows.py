"""The rows of a measured unit: columns found by name, brought to standard units, in time order."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arrays import Index, Real, Truth, Whole
from pipeline.config.files.section import nearest_name
from pipeline.config.files.table_file import LARGEST_VALUE, TableFile, read_table, shortened_list
from pipeline.errors import InputError
from pipeline.identification.measurement.columns import FileColumn
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.measurement.unit_sections import DataFile

REQUIRED_QUANTITIES = ("cycle", "crank_deg", "torque_Nm", "angle_arcmin")
OPTIONAL = ("time_s", "temperature_C", "command_torque_Nm")
ENCODERS = ("input_deg", "output_deg", "input_rpm")
"""Columns of a record: a pair of encoders, in place of the crank angle and the error, and the speed."""
CRANK_DIGITS = 6
"""Decimals of a crank angle [deg] by which positions are told apart."""


class MissingColumn(NamedTuple):
    """A column that a file should have: its file and name, the quantity read from it, and the file's columns."""

    file: str
    name: str
    quantity: str
    present: tuple[str, ...]


@dataclass(frozen=True)
class Rows:
    """Measured rows; by position, and in each as they stand in the files, which is the order of time.

    Attributes
    ----------
    cranks : (n_positions,) [deg] crank angles, ascending.
    position : (n,) index into `cranks`; -1 where the crank angle is no number.
    cycle : (n,) number; -1 where it is no integer (see `is_misnumbered`).
    is_misnumbered : (n,) whether crank angle or cycle is no number.
    torque, angle : (n,) [N m], [arcmin]; NaN where it is no number.
    time, temperature, command : (n,) [s], [deg C], [N m]; None without such a column in any file.
    file, line : (n,) index into `files`, and line in that file (the header is line 1).
    files : names.
    missing : columns that a file should have and does not have.
    extra : (n,) rows of all other columns, as they were read.
    """

    cranks: Real
    position: Whole
    cycle: Whole
    is_misnumbered: Truth
    torque: Real
    angle: Real
    time: Real | None
    temperature: Real | None
    command: Real | None
    file: Whole
    line: Whole
    files: tuple[str, ...]
    missing: tuple[MissingColumn, ...]
    extra: pd.DataFrame

    def __len__(self) -> int:
        return len(self.torque)

    @property
    def coordinate(self) -> Real:
        """The torque that the bench steers (n,) [N m]: commanded where known, else measured."""
        return self.torque if self.command is None else self.command

    def where(self, selected_rows: Index | Truth) -> tuple[str, ...]:
        """`file:line` of the selected rows (a mask or indices)."""
        row_numbers = np.arange(len(self))[selected_rows]
        return tuple(f"{self.files[self.file[row]]}:{self.line[row]}" for row in row_numbers)

    def runs(self) -> Iterator[tuple[int, int, slice]]:
        """Position, cycle and rows of each run of rows of one cycle at one position, in order."""
        if not len(self):
            return
        boundary = (np.diff(self.position) != 0) | (np.diff(self.cycle) != 0)
        edges = np.concatenate([[0], np.flatnonzero(boundary) + 1, [len(self)]])
        for start, stop in zip(edges[:-1], edges[1:], strict=True):
            yield int(self.position[start]), int(self.cycle[start]), slice(int(start), int(stop))


@dataclass(frozen=True)
class Recorded:
    """What the files of a unit hold, in the order of reading.

    Attributes
    ----------
    table : quantities in standard units, and `line`; a column without values is missing.
    source : (n,) number of each row's file.
    missing, extra : as of ``Rows``.
    """

    table: pd.DataFrame
    source: Whole
    missing: tuple[MissingColumn, ...]
    extra: pd.DataFrame

    def quantity(self, name: str) -> Real:
        """The values of a quantity (n,); NaN where it was not measured."""
        return self.table[name].to_numpy(float) if name in self.table else np.full(len(self.table), np.nan)

    @property
    def cycle(self) -> tuple[Whole, Truth]:
        """Cycle of each row (n,), -1 where it is no integer, and where it is one (n,)."""
        cycle = self.quantity("cycle")
        integer = np.isfinite(cycle) & (np.abs(cycle) < 2**31)
        integer[integer] = cycle[integer] == np.round(cycle[integer])
        return np.where(integer, cycle, -1).astype(np.int64), integer


def read_rows(unit: UnitFile) -> Rows:
    """All rows of a unit that its files select, each at the position of its crank angle; see ``recorded_rows``."""
    record = recorded_rows(unit)
    crank = np.round(record.quantity("crank_deg"), CRANK_DIGITS)
    cranks = np.unique(crank[np.isfinite(crank)])
    position = np.where(np.isfinite(crank), np.searchsorted(cranks, crank), -1)
    return rows_of(record, unit, cranks, position)


def recorded_rows(unit: UnitFile) -> Recorded:
    """What the files of a unit hold.

    A value that is no number becomes NaN and a missing column NaN throughout; `data_faults` reports both.

    Raises
    ------
    InputError : a file is no table, or its `where` names a column it has not or selects no row; with all problems.
    """
    problems: list[str] = []
    tables = []
    for number, file in enumerate(unit.files):
        try:
            table = read_table(unit.folder / file.path, file.path, file.separator, file.decimal)
            tables.append(_selected_rows(table, file, number, unit))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(shortened_list(problems, unit.name))
    missing: list[MissingColumn] = []
    parts = [_standard(table, number, unit, missing) for number, table in enumerate(tables)]
    source = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    mapped_columns = {_column(unit, name).name for name in (*REQUIRED_QUANTITIES, *OPTIONAL, *ENCODERS)}
    extra = pd.concat(
        [table.cells.drop(columns=mapped_columns & set(table.cells)) for table in tables], ignore_index=True
    )
    return Recorded(pd.concat(parts, ignore_index=True), source, tuple(missing), extra)


def training_rows(unit: UnitFile, rows: Rows) -> Truth:
    """Whether each row is fitted (n,); the others are held out: whole crank positions or whole cycles.

    Raises
    ------
    InputError : `held_out.train` names a crank angle or cycle that was not measured, or leaves nothing held out.
    """
    of_row, train, cranks = _held_out_by(unit, rows)
    key, crank_text = f"{unit.name}/unit.toml: held_out.train", ", ".join(f"{value:g}" for value in cranks)
    unknown_values = [f"{value:g}" for value in train if value not in cranks]
    if unknown_values:
        raise InputError(f"{key} = {', '.join(unknown_values)}; measured are {crank_text}")
    if unit.settings.held_out.train and len(train) == len(cranks):
        raise InputError(f"{key} = {crank_text}; leaves nothing to judge the model with; leave one out")
    return np.isin(of_row, train)


def fitted_rows(unit: UnitFile, rows: Rows) -> Truth:
    """Rows (n,) that whatever is estimated may see: those that unit.toml trains on, else all.

    Where nothing that it names was measured, all: ``training_rows`` says so before a fit.
    """
    of_row, train, _ = _held_out_by(unit, rows)
    is_fitted = np.isin(of_row, train)
    return is_fitted if unit.settings.held_out.train and np.any(is_fitted) else np.ones(len(rows), bool)


def _held_out_by(unit: UnitFile, rows: Rows) -> tuple[Real, Real, Real]:
    """Crank angle or cycle of each row (n,), those that are fitted, and all that were measured."""
    held_out = unit.settings.held_out
    by_position = held_out.by == "position" if held_out.by else len(rows.cranks) >= 2
    crank = np.append(rows.cranks, np.nan)[rows.position]  # the last one, -1, is that of an unknown position
    of_row = crank if by_position else rows.cycle.astype(float)
    cranks = np.unique(of_row[~rows.is_misnumbered])
    return of_row, np.round(held_out.train, CRANK_DIGITS) if held_out.train else cranks[::2], cranks


def _selected_rows(table: TableFile, file: DataFile, number: int, unit: UnitFile) -> TableFile:
    frame = table.cells
    key = f"{unit.name}/unit.toml: files[{number}].where"
    row_mask = np.ones(len(frame), bool)
    for name, values in file.where.items():
        if name not in frame:
            raise InputError(f"{key}.{name}; {file.path} has no such column; {nearest_name(name, frame.columns)}")
        row_mask &= frame[name].isin(values).to_numpy()
    if not row_mask.any():
        raise InputError(f"{file.path}: no row" + (" that its where selects; widen it" if file.where else ""))
    return replace(table, cells=frame[row_mask])


def _column(unit: UnitFile, quantity: str) -> FileColumn:
    column: FileColumn = getattr(unit.settings.columns, quantity)
    return column


def _standard(table: TableFile, number: int, unit: UnitFile, missing: list[MissingColumn]) -> pd.DataFrame:
    """The quantities of file ``number`` in standard units at the output; what it lacks is added to `missing`."""
    file = unit.files[number]
    crank = float(number) if unit.has_anonymous_positions else file.crank_deg
    constants = {**dict(file), "crank_deg": crank}
    to_output = {
        "torque_Nm": unit.input_ratio,
        "command_torque_Nm": unit.input_ratio,
        "angle_arcmin": 1 / unit.input_ratio,
    }
    mapped_columns = unit.settings.columns.model_fields_set
    values = {}
    for quantity in (*REQUIRED_QUANTITIES, *OPTIONAL, *ENCODERS):
        column = _column(unit, quantity)
        if column.name in table.cells:
            scale, shift = column.to_standard
            numbers = table.numbers(column.name)
            with np.errstate(over="ignore", invalid="ignore"):
                value = to_output.get(quantity, 1.0) * (column.factor * (scale * numbers + shift) + column.offset)
                values[quantity] = np.where(np.abs(value) <= LARGEST_VALUE, value, np.nan)
        elif constants.get(quantity) is not None:
            values[quantity] = np.full(len(table.cells), to_output.get(quantity, 1.0) * constants[quantity], float)
        elif quantity in REQUIRED_QUANTITIES or quantity in mapped_columns:
            missing.append(MissingColumn(file.path, column.name, quantity, tuple(table.cells)))
    return pd.DataFrame({"line": table.cells.index, **values})


def rows_of(record: Recorded, unit: UnitFile, cranks: Real, position: Whole) -> Rows:
    """The rows of a record by position (n,), -1 where it is unknown, of those at ``cranks`` (n_positions,) [deg]."""
    quantity, (cycle, integer) = record.quantity, record.cycle
    order = np.argsort(position, kind="stable")
    optional = [quantity(name)[order] if name in record.table else None for name in OPTIONAL]
    return Rows(
        cranks=cranks,
        position=position[order],
        cycle=cycle[order],
        is_misnumbered=(~integer | (position < 0))[order],
        torque=quantity("torque_Nm")[order],
        angle=quantity("angle_arcmin")[order],
        time=optional[0],
        temperature=optional[1],
        command=optional[2],
        file=record.source[order],
        line=record.table["line"].to_numpy(np.int64)[order],
        files=tuple(file.path for file in unit.files),
        missing=record.missing,
        extra=record.extra.iloc[order].reset_index(drop=True),
    )

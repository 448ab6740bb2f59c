"""All that is known of a measured unit before any model: what follows from its rows, and what is wrong with them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.config.files.table_file import shortened_list
from pipeline.identification.measurement.faults.data_faults import data_faults
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.measured_rows import MeasuredRows
from pipeline.identification.measurement.rows import read_rows, training_rows
from pipeline.identification.measurement.unit_file import UnitFile


@dataclass(frozen=True, eq=False)
class Measurement(MeasuredRows):
    """A unit's rows, what follows from them, and their faults.

    Attributes
    ----------
    notes : what was found by the model, beside the faults of the rows.
    """

    notes: tuple[Fault, ...] = field(default=(), kw_only=True)

    @classmethod
    def read(cls, unit: UnitFile) -> "Measurement":
        """The measurement of a unit.

        Raises
        ------
        InputError : as ``read_rows``.
        """
        return cls(unit, read_rows(unit))

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the data, fatal ones and notes."""
        return (*data_faults(self), *self.notes)

    def in_other_sense(self, *notes: Fault) -> "Measurement":
        """The measurement with torque and angle of the other sign, and notes on it."""
        rows, command = self.rows, self.rows.command
        reversed_rows = replace(
            rows, torque=-rows.torque, angle=-rows.angle, command=None if command is None else -command
        )
        return Measurement(self.unit, reversed_rows, notes=notes)

    @property
    def fatal(self) -> tuple[Fault, ...]:
        """Faults with which nothing can be fitted."""
        return tuple(fault for fault in self.faults if fault.severity == "fatal")

    @property
    def summary(self) -> list[str]:
        """What was read, and every fault, a line each."""
        rows = self.rows
        cycles = len(np.unique(np.column_stack([rows.position, rows.cycle]), axis=0))
        return [
            f"{self.unit.name}: {len(rows)} rows in {len(rows.files)} files, {len(rows.cranks)} crank angles, "
            f"{cycles} cycles",
            *shortened_list((fault.line for fault in self.faults), self.unit.name),
        ]

    @cached_property
    def training_cells(self) -> Truth:
        """Cells (n_cells,) that unit.toml, or its default, lets a fit see.

        Raises
        ------
        InputError : as ``training_rows``.
        """
        return training_rows(self.unit, self.rows)[self.cells.first_row]

    @property
    def known_cranks(self) -> int:
        """Number of positions whose crank angle is known."""
        return len(self.rows.cranks) if self.unit.settings.crank_angles == "measured" else 0

    @property
    def drive_cranks(self) -> Real:
        """Crank angle at which the model of each position stands (n_positions,) [deg].

        As measured. Angles that nobody knows predict no difference between positions, so that all stand as the first
        one trained on.
        """
        cranks = self.rows.cranks
        if self.known_cranks:
            return cranks
        return np.full(len(cranks), cranks[self.cells.position[self.training_cells][0]])

    def over_cells(self, values: Real) -> Real:
        """Means (n_cells,) of values of the rows (n_rows,)."""
        usable_rows = np.flatnonzero(self.usable)
        first_row = np.searchsorted(usable_rows, self.cells.first_row)
        return np.array(
            [values[usable_rows[k : k + n]].mean() for k, n in zip(first_row, self.cells.count, strict=True)]
        )

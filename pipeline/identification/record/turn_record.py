"""A record of a drive that turned under held torques: its rows as read, its passes and cells, and its faults."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pipeline.arrays import Real
from pipeline.config.files.table_file import shortened_list
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.rows import Recorded, recorded_rows
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.record.faults import column_faults, record_faults
from pipeline.identification.record.orders import orders_of
from pipeline.identification.record.passes import RecordedPasses

ARCMIN_A_DEGREE = 60.0
"""Minutes of arc in a degree."""


class TurnRecord(RecordedPasses):
    """A record that was read, and its faults; passes and cells can be computed only of data without a fatal one."""

    @classmethod
    def read(cls, unit: UnitFile) -> TurnRecord:
        """The record of a unit; raises as ``recorded_rows``."""
        table = recorded_rows(unit)
        faults = tuple(column_faults(table, unit))
        place, error = (np.full(len(table.table), np.nan),) * 2 if faults else _angles(table, unit)
        cycle = np.maximum(table.cycle[0], 0)
        return cls(
            unit=unit,
            place=place,
            error=error,
            torque=table.quantity("torque_Nm"),
            time=table.quantity("time_s"),
            temperature=table.quantity("temperature_C"),
            run=cycle * (int(table.source.max(initial=0)) + 1) + table.source,
            cycle=cycle,
            reading_faults=faults,
        )

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the data, fatal ones and notes."""
        return self.reading_faults or tuple(record_faults(self))

    @property
    def fatal(self) -> tuple[Fault, ...]:
        """Faults with which nothing can be fitted."""
        return tuple(fault for fault in self.faults if fault.severity == "fatal")

    @property
    def summary(self) -> list[str]:
        """What was read, and every fault, a line each."""
        lines = [f"{self.unit.name}: {len(self)} rows in {len(self.unit.files)} files"]
        if not self.fatal:
            torques = ", ".join(f"{level:.3g}" for level in self.levels)
            lines[0] += f", {len(self.passes)} passes over {self.span_deg:.4g} deg of the output at {torques} N m"
        return [*lines, *shortened_list((fault.line for fault in self.faults), self.unit.name)]


def _angles(record: Recorded, unit: UnitFile) -> tuple[Real, Real]:
    """Angle of the output by the ideal ratio (n,) [deg], and its error (n,) [arcmin].

    The sense of the output against the input is that of the record; the ratio's sign is not asked for.
    """
    ratio = orders_of(unit).ratio
    has_pair = {"input_deg", "output_deg"} <= set(record.table)
    turned_angle = record.quantity("input_deg" if has_pair else "crank_deg")
    if not has_pair:
        place, error = turned_angle / ratio, record.quantity("angle_arcmin")
        if unit.settings.angle == "error":
            return place, error
        output = error / ARCMIN_A_DEGREE
    else:
        place, output = turned_angle / ratio, record.quantity("output_deg")
    is_known = np.isfinite(place) & np.isfinite(output)
    sign = (
        1.0
        if not is_known.any()
        or np.ptp(output[is_known] - place[is_known]) <= np.ptp(output[is_known] + place[is_known])
        else -1.0
    )
    place = sign * place
    error = ARCMIN_A_DEGREE * (output - place)
    return place, error - (np.nanmedian(error) if is_known.any() else 0.0)

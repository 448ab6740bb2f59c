"""A record of a turning drive, read and judged."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pipeline.arrays import Real
from pipeline.config.files.table_file import shortened_list
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.rows import Recorded, recorded_rows
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.record.orders import orders_of
from pipeline.identification.record.passes import RecordedPasses
from pipeline.model.units import ARCMIN_A_DEGREE

FEWEST_INTERVALS = 24
"""Intervals of the output angle from which waves are told apart."""
LARGEST_ERROR_ARCMIN = 120.0
"""Range of the transmission error beyond which the ratio or a column is wrong."""
LEAST_TURN = 2.0
"""Turns of the input that a pass makes at least."""


def column_faults(record: Recorded, unit: UnitFile) -> Iterator[Fault]:
    """Columns that the files lack: a pair of encoders, or an error over the angle of the input."""
    columns = set(record.table)
    if not ({"input_deg", "output_deg"} <= columns or {"crank_deg", "angle_arcmin"} <= columns):
        yield Fault(
            "missing column",
            f"{unit.name}: found {', '.join(sorted(columns - {'line'})) or 'none'}; a record needs input_deg and "
            "output_deg (both encoders), or crank_deg and angle_arcmin; name them under [columns]",
            "fatal",
        )
    if "torque_Nm" not in columns:
        text = f"{unit.name}: no torque_Nm; name its column under [columns.torque_Nm]"
        yield Fault("missing column", text, "fatal")


def record_faults(record: RecordedPasses) -> Iterator[Fault]:
    """All faults of the rows; those that rest on passes are looked for only where there are any."""
    missing = int(np.sum(~record.numeric))
    if missing == len(record):
        yield Fault("no numbers", "no row has numbers for both angles and the torque", "fatal")
        return
    if missing:
        yield Fault("no numbers", f"{missing} of {len(record)} rows lack an angle or a torque and are left out", "note")
    passes = record.passes
    if not len(passes) or record.span_deg * record.orders.ratio < 360.0 * LEAST_TURN:
        text = (
            f"the input turns less than {LEAST_TURN:g} times in every pass; check ratio = {record.orders.ratio:g} and "
            'the units of the columns, or say locked = "input" or "output" of loops'
        )
        yield Fault("standing input", text, "fatal")
        return
    if record.n_intervals < FEWEST_INTERVALS:
        text = f"a pass has rows for {record.n_intervals} intervals of the output angle, {FEWEST_INTERVALS} are needed"
        yield Fault("too few points", f"{text}; record the angles more often", "fatal")
        return
    senses = [np.unique(passes.sense[passes.level == level]) for level in np.unique(passes.level)]
    if record.unit.settings.side == "input" and min(len(ways) for ways in senses) < 2:
        text = (
            "a torque at the input holds the loss of the drive, which cancels only where each load is turned in both "
            "senses at each temperature; add the missing passes, or measure the torque at the output"
        )
        yield Fault("one sense", text, "fatal")
        return
    span = float(np.ptp(record.cells.error))
    if span > LARGEST_ERROR_ARCMIN:
        text = (
            f"the error ranges over {span:.3g} arcmin, {LARGEST_ERROR_ARCMIN:g} are plausible; check "
            f"ratio = {record.orders.ratio:g}, the units of both angles, and the factor of each"
        )
        yield Fault("unit", text, "fatal")
    if len(passes) < FEWEST_BLOCKS:
        text = f"{len(passes)} passes, {FEWEST_BLOCKS} are needed: no effect can be named; repeat them"
        yield Fault("too few points", text, "note")
    if len(np.unique(passes.kind)) == len(passes):
        yield Fault("no repeats", "no pass is repeated: the noise is that of the rows; make each pass twice", "note")




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

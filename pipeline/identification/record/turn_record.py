"""A record of a turning drive, read and judged."""

import re
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.config.files.table_file import shortened_list
from pipeline.constant_kinds import Unit
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.rows import Recorded, recorded_rows
from pipeline.identification.measurement.turning.motion import stretches
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.record.encoders import angles_of, runs_without_jumps, travel
from pipeline.identification.record.orders import orders_of
from pipeline.identification.record.passes import RecordedPasses

FEWEST_INTERVALS = 24
"""Intervals of the output angle from which waves are told apart."""
LARGEST_ERROR_ARCMIN = 120.0
"""Range of the transmission error beyond which the ratio or a column is wrong."""
DEGREES_A_SECOND: Unit = 6.0
"""Of a turn a minute."""
RADIANS_SHARE = 0.005
"""Share by which the angle that was turned may differ from 2 pi for it to be a turn in radians."""
LEAST_TURN = 2.0
"""Turns of the input that a pass makes at least."""


def column_faults(record: Recorded, unit: UnitFile, run: Whole) -> Iterator[Fault]:
    """Columns that the files lack or name by each other: two encoders, or an error over the angle of one end."""
    columns = set(record.table)
    pairs = ({"input_deg", "output_deg"}, {"crank_deg", "angle_arcmin"}, {"output_deg", "angle_arcmin"})
    if not any(pair <= columns for pair in pairs):
        found = ", ".join(sorted({*columns, *record.extra} - {"line"})) or "none"
        text = (
            f"{unit.name}: found {found}; a record needs input_deg and output_deg (both encoders), or crank_deg (the "
            "input's angle) or output_deg with angle_arcmin (the error); name them under [columns]"
        )
        yield Fault("missing column", text, "fatal")
    if "torque_Nm" not in columns:
        text = f"{unit.name}: no torque_Nm; name its column under [columns.torque_Nm], or give torque_Nm of each file"
        yield Fault("missing column", text, "fatal")
    for name in sorted({"input_deg", "output_deg", "crank_deg"} & columns):
        column = getattr(unit.settings.columns, name)
        written = re.search(r"(?<![a-z])(rad|mrad|arcsec|arcmin|rev)(?![a-z])", column.name.lower())
        if written and "unit" not in column.model_fields_set:
            text = f'{unit.name}: the column "{column.name}" is read in deg; give unit under [columns.{name}]'
            yield Fault("unit", text, "fatal")
    if {"input_deg", "output_deg"} <= columns:
        turned, output = (travel(record.quantity(name), run) for name in ("input_deg", "output_deg"))
        if turned < output:
            text = f"output_deg turns by {output:.4g} deg, input_deg by {turned:.4g}; exchange their names in [columns]"
            yield Fault("exchanged columns", text, "fatal")


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
    if abs(record.span_deg / (2 * np.pi) - 1) < RADIANS_SHARE:
        text = f'the output turns by {record.span_deg:.4g}, a turn in radians; give unit = "rad" under [columns]'
        yield Fault("unit", text, "fatal")
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
    if text := _unsigned_torque(record):
        yield Fault("sign", text, "fatal")
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


def _unsigned_torque(record: RecordedPasses) -> str:
    """What says that torques of one sign act against the motion in both senses, or "".

    The twist of a load that acts one way is alike in both senses; that of a brake turns over with the sense, and the
    senses then differ by more than the mean of both does.
    """
    cells, passes = record.cells, record.passes
    sense, torque = passes.sense[cells.owner], record.levels[passes.level[cells.owner]]
    if len(np.unique(torque[torque != 0])) < 2 or np.any(torque < 0) == np.any(torque > 0) or len(np.unique(sense)) < 2:
        return ""
    columns = np.column_stack([torque, sense * torque, sense, np.ones(len(sense))])
    (twist, lag, *_), *_ = np.linalg.lstsq(columns, cells.error, rcond=None)
    if abs(lag) <= abs(twist):
        return ""
    return (
        "torques of one sign, and the error grows with them unlike in both senses, as under a brake that opposes the "
        'motion; say torque_sign = "against_motion", or give the torque its sign'
    )


class TurnRecord(RecordedPasses):
    """A record that was read, and its faults; passes and cells can be computed only of data without a fatal one."""

    @classmethod
    def read(cls, unit: UnitFile) -> "TurnRecord":
        """The record of a unit; raises as ``recorded_rows``."""
        table = recorded_rows(unit)
        run = np.maximum(table.cycle[0], 0) * (int(table.source.max(initial=0)) + 1) + table.source
        faults = tuple(column_faults(table, unit, run))
        is_absolute = unit.settings.angle == "absolute"
        place = error = np.full(len(table.table), np.nan)
        if not faults:
            place, error = angles_of(table, orders_of(unit).ratio, run, is_absolute)
            run = runs_without_jumps(orders_of(unit).ratio * place, run)
        return cls(
            unit=unit,
            place=place,
            error=error,
            torque=_signed_torque(table, unit, orders_of(unit).ratio * place, run),
            time=table.quantity("time_s"),
            temperature=table.quantity("temperature_C"),
            speed=DEGREES_A_SECOND * table.quantity("input_rpm") / orders_of(unit).ratio,
            run=run,
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


def _signed_torque(record: Recorded, unit: UnitFile, turned: Real, run: Whole) -> Real:
    """Torque on the output (n,) [N m]; of a brake against the sense in which the input turns (n,) [deg]."""
    torque = record.quantity("torque_Nm")
    if unit.settings.torque_sign == "signed":
        return torque
    sense, _ = stretches(turned, run, np.zeros(len(run), np.int64), np.isfinite(turned) & np.isfinite(torque))
    return -np.abs(torque) * sense

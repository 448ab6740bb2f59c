"""What is wrong with the record of a turning drive, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.rows import Recorded
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.record.passes import RecordedPasses

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

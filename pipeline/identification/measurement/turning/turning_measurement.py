"""A record of a drive whose crank turns, or of loops, as the settings of the unit say; and what is wrong with it."""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.faults.data_faults import recording_faults
from pipeline.identification.measurement.faults.fault import Fault, fault_of_rows, frequent_fault
from pipeline.identification.measurement.faults.shape_faults import implausible_angle, implausible_torque, largest_span
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.motion import HELD_SHARE, fewest_pitches
from pipeline.identification.measurement.turning.turned_rows import TurnedRows
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.measurement.unit_sections import NEITHER
from pipeline.model.units import TURN_DEG

FEWEST_INTERVALS = 5
"""Intervals of a turn from which two orders of the crank are told apart."""
UNHELD_SHARE = 0.2
"""Share of the rows beside the held torque beyond which it was not held."""
FALLING = 0.1
"""Share of the range of the angle by which it may fall from the smallest to the largest torque."""


def turning_faults(measurement: TurnedRows) -> list[Fault]:
    """All faults of a record; those that rest on turns are looked for only if there are any."""
    faults = [*recording_faults(measurement)]
    if any(fault.severity == "fatal" for fault in faults) or not measurement.numeric.any():
        return faults
    faults += _turns(measurement)
    if any(fault.severity == "fatal" for fault in faults):
        return faults
    faults += _implausible(measurement)
    return [*faults, *_few_point_faults(measurement)]


def _turns(measurement: TurnedRows) -> Iterator[Fault]:
    motion, rows, good = measurement.motion, measurement.rows, measurement.numeric
    if not np.any(motion.turn >= 0):
        text = (
            'the crank makes no half turn at a held torque in any cycle; say locked = "input" or "output" of loops at '
            "a standing crank, and number each pass of a turning one as a cycle"
        )
        yield Fault("standing crank", text, "fatal")
        return
    is_beside = good & (motion.turn < 0)
    text = (
        f"{is_beside.sum()} of {len(rows)} rows lie in less than half a turn, in a turn that is left out, or "
        f"differ by more than {HELD_SHARE:.0%} of the largest torque from the one held"
    )
    advice = "hold a torque over whole turns"
    yield from frequent_fault(rows, is_beside, "torque not held", UNHELD_SHARE, text, advice)
    cut = measurement.is_saturated & good
    if cut.any():
        text = f"the torque is saturated in {cut.sum()} rows, which are left out"
        yield fault_of_rows(rows, cut, "saturation", "note", text)
    if motion.left_out:
        text = f"{motion.left_out} turns of the crank, even over the record, are left out: the others say as much"
        yield Fault("many turns", text, "note")
    if not len(measurement.cells) or motion.width > TURN_DEG / FEWEST_INTERVALS:
        text = (
            f"a turn has too few rows for {FEWEST_INTERVALS} intervals of whole pitches of the pins "
            f"with {FEWEST_COMPARED} rows in each; record the angle more often"
        )
        yield Fault("too few points", text, "fatal")


def _implausible(measurement: TurnedRows) -> Iterator[Fault]:
    unit, cells = measurement.unit, measurement.cells
    design, column = unit.study.design, unit.settings.columns.angle_arcmin
    top, span = float(np.max(np.abs(cells.torque_mean))), float(np.ptp(cells.angle_mean))
    messages = [implausible_torque(cells.torque_mean, unit.rated_torque_Nm)]
    limit = largest_span(design, top)
    message = implausible_angle(span, unit.settings.instrument.angle_resolution_arcmin, limit, column.unit)
    if message and span > limit:
        message += (
            '; or the column is the angle of the output itself: say angle = "absolute", and give crank_deg '
            "factor = -1 where the output turns in the sense in which the crank is counted"
        )
    yield from (Fault("unit", text, "fatal") for text in [*messages, message] if text)
    level = measurement.level
    means = np.array([cells.angle_mean[level == number].mean() for number in np.unique(level)])
    if len(means) > 1 and means[-1] - means[0] < -FALLING * span:
        yield Fault("sign", "the angle falls with rising torque; give one of the two columns factor = -1", "fatal")


def _few_point_faults(measurement: TurnedRows) -> Iterator[Fault]:
    cells, motion = measurement.cells, measurement.motion
    fewest = fewest_pitches(measurement.unit.study.design.cycloid.pins)
    if motion.pitches > fewest:
        text = (
            f"the rows of a turn fill intervals of {motion.width:.3g} deg, {motion.pitches} pitches of the pins, and "
            f"orders near {180 / motion.width:.2g} are blurred; record the angle {motion.pitches / fewest:.2g} times "
            "as often for the finest"
        )
        yield Fault("coarse intervals", text, "note")
    turns, levels = len(np.unique(cells.block)), len(np.unique(measurement.level))
    if turns < FEWEST_BLOCKS:
        needed = f"{turns} turns (cycle x held torque x sense), {FEWEST_BLOCKS} are needed: no effect can be accepted"
        yield Fault("too few points", f"{needed}; repeat them, or hold further torques", "note")
    if not measurement.repeatability.repeats.n:
        advice = "no turn is repeated: the noise is that between neighbouring intervals; measure each turn twice"
        yield Fault("no repeats", advice, "note")
    if len(np.unique(cells.direction)) < 2:
        yield Fault("one sense", "the crank turns in one sense alone: friction cannot be tested", "note")
    if levels < 2:
        yield Fault("one torque", "one torque is held: play and compliance in series cannot be tested", "note")


class TurningMeasurement(TurnedRows):
    """A record of a turning drive: positions are intervals of the crank, branches are turns."""

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the data, fatal ones and notes."""
        return tuple(turning_faults(self))


def read_measurement(unit: UnitFile) -> Measurement:
    """The measurement of a unit.

    Raises
    ------
    InputError : as ``read_rows``.
    """
    return (TurningMeasurement if unit.settings.locked == NEITHER else Measurement).read(unit)

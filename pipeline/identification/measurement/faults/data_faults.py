"""What is wrong with the data of a measured unit, before any model is asked."""

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Index, Truth
from pipeline.config.files.table_file import LARGEST_VALUE
from pipeline.constant_kinds import ShownCount
from pipeline.identification.measurement.enough import FEWEST_SCATTERED
from pipeline.identification.measurement.faults import shape_faults
from pipeline.identification.measurement.faults.branch_faults import branch_faults
from pipeline.identification.measurement.faults.fault import SHOWN_ROWS, Fault, fault_of_rows, frequent_fault
from pipeline.identification.measurement.measured_rows import MeasuredRows
from pipeline.identification.measurement.repeated_branches import mean_loops
from pipeline.identification.measurement.row_filters import SATURATION_RULE
from pipeline.identification.measurement.rows import Rows
from pipeline.identification.measurement.unit_file import UnitFile

CLIPPED_SHARE = 0.05
"""Share of rows at the end of the angle's range from which nothing is known of the curve under load."""
TOLERATED_SHARE = 0.01
"""Share of rows that may be no numbers or jumps of the encoder; more are a fault of the recording."""
SHOWN_COLUMNS: ShownCount = 12
"""Of a header that lacks one."""
TURNING_SHARE = 0.05
"""Crank angles in rows from which the crank was not locked: a loop has tens of rows at the least."""


def recording_faults(measurement: MeasuredRows) -> list[Fault]:
    """Faults of the recording, whatever was measured: columns, numbers, order, files that repeat each other."""
    rows, good = measurement.rows, measurement.numeric
    faults = [*_missing_columns(rows), *_not_numbers(rows)]
    return [*faults, *_order(rows, good), *_duplicates(rows)] if good.any() else faults


def data_faults(measurement: MeasuredRows) -> list[Fault]:
    """All faults of the data; those that rest on numbers are looked for only if there are any."""
    unit, rows, good = measurement.unit, measurement.rows, measurement.numeric
    faults = recording_faults(measurement)
    finite = np.isfinite(rows.torque) & np.isfinite(rows.angle)
    unread = [*_turning_crank(rows, finite)] or [*_constant(rows, finite)]
    faults += unread
    turning = any(fault.kind == "turning crank" for fault in unread)
    if finite.any() and not turning and not any(fault.severity == "fatal" for fault in unread):
        unread += [*_wrapped(rows, finite)]
        faults += unread[-1:] if unread else _implausible(unit, rows, finite & ~measurement.spikes)
    if not good.any() or any(fault.severity == "fatal" for fault in unread):
        return faults
    faults += _left_out(rows, measurement.is_saturated & good, measurement.is_clipped, measurement.spikes)
    usable, blocks = measurement.usable, measurement.branches
    faults += branch_faults(rows, blocks, usable)
    if not any(fault.kind == "disordered rows" for fault in faults):
        faults += _offsets(unit, rows, usable)
    if not any(fault.severity == "fatal" for fault in faults):
        faults += [*_unknown_noise(measurement), *_standing_out(measurement)]
    return faults


def _unknown_noise(measurement: MeasuredRows) -> Iterator[Fault]:
    noise = measurement.repeatability
    if not np.isfinite([noise.repeats.value, noise.within_branch.value]).any():
        text = (
            "the noise, which errors are counted in, is not known: no cycle is repeated, and no branch has the "
            f"{FEWEST_SCATTERED} rows that its scatter takes; measure more rows a branch, or each cycle twice"
        )
        yield Fault("too few points", text, "fatal")


def _standing_out(measurement: MeasuredRows) -> Iterator[Fault]:
    repeats = measurement.repeatability.repeats.value
    loops = mean_loops(measurement.branches, measurement.cells, measurement.usable_rows)
    for position, distance, largest_distance in shape_faults.standing_out(loops, repeats):
        text = (
            f"the loop at crank {measurement.rows.cranks[position]:g} deg differs by {distance:.3g} arcmin from all "
            f"others, which differ by {largest_distance:.3g} arcmin at most: is the output or its locking plate loose "
            "there? Measure that position again after mounting it anew"
        )
        yield Fault("position stands out", text, "note")


def _missing_columns(rows: Rows) -> Iterator[Fault]:
    for file, column, quantity, present in rows.missing:
        constant = " or give it as a constant of the file" if quantity in ("crank_deg", "cycle") else ""
        header = ", ".join(map(str, present[:SHOWN_COLUMNS])) + ", ..." * (len(present) > SHOWN_COLUMNS)
        advice = f"name the column of {quantity} in [columns.{quantity}]{constant}"
        yield Fault("missing column", f"{file} has no column {column!r}, its header is: {header}; {advice}", "fatal")


def _not_numbers(rows: Rows) -> Iterator[Fault]:
    missing_columns = {(rows.files.index(column.file), column.quantity) for column in rows.missing}
    bad = {
        "crank_deg": rows.position < 0,
        "cycle": rows.is_misnumbered & (rows.cycle == -1),
        "torque_Nm": ~np.isfinite(rows.torque),
        "angle_arcmin": ~np.isfinite(rows.angle),
        "time_s": None if rows.time is None else ~np.isfinite(rows.time),
        "temperature_C": None if rows.temperature is None else ~np.isfinite(rows.temperature),
        "command_torque_Nm": None if rows.command is None else ~np.isfinite(rows.command),
    }
    for quantity, mask in bad.items():
        if mask is None:
            continue
        mask = mask & ~np.isin(rows.file, [file for file, name in missing_columns if name == quantity])
        fault_text = "no whole number" if quantity == "cycle" else f"no number up to {LARGEST_VALUE:g}"
        text = f"{quantity} is {fault_text} in {mask.sum()} of {len(rows)} rows"
        yield from frequent_fault(rows, mask, "not a number", TOLERATED_SHARE, text, "correct the file")


def _order(rows: Rows, good: Truth) -> Iterator[Fault]:
    last_row: dict[tuple[int, int], int] = {}
    backward_rows: list[int] = []
    repeated_rows: list[int] = []
    for number, (position, cycle, run) in enumerate(rows.runs()):
        if rows.time is not None:
            valid_rows = np.flatnonzero(good[run] & np.isfinite(rows.time[run])) + run.start
            backward_rows += valid_rows[1:][np.diff(rows.time[valid_rows]) < 0].tolist()
        if good[run].any() and last_row.setdefault((position, cycle), number) != number:
            repeated_rows.append(run.start)
    if backward_rows:
        text = "time falls within a cycle; rows must be in time order"
        yield fault_of_rows(rows, np.array(backward_rows), "decreasing time", "fatal", text)
    if repeated_rows:
        places = [f" at {rows.cranks[rows.position[row]]:g} deg" if len(rows.cranks) else "" for row in repeated_rows]
        listing = ", ".join(
            f"{rows.cycle[row]}{place}" for row, place in zip(repeated_rows[:SHOWN_ROWS], places, strict=False)
        )
        text = f"cycle {listing} appears again after another cycle or file; order the rows, or number the cycles on"
        yield fault_of_rows(rows, np.array(repeated_rows), "disordered rows", "fatal", text)


def _duplicates(rows: Rows) -> Iterator[Fault]:
    first_file: dict[bytes, int] = {}
    for file, name in enumerate(rows.files):
        of_file = rows.file == file
        content = np.stack([rows.torque[of_file], rows.angle[of_file]]).tobytes()
        original_file = first_file.setdefault(content, file)
        if original_file != file:
            text = f"{name} repeats {rows.files[original_file]} value for value; remove one"
            yield fault_of_rows(rows, of_file, "duplicate file", "fatal", text)


def _turning_crank(rows: Rows, good: Truth) -> Iterator[Fault]:
    if good.any() and len(rows.cranks) > TURNING_SHARE * good.sum() and len(rows.cranks) > 1:
        text = (
            f"crank_deg takes {len(rows.cranks)} values in {good.sum()} rows: the crank turns within a cycle, or its "
            "reading jitters. A record of a turning drive that has a design is read where unit.toml says "
            'locked = "neither"; of loops give the angle of the locked position, rounded or as a constant of the file'
        )
        yield Fault("turning crank", text, "fatal")


def _wrapped(rows: Rows, good: Truth) -> Iterator[Fault]:
    """Angles that jump by a turn from row to row, as of an encoder that starts again at its end."""
    numbers = np.flatnonzero(good)
    is_within = np.diff(rows.position[numbers]) == 0
    turns = np.abs(np.round(np.diff(rows.angle[numbers]) / shape_faults.REVOLUTION)) * is_within
    is_jump = turns == 1
    if is_jump.any() and np.max(turns) == 1:
        text = (
            f"the angle jumps by a turn (360 degrees) at {is_jump.sum()} rows, as of an encoder that starts again; "
            "add or subtract a turn in the rows after each jump"
        )
        yield fault_of_rows(rows, numbers[1:][is_jump], "wrapped angle", "fatal", text)


def _constant(rows: Rows, good: Truth) -> Iterator[Fault]:
    measured_quantities = {"torque_Nm": rows.torque, "angle_arcmin": rows.angle, "command_torque_Nm": rows.command}
    for quantity, values in measured_quantities.items():
        for position, crank in enumerate(rows.cranks):
            rows_here = good & (rows.position == position)
            if values is not None and rows_here.any() and np.ptp(values[rows_here]) == 0:
                constant = f"{quantity} is {values[rows_here][0]:g} in all rows at crank {crank:g} deg"
                text = f"{constant}; is it the right column?"
                yield fault_of_rows(rows, rows_here, "constant column", "fatal", text)
    time = np.empty(0) if rows.time is None else rows.time[np.isfinite(rows.time)]
    if len(time) > 1 and np.ptp(time) == 0:
        yield Fault("constant column", "time_s does not vary: effects of time cannot be tested", "note")


def _implausible(unit: UnitFile, rows: Rows, good: Truth) -> Iterator[Fault]:
    resolution = unit.settings.instrument.angle_resolution_arcmin
    findings = [shape_faults.implausible_torque(rows.torque[good], unit.rated_torque_Nm)]
    loops = [good & (rows.position == position) for position in np.unique(rows.position[good])]
    span = float(max(np.ptp(rows.angle[loop]) for loop in loops))
    top = float(np.max(np.abs(rows.torque[good])))
    limit = shape_faults.largest_span(unit.study.design, top) if unit.design_study else np.inf
    column = unit.settings.columns.angle_arcmin
    findings.append(shape_faults.implausible_angle(span, resolution, limit, column.unit))
    if all(shape_faults.columns_exchanged(rows.torque[loop], rows.angle[loop]) for loop in loops):
        text = (
            "the loops are flat near zero torque and steep under load, as torque over angle is: exchange the columns "
            "of torque_Nm and angle_arcmin in [columns]"
        )
        yield Fault("swapped columns", text, "fatal")
    elif all(_gains_energy(rows, loop) for loop in loops):
        lag = "" if rows.time is not None else ". If the torque sensor lags behind, give the column time_s"
        text = (
            "every loop gives back more work than it takes, which no drive does: exchange the columns of torque_Nm and "
            f"angle_arcmin in [columns], put the rows into the order of time, or give one column factor = -1{lag}"
        )
        yield Fault("swapped columns", text, "fatal")
    yield from (Fault("unit", message, "fatal") for message in findings if message)
    settings = unit.settings
    if unit.design_study and not any(findings):
        least = shape_faults.least_span(unit.study.design, top)
        most = shape_faults.largest_span(unit.study.design, top, shape_faults.LIKELY_TWIST)
        if not least <= span <= most:
            usual = f"have {most:.3g} at most" if span > most else f"twist by {least:.3g} at least"
            text = f"the angle spans {span:.4g} arcmin, a drive of this design is likely to {usual}"
            yield Fault("unit", f"{text}: check unit and factor in [columns]", "note")
    if settings.generic and settings.side == "output" and settings.locked == "output" and not any(findings):
        doubt = shape_faults.doubtful_side(top, span, settings.generic.rated_torque_Nm, settings.generic.ratio)
        yield from (Fault("unit", doubt, "note") for _ in range(bool(doubt)))
    falling = [
        f"{crank:g}"
        for position, crank in enumerate(rows.cranks)
        if _angle_falls(rows, np.flatnonzero(good & (rows.position == position)))
    ]
    if falling:
        fall = f"the angle falls with rising torque at crank {', '.join(falling)} deg"
        yield Fault("sign", f"{fall}; give one of the two columns factor = -1", "fatal")


def _gains_energy(rows: Rows, loop: Truth) -> bool:
    """Whether rows of a position give back more work than they take. Timed rows may hold a lag of the sensor."""
    time = None if rows.time is None else rows.time[loop]
    return shape_faults.gains_energy(rows.torque[loop], rows.angle[loop], rows.cycle[loop], time)


def _angle_falls(rows: Rows, file_rows: Index) -> bool:
    """Whether the mean angle at high torque is below that at low torque by more than a tenth of the angle's range."""
    torque, angle = rows.torque[file_rows], rows.angle[file_rows]
    if file_rows.size < 4:
        return False
    low, high = np.quantile(torque, [0.25, 0.75])
    return bool(angle[torque >= high].mean() - angle[torque <= low].mean() < -0.1 * np.ptp(angle))


def _left_out(rows: Rows, cut: Truth, is_clipped: Truth, jumps: Truth) -> Iterator[Fault]:
    if is_clipped.any():
        ends = f"{rows.angle[is_clipped].min():.4g} to {rows.angle[is_clipped].max():.4g} arcmin"
        text = (
            f"the angle stands still at the ends of its range ({ends}) in {is_clipped.sum()} of {len(rows)} rows while "
            "the torque goes on"
        )
        yield from frequent_fault(rows, is_clipped, "clipped angle", CLIPPED_SHARE, text, "measure with a wider range")
    if cut.any():
        message = f"the torque is saturated in {cut.sum()} rows; {SATURATION_RULE}"
        yield fault_of_rows(rows, cut, "saturation", "note", message)
    text = f"the angle jumps out and back in {jumps.sum()} rows, three in a row at most"
    yield from frequent_fault(rows, jumps, "encoder jump", TOLERATED_SHARE, text, "check the encoder")


def _offsets(unit: UnitFile, rows: Rows, usable: Truth) -> Iterator[Fault]:
    """Cycles of a position, or positions with a common offset, that lie further apart than their loops are high."""
    previous: tuple[int, int, float, float] | None = None
    for position, cycle, run in rows.runs():
        run_rows = np.flatnonzero(usable[run]) + run.start
        if not run_rows.size:
            continue
        low, high = rows.angle[run_rows].min(), rows.angle[run_rows].max()
        if previous is not None and (previous[0] == position or unit.settings.offset == "common"):
            shift = (low + high) / 2 - (previous[2] + previous[3]) / 2
            if abs(shift) > max(high - low, previous[3] - previous[2]):
                is_same = previous[0] == position
                advice = "the zero of the angle was lost between them" if is_same else 'say offset = "per_position"'
                text = (
                    f"cycle {cycle} at crank {rows.cranks[position]:g} deg lies {shift:+.4g} arcmin from cycle "
                    f"{previous[1]} at crank {rows.cranks[previous[0]]:g} deg, more than the loop is high; {advice}"
                )
                yield fault_of_rows(rows, run_rows, "mixed offsets", "fatal", text)
        previous = position, cycle, low, high

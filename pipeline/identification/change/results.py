"""What a comparison of two measurements leaves behind: its sentence, verdict.json and tables."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.engine.store import write_json, write_tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.errors import InputError
from pipeline.identification.change.comparison import Change, Comparison, compare_states
from pipeline.identification.change.loops import State
from pipeline.identification.change.pattern import Pattern, pattern
from pipeline.identification.change.scatter import FEWEST_FREEDOM
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_sections import NEITHER
from pipeline.identification.selection.statements.verdict import VERDICT_FILE

CHANGES = Table(
    "changes",
    "number of the loops of one size",
    (
        Column("kind", "label", "", "name of the number"),
        Column("loops", "label", "", "largest torque of the loops"),
        Column("title", "label", "", "of the number"),
        Column("unit", "label", "", "of the number in both states"),
        Column("before", "float64", "see unit", "mean over the common positions, geometric of a positive number"),
        Column("after", "float64", "see unit", "the same of the second state"),
        Column("change_unit", "label", "", "of all columns below: 1 where they are shares of a positive number"),
        Column("change", "float64", "see change_unit", "second state less first, or its share of the first"),
        *interval_columns("see change_unit", "95 % interval; null: scatter unknown"),
        Column("detectable", "float64", "see change_unit", "growth that would be shown with a chance of 80 %"),
        Column("scatter", "float64", "see change_unit", "standard deviation that mounting adds at a position"),
        Column("p", "float64", "1", "of no change, this number by itself"),
        Column("p_family", "float64", "1", "of no change, all numbers counted: of their largest t"),
        Column("freedom", "int32", "1", "degrees of freedom that the scatter is known with"),
        Column("named", "bool", "", "whether the verdict names it"),
    ),
)
POSITIONS = Table(
    "positions",
    "number of the loops of one size at a position in a state",
    (
        Column("state", "label", "", "unit"),
        Column("position", "label", "", "name of the position, or its crank angle"),
        Column("kind", "label", "", "name of the number"),
        Column("loops", "label", "", "largest torque of the loops"),
        Column("value", "float64", "see changes", "read off the mean loop"),
    ),
)
LOOPS = Table(
    "loops",
    "point of the mean loop of one size at a position in one of the two states",
    (
        Column("state", "label", "", "unit"),
        Column("position", "label", "", "name of the position, or its crank angle"),
        Column("loops", "label", "", "largest torque of the loops"),
        Column("torque_Nm", "float64", "N m", "torque"),
        Column("rising_arcmin", "float64", "arcmin", "angle while the torque rises, mean angle of the loop removed"),
        Column("falling_arcmin", "float64", "arcmin", "angle while the torque falls"),
    ),
)


@dataclass(frozen=True)
class ChangeAnswer:
    """Two measurements of a drive, what changed between them, and what follows from it.

    Attributes
    ----------
    before, after : states.
    comparison : of their loops.
    positions : whether they kept their pattern.
    further : further states, which give the scatter of mounting.
    """

    before: State
    after: State
    comparison: Comparison
    positions: Pattern
    further: tuple[State, ...] = ()

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        comparison = self.comparison
        if comparison.named_changes:
            changes = "; ".join(change_text(change) for change in comparison.named_changes)
            return f"Shown: {changes}. A new mounting that moves all positions alike would look the same."
        if comparison.freedom < FEWEST_FREEDOM:
            count = len(comparison.labels)
            return (
                f"No change is shown: the states share {count} position{'s' * (count > 1)}, and the scatter of "
                "mounting is unknown."
            )
        if comparison.near_changes:
            return (
                "No change is shown beyond the scatter of mounting. Significant by themselves, before "
                f"{len(comparison.changes)} tests are counted: {'; '.join(map(change_text, comparison.near_changes))}."
            )
        return "No change is shown: every number of the loops differs by no more than the scatter of mounting."

    @property
    def limits_sentence(self) -> str:
        """Sizes of change that would be shown, where nothing is named and the scatter is known."""
        limits = () if self.comparison.named_changes else detection_limits(self.comparison)
        if not limits:
            return ""
        return (
            f"Detectable with 80 % power: {', '.join(limits)}, by the scatter over the positions of "
            f"{2 + len(self.further)} states ({self.comparison.freedom} degrees of freedom)."
        )

    @property
    def unmeasured_sentence(self) -> str:
        """Numbers that these loops do not show, in words; empty without any."""
        titles = [number.title for number in self.comparison.table.unmeasured_numbers]
        if not titles:
            return ""
        return f"Not measurable in these loops, which do not load the spring at every position: {'; '.join(titles)}."

    @property
    def pattern_sentence(self) -> str:
        """Whether the positions kept what is their own."""
        share = self.positions
        if not math.isfinite(share.p):
            return "Whether positions kept their pattern can be tested with 4 or more positions in both measurements."
        n_as_good = round(share.p * share.pairings)
        rank = f"{n_as_good} of {share.pairings} pairings, the true one included, agree as well as it"
        if share.persists:
            return f"The positions kept their pattern: {rank}."
        return (
            f"It is not shown that the positions kept their pattern ({rank}). A new assembly changes it, and so does a "
            "mounting that is not repeatable."
        )

    @property
    def advice(self) -> str:
        """What to measure next."""
        named_changes = self.comparison.named_changes
        if named_changes:
            kinds = dict.fromkeys(change.number.kind for change in named_changes)
            return "Measure it directly: " + "; ".join(f"{kind.title}, by {kind.measurement}" for kind in kinds) + "."
        if self.comparison.freedom < FEWEST_FREEDOM:
            return "Measure 3 or more crank positions in both states, or name further states of the drive."
        return (
            "More crank positions narrow the intervals. Further states of the drive, or the same state mounted again, "
            "give the scatter of mounting with more degrees of freedom (make changed A= B= ALSO=)."
        )


def detection_limits(comparison: Comparison) -> tuple[str, ...]:
    """For each number the change that would be shown with a chance of 80 %; empty where the scatter is unknown."""
    return tuple(
        f"{change.number.title} {_percent_or_unit(change.detectable, change)}"
        for change in comparison.changes
        if math.isfinite(change.detectable)
    )


def change_text(change: Change) -> str:
    """A change with its interval in words."""
    size = _percent_or_unit(change.mean, change)
    low, high = (_percent_or_unit(value, change) for value in (change.low, change.high))
    return f"{change.words} ({size}, 95 % interval {low} to {high}; loops up to {change.number.size.label})"


def answer(
    measurement_before: Measurement, measurement_after: Measurement, further: Sequence[Measurement] = ()
) -> ChangeAnswer:
    """What changed between two measurements of one drive.

    Parameters
    ----------
    further : other states of the drive, which give the scatter of mounting.

    Raises
    ------
    InputError : a measurement is of a turning crank, has a fatal fault or is named twice, or they have nothing in
        common.
    """
    first_state, second_state, *further_states = comparable_states([measurement_before, measurement_after, *further])
    comparison = compare_states(first_state, second_state, further_states)
    return ChangeAnswer(
        first_state, second_state, comparison, pattern(comparison.table, comparison.labels), tuple(further_states)
    )


def comparable_states(measurements: Sequence[Measurement]) -> list[State]:
    """States of measurements whose loops can be compared.

    Raises
    ------
    InputError : a measurement is of a turning crank, has a fatal fault or is named twice, or another end is locked.
    """
    turning = [measurement.unit.name for measurement in measurements if measurement.unit.settings.locked == NEITHER]
    if turning:
        raise InputError(f"{', '.join(turning)}: the crank turns; only loops with one end locked are compared")
    faults = [f"{measurement.unit.name}: {fault.line}" for measurement in measurements for fault in measurement.fatal]
    folders = [measurement.unit.folder.resolve() for measurement in measurements]
    faults += [
        f"{folder.name}: named {folders.count(folder)} times; each state counts once: name another one, or leave it out"
        for folder in dict.fromkeys(folders)
        if folders.count(folder) > 1
    ]
    ends = list(dict.fromkeys(measurement.unit.settings.locked for measurement in measurements))
    if len(ends) > 1:
        ends_text = " and ".join(f'"{end}"' for end in ends)
        faults.append(f"locked = {ends_text}; measurements are compared with one end locked")
    if faults:
        raise InputError(faults)
    return [State.from_measurement(measurement) for measurement in measurements]


def write(change_answer: ChangeAnswer, folder: Path) -> dict[str, pd.DataFrame]:
    """Write tables and, last, the verdict into ``folder``; the frames by name."""
    comparison = change_answer.comparison
    tables = {CHANGES: change_rows(comparison), POSITIONS: position_rows(comparison), LOOPS: loop_rows(comparison)}
    frames = write_tables(tables, folder)
    write_json(folder / VERDICT_FILE, content(change_answer))
    return frames


def content(change_answer: ChangeAnswer) -> dict[str, Any]:
    """Content of verdict.json."""
    comparison = change_answer.comparison
    return {
        "before": change_answer.before.name,
        "after": change_answer.after.name,
        "verdict": comparison.verdict,
        "sentence": change_answer.sentence,
        "pattern": change_answer.pattern_sentence,
        "pattern_p": change_answer.positions.p if math.isfinite(change_answer.positions.p) else None,
        "advice": change_answer.advice,
        "named": [_change_record(change) for change in comparison.named_changes],
        "near": [_change_record(change) for change in comparison.near_changes],
        "detectable": [] if comparison.named_changes else list(detection_limits(comparison)),
        "unmeasured": [number.title for number in comparison.table.unmeasured_numbers],
        "others": [state.name for state in change_answer.further],
        "positions": list(comparison.labels),
        "data_faults": {
            state.name: [asdict(fault) for fault in state.measurement.faults]
            for state in (change_answer.before, change_answer.after, *change_answer.further)
        },
    }


def _change_record(change: Change) -> dict[str, Any]:
    return {
        "words": change.words,
        "kind": change.number.kind.name,
        "loops": change.number.size.label,
        "change": change.mean,
        "unit": change.unit,
        "ci_low": change.low,
        "ci_high": change.high,
        "p": change.p,
        "p_family": change.p_family,
    }


def change_rows(comparison: Comparison) -> Columns:
    """Columns of `CHANGES`."""
    changes = comparison.changes
    names = ("before", "after", "low", "high", "mean", "detectable", "scatter", "p", "p_family")
    values = {name: np.array([getattr(change, name) for change in changes]) for name in names}
    return {
        "kind": [change.number.kind.name for change in changes],
        "loops": [change.number.size.label for change in changes],
        "title": [change.number.kind.title for change in changes],
        "unit": [change.number.kind.unit for change in changes],
        "before": values["before"],
        "after": values["after"],
        "change_unit": [change.unit for change in changes],
        "change": values["mean"],
        "ci_low": values["low"],
        "ci_high": values["high"],
        **{name: values[name] for name in names[5:]},
        "freedom": np.full(len(changes), comparison.freedom, np.int32),
        "named": np.array([change.is_shown for change in changes]),
    }


def position_rows(comparison: Comparison) -> Columns:
    """Columns of `POSITIONS`, of all states."""
    table = comparison.table
    rows = [
        (table.states[state].name, label, number.kind.name, number.size.label, value)
        for state, label, values in zip(table.state, table.label, table.values, strict=True)
        for number, value in zip(table.numbers, values, strict=True)
    ]
    return POSITIONS.columns_of_rows(rows)


def loop_rows(comparison: Comparison) -> Columns:
    """Columns of `LOOPS`, of the two states at the positions that both have."""
    parts = list(_loop_parts(comparison))
    lengths = [len(loop.torque) for *_, loop in parts]
    means = [float(loop.middle.mean()) for *_, loop in parts]
    return {
        "state": np.repeat([state for state, *_ in parts], lengths),
        "position": np.repeat([label for _, label, *_ in parts], lengths),
        "loops": np.repeat([size for _, _, size, _ in parts], lengths),
        "torque_Nm": np.concatenate([loop.torque for *_, loop in parts]),
        "rising_arcmin": np.concatenate([loop.rising - mean for (*_, loop), mean in zip(parts, means, strict=True)]),
        "falling_arcmin": np.concatenate([loop.falling - mean for (*_, loop), mean in zip(parts, means, strict=True)]),
    }


def _loop_parts(comparison: Comparison) -> Iterator[tuple[str, str, str, Any]]:
    """State, position, size and loop of the positions that both states have."""
    table = comparison.table
    for number, label, loops in zip(table.state, table.label, table.loops, strict=True):
        if number < 2 and label in comparison.labels:
            for size, loop in loops.items():
                yield table.states[number].name, label, size.label, loop


def _percent_or_unit(value: float, change: Change) -> str:
    scale, unit = (100, "%") if change.unit == "1" else (1, change.unit)
    return f"{scale * value:+.3g} {unit}"

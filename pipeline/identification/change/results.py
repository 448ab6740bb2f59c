"""What a comparison of two measurements leaves behind: its sentence, verdict.json and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.engine.store import write_atomic, write_json
from pipeline.engine.table import Column, Columns, Table
from pipeline.errors import InputError
from pipeline.identification.change.comparison import FEWEST_POSITIONS, Change, Comparison, compared
from pipeline.identification.change.kinds import KINDS
from pipeline.identification.change.pairing import Pair, State, pairs
from pipeline.identification.change.pattern import Pattern, pattern
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import NEITHER

VERDICT_FILE = "verdict.json"
CHANGES = Table(
    "changes",
    "kind of change, with all others equal and with all others free",
    (
        Column("kind", "label", "", "name"),
        Column("others", "label", "", "equal in both states, or free at each position, as mounting makes them differ"),
        Column("title", "label", "", "of the number that differs"),
        Column("unit", "label", "", "of change and interval"),
        Column("change", "float64", "see unit", "mean over the positions, second state less first"),
        Column("ci_low", "float64", "see unit", "lower end of the 95 % interval; null: too few positions"),
        Column("ci_high", "float64", "see unit", "upper end"),
        Column("p", "float64", "1", "of no change, this kind by itself"),
        Column("p_family", "float64", "1", "of no change, all tests of the pair counted: of their largest t"),
        Column("detectable", "float64", "see unit", "size that would have been sure with a chance of 95 %"),
        Column("freedom", "int32", "1", "degrees of freedom that the scatter over the positions is known with"),
        Column("held_out_share", "float64", "1", "held-out rms of the difference, in that of no change"),
        Column("named", "bool", "", "whether the verdict names it"),
    ),
)
POSITIONS = Table(
    "positions",
    "kind of change at a crank position, with all others equal and with all others free",
    (
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("kind", "label", "", "name"),
        Column("others", "label", "", "equal or free"),
        Column("change", "float64", "see changes", "estimated at this position alone"),
        Column("without_floors", "float64", "1", "rms of the difference without the change, in noise"),
        Column("held_out_floors", "float64", "1", "the same with the mean change of the other positions"),
    ),
)
DIFFERENCE = Table(
    "difference",
    "cell of the second state that has a counterpart in the first",
    (
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("cycle", "int32", "1", "load cycle of the second state"),
        Column("direction", "int32", "1", "+1 where the torque rises, -1 where it falls"),
        Column("torque_Nm", "float64", "N m", "mean torque of the rows"),
        Column("sigma_arcmin", "float64", "arcmin", "noise of the cell"),
        Column("difference_arcmin", "float64", "arcmin", "angle of the second state less the first, offset removed"),
        Column("without_arcmin", "float64", "arcmin", "what mounting may have changed, fitted without the change"),
        Column("held_out_arcmin", "float64", "arcmin", "the change of the other positions, mounting fitted beside it"),
    ),
)


@dataclass(frozen=True)
class ChangeAnswer:
    """Two measurements of a drive and what is said of them.

    Attributes
    ----------
    before, after : states.
    comparison : comparison over the positions of both.
    positions : whether they kept their pattern.
    further : further states, which tell how far mounting scatters.
    """

    before: State
    after: State
    comparison: Comparison
    positions: Pattern
    further: tuple[State, ...] = ()

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        named_changes, count = self.comparison.named, len(self.comparison.models)
        if not named_changes and not self.comparison.near:
            return f"No change is shown: {self._nothing(count)}"
        texts = [f"{change.words} ({_numbers(change)})" for change in named_changes or self.comparison.near]
        gain = 100 * (1 - self.comparison.best.gain)
        removed = f"removes {gain:.0f} % of the difference at positions that it was not "
        if named_changes:
            return f"Shown: {', or '.join(texts)}; this {removed}estimated at."
        return (
            f"No change is shown beyond what mounting may do. Nearest: {', or '.join(texts)}, which {removed}estimated "
            "at; the interval is of 95 % by itself, and of pairs without a change one in seven has one."
        )

    def _nothing(self, count: int) -> str:
        floors = float(np.sqrt(np.mean(self.comparison.nothing**2)))
        differ = f"the curves differ by {floors:.1f} noise floors"
        if count < FEWEST_POSITIONS:
            return (
                f"{differ} at {count} position{'s' * (count > 1)}, and what mounting the drive again changes by itself "
                f"is known only from {FEWEST_POSITIONS} positions on."
            )
        return f"{differ}, and nothing that is alike at all {count} positions explains a tenth of it."

    @property
    def limits_sentence(self) -> str:
        """What could hide, where nothing is named and the scatter over the positions is known."""
        limits = () if self.comparison.named else detection_limits(self.comparison)
        if not limits:
            return ""
        sizes = ", ".join(limits)
        states, freedom = 2 + len(self.further), self.comparison.best.freedom
        return (
            f"What could hide: a change smaller than {sizes}, which would have been sure with a chance of 95 % by the "
            f"scatter over the positions of {states} states ({freedom} degrees of freedom)."
        )

    @property
    def pattern_sentence(self) -> str:
        """Whether the positions kept what is their own."""
        share = self.positions
        if not math.isfinite(share.p):
            return f"Whether positions kept their pattern takes {FEWEST_POSITIONS} of them in both measurements."
        rank = f"of {share.pairings} pairings of the positions {100 * share.p:.0f} % agree as well as the true one"
        if share.persists:
            return f"The positions kept their pattern: {rank}."
        return (
            f"It is not shown that the positions kept their pattern ({rank}): a new assembly shuffles it, and so does "
            "a mounting that does not return."
        )

    @property
    def advice(self) -> str:
        """What to measure next."""
        if len(self.comparison.models) < FEWEST_POSITIONS:
            return f"Measure {FEWEST_POSITIONS} or more crank positions in both states."
        kinds = [kind for change in self.comparison.named for kind in change.kinds]
        if len(self.comparison.named) > 1:
            return "; ".join(f"{kind.title}: {kind.told_apart_by}" for kind in dict.fromkeys(kinds)) + "."
        if not kinds:
            return (
                "More crank positions: the interval narrows with their number. Further states of the drive, or the "
                "same mounted again, tell what mounting alone does: name them too (make changed A= B= ALSO=)."
            )
        return ""


def detection_limits(comparison: Comparison) -> tuple[str, ...]:
    """By kind the change that would have been sure with a chance of 95 %; nothing with too few positions.

    Of the two tests of a kind, others equal or free, the one that shows the smaller change.
    """
    if not comparison.beside:
        return ()
    limits = []
    for kind, single, mounted in zip(KINDS, comparison.singles, comparison.beside, strict=True):
        scale, unit = (100, "%") if kind.unit == "1" else (1, kind.unit)
        limit = scale * min(float(single.detectable[0]), float(mounted.detectable[0]))
        limits.append(f"{limit:.2g} {unit} of {kind.title.removesuffix(', as a share')}")
    return tuple(limits)


def answer(
    measurement_before: Measurement, measurement_after: Measurement, further: Sequence[Measurement] = ()
) -> ChangeAnswer:
    """What changed between two measurements of one drive.

    Parameters
    ----------
    further : other states of the drive, which tell how far mounting scatters.

    Raises
    ------
    InputError : a measurement is of a turning crank, has a fatal fault or is named twice, or they have nothing in
        common, or a further one lacks a position.
    """
    measurements = (measurement_before, measurement_after, *further)
    turning = [measurement.unit.name for measurement in measurements if measurement.unit.settings.locked == NEITHER]
    if turning:
        raise InputError(
            f"{', '.join(turning)}: the crank turns; states are compared by loops at a standing crank alone"
        )
    faults = [f"{measurement.unit.name}: {fault.line}" for measurement in measurements for fault in measurement.fatal]
    folders = [measurement.unit.folder.resolve() for measurement in measurements]
    faults += [
        f"{folder.name}: named {folders.count(folder)} times; each state counts once: name another one, or leave it out"
        for folder in dict.fromkeys(folders)
        if folders.count(folder) > 1
    ]
    ends = [measurement.unit.settings.locked for measurement in measurements]
    if len(set(ends)) > 1:
        ends_text = " and ".join(f'"{end}"' for end in ends)
        faults.append(f"locked = {ends_text}; measurements are compared with one end locked")
    if faults:
        raise InputError(faults)
    first, second, *further_states = (State.of(measurement) for measurement in measurements)
    results = pairs(first, second)
    cranks = [pair.crank_deg for pair in results]
    comparison = compared(results, [_at(cranks, first, state) for state in further_states])
    return ChangeAnswer(first, second, comparison, pattern(first, second, cranks), tuple(further_states))


def _at(cranks: Sequence[float], first: State, state: State) -> list[Pair]:
    """The pairs of a further state at crank angles [deg]."""
    by_crank = {pair.crank_deg: pair for pair in pairs(first, state)}
    gaps = [f"{crank:g}" for crank in cranks if crank not in by_crank]
    if gaps:
        raise InputError(
            f"{state.measurement.unit.name}: nothing to compare at {', '.join(gaps)} deg; a further state tells the "
            "scatter where it has every position of the two, or leave it out"
        )
    return [by_crank[crank] for crank in cranks]


def write(change_answer: ChangeAnswer, folder: Path) -> None:
    """Write tables and, last, the verdict into ``folder``."""
    for table, columns in (
        (CHANGES, change_rows(change_answer.comparison)),
        (POSITIONS, position_rows(change_answer.comparison)),
        (DIFFERENCE, difference_rows(change_answer.comparison)),
    ):
        write_atomic(folder / f"{table.name}.parquet", table.part(columns).data)
    write_json(folder / VERDICT_FILE, _verdict(change_answer))


def _verdict(change_answer: ChangeAnswer) -> dict[str, Any]:
    identification = change_answer.comparison
    return {
        "before": change_answer.before.measurement.unit.name,
        "after": change_answer.after.measurement.unit.name,
        "verdict": identification.verdict,
        "sentence": change_answer.sentence,
        "pattern": change_answer.pattern_sentence,
        "pattern_p": change_answer.positions.p if math.isfinite(change_answer.positions.p) else None,
        "advice": change_answer.advice,
        "named": [_told(change) for change in identification.named],
        "near": [_told(change) for change in identification.near],
        "could_hide": [] if identification.named else list(detection_limits(identification)),
        "others": [state.measurement.unit.name for state in change_answer.further],
        "positions_deg": [model.pair.crank_deg for model in identification.models],
        "drives": [asdict(model.drive) for model in identification.models],
        "data_faults": {
            state.measurement.unit.name: [asdict(fault) for fault in state.measurement.faults]
            for state in (change_answer.before, change_answer.after, *change_answer.further)
        },
    }


def _told(change: Change) -> dict[str, Any]:
    """A change with its kinds' intervals."""
    columns = (values.tolist() for values in (change.mean, change.low, change.high, change.p))
    return {
        "words": change.words,
        "held_out_share": change.gain,
        "kinds": {
            kind.name: {"change": mean, "unit": kind.unit, "ci_low": low, "ci_high": high, "p": p}
            for kind, mean, low, high, p in zip(change.kinds, *columns, strict=True)
        },
    }


def change_rows(comparison: Comparison) -> Columns:
    """Columns of `CHANGES`."""
    named_keys = {(kind.name, change.other_kinds) for change in comparison.named for kind in change.kinds}
    changes = [*comparison.singles, *comparison.beside]
    kinds = [change.kinds[0] for change in changes]
    return {
        "kind": [kind.name for kind in kinds],
        "others": [change.other_kinds for change in changes],
        "title": [kind.title for kind in kinds],
        "unit": [kind.unit for kind in kinds],
        "change": np.array([change.mean[0] for change in changes]),
        "ci_low": np.array([change.low[0] for change in changes]),
        "ci_high": np.array([change.high[0] for change in changes]),
        "p": np.array([change.p[0] for change in changes]),
        "p_family": np.array([change.p_family[0] for change in changes]),
        "detectable": np.array([change.detectable[0] for change in changes]),
        "freedom": np.array([change.freedom for change in changes], np.int32),
        "held_out_share": np.array([change.gain for change in changes]),
        "named": np.array([(change.kinds[0].name, change.other_kinds) in named_keys for change in changes]),
    }


def position_rows(comparison: Comparison) -> Columns:
    """Columns of `POSITIONS`."""
    changes = [*comparison.singles, *comparison.beside]
    n = len(comparison.models)
    return {
        "crank_deg": np.tile([model.pair.crank_deg for model in comparison.models], len(changes)),
        "kind": [change.kinds[0].name for change in changes for _ in range(n)],
        "others": [change.other_kinds for change in changes for _ in range(n)],
        "change": np.concatenate([change.by_position[:, 0] for change in changes]),
        "without_floors": np.concatenate([change.nothing for change in changes]),
        "held_out_floors": np.concatenate([change.error for change in changes]),
    }


def difference_rows(comparison: Comparison) -> Columns:
    """Columns of `DIFFERENCE`, with what the best change says of each position from the others."""
    parts: list[Mapping[str, Any]] = []
    best = comparison.best
    for model, error_without, held_out in zip(comparison.models, best.mounting, best.held_out, strict=True):
        pair, cells = model.pair, model.pair.matched
        weight = 1 / pair.sigma[cells] ** 2
        curves = {
            "difference": pair.difference,
            "without": model.change(error_without),
            "held_out": model.change(held_out),
        }
        parts.append(
            {
                "crank_deg": np.full(int(cells.sum()), pair.crank_deg),
                "cycle": pair.cycle[cells],
                "direction": pair.direction[cells],
                "torque_Nm": pair.torque[cells],
                "sigma_arcmin": pair.sigma[cells],
                **{
                    f"{name}_arcmin": curve[cells] - np.average(curve[cells], weights=weight)
                    for name, curve in curves.items()
                },
            }
        )
    return {column.name: np.concatenate([part[column.name] for part in parts]) for column in DIFFERENCE.columns}


def _numbers(change: Change) -> str:
    parts = []
    for kind, mean, low, high in zip(change.kinds, change.mean, change.low, change.high, strict=True):
        scale, unit = (100, "%") if kind.unit == "1" else (1, kind.unit)
        parts.append(f"{scale * mean:+.3g} {unit}, {scale * low:.3g} to {scale * high:.3g}")
    return "; ".join(parts)

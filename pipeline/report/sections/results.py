"""The metrics over the samples, or of each listed case, with their limits."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.distributions import crank_figure, distributions_figure
from pipeline.figures.labels import METRICS
from pipeline.figures.yields import units_figure
from pipeline.model.metrics import CONTINUOUS_TURN, WHOLE_TURN
from pipeline.report.explorer import UNITS_SHOWN, WORST_SHOWN, explored_units
from pipeline.report.frames import HEADLINES, OK, ROWS_SHOWN, Drawing, Frames, case_label, unsolved_rows
from pipeline.report.layout import DASH, count_text, number, percent, plain_number
from pipeline.report.results import STATISTICS, Results
from pipeline.report.sections.section import Page, Section


@dataclass(frozen=True)
class CaseRow:
    """One case, its worst metrics over the turn or those at one crank angle; `failing` marks those beyond a limit."""

    label: str
    crank: str
    values: tuple[str, ...]
    failing: tuple[bool, ...]
    note: str


def case_rows(frames: Frames) -> list[CaseRow]:
    """Worst metrics of the first cases over the turn."""
    by_sample = _first_cases(frames).groupby("sample")
    return [_case_row(frames, int(sample), rows, "", frames.turn_of(int(sample))) for sample, rows in by_sample]


def case_crank_rows(frames: Frames) -> list[CaseRow]:
    """Metrics of the first cases at every crank angle."""
    return [
        _case_row(frames, int(sample), rows, plain_number(crank), {name: float(rows[name].iloc[0]) for name in METRICS})
        for (sample, crank), rows in _first_cases(frames).groupby(["sample", "crank_deg"])
    ]


def _first_cases(frames: Frames) -> pd.DataFrame:
    return frames.metrics[frames.metrics["sample"] < ROWS_SHOWN]


def _case_row(frames: Frames, sample: int, rows: pd.DataFrame, crank: str, values: dict[str, float]) -> CaseRow:
    notes = ["no result"] if len(unsolved_rows(rows)) else sorted({str(text) for text in rows["status"] if text != OK})
    notes += ["preloaded"] if rows["preloaded"].any() else []
    metrics_shown = frames.shown_metrics
    return CaseRow(
        case_label(frames.study, sample),
        crank,
        tuple(number(values[name], METRICS[name]) for name in metrics_shown),
        tuple(_fails(frames, name, values[name]) for name in metrics_shown),
        ", ".join(notes),
    )


def _fails(frames: Frames, metric: str, value: float) -> bool:
    limit = frames.limits.get(metric)
    if limit is None or np.isnan(value):
        return False
    return not METRICS[metric].keeps(np.array(value), limit)


ESTIMATES = {
    WHOLE_TURN: "whole turn: the search, corrected by the audited units",
    CONTINUOUS_TURN: "continuous turn: at worst",
}
"""Rows of estimates after those of angles, by what they are over."""


@dataclass(frozen=True)
class ConvergenceTable:
    """Mean worst value of each metric and yield of all limits, from ever more crank angles."""

    frames: Frames
    results: Results

    @property
    def metrics(self) -> list[str]:
        """Metrics with a column."""
        return [name for name in self.frames.shown_metrics if self.frames.over_turn[name].notna().any()]

    @property
    def headings(self) -> list[tuple[str, str]]:
        """Title and unit of each column after the first."""
        yields = [("Yield, all limits", "")] if self.frames.limits else []
        return [(METRICS[name].title, METRICS[name].unit.replace("1", "")) for name in self.metrics] + yields

    @property
    def rows(self) -> Iterator[tuple[str, list[str]]]:
        """Label and cells of each number of angles; none where all limits are over another value than the worst."""
        if self.frames.turn_statistic != "worst":
            return
        table = self.frames.convergence[~self.frames.convergence["extrapolated"].astype(bool)]
        by_metric = {name: table[table["metric"] == name] for name in (*self.metrics, ALL_LIMITS)}
        counts = max((part["n_angles"].to_list() for name, part in by_metric.items() if len(part)), key=len)
        loaded = [part["n_angles"].to_list() for name, part in by_metric.items() if len(part) == len(counts)]
        for place in range(len(counts)):
            angles = min(row[place] for row in loaded)
            searched = self.results.n_searched and place == len(counts) - 1
            label = f"{angles:,} pitches, searched" if searched else count_text(angles, "loaded angle")
            means = [self._value(by_metric[name], "worst_mean", place) for name in self.metrics]
            share = [self._value(by_metric[ALL_LIMITS], "yield", place)] if self.frames.limits else []
            yield label, self._cells(means, share)
        for turn_value, label in ESTIMATES.items():
            means = [self.results.value_over(turn_value, name, "mean") for name in self.metrics]
            if np.isfinite(means).any():
                share = [self.results.value_over(turn_value, ALL_LIMITS, "yield")] if self.frames.limits else []
                yield label, self._cells(means, share)

    @property
    def has_bound(self) -> bool:
        """Whether a row is about the continuous turn."""
        return any(np.isfinite(self.results.value_over(CONTINUOUS_TURN, name, "mean")) for name in self.metrics)

    @staticmethod
    def _value(part: pd.DataFrame, column: str, place: int) -> float:
        return float(part[column].iloc[place]) if place < len(part) else np.nan

    def _cells(self, means: list[float], share: list[float]) -> list[str]:
        texts = [number(value, METRICS[name]) for name, value in zip(self.metrics, means, strict=True)]
        return texts + [percent(value) if np.isfinite(value) else DASH for value in share]


def _values(page: Page) -> Mapping[str, object]:
    frames = page.frames
    return {
        "case_rows": case_rows(frames) if frames.is_listed else [],
        "case_crank_rows": case_crank_rows(frames) if frames.is_listed else [],
        "rows_shown": ROWS_SHOWN,
        "explorer": page.explorer,
        "statistics": list(STATISTICS.values()),
        "convergence": ConvergenceTable(frames, Results(frames)),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    if frames.is_listed or not len(frames.over_turn):
        return
    metrics = [name for name in frames.shown_metrics if frames.over_turn[name].notna().any()]
    yield _distributions(frames, metrics)
    yield from _units(frames)
    headlines = [metric for metric in HEADLINES if metric in metrics]
    if len(frames.study.cycle.crank_deg) > 1 and headlines:
        yield _cranks(frames, headlines)


def _distributions(frames: Frames, metrics: list[str]) -> Drawing:
    worst_rows = frames.distributions[frames.distributions["over"] == frames.turn_statistic]
    level = plain_number(100 * frames.study.metrics.confidence)
    nominal = frames.turn_of(0) if frames.study.samples.nominal_first else {}
    return Drawing(
        "distributions",
        "Distributions of the metrics over the samples",
        f"{frames.turn_statistic.capitalize()} value of each of {count_text(len(frames.over_turn), 'sample')} over the "
        f"turn. Below each histogram: 5 % quantile, mean and 95 % quantile with their {level} % intervals; an "
        "arrowhead marks an end that the samples do not determine. Beyond the limit the ground is shaded.",
        partial(distributions_figure, frames.over_turn[metrics], worst_rows, frames.limits, nominal),
    )


def _units(frames: Frames) -> Iterator[Drawing]:
    units = explored_units(frames)
    if len(units.columns) < 2:
        return
    pair = list(units.columns[:2])
    curves = frames.at_crank(frames.curves)
    angles = np.stack([curves.loc[curves["sample"] == sample, "angle_arcmin"].to_numpy() for sample in units.index])
    torque = curves["torque_Nm"].to_numpy()[: angles.shape[1]]
    yield Drawing(
        "units",
        "Single units",
        f"{count_text(len(units), 'unit').capitalize()}{_choice(frames, units)}: their values over the turn, and their "
        f"loops at crank angle {plain_number(frames.crank_deg)}°. Point at a unit, or go from unit to unit with the "
        "arrow keys, to see its loop and the forces on its pins (filled points).",
        partial(units_figure, pair, units[pair].to_numpy(), frames.limits, torque, angles),
    )


def _choice(frames: Frames, units: pd.DataFrame) -> str:
    """How the units of the explorer were chosen."""
    if not frames.limits or len(units) < UNITS_SHOWN:
        return ""
    return f", {WORST_SHOWN} of them the nearest to a limit or farthest beyond one, the others random"


def _cranks(frames: Frames, metrics: list[str]) -> Drawing:
    by_crank = frames.distributions[frames.distributions["over"] == "angle"]
    return Drawing(
        "cranks",
        f"The metrics over the turn of the {frames.study.cycle.turn}",
        "Mean and band of 90 % of the samples at each loaded crank angle, and the nominal reducer. A unit's worst "
        "over the turn is at least as bad as its value at any of these angles.",
        partial(crank_figure, by_crank, frames.nominal, metrics, frames.limits),
    )


SECTION = Section(
    name="results",
    title="Results",
    rank=20,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    drawings=_drawings,
)

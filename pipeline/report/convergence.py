"""How the worst over the turn moves with the number of crank angles, as rows of a table."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import METRICS
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import DASH, count_text, number, percent
from pipeline.report.results import Results

ESTIMATES = {
    "whole_turn": "whole turn: the search, corrected by the audited units",
    "continuous_turn": "continuous turn: at worst",
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

    @staticmethod
    def _value(part, column: str, place: int) -> float:
        return float(part[column].iloc[place]) if place < len(part) else np.nan

    def _cells(self, means: list[float], share: list[float]) -> list[str]:
        texts = [number(value, METRICS[name]) for name, value in zip(self.metrics, means, strict=True)]
        return texts + [percent(value) if np.isfinite(value) else DASH for value in share]

"""The results of a study as the report tells them: rows of tables and short sentences, their numbers as text."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.figures.labels import METRICS, parameter_title, signed
from pipeline.figures.sensitivity import REMAINDER
from pipeline.report.frames import HEADLINES, OK, Frames, case_label
from pipeline.report.wording import (
    NOTHING,
    UNDETERMINED,
    counted,
    interval,
    listed,
    number,
    percent,
    percent_interval,
    plain,
)

STATISTICS = ("mean", "std", "p05", "p95")
ALL_LIMITS = "all_limits"
ROWS_SHOWN = 40
"""Of the tables of cases and of failed loops."""
DRIVERS_NAMED = 3


@dataclass(frozen=True)
class Cell:
    """A number and its confidence interval, as text."""

    value: str
    interval: str = ""


@dataclass(frozen=True)
class MetricRow:
    """One metric in the table of key results; `met` tells of each sample whether it keeps the limit."""

    title: str
    unit: str
    nominal: str
    estimates: tuple[Cell, ...]
    limit: str
    met: Cell


@dataclass(frozen=True)
class CaseRow:
    """One listed case, its worst metrics over the crank angles or those at one; with `failing` past a limit."""

    label: str
    crank: str
    values: tuple[str, ...]
    failing: tuple[bool, ...]
    note: str


@dataclass(frozen=True)
class Driver:
    """What drives one metric, in one sentence."""

    title: str
    sentence: str


@dataclass(frozen=True)
class Results:
    """Everything of the results that the page says in numbers."""

    frames: Frames

    @cached_property
    def _estimates(self) -> Mapping[tuple[str, float | None, str], tuple[float, float, float]]:
        table = self.frames.distributions
        keys = zip(table["metric"], table["crank_deg"], table["statistic"], strict=True)
        values = table[["value", "ci_low", "ci_high"]].to_numpy(float)
        return {
            (metric, None if np.isnan(crank) else crank, statistic): tuple(row)
            for (metric, crank, statistic), row in zip(keys, values, strict=True)
        }

    def _estimate(self, metric: str, statistic: str, crank: float | None = None) -> tuple[float, float, float]:
        return self._estimates.get((metric, crank, statistic), (np.nan, np.nan, np.nan))

    def _cell(self, metric: str, statistic: str, crank: float | None = None) -> Cell:
        value, low, high = self._estimate(metric, statistic, crank)
        quantity = METRICS[metric]
        return Cell(number(value, quantity), interval(low, high, quantity) if np.isfinite(value) else "")

    def _share(self, metric: str, statistic: str) -> Cell:
        value, low, high = self._estimate(metric, statistic)
        return Cell(percent(value), percent_interval(low, high)) if np.isfinite(value) else Cell(NOTHING)

    @property
    def samples(self) -> int:
        """Samples that the statistics rest on."""
        return len(self.frames.worst)

    @cached_property
    def metric_rows(self) -> list[MetricRow]:
        """Key results of every metric, worst over the crank angles."""
        nominal = self.frames.worst_of(self.frames.nominal)
        return [
            MetricRow(
                METRICS[metric].title,
                METRICS[metric].unit,
                number(nominal[metric], METRICS[metric]),
                tuple(self._cell(metric, statistic) for statistic in STATISTICS),
                self.limit(metric),
                self._share(metric, "yield"),
            )
            for metric in self.frames.shown_metrics
        ]

    @property
    def headlines(self) -> list[MetricRow]:
        """The three metrics that the study is about."""
        titles = [METRICS[metric].title for metric in HEADLINES]
        return [row for row in self.metric_rows if row.title in titles]

    def limit(self, metric: str) -> str:
        """The limit of a metric with the side that it bounds."""
        if metric not in self.frames.limits:
            return NOTHING
        return f"{'≥' if METRICS[metric].smaller_is_worse else '≤'} {plain(self.frames.limits[metric])}"

    @property
    def all_limits(self) -> Cell:
        """Yield against all limits together."""
        return self._share(ALL_LIMITS, "yield")

    @property
    def preloaded(self) -> Cell:
        """Share of samples that are preloaded at some crank angle."""
        return self._share("preloaded", "mean")

    @cached_property
    def crank_rows(self) -> list[tuple[str, list[tuple[str, str, str]]]]:
        """Per crank angle and headline metric: nominal, mean with interval, 5 % to 95 %."""
        rows = []
        for crank in self.frames.study.cycle.crank_deg:
            at = self.frames.nominal[self.frames.nominal["crank_deg"] == crank]
            cells = []
            for metric in HEADLINES:
                nominal = float(at[metric].iloc[0]) if len(at) else np.nan
                low, high = (self._estimate(metric, name, crank)[0] for name in ("p05", "p95"))
                cells.append((
                    number(nominal, METRICS[metric]),
                    self._cell(metric, "mean", crank).value,
                    interval(low, high, METRICS[metric]),
                ))
            rows.append((plain(crank), cells))
        return rows

    @cached_property
    def case_rows(self) -> list[CaseRow]:
        """Worst metrics of the listed cases, and of the nominal reducer where the study has it."""
        return [
            self._case_row(sample, rows, "")
            for sample, rows in self.frames.metrics.groupby("sample")
            if sample < ROWS_SHOWN
        ]

    @cached_property
    def case_crank_rows(self) -> list[CaseRow]:
        """Metrics of the listed cases at every crank angle."""
        few = self.frames.metrics[self.frames.metrics["sample"] < ROWS_SHOWN]
        grouped = few.groupby(["sample", "crank_deg"])
        return [self._case_row(sample, rows, plain(crank)) for (sample, crank), rows in grouped]

    def _case_row(self, sample: int, rows: pd.DataFrame, crank: str) -> CaseRow:
        failed = np.asarray(rows["status"]) != OK
        worst = self.frames.worst_of(rows) if not crank else {name: float(rows[name].iloc[0]) for name in METRICS}
        shown = self.frames.shown_metrics
        notes = (["no result"] if failed.any() else []) + (["preloaded"] if rows["preloaded"].any() else [])
        return CaseRow(
            case_label(self.frames.study, sample),
            crank,
            tuple(number(worst[name], METRICS[name]) for name in shown),
            tuple(self._fails(name, worst[name]) for name in shown),
            ", ".join(notes),
        )

    def _fails(self, metric: str, value: float) -> bool:
        limit = self.frames.limits.get(metric)
        if limit is None or np.isnan(value):
            return False
        return value < limit if METRICS[metric].smaller_is_worse else value > limit

    @property
    def failure_rows(self) -> list[tuple[str, str, str]]:
        """Label, crank angle and reason of the first loops without a result."""
        failed = self.frames.failed.head(ROWS_SHOWN)
        return [
            (case_label(self.frames.study, int(sample)), plain(crank), str(reason))
            for sample, crank, reason in zip(failed["sample"], failed["crank_deg"], failed["status"], strict=True)
        ]

    @property
    def failures(self) -> str:
        """How many loops have no result."""
        failed = self.frames.failed
        if not len(failed):
            return "Every load cycle of every sample has reached equilibrium."
        loops, samples = len(failed), failed["sample"].nunique()
        whole = counted(len(self.frames.status), "load cycle")
        return (
            f"{loops:,} of {whole} {'has' if loops == 1 else 'have'} no result; {counted(samples, 'sample')} "
            f"{'is' if samples == 1 else 'are'} therefore left out of the statistics."
        )

    @cached_property
    def drivers(self) -> list[Driver]:
        """For each metric the tolerances that drive it most, as far as the samples tell."""
        return [Driver(METRICS[metric].title, self._driver(metric)) for metric in self.frames.shown_metrics]

    def _driver(self, metric: str) -> str:
        table = self.frames.sensitivity[self.frames.sensitivity["metric"] == metric]
        known = table[np.isfinite(table["index"].to_numpy(float)) & (table["parameter"] != REMAINDER)]
        if not len(known):
            return f"{UNDETERMINED}: the metric or the errors do not vary, or there are too few samples"
        clear = known[(known["ci_low"] > 0) | (known["ci_high"] < 0)]
        shares = clear[clear["kind"] == "variance_share"].sort_values("index", ascending=False, kind="stable")
        if len(shares):
            named = [
                f"{parameter_title(name)} ({percent(share)})"
                for name, share in zip(shares["parameter"], shares["index"], strict=True)
            ]
            return f"{listed(named[:DRIVERS_NAMED])} of its variance{self._rest(metric)}"
        ranks = clear[clear["kind"] == "rank_correlation"].sort_values(
            "index", ascending=False, kind="stable", key=np.abs
        )
        if len(ranks):
            named = [
                f"{parameter_title(name)} ({signed(index, 2)})"
                for name, index in zip(ranks["parameter"], ranks["index"], strict=True)
            ]
            return f"{listed(named[:DRIVERS_NAMED])} by rank correlation"
        return "no single tolerance stands out: every interval holds 0"

    def _rest(self, metric: str) -> str:
        table = self.frames.sensitivity
        rest = table[(table["metric"] == metric) & (table["parameter"] == REMAINDER)]["index"]
        return f"; {percent(float(rest.iloc[0]))} is not linear in the errors" if len(rest) else ""

    @property
    def shares_determined(self) -> bool:
        """Whether the samples are enough for variance shares."""
        shares = self.frames.sensitivity[self.frames.sensitivity["kind"] == "variance_share"]
        return bool(np.any(np.isfinite(shares["index"].to_numpy(float))))

    @property
    def constant_metrics(self) -> list[str]:
        """Metrics that do not vary over the samples, which therefore nothing drives."""
        return [METRICS[name].title.lower() for name in self.frames.shown_metrics if self._spread(name) == 0]

    def _spread(self, metric: str) -> float:
        return float(np.ptp(self.frames.worst[metric].to_numpy())) if self.samples else 0.0

    @property
    def beyond_law(self) -> str:
        """Share of the pins' moment on contacts beyond the range of their law, at the largest torque of the cycle."""
        curves = self.frames.curves
        top = np.abs(curves["torque_Nm"].to_numpy()) >= (1 - 1e-9) * np.abs(curves["torque_Nm"].to_numpy()).max()
        lost = curves["sample"].isin(self.frames.failed["sample"]).to_numpy()
        shares = curves["beyond_limit_share"].to_numpy()[top & ~lost]
        if not shares.size:
            return NOTHING
        return f"{percent(float(shares.mean()))} on average and {percent(float(shares.max()))} at most"

    @cached_property
    def overloaded(self) -> list[str]:
        """Contacts of the drawn samples beyond the pressure limit, one sentence a sample."""
        limit = self.frames.limits.get("peak_pressure_MPa")
        return [] if limit is None else list(self._overloaded(limit))

    def _overloaded(self, limit: float) -> Iterator[str]:
        loads = self.frames.at_crank(self.frames.loads)
        for label, sample in self.frames.drawn.items():
            rows = loads[loads["sample"] == sample]
            if not len(rows):
                continue
            over = rows.loc[rows["pressure_MPa"] > limit, "contact"].unique()
            pins = sorted(int(contact) for contact in over if contact < self.frames.study.design.cycloid.pins)
            rollers = len(over) - len(pins)
            parts = ([f"{counted(len(pins), 'pin')} ({ranges(pins)})"] if pins else []) + (
                [counted(rollers, "output roller")] if rollers else []
            )
            yield f"{label}: {listed(parts) if parts else 'none'}"


def ranges(numbers: list[int]) -> str:
    """Ascending numbers with their runs joined: ``3, 70–75``."""
    runs: list[list[int]] = []
    for item in numbers:
        if runs and item == runs[-1][1] + 1:
            runs[-1][1] = item
        else:
            runs.append([item, item])
    return ", ".join(f"{first}" if first == last else f"{first}\u2013{last}" for first, last in runs)

"""The results of a study as the report tells them: rows of tables and short sentences, their numbers as text."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS
from pipeline.figures.labels import LIMITED_METRICS, METRICS
from pipeline.model.metrics import WHOLE_TURN, signed_number
from pipeline.report.frames import HEADLINES, Frames, case_label
from pipeline.report.layout import DASH, count_text, interval, number, percent, percent_interval, plain_number
from pipeline.statistics.intervals import Estimate, units_for_yield

STATISTICS = {"mean": "Mean", "p05": "5 % quantile", "p95": "95 % quantile", "std": "Standard deviation"}
"""Of a metric over the turn, in the order of the table, with their headings."""
CRANK_DECIMALS = 2
"""Of crank angles [degrees] in tables."""
FAILURES_SHOWN = 20
"""Failures that the page lists."""


@dataclass(frozen=True)
class Cell:
    """A number and its confidence interval, as text."""

    value: str
    interval: str = ""


def _share_cell(value: float, low: float, high: float) -> Cell:
    return Cell(percent(value), percent_interval(low, high)) if np.isfinite(value) else Cell(DASH)


@dataclass(frozen=True)
class MetricRow:
    """One metric in the table of key results; `met` tells of each sample whether it keeps the limit."""

    name: str
    title: str
    unit: str
    nominal: str
    estimates: tuple[Cell, ...]
    limit: str
    met: Cell


def _is_of_turn(metric: str) -> bool:
    """Whether it is a metric of the turn, which is one number whatever the limits count over the turn."""
    return metric in LIMITED_METRICS and metric not in METRICS


@dataclass(frozen=True)
class Results:
    """Everything of the results that the page says in numbers."""

    frames: Frames

    @cached_property
    def _estimates(self) -> Mapping[tuple[str, str, float | None, str], tuple[float, float, float]]:
        table = self.frames.distributions
        keys = zip(table["metric"], table["over"], table["crank_deg"], table["statistic"], strict=True)
        values = table[["value", "ci_low", "ci_high"]].to_numpy(float)
        return {
            (metric, turn_value, None if np.isnan(crank) else crank, statistic): tuple(row)
            for (metric, turn_value, crank, statistic), row in zip(keys, values, strict=True)
        }

    def estimate(self, metric: str, statistic: str, crank: float | None = None) -> tuple[float, float, float]:
        """A statistic and its interval at a crank angle, or over the turn as the limits mean it; NaN where missing."""
        over_turn = "turn" if _is_of_turn(metric) else self.frames.turn_statistic
        turn_value = over_turn if crank is None else "angle"
        if crank is None and self.is_of_whole_turn(metric, statistic):
            turn_value = WHOLE_TURN
        return self._estimates.get((metric, turn_value, crank, statistic), (np.nan, np.nan, np.nan))

    def is_of_whole_turn(self, metric: str, statistic: str) -> bool:
        """Whether an estimate over the turn is corrected by units that were solved at every pitch."""
        key = (metric, WHOLE_TURN, None, statistic)
        return (self.frames.turn_statistic == "worst" or _is_of_turn(metric)) and key in self._estimates

    def value_over(self, turn_value: str, metric: str, statistic: str) -> float:
        """A statistic of the whole or the continuous turn; NaN where there is none."""
        return self._estimates.get((metric, turn_value, None, statistic), (np.nan,) * 3)[0]

    def cell(self, metric: str, statistic: str, crank: float | None = None) -> Cell:
        """A statistic of a metric, with its interval."""
        value, low, high = self.estimate(metric, statistic, crank)
        quantity = LIMITED_METRICS[metric]
        return Cell(number(value, quantity), interval(low, high, quantity) if np.isfinite(value) else "")

    def estimate_cells(self, metric: str) -> tuple[Cell, ...]:
        """The statistics of a metric over the turn, in the order of `STATISTICS`."""
        return tuple(self.cell(metric, statistic) for statistic in STATISTICS)

    def share(self, metric: str, statistic: str) -> Cell:
        """A share of the units in percent, with its interval."""
        return _share_cell(*self.estimate(metric, statistic))

    @property
    def samples(self) -> int:
        """Samples that the statistics rest on."""
        return len(self.frames.over_turn)

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Each metric of the nominal reducer over the turn, as the limits mean it; NaN without such a sample."""
        first_row = 0 if self.frames.study.samples.nominal_first else -1
        return self.frames.turn_of(first_row)

    @cached_property
    def metric_rows(self) -> list[MetricRow]:
        """Key results of every metric over the turn, as the limits mean it."""
        rows = []
        for name in self.frames.shown_metrics:
            metric, limit, met = METRICS[name], self.limit(name), self.share(name, "yield")
            nominal, estimates = number(self.nominal[name], metric), self.estimate_cells(name)
            rows.append(MetricRow(name, metric.title, metric.unit, nominal, estimates, limit, met))
        return rows

    @property
    def headlines(self) -> list[MetricRow]:
        """The three metrics that the study is about."""
        return [row for row in self.metric_rows if row.name in HEADLINES]

    def limit(self, metric: str) -> str:
        """The limit of a metric with the side that it bounds."""
        if metric not in self.frames.limits:
            return DASH
        return f"{'≥' if LIMITED_METRICS[metric].smaller_is_worse else '≤'} {plain_number(self.frames.limits[metric])}"

    @property
    def all_limits(self) -> Cell:
        """Yield against all limits together."""
        return self.share(ALL_LIMITS, "yield")

    @property
    def preloaded_share(self) -> Cell:
        """Share of samples that are preloaded at some crank angle."""
        return _share_cell(*self._estimates.get(("preloaded", "worst", None, "mean"), (np.nan, np.nan, np.nan)))

    @property
    def n_searched(self) -> int:
        """Pitches of the output turn among which the worst of each unit was searched; 0 where it was not."""
        return int(self.frames.units.iloc[0]["n_searched"]) if self.frames.turn_statistic == "worst" else 0

    @cached_property
    def angles(self) -> str:
        """From how many crank angles a worst value is taken."""
        counts = self.frames.units.iloc[0]
        if self.n_searched:
            return f"all {self.n_searched:,} pitches of the pins in a turn of the output"
        n_loaded, rigid = int(counts["n_angles"]), int(counts["n_rigid_angles"])
        return f"{count_text(n_loaded, 'loaded crank angle')}; of the clearance backlash {rigid:,}"

    def _values_at_twice_the_angles(self, metric: str, column: str) -> tuple[float, float, float]:
        """A value of the table of convergence now, and the two of twice the crank angles; NaN where they are few."""
        part = self.frames.convergence[self.frames.convergence["metric"] == metric]
        current, extrapolated_rows = (
            part[part["extrapolated"] == is_extrapolated] for is_extrapolated in (False, True)
        )
        if not len(current) or not len(extrapolated_rows):
            return np.nan, np.nan, np.nan
        expected_row = extrapolated_rows.iloc[-1]
        return float(current[column].iloc[-1]), float(expected_row[column]), float(expected_row[f"{column}_settled"])

    @cached_property
    def doubled_yield(self) -> str:
        """Yield against all limits expected of twice as many crank angles; empty where they are too few."""
        _, *expected_yield = self._values_at_twice_the_angles(ALL_LIMITS, "yield")
        is_known = np.isfinite(expected_yield).all() and self.frames.turn_statistic == "worst"
        return percent_interval(*expected_yield) if is_known else ""

    @cached_property
    def angle_doubling_phrases(self) -> list[str]:
        """How far the mean worst values would move with twice as many crank angles, one phrase each."""
        phrases = []
        for name in HEADLINES:
            current, *expected_mean = self._values_at_twice_the_angles(name, "worst_mean")
            if np.isfinite(expected_mean).all():
                metric = METRICS[name]
                ends = dict.fromkeys(
                    signed_number(value - current, metric.decimals) for value in expected_mean
                )  # once where alike
                phrases.append(f"the {metric.inline} by {' to '.join(ends)} {metric.unit}")
        return phrases

    @cached_property
    def crank_rows(self) -> list[tuple[str, list[tuple[str, str, str]]]]:
        """Per crank angle and headline metric: nominal, mean, 5 % to 95 % quantile."""
        rows = []
        for crank in self.frames.study.cycle.crank_deg:
            rows_of_crank = self.frames.nominal[self.frames.nominal["crank_deg"] == crank]
            cells = []
            for metric in HEADLINES:
                nominal = float(rows_of_crank[metric].iloc[0]) if len(rows_of_crank) else np.nan
                low, high = (self.estimate(metric, name, crank)[0] for name in ("p05", "p95"))
                mean, spread = self.cell(metric, "mean", crank).value, interval(low, high, METRICS[metric])
                cells.append((number(nominal, METRICS[metric]), mean, spread))
            rows.append((plain_number(round(crank, CRANK_DECIMALS)), cells))
        return rows

    @property
    def failure_rows(self) -> list[tuple[str, str, str]]:
        """Label, crank angle and reason of the first loops without a result."""
        failed_rows = pd.concat([self.frames.failed_rows, self.frames.doubtful]).head(FAILURES_SHOWN)
        return [
            (case_label(self.frames.study, int(sample)), plain_number(round(crank, CRANK_DECIMALS)), str(reason))
            for sample, crank, reason in zip(
                failed_rows["sample"], failed_rows["crank_deg"], failed_rows["status"], strict=True
            )
        ]

    @property
    def failures(self) -> str:
        """How many loops have no result."""
        failed_rows, doubtful = self.frames.failed_rows, self.frames.doubtful
        limits = ""
        if len(doubtful):
            limits = (
                f" Of {count_text(len(doubtful), 'load cycle')} of "
                f"{count_text(doubtful['sample'].nunique(), 'sample')} a value is outside its range of validity; it is "
                f"missing and in no statistic: {'; '.join(sorted(set(doubtful['status'].astype(str))))}."
            )
        if not len(failed_rows):
            return f"Every load cycle of every sample has reached equilibrium.{limits}"
        loops, samples = len(failed_rows), failed_rows["sample"].nunique()
        load_cycles = count_text(self.frames.n_loops, "load cycle")
        return (
            f"{loops:,} of {load_cycles} {'has' if loops == 1 else 'have'} no result; they belong to "
            f"{count_text(samples, 'sample')}, left out of all statistics.{limits}"
        )


HALF_WIDTHS = (0.02, 0.01, 0.005, 0.001)
"""Of the interval of a yield."""
MOSTLY_PRELOADED = 0.5
"""Share of preloaded units from which on a study says so first."""


def yield_estimate(distributions: pd.DataFrame, turn_value: str) -> Estimate | None:
    """Yield against all limits with its interval; None where no unit tells it.

    Parameters
    ----------
    distributions : table of ``aggregate``.
    turn_value : what the limits hold for: ``worst``, ``mean`` or ``best``.
    """
    key = {"metric": ALL_LIMITS, "over": turn_value, "statistic": "yield"}
    rows = distributions[(distributions[list(key)] == pd.Series(key)).all(axis=1)]
    for row in rows.itertuples():
        return Estimate(float(row.value), float(row.ci_low), float(row.ci_high), int(row.n))
    return None


def preload_warning(distributions: pd.DataFrame) -> str:
    """A sentence where most units are preloaded, which a wrong sign or a missing allowance gives; else empty."""
    key = {"metric": "preloaded", "over": "worst", "statistic": "mean"}
    share = distributions.loc[(distributions[list(key)] == pd.Series(key)).all(axis=1), "value"]
    if share.empty or share.iloc[0] < MOSTLY_PRELOADED:
        return ""
    return preload_sentence({"the units": float(share.iloc[0])}, CHECK_TOLERANCES)


CHECK_TOLERANCES = (
    "Check the signs of the tolerances (python -m pipeline keys tolerances) and the allowances (allowance_um)."
)
"""What to do where tolerances make preloaded units."""


def preload_sentence(shares: Mapping[str, float], advice: str) -> str:
    """How many units are preloaded and what to do; empty where none is.

    Parameters
    ----------
    shares : of preloaded units by whose they are, as "the units made from these parts"; the first is the subject.
    """
    if not any(shares.values()):
        return ""
    (whose, share), *others = ((whose, f"{100 * share:.3g} %") for whose, share in shares.items())
    beside = "".join(f", of {other} {other_share}" for other, other_share in others)
    return (
        f"{share} of {whose} are preloaded{beside}: at some crank angle parts interfere without load. A preloaded unit "
        f"may keep every limit, because none counts preload itself. {advice}"
    ).rstrip()


def preload_warnings(shares: Mapping[str, float], advice: str) -> list[str]:
    """The sentence on preloaded units as a warning, with the advice where most are; none where no unit is."""
    sentence = preload_sentence(shares, advice if max(shares.values()) >= MOSTLY_PRELOADED else "")
    return [f"Warning: {sentence}"] if sentence else []


def needed_units(estimate: Estimate, confidence: float) -> list[tuple[float, int]]:
    """Half width of the interval of a yield, and the independent units that know it so well."""
    return [(width, units_for_yield(estimate.value, width, confidence)) for width in HALF_WIDTHS]


def needed_sentences(estimate: Estimate, confidence: float) -> Iterator[str]:
    """The same as lines of a summary."""
    for width, units in needed_units(estimate, confidence):
        yield f"for +-{100 * width:g} % on the yield against all limits take {units:,} independent units"

"""Which errors drive a metric, in words: the leading indices that the samples determine."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.figures.labels import LIMITED_METRICS, METRICS, PARAMETERS, parameter_title
from pipeline.figures.yields import sensitivity_figure
from pipeline.model.metrics import signed_number
from pipeline.populations.scaled_tolerances import RemovedVariance
from pipeline.report import inputs
from pipeline.report.frames import Drawing, Frames
from pipeline.report.layout import DASH, UNDETERMINED_TEXT, percent, percent_interval, plain_number
from pipeline.report.results import Cell
from pipeline.report.sections.section import Page, Section
from pipeline.statistics.sensitivity import FIRST_ORDER, RANK_CORRELATION, SUM, TOTAL, are_determined

REMOVED_VARIANCES = "scales/variances"
"""Table of what each tolerance removes of the variances if it is tightened."""
MOST_NAMED = 3
"""Errors that a row names."""
NONE_LEADS = "none stands out"


@dataclass(frozen=True)
class Driver:
    """What drives one metric.

    Attributes
    ----------
    in_all, by_itself, by_rank : the leading errors by total index, first-order index and rank correlation.
    together : what errors cause only acting together, the rest of the first-order indices, with its interval.
    """

    metric: str
    title: str
    in_all: str
    by_itself: str
    by_rank: str
    together: Cell


def drivers(frames: Frames) -> list[Driver]:
    """For each metric the errors that drive its worst value over the turn most, as far as the samples tell."""
    table = frames.sensitivity[frames.sensitivity["over"] == "worst"]
    return [_driver(metric, table[table["metric"] == metric]) for metric in frames.shown_metrics]


def driver_tables(frames: Frames) -> dict[str, list[tuple[str, list[Cell]]]]:
    """By metric, every error with its total index, first-order index and rank correlation; largest total first."""
    table = frames.sensitivity[(frames.sensitivity["over"] == "worst") & (frames.sensitivity["parameter"] != SUM)]
    return {metric: _driver_rows(table[table["metric"] == metric]) for metric in frames.shown_metrics}


def _driver_rows(table: pd.DataFrame) -> list[tuple[str, list[Cell]]]:
    cells: dict[str, dict[str, Cell]] = {}
    totals: dict[str, float] = {}
    columns = (table[name] for name in ("parameter", "kind", "index", "ci_low", "ci_high"))
    for parameter, kind, index, low, high in zip(*columns, strict=True):
        title = parameter_title(str(parameter))
        if np.isfinite(index):
            texts = (
                (
                    signed_number(index, 2),
                    f"{signed_number(low, 2)} to {signed_number(high, 2)}" if np.isfinite([low, high]).all() else "",
                )
                if kind == RANK_CORRELATION
                else (percent(index), percent_interval(low, high))
            )
            cells.setdefault(title, {})[str(kind)] = Cell(*texts)
        if kind == TOTAL:
            totals[title] = float(np.nan_to_num(index))
    titles = sorted(cells, key=lambda title: -totals.get(title, 0.0))
    kinds = (TOTAL, FIRST_ORDER, RANK_CORRELATION)
    return [(title, [cells[title].get(kind, Cell(DASH)) for kind in kinds]) for title in titles]


def main_contributor(frames: Frames, metric: str) -> str:
    """The tolerance that drives a metric most, with its share of the variance; empty where none is determined.

    It is that of the largest total share, else that which removes most of the variance if it is tightened. A rank
    correlation does not tell: errors of elements enter it by their mean, and what scatters from element to element is
    not seen.
    """
    total = _leading(_judged_rows(frames, metric), TOTAL)
    if len(total):
        share = percent(float(total.iloc[0]))
        return f"{parameter_title(total.index[0])} ({share} of its variance, interactions included)"
    removed = _most_removed(frames, metric)
    if removed is None:
        return ""
    return (
        f"{PARAMETERS[removed.tolerance]} (tightened to a quarter, it removes {percent(removed.value)} of the variance)"
    )


def _most_removed(frames: Frames, metric: str) -> RemovedVariance | None:
    """What the tolerance removes that certainly removes variance, and the most of it; None where none does."""
    table = frames.tables.get(REMOVED_VARIANCES, pd.DataFrame(columns=["metric", "ci_low"]))
    certain = table[(table["metric"] == metric) & (table["ci_low"].astype(float) > 0)]
    if certain.empty:
        return None
    row = certain.sort_values("value", ascending=False).iloc[0]
    return RemovedVariance(**{name: row[name] for name in RemovedVariance.__dataclass_fields__})


def share_note(frames: Frames, metric: str) -> str:
    """Which share of the variance the page states of the main contributor, and its share by itself; else empty."""
    rows = _judged_rows(frames, metric)
    total = _leading(rows, TOTAL)
    if total.empty:
        return _removed_note(_most_removed(frames, metric))
    note = (
        "A share with interactions included counts all variance in which the tolerance takes part, alone or together "
        "with others (total Sobol\u2019 index); making this tolerance alone exact removes less where tolerances "
        "interact"
    )
    alone = rows[(rows["kind"] == FIRST_ORDER) & (rows["parameter"] == total.index[0])]
    if alone.empty or not np.isfinite(alone["index"].iloc[0]):
        return f"{note}."
    index, low, high = (float(alone[name].iloc[0]) for name in ("index", "ci_low", "ci_high"))
    share = f"{percent(index)} ({percent_interval(low, high)}) of the variance of the {LIMITED_METRICS[metric].inline}"
    return f"{note}: by itself the {parameter_title(total.index[0])} causes {share} (first-order index)."


def share_notes(frames: Frames, metrics: Iterable[str]) -> list[str]:
    """What each measure of a main contributor is that the page states for these metrics, once each."""
    notes: dict[bool, str] = {}
    for metric in metrics:
        if note := share_note(frames, metric):
            notes.setdefault(_leading(_judged_rows(frames, metric), TOTAL).empty, note)
    return list(notes.values())


def _removed_note(removed: RemovedVariance | None) -> str:
    """What a share of removed variance is and how sure it is."""
    if removed is None:
        return ""
    return (
        f"Removed variance: that of the {LIMITED_METRICS[removed.metric].inline} over {removed.n:,} units solved again "
        f"with the {PARAMETERS[removed.tolerance]} at a quarter of its limits is less by {percent(removed.value)} "
        f"({percent_interval(removed.ci_low, removed.ci_high)})."
    )


def _judged_rows(frames: Frames, metric: str) -> pd.DataFrame:
    """Indices of a metric over what its limit judges: the study's choice where it has them, else the worst."""
    table = frames.sensitivity[frames.sensitivity["metric"] == metric]
    overs = [name for name in (frames.turn_statistic, "worst", "turn") if (table["over"] == name).any()]
    return table[table["over"] == overs[0]] if overs else table


def base_samples(frames: Frames) -> int:
    """Base samples that the shares of the variance rest on, the fewest of any that is determined; 0 if none is."""
    shares = frames.sensitivity[frames.sensitivity["kind"] == TOTAL].dropna(subset=["index"])
    return int(shares["n"].min()) if len(shares) else 0


def constant_metrics(frames: Frames) -> list[str]:
    """Metrics that do not vary over the samples, which therefore nothing drives."""
    over_turn = frames.over_turn[frames.shown_metrics]
    spans = np.ptp(over_turn.to_numpy(), axis=0) if len(over_turn) else np.ones(over_turn.shape[1])
    return [METRICS[name].inline for name in over_turn.columns[spans == 0]]


def _driver(metric: str, table: pd.DataFrame) -> Driver:
    total, first_order, ranks = (_leading(table, kind) for kind in (TOTAL, FIRST_ORDER, RANK_CORRELATION))
    return Driver(
        metric=metric,
        title=METRICS[metric].title,
        in_all=_names([f"{name} ({percent(share)})" for name, share in _titled_indices(total)], table, TOTAL),
        by_itself=_names(
            [f"{name} ({percent(share)})" for name, share in _titled_indices(first_order)], table, FIRST_ORDER
        ),
        by_rank=_names(
            [f"{name} ({signed_number(rank, 2)})" for name, rank in _titled_indices(ranks)], table, RANK_CORRELATION
        ),
        together=_together(table),
    )


def _titled_indices(indices: pd.Series) -> list[tuple[str, float]]:
    return [(parameter_title(str(name)), float(index)) for name, index in indices.head(MOST_NAMED).items()]


def _names(leaders: list[str], table: pd.DataFrame, kind: str) -> str:
    has_index = np.isfinite(table.loc[table["kind"] == kind, "index"].to_numpy(float)).any()
    return "; ".join(leaders) or (NONE_LEADS if has_index else UNDETERMINED_TEXT)


def _leading(table: pd.DataFrame, kind: str) -> pd.Series:
    """Determined indices of one kind by parameter, largest first; a share below 0 is noise."""
    rows = table[(table["kind"] == kind) & (table["parameter"] != SUM)]
    index = rows["index"].to_numpy(float)
    certain = are_determined(index, rows["ci_low"].to_numpy(float), rows["ci_high"].to_numpy(float))
    leading = rows[certain & ((index > 0) | (kind == RANK_CORRELATION))]
    indices = pd.Series(leading["index"].to_numpy(float), leading["parameter"].astype(str))
    return indices.sort_values(ascending=False, kind="stable", key=np.abs)


def _together(table: pd.DataFrame) -> Cell:
    rows = table[(table["kind"] == FIRST_ORDER) & (table["parameter"] == SUM)]
    if rows.empty or not np.isfinite(rows["index"].iloc[0]):
        return Cell(DASH)
    index, low, high = (float(rows[name].iloc[0]) for name in ("index", "ci_low", "ci_high"))
    return Cell(percent(1 - index), percent_interval(1 - high, 1 - low))


def _values(page: Page) -> Mapping[str, object]:
    frames = page.frames
    return {
        "drivers": drivers(frames),
        "driver_tables": driver_tables(frames),
        "base_samples": base_samples(frames),
        "constant_metrics": constant_metrics(frames),
        "metric_titles": {name: METRICS[name].title for name in frames.shown_metrics},
        "inline_titles": {name: METRICS[name].inline for name in frames.shown_metrics},
        "zero_tolerances": inputs.zero_tolerances(frames.study.tolerances),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    table, level = frames.sensitivity, plain_number(100 * frames.study.metrics.confidence)
    for metric in frames.shown_metrics if len(frames.over_turn) else ():
        of_metric = (table["metric"] == metric) & (table["over"] == "worst")
        rows = table[of_metric & np.isfinite(table["index"].to_numpy(float))]
        if len(rows):
            yield Drawing(
                f"drivers_{metric}",
                f"Which tolerance drives the {METRICS[metric].inline}",
                f"Worst over the turn. Lines: {level} % intervals. Empty bars, numbers in brackets: not determined, "
                "the interval is as wide as the index.",
                partial(sensitivity_figure, rows),
            )


SECTION = Section(
    name="drivers",
    title="Which tolerance decides",
    rank=25,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.is_listed,
    drawings=_drawings,
)

"""The page on two runs side by side."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config.files.section import shown_value
from pipeline.config.studies.study import ALL_LIMITS
from pipeline.decisions.fresh_units import preloaded_share
from pipeline.decisions.run_comparison import DIFFERENCES, DRIVER_CHANGES, INPUTS, ComparedRun, differing_inputs
from pipeline.engine.store import write_atomic, write_tables
from pipeline.engine.table import Columns
from pipeline.figures.distributions import overlay_figure
from pipeline.figures.labels import LIMITED_METRICS, METRICS, parameter_title
from pipeline.model.metrics import Quantity, signed_number
from pipeline.report.layout import DASH, SHARE, Picture, count_text, drawn_pictures, interval, number, percent, render
from pipeline.report.results import CHECK_TOLERANCES, preload_warnings
from pipeline.statistics.sensitivity import FIRST_ORDER, RANK_CORRELATION, SUM, TOTAL

KINDS = {
    TOTAL: "share of the variance, in all",
    FIRST_ORDER: "share of the variance, by itself",
    RANK_CORRELATION: "rank correlation",
}
NOT_HOW_MEASURED = ("design.", "limits.", "samples.", "tolerances.", "cases")
"""Beginnings of keys by which units differ, or what is asked of them, but not how they are loaded and read."""
LEADING = 3
"""Drivers of a metric that are shown, by the larger of the two runs."""


def write_comparison(
    a: ComparedRun,
    b: ComparedRun,
    inputs: Sequence[tuple[str, Any, Any]],
    rows: Columns,
    drivers: Columns,
    folder: Path,
) -> dict[str, pd.DataFrame]:
    """Write report.html, its figure and the three tables as CSV and Parquet into ``folder``; their frames by name."""
    settings = [(key, *(_text(value) for value in pair)) for key, *pair in inputs]
    columns = {name: np.array([row[k] for row in settings], object) for k, name in enumerate(("key", "a", "b"))}
    frames = write_tables({DIFFERENCES: rows, DRIVER_CHANGES: drivers, INPUTS: columns}, folder, as_csv=True)
    frame = frames[DIFFERENCES.name]
    metrics = [name for name in METRICS if not _constant(a, b, name)]
    page = render(
        "decisions/compare.html",
        a=a,
        b=b,
        settings=[(key, *(value or DASH for value in pair)) for key, *pair in settings],
        warnings=warnings(a, b),
        sentence=yield_sentence(a, b, frame),
        answers=metric_answers(a, b, frame),
        paired=bool(len(frame) and frame["paired"].iloc[0]),
        listed=a.study.samples.experiment == "cases",
        rows=[_row(row) for row in frame.to_dict("records") if row["metric"] in (*metrics, ALL_LIMITS)],
        drivers=_drivers(pd.DataFrame(drivers)),
        level=100 * a.study.metrics.confidence,
        pictures=_pictures(a, b, metrics, folder),
    )
    write_atomic(folder / "report.html", page.encode())
    return frames


ANSWERED_STATISTICS = ("mean", "std")
"""Statistics of a metric that its answer names."""


def answer_lines(a: ComparedRun, b: ComparedRun, rows: pd.DataFrame) -> list[str]:
    """Warnings, then one sentence for the yield and for each metric."""
    answers = [f"{item['title']}: {item['text']}" for item in metric_answers(a, b, rows)]
    return [*warnings(a, b), *([sentence] if (sentence := yield_sentence(a, b, rows)) else []), *answers]


def warnings(a: ComparedRun, b: ComparedRun) -> list[str]:
    """What makes the two runs differ beside their tolerances, and that units are preloaded."""
    texts, limits = [], [run.study.limits.of_metrics for run in (a, b)]
    if limits[0] != limits[1] or a.study.limits.over != b.study.limits.over:
        names = [name for name in LIMITED_METRICS if limits[0].get(name) != limits[1].get(name)]
        pairs = [f"{name} {limits[0].get(name, DASH)} in A, {limits[1].get(name, DASH)} in B" for name in names]
        what = "; ".join(pairs) or f"over = {a.study.limits.over} in A, {b.study.limits.over} in B"
        texts.append(f"Warning: the limits differ ({what}), so the yields answer different requirements.")
    if keys := [key for key, *_ in differing_inputs(a.study, b.study) if key.startswith("design.")]:
        texts.append(
            f"Warning: the designs differ in {count_text(len(keys), 'setting')} ({a.study.design.title} / "
            f"{b.study.design.title}), so differences are not due to tolerances alone."
        )
    if pairs := [
        f"{key} {value_a if value_a is not None else DASH} in A, {value_b if value_b is not None else DASH} in B"
        for key, value_a, value_b in differing_inputs(a.study, b.study)
        if not key.startswith(NOT_HOW_MEASURED)
    ]:
        texts.append(
            f"Warning: the runs differ in how units are loaded and read ({'; '.join(pairs)}), so differences are not "
            "due to tolerances alone."
        )
    shares = {"the units of A": preloaded_share(a.units), "those of B": preloaded_share(b.units)}
    return [*texts, *preload_warnings(shares, CHECK_TOLERANCES)]


def yield_sentence(a: ComparedRun, b: ComparedRun, rows: pd.DataFrame) -> str:
    """The difference of the yield against all limits; empty where not both studies set limits."""
    shares = rows[(rows["metric"] == ALL_LIMITS) & (rows["statistic"] == "yield")]
    if not len(shares):
        return ""
    row = shares.iloc[0]
    ends = interval(100 * row["ci_low"], 100 * row["ci_high"], SHARE)
    return (
        f"{_compared_units(a, b, row)}{percent(row['a'])} of the units of {a.label} meet every limit, "
        f"{percent(row['b'])} of {b.label}. The difference of {signed_number(100 * row['difference'], 1)} percentage "
        f"points (interval {ends}) is {_significance(row)}."
    )


def _compared_units(a: ComparedRun, b: ComparedRun, row: pd.Series) -> str:
    """Which units are compared where some of a run are not; empty where all are."""
    if not row["paired"] or (row["n_a"], row["n_b"]) == (len(a.units), len(b.units)):
        return ""
    return (
        f"Compared are the {count_text(int(row['n_a']), 'unit')} of the same draws that have a result in both runs, "
        f"of {len(a.units):,} in A and {len(b.units):,} in B; yields, means and spreads of all units are in the report "
        "of each run. Of these units: "
    )


def metric_answers(a: ComparedRun, b: ComparedRun, rows: pd.DataFrame) -> list[dict[str, str]]:
    """For each metric that varies its title, and what its mean and spread say."""
    answers = []
    for name, metric in METRICS.items():
        of_metric = rows[rows["metric"] == name].set_index("statistic")
        statistics = [statistic for statistic in ANSWERED_STATISTICS if statistic in of_metric.index]
        if _constant(a, b, name) or not statistics:
            continue
        cells = {
            statistic: _row({"metric": name, "statistic": statistic, **of_metric.loc[statistic]})
            for statistic in statistics
        }
        parts = [
            f"{title} {cell['a']} in A, {cell['b']} in B; the difference of {cell['difference']} "
            f"{_answer(cell['ends'], of_metric.loc[statistic])}"
            for (statistic, cell), title in zip(cells.items(), ("Mean", "Standard deviation"), strict=False)
        ]
        unit = "" if metric.unit == "1" else f" [{metric.unit}]"
        answers.append({"title": f"{metric.title}{unit}", "text": ". ".join(parts)})
    return answers


def _answer(ends: str, row: pd.Series) -> str:
    """The interval of a difference and whether it is significant; that there is none where so few units have none."""
    return f"(interval {ends}) is {_significance(row)}" if ends else "has no interval: too few units"


def _significance(row: pd.Series) -> str:
    is_significant = row["ci_low"] > 0 or row["ci_high"] < 0
    return "statistically significant" if is_significant else "not statistically significant"


def _statistic_title(name: str) -> str:
    """A statistic in words: ``p05`` is the 5 % quantile."""
    if re.fullmatch(r"p\d\d", name):
        return f"{int(name[1:])} % quantile"
    return "standard deviation" if name == "std" else name


def _constant(a: ComparedRun, b: ComparedRun, metric: str) -> bool:
    """Whether a metric is one number in both runs, as the hysteresis loss without friction."""
    values = np.concatenate([run.units[metric].dropna().to_numpy(float) for run in (a, b)])
    return values.size == 0 or (values.size > 1 and float(np.ptp(values)) == 0)


def _text(value: Any) -> str | None:
    return None if value is None else value if isinstance(value, str) else shown_value(value)


def _row(row: dict[Any, Any]) -> dict[str, Any]:
    share = row["statistic"] == "yield"
    quantity = SHARE if share else METRICS[row["metric"]]
    factor = 100 if share else 1
    finer = Quantity(quantity.title, quantity.unit, quantity.decimals + 1)
    has_interval = np.isfinite(row["ci_low"]) or np.isfinite(row["ci_high"])
    title = "All limits" if row["metric"] == ALL_LIMITS else METRICS[row["metric"]].title
    return {
        "title": title,
        "unit": quantity.unit,
        "statistic": _statistic_title(str(row["statistic"])),
        "a": number(factor * row["a"], quantity),
        "b": number(factor * row["b"], quantity),
        "difference": number(factor * row["difference"], finer),
        "ends": interval(factor * row["ci_low"], factor * row["ci_high"], finer) if has_interval else "",
        "certain": bool(row["ci_low"] > 0 or row["ci_high"] < 0),
    }


def _drivers(table: pd.DataFrame) -> list[dict[str, str]]:
    """The leading drivers of every metric by each kind."""
    rows = []
    table = table[table["parameter"] != SUM]
    for (metric, kind), part in table.groupby(["metric", "kind"], sort=False):
        if METRICS[metric].needs_friction or METRICS[metric].needs_disks:
            continue
        size = part[["index_a", "index_b"]].abs().max(axis=1).sort_values(ascending=False, kind="stable")
        for position in size.dropna().index[:LEADING]:
            row = part.loc[position]
            cells = {}
            for run in "ab":
                cells[run] = _index(row[f"index_{run}"])
                cells[f"ends_{run}"] = f"{_index(row[f'ci_low_{run}'])} to {_index(row[f'ci_high_{run}'])}"
            title = parameter_title(row["parameter"])
            rows.append({"metric": METRICS[metric].title, "kind": KINDS[kind], "parameter": title, **cells})
    return rows


def _index(value: float) -> str:
    return signed_number(value, 2) if np.isfinite(value) else DASH


def _pictures(a: ComparedRun, b: ComparedRun, metrics: Sequence[str], folder: Path) -> dict[str, Picture]:
    if a.study.samples.experiment == "cases" or not metrics:
        return {}
    runs = {f"A: {a.label}": a.units, f"B: {b.label}": b.units}
    figure = overlay_figure(runs, [run.study.limits.of_metrics for run in (a, b)], metrics)
    caption = "Upright lines are the limits of each run. Values over the turn, as the limits count them."
    return drawn_pictures({"distributions": figure}, {"distributions": ("Distributions of both runs", caption)}, folder)

"""The page on worst cases beside statistics."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.decisions.bounds.results import BOUNDS, CAPABILITY, CONTRIBUTIONS, STACKS, BoundFindings, table_rows
from pipeline.engine.store import write_atomic
from pipeline.figures.decisions import bounds_figure
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.report.layout.rendering import Picture, drawn_picture, render
from pipeline.report.layout.wording import number, percent, percent_interval

TEMPLATE = "decisions/bounds.html"
LARGEST_GAP = 0.1
"""Relative error of the linear stack's standard deviation beyond which its contributions are marked."""
STATISTICS = {"mean": "mean", "std": "standard deviation", "far": "99.73 % quantile (unfavourable side)"}


def write_bounds_page(bound_findings: BoundFindings, folder: Path) -> None:
    """Write report.html into ``folder``."""
    tables = {table: pd.DataFrame(rows) for table, rows in table_rows(bound_findings).items()}
    invalid = invalid_stacks(tables[STACKS])
    page = render(
        TEMPLATE,
        study=bound_findings.study,
        sentence=bounds_sentence(tables[BOUNDS], tables[STACKS]),
        bounds=[_bound(row) for row in tables[BOUNDS].to_dict("records")],
        stacks=[_stack(row) for row in tables[STACKS].to_dict("records")],
        cranks=sorted(set(tables[CONTRIBUTIONS]["crank_deg"])),
        contributions=_contributions(tables[CONTRIBUTIONS], invalid),
        invalid=[METRICS[name].inline for name in invalid],
        largest_gap=percent(LARGEST_GAP),
        capabilities=[_capability(row) for row in tables[CAPABILITY].to_dict("records")],
        pictures={"bounds": _picture(tables[BOUNDS], tables[STACKS], folder)},
    )
    write_atomic(folder / "report.html", page.encode())


def bounds_sentence(bounds: pd.DataFrame, stacks: pd.DataFrame) -> str:
    """The worst case of every metric at any crank angle, and how far single drawn units come.

    Parameters
    ----------
    bounds, stacks : rows of `BOUNDS` and `STACKS`.
    """
    parts = []
    for name, rows in bounds.groupby("metric", sort=False):
        metric = METRICS[str(name)]
        extreme, side = (pd.Series.min, "at least") if metric.smaller_is_worse else (pd.Series.max, "at most")
        far_stacks = stacks[(stacks["metric"] == name) & (stacks["statistic"] == "far")]["full"]
        unit = "" if metric.unit == "1" else f" {metric.unit}"
        drawn_text = (
            f" (99.73 % of drawn units: {side} {number(extreme(far_stacks), metric)}{unit})" if len(far_stacks) else ""
        )
        parts.append(f"{metric.inline} {number(extreme(rows['value']), metric)}{unit}{drawn_text}")
    return f"With every error anywhere within its limits the worst values are: {', '.join(parts)}."


def _picture(bounds: pd.DataFrame, stacks: pd.DataFrame, folder: Path) -> Picture:
    """The figure, written into ``folder`` too."""
    caption = (
        "Of single units at each crank angle. Diamonds: worst cases over the tolerance box, of the play its largest "
        "and least from both sides. Bars: three standard deviations about the mean, of the full model and of the "
        "linear stack; where they differ, a linear stack-up is not valid."
    )
    title, figure = "Worst case, linear stack and Monte Carlo", bounds_figure(bounds, stacks)
    return drawn_picture(figure, title, caption, folder / "figures" / "bounds")


def _bound(row: dict) -> tuple[str, str, str, str]:
    quantity = METRICS[row["metric"]]
    return quantity.axis, f"{row['crank_deg']:.4g}", row["what"], number(row["value"], quantity)


def _stack(row: dict) -> dict[str, str]:
    quantity = METRICS[row["metric"]]
    gap = row["linear"] / row["full"] - 1 if row["full"] else float("nan")
    return {
        "title": quantity.axis,
        "crank": f"{row['crank_deg']:.4g}",
        "statistic": STATISTICS[row["statistic"]],
        "linear": number(row["linear"], quantity),
        "full": number(row["full"], quantity),
        "gap": percent(gap),
    }


def invalid_stacks(stacks: pd.DataFrame) -> list[str]:
    """Metrics whose linear stack misses the standard deviation of the full model at some crank angle."""
    spread = stacks[stacks["statistic"] == "std"]
    is_off = (spread["linear"] - spread["full"]).abs() > LARGEST_GAP * spread["full"]
    return list(dict.fromkeys(spread.loc[is_off, "metric"].astype(str)))


def _contributions(table: pd.DataFrame, invalid: list[str]) -> list[tuple[str, str, list[str]]]:
    rows = []
    for (metric, parameter), part in table.groupby(["metric", "parameter"], sort=False):
        by_crank = part.set_index("crank_deg")["percent"].sort_index()
        mark = " (not valid)" if metric in invalid else ""
        shares = [percent(value / 100) for value in by_crank]
        rows.append((f"{METRICS[metric].title}{mark}", PARAMETERS[parameter], shares))
    return rows


def _capability(row: dict) -> dict[str, object]:
    quantity = METRICS[row["metric"]]
    return {
        "title": quantity.axis,
        "mean": number(row["mean"], quantity),
        "std": number(row["std"], quantity),
        "cpk": f"{row['cpk']:.2f}",
        "normal": percent(row["yield_if_normal"]),
        "yield": percent(row["yield"]),
        "ends": percent_interval(row["ci_low"], row["ci_high"]),
        "normality": f"{'not rejected' if row['is_normal_plausible'] else 'rejected'} (n = {row['n']:,})",
    }

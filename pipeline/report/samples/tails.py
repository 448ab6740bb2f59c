"""Far tails as the page tells them: parts per million beyond each limit, and quantiles."""

from dataclasses import dataclass

from pipeline.figures.style import METRICS
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import interval, number
from pipeline.report.results import Cell, Results

MILLION = 1e6
"""Parts of a whole."""


@dataclass(frozen=True)
class TailLine:
    """One metric as text: its limit, units beyond it, its far quantile, and how many units know each as well."""

    name: str
    title: str
    unit: str
    limit: str
    exceedance: Cell
    beyond_effective: str
    level: str
    quantile: Cell
    quantile_effective: str


def tail_lines(frames: Frames) -> list[TailLine]:
    """A line for each metric that has a far tail; none where the study does not ask for them."""
    lines = []
    for metric, rows in frames.tails.groupby("metric", sort=False, observed=True):
        quantity, results = METRICS[metric], Results(frames)
        exceeding, distant = (rows[(rows["statistic"] == "beyond") == shares].iloc[0] for shares in (True, False))
        ends = [min(max(MILLION * float(exceeding[end]), 0.0), MILLION) for end in ("value", "ci_low", "ci_high")]
        lines.append(
            TailLine(
                name=metric,
                title=quantity.title,
                unit=quantity.unit,
                limit=results.limit(metric),
                exceedance=Cell(f"{ends[0]:,.0f}", f"{ends[1]:,.0f} to {ends[2]:,.0f}"),
                beyond_effective=f"{exceeding['effective']:,.0f}",
                level=f"{str(distant['statistic']).removeprefix('p')} %",
                quantile=Cell(
                    number(distant["value"], quantity), interval(distant["ci_low"], distant["ci_high"], quantity)
                ),
                quantile_effective=f"{distant['effective']:,.0f}",
            )
        )
    return lines

"""Estimates and their intervals against the number of samples that they rest on."""

from collections.abc import Mapping

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from pipeline.figures.labels import METRICS
from pipeline.figures.style import ACCENT, ALARM, COLOURS, MARKERS, MUTED_INK, legend_below, new_figure, with_style

LABELLED_SHARES = (1.0, 2.0, 5.0)
"""Numbers of a decade that stand on the axis."""
QUANTILES = {"p95": "95 % quantile", "p50": "median", "p05": "5 % quantile"}


@with_style
def sample_convergence_figure(
    rows: pd.DataFrame, limits: Mapping[str, float], share: str, half_width: float | None
) -> Figure:
    """Quantiles of each metric, and the yield, against the number of samples; bands are their intervals.

    Parameters
    ----------
    rows : ``metric``, ``statistic``, ``n``, ``value``, ``ci_low``, ``ci_high``; an infinite end is one that the samples
        do not determine, and the band begins where both are known.
    limits : metric -> limit.
    share : name of the metric whose rows are the yield.
    half_width : wanted of the yield's interval, drawn about the middle of the last one.
    """
    metrics = list(dict.fromkeys(rows["metric"]))
    lines = -(-len(metrics) // 2)
    figure = new_figure(2.7 * lines)
    panels = figure.subplots(lines, 2, squeeze=False).flat
    for axes in panels[len(metrics) :]:
        axes.set_visible(False)
    quantiles = None
    for axes, metric in zip(panels, metrics, strict=False):
        part = rows[rows["metric"] == metric]
        axes.set(xscale="log", xlabel="samples")
        axes.xaxis.set_major_locator(LogLocator(subs=LABELLED_SHARES))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda number, _: f"{number:,.0f}"))
        axes.xaxis.set_minor_locator(NullLocator())
        if metric == share:
            _share(axes, part, half_width)
            continue
        quantiles = axes
        for (statistic, label), colour, marker in zip(QUANTILES.items(), COLOURS, MARKERS, strict=False):
            _draw_band(axes, part[part["statistic"] == statistic], 1.0, colour, marker, label)
        if metric in limits:
            axes.axhline(limits[metric], color=ALARM, linewidth=1.2, linestyle="--", label="limit")
        axes.set(title=METRICS[metric].title, ylabel=METRICS[metric].unit)
    if quantiles is not None:
        legend_below(figure, quantiles)
    return figure


def _share(axes: Axes, rows: pd.DataFrame, half_width: float | None) -> None:
    _draw_band(axes, rows, 100.0, ACCENT, "o", "yield")
    if half_width is not None:
        middle = 50 * float(rows["ci_low"].iloc[-1] + rows["ci_high"].iloc[-1])
        for end in (middle - 100 * half_width, middle + 100 * half_width):
            axes.axhline(end, color=MUTED_INK, linewidth=1.0, linestyle=":")
    axes.set(title="Yield against all limits", ylabel="%")


def _draw_band(axes: Axes, rows: pd.DataFrame, scale: float, colour: str, marker: str, label: str) -> None:
    n, value = rows["n"], scale * rows["value"]
    axes.plot(n, value, marker=marker, markersize=3, linewidth=1.1, color=colour, label=label)
    low, high = (scale * rows[end].where(abs(rows[end]) < float("inf")) for end in ("ci_low", "ci_high"))
    axes.fill_between(n, low, high, color=colour, alpha=0.18, linewidth=0)

"""Distributions of the metrics over the samples: with limits, of two runs, and beside published units."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.figures.labels import FULL_TURN, LIMITED_METRICS, METRICS
from pipeline.figures.style import (
    ACCENT,
    ACCENT_LIGHT,
    ALARM,
    COLOURS,
    INK,
    MUTED_INK,
    legend_below,
    new_figure,
    paired_panels,
    with_style,
    write_beside,
)

BARS = "#a9cbe4"
BINS = (8, 40)
"""Fewest and most bars of a histogram."""
FEW_ANGLES = 6
"""Crank angles that are drawn one by one; more of them are lines with a band."""
MOST_BARS = 40
"""Crank angles whose bars have room side by side; more of them are drawn thinner."""
BAND = "5 % to 95 %"
ESTIMATES = {"p05": "5 %", "mean": "mean", "p95": "95 %"}


@with_style
def distributions_figure(
    values: pd.DataFrame, estimates: pd.DataFrame, limits: Mapping[str, float], nominal: Mapping[str, float]
) -> Figure:
    """Histogram of each metric; below it the 5th percentile, the mean and the 95th with their intervals.

    Parameters
    ----------
    values : one row a sample, one column a metric (a name of `METRICS`).
    estimates : ``metric``, ``statistic``, ``value``, ``ci_low``, ``ci_high``; an infinite end of an interval is one
        that the samples do not determine, drawn as an arrow.
    limits : metric -> limit; upper, but for metrics of which smaller is worse.
    nominal : metric -> value of the nominal reducer.
    """
    metrics = list(values)
    figure, panels = paired_panels(len(metrics), 3.1)
    for axes, metric in zip(panels, metrics, strict=True):
        rows = estimates[estimates["metric"] == metric].set_index("statistic")
        draw_histogram(axes, values[metric].dropna().to_numpy(), metric, limits.get(metric), nominal.get(metric))
        _estimates(axes, rows)
    return figure


def draw_histogram(
    axes: Axes, values: np.ndarray, metric: str, limit: float | None = None, nominal: float | None = None
) -> Axes:
    """Histogram of values (n,) of a metric, its limit and the value of the nominal reducer."""
    quantity = METRICS[metric]
    edges = np.histogram_bin_edges(values, "fd") if np.ptp(values) > 0 else np.array([0.0, 1.0])
    bars = int(np.clip(len(edges) - 1, *BINS)) if np.ptp(values) > 0 else 1
    counts, edges = np.histogram(values, bars)
    axes.bar(edges[:-1], counts, np.diff(edges), align="edge", color=BARS, edgecolor="white", linewidth=0.6)
    axes.grid(False, axis="x")
    top = counts.max()
    marked_values = [value for value in (limit, nominal) if value is not None and np.isfinite(value)]
    low, high = min([edges[0], *marked_values]), max([edges[-1], *marked_values])
    room = 0.06 * (high - low)
    axes.set(xlabel=quantity.axis, ylabel="samples", xlim=(low - room, high + room), ylim=(-0.36 * top, 1.12 * top))
    ticks = MaxNLocator(5, integer=True).tick_values(0, top)
    axes.set_yticks(ticks[ticks <= top])
    axes.axhline(0, color=MUTED_INK, linewidth=0.8)
    if nominal is not None and np.isfinite(nominal):
        axes.plot([nominal], [0.0], "D", color=INK, markersize=5, markerfacecolor="white", clip_on=False, zorder=5)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
        write_beside(axes, "nominal", (nominal, 0), (0, 8), ha="center", color=INK, bbox=box, zorder=6)
    if limit is not None:
        start, end = axes.get_xlim()
        axes.axvline(limit, color=ALARM, linewidth=1.3)
        failing = (start, limit) if quantity.smaller_is_worse else (limit, end)
        axes.axvspan(*failing, facecolor=ALARM, alpha=0.07, linewidth=0)
        is_right = limit < 0.5 * (start + end)
        style = {"ha": "left" if is_right else "right", "va": "top", "fontsize": 8.5, "color": ALARM}
        write_beside(axes, f"limit {limit:g}", (limit, 1.12 * top), (4 if is_right else -4, -2), **style)
        axes.set_xlim(start, end)
    return axes


def _estimates(axes: Axes, rows: pd.DataFrame) -> None:
    """The estimates below the histogram, with bars for the determined ends of their intervals."""
    start, end = axes.get_xlim()
    depth = -axes.get_ylim()[0]
    for line, (name, text) in enumerate(ESTIMATES.items()):
        if name not in rows.index or not np.isfinite(rows.loc[name, "value"]):
            continue
        value, low, high = (float(rows.loc[name, key]) for key in ("value", "ci_low", "ci_high"))
        y = -depth * (0.22 + 0.3 * line)
        axes.plot(
            [max(low, start), min(high, end)], [y, y], color=ACCENT, linewidth=2.2, solid_capstyle="butt", alpha=0.55
        )
        for bound, marker, edge in ((low, "<", start), (high, ">", end)):
            if not np.isfinite(bound):
                axes.plot([edge], [y], marker, color=ACCENT, markersize=4, alpha=0.55, clip_on=False)
        axes.plot([value], [y], "o", color=ACCENT, markersize=4.5)
        write_beside(axes, text, (1.0, y), (3, 0), xycoords=("axes fraction", "data"), color=MUTED_INK, va="center")


@with_style
def crank_figure(
    estimates: pd.DataFrame, nominal: pd.DataFrame, metrics: Sequence[str], limits: Mapping[str, float]
) -> Figure:
    """Each metric against the crank angle: mean and 5 % to 95 % of the samples, and the nominal reducer.

    Parameters
    ----------
    estimates : ``metric``, ``crank_deg``, ``statistic``, ``value``; the rows with a crank angle.
    nominal : ``crank_deg`` and one column a metric; no rows where the study has no nominal sample.
    metrics : names of `METRICS`.
    limits : as in `distributions_figure`.
    """
    figure = new_figure(2.8)
    for axes, metric in zip(figure.subplots(1, len(metrics), squeeze=False)[0], metrics, strict=True):
        rows = estimates[estimates["metric"] == metric].pivot(index="crank_deg", columns="statistic", values="value")
        count = len(rows) > FEW_ANGLES and rows.index.max() < FULL_TURN
        if count:
            axes.fill_between(rows.index, rows["p05"], rows["p95"], color=ACCENT, alpha=0.25, linewidth=0, label=BAND)
        else:
            width = 6 if len(rows) <= MOST_BARS else 6 * MOST_BARS / len(rows)
            axes.vlines(rows.index, rows["p05"], rows["p95"], color=ACCENT, linewidth=width, alpha=0.3, label=BAND)
        size = 2.5 if count else 4.5 * min(1.0, (MOST_BARS / len(rows)) ** 0.5)
        axes.plot(rows.index, rows["mean"], "-o" if count else "o", color=ACCENT, markersize=size, label="mean")
        if len(nominal):
            style = {"color": INK, "markerfacecolor": "white", "markersize": size, "linewidth": 0.9}
            axes.plot(nominal["crank_deg"], nominal[metric], "-D" if count else "D", label="nominal", **style)
        if metric in limits:
            axes.axhline(limits[metric], color=ALARM, linewidth=1.2, label="limit")
        axes.set(xlabel="crank angle (degrees)", title=METRICS[metric].title, ylabel=METRICS[metric].unit)
        axes.margins(x=0.15, y=0.12)
        if len(rows) <= FEW_ANGLES:
            axes.set_xticks(rows.index)
        elif rows.index.max() >= FULL_TURN:
            axes.xaxis.set_major_locator(MaxNLocator(4))
    legend_below(figure, axes)
    return figure


OVERLAY_BARS = 40
"""Bars of the common histogram."""
RUN_LINES = ("-", "--")


@with_style
def overlay_figure(
    runs: Mapping[str, pd.DataFrame], limits: Sequence[Mapping[str, float]], metrics: Sequence[str]
) -> Figure:
    """Share of the samples per bar of each metric, one outline a run.

    Parameters
    ----------
    runs : label -> one row a sample, one column a metric; two of them.
    limits : metric -> limit, of each run.
    metrics : names of `METRICS`.
    """
    figure, panels = paired_panels(len(metrics), 2.8)
    for axes, metric in zip(panels, metrics, strict=True):
        values = [frame[metric].dropna().to_numpy(float) for frame in runs.values()]
        edges = np.histogram_bin_edges(np.concatenate(values), OVERLAY_BARS).tolist()
        for label, entry, colour, line, limit in zip(runs, values, COLOURS, RUN_LINES, limits, strict=False):
            weight = np.full(entry.size, 1 / max(entry.size, 1))
            axes.hist(entry, edges, weights=weight, histtype="stepfilled", color=colour, alpha=0.18)
            axes.hist(entry, edges, weights=weight, histtype="step", color=colour, linestyle=line, label=label)
            if metric in limit:
                axes.axvline(limit[metric], color=colour, linestyle=line, linewidth=1.1)
        axes.set(xlabel=METRICS[metric].axis, ylabel="share of the samples")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return figure


UNIT_LINES = ("-", "--", ":", "-.")


@with_style
def published_figure(
    values: Mapping[str, np.ndarray],
    measured_values: Mapping[str, Mapping[str, float]],
    waves: pd.DataFrame | None,
    named_orders: Sequence[int],
) -> Figure:
    """Histogram of each metric with a line for each measured unit, and the predicted orders.

    Parameters
    ----------
    values : metric -> (n,) of the predicted units.
    measured_values : metric -> label of a unit -> its value.
    waves : ``middle``, ``high`` [arcsec] by order of the output turn; None for no panel.
    named_orders : orders that the sources name.
    """
    count = len(values) + (waves is not None)
    figure, panels = paired_panels(count, 3.2, min(count, 2))
    for axes, (name, predicted_values) in zip(panels, values.items(), strict=False):
        _histogram(axes, predicted_values, name, measured_values[name])
    if waves is not None:
        _orders(panels[-1], waves, named_orders)
    return figure


def _histogram(axes: Axes, predicted_values: np.ndarray, name: str, measured_values: Mapping[str, float]) -> None:
    bars = int(np.clip(np.sqrt(len(predicted_values)), *BINS))
    axes.hist(predicted_values, bars, color=BARS, edgecolor="white", linewidth=0.6, label="predicted units")
    for number, (label, value) in enumerate(measured_values.items()):
        axes.axvline(value, color=ALARM, linewidth=1.4, linestyle=UNIT_LINES[number % len(UNIT_LINES)], label=label)
    quantity = LIMITED_METRICS[name]
    axes.set(xlabel=f"{quantity.title} ({quantity.unit})", ylabel="units")
    axes.grid(False, axis="x")
    legend_below(axes.figure, axes)


def _orders(axes: Axes, waves: pd.DataFrame, named_orders: Sequence[int]) -> None:
    axes.vlines(waves.index, 0, waves["high"], color=ACCENT_LIGHT, linewidth=1.6)
    axes.vlines(waves.index, 0, waves["middle"], color=ACCENT, linewidth=1.6)
    heights = waves.loc[list(named_orders), "high"]
    axes.plot(named_orders, heights, "v", color=INK, markersize=5, markerfacecolor="white")
    for order, height in heights.items():
        write_beside(axes, str(order), (order, height), (0, 5), ha="center")
    axes.set(xlabel="waves per turn of the output", ylabel="amplitude (arcsec)", xlim=(0, None), ylim=(0, None))

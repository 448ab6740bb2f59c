"""Units that meet their limits: which limits fail, the scale of each tolerance, single units, and more samples."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.figures.labels import LIMITED_METRICS, METRICS, PARAMETERS
from pipeline.figures.style import ACCENT, ALARM, COLOURS, INK, MARKERS, MUTED_INK, legend_below, new_figure, with_style

CURVES = 5
"""Tolerances of the widest span of yields that have a line; more could not be told apart."""


@with_style
def failures_figure(
    breaks: Mapping[str, NDArray[np.bool_]], curves: Mapping[str, NDArray[np.float64]], target: float
) -> Figure:
    """Share of all units that break each limit, most first; beside it yield against the scale of each tolerance.

    Parameters
    ----------
    breaks : metric -> whether each unit (n,) breaks its limit.
    curves : tolerance -> scales, yields and the ends of their intervals (4, n), widest span first; may be empty.
    target : yield that is aimed at.
    """
    figure = new_figure(max(0.9 + 0.3 * len(breaks), 3.3 if curves else 0.0))
    pareto, *other_axes = figure.subplots(
        1, 2 if curves else 1, squeeze=False, width_ratios=[1, 1.25] if curves else None
    )[0]
    _draw_breaks(pareto, breaks)
    if curves:
        _draw_curves(other_axes[0], curves, target)
    return figure


def _draw_breaks(axes: Axes, breaks: Mapping[str, NDArray[np.bool_]]) -> None:
    names = sorted(breaks, key=lambda name: float(np.mean(breaks[name])))
    broken = np.stack([breaks[name] for name in names])
    breaks_alone = broken & (broken.sum(axis=0) == 1)
    for row, (all_units, only) in enumerate(zip(broken.mean(axis=1), breaks_alone.mean(axis=1), strict=True)):
        axes.barh(row, 100 * all_units, 0.6, color=COLOURS[4], label="breaks this limit" if row == 0 else None)
        axes.barh(row, 100 * only, 0.6, color=ALARM, label="breaks no other limit" if row == 0 else None)
        axes.annotate(
            f"{100 * all_units:.3g} %", (100 * all_units, row), (4, 0), textcoords="offset points", va="center"
        )
    axes.set_yticks(range(len(names)), [LIMITED_METRICS[name].title for name in names])
    axes.set(xlabel="units (%)")
    axes.set_xlim(0, 1.25 * max(100 * float(broken.mean(axis=1).max()), 1e-9))
    axes.grid(visible=False, axis="y")
    axes.legend(loc="lower center", bbox_to_anchor=(0.3, 1.0), ncols=2, columnspacing=1.0, handlelength=1.2)


def _draw_curves(axes: Axes, curves: Mapping[str, NDArray[np.float64]], target: float) -> None:
    shown_curves = list(curves.items())[:CURVES]
    for (name, (scale, value, low, high)), colour, marker in zip(shown_curves, COLOURS, MARKERS, strict=False):
        axes.plot(scale, 100 * value, color=colour, marker=marker, label=PARAMETERS[name])
        if name == shown_curves[0][0]:
            axes.fill_between(scale, 100 * low, 100 * high, color=colour, alpha=0.12, linewidth=0)
    axes.axhline(100 * target, color=MUTED_INK, linestyle=":")
    axes.annotate(f"{100 * target:g} %", (1, 100 * target), (-2, 2), xycoords=("axes fraction", "data"), ha="right",
                  textcoords="offset points", color=MUTED_INK, fontsize=8)  # fmt: skip
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set(xlabel="factor on the limits of the tolerance (1: as stated)", ylabel="yield (%), estimated", xscale="log")
    ticks = list(shown_curves[0][1][0]) if shown_curves else [1.0]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticklabels([f"{tick:g}" for tick in ticks])
    axes.legend(loc="lower left")


@with_style
def units_figure(
    metrics: Sequence[str], values: Real, limits: Mapping[str, float], torque: Real, angles: Real
) -> Figure:
    """Two metrics of every unit against each other with their limits, and the units' loops.

    Parameters
    ----------
    metrics : names of the two.
    values : (n_units, 2), in their units.
    limits : by metric, where there are any.
    torque : (n_steps,) [N m].
    angles : (n_units, n_steps) [arcmin].
    """
    figure = new_figure(3.4)
    scatter, loops = figure.subplots(1, 2)
    scatter.plot(*values.T, "o", color=ACCENT, alpha=0.6)
    for name, line in zip(metrics, (scatter.axvline, scatter.axhline), strict=True):
        if name in limits:
            line(limits[name], color=ALARM, linestyle="--", linewidth=1.0)
    scatter.set_xlabel(METRICS[metrics[0]].axis)
    scatter.set_ylabel(METRICS[metrics[1]].axis)
    scatter.set_title("Units; dashed: limits")
    loops.plot(torque, angles.T, color=ACCENT, alpha=0.25, linewidth=0.7)
    loops.set_xlabel("torque (N m)")
    loops.set_ylabel("angle of the output (arcmin)")
    loops.set_title("Their loops")
    return figure


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

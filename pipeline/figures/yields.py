"""Units that meet their limits: which limits fail, the scale of each tolerance, single units, and more samples."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from pipeline.arrays import Real, Truth
from pipeline.figures.labels import LIMITED_METRICS, METRICS, PARAMETERS, parameter_title
from pipeline.figures.style import (
    ACCENT,
    ALARM,
    COLOURS,
    INK,
    MARKERS,
    MUTED_INK,
    legend_below,
    new_figure,
    with_style,
    write_beside,
)
from pipeline.model.metrics import signed_number
from pipeline.statistics.sensitivity import FIRST_ORDER, RANK_CORRELATION, SUM, TOTAL, are_determined

CURVES = 5
"""Tolerances of the widest span of yields that have a line; more could not be told apart."""


@with_style
def failures_figure(breaks: Mapping[str, Truth], curves: Mapping[str, Real], target: float) -> Figure:
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


def _draw_breaks(axes: Axes, breaks: Mapping[str, Truth]) -> None:
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
    axes.set(xlabel="units (%)", xlim=(0, 1.25 * max(100 * float(broken.mean(axis=1).max()), 1e-9)))
    axes.grid(visible=False, axis="y")
    axes.legend(loc="lower center", bbox_to_anchor=(0.3, 1.0), ncols=2, columnspacing=1.0, handlelength=1.2)


def _draw_curves(axes: Axes, curves: Mapping[str, Real], target: float) -> None:
    shown_curves = list(curves.items())[:CURVES]
    for (name, (scale, value, low, high)), colour, marker in zip(shown_curves, COLOURS, MARKERS, strict=False):
        axes.plot(scale, 100 * value, color=colour, marker=marker, label=PARAMETERS[name])
        if name == shown_curves[0][0]:
            axes.fill_between(scale, 100 * low, 100 * high, color=colour, alpha=0.12, linewidth=0)
    axes.axhline(100 * target, color=MUTED_INK, linestyle=":")
    style = {"xycoords": ("axes fraction", "data"), "ha": "right", "color": MUTED_INK}
    write_beside(axes, f"{100 * target:g} %", (1, 100 * target), (-2, 2), **style)
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set(xlabel="factor on the limits of the tolerance (1: as stated)", ylabel="yield (%), estimated", xscale="log")
    ticks = list(shown_curves[0][1][0]) if shown_curves else [1.0]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticklabels([f"{tick:g}" for tick in ticks])
    axes.legend(loc="best", frameon=True, framealpha=0.85, edgecolor="none")


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
    scatter.set(xlabel=METRICS[metrics[0]].axis, ylabel=METRICS[metrics[1]].axis, title="Units; dashed: limits")
    loops.plot(torque, angles.T, color=ACCENT, alpha=0.25, linewidth=0.7)
    loops.set(xlabel="torque (N m)", ylabel="angle of the output (arcmin)", title="Their loops")
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


PANELS = {RANK_CORRELATION: "Rank correlation", TOTAL: "Share of the variance"}
"""Titles; the second panel has both shares."""
KIND_COLOURS = {RANK_CORRELATION: "#4a97c9", FIRST_ORDER: "#4a97c9", TOTAL: "#b5d3e7"}
SUM_COLOURS = {FIRST_ORDER: "#8b95a1", TOTAL: "#c3cad2"}
LABELS = {FIRST_ORDER: "by itself", TOTAL: "with interactions"}


@with_style
def sensitivity_figure(indices: pd.DataFrame) -> Figure:
    """Bars of rank correlation and of the shares of the variance, largest first; a kind without an index is left out.

    Parameters
    ----------
    indices : rows of ``aggregate/sensitivity`` of one metric: parameter, kind, index, ci_low, ci_high.

    Notes
    -----
    A bar without a filling and a number in brackets are not determined: the interval is as wide as the index. Errors
    that do not vary in the study have an index of exactly 0, or none, and no bar.
    """
    is_estimated = np.isfinite(indices["index"].to_numpy(float)) & (indices["ci_low"] != indices["ci_high"]).to_numpy()
    shown_indices = indices[is_estimated]
    panels = [kind for kind in PANELS if (shown_indices["kind"] == kind).any()]
    bars = {
        RANK_CORRELATION: int((shown_indices["kind"] == RANK_CORRELATION).sum()),
        TOTAL: int((shown_indices["kind"] == TOTAL).sum() * 1.6),
    }
    figure = new_figure(0.85 + 0.24 * max((bars[kind] for kind in panels), default=1))
    for axes, kind in zip(figure.subplots(1, max(len(panels), 1), squeeze=False)[0], panels, strict=False):
        draw_shares(axes, shown_indices, (RANK_CORRELATION,) if kind == RANK_CORRELATION else (FIRST_ORDER, TOTAL))
        axes.set_title(PANELS[kind])
    return figure


def draw_shares(axes: Axes, rows: pd.DataFrame, kinds: tuple[str, ...]) -> Axes:
    """Parameters by the size of their last kind, a bar for each kind; sums of shares come last."""
    order = rows[rows["kind"] == kinds[-1]]
    is_sum = (order["parameter"] == SUM).to_numpy()
    names = list(order["parameter"].iloc[np.lexsort([-np.abs(order["index"].to_numpy(float)), is_sum])])
    height = 0.72 / len(kinds)
    for k, kind in enumerate(kinds):
        part = rows[(rows["kind"] == kind) & rows["parameter"].isin(names)]
        positions = np.array([names.index(name) for name in part["parameter"]], float)
        colours = [SUM_COLOURS[kind] if name == SUM else KIND_COLOURS[kind] for name in part["parameter"]]
        _bars(axes, part, positions + height * (k - (len(kinds) - 1) / 2), height, colours)
    axes.axvline(0, color=MUTED_INK, linewidth=0.8)
    axes.set_yticks(range(len(names)), [parameter_title(name) for name in names])
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.set_ylim(len(names) - 0.5, -0.5)
    if kinds == (RANK_CORRELATION,):
        axes.set(xlim=(-1, 1), xticks=[-1, -0.5, 0, 0.5, 1])
    else:
        shares = rows[rows["kind"].isin(kinds)]
        axes.set_xlim(min(0.0, float(shares["ci_low"].min())), max(1.0, float(shares["ci_high"].max())))
        axes.legend(handles=[Patch(color=KIND_COLOURS[kind], label=LABELS[kind]) for kind in kinds], loc="center right")
    return axes


def _bars(axes: Axes, rows: pd.DataFrame, positions: Real, height: float, colours: list[str]) -> None:
    value, low, high = (rows[name].to_numpy(float) for name in ("index", "ci_low", "ci_high"))
    certain = are_determined(value, low, high)
    for y, number, sure, colour in zip(positions, value, certain, colours, strict=True):
        (bar,) = axes.barh(y, number, height=0.92 * height, color=colour)
        if not sure:
            bar.set(facecolor="none", edgecolor=MUTED_INK, linestyle=":")
        text = signed_number(number, 2) if sure else f"({signed_number(number, 2)})"
        style = {"va": "center", "fontsize": 8 if height > 0.5 else 7, "color": INK if sure else MUTED_INK}
        write_beside(axes, text, (1.0, y), (4, 0), xycoords=("axes fraction", "data"), **style)
    has_interval = np.isfinite(low) & np.isfinite(high)
    axes.hlines(positions[has_interval], low[has_interval], high[has_interval], color=INK, linewidth=1.0)

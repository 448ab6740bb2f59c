"""Which limits the failing units break, and how the yield follows the scale of each tolerance."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import NDArray

from pipeline.figures.labels import LIMITED_METRICS, PARAMETERS
from pipeline.figures.style import ALARM, COLOURS, INK, MARKERS, MUTED_INK, new_figure, with_style

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
    axes.set(
        xlabel="limits of the tolerance, as a multiple of those stated", ylabel="yield (%), estimated", xscale="log"
    )
    ticks = list(shown_curves[0][1][0]) if shown_curves else [1.0]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticklabels([f"{tick:g}" for tick in ticks])
    axes.legend(loc="lower left")

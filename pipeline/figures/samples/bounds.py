"""Worst cases, linear stacks and Monte Carlo of each metric beside each other."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.labels import METRICS
from pipeline.figures.style import ACCENT, ALARM, COLOURS, INK, legend_below, new_figure, with_style

ROWS = {"full": ("Monte Carlo", ACCENT), "linear": ("linear stack (RSS)", COLOURS[2])}
"""Columns of the stacks, with their labels and colours."""
DEVIATIONS = 3.0
"""Standard deviations on either side of the mean."""


@with_style
def bounds_figure(bounds: pd.DataFrame, stacks: pd.DataFrame) -> Figure:
    """For each metric and crank angle the worst cases, and the mean with three standard deviations of both models.

    Parameters
    ----------
    bounds : ``metric``, ``crank_deg``, ``value``; one or more bounds each.
    stacks : ``metric``, ``crank_deg``, ``statistic`` (mean, std, or far: 99.73 %, worse side), ``linear``, ``full``.
    """
    metrics = list(dict.fromkeys(stacks["metric"]))
    cranks = sorted(set(stacks["crank_deg"]))
    lines = -(-len(metrics) // 2)
    figure = new_figure(lines * (1.3 + 0.42 * len(cranks)))
    panels = figure.subplots(lines, 2, squeeze=False).flat
    for axes in panels[len(metrics) :]:
        axes.set_visible(False)
    for axes, metric in zip(panels, metrics, strict=False):
        for column_index, crank in enumerate(cranks):
            selections = (
                table[(table["metric"] == metric) & (table["crank_deg"] == crank)] for table in (bounds, stacks)
            )
            _crank(axes, column_index, *selections)
        axes.set_yticks(range(len(cranks)), [f"{crank:g}°" for crank in cranks])
        axes.set(title=METRICS[metric].title, xlabel=METRICS[metric].unit, ylabel="crank angle")
        axes.set_ylim(len(cranks) - 0.4, -0.6)
        axes.grid(False, axis="y")
    legend_below(figure, figure.axes[0])
    return figure


def _crank(axes: Axes, crank_index: int, bounds: pd.DataFrame, stacks: pd.DataFrame) -> None:
    """The three of one metric at one crank angle; labelled at the first."""
    values, is_first = stacks.set_index("statistic"), crank_index == 0
    for lane, (column, (label, colour)) in enumerate(ROWS.items()):
        y = crank_index - 0.12 + 0.24 * lane
        mean, spread = (float(values.loc[name, column]) for name in ("mean", "std"))
        axes.plot(mean + DEVIATIONS * spread * np.array([-1, 1]), [y, y], color=colour, linewidth=4.0, alpha=0.4)
        axes.plot([mean], [y], "o", color=colour, markersize=4.5, label=f"{label}: mean ± 3 σ" if is_first else None)
        tail_label = "99.73 % quantile (worse side)" if is_first and column == "full" else None
        axes.plot(
            [float(values.loc["far", column])], [y], "|", color=INK, markersize=9, markeredgewidth=1.4, label=tail_label
        )
    worst_label = "worst cases" if is_first else None
    axes.plot(bounds["value"], np.full(len(bounds), crank_index), "D", color=ALARM, markersize=4.5, label=worst_label)

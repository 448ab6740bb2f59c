"""Which tolerance drives a metric: indices with their intervals, ranked."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pipeline.arrays import Real
from pipeline.figures.labels import parameter_title
from pipeline.figures.style import INK, MUTED_INK, new_figure, with_style
from pipeline.model.metrics import signed_number
from pipeline.statistics.sensitivity import FIRST_ORDER, RANK_CORRELATION, SUM, TOTAL, are_determined

PANELS = {RANK_CORRELATION: "Rank correlation", TOTAL: "Share of the variance"}
"""Titles; the second panel has both shares."""
COLOURS = {RANK_CORRELATION: "#4a97c9", FIRST_ORDER: "#4a97c9", TOTAL: "#b5d3e7"}
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
        colours = [SUM_COLOURS[kind] if name == SUM else COLOURS[kind] for name in part["parameter"]]
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
        axes.legend(handles=[Patch(color=COLOURS[kind], label=LABELS[kind]) for kind in kinds], loc="center right")
    return axes


def _bars(axes: Axes, rows: pd.DataFrame, positions: Real, height: float, colours: list[str]) -> None:
    value, low, high = (rows[name].to_numpy(float) for name in ("index", "ci_low", "ci_high"))
    certain = are_determined(value, low, high)
    for y, number, sure, colour in zip(positions, value, certain, colours, strict=True):
        (bar,) = axes.barh(y, number, height=0.92 * height, color=colour)
        if not sure:
            bar.set(facecolor="none", edgecolor=MUTED_INK, linestyle=":")
        axes.annotate(
            signed_number(number, 2) if sure else f"({signed_number(number, 2)})",
            (1.0, y),
            (4, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize=8 if height > 0.5 else 7,
            color=INK if sure else MUTED_INK,
        )
    has_interval = np.isfinite(low) & np.isfinite(high)
    axes.hlines(positions[has_interval], low[has_interval], high[has_interval], color=INK, linewidth=1.0)

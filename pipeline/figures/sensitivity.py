"""Which tolerance drives a metric: indices with their intervals, ranked."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.labels import parameter_title
from pipeline.figures.style import INK, MUTED, new_figure, styled
from pipeline.model.metrics import signed

CLEAR, PALE, REST = "#4a97c9", "#cfe2f0", "#c3cad2"
REMAINDER = "remainder"
TITLES = {"rank_correlation": "Rank correlation", "variance_share": "Share of the variance"}


@styled
def sensitivity_figure(indices: pd.DataFrame) -> Figure:
    """Bars of rank correlation and of variance share, largest first; a kind that is not determined is left out.

    Parameters
    ----------
    indices : rows of ``aggregate/sensitivity`` of one metric: parameter, kind, index, ci_low, ci_high.

    Notes
    -----
    A pale bar has an interval that holds 0: the samples do not show that the error matters at all. Errors that do not
    vary in the study have an index of exactly 0, or none, and no bar.
    """
    shown = indices[np.isfinite(indices["index"].to_numpy(float)) & (indices["ci_low"] != indices["ci_high"])]
    kinds = [kind for kind in TITLES if (shown["kind"] == kind).any()]
    most = max((int((shown["kind"] == kind).sum()) for kind in kinds), default=1)
    figure = new_figure(0.75 + 0.24 * most)
    for axes, kind in zip(figure.subplots(1, max(len(kinds), 1), squeeze=False)[0], kinds, strict=False):
        _bars(axes, shown[shown["kind"] == kind], kind)
    return figure


def _bars(axes: Axes, rows: pd.DataFrame, kind: str) -> None:
    rest = (rows["parameter"] == REMAINDER).to_numpy()
    rows = rows.iloc[np.lexsort([-np.abs(rows["index"].to_numpy()), rest])]
    place = np.arange(len(rows))
    value, low, high = (rows[name].to_numpy(float) for name in ("index", "ci_low", "ci_high"))
    colours = np.where((low > 0) | (high < 0), CLEAR, PALE)
    axes.barh(place, value, height=0.66, color=np.where(rows["parameter"] == REMAINDER, REST, colours))
    bounded = np.isfinite(low) & np.isfinite(high)
    axes.hlines(place[bounded], low[bounded], high[bounded], color=INK, linewidth=1.1)
    axes.axvline(0, color=MUTED, linewidth=0.8)
    for y, number in zip(place, value, strict=True):
        axes.annotate(
            signed(number, 2),
            (1.0, y),
            (4, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=INK,
        )
    axes.set_yticks(place, [parameter_title(name) for name in rows["parameter"]])
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.set(title=TITLES[kind], ylim=(len(rows) - 0.5, -0.5))
    if kind == "rank_correlation":
        axes.set(xlim=(-1, 1), xticks=[-1, -0.5, 0, 0.5, 1])
    else:
        axes.set_xlim(min(0.0, float(low[bounded].min(initial=0.0))), max(1.0, float(high[bounded].max(initial=0.0))))

"""Figure of a series: numbers of the loops over the states."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, INK, MUTED, new_figure, styled

ACROSS = 3
"""Panels side by side."""


@styled
def states_figure(states: pd.DataFrame, trends: pd.DataFrame, variable: str) -> Figure:
    """Each number of the loops over the variable, or over the states in order, with its interval and trend.

    Parameters
    ----------
    states : rows of the table ``states`` that are of loops.
    trends : the table ``trends``.
    variable : name; empty where none orders the states.
    """
    rows = -(-len(trends) // ACROSS)
    figure = new_figure(0.3 + 2.6 * rows)
    panels = figure.subplots(rows, min(len(trends), ACROSS), squeeze=False).ravel()
    for axes, trend in zip(panels, trends.to_dict("records"), strict=False):
        chosen = states[(states["number"] == trend["number"]) & (states["loops"] == trend["loops"])]
        place = chosen["variable"].to_numpy() if variable else np.arange(len(chosen))
        colour = ACCENT if trend["shown"] else INK
        axes.vlines(place, chosen["ci_low"], chosen["ci_high"], color=colour)
        axes.plot(place, chosen["value"], "o", color=colour, markersize=4)
        if variable:
            line = np.linspace(place.min(), place.max(), 50)
            axes.plot(
                line, _line(chosen["value"].to_numpy(), place, trend, line), color=colour if trend["shown"] else MUTED
            )
        axes.set_title(f"{trend['number'].replace('_', ' ')}, to {trend['loops']}")
        axes.set_xlabel(variable.replace("_", " ") if variable else "state")
        axes.set_ylabel(str(chosen["unit"].iloc[0]))
    for axes in panels[len(trends) :]:
        axes.set_axis_off()
    return figure


def _line(values: np.ndarray, place: np.ndarray, trend: dict, line: np.ndarray) -> np.ndarray:
    """The trend through the mean of the states (n,): exponential of a positive number."""
    if trend["slope_unit"] == "1":
        return np.exp(np.log(values).mean()) * (1 + trend["slope"]) ** (line - place.mean())
    return values.mean() + trend["slope"] * (line - place.mean())

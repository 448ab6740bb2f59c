"""Figures of several states of one drive: their loops, numbers, changes and residuals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, ALARM, INK, MUTED_INK, RULE, legend_below, new_figure, with_style

ACROSS = 3
"""Panels side by side."""
STAGES = {"refitted": "friction, play and compliance", "after": "with what is named"}
"""Predictions of positions that were left out, with their titles."""


@with_style
def angle_figure(cells: pd.DataFrame) -> Figure:
    """Residuals of unused positions over the crank angle, of the first state: without and with what is named.

    Parameters
    ----------
    cells : the table ``cells``.
    """
    cells = cells[cells["state"] == cells["state"].iloc[0]]
    figure = new_figure(3.2)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (stage, title) in zip(panels, STAGES.items(), strict=True):
        for number, (_, rows) in enumerate(cells.groupby("position", sort=False, observed=True)):
            shade = 0.25 + 0.65 * number / max(cells["position"].nunique() - 1, 1)
            axes.plot(
                rows["crank_deg"] % 360, rows[f"residual_{stage}_arcmin"], ".", color=ACCENT, alpha=shade, markersize=2
            )
        axes.axhline(0.0, color=MUTED_INK, linewidth=0.8)
        axes.set_title(title)
        axes.set_xlabel("crank angle within its turn [deg]")
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 90))
    panels[0].set_ylabel("measured less predicted [arcmin]")
    return figure


@with_style
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
        trend_rows = states[(states["number"] == trend["number"]) & (states["loops"] == trend["loops"])]
        place = trend_rows["variable"].to_numpy() if variable else np.arange(len(trend_rows))
        colour = ACCENT if trend["shown"] else INK
        axes.vlines(place, trend_rows["ci_low"], trend_rows["ci_high"], color=colour)
        axes.plot(place, trend_rows["value"], "o", color=colour, markersize=4)
        if variable:
            line = np.linspace(place.min(), place.max(), 50)
            axes.plot(
                line,
                _line(trend_rows["value"].to_numpy(), place, trend, line),
                color=colour if trend["shown"] else MUTED_INK,
            )
        axes.set_title(f"{trend['number'].replace('_', ' ')}, to {trend['loops']}")
        axes.set_xlabel(variable.replace("_", " ") if variable else "state")
        axes.set_ylabel(str(trend_rows["unit"].iloc[0]))
    for axes in panels[len(trends) :]:
        axes.set_axis_off()
    return figure


def _line(values: np.ndarray, place: np.ndarray, trend: dict, line: np.ndarray) -> np.ndarray:
    """The trend through the mean of the states (n,): exponential of a positive number."""
    if trend["slope_unit"] == "1":
        return np.exp(np.log(values).mean()) * (1 + trend["slope"]) ** (line - place.mean())
    return values.mean() + trend["slope"] * (line - place.mean())


MOST_POSITIONS = 9
"""Panels side by side, and positions that are drawn at most."""


@with_style
def loops_figure(loops: pd.DataFrame, state_before: str) -> Figure:
    """Mean loops of both states over the torque, a panel for each position.

    Parameters
    ----------
    loops : rows of one size of the table ``loops``.
    state_before : the first state; the other one is drawn above it.
    """
    labels = list(dict.fromkeys(loops["position"]))[:MOST_POSITIONS]
    rows = -(-len(labels) // ACROSS)
    figure = new_figure(0.5 + 2.9 * rows)
    panels = figure.subplots(rows, min(len(labels), ACROSS), squeeze=False, sharey=True).ravel()
    for axes, label in zip(panels, labels, strict=False):
        for state, curve in loops[loops["position"] == label].groupby("state", sort=False, observed=True):
            colour, line = (MUTED_INK, "--") if state == state_before else (ACCENT, "-")
            axes.plot(curve["torque_Nm"], curve["rising_arcmin"], line, color=colour, label=str(state))
            axes.plot(curve["torque_Nm"], curve["falling_arcmin"], line, color=colour)
        axes.set_title(f"Position {label}")
        axes.set_xlabel("torque (N m)")
    for axes in panels[len(labels) :]:
        axes.set_axis_off()
    panels[0].set_ylabel("angle (arcmin)")
    legend_below(figure, panels[0])
    return figure


@with_style
def changes_figure(changes: pd.DataFrame) -> Figure:
    """Change of each positive number in per cent, with its interval and the growth that would be shown."""
    shares = changes[changes["change_unit"] == "1"]
    figure = new_figure(0.9 + 0.35 * len(shares))
    axes = figure.subplots()
    places = np.arange(len(shares))[::-1]
    for place, row in zip(places, shares.to_dict("records"), strict=True):
        colour = ACCENT if row["named"] else INK
        limit = row["detectable"]
        axes.plot([100 * limit, 100 / (1 + limit) - 100], [place, place], "|", color=ALARM, markersize=9)
        axes.plot([100 * row["ci_low"], 100 * row["ci_high"]], [place, place], color=colour)
        axes.plot(100 * row["change"], place, "o", color=colour, markersize=5)
    axes.axvline(0.0, color=RULE)
    axes.set_yticks(places, [f"{row['title']}, to {row['loops']}" for row in shares.to_dict("records")])
    axes.set_xlabel("change (%)")
    return figure

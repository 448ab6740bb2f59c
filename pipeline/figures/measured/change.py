"""Figures of two measurements of one drive: their loops, and the change of each number with its interval."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, ALARM, INK, MUTED_INK, RULE, legend_below, new_figure, with_style

ACROSS, MOST_POSITIONS = 3, 9
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

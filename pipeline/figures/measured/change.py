"""Figures of two measurements of one drive: their difference, and each kind of change with its interval."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, ALARM, INK, MUTED, legend_below, new_figure, styled

SENSES = {1: ("torque rising", ACCENT, "o"), -1: ("torque falling", ALARM, "v")}
ACROSS, MOST_POSITIONS = 3, 9
"""Panels side by side, and positions that are drawn at most."""


@styled
def difference_figure(cells: pd.DataFrame) -> Figure:
    """Measured difference of the two states over the torque at each position, against what the change says.

    Parameters
    ----------
    cells : the table ``difference``.
    """
    cranks = list(dict.fromkeys(cells["crank_deg"]))[:MOST_POSITIONS]
    rows = -(-len(cranks) // ACROSS)
    figure = new_figure(0.5 + 2.9 * rows)
    panels = figure.subplots(rows, min(len(cranks), ACROSS), squeeze=False, sharey=True).ravel()
    for axes, crank in zip(panels, cranks, strict=False):
        at_crank = cells[cells["crank_deg"] == crank]
        for sense, (label, colour, marker) in SENSES.items():
            branch = at_crank[at_crank["direction"] == sense].sort_values("torque_Nm")
            axes.plot(
                branch["torque_Nm"],
                branch["difference_arcmin"],
                marker,
                color=colour,
                markersize=2.5,
                alpha=0.5,
                markeredgewidth=0,
                label=f"measured, {label}",
            )
            axes.plot(
                branch["torque_Nm"], branch["held_out_arcmin"], color=colour, label=f"from other positions, {label}"
            )
        axes.axhline(0.0, color=MUTED, linewidth=0.6)
        axes.set_title(f"Crank at {crank:g}°")
        axes.set_xlabel("torque (N m)")
    for axes in panels[len(cranks) :]:
        axes.set_axis_off()
    panels[0].set_ylabel("after − before (arcmin)")
    legend_below(figure, panels[0])
    return figure


@styled
def changes_figure(changes: pd.DataFrame, positions: pd.DataFrame) -> Figure:
    """Each kind of change: at each position, its mean and its 95 % interval, a panel each."""
    figure = new_figure(2.2)
    panels = np.atleast_1d(figure.subplots(1, len(changes)))
    for axes, row in zip(panels, changes.to_dict("records"), strict=True):
        at_positions = positions[positions["kind"] == row["kind"]]["change"]
        axes.plot(at_positions, np.zeros(len(at_positions)), "|", color=INK, markersize=9)
        colour = ACCENT if row["named"] else MUTED
        axes.plot([row["ci_low"], row["ci_high"]], [0.5, 0.5], color=colour)
        axes.plot(row["change"], 0.5, "o", color=colour, markersize=5)
        axes.axvline(0.0, color=MUTED, linewidth=0.6)
        axes.set_ylim(-0.5, 1.0)
        axes.set_yticks([0.0, 0.5], ["positions", "mean"] if axes is panels[0] else ["", ""])
        axes.set_title(row["kind"].replace("_", " "))
        axes.set_xlabel("share" if row["unit"] == "1" else row["unit"])
    return figure

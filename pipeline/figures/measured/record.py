"""Figures of a record of a turning drive: its error over the output angle, and its orders."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, ACCENT_LIGHT, ALARM, COLOURS, INK, legend_below, new_figure, with_style

MOST_CURVES = 6
"""Held torques whose curves share a panel: colours are told apart."""
SENSES = {1: "forward", -1: "backward"}


@with_style
def record_figure(points: pd.DataFrame) -> Figure:
    """Error over the output angle in both senses, a colour for each held torque, at the lowest temperature.

    Parameters
    ----------
    points : the table ``points``.
    """
    figure = new_figure(3.6)
    panels = figure.subplots(1, 2, sharey=True)
    coldest = points["temperature_C"].min()
    shown_points = points if np.isnan(coldest) else points[points["temperature_C"] < coldest + 1e-9]
    if shown_points["sense"].nunique() < points["sense"].nunique():
        shown_points = points
    torques = np.unique(points["torque_Nm"])
    chosen_torques = torques[np.unique(np.linspace(0, len(torques) - 1, MOST_CURVES).round().astype(int))]
    for axes, (sense, name) in zip(panels, SENSES.items(), strict=True):
        for colour, torque in zip(COLOURS, chosen_torques, strict=False):
            frame = shown_points[(shown_points["sense"] == sense) & (shown_points["torque_Nm"] == torque)].sort_values(
                "output_deg"
            )
            frame = frame.groupby("output_deg", as_index=False).mean(numeric_only=True)
            label = f"{torque:.3g} N m"
            axes.plot(frame["output_deg"], frame["error_arcmin"], ".", color=colour, markersize=2.0, label=label)
            axes.plot(frame["output_deg"], frame["predicted_arcmin"], color=colour, linewidth=0.7)
        axes.set(title=f"Output turns {name}", xlabel="output angle (degrees)")
    panels[0].set_ylabel("error of the output (arcmin)")
    legend_below(figure, panels[0])
    return figure


@with_style
def torque_levels_figure(levels: pd.DataFrame) -> Figure:
    """Mean of the senses over the torque, and their difference."""
    figure = new_figure(3.0)
    left_axes, right_axes = figure.subplots(1, 2)
    left_axes.plot(levels["torque_Nm"], levels["mean_arcmin"], "-o", color=ACCENT)
    left_axes.set(title="Mean of the senses: rigidity", xlabel="torque (N m)", ylabel="error (arcmin)")
    right_axes.plot(levels["torque_Nm"], levels["difference_arcmin"], "-o", color=ALARM)
    right_axes.set(title="Forward less backward: lost motion", xlabel="torque (N m)", ylabel="difference (arcmin)")
    right_axes.axhline(0, color=INK, linewidth=0.8)
    return figure


@with_style
def record_orders_figure(orders: pd.DataFrame) -> Figure:
    """Amplitudes of the orders: what all passes share, and what grows with the torque."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    axes.vlines(orders["order"], 0, orders["amplitude_arcsec"], color=ACCENT_LIGHT, linewidth=4, label="in all passes")
    axes.plot(
        orders["order"], orders["per_torque_arcsec"], "o", color=ALARM, label="at the largest torque, in proportion"
    )
    axes.plot(orders["order"], orders["senses_arcsec"], "x", color=INK, label="half of the difference of the senses")
    for row in orders[orders["of"] != ""].itertuples():
        axes.annotate(
            f"{row.order:g}",
            (row.order, row.amplitude_arcsec),
            (0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.set(xlabel="waves per turn of the output", ylabel="amplitude (arcsec)", ylim=(0, None))
    legend_below(figure, axes)
    return figure

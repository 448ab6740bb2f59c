"""Figures of a measured unit whose crank turned, and of a record of a turning drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.measured_unit import ACROSS, EXTREME, MODELS, ROOM, STAGES
from pipeline.figures.style import ACCENT, ACCENT_LIGHT, ALARM, COLOURS, INK, legend_below, new_figure, with_style

MOST_PANELS = 6
"""Held torques and senses that share a figure."""
SENSES = {-1: ("crank forward", ACCENT, "o"), 1: ("crank backward", ALARM, "v")}
"""By the sense in which the output slides, against that of the crank."""
HARMONICS = {"measured": (INK, "measured"), "recalibrated": (ALARM, "refitted"), "after": (ACCENT, "after")}


@with_style
def turns_figure(cells: pd.DataFrame, models: Mapping[str, tuple[str, str, str]] = MODELS) -> Figure:
    """Measured cells of each held torque and sense, means over its turns, against the models; the mean is removed.

    Parameters
    ----------
    cells : the table ``residual`` with the number of the held torque, ``level``.
    models : by the name that begins a column: label, colour and line.
    """
    kinds = [frame for _, frame in cells.groupby(["level", "direction"])][:MOST_PANELS]
    rows = -(-len(kinds) // ACROSS)
    figure = new_figure(0.5 + 3.1 * rows)
    panels = np.atleast_1d(figure.subplots(rows, min(len(kinds), ACROSS), squeeze=False, sharey=True)).ravel()
    for axes, frame in zip(panels, kinds, strict=False):
        columns = ["angle_arcmin", *(f"{stage}_arcmin" for stage in models)]
        turn = frame.groupby("crank_deg")[columns].mean()
        turn = turn - turn["angle_arcmin"].mean()
        for stage, (label, colour, line) in models.items():
            axes.plot(turn.index, turn[f"{stage}_arcmin"], color=colour, linestyle=line, linewidth=1.2, label=label)
        axes.plot(turn.index, turn["angle_arcmin"], ".", color=INK, markersize=3.5, label="measured", zorder=1)
        sense = SENSES[int(frame["direction"].iloc[0])][0]
        axes.set_title(f"{frame['torque_Nm'].mean():.3g} N m, {sense}")
        axes.set_xlabel("crank angle (°)")
    for axes in panels[len(kinds) :]:
        axes.set_axis_off()
    panels[0].set_ylabel("error of the output (arcmin)")
    legend_below(figure, panels[0])
    return figure


@with_style
def turn_residual_figure(cells: pd.DataFrame) -> Figure:
    """Residual over the crank angle before and after, the senses in two colours, one scale for both."""
    figure = new_figure(3.4)
    panels = figure.subplots(1, 2, sharey=True)
    residuals = np.concatenate([cells[f"residual_{stage}_arcmin"].dropna().to_numpy() for stage in STAGES])
    reach = ROOM * max(*np.abs(np.percentile(residuals, [EXTREME, 100 - EXTREME])), 1e-6) if residuals.size else 1.0
    for axes, (stage, title) in zip(panels, STAGES.items(), strict=True):
        for sense, (label, colour, marker) in SENSES.items():
            frame = cells[cells["direction"] == sense]
            residual = frame[f"residual_{stage}_arcmin"]
            axes.plot(
                *(frame["crank_deg"], residual, marker),
                color=colour,
                markersize=2.5,
                alpha=0.6,
                markeredgewidth=0,
                label=label,
            )
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.set(title=title, xlabel="crank angle (°)", ylim=(-reach, reach))
    panels[0].set_ylabel("measured − predicted (arcmin)")
    legend_below(figure, panels[0])
    return figure


@with_style
def orders_figure(amplitudes: Mapping[str, Sequence[float]], floor: float) -> Figure:
    """Orders of the crank (n_orders,) [arcmin] from 1 on, means over whole turns, measured and of the models.

    Parameters
    ----------
    amplitudes : by ``measured`` and the stages.
    floor : noise of an amplitude [arcmin].
    """
    figure = new_figure(3.2)
    axes = figure.subplots()
    shown_styles = {name: style for name, style in HARMONICS.items() if name in amplitudes}
    for number, (name, (colour, label)) in enumerate(shown_styles.items()):
        order = np.arange(1, len(amplitudes[name]) + 1)
        place = order + 0.8 * ((number + 0.5) / len(shown_styles) - 0.5)
        axes.bar(place, amplitudes[name], 0.8 / len(shown_styles), color=colour, label=label)
    axes.axhline(floor, color=INK, linewidth=1.0, linestyle=":", label="noise of an amplitude")
    axes.set(xlabel="order of the crank", ylabel="amplitude (arcmin)")
    legend_below(figure, axes)
    return figure


MOST_CURVES = 6
"""Held torques whose curves share a panel: colours are told apart."""
OUTPUT_SENSES = {1: "forward", -1: "backward"}


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
    for axes, (sense, name) in zip(panels, OUTPUT_SENSES.items(), strict=True):
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

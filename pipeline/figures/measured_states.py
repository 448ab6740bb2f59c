"""Figures of several states of one drive, of a unit whose crank turned, and of a record of a turning drive."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.arrays import Index, Real
from pipeline.figures.measured_unit import MODELS, residual_figure
from pipeline.figures.style import (
    ACCENT,
    ACCENT_LIGHT,
    ALARM,
    COLOURS,
    INK,
    MUTED_INK,
    RULE,
    legend_below,
    new_figure,
    panel_grid,
    with_style,
    write_beside,
)

SERIES_STAGES = {"refitted": "friction, play and compliance", "after": "with what is named"}
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
    for axes, (stage, title) in zip(panels, SERIES_STAGES.items(), strict=True):
        for number, (_, rows) in enumerate(cells.groupby("position", sort=False, observed=True)):
            shade = 0.25 + 0.65 * number / max(cells["position"].nunique() - 1, 1)
            axes.plot(
                rows["crank_deg"] % 360, rows[f"residual_{stage}_arcmin"], ".", color=ACCENT, alpha=shade, markersize=2
            )
        axes.axhline(0.0, color=MUTED_INK, linewidth=0.8)
        axes.set(title=title, xlabel="crank angle within its turn [deg]", xlim=(0, 360), xticks=range(0, 361, 90))
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
    figure, panels = panel_grid(len(trends), 0.3, 2.6)
    for axes, trend in zip(panels, trends.to_dict("records"), strict=False):
        trend_rows = states[(states["number"] == trend["number"]) & (states["loops"] == trend["loops"])]
        place = trend_rows["variable"].to_numpy() if variable else np.arange(len(trend_rows))
        colour = ACCENT if trend["shown"] else INK
        axes.vlines(place, trend_rows["ci_low"], trend_rows["ci_high"], color=colour)
        axes.plot(place, trend_rows["value"], "o", color=colour, markersize=4)
        if variable:
            line = np.linspace(place.min(), place.max(), 50)
            fitted = _line(trend_rows["value"].to_numpy(), place, trend, line)
            axes.plot(line, fitted, color=colour if trend["shown"] else MUTED_INK)
        axes.set_title(f"{trend['number'].replace('_', ' ')}, to {trend['loops']}")
        axes.set_xlabel(variable.replace("_", " ") if variable else "state")
        axes.set_ylabel(str(trend_rows["unit"].iloc[0]))
    return figure


def _line(values: Real, place: Real | Index, trend: dict[str, Any], line: Real) -> Real:
    """The trend through the mean of the states (n,): exponential of a positive number."""
    slope: float = trend["slope"]
    distance: Real = line - place.mean()
    if trend["slope_unit"] == "1":
        return float(np.exp(np.log(values).mean())) * (1 + slope) ** distance
    return float(values.mean()) + slope * distance


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
    figure, panels = panel_grid(len(labels), 0.5, 2.9, sharey=True)
    for axes, label in zip(panels, labels, strict=False):
        for state, curve in loops[loops["position"] == label].groupby("state", sort=False, observed=True):
            colour, line = (MUTED_INK, "--") if state == state_before else (ACCENT, "-")
            axes.plot(curve["torque_Nm"], curve["rising_arcmin"], line, color=colour, label=str(state))
            axes.plot(curve["torque_Nm"], curve["falling_arcmin"], line, color=colour)
        axes.set(title=f"Position {label}", xlabel="torque (N m)")
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
    figure, panels = panel_grid(len(kinds), 0.5, 3.1, sharey=True)
    for axes, frame in zip(panels, kinds, strict=False):
        columns = ["angle_arcmin", *(f"{stage}_arcmin" for stage in models)]
        turn = frame.groupby("crank_deg")[columns].mean()
        turn = turn - turn["angle_arcmin"].mean()
        for stage, (label, colour, line) in models.items():
            axes.plot(turn.index, turn[f"{stage}_arcmin"], color=colour, linestyle=line, linewidth=1.2, label=label)
        axes.plot(turn.index, turn["angle_arcmin"], ".", color=INK, markersize=3.5, label="measured", zorder=1)
        sense = SENSES[int(frame["direction"].iloc[0])][0]
        axes.set(title=f"{frame['torque_Nm'].mean():.3g} N m, {sense}", xlabel="crank angle (°)")
    panels[0].set_ylabel("error of the output (arcmin)")
    legend_below(figure, panels[0])
    return figure


def turn_residual_figure(cells: pd.DataFrame) -> Figure:
    """Residual over the crank angle before and after, the senses in two colours, one scale for both."""
    return residual_figure(cells, ("crank_deg", "crank angle (°)"), SENSES)


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
        write_beside(axes, f"{row.order:g}", (row.order, row.amplitude_arcsec), (0, 4), ha="center")
    axes.set(xlabel="waves per turn of the output", ylabel="amplitude (arcsec)", ylim=(0, None))
    legend_below(figure, axes)
    return figure

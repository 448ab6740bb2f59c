"""Figures of a measured unit: its loops against the models, and what the residual depends on."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.figures import style

MODELS = {
    "declared": ("model as declared", style.MUTED_INK, ":"),
    "recalibrated": ("calibrated numbers refitted", style.ALARM, "--"),
    "after": ("with what is named", style.ACCENT, "-"),
}
WRITTEN_STYLE = {"written": ("written study", style.MUTED_INK, "-.")}
"""The study beside the page on the same load history, as ``MODELS``."""
STAGES = {"recalibrated": "Before: calibrated numbers refitted", "after": "After: with what is named"}
SENSES = {1: ("torque rising", style.ACCENT, "o"), -1: ("torque falling", style.ALARM, "v")}
MOST_LOOPS = 6
"""Positions that share a figure."""
EXTREME = 4.0
"""Percent of the residuals at each end that the scale does not follow: there the angle jumps through the play."""
ZOOM_SHARE = 0.12
"""Share of the largest torque that the small panels of the loops show."""
ROOM = 2.0
"""Reach of the scale beyond the others."""


DESCRIPTION_STYLES = {
    "spring": ("a spring alone", style.ALARM, "--"),
    "described": ("play, friction and a spring", style.ACCENT, "-"),
}
"""Models of a drive without a design, as ``MODELS``."""
REMAINDER_TITLES = {"spring": "A spring alone", "described": "Play, friction and a spring"}


@style.with_style
def loops_figure(cells: pd.DataFrame, models: Mapping[str, tuple[str, str, str]] = MODELS) -> Figure:
    """Measured cells of each position, in the second cycle where there is one, against the models; offsets removed.

    Parameters
    ----------
    cells : the table ``residual``.
    models : by the name that begins a column: label, colour and line.
    """
    cranks = list(dict.fromkeys(cells["crank_deg"]))[:MOST_LOOPS]
    figure, panels = style.panel_grid(len(cranks), 0.5, 3.1)
    for axes, crank in zip(panels, cranks, strict=False):
        position_rows = cells[cells["crank_deg"] == crank]
        cycles = list(dict.fromkeys(position_rows["cycle"]))
        cycle_rows = position_rows[position_rows["cycle"] == cycles[min(1, len(cycles) - 1)]]
        _draw_loop(axes, cycle_rows, models)
        _draw_zoom(axes, cycle_rows, models)
        axes.set(title=f"Crank at {crank:g}°, cycle {cycle_rows['cycle'].iloc[0]}", xlabel="torque (N m)")
        axes.xaxis.set_major_locator(MaxNLocator(4))  # torques of four digits have no room for more
    panels[0].set_ylabel("angle (arcmin)")
    style.legend_below(figure, panels[0])
    return figure


def _draw_loop(axes: Axes, rows: pd.DataFrame, models: Mapping[str, tuple[str, str, str]]) -> None:
    """The cells of one cycle and what the models predict of them, about their mean angle."""
    torque, middle = rows["torque_Nm"], rows["angle_arcmin"].mean()
    for stage, (label, colour, line) in models.items():
        axes.plot(torque, rows[f"{stage}_arcmin"] - middle, color=colour, linestyle=line, linewidth=1.2, label=label)
    axes.plot(torque, rows["angle_arcmin"] - middle, ".", color=style.INK, markersize=3.5, label="measured", zorder=1)


def _draw_zoom(axes: Axes, rows: pd.DataFrame, models: Mapping[str, tuple[str, str, str]]) -> None:
    """The loop about zero torque, where the models differ most, in the corner that no loop passes through."""
    reach = ZOOM_SHARE * float(rows["torque_Nm"].abs().max())
    near_rows = rows[rows["torque_Nm"].abs() <= reach]
    if near_rows.empty:
        return
    zoom = axes.inset_axes((0.02, 0.62, 0.36, 0.36))
    _draw_loop(zoom, rows, models)
    angles = (
        near_rows[["angle_arcmin", *(f"{stage}_arcmin" for stage in models)]].to_numpy() - rows["angle_arcmin"].mean()
    )
    low, high = np.nanmin(angles), np.nanmax(angles)
    room = 0.1 * max(high - low, 1e-9)
    zoom.set(xlim=(-reach, reach), ylim=(low - room, high + room), xticks=[0.0], yticks=[])
    zoom.tick_params(labelsize=7)


def torque_figure(cells: pd.DataFrame, stages: Mapping[str, str] = STAGES) -> Figure:
    """Residual over torque before and after, the branches in two colours, one scale for both."""
    return residual_figure(cells, ("torque_Nm", "torque (N m)"), SENSES, stages)


@style.with_style
def residual_figure(
    cells: pd.DataFrame,
    across: tuple[str, str],
    senses: Mapping[int, tuple[str, str, str]],
    stages: Mapping[str, str] = STAGES,
) -> Figure:
    """Residual of each stage over a column of the cells, one scale for all.

    Parameters
    ----------
    across : the column and what the axis calls it.
    senses : label, colour and marker by the direction.
    """
    column, axis_label = across
    figure = style.new_figure(3.4)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (stage, title) in zip(panels, stages.items(), strict=True):
        for sense, (label, colour, marker) in senses.items():
            rows = cells[cells["direction"] == sense]
            look = {"color": colour, "markersize": 2.5, "alpha": 0.6, "markeredgewidth": 0, "label": label}
            axes.plot(rows[column], rows[f"residual_{stage}_arcmin"], marker, **look)
        zero_line(axes, cells, stages)
        axes.set(title=title, xlabel=axis_label)
    panels[0].set_ylabel("measured − predicted (arcmin)")
    style.legend_below(figure, panels[0])
    return figure


@style.with_style
def time_figure(cells: pd.DataFrame) -> Figure:
    """Residual over the sequence of the cells, before and after; positions in turn, their crank angles above."""
    figure = style.new_figure(4.6)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    number = np.arange(len(cells))
    cranks = list(dict.fromkeys(cells["crank_deg"]))
    for axes, (stage, title) in zip(panels, STAGES.items(), strict=True):
        for k, crank in enumerate(cranks):
            is_selected = (cells["crank_deg"] == crank).to_numpy()
            residual = cells[f"residual_{stage}_arcmin"].to_numpy()[is_selected]
            colour = style.COLOURS[k % len(style.COLOURS)]
            axes.plot(number[is_selected], residual, ".", color=colour, markersize=2.5, label=f"crank at {crank:g}°")
        for start in np.flatnonzero(np.diff(cells["cycle"].to_numpy()) != 0) + 0.5:
            axes.axvline(start, color=style.MUTED_INK, linewidth=0.5, alpha=0.5)
        zero_line(axes, cells)
        axes.set_title(title)
    panels[1].set_xlabel("cell in order of time, position by position; lines part the cycles")
    figure.supylabel("measured − predicted (arcmin)", fontsize=9)
    style.legend_below(figure, panels[0])
    return figure


@style.with_style
def candidates_figure(candidates: pd.DataFrame, base_error: float) -> Figure:
    """Misfit with every effect that was fitted, against that of the recalibrated model and the noise."""
    fitted_rows = candidates[candidates["misfit_after"].notna()].iloc[::-1]
    figure = style.new_figure(0.9 + 0.27 * max(len(fitted_rows), 3))
    axes = figure.subplots()
    positions = np.arange(len(fitted_rows))
    colours = [
        style.ACCENT if member else (style.COLOURS[5] if good else style.MUTED_INK)
        for member, good in zip(fitted_rows["member_of_class"], fitted_rows["significant"], strict=True)
    ]
    axes.barh(positions, fitted_rows["misfit_after"], color=colours, height=0.62)
    axes.set_yticks(
        positions, [_label(*candidate) for candidate in zip(fitted_rows["effect"], fitted_rows["title"], strict=True)]
    )
    axes.axvline(base_error, color=style.ALARM, linewidth=1.2, linestyle="--", label="calibrated numbers refitted")
    axes.axvline(1.0, color=style.INK, linewidth=1.0, linestyle=":", label="noise of the cells")
    axes.set_xlabel("misfit (1: noise of the cells)")
    axes.set_xlim(left=0)
    axes.grid(axis="y", visible=False)
    style.legend_below(figure, axes)
    return figure


def _label(name: str, title: str) -> str:
    """The title of one effect; of several their names in the library, whose titles together are too long."""
    return " + ".join(part.replace("_", " ") for part in name.split("+")) if "+" in name else title


def zero_line(axes: Axes, cells: pd.DataFrame, stages: Mapping[str, str] = STAGES) -> None:
    """Zero, and a scale that the few cells across the play do not set."""
    axes.axhline(0, color=style.INK, linewidth=0.8)
    values = np.concatenate([cells[f"residual_{stage}_arcmin"].dropna().to_numpy() for stage in stages])
    if values.size:
        reach = ROOM * max(*np.abs(np.percentile(values, [EXTREME, 100 - EXTREME])), 1e-6)
        axes.set_ylim(-reach, reach)


@style.with_style
def quantiles_figure(quantiles: pd.DataFrame) -> Figure:
    """Quantiles of measured units against those of a study, a panel a metric; on the line the two are alike.

    Parameters
    ----------
    quantiles : ``label``, ``unit``, ``study``, ``measured``: one row a metric and probability.
    """
    labels = list(dict.fromkeys(quantiles["label"]))
    figure, panels = style.panel_grid(len(labels), 0.2, 3.1)
    for axes, label in zip(panels, labels, strict=False):
        metric_rows = quantiles[quantiles["label"] == label]
        ends = [metric_rows[["study", "measured"]].min().min(), metric_rows[["study", "measured"]].max().max()]
        axes.plot(ends, ends, color=style.MUTED_INK, linewidth=1.0, linestyle="--")
        axes.plot(metric_rows["study"], metric_rows["measured"], "o", color=style.ACCENT)
        unit = metric_rows["unit"].iloc[0]
        axes.set(title=label, xlabel=f"study ({unit})", ylabel=f"units ({unit})")
    return figure

"""Torsion angle against torque (the paper's Fig. 14) and its spread; deflection of the bearing (Fig. 12)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.spread import centred_loops
from pipeline.figures.style import ACCENT_LIGHT, INK, MUTED_INK, legend_below, line_styles, new_figure, with_style
from pipeline.model.metrics import Definitions

ZOOM = 3.0
"""Reach of the close-up about zero torque, in lost-motion torques."""
SMALLEST_MARK = 0.08
"""Share of the axis that a width must have for its arrow to be drawn."""
BEHIND_TEXT = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}


@with_style
def hysteresis_figure(
    traces: Mapping[str, pd.DataFrame], spread: pd.DataFrame | None = None, marks: Definitions | None = None
) -> Figure:
    """Whole loop, and its middle enlarged with the definitions of backlash and lost motion.

    Parameters
    ----------
    traces : label -> rows of ``hysteresis/curves`` of one sample at one crank angle, in the order of steps.
    spread : ``branch``, ``torque_Nm``, ``low``, ``middle``, ``high`` [arcmin]: 5th, 50th and 95th percentile of the
        angle over the samples, each loop `centred_loops`, on the branches loading+ and loading-.
    marks : where to draw the definitions of the metrics, on the trace with the widest loop.
    """
    figure = new_figure(4.4)
    cycle_axes, middle = figure.subplots(1, 2)
    loops = {label: _centred_frame(rows) for label, rows in traces.items()}
    for axes in (cycle_axes, middle):
        draw_loops(axes, loops, spread)
    cycle_axes.set_title("Load cycle")
    middle.set_title("About zero torque")
    if marks is not None:
        _zoom(middle, loops, spread, ZOOM * marks.lost_motion)
    if marks is not None and loops:
        widest = max(loops.values(), key=lambda rows: _angle_at(rows, 0.0, "unloading+"))
        _mark_rigidity(cycle_axes, widest, (marks.rigidity_low, marks.rigidity_high))
        _mark_widths(middle, widest, marks.lost_motion)
    legend_below(figure, cycle_axes)
    return figure


def draw_loops(axes: Axes, loops: Mapping[str, pd.DataFrame], spread: pd.DataFrame | None = None) -> Axes:
    """Angle against torque of loops by label, and the spread of others; frames as in ``hysteresis_figure``."""
    _draw_spread(axes, spread, "angle")
    for style, rows in zip(line_styles(loops), loops.values(), strict=True):
        axes.plot(rows["torque_Nm"], rows["angle_arcmin"], **{**style, "markersize": 2.5})
    axes.set(xlabel="torque on the output (N m)", ylabel="torsion angle (arcmin)")
    return axes


@with_style
def bearing_figure(traces: Mapping[str, pd.DataFrame], spread: Mapping[str, pd.DataFrame] | None = None) -> Figure:
    """Displacement of the disk's centre on the input bearing against torque, along x and y of the housing.

    Parameters
    ----------
    traces : as in `hysteresis_figure`.
    spread : "bearing_x_um" and "bearing_y_um" -> frame as in `hysteresis_figure`, in um and not centred.
    """
    figure = new_figure(3.2)
    for axes, column in zip(figure.subplots(1, 2), ("bearing_x_um", "bearing_y_um"), strict=True):
        _draw_spread(axes, spread[column] if spread else None, "displacement")
        for style, rows in zip(line_styles(traces), traces.values(), strict=True):
            axes.plot(rows["torque_Nm"], rows[column], **{**style, "markersize": 2.5})
        axes.set(xlabel="torque on the output (N m)", ylabel=f"displacement along {column[8]} (µm)")
    legend_below(figure, axes)
    return figure


def _centred_frame(rows: pd.DataFrame) -> pd.DataFrame:
    angle = centred_loops(
        rows["angle_arcmin"].to_numpy()[None], np.asarray(rows["branch"]), rows["torque_Nm"].to_numpy()
    )[0]
    return rows.assign(angle_arcmin=angle)


def _draw_spread(axes: Axes, spread: pd.DataFrame | None, description: str) -> None:
    if spread is None:
        return
    for number, (_, rows) in enumerate(spread.groupby("branch", observed=True)):
        single = number == 0
        axes.fill_between(
            rows["torque_Nm"],
            rows["low"],
            rows["high"],
            color=ACCENT_LIGHT,
            linewidth=0,
            label="5 % to 95 % of samples" if single else None,
        )
        axes.plot(
            rows["torque_Nm"],
            rows["middle"],
            color=INK,
            linewidth=1.0,
            linestyle="--",
            label=f"median {description}" if single else None,
        )


def _angle_at(rows: pd.DataFrame, torque: float, branch: str) -> float:
    """Angle of a loop at one of its torques [arcmin]."""
    branch_rows = rows[np.asarray(rows["branch"]) == branch]
    return float(branch_rows["angle_arcmin"].iloc[int(np.argmin(np.abs(branch_rows["torque_Nm"].to_numpy() - torque)))])


def _mark_rigidity(axes: Axes, loop: pd.DataFrame, torque: tuple[float, float]) -> None:
    angle = [_angle_at(loop, level, "loading+") for level in torque]
    axes.plot([torque[0], torque[1], torque[1]], [angle[0], angle[0], angle[1]], color=INK, linewidth=1.0)
    axes.plot(torque, angle, "o", color=INK, markersize=5, markerfacecolor="white", zorder=4)
    text = "torsional rigidity:\nΔ torque / Δ angle between the circles"
    axes.text(0.98, 0.04, text, transform=axes.transAxes, ha="right", va="bottom", fontsize=8.5, bbox=BEHIND_TEXT)


def _mark_widths(axes: Axes, loop: pd.DataFrame, torque: float) -> None:
    """Arrows of the width at zero torque and of the lost motion between the loop's centre lines."""
    reach, height = axes.get_xlim()[1], np.ptp(axes.get_ylim())
    for side, level, branches, text in (
        (-0.14, 0.0, ("unloading+", "unloading-"), "clearance\nbacklash"),
        (0.78, torque, ("loading+", "loading-"), "lost\nmotion"),
    ):
        high, low = _angle_at(loop, level, branches[0]), _angle_at(loop, -level, branches[1])
        if high - low < SMALLEST_MARK * height:
            continue
        arrow_torque = side * reach
        for end, angle in ((level, high), (-level, low)):
            axes.plot([end, arrow_torque], [angle, angle], color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
            axes.plot(end, angle, "o", color=INK, markersize=5, markerfacecolor="white", zorder=4)
        arrow = {"arrowstyle": "<|-|>", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (arrow_torque, high), (arrow_torque, low), zorder=5, arrowprops=arrow)
        axes.text(
            arrow_torque - 0.04 * reach,
            low + 0.65 * (high - low),
            text,
            fontsize=8.5,
            va="center",
            ha="right",
            bbox=BEHIND_TEXT,
        )
    for level in (-torque, torque):
        axes.axvline(level, color=MUTED_INK, linewidth=0.8, linestyle=":")


def _zoom(axes: Axes, loops: Mapping[str, pd.DataFrame], spread: pd.DataFrame | None, reach: float) -> None:
    """Axes within ``reach`` [N m] of zero torque, as high as the curves are there."""
    frames: list[tuple[pd.DataFrame, tuple[str, ...]]] = [(rows, ("angle_arcmin",)) for rows in loops.values()]
    frames += [(spread, ("low", "high"))] if spread is not None else []
    top = 0.0
    for rows, columns in frames:
        for column in columns:
            in_view = np.abs(rows["torque_Nm"].to_numpy()) <= 1.1 * reach
            top = max(top, float(np.max(np.abs(rows[column].to_numpy()[in_view]), initial=0.0)))
    axes.set_xlim(-reach, reach)
    if top > 0:
        axes.set_ylim(-1.1 * top, 1.1 * top)

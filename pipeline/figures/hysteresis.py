"""Torsion angle against torque (the paper's Fig. 14) and its spread; deflection of the bearing (Fig. 12)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.constant_kinds import Shown
from pipeline.figures.labels import FULL_TURN, centred_loops
from pipeline.figures.style import (
    ACCENT,
    ACCENT_LIGHT,
    ALARM,
    INK,
    MUTED_INK,
    draw_band,
    legend_below,
    line_styles,
    new_figure,
    with_style,
)
from pipeline.model.metrics import Definitions

ZOOM = 3.0
"""Reach of the close-up about zero torque, in lost-motion torques."""
OPEN_LOOP: Shown = 1e-3
"""Opening of a loop at the torque of the lost motion, of its height, from which it has friction."""
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
        labels = ("5 % to 95 % of samples", f"median {description}") if number == 0 else (None, None)
        draw_band(axes, rows["torque_Nm"], rows, *labels)


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
    opening = _angle_at(loop, torque, "unloading+") - _angle_at(loop, torque, "loading+")
    width = "zero-torque\nwidth" if opening > OPEN_LOOP * height else "clearance\nbacklash"
    for side, level, branches, text in (
        (-0.14, 0.0, ("unloading",), width),
        (0.78, torque, ("loading", "unloading"), "lost\nmotion"),
    ):
        high, low = (
            float(np.mean([_angle_at(loop, sign * level, f"{branch}{sense}") for branch in branches]))
            for sign, sense in ((1, "+"), (-1, "-"))
        )
        if high - low < SMALLEST_MARK * height:
            continue
        arrow_torque = side * reach
        for end, angle in ((level, high), (-level, low)):
            axes.plot([end, arrow_torque], [angle, angle], color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
            axes.plot(end, angle, "o", color=INK, markersize=5, markerfacecolor="white", zorder=4)
        arrow = {"arrowstyle": "<|-|>", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (arrow_torque, high), (arrow_torque, low), zorder=5, arrowprops=arrow)
        place = arrow_torque - 0.04 * reach, low + 0.65 * (high - low)
        axes.text(*place, text, fontsize=8.5, va="center", ha="right", bbox=BEHIND_TEXT)
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


SENSES = {"+": (ACCENT, "-o"), "-": (ALARM, "--s")}
"""Colour and line of each sense of the torque."""
BAND = "5 % to 95 % of samples, sense +"


@with_style
def transmission_figure(panels: Mapping[str, pd.DataFrame], spreads: Mapping[str, pd.DataFrame]) -> Figure:
    """Transmission error against the crank angle, about its mean, a panel without and one under load.

    Parameters
    ----------
    panels : title -> ``sense``, ``crank_deg``, ``error_arcsec`` of one unit.
    spreads : title -> ``crank_deg``, ``low``, ``middle``, ``high`` [arcsec] over the samples; fewer titles where none.
    """
    figure = new_figure(3.2)
    for axes, (title, rows) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        _band(axes, spreads.get(title))
        _senses(axes, rows, "error_arcsec")
        axes.set(title=title, xlabel="crank angle (degrees)", ylabel="error about its mean (arcsec)")
    legend_below(figure, axes)
    return figure


@with_style
def orders_figure(panels: Mapping[str, pd.DataFrame]) -> Figure:
    """Amplitude of each order over the samples: median and 95 % quantile.

    Parameters
    ----------
    panels : title -> ``order``, ``middle``, ``high`` [arcsec].
    """
    figure = new_figure(2.8)
    for axes, (title, rows) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        width = 0.8 * float(rows["order"].sort_values().diff().min()) if len(rows) > 1 else 0.8
        axes.bar(rows["order"], rows["high"], color=ACCENT_LIGHT, width=width, label="95 % quantile of samples")
        axes.bar(rows["order"], rows["middle"], color=ACCENT, width=width, label="median of samples")
        axes.set(title=title, xlabel="waves per turn of the crank", ylabel="amplitude (arcsec)")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure, axes)
    return figure


@with_style
def turn_forces_figure(
    bearing: pd.DataFrame, spread: pd.DataFrame | None, pins: Sequence[pd.DataFrame], name: str
) -> Figure:
    """Force on a disk's bearing and contact force of one pin against the crank angle.

    Parameters
    ----------
    bearing : ``sense``, ``crank_deg``, ``bearing_force_N`` of one unit.
    spread : ``crank_deg``, ``low``, ``middle``, ``high`` [N] over the samples, or None.
    pins : of one pin, none or one frame: ``sense``, ``crank_deg``, ``force_N``, ``contact``.
    name : of the bearing.
    """
    figure = new_figure(3.2)
    panels = figure.subplots(1, 1 + len(pins), squeeze=False)[0]
    _band(panels[0], spread)
    _senses(panels[0], bearing, "bearing_force_N")
    panels[0].set(title=name.capitalize(), xlabel="crank angle (degrees)", ylabel="radial force (N)", ylim=(0, None))
    for axes, rows in zip(panels[1:], pins, strict=True):
        _senses(axes, rows, "force_N")
        title = f"Pin {int(rows['contact'].iloc[0])}"
        axes.set(title=title, xlabel="crank angle (degrees)", ylabel="contact force (N)", ylim=(0, None))
    legend_below(figure, panels[0])
    return figure


@with_style
def output_turn_figure(
    errors: Mapping[str, pd.DataFrame], waves: Mapping[str, pd.DataFrame], lobes: int, bearing: str
) -> Figure:
    """One unit over a turn of the output: its error, the orders of that, and forces where a torque is held.

    Parameters
    ----------
    errors : title -> ``sense``, ``crank_deg``, ``error_arcsec``, ``bearing_force_N``, ``pin_force_N``, a column each.
    waves : title -> ``sense``, ``order_of_crank``, ``amplitude_arcsec``, by the same titles.
    lobes : turns of the crank.
    bearing : its name.
    """
    loaded_errors = [rows for rows in errors.values() if rows["bearing_force_N"].notna().any()]
    figure = new_figure(5.2 + 2.6 * bool(loaded_errors))
    panels = figure.subplots(2 + bool(loaded_errors), max(len(errors), 1 + bool(loaded_errors)), squeeze=False)
    for column, (title, rows) in enumerate(errors.items()):
        about_mean = rows["error_arcsec"] - rows.groupby("sense", observed=True)["error_arcsec"].transform("mean")
        _over_output(panels[0, column], rows.assign(error_arcsec=about_mean), "error_arcsec", lobes)
        panels[0, column].set(title=title[:1].upper() + title[1:], ylabel="error about its mean (arcsec)")
        _waves(panels[1, column], waves[title])
    forces = {"bearing_force_N": bearing.capitalize(), "pin_force_N": "Pin 0"}
    for rows in loaded_errors:
        for axes, (name, body) in zip(panels[2], forces.items(), strict=False):
            _over_output(axes, rows, name, lobes)
            axes.set(title=body, ylabel="force (N)", ylim=(0, None))
    legend_below(figure, panels[0, 0])
    return figure


def _over_output(axes: Axes, rows: pd.DataFrame, column: str, lobes: int) -> None:
    for sense, (colour, _) in SENSES.items():
        part = rows[rows["sense"] == sense]
        name = sense.replace("-", "−")
        axes.plot(part["crank_deg"] / 360, part[column], color=colour, linewidth=0.4, label=f"sense {name}")
    axes.set(xlabel="turns of the crank", xlim=(0, lobes))


def _waves(axes: Axes, rows: pd.DataFrame) -> None:
    for sense, (colour, _) in SENSES.items():
        part = rows[rows["sense"] == sense]
        axes.plot(part["order_of_crank"], part["amplitude_arcsec"], color=colour, linewidth=0.5)
    axes.set(xlabel="waves per turn of the crank", ylabel="amplitude (arcsec)", xlim=(0, None), ylim=(0, None))


def _band(axes: Axes, spread: pd.DataFrame | None) -> None:
    if spread is None:
        return
    crank = spread["crank_deg"]
    if _is_dense(spread):
        axes.fill_between(crank, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=0, label=BAND)
    else:
        axes.vlines(crank, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=4, label=BAND)
    style = ":" if _is_dense(spread) else "_"
    axes.plot(crank, spread["middle"], style, color=INK, linewidth=1.0, label="median, sense +")


def _is_dense(rows: pd.DataFrame) -> bool:
    """Whether the crank angles stand so near to each other that a line through them says something."""
    return bool(rows["crank_deg"].max() < FULL_TURN)


def _senses(axes: Axes, rows: pd.DataFrame, column: str) -> None:
    for sense, (colour, line) in SENSES.items():
        part = rows[rows["sense"] == sense]
        name = sense.replace("-", "−")
        drawn_line = line if _is_dense(rows) else line[-1]
        axes.plot(part["crank_deg"], part[column], drawn_line, color=colour, markersize=2.5, label=f"sense {name}")

"""The reducer drawn with the numbers of its pins, rollers and contacts."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.style import ACCENT, ALARM, COLOURS, INK, MUTED, RULE, new_figure, styled

PINS_BETWEEN_NUMBERS = 5
LABEL_GAP = 1.7
"""From a pin's centre to its number, in pin radii beyond the pin."""


@styled
def reducer_figure(
    contacts: pd.DataFrame, flank: NDArray[np.complex128], crank_deg: float, pin_radius: float, roller_radius: float
) -> Figure:
    """Pins and disk, and the rollers of the output's two slides, numbered as in the tables.

    Parameters
    ----------
    contacts : rows of ``clearance/contacts`` at one crank angle.
    flank : (n_points,) closed outline of the disk in the housing frame [mm], x + iy.
    crank_deg : crank angle of ``contacts`` [degrees].
    pin_radius, roller_radius : [mm]
    """
    figure = new_figure(4.7)
    ring, slides = figure.subplots(1, 2, width_ratios=[1.18, 1])
    _draw_ring(ring, contacts[contacts["kind"] == "pin"], flank, crank_deg, pin_radius)
    _draw_slides(slides, contacts[contacts["kind"] == "output"], roller_radius)
    for axes in (ring, slides):
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def _circles(axes: Axes, centre: NDArray[np.complex128], radius: float, **style) -> None:
    size = np.full(len(centre), 2 * radius)
    axes.add_collection(EllipseCollection(
        size, size, np.zeros(len(centre)), units="xy", transOffset=axes.transData,
        offsets=np.column_stack([centre.real, centre.imag]), **style,
    ))


def _draw_ring(
    axes: Axes, pins: pd.DataFrame, flank: NDArray[np.complex128], crank_deg: float, radius: float
) -> None:
    normal = pins["normal_x"].to_numpy() + 1j * pins["normal_y"].to_numpy()
    centre = pins["x_mm"].to_numpy() + 1j * pins["y_mm"].to_numpy() - radius * normal
    axes.fill(flank.real, flank.imag, facecolor="#f1f4f7", edgecolor=MUTED, linewidth=0.7)
    _circles(axes, centre, radius, facecolor="white", edgecolor=ACCENT, linewidth=0.8)
    for number, at in zip(pins["contact"], centre, strict=True):
        if number % PINS_BETWEEN_NUMBERS == 0:
            out = at * (1 + (1 + LABEL_GAP) * radius / abs(at))
            axes.text(out.real, out.imag, str(number), ha="center", va="center", fontsize=8, color=ACCENT)
    reach = np.abs(centre[0])
    tip = 0.45 * reach * np.exp(1j * np.radians(crank_deg))
    axes.annotate("", (tip.real, tip.imag), (0, 0), arrowprops={"arrowstyle": "-|>", "color": ALARM, "linewidth": 1.4})
    axes.plot(0, 0, "+", color=INK, markersize=7)
    axes.text(0, -0.09 * reach, "arrow: direction of\nthe eccentric", ha="center", va="top", fontsize=8.5, color=ALARM)
    turn = 0.72 * reach * np.exp(-1j * np.linspace(0.25, 1.0, 40))
    axes.plot(turn.real, turn.imag, color=MUTED, linewidth=1.0)
    axes.annotate(
        "", (turn[-1].real, turn[-1].imag), (turn[-4].real, turn[-4].imag),
        arrowprops={"arrowstyle": "-|>", "color": MUTED, "linewidth": 1.0},
    )
    axes.text(0.55 * reach, -0.3 * reach, "count\nclockwise", ha="center", va="center", fontsize=8.5, color=MUTED)
    edge = reach + 5.2 * radius
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=f"Pins 0 to {len(pins) - 1}, crank at {crank_deg:g}°")


def _draw_slides(axes: Axes, rollers: pd.DataFrame, radius: float) -> None:
    place = rollers["x_mm"].to_numpy() + 1j * rollers["y_mm"].to_numpy()
    edge = np.max(np.abs([place.real, place.imag])) + 7 * radius
    axes.axhline(0, color=RULE, linewidth=0.8)
    axes.axvline(0, color=RULE, linewidth=0.8)
    for interface, style in zip((0, 1), (COLOURS[2], COLOURS[1]), strict=True):
        mine = rollers["interface"].to_numpy() == interface
        rows = rollers[mine]
        name = f"{rows['body_a'].iloc[0]} to {rows['body_b'].iloc[0]}"
        _circles(axes, place[mine], radius, facecolor="white", edgecolor=style, linewidth=1.1)
        axes.plot([], [], "o", color=style, markerfacecolor="white", markersize=7, label=f"interface {interface}: {name}")
        for at, station in zip(place[mine], rows["station"], strict=True):
            axes.text(at.real, at.imag, str(station), ha="center", va="center", fontsize=7.5, color=style)
        _name_rows(axes, rows, place[mine], radius, style)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, handletextpad=0.2, columnspacing=1.2)
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title="Output rollers, 0 outside, and their contacts")


def _name_rows(axes: Axes, rows: pd.DataFrame, place: NDArray[np.complex128], radius: float, colour: str) -> None:
    """Numbers of the contacts of each row of rollers, written beyond its outermost one."""
    for (face, end), row in rows.groupby(["face", "end"]):
        mine = ((rows["face"] == face) & (rows["end"] == end)).to_numpy()
        outer, inner = place[mine][0], place[mine][-1]
        along = (outer - inner) / abs(outer - inner) if len(row) > 1 else outer / abs(outer)
        at = outer + along * 1.6 * radius
        upright = abs(along.imag) > abs(along.real)
        axes.text(
            at.real, at.imag, f"{row['contact'].min()}–{row['contact'].max()}", color=colour, fontsize=8,
            rotation=90 if upright else 0, rotation_mode="anchor", va="center",
            ha="left" if (along.imag if upright else along.real) > 0 else "right",
        )

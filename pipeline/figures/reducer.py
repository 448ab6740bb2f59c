"""The reducer drawn with the numbers of its pins, rollers and contacts."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.style import ACCENT, ALARM, COLOURS, INK, MUTED, new_figure, styled

INTERFACES = (0, 1)
"""Disk to plate, plate to output."""
MOST_NUMBERS = 100
"""Up to so many pins each one has its number beside it, else every fifth."""
NUMBER_RADIUS = 1.07
"""Circle of the numbers over that of the pins."""


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
    figure = new_figure(6.0)
    mosaic = [["ring", str(interface)] for interface in INTERFACES]
    panels: dict[str, Axes] = figure.subplot_mosaic(mosaic, width_ratios=[2.05, 1])
    draw_ring(panels["ring"], contacts[contacts["kind"] == "pin"], flank, crank_deg, pin_radius)
    for interface in INTERFACES:
        _draw_slide(panels[str(interface)], contacts[contacts["interface"] == interface], roller_radius)
    for axes in panels.values():
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def circles(axes: Axes, centre: NDArray[np.complex128], radius: float, **style) -> None:
    """Circles of one radius [mm] about the centres (n,) [mm]."""
    size = np.full(len(centre), 2 * radius)
    axes.add_collection(
        EllipseCollection(
            size,
            size,
            np.zeros(len(centre)),
            units="xy",
            transOffset=axes.transData,
            offsets=np.column_stack([centre.real, centre.imag]),
            **style,
        )
    )


def draw_ring(axes: Axes, pins: pd.DataFrame, flank: NDArray[np.complex128], crank_deg: float, radius: float) -> None:
    """The disk among its numbered pins, whose rows of ``clearance/contacts`` are ``pins``."""
    normal = pins["normal_x"].to_numpy() + 1j * pins["normal_y"].to_numpy()
    centre = pins["x_mm"].to_numpy() + 1j * pins["y_mm"].to_numpy() - radius * normal
    axes.fill(flank.real, flank.imag, facecolor="#f1f4f7", edgecolor=MUTED, linewidth=0.7)
    circles(axes, centre, radius, facecolor="white", edgecolor=ACCENT, linewidth=0.8)
    for number, label_point in zip(pins["contact"], NUMBER_RADIUS * centre, strict=True):
        if len(pins) <= MOST_NUMBERS or number % 5 == 0:
            axes.text(
                label_point.real,
                label_point.imag,
                str(number),
                ha="center",
                va="center",
                fontsize=7,
                color=ACCENT,
                in_layout=False,
            )
    reach = np.abs(centre[0])
    tip = 0.45 * reach * np.exp(1j * np.radians(crank_deg))
    axes.annotate("", (tip.real, tip.imag), (0, 0), arrowprops={"arrowstyle": "-|>", "color": ALARM, "linewidth": 1.4})
    axes.plot(0, 0, "+", color=INK, markersize=7)
    axes.text(0, -0.09 * reach, "arrow: direction of\nthe eccentric", ha="center", va="top", fontsize=8.5, color=ALARM)
    turn = 0.72 * reach * np.exp(-1j * np.linspace(0.25, 1.0, 40))
    axes.plot(turn.real, turn.imag, color=MUTED, linewidth=1.0)
    axes.annotate(
        "",
        (turn[-1].real, turn[-1].imag),
        (turn[-4].real, turn[-4].imag),
        arrowprops={"arrowstyle": "-|>", "color": MUTED, "linewidth": 1.0},
    )
    axes.text(0.42 * reach, -0.3 * reach, "count\nclockwise", ha="center", va="center", fontsize=8.5, color=MUTED)
    edge = 1.12 * reach
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=f"Pins 0 to {len(pins) - 1}, crank at {crank_deg:g}°")


def _draw_slide(axes: Axes, rollers: pd.DataFrame, radius: float) -> None:
    """Rollers of one interface, each with its place in its row."""
    centres = rollers["x_mm"].to_numpy() + 1j * rollers["y_mm"].to_numpy()
    interface = int(rollers["interface"].iloc[0])
    colour = (COLOURS[2], ALARM)[interface % 2]
    axes.plot(0, 0, "+", color=INK, markersize=6)
    circles(axes, centres, radius, facecolor="white", edgecolor=colour, linewidth=0.9)
    for label_point, station in zip(centres, rollers["station"], strict=True):
        axes.text(
            label_point.real,
            label_point.imag,
            str(station),
            ha="center",
            va="center_baseline",
            fontsize=6,
            color=colour,
            in_layout=False,
        )
    _name_rows(axes, rollers, centres, radius, colour)
    edge = np.max(np.abs([centres.real, centres.imag])) + 12 * radius
    bodies = f"{rollers['body_a'].iloc[0]} to {rollers['body_b'].iloc[0]}"
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=f"Interface {interface}: {bodies}")


def _name_rows(axes: Axes, rows: pd.DataFrame, centres: NDArray[np.complex128], radius: float, colour: str) -> None:
    """Numbers of the contacts of each row of rollers, written beyond its outermost one."""
    for (face, end), row in rows.groupby(["face", "end"]):
        in_row = ((rows["face"] == face) & (rows["end"] == end)).to_numpy()
        outer, inner = centres[in_row][0], centres[in_row][-1]
        along = (outer - inner) / abs(outer - inner) if len(row) > 1 else outer / abs(outer)
        label_point = outer + along * 1.6 * radius
        upright = abs(along.imag) > abs(along.real)
        axes.text(
            label_point.real,
            label_point.imag,
            f"{row['contact'].min()}–{row['contact'].max()}",
            color=colour,
            fontsize=7.5,
            rotation=90 if upright else 0,
            rotation_mode="anchor",
            va="center",
            ha="left" if (along.imag if upright else along.real) > 0 else "right",
        )

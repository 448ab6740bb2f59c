"""Output pins in the holes of the disk: drawn with their numbers, and how they carry the load."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.pins import draw_loads
from pipeline.figures.reducer import circles, draw_ring
from pipeline.figures.style import ALARM, COLOURS, INK, MUTED, legend_below, new_figure, styled

MARGIN = 1.05
"""Edge of the drawing of the holes over the reach of the disk."""


@dataclass(frozen=True)
class Holes:
    """Radii of the output pins and of their holes, and the eccentricity between them [mm]."""

    pin_radius: float
    hole_radius: float
    eccentricity: float


@styled
def holes_figure(
    contacts: pd.DataFrame, flank: NDArray[np.complex128], crank_deg: float, pin_radius: float, holes: Holes
) -> Figure:
    """Pins and disk, and the output pins in the disk's holes, numbered as in the tables.

    Parameters
    ----------
    contacts, flank, crank_deg, pin_radius : as in `reducer_figure`.
    holes : the output.
    """
    figure = new_figure(4.6)
    ring, inner = figure.subplots(1, 2)
    draw_ring(ring, contacts[contacts["kind"] == "pin"], flank, crank_deg, pin_radius)
    _draw_holes(inner, contacts[contacts["kind"] == "output"], flank, holes)
    for axes in (ring, inner):
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def _draw_holes(axes: Axes, rows: pd.DataFrame, flank: NDArray[np.complex128], holes: Holes) -> None:
    normal = rows["normal_x"].to_numpy() + 1j * rows["normal_y"].to_numpy()
    wall = rows["x_mm"].to_numpy() + 1j * rows["y_mm"].to_numpy()
    hole = wall + holes.hole_radius * normal
    pin = hole - holes.eccentricity * normal
    axes.fill(flank.real, flank.imag, facecolor="#f1f4f7", edgecolor=MUTED, linewidth=0.7)
    circles(axes, hole, holes.hole_radius, facecolor="white", edgecolor=INK, linewidth=0.8)
    circles(axes, pin, holes.pin_radius, facecolor="white", edgecolor=COLOURS[2], linewidth=0.9)
    axes.plot(wall.real, wall.imag, ".", color=ALARM, markersize=5)
    axes.plot(0, 0, "+", color=INK, markersize=6)
    for label_point, station, contact in zip(pin, rows["station"], rows["contact"], strict=True):
        text = f"{station}\n({contact})"
        axes.text(
            label_point.real,
            label_point.imag,
            text,
            ha="center",
            va="center",
            fontsize=7,
            color=COLOURS[2],
            in_layout=False,
        )
    edge = MARGIN * np.max(np.abs(flank))
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=f"Output pins 0 to {len(rows) - 1} in the disk's holes")


@styled
def output_pin_loads_figure(traces: Mapping[str, pd.DataFrame], contacts: pd.DataFrame, rising: bool = False) -> Figure:
    """Contact force and deformation of the output pins against their number.

    Parameters
    ----------
    traces, contacts, rising : as in `roller_loads_figure`.
    """
    pins = contacts.loc[contacts["kind"] == "output", ["contact", "station"]]
    of_pins = {label: rows.merge(pins, on="contact").sort_values("station") for label, rows in traces.items()}
    figure = new_figure(4.6)
    force, depth = figure.subplots(2, 1, sharex=True)
    draw_loads(force, depth, of_pins, "station", rising)
    depth.set(xlabel="output pin", xlim=(-0.5, len(pins) - 0.5))
    legend_below(figure, force)
    return figure

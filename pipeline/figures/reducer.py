"""The reducer with the numbers of its contacts, and the gap that the drawn flank leaves to nominal pins."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from pipeline.arrays import Complex
from pipeline.config.mechanisms.mechanism import Circles, Panel, Part, Points, RowLabel
from pipeline.figures.style import ACCENT, ALARM, COLOURS, INK, MUTED_INK, legend_below, new_figure, with_style

LINES: Mapping[Part, str] = {"disk": INK, "output": COLOURS[2], "between": ALARM}
MARGIN = 1.05
"""Edge of a drawing of the disk over the disk's reach."""
MOST_NUMBERS = 100
"""Up to so many pins each one has its number beside it, else every fifth."""
NUMBER_RADIUS = 1.07
"""Circle of the numbers over that of the pins."""


@with_style
def reducer_figure(
    contacts: pd.DataFrame, flanks: Sequence[Complex], crank_deg: float, pin_radius: float, panels: Sequence[Panel]
) -> Figure:
    """Pins and disk, and the output mechanism, numbered as in the tables.

    Parameters
    ----------
    contacts : rows of ``clearance/contacts`` at one crank angle.
    flanks : closed outline (n_points,) of the disk of each panel in the housing frame [mm], x + iy; without panels, of
        the disk.
    crank_deg : crank angle of ``contacts`` [degrees].
    pin_radius : [mm]
    panels : drawings of the mechanism; a single one is as large as that of the pins.
    """
    single = len(panels) == 1
    figure = new_figure(4.6 if single else 6.0)
    mosaic = [["ring", str(k)] for k in range(len(panels))]
    grid: dict[str, Axes] = figure.subplot_mosaic(mosaic, width_ratios=[1 if single else 2.05, 1])
    pins = contacts[contacts["kind"] == "pin"]
    draw_ring(grid["ring"], pins[pins["disk"] == pins["disk"].min()], flanks[0], crank_deg, pin_radius)
    for k, (panel, flank) in enumerate(zip(panels, flanks, strict=False)):
        _draw_panel(grid[str(k)], panel, flank)
    for axes in grid.values():
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def circles(axes: Axes, centre: Complex, radius: float, **style: Any) -> None:
    """Circles of one radius [mm] about the centres (n,) [mm]."""
    size = np.full(len(centre), 2 * radius)
    places = {"offsets": np.column_stack([centre.real, centre.imag]), "transOffset": axes.transData}
    axes.add_collection(EllipseCollection(size, size, np.zeros(len(centre)), units="xy", **places, **style))


def draw_ring(axes: Axes, pins: pd.DataFrame, flank: Complex, crank_deg: float, radius: float) -> None:
    """The disk among its numbered pins, whose rows of ``clearance/contacts`` are ``pins``."""
    normal = pins["normal_x"].to_numpy() + 1j * pins["normal_y"].to_numpy()
    centre = pins["x_mm"].to_numpy() + 1j * pins["y_mm"].to_numpy() - radius * normal
    axes.fill(flank.real, flank.imag, facecolor="#f1f4f7", edgecolor=MUTED_INK, linewidth=0.7)
    circles(axes, centre, radius, facecolor="white", edgecolor=ACCENT, linewidth=0.8)
    for number, label_point in zip(pins["contact"], NUMBER_RADIUS * centre, strict=True):
        if len(pins) <= MOST_NUMBERS or number % 5 == 0:
            _write_within(axes, label_point, str(number), va="center", fontsize=7, color=ACCENT)
    reach = np.abs(centre[0])
    tip = 0.45 * reach * np.exp(1j * np.radians(crank_deg))
    axes.annotate("", (tip.real, tip.imag), (0, 0), arrowprops={"arrowstyle": "-|>", "color": ALARM, "linewidth": 1.4})
    axes.plot(0, 0, "+", color=INK, markersize=7)
    axes.text(0, -0.09 * reach, "arrow: direction of\nthe eccentric", ha="center", va="top", fontsize=8.5, color=ALARM)
    turn = 0.72 * reach * np.exp(-1j * np.linspace(0.25, 1.0, 40))
    axes.plot(turn.real, turn.imag, color=MUTED_INK, linewidth=1.0)
    arrow = {"arrowstyle": "-|>", "color": MUTED_INK, "linewidth": 1.0}
    axes.annotate("", (turn[-1].real, turn[-1].imag), (turn[-4].real, turn[-4].imag), arrowprops=arrow)
    axes.text(0.42 * reach, -0.3 * reach, "count\nclockwise", ha="center", va="center", fontsize=8.5, color=MUTED_INK)
    edge = 1.12 * reach
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=f"Pins 0 to {len(pins) - 1}, crank at {crank_deg:g}°")


def _draw_panel(axes: Axes, panel: Panel, flank: Complex) -> None:
    if panel.disk:
        axes.fill(flank.real, flank.imag, facecolor="#f1f4f7", edgecolor=MUTED_INK, linewidth=0.7)
    for shape in panel.shapes:
        match shape:
            case Circles():
                circles(axes, shape.centre, shape.radius, facecolor="white", edgecolor=LINES[shape.part], linewidth=0.9)
                for centre, text in zip(shape.centre, shape.texts, strict=bool(shape.texts)):
                    middle = "center" if "\n" in text else "center_baseline"
                    _write_within(axes, centre, text, va=middle, fontsize=shape.text_size, color=LINES[shape.part])
            case Points():
                axes.plot(shape.point.real, shape.point.imag, ".", color=ALARM, markersize=5)
            case RowLabel():
                _write_beyond(axes, shape)
    axes.plot(0, 0, "+", color=INK, markersize=6)
    edge = panel.reach or MARGIN * np.max(np.abs(flank))
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), title=panel.title)


def _write_within(axes: Axes, point: complex, text: str, **style: Any) -> None:
    axes.text(point.real, point.imag, text, ha="center", in_layout=False, **style)


def _write_beyond(axes: Axes, label: RowLabel) -> None:
    upright = abs(label.direction.imag) > abs(label.direction.real)
    axes.text(
        label.point.real,
        label.point.imag,
        label.text,
        color=LINES[label.part],
        fontsize=7.5,
        rotation=90 if upright else 0,
        rotation_mode="anchor",
        va="center",
        ha="left" if (label.direction.imag if upright else label.direction.real) > 0 else "right",
    )


PHASE_TICKS = np.arange(-180, 181, 45)


@with_style
def nominal_gap_figure(curve: pd.DataFrame, pins: pd.DataFrame, lobes_differ: bool) -> Figure:
    """Gap against the phase of a pin: distance from the flank, gap along the normal, and that at one crank angle.

    Parameters
    ----------
    curve : phase_deg ascending, exact_um, first_order_um.
    pins : phase_deg, first_order_um of the pins.
    lobes_differ : whether each lobe was measured: then no line joins the points, each of which is of its own lobe.
    """
    figure = new_figure(3.3)
    axes = figure.subplots()
    axes.axhline(0, color=MUTED_INK, linewidth=0.8)
    exact, first_order = (".", ".") if lobes_differ else ("-", "--")
    axes.plot(curve["phase_deg"], curve["exact_um"], exact, color=ACCENT, markersize=2, label="distance from the flank")
    along = curve["phase_deg"], curve["first_order_um"]
    axes.plot(*along, first_order, color=ALARM, markersize=1, label="along the normal")
    axes.plot(pins["phase_deg"], pins["first_order_um"], "o", color=INK, label="pins at this crank angle")
    axes.set(xlabel="phase of the pin from the eccentric (degrees): 0 in a root, 180 on a tip", xticks=PHASE_TICKS)
    axes.set_ylabel("gap (µm)")
    axes.margins(x=0.01)
    legend_below(figure, axes)
    return figure

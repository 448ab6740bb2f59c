"""How pins and output carry the load: dead zones, forces and deformations (the paper's Fig. 9 to 13)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import ALARM, legend_below, line_styles, new_figure, pin_axis, rising_styles, with_style

MARGIN = 2
"""Pins shown beyond the first and last loaded one."""


@with_style
def dead_zones_figure(traces: Mapping[str, pd.DataFrame]) -> Figure:
    """Clearance of every pin and how far the bodies approach there: contact where the approach exceeds the clearance.

    Parameters
    ----------
    traces : label -> rows of ``hysteresis/contacts`` of the pins of one sample at one step: contact, clearance_um,
        approach_um, force_N. One panel each.
    """
    figure = new_figure(0.6 + 2.3 * len(traces))
    panels = figure.subplots(len(traces), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, rows) in zip(panels, traces.items(), strict=True):
        is_loaded = rows[rows["force_N"] > 0]
        axes.bar(rows["contact"], rows["clearance_um"], width=0.8, color="#d3dae1", label="clearance")
        axes.plot(
            rows["contact"], rows["approach_um"], "o", color="#66727f", markersize=3, label="approach of the bodies"
        )
        axes.plot(
            is_loaded["contact"],
            is_loaded["approach_um"],
            "s",
            color=ALARM,
            markersize=4.5,
            label="approach, in contact",
        )
        top = max(rows["clearance_um"].max(), rows["approach_um"].max(), 0.0)
        axes.set_ylim(min(rows["clearance_um"].min(), 0.0) * 1.1, 1.08 * top if top > 0 else 1.0)
        axes.set(title=f"{label}: {len(is_loaded)} pins in contact", ylabel="distance (µm)")
        axes.margins(x=0.01)
    pin_axis(panels[-1])
    legend_below(figure, panels[0])
    return figure


@with_style
def pin_loads_figure(traces: Mapping[str, pd.DataFrame], rising: bool = False) -> Figure:
    """Contact force and contact deformation of the loaded pins against pin number.

    Parameters
    ----------
    traces : label -> rows of ``hysteresis/contacts`` of the pins of one sample at one step: contact, force_N,
        penetration_um.
    rising : whether the labels are steps of one rising quantity, the torque, and not separate cases.
    """
    figure = new_figure(4.6)
    force, depth = figure.subplots(2, 1, sharex=True)
    _draw_loads(force, depth, traces, "contact", rising)
    pin_axis(depth)
    numbers = np.concatenate([rows["contact"][rows["force_N"] > 0] for rows in traces.values()])
    if numbers.size:
        force.set_xlim(numbers.min() - MARGIN, numbers.max() + MARGIN)
    legend_below(figure, force)
    return figure


def _draw_loads(force: Axes, depth: Axes, traces: Mapping[str, pd.DataFrame], number: str, rising: bool) -> None:
    """Lines of contact force and deformation of the loaded contacts against the column ``number``."""
    for style, rows in zip(_styles(rising)(traces), traces.values(), strict=True):
        is_loaded = rows["force_N"] > 0
        force.plot(rows[number], rows["force_N"].where(is_loaded), **style)
        depth.plot(rows[number], rows["penetration_um"].where(is_loaded), **style)
    force.set(ylabel="contact force (N)", ylim=(0, None))
    depth.set(ylabel="deformation (µm)", ylim=(0, None))


@with_style
def output_loads_figure(
    traces: Mapping[str, pd.DataFrame],
    contacts: pd.DataFrame,
    station: str,
    rising: bool = False,
    names: Sequence[str] = (),
) -> Figure:
    """Contact force and deformation of the loaded output contacts along their rows (the paper's Fig. 13).

    Parameters
    ----------
    traces : label -> rows of ``hysteresis/contacts`` of one sample at one step, all contacts.
    contacts : rows of ``clearance/contacts`` at the same crank angle.
    station : what the numbers of the contacts of a row are called.
    rising : as in `pin_loads_figure`.
    names : of a contact of each interface, where they differ.

    Notes
    -----
    One pair of panels for each interface. One sense of torque loads one face at each end of a tongue: end 0 is drawn
    solid, end 1 dotted.
    """
    columns = ["contact", "interface", "face", "end", "station", "body_a", "body_b"]
    output = contacts.loc[contacts["kind"] == "output", columns]
    interfaces = list(output.groupby("interface"))
    figure = new_figure(4.6)
    grid = figure.subplots(2, len(interfaces), sharex="col", sharey="row", squeeze=False)
    for style, rows in zip(_styles(rising)(traces), traces.values(), strict=True):
        for (interface, end, _), row in rows.merge(output, on="contact").groupby(["interface", "end", "face"]):
            is_loaded, row = row["force_N"] > 0, row.sort_values("station")
            if not is_loaded.any():
                continue
            line = {**style, "label": style["label"] if end == 0 else None, "linestyle": "-" if end == 0 else ":"}
            grid[0, interface].plot(row["station"], row["force_N"].where(is_loaded), **line)
            grid[1, interface].plot(row["station"], row["penetration_um"].where(is_loaded), **line)
    for interface, row in interfaces:
        if len(interfaces) > 1:
            bodies = f"{row['body_a'].iloc[0]} to {row['body_b'].iloc[0]}"
            grid[0, interface].set_title((f"{names[interface]}s" if names else bodies).capitalize())
        grid[1, interface].set(xlabel=names[interface] if names else station, xticks=sorted(row["station"].unique()))
    grid[0, 0].set(ylabel="contact force (N)", ylim=(0, None))
    grid[1, 0].set(ylabel="deformation (µm)", ylim=(0, None))
    legend_below(figure, grid[0, -1])
    return figure


def _styles(rising: bool) -> Callable[[Mapping[str, Any]], Iterator[dict[str, Any]]]:
    return rising_styles if rising else line_styles

"""Clearances, spring laws and forces of the contacts (the paper's Fig. 4, 5 and 9 to 13)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator, StrMethodFormatter

from pipeline.figures.style import (
    ALARM,
    MUTED_INK,
    draw_band,
    legend_below,
    line_styles,
    new_figure,
    pin_axis,
    rising_styles,
    with_style,
)


@with_style
def pin_clearances_figure(traces: Mapping[str, pd.DataFrame], spread: pd.DataFrame | None = None) -> Figure:
    """Clearance against pin number for each trace, over the spread of the samples.

    Parameters
    ----------
    traces : label -> rows of ``clearance/gaps`` of the pins of one sample at one crank angle: contact, clearance_um.
    spread : per pin ``contact``, ``low``, ``middle``, ``high`` [um]: 5th, 50th and 95th percentile.
    """
    figure = new_figure(3.3)
    axes = figure.subplots()
    axes.axhline(0, color=MUTED_INK, linewidth=0.8)
    if spread is not None:
        draw_band(axes, spread["contact"], spread, "5 % to 95 % of samples", "median of samples")
    for style, rows in zip(line_styles(traces), traces.values(), strict=True):
        axes.plot(rows["contact"], rows["clearance_um"], **style)
    axes.set_ylabel("clearance (µm)")
    pin_axis(axes)
    axes.margins(x=0.01)
    legend_below(figure, axes)
    return figure


CURVES_SHOWN = 5
"""Laws of pins that a figure tells apart, spread over their curvatures."""
BEARING = -1
"""Stands for the input bearing, which is no contact."""


@with_style
def spring_laws_figure(
    laws: pd.DataFrame,
    contacts: pd.DataFrame,
    output: str = "output roller",
    bearing: str = "input bearing",
    names: Sequence[str] = (),
) -> Figure:
    """Force and tangent stiffness of the pins by the curvature of the flank, of the bearing and of the output.

    Parameters
    ----------
    laws : rows of ``springs/laws`` at one crank angle.
    contacts : rows of ``clearance/contacts`` at the same crank angle.
    output, bearing : what one of the output's contacts and the bearing are called.
    names : of a contact of each interface of the output, where they differ.

    Notes
    -----
    The linear extrapolation beyond the law's range is dashed.
    """
    curves = dict(iter(laws.groupby("contact")))
    figure = new_figure(5.4)
    grid = figure.subplots(2, 2, sharex="col")
    grid[0, 0].set_ylabel("local deformation (µm)")
    grid[1, 0].set_ylabel("tangent stiffness (N/µm)")
    for column, (title, chosen) in enumerate(
        (
            ("(a) Pins, by the flank's radius", _pin_curves(contacts)),
            (_others_title(contacts, bearing), _other_curves(contacts, curves, output, bearing, names)),
        )
    ):
        shown_curves = {label: curves[contact] for label, contact in chosen.items()}
        for style, rows in zip(line_styles(shown_curves), shown_curves.values(), strict=True):
            style = {"color": style["color"], "label": style["label"]}
            _draw(grid[0, column], rows, "local_um", style)
            _draw(grid[1, column], rows, "stiffness_N_per_um", style)
        grid[0, column].set_title(title)
        grid[0, column].legend(loc="upper left")
        grid[1, column].set_xlabel("force (N)")
        grid[0, column].margins(x=0.0)
        grid[0, column].set_ylim(bottom=0)
        grid[1, column].set_yscale("log")  # the roots are stiffer than the tips by two orders
        grid[1, column].yaxis.set_major_formatter(StrMethodFormatter("{x:,g}"))  # the page has no mathtext
        grid[1, column].yaxis.set_minor_locator(NullLocator())
    return figure


def _others_title(contacts: pd.DataFrame, bearing: str) -> str:
    return f"(b) {bearing.capitalize()}" + (" and output" if (contacts["kind"] == "output").any() else "")


def _draw(axes: Axes, rows: pd.DataFrame, column: str, style: dict[str, Any]) -> None:
    loaded_rows = rows[rows["force_N"] > 0]
    values, beyond_limit = loaded_rows[column].to_numpy(), loaded_rows["beyond_limit"].to_numpy()
    tangent = beyond_limit | np.append(beyond_limit[1:], False)  # joined to the last point of the law proper
    axes.plot(loaded_rows["force_N"], np.where(beyond_limit, np.nan, values), **style)
    axes.plot(loaded_rows["force_N"], np.where(tangent, values, np.nan), color=style["color"], linestyle=(0, (3, 2)))


def _pin_curves(contacts: pd.DataFrame) -> Mapping[str, int]:
    """A few pins, their curvatures evenly spread from the most concave flank to the most convex one."""
    pins = contacts[(contacts["kind"] == "pin") & (contacts["disk"] == 0)]
    curvatures = pins["curvature_per_mm"].to_numpy()
    targets = np.linspace(curvatures.min(), curvatures.max(), CURVES_SHOWN)
    picks = dict.fromkeys(int(np.argmin(np.abs(curvatures - curvature))) for curvature in targets)
    curves = {}
    for contact, curvature in zip(pins["contact"].iloc[list(picks)], curvatures[list(picks)], strict=True):
        shape = "concave" if curvature < 0 else "convex"
        radius = np.inf if curvature == 0 else 1 / abs(curvature)
        curves[f"{radius:.3g} mm {shape}, pin {contact}"] = int(contact)
    return curves


def _other_curves(
    contacts: pd.DataFrame, curves: Mapping[int, pd.DataFrame], name: str, bearing: str, names: Sequence[str]
) -> Mapping[str, int]:
    """The bearing, and one contact of each interface; one for both where they obey the same law."""
    output = contacts[contacts["kind"] == "output"]
    if output.empty:
        return {bearing: BEARING}
    rollers = output.loc[output.groupby("interface")["contact"].idxmin()]
    reference, *remaining = (curves[contact]["local_um"].to_numpy() for contact in rollers["contact"])
    if all(np.array_equal(reference, curve) for curve in remaining):
        return {bearing: BEARING, name: int(rollers["contact"].iloc[0])}
    labels = names or [f"{name}, {row['body_a']} to {row['body_b']}" for _, row in rollers.iterrows()]
    return {
        bearing: BEARING,
        **{label: int(contact) for label, contact in zip(labels, rollers["contact"], strict=False)},
    }


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
            grid[0, interface].set_title((names[interface] if names else bodies).capitalize())
        grid[1, interface].set(xlabel=names[interface] if names else station, xticks=sorted(row["station"].unique()))
    grid[0, 0].set(ylabel="contact force (N)", ylim=(0, None))
    grid[1, 0].set(ylabel="deformation (µm)", ylim=(0, None))
    legend_below(figure, grid[0, -1])
    return figure


def _styles(rising: bool) -> Callable[[Mapping[str, Any]], Iterator[dict[str, Any]]]:
    return rising_styles if rising else line_styles

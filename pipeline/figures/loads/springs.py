"""Spring laws of the contacts and of the input bearing (the paper's Fig. 5)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from pipeline.figures.style import line_styles, new_figure, with_style

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
        grid[1, column].yaxis.set_minor_locator(NullLocator())
    return figure


def _others_title(contacts: pd.DataFrame, bearing: str) -> str:
    return f"(b) {bearing.capitalize()}" + (" and output" if (contacts["kind"] == "output").any() else "")


def _draw(axes: Axes, rows: pd.DataFrame, column: str, style: dict) -> None:
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

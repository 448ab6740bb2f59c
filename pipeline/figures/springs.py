"""Spring laws of the contacts and of the input bearing (the paper's Fig. 5)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import line_styles, new_figure, styled

CURVES_SHOWN = 5
BEARING = -1


@styled
def spring_laws_figure(laws: pd.DataFrame, contacts: pd.DataFrame) -> Figure:
    """Force and tangent stiffness of the pins by the curvature of the flank, of the bearing and of the rollers.

    Parameters
    ----------
    laws : rows of ``springs/laws`` at one crank angle.
    contacts : rows of ``clearance/contacts`` at the same crank angle.

    Notes
    -----
    Beyond the law's range its tangent goes on, drawn dashed. Pins of equal curvature share a curve; the ones shown are
    spread evenly over the pins, from the roots of the lobes to their tips.
    """
    curves = {contact: rows for contact, rows in laws.groupby("contact")}
    figure = new_figure(5.4)
    grid = figure.subplots(2, 2, sharex="col")
    for column, (title, chosen) in enumerate((
        ("(a) Pins, by the flank's radius", _pin_curves(contacts)),
        ("(b) Input bearing and output rollers", _other_curves(contacts)),
    )):
        shown = {label: curves[contact] for label, contact in chosen.items()}
        for style, rows in zip(line_styles(shown), shown.values(), strict=True):
            style.pop("marker")
            _draw(grid[0, column], rows, "local_um", style)
            _draw(grid[1, column], rows, "stiffness_N_per_um", style)
        grid[0, column].set_title(title)
        grid[0, column].legend(loc="upper left")
        grid[1, column].set_xlabel("force (N)")
        grid[0, column].margins(x=0.0)
    grid[0, 0].set_ylabel("local deformation (µm)")
    grid[1, 0].set_ylabel("tangent stiffness (N/µm)")
    for axes in grid.flat:
        axes.set_ylim(bottom=0)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, column: str, style: dict) -> None:
    loaded = rows[rows["force_N"] > 0]
    values, beyond = loaded[column].to_numpy(), loaded["beyond_limit"].to_numpy()
    tangent = beyond | np.append(beyond[1:], False)  # joined to the last point of the law proper
    axes.plot(loaded["force_N"], np.where(beyond, np.nan, values), **style)
    axes.plot(loaded["force_N"], np.where(tangent, values, np.nan), color=style["color"], linestyle=(0, (3, 2)))


def _pin_curves(contacts: pd.DataFrame) -> Mapping[str, int]:
    """A few pins from the most concave flank to the most convex one."""
    pins = contacts[contacts["kind"] == "pin"].sort_values("curvature_per_mm", kind="stable")
    picks = np.unique(np.linspace(0, len(pins) - 1, CURVES_SHOWN).round().astype(int))
    chosen = {}
    for contact, curvature in zip(pins["contact"].iloc[picks], pins["curvature_per_mm"].iloc[picks], strict=True):
        shape = "concave" if curvature < 0 else "convex"
        radius = np.inf if curvature == 0 else 1 / abs(curvature)
        chosen[f"{radius:.3g} mm {shape}, pin {contact}"] = int(contact)
    return chosen


def _other_curves(contacts: pd.DataFrame) -> Mapping[str, int]:
    """The bearing, and one roller of each interface."""
    rollers = contacts[contacts["kind"] == "output"].groupby("interface")["contact"].min()
    names = {
        f"roller, {row['body_a']} to {row['body_b']}": int(row["contact"])
        for _, row in contacts[contacts["contact"].isin(rollers)].iterrows()
    }
    return {"input bearing": BEARING, **names}

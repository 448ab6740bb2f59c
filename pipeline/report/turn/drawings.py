"""The figures of the section: which rows each one draws, and what its caption says."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.figures.hysteresis import spread_frame
from pipeline.figures.turn import orders_figure, transmission_figure, turn_forces_figure
from pipeline.model.metrics.turn import FEWEST_ANGLES
from pipeline.report.drawing import Drawing
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import count_text, plain_number

UNBALANCED_NOTE = " (not known of this reducer, see below)"
"""Said of forces on a bearing that do not balance the torque on the output."""
TILT = " That the offset of the disks' planes tilts them is not modelled: bearings carry more than this."
"""Said of several disks."""
MESH_ORDERS = 2
"""Orders about that of the pins that are drawn with the lowest."""


def turn_drawings(frames: Frames) -> Iterator[Drawing]:
    """All figures of the turn; none from fewer angles than tell anything of it."""
    if not frames.samples_drawn or len(frames.study.cycle.crank_deg) < FEWEST_ANGLES:
        return
    yield _transmission(frames)
    if not frames.is_listed and len(frames.orders):
        yield _orders(frames)
    yield _forces(frames)


def _panels(frames: Frames) -> dict[str, float]:
    """Torque [N m] of the two curves by their titles."""
    held_torque = assembly.definitions(frames.study).rigidity_high
    return {"Without load, at the end of the play": 0.0, f"{plain_number(held_torque)} N m held": held_torque}


def _spread(frames: Frames, rows: pd.DataFrame, column: str, is_centred: bool) -> pd.DataFrame | None:
    """Spread over the samples in the sense +, the nominal one left out; None of listed cases and of a single sample."""
    rows = rows[(rows["sense"] == "+") & (rows["sample"] >= frames.first_random)]
    table = rows.pivot(index="sample", columns="crank_deg", values=column).dropna()
    if frames.is_listed or len(table) < 2:
        return None
    values = table.to_numpy()
    shifted_values = values - values.mean(axis=1, keepdims=True) if is_centred else values
    return spread_frame(shifted_values, crank_deg=table.columns.to_numpy())


def _of_torque(rows: pd.DataFrame, torque: float) -> pd.DataFrame:
    return rows[np.abs(rows["torque_Nm"]) == torque]


def _transmission(frames: Frames) -> Drawing:
    label, sample = next(iter(frames.samples_drawn.items()))
    panels, spreads = {}, {}
    for title, torque in _panels(frames).items():
        rows = _of_torque(frames.transmission, torque)
        unit = rows[rows["sample"] == sample]
        mean = unit.groupby("sense", observed=True)["error_arcsec"].transform("mean")
        panels[title] = unit.assign(error_arcsec=unit["error_arcsec"] - mean)
        spread = _spread(frames, rows, "error_arcsec", is_centred=True)
        if spread is not None:
            spreads[title] = spread
    return Drawing(
        "transmission",
        f"Transmission error over a turn of the {frames.study.cycle.turn}",
        f"Angle of the output less that of the nominal ratio, about its mean: {frames.owner(label)} in both senses"
        f"{', and the spread of the samples in the sense +' if spreads else ''}.",
        partial(transmission_figure, panels, spreads),
    )


def _orders(frames: Frames) -> Drawing:
    pins, panels = frames.study.design.cycloid.pins, {}
    cycle, under_load = frames.study.cycle, bool((frames.orders["torque_Nm"] != 0).any())
    angles = len(cycle.crank_deg) if under_load else cycle.rigid_angles
    lowest = (angles - 1) // 2 // cycle.crank_turns
    folded_text = f" Orders beyond {lowest} fold back onto these" if under_load else ""
    for title, torque in _panels(frames).items():
        rows = _of_torque(frames.orders, torque)
        rows = rows[(rows["sample"] >= frames.first_random) & (rows["order"] <= lowest)]
        if len(rows):
            quantiles = rows.groupby("order")["amplitude_arcsec"].quantile([0.5, 0.95]).unstack()
            panels[title] = quantiles.set_axis(["middle", "high"], axis=1).reset_index()
    free_rows = _of_torque(frames.orders, 0.0)
    mesh = free_rows.loc[np.abs(free_rows["order"] - pins) <= MESH_ORDERS, "amplitude_arcsec"]
    at_pins = f" At the order of the {pins} pins the unloaded one has {mesh.median():.2g} arcsec." if len(mesh) else ""
    return Drawing(
        "orders",
        "Orders of the transmission error",
        f"Amplitude of the waves per turn of the crank, both senses.{at_pins}{folded_text}"
        f"{' under load, for the loaded angles do not tell them apart.' if folded_text else ''}",
        partial(orders_figure, panels),
    )


def _forces(frames: Frames) -> Drawing:
    label, sample = next(iter(frames.samples_drawn.items()))
    rows = frames.transmission[frames.transmission["torque_Nm"] != 0]
    spread = _spread(frames, rows, "bearing_force_N", is_centred=False)
    contacts = frames.turn_contacts[frames.turn_contacts["sample"] == sample]
    of_pin = []
    if len(contacts):
        pin = contacts[contacts["contact"] == contacts["contact"].min()]
        of_pin.append(pin.assign(sense=np.where(pin["torque_Nm"] > 0, "+", "-")))
    held_torque = plain_number(assembly.definitions(frames.study).rigidity_high)
    design = frames.study.design
    bearing, several = design.output.words.bearing, design.disk.count > 1 or design.output.carries_disks
    force = "largest force of a disk on a" if several else "force of the disk on the"
    return Drawing(
        "turn_forces",
        f"Forces over a turn of the {frames.study.cycle.turn}",
        f"{held_torque} N m held. Left: {force} {bearing}{_whose(frames, label, spread)}"
        f"{UNBALANCED_NOTE if frames.units['bearing_force_peak_N'].isna().all() else ''}."
        f"{TILT if frames.study.design.disk.count > 1 else ''} "
        f"Right: contact force of one pin of {frames.owner(label)}; it carries in one half of the turn in each sense.",
        partial(turn_forces_figure, rows[rows["sample"] == sample], spread, of_pin, bearing),
    )


def _whose(frames: Frames, label: str, spread: pd.DataFrame | None) -> str:
    samples = frames.transmission["sample"].nunique()
    band = f", and the spread of {count_text(samples, 'sample')}" if spread is not None else ""
    return f" of {frames.owner(label)}{band}"

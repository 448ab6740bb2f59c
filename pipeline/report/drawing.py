"""What the report states of a figure, which rows and words figures share, and the gap of the drawn flank."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.designs.design import Design
from pipeline.figures.labels import centred_loops, spread_frame
from pipeline.model.geometry.clearance import Errors, exact_gaps, first_order_gaps
from pipeline.model.units import UM_PER_MM
from pipeline.report.frames import Frames
from pipeline.report.layout import count_text, listed_text, plain_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """One figure of the report; `name` is the stem of its files and its place in the page, `figure` draws it."""

    name: str
    title: str
    caption: str
    figure: Callable[[], Figure]


def disk_words(design: Design) -> str:
    """Which disk a figure shows, where there are several."""
    return ", disk 0 of several" if design.disk.count > 1 else ""


def band_sentence(frames: Frames, spread: object) -> str:
    """Which samples the band is of."""
    if spread is None:
        return ""
    subset = frames.curves["sample"].iloc[-1] + 1 < frames.study.samples.rows
    return f" The band is over {'the first ' if subset else ''}{count_text(len(frames.band), 'sample')}."


def loop_traces(frames: Frames) -> dict[str, pd.DataFrame]:
    """Loop of each drawn sample at the crank angle of the figures, by its label."""
    curves = frames.at_crank(frames.curves)
    return {label: curves[curves["sample"] == sample] for label, sample in frames.samples_drawn.items()}


def loop_spreads(frames: Frames, *columns: str) -> Mapping[str, pd.DataFrame] | None:
    """Spread over the samples on the two branches that span all torques, by column; None of a single sample.

    Angles count from the middle of each loop's width at zero torque.
    """
    if len(frames.band) < 2:
        return None
    steps = len(frames.of_band(frames.curves, "torque_Nm")[0])
    branch = np.asarray(frames.curves["branch"].iloc[:steps])
    torque = frames.curves["torque_Nm"].to_numpy()[:steps]
    spanning = (branch == "loading+") | (branch == "loading-")
    spreads = {}
    for name in columns:
        values = frames.of_band(frames.curves, name)
        values = centred_loops(values, branch, torque) if name == "angle_arcmin" else values
        spreads[name] = spread_frame(values[:, spanning], branch=branch[spanning], torque_Nm=torque[spanning])
    return spreads


CRANKS_PER_PITCH = 16
"""Crank angles within a pitch of the pins: between them their phases fill the lobe."""


def nominal_gaps(design: Design, crank_deg: float) -> pd.DataFrame:
    """Gaps of nominal pins at one crank angle by phase: phase_deg, exact_um, first_order_um."""
    reducer, profile = assembly.reducer(design, crank_deg), assembly.profile(design)
    nominal = Errors.zero(profile.pins, profile.lobes, len(reducer.contacts) - reducer.n_pins)
    gaps = {
        name: UM_PER_MM * method(profile, reducer, nominal, "radial")[0]
        for name, method in (("exact_um", exact_gaps), ("first_order_um", first_order_gaps))
    }
    return pd.DataFrame({"phase_deg": np.degrees(reducer.pins.phase), **gaps})


def nominal_gap_curve(design: Design) -> pd.DataFrame:
    """Gaps of nominal pins over the phase, ascending; columns as of ``nominal_gaps``."""
    cranks = 360 / design.cycloid.pins * np.arange(CRANKS_PER_PITCH) / CRANKS_PER_PITCH
    rows = pd.concat([nominal_gaps(design, float(crank)) for crank in cranks])
    return rows.sort_values("phase_deg", ignore_index=True)


def flank_fact(design: Design) -> str:
    """How the drawing modifies the flank; empty without a modification."""
    flank = design.flank
    if flank is None:
        return ""
    parts = {
        "equidistant {} µm": flank.equidistant_um,
        "moved distance {} µm": flank.moved_distance_um,
        "rotation {}′": flank.rotation_arcmin,
    }
    modifications = [text.format(plain_number(value)) for text, value in parts.items() if value]
    if flank.measured is not None:
        lobes = "each lobe" if len(flank.measured.deviation_um) > 1 else "one for all lobes"
        modifications.append(f"and a measured deviation at {flank.measured.points} points, {lobes}")
    return listed_text(modifications) if modifications else "as the pins generate it"

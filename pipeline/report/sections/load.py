"""How the contacts carry the load: clearances, spring laws, forces and deflections."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.figures.contacts import (
    dead_zones_figure,
    output_loads_figure,
    pin_clearances_figure,
    pin_loads_figure,
    spring_laws_figure,
)
from pipeline.figures.hysteresis import bearing_figure
from pipeline.figures.labels import spread_frame
from pipeline.report.frames import DRAWN_CASES, Drawing, Frames, band_sentence, disk_words, loop_spreads, loop_traces
from pipeline.report.layout import plain_number
from pipeline.report.sections.section import Section

RISING = (0.25, 0.5, 1.0)
"""Shares of the largest torque that join the lost-motion torque in the figures of growing torque."""


def _drawings(frames: Frames) -> Iterator[Drawing]:
    yield _springs(frames)
    yield _clearances(frames)
    yield from _loads(frames)
    yield _bearing(frames)


def _springs(frames: Frames) -> Drawing:
    output = frames.study.design.output
    return Drawing(
        "spring_laws",
        "Spring laws",
        "Local deformation and tangent stiffness of single contacts, beyond their clearance. The overall "
        "disk deflection is additional. Dashed: linear extrapolation beyond the law's range.",
        partial(
            spring_laws_figure,
            frames.at_crank(frames.laws),
            frames.at_crank(frames.contacts),
            output.words.contact,
            output.words.bearing,
            output.words.rows,
        ),
    )


def _clearances(frames: Frames) -> Drawing:
    pins = frames.study.design.cycloid.pins
    gaps = frames.at_crank(frames.gaps)
    of_pins = gaps[gaps["contact"] < pins]
    traces = {label: of_pins[of_pins["sample"] == sample] for label, sample in frames.samples_drawn.items()}
    spread = None
    if len(frames.band) > 1:
        spread = spread_frame(frames.of_band(frames.gaps, "clearance_um")[:, :pins], contact=np.arange(pins))
    return Drawing(
        "clearances",
        "Clearance between disk and pins",
        f"At crank angle {plain_number(frames.crank_deg)}°, before any load. Equal errors of the pins do not give "
        f"equal clearances. Negative values are interference.{band_sentence(frames, spread)}",
        partial(pin_clearances_figure, traces, spread),
    )


def _loads(frames: Frames) -> Iterator[Drawing]:
    """Forces on pins and rollers of the drawn samples whose contacts were kept."""
    selected_figures = {
        label: rows
        for label, sample in frames.samples_drawn.items()
        if len(rows := frames.at_crank(frames.loads[frames.loads["sample"] == sample]))
    }
    if not selected_figures:
        return
    study, pins = frames.study, frames.study.design.cycloid.pins
    torques = _rising_torques(frames, next(iter(selected_figures.values())))
    low, crank = torques[0], plain_number(frames.crank_deg)
    at_low = {label: _at_torque(rows, low) for label, rows in selected_figures.items()}
    of_pins = {label: rows[rows["contact"] < pins] for label, rows in at_low.items()}
    yield Drawing(
        "dead_zones",
        f"Clearance and approach at {plain_number(low)} N m",
        f"At crank angle {crank}° and {plain_number(study.metrics.lost_motion_percent)} % of the rated torque. A pin "
        "carries load where the bodies approach each other by more than its clearance.",
        partial(dead_zones_figure, of_pins),
    )
    contacts, of_disk = frames.at_crank(frames.contacts), disk_words(study.design)
    if len(selected_figures) > 1:
        traces, rising, condition = at_low, False, f"at {plain_number(low)} N m"
    else:
        ((label, rows),) = selected_figures.items()
        traces = {f"{plain_number(torque)} N m": _at_torque(rows, torque) for torque in torques}
        rising, condition = True, f"of {frames.owner(label)} under growing torque"
    yield Drawing(
        "pin_loads",
        f"Contact forces and deformations of the pins {condition}",
        f"At crank angle {crank}°{of_disk}. The deformation is that of the contact and of the disk under it.",
        partial(pin_loads_figure, {name: rows[rows["contact"] < pins] for name, rows in traces.items()}, rising),
    )
    words = study.design.output.words
    if study.design.output.contacts == 0:
        return
    yield Drawing(
        "output_loads",
        f"Forces on the {words.contact}s {condition}",
        f"At crank angle {crank}°{of_disk}; {words.loads}",
        partial(output_loads_figure, traces, contacts[contacts["disk"] <= 0], words.station, rising, words.rows),
    )


def _rising_torques(frames: Frames, rows: pd.DataFrame) -> list[float]:
    """The lost-motion torque and some larger ones that the load cycle visits, ascending [N m]."""
    state_torques = np.unique(rows["torque_Nm"].to_numpy())
    lost_motion = frames.study.design.cycloid.rated_torque_Nm * frames.study.metrics.lost_motion_percent / 100
    torques = [lost_motion, *(share * state_torques[-1] for share in RISING)]
    return sorted({float(state_torques[np.argmin(np.abs(state_torques - torque))]) for torque in torques})


def _at_torque(rows: pd.DataFrame, torque: float) -> pd.DataFrame:
    """Contacts at the first step of the cycle that has this torque."""
    return rows[rows["step"] == rows.loc[rows["torque_Nm"] == torque, "step"].min()]


def _bearing(frames: Frames) -> Drawing:
    design, spreads = frames.study.design, loop_spreads(frames, "bearing_x_um", "bearing_y_um")
    return Drawing(
        "bearing",
        "Displacement of the disk" + ("" if design.output.carries_disks else " on the input bearing"),
        f"At crank angle {plain_number(frames.crank_deg)}°{disk_words(design)}, in the housing's directions; the "
        f"eccentric points along {_direction(frames.crank_deg)}.{band_sentence(frames, spreads)}",
        partial(bearing_figure, loop_traces(frames), spreads),
    )


def _direction(crank_deg: float) -> str:
    names: dict[float, str] = {0.0: "+x", 90.0: "+y", 180.0: "−x", 270.0: "−y"}
    return names.get(crank_deg, f"{plain_number(crank_deg)}° from x, counterclockwise")


SECTION = Section(
    name="load",
    title="How the load is carried",
    rank=70,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"drawn_cases": DRAWN_CASES},
    drawings=_drawings,
)

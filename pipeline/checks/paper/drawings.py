"""The paper's figures drawn from the run's tables with its cases; each with the sentence that goes under it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline import assembly
from pipeline.checks.paper.statements import SHARES
from pipeline.checks.paper.table2 import Tables
from pipeline.figures import contacts
from pipeline.figures.hysteresis import bearing_figure, hysteresis_figure


@dataclass(frozen=True)
class PaperDrawing:
    """One figure: the numbers of the paper's figures that it stands for, its file's stem, title and caption."""

    numbers: tuple[str, ...]
    stem: str
    title: str
    caption: str
    figure: Figure


def drawings(tables: Tables) -> Iterator[PaperDrawing]:
    """All figures in the order of the paper."""
    yield from _before_load(tables)
    yield from _at_lost_motion(tables)
    yield from _under_torque(tables)


def _before_load(tables: Tables) -> Iterator[PaperDrawing]:
    yield PaperDrawing(
        ("4",),
        "figure_04",
        "Clearances between the pin-rollers and the cycloid disk with various tolerances",
        "Clearance at the nominal pose against pin number; pins are numbered clockwise from the eccentric.",
        contacts.pin_clearances_figure({case: tables.clearances(case) for case in tables.with_tolerance}),
    )
    yield PaperDrawing(
        ("5a", "5b"),
        "figure_05",
        "Non-linear contact stiffness of the connecting elements",
        "(a) disk and pins, (b) input bearing and output rollers. Above the deformation against the force, below the "
        "tangent stiffness. Of the disk's share the law holds what the mesh does not; the paper's springs hold all.",
        contacts.spring_laws_figure(tables.laws, tables.contacts),
    )


def _at_lost_motion(tables: Tables) -> Iterator[PaperDrawing]:
    torque = tables.lost_motion_torque
    yield PaperDrawing(
        ("9",),
        "figure_09",
        f"Clearance and spring deformation at the contact points under {torque:g} N m",
        "A pin touches where the approach of the two bodies exceeds the clearance.",
        contacts.dead_zones_figure({case: tables.loaded_pins(case, torque) for case in tables.with_tolerance}),
    )
    every = [case.label for case in tables.study.cases]
    yield PaperDrawing(
        ("10",),
        "figure_10",
        f"Contact force and contact deformation at {torque:g} N m",
        "Against pin number, for each tolerance.",
        contacts.pin_loads_figure({case: tables.loaded_pins(case, torque) for case in every}),
    )


def _under_torque(tables: Tables) -> Iterator[PaperDrawing]:
    rated_torque, torque = tables.study.design.cycloid.rated_torque_Nm, tables.lost_motion_torque
    case = tables.with_tolerance[0]
    rising = {f"{share * rated_torque:g} N m": tables.loaded_pins(case, share * rated_torque) for share in SHARES}
    yield PaperDrawing(
        ("11",),
        "figure_11",
        f"Contact force and contact deformation under increasing torque, {case}",
        "Against pin number.",
        contacts.pin_loads_figure(rising, rising=True),
    )
    every = [tolerance_case.label for tolerance_case in tables.study.cases]
    curves = {label: tables.of_case(tables.curves, label) for label in every}
    yield PaperDrawing(
        ("12",),
        "figure_12",
        "Deflection of the input bearing with various tolerances of disk (D) and output rollers (R)",
        "Along x, the direction of the eccentric, and along y; over the whole load cycle.",
        bearing_figure(curves),
    )
    yield PaperDrawing(
        ("13",),
        "figure_13",
        f"Contact force and deformation of the output rollers at {torque:g} N m",
        "Rollers from outside to inside, on both interfaces.",
        contacts.output_loads_figure(
            {label: tables.contacts_at(label, torque) for label in every},
            tables.contacts,
            tables.study.design.output.words.station,
        ),
    )
    yield PaperDrawing(
        ("14",),
        "figure_14",
        "Torque and torsional angle with various tolerances",
        "Left the whole cycle, right its middle. Marked, on the first curve, are the definitions of the metrics.",
        hysteresis_figure(_open_first(curves), None, assembly.definitions(tables.study)),
    )


def _open_first(curves: dict[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    """The curves, the widest first: the definitions are marked on it."""
    widths = {label: float(np.ptp(rows["angle_arcmin"].to_numpy())) for label, rows in curves.items()}
    return {label: curves[label] for label in sorted(widths, key=lambda label: -widths[label])}

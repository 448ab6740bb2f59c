"""The reducer and the settings of the study."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.arrays import Complex
from pipeline.config.designs.design import Design
from pipeline.figures.labels import PARAMETERS
from pipeline.figures.reducer import nominal_gap_figure, reducer_figure
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation
from pipeline.report import inputs
from pipeline.report.frames import ROWS_SHOWN, Drawing, Frames, flank_fact, nominal_gap_curve, nominal_gaps
from pipeline.report.layout import plain_number
from pipeline.report.sections.section import Page, Section

FLANK_POINTS_PER_LOBE = 48
"""Points of the drawn flank: its polygon is off by less than a line."""


def _values(page: Page) -> Mapping[str, object]:
    study = page.frames.study
    cases = inputs.case_columns(study.cases)
    return {
        "reducer_facts": inputs.reducer_facts(study.design),
        "study_facts": inputs.study_facts(page.frames),
        "tolerance_rows": inputs.tolerance_rows(study.tolerances),
        "zero_tolerances": inputs.zero_tolerances(study.tolerances),
        "nominal_outside": inputs.nominal_outside(study.tolerances),
        "case_titles": [PARAMETERS[name] for name in cases],
        "case_inputs": [(case.label, inputs.case_cells(case, cases)) for case in study.cases[:ROWS_SHOWN]],
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    yield _reducer(frames)
    if frames.study.design.flank is not None:
        yield _flank(frames)


def flank_outline(design: Design, crank_deg: float) -> Complex:
    """Closed outline of the disk in the housing frame (n_points,) [mm], x + iy; its points are equally far apart."""
    cycloid = design.cycloid
    profile = CycloidProfile(cycloid.pins, cycloid.pin_circle_radius_mm, cycloid.pin_radius_mm, cycloid.eccentricity_mm)
    crank = np.radians(crank_deg)
    fine = np.linspace(0, profile.lobe_pitch, 50 * FLANK_POINTS_PER_LOBE)
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(profile.flank(fine))))])
    lobe = np.interp(np.linspace(0, length[-1], FLANK_POINTS_PER_LOBE, endpoint=False), length, fine)
    psi = np.append((lobe + profile.lobe_pitch * np.arange(profile.lobes)[:, None]).ravel(), 2 * np.pi)
    turned = profile.flank(psi) * np.exp(1j * disk_rotation(profile, crank))
    outline: Complex = turned + profile.eccentricity * np.exp(1j * crank)
    return outline


def _reducer(frames: Frames) -> Drawing:
    design, crank = frames.study.design, frames.crank_deg
    reducer, words = assembly.reducer(design, crank), design.output.words
    panels = [
        (panel, flank_outline(design, float(np.degrees(disk.crank))))
        for disk, numbers in zip(reducer.disks, reducer.output_rows, strict=True)
        for panel in design.output.panels(disk, reducer.contacts.some(numbers), numbers)
    ]
    return Drawing(
        "reducer",
        f"Numbers of pins and {words.contact}s",
        f"Pins are counted clockwise from the direction of the eccentric at crank angle 0. {words.drawing}",
        partial(
            reducer_figure,
            frames.at_crank(frames.contacts),
            [outline for _, outline in panels] or [flank_outline(design, crank)],
            crank,
            design.cycloid.pin_radius_mm,
            [panel for panel, _ in panels],
        ),
    )


def _flank(frames: Frames) -> Drawing:
    design = frames.study.design
    measured_flank = design.flank.measured if design.flank else None
    lobes_differ = measured_flank is not None and len(measured_flank.deviation_um) > 1
    return Drawing(
        "flank",
        "Gap of the drawn flank",
        f"What the drawn flank leaves to nominal pins before any take-up, {flank_fact(design)}; crank angle of the "
        f"pins {plain_number(frames.crank_deg)}°. Small motions close the gap along the nominal normal. The distance "
        "is less near the roots, where the nearest point of the flank lies beside the one that the normal meets.",
        partial(nominal_gap_figure, nominal_gap_curve(design), nominal_gaps(design, frames.crank_deg), lobes_differ),
    )


SECTION = Section(
    name="study",
    title="Reducer and study",
    rank=60,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    drawings=_drawings,
)

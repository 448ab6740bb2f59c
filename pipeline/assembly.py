"""A validated design and study as objects of the model: where millimetres of a file become bodies and contacts."""

from typing import TYPE_CHECKING

import numpy as np

from pipeline.config.design import Design
from pipeline.config.design import Material as MaterialSection
from pipeline.config.design import PinInHole as PinInHoleSection
from pipeline.config.design import RollerPlate as RollerPlateSection
from pipeline.config.flank import flank_profile
from pipeline.config.study import Study
from pipeline.model.contact.laws import ContactLaws, LineContact, Material, concatenated
from pipeline.model.contact.line_laws import library as law_library
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.cycloid_profile import CycloidProfile, Real
from pipeline.model.geometry.reducer import (
    Bearing,
    PinInHole,
    Reducer,
    RollerPlate,
    pin_in_hole_reducer,
    roller_plate_reducer,
)
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.metrics import Definitions
from pipeline.model.units import MM_PER_UM, NMM_PER_NM

if TYPE_CHECKING:  # its statistics are slow to import, and workers import this module
    from pipeline.sampling import Errors as SampledErrors


def profile(design: Design) -> CycloidProfile:
    """The flank of the design, with its modification."""
    return flank_profile(design.cycloid, design.flank)


def reducer(design: Design, crank_deg: float) -> Reducer:
    """Bodies and contacts of the design at one crank angle [degrees]."""
    crank, output = np.radians(crank_deg), design.output
    if isinstance(output, PinInHoleSection):
        return pin_in_hole_reducer(profile(design), pins_in_holes(design, output), crank)
    mechanism = RollerPlate(
        stations=tuple(np.linspace(output.outer_station_mm, output.inner_station_mm, output.stations)),
        face_offset=output.face_offset_mm,
        slide_angle=np.radians(output.slide_angle_deg),
        floats=output.plate == "floats",
    )
    return roller_plate_reducer(profile(design), mechanism, crank)


def pins_in_holes(design: Design, output: PinInHoleSection) -> PinInHole:
    """The output pins of the design and the holes of its disk."""
    return PinInHole(
        pins=output.pins,
        circle_radius=output.pin_circle_radius_mm,
        pin_radius=output.pin_radius_mm,
        hole_radius=output.hole_radius_mm(design.cycloid),
        phase=np.radians(output.phase_deg),
    )


def bearing(design: Design) -> Bearing:
    """The input bearing of the design."""
    return Bearing(design.bearing.stiffness_N_per_mm_power, design.bearing.exponent)


def load_cycle(study: Study, levels: int) -> LoadCycle:
    """The load cycle of so many ``levels`` a branch, with the torques of the metrics among them."""
    metrics = study.metrics
    marks = (metrics.lost_motion_percent, *metrics.rigidity_percent)
    return LoadCycle.evenly(
        NMM_PER_NM * study.design.cycloid.rated_torque_Nm,
        levels,
        study.cycle.torque_fraction,
        tuple(percent / 100 for percent in marks),
    )


def definitions(study: Study) -> Definitions:
    """Torques [N m] at which the study reads a loop."""
    rated, metrics = study.design.cycloid.rated_torque_Nm, study.metrics
    percents = (metrics.lost_motion_percent, *metrics.rigidity_percent)
    return Definitions(*(percent / 100 * rated for percent in percents))


def errors(sampled: "SampledErrors") -> Errors:
    """Sampled errors [um] as the model takes them [mm]; a lobe's error is the disk's and its own."""
    return Errors(
        pin_radial=MM_PER_UM * sampled.pin_radial,
        pin_tangential=MM_PER_UM * sampled.pin_tangential,
        pin_radius=MM_PER_UM * sampled.pin_radius,
        lobe=MM_PER_UM * (sampled.disk_profile[:, None] + sampled.lobe_profile),
        eccentricity=MM_PER_UM * sampled.eccentricity,
        roller_diameter=MM_PER_UM * sampled.roller_diameter,
    )


def bearing_clearance(design: Design, deviation_um: Real) -> Real:
    """Radial clearance (n,) [mm] of the input bearing: the design's and each sample's."""
    return MM_PER_UM * (design.bearing.clearance_um + deviation_um)


def _material(section: MaterialSection, design: Design) -> Material:
    return Material(section.youngs_modulus_MPa, section.poisson_ratio, design.disk.stress)


def contact_laws(study: Study, at: Reducer) -> ContactLaws:
    """Laws of every contact of the reducer, pins first.

    Raises
    ------
    ValueError
        If the law leaves nothing to a contact (Palmgren on a patch that holds more than its whole approach).
    """
    output = study.design.output
    of_output = _hole_laws(study, output) if isinstance(output, PinInHoleSection) else _roller_laws(study, output)
    return concatenated([_pin_laws(study, at), of_output])


def _pin_laws(study: Study, at: Reducer) -> ContactLaws:
    design, width = study.design, study.reduce.patch_half_width_mm
    radius, thickness = design.cycloid.pin_radius_mm, design.disk.thickness_mm
    pin = _material(design.materials[design.pins.material], design)
    disk = _material(design.materials[design.disk.material], design)
    contact = LineContact(1 / (1 / radius + at.pins.flank_curvature), thickness, pin, disk)
    return law_library()[study.springs.law].on_mesh(contact, radius, width)


def _hole_laws(study: Study, output: PinInHoleSection) -> ContactLaws:
    """An output pin in a hole of the meshed disk: a line contact of a cylinder with a slightly larger concave one.

    Hertz' half plane holds while the contact is narrow against the pin; the law ends at half of its radius.
    """
    design, width = study.design, study.reduce.roller_patch_half_width_mm
    pin = _material(design.materials[output.pin_material], design)
    disk = _material(design.materials[design.disk.material], design)
    radius, thickness = output.pin_radius_mm, design.disk.thickness_mm
    relative = 1 / (1 / radius - 1 / output.hole_radius_mm(design.cycloid))
    contact = LineContact(np.full(output.pins, relative), thickness, pin, disk)
    return law_library()[study.springs.law].on_mesh(contact, radius, width)


def _roller_laws(study: Study, output: RollerPlateSection) -> ContactLaws:
    """A roller between the flats of two bodies: the disk's tongue and the plate, or the plate and the output.

    The output is taken to be of the plate's material.
    """
    design, law = study.design, law_library()[study.springs.law]
    roller = _material(design.materials[output.roller_material], design)
    plate = _material(design.materials[output.plate_material], design)
    disk = _material(design.materials[design.disk.material], design)
    laws = []
    for flats in ((disk, plate), (plate, plate)):
        radius = np.full(output.rollers // 2, output.roller_radius_mm)
        first, second = (LineContact(radius, output.roller_length_mm, roller, flat) for flat in flats)
        laws.append(law.between_flats((first, second), output.roller_radius_mm, output.flat_depth_mm))
    return concatenated(laws)


def disk_contacts(at: Reducer) -> np.ndarray:
    """Numbers of the contacts that load the disk: the pins, then the rollers of its own slide or its output pins."""
    return np.flatnonzero((at.contacts.body_a == "disk") | (at.contacts.body_b == "disk"))

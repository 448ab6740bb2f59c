"""A validated design and study as objects of the model: where millimetres of a file become bodies and contacts."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pipeline.arrays import Complex, Real
from pipeline.config.designs.design import Design, MaterialSection
from pipeline.config.designs.flank import flank_profile
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.mechanisms.mechanism import LawInputs
from pipeline.config.studies.study import LAW_FACTORS, Study
from pipeline.model.contact.laws import ContactLaws, LineContact, Material, concatenated_laws, curved_laws, scaled_laws
from pipeline.model.contact.line_laws.contact_law import ContactLaw, law_of
from pipeline.model.elastic.beam import ring_flexibility
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import Clocking, clocking, same_places
from pipeline.model.geometry.cycloid_profile import KEPT_ANGLES, CycloidProfile
from pipeline.model.geometry.out_of_round import ORDERS
from pipeline.model.geometry.reducer import Bearing, OutputContacts, Reducer, nominal_reducer
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.metrics import Definitions
from pipeline.model.units import MM_PER_UM, NMM_PER_NM

if TYPE_CHECKING:  # its statistics are slow to import, and workers import this module
    from pipeline.sampling.errors import Errors as SampledErrors


def profile(design: Design) -> CycloidProfile:
    """The flank of the design, with its modification."""
    return flank_profile(design.cycloid, design.flank)


def reducer(design: Design, crank_deg: float) -> Reducer:
    """Bodies and contacts of the design at one crank angle [degrees]."""
    return _reducer(profile(design), design.output, crank_deg, design.cycloid.fixed, design.disk.count)


@lru_cache(maxsize=KEPT_ANGLES)
def _reducer(flank: CycloidProfile, output: OutputContacts, crank_deg: float, fixed_side: str, disks: int) -> Reducer:
    """Kept: a fit makes hundreds of drives of one geometry."""
    return nominal_reducer(flank, output, np.radians(crank_deg), fixed_side, disks)


def bearing(design: Design) -> Bearing:
    """The input bearing of the design."""
    return Bearing(design.bearing.stiffness_N_per_mm_power, design.bearing.exponent)


def load_cycle(study: Study, levels: int) -> LoadCycle:
    """The load cycle of so many ``levels`` a branch, with the torques of the metrics among them."""
    rated_torque = NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    marks = tuple(percent / 100 for percent in (study.metrics.lost_motion_percent, *study.metrics.rigidity_percent))
    return LoadCycle.evenly(rated_torque, levels, study.cycle.torque_fraction, marks)


def definitions(study: Study) -> Definitions:
    """Torques [N m] at which the study reads a loop."""
    rated, metrics = study.design.cycloid.rated_torque_Nm, study.metrics
    percents = (metrics.lost_motion_percent, *metrics.rigidity_percent)
    return Definitions(*(percent / 100 * rated for percent in percents))


def errors(sampled: "SampledErrors") -> Errors:
    """Sampled errors [um] as the model takes them [mm]; a lobe's error is its disk's and its own."""
    lobe, pitch = sampled.lobe_profile, sampled.lobe_pitch
    if sampled.disk_profile.ndim == 2:
        lobe, pitch = (values.reshape(*sampled.disk_profile.shape, -1) for values in (lobe, pitch))
    direction = np.stack([np.cos(sampled.bore_runout_phase), np.sin(sampled.bore_runout_phase)], axis=-1)
    pins, holes = (_vector(sampled, name, 1) for name in ("output_pin_position", "hole_position"))
    waves = [_vector(sampled, f"pin_roundness_{order}", -order) for order in ORDERS]
    return Errors(
        pin_radial=MM_PER_UM * sampled.pin_radial,
        pin_tangential=MM_PER_UM * sampled.pin_tangential,
        pin_radius=MM_PER_UM * sampled.pin_radius,
        lobe=MM_PER_UM * (sampled.disk_profile[..., None] + lobe),
        eccentricity=MM_PER_UM * sampled.eccentricity,
        roller_diameter=MM_PER_UM * sampled.roller_diameter,
        eccentric_phase=MM_PER_UM * sampled.eccentric_phase,
        lobe_pitch=MM_PER_UM * pitch,
        bore_runout=MM_PER_UM * sampled.bore_runout_amplitude[..., None] * direction,
        hole_diameter=MM_PER_UM * _of_disks(sampled.hole_diameter, sampled),
        pin_off_hole=_pins_off_holes(pins, _of_disks(holes, sampled)),
        pin_roundness=np.stack(waves, axis=-1),
        displacement=np.hstack([_displacement(sampled, d) for d in dimension_library().values() if d.displaces]),
    )


def _displacement(sampled: "SampledErrors", dimension: Dimension) -> Complex:
    """Displacements (n, n_elements) [mm] of a dimension; of one without a direction along that of its element."""
    if dimension.direction:
        values = _vector(sampled, dimension.name, 1)
    else:
        values = (MM_PER_UM * getattr(sampled, dimension.field)).astype(complex)
    return values.reshape(len(sampled), math.prod(values.shape[1:]))


def _vector(sampled: "SampledErrors", name: str, turns: int) -> Complex:
    """Amplitude and so many times the direction of a dimension as a complex number (n, n_elements) [mm]."""
    amplitude, direction = getattr(sampled, f"{name}_amplitude"), getattr(sampled, f"{name}_phase")
    vector: Complex = MM_PER_UM * amplitude * np.exp(1j * turns * direction)
    return vector


def _of_disks(values: np.ndarray, sampled: "SampledErrors") -> np.ndarray:
    """Values of holes (n, n_disks n_holes) as (n, n_disks, n_holes), of one disk (n, n_holes)."""
    return values.reshape(*sampled.disk_profile.shape, -1) if sampled.disk_profile.ndim == 2 else values


def _pins_off_holes(pins: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """Way of each output pin against its hole, in the shape of the holes'; none of holes in which no pins are."""
    return (pins[:, None] if holes.ndim > pins.ndim else pins) - holes if holes.shape[-1] == pins.shape[-1] else -holes


def bearing_clearance(design: Design, deviation_um: Real) -> Real:
    """Radial clearance (n,) or (n, n_disks) [mm] of the input bearings: the design's and each sample's."""
    return MM_PER_UM * (design.bearing.clearance_um + deviation_um)


def modulus(design: Design, sampled: "SampledErrors") -> Real | None:
    """Factor (n,) of the modulus of all elastic parts in each unit; None where no temperature is drawn."""
    if design.thermal is None:
        return None
    return design.thermal.modulus({part: getattr(sampled, f"{part}_growth") for part in design.thermal.drawn_parts})


def _material(section: MaterialSection, design: Design) -> Material:
    return Material(section.youngs_modulus_MPa, section.poisson_ratio, design.disk.stress)


def contact_law(study: Study) -> ContactLaw:
    """The law that the study names; of a rigid disk, whose mesh holds nothing, that on solid bodies."""
    law = law_of(study.springs.law, study.springs.stiffness_N_per_mm)
    if study.reduce.disk == "elastic":
        return law
    return replace(law, on_mesh=lambda contact, radius, patch_half_width: law.on_solid(contact, radius))


def contact_laws(study: Study, reducer: Reducer) -> ContactLaws:
    """Laws of every contact of the reducer, pins first, with the study's factors.

    Raises
    ------
    ValueError
        As ``pin_laws``.
    """
    laws = concatenated_laws([pin_laws(study, reducer), output_laws(study)])
    return with_factors(laws, study.design, reducer, law_factors(study), usual_forces(study.design))


def pin_laws(study: Study, reducer: Reducer) -> ContactLaws:
    """Laws of the contacts of the pins, without factors.

    Raises
    ------
    ValueError
        If the law leaves nothing to a contact (Palmgren on a patch that holds more than its whole approach).
    """
    inputs, radius = _law_inputs(study), study.design.cycloid.pin_radius_mm
    pin = inputs.materials[study.design.pins.material]
    on_flank = LineContact(1 / (1 / radius + reducer.pins.flank_curvature), inputs.thickness, pin, inputs.disk)
    return inputs.law.on_mesh(on_flank, radius, study.reduce.patch_half_width_mm)


def output_laws(study: Study) -> ContactLaws:
    """Laws of the output's contacts with every disk, then of those behind the disks, without factors.

    They are alike at all crank angles.
    """
    output = study.design.output
    return concatenated_laws([*[output.laws(_law_inputs(study))] * study.design.disk.count, output.laws_behind()])


def law_factors(study: Study) -> tuple[float, ...]:
    """The study's factors of the laws (n_law_factors,), in the order of ``LAW_FACTORS``."""
    return tuple(getattr(study.springs, factor.key) for factor in LAW_FACTORS)


def with_factors(
    laws: ContactLaws, design: Design, reducer: Reducer, factors: Sequence[float], forces: Real
) -> ContactLaws:
    """Laws of every contact of a reducer with factors in the order of ``LAW_FACTORS``, at its ``usual_forces``.

    The deflection of a pin whose relative radius of curvature with the flank is R', of its own radius r, is multiplied
    by the factor of half a radius to the power log2(r/R'): 1 on a flat flank, the factor where R' = r/2.
    """
    of_pins, of_output, curvature, of_half_radius = factors
    n_pins = reducer.n_pins
    deflection = np.where(np.arange(len(laws)) < n_pins, of_pins, of_output)
    radius_ratio = 1 + design.cycloid.pin_radius_mm * reducer.pins.flank_curvature
    deflection[:n_pins] *= of_half_radius ** np.log2(radius_ratio)
    return scaled_laws(curved_laws(laws, curvature, forces), deflection)


def usual_forces(design: Design) -> Real:
    """Force of each contact (n_contacts,) [N] at which laws of another curvature are alike, at all crank angles.

    It is the mean force of the contacts that carry, of the pins or of the output, at half of the rated torque, if they
    are every second one: the rated torque over the sum of the arms.
    """
    geometry = reducer(design, 0.0)
    contacts, n_pins = geometry.contacts, geometry.n_pins
    arms = np.abs(np.append(contacts.arm[:n_pins], geometry.contact_jacobian[n_pins:, geometry.output_motion]))
    total = np.repeat([np.sum(arms[:n_pins]), np.sum(arms[n_pins:])], [n_pins, len(arms) - n_pins])
    forces: Real = NMM_PER_NM * design.cycloid.rated_torque_Nm / total
    return forces


def _law_inputs(study: Study) -> LawInputs:
    design = study.design
    return LawInputs(
        law=contact_law(study),
        materials={name: _material(section, design) for name, section in design.materials.items()},
        disk=_material(design.materials[design.disk.material], design),
        thickness=design.disk.thickness_mm,
        eccentricity=design.cycloid.eccentricity_mm,
        bearing=bearing(design),
        patch_half_width=study.reduce.roller_patch_half_width_mm,
    )


def compliance_beside_disks(design: Design, reducer: Reducer) -> Real:
    """What output, input shaft and housing give way between all contacts (n_contacts, n_contacts) [mm/N].

    Notes
    -----
    A disk's forces are those of its input bearing, by its balance: they bend the shaft, and the disk goes along with it
    as a whole. So its contacts yield by the flexibility between the disks' planes, along their normals.
    """
    pins, rows = reducer.n_pins, slice(reducer.n_pins, None)
    materials = {name: _material(section, design) for name, section in design.materials.items()}
    full = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    of_output = design.output.compliance(reducer.contacts.some(rows), reducer.disk_of_contact[rows], materials)
    if of_output is not None:
        full[rows, rows] = of_output
    if design.input_shaft:
        flexibility = design.input_shaft.flexibility(reducer.n_disks, materials)
        full += reducer.planar @ np.kron(flexibility, np.eye(2)) @ reducer.planar.T
    if design.housing.ring:
        ring = design.housing.ring
        radii = design.cycloid.pin_circle_radius_mm, 0.5 * design.housing.outer_diameter_mm
        modulus = materials[ring.material].youngs_modulus
        full[:pins, :pins] += ring_flexibility(reducer.pins.centre, reducer.pins.normal, radii, ring.width_mm, modulus)
    return full


def disk_contacts(reducer: Reducer, disk: int = 0) -> np.ndarray:
    """Numbers of the contacts that load a disk: the pins, then the rollers of its own slide or its output pins."""
    return np.flatnonzero(reducer.disk_of_contact == disk)


def joined_blocks(reducer: Reducer, blocks: Iterable[Real]) -> Real:
    """Compliance (n_contacts, n_contacts) [mm/N] between all contacts from that of each disk between its own."""
    full = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    for disk, block in enumerate(blocks):
        rows = disk_contacts(reducer, disk)
        full[np.ix_(rows, rows)] = block
    return full


def first_part(design: Design, crank_deg: float, disk: int) -> tuple[float, np.ndarray] | None:
    """Crank angle [degrees] at which the first disk is what a disk is at ``crank_deg``, and its contacts' places there.

    None where no turn makes them one: they are no part, or the rollers in their holes stand otherwise.
    """
    lobes = clockings(design)[disk].lobes
    if lobes is None:
        return None
    turned_on = crank_deg + 360.0 * (disk / design.disk.count + lobes)
    points = []
    for angle, number in ((crank_deg, disk), (turned_on, 0)):
        geometry = reducer(design, angle)
        points.append(geometry.contacts.point[disk_contacts(geometry, number)] - geometry.disks[number].eccentric)
    places = same_places(*points)
    return None if places is None else (turned_on, places)


def clockings(design: Design) -> tuple[Clocking, ...]:
    """How the lobes of each disk stand against its holes."""
    holes = design.output.holes(design.cycloid)
    centres = holes.centres if holes else np.zeros(0, complex)
    count = design.disk.count
    return tuple(clocking(centres, design.cycloid.lobes, disk, count) for disk in range(count))

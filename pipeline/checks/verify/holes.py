"""Check of a disk with holes: its compliance from hole to rim against CalculiX on a mesh, with loads, of its own."""

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import elastic
from pipeline.arrays import Complex, Real
from pipeline.checks.calculix.pressed_disk import Press, PressedDisk
from pipeline.checks.calculix.program import INSTALL, PROGRAM, calculix_program
from pipeline.checks.calculix.quadtree_mesh import Curve, curved_mesh
from pipeline.checks.specimen import (
    Finding,
    Specimen,
    largest_difference,
    loaded_equilibria,
    relative,
    reported_number,
    skipped_check,
)
from pipeline.checks.verify.flank import li_guan_flank
from pipeline.config import load_study
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.settings import PROJECT

STUDY = "pin_in_hole"
CRANK_DEG = 25.0
"""Off the symmetries of pins and holes."""
FINENESS = 0.5
"""Of CalculiX' mesh: an edge under a patch over half of the patch's half width; all others in proportion."""
COARSER = 2 * FINENESS
"""Of its other mesh, by which its own convergence is seen."""
GROWTH = 0.35
"""Of its edges per unit of distance from the patches and boundaries."""
EDGES = {"flank": 1 / 2, "hole": 1 / 3, "bore": 1 / 8}
"""Largest edge on a boundary, in radii of a pin, of a hole and of the bore, at a fineness of 1."""
LIMITS = {"own": 0.02, "elsewhere": 2e-3, "work": 5e-3}
"""Of the study's mesh and of CalculiX' coarser one: a patch's own deflection over 2/(pi E' t), as the mesh independence
of a disk without holes has it; deflections elsewhere over the largest of them; the work of the forces, relative."""
REFINED_LIMITS = {"own": 0.01, "elsewhere": 1e-3, "work": 1e-3}
"""Of the model's mesh refined once."""
FAR_PINS = 17
"""Pins from the most loaded one to the second that is pressed; the second hole lies opposite."""


@dataclass(frozen=True)
class Pressing:
    """Loads of a specimen's disk: one contact after the other alone, and all as at the rated torque.

    Attributes
    ----------
    forces : (n_loads, n_patches) [N], the last ones those of the equilibrium.
    loaded_patches : patch of each unit load (n_loads - 1,).
    is_pin : whether a patch lies on the flank (n_patches,).
    unit : 2/(pi E' t) [mm/N].
    """

    forces: Real
    loaded_patches: np.ndarray
    is_pin: np.ndarray
    unit: float

    @classmethod
    def from_specimen(cls, specimen: Specimen) -> "Pressing":
        """The most loaded pin and hole, another of each, and the forces at the rated torque."""
        rows = specimen.disk_rows
        force = loaded_equilibria(specimen, np.array([specimen.rated_torque])).force[0, 0, rows]
        is_pin = specimen.reducer.contacts.kind[rows] == PIN
        pins, holes = np.flatnonzero(is_pin), np.flatnonzero(~is_pin)
        pin, hole = np.argmax(force[pins]), np.argmax(force[holes])
        loaded_patches = np.concatenate(
            [pins[[pin, (pin + FAR_PINS) % len(pins)]], holes[[hole, (hole + len(holes) // 2) % len(holes)]]]
        )
        disk = specimen.disk
        unit = 2 * (1 - disk.poisson_ratio**2) / (np.pi * disk.youngs_modulus * disk.thickness)
        return cls(np.vstack([np.eye(len(rows))[loaded_patches], force]), loaded_patches, is_pin, unit)


def pressed_disk(specimen: Specimen, fineness: float) -> PressedDisk:
    """The specimen's disk for CalculiX: flank by Li, He and Guan, round holes and bore, the contacts as presses."""
    design, reduce, profile = specimen.study.design, specimen.study.reduce, specimen.profile
    pose, contacts = specimen.reducer.disks[0], specimen.reducer.contacts.some(specimen.disk_rows)
    turn = np.exp(-1j * disk_rotation(profile, pose.crank))
    point, normal = (contacts.point - pose.eccentric) * turn, contacts.normal * turn
    holes = design.output.holes(design.cycloid)
    assert holes is not None
    bore = design.disk.bore_radius_mm
    curves = (
        Curve(
            lambda share: li_guan_flank(profile, 2 * np.pi * profile.lobes * share),
            fineness * EDGES["flank"] * profile.pin_radius,
        ),
        *(
            Curve(partial(_circle, centre, holes.radius), fineness * EDGES["hole"] * holes.radius)
            for centre in holes.centres
        ),
        Curve(partial(_circle, 0j, bore), fineness * EDGES["bore"] * bore, has_even_corners=True),
    )
    presses = tuple(
        Press(0, complex(hole_point), complex(hole_normal), reduce.patch_half_width_mm)
        if hole < 0
        else Press(1 + int(hole), complex(hole_point), complex(-hole_normal), reduce.roller_patch_half_width_mm)
        for hole, hole_point, hole_normal in zip(contacts.hole, point, normal, strict=True)
    )
    edge = 0.5 * fineness * min(reduce.patch_half_width_mm, reduce.roller_patch_half_width_mm)
    mesh = curved_mesh(curves[0], curves[1:], point, edge, GROWTH)
    material = design.materials[design.disk.material]
    return PressedDisk(
        mesh, curves, material.youngs_modulus_MPa, material.poisson_ratio, design.disk.thickness_mm, presses
    )


def _circle(centre: complex, radius: float, share: Real) -> Complex:
    circle: Complex = centre + radius * np.exp(2j * np.pi * share)
    return circle


def check_holes(specimen: Specimen) -> Iterator[Finding]:
    """Disk with ten holes whole in CalculiX, on a mesh of its own: deflections by one force and at the rated torque."""
    if calculix_program() is None:
        yield skipped_check(f"needs CalculiX: no program {PROGRAM}; {INSTALL}")
        return
    specimen_in_strain = Specimen(load_study(STUDY, PROJECT), specimen.sample, CRANK_DEG).in_stress("plane_strain")
    pressing = Pressing.from_specimen(specimen_in_strain)
    disk = pressed_disk(specimen_in_strain, FINENESS)
    answer = calculix_deflections(disk, pressing.forces)
    yield reported_number("nodes of CalculiX' mesh", len(disk.mesh.nodes))
    yield reported_number("nodes of the study's mesh", len(specimen_in_strain.disk.nodes))
    computed_answer = pressing.forces @ specimen_in_strain.disk_compliance.matrix
    yield from agreement("study's mesh", pressing, answer, computed_answer, LIMITS)
    refined_answer = pressing.forces @ _refined_compliance(specimen_in_strain)
    yield from agreement("mesh refined once", pressing, answer, refined_answer, REFINED_LIMITS)
    coarser = calculix_deflections(pressed_disk(specimen_in_strain, COARSER), pressing.forces)
    yield from agreement("CalculiX, edges twice as long", pressing, answer, coarser, LIMITS)


def _refined_compliance(specimen: Specimen) -> Real:
    """Compliance between the patches (n_patches, n_patches) [mm/N] on half as long edges."""
    reduce = specimen.study.reduce
    study = specimen.study.with_section(
        "reduce",
        flank_edges_per_lobe=2 * reduce.flank_edges_per_lobe,
        growth=0.7 * reduce.growth,
        largest_edge_mm=0.5 * reduce.largest_edge_mm,
    )
    body = elastic.elastic_disk(study, hole_edges=2 * elastic.EDGES_PER_HALF_WIDTH)
    return body.compliance(elastic.disk_patches(study, body, specimen.reducer)).matrix


def calculix_deflections(disk: PressedDisk, forces: Real) -> Real:
    """Mean deflections of the patches (n_loads, n_patches) [mm] by CalculiX."""
    with tempfile.TemporaryDirectory() as folder:
        return disk.along(disk.solve(forces, Path(folder)))


def agreement(
    name: str, pressing: Pressing, answer: Real, computed_answer: Real, limits: Mapping[str, float]
) -> Iterator[Finding]:
    """Own deflections, those elsewhere by the kind of the pressed and of the deflected patch, and the work."""
    loaded_patches, unit = pressing.loaded_patches, pressing.unit
    loads = np.arange(len(loaded_patches))
    reference, computed_compliance = answer[loads, loaded_patches] / unit, computed_answer[loads, loaded_patches] / unit
    yield largest_difference(
        f"deflection of a pressed patch over 2/(pi E' t), {name}", reference, computed_compliance, limits["own"]
    )
    elsewhere = np.arange(answer.shape[1]) != loaded_patches[:, None]
    for source, from_pin in (("pin", True), ("hole", False)):
        for target, to_pin in (("lobes", True), ("holes", False)):
            is_compared = (
                elsewhere & (pressing.is_pin[loaded_patches] == from_pin)[:, None] & (pressing.is_pin == to_pin)
            )
            reference, computed_compliance = answer[:-1][is_compared], computed_answer[:-1][is_compared]
            quantity = f"deflection of the {target} by 1 N on a {source} over the largest, {name} [mm]"
            yield largest_difference(
                quantity, reference, computed_compliance, limits["elsewhere"], np.abs(reference).max()
            )
    work = answer[-1] @ pressing.forces[-1], computed_answer[-1] @ pressing.forces[-1]
    yield relative(f"work of the forces at the rated torque, {name} [N mm]", *work, limits["work"])

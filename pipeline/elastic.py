"""The disk of a design as an elastic body with the patches of its contacts; slow to import, so apart from assembly."""

from itertools import groupby

import numpy as np

from pipeline.assembly import disk_contacts, profile
from pipeline.config.studies.study import Study
from pipeline.model.elastic.condensed_body import ElasticBody, elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.perforated_mesh import hole_boundary, perforated_mesh
from pipeline.model.elastic.pressure_patches import Patches, boundary_patches, joined_patches, line_patches
from pipeline.model.geometry.contacts import OUTPUT, PIN
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import Reducer

EDGES_PER_HALF_WIDTH = 2
"""Edges of a hole's wall under half of a patch."""


def elastic_disk(study: Study, rotation: float = 0.0, hole_edges: int = EDGES_PER_HALF_WIDTH) -> ElasticBody:
    """The meshed lobed disk with its holes, if any, held by the mean motion of its bore.

    Parameters
    ----------
    rotation : rotation of the holes [rad] from those of the first disk (``clocking``).
    hole_edges : edges of a hole's wall under half of a patch.

    Notes
    -----
    Holes leave no symmetry but that of the common divisors of lobes and holes, of which no use is made.
    """
    design, reduce = study.design, study.reduce
    flank = flank_nodes(profile(design), reduce.flank_edges_per_lobe)
    mesh = lobed_disk_mesh(
        flank, design.cycloid.lobes, design.disk.bore_radius_mm, reduce.growth, reduce.largest_edge_mm
    )
    holes, sectors = design.output.holes(design.cycloid), design.cycloid.lobes
    if holes:
        sectors = 1
        edge = reduce.roller_patch_half_width_mm / hole_edges
        mesh = perforated_mesh(mesh, holes.centres * np.exp(1j * rotation), holes.radius, edge, reduce.growth)
    material = design.materials[design.disk.material]
    return elastic_body(
        mesh,
        material.youngs_modulus_MPa,
        material.poisson_ratio,
        design.disk.thickness_mm,
        design.disk.stress,
        "bore",
        sectors,
    )


def disk_patches(study: Study, disk: ElasticBody, reducer: Reducer, number: int = 0) -> Patches:
    """Patches of ``disk_contacts`` on a disk, in the frame of its lobes, directed as the contacts push it.

    Notes
    -----
    The pins press on the true flank, output pins on the walls of their holes, wherever the crank has turned the
    contact. A tongue stands out of the plane of the slice; its rollers' forces enter the slice along the tongue's
    faces, spread over the patch of a roller.
    """
    contacts, reduce, pose = reducer.contacts.some(disk_contacts(reducer, number)), study.reduce, reducer.disks[number]
    turn = np.exp(-1j * disk_rotation(profile(study.design), pose.crank))
    point, normal = (contacts.point - pose.eccentric) * turn, contacts.normal * turn
    pins = contacts.kind == PIN
    on_flank = boundary_patches(disk.mesh, "flank", point[pins], normal[pins], reduce.patch_half_width_mm)
    output = np.flatnonzero(contacts.kind == OUTPUT)
    width = reduce.roller_patch_half_width_mm
    parts = [on_flank]
    for in_holes, run in groupby(output, key=lambda contact: contacts.hole[contact] >= 0):
        rows = np.array(list(run))
        if in_holes:
            for k, wall in zip(rows, map(hole_boundary, contacts.hole[rows]), strict=True):
                parts.append(boundary_patches(disk.mesh, wall, point[k], -normal[k], width))
        else:
            parts.append(line_patches(disk.mesh, point[rows], 1j * normal[rows], -normal[rows], width))
    return joined_patches(*parts)

"""The disk of a design as an elastic body with the patches of its contacts; slow to import, so apart from assembly."""

import numpy as np

from pipeline.assembly import profile
from pipeline.config.study import Study
from pipeline.model.bodies import ElasticBody, elastic_body
from pipeline.model.meshing import flank_nodes, lobed_disk_mesh
from pipeline.model.patches import Patches, boundary_patches, joined, line_patches
from pipeline.model.profile import disk_rotation
from pipeline.model.reducer import OUTPUT, PIN, Reducer


def elastic_disk(study: Study) -> ElasticBody:
    """The lobed disk, meshed, assembled and factorised, held by the mean motion of its bore."""
    design, reduce = study.design, study.reduce
    flank = flank_nodes(profile(design), reduce.flank_edges_per_lobe)
    mesh = lobed_disk_mesh(
        flank, design.cycloid.lobes, design.disk.bore_radius_mm, reduce.growth, reduce.largest_edge_mm
    )
    material = design.materials[design.disk.material]
    return elastic_body(
        mesh,
        material.youngs_modulus_MPa,
        material.poisson_ratio,
        design.disk.thickness_mm,
        design.disk.stress,
        "bore",
    )


def disk_patches(study: Study, disk: ElasticBody, at: Reducer) -> Patches:
    """Patches of ``disk_contacts`` on the disk, in the disk's frame, directed as the contacts push it.

    Notes
    -----
    The pins press on the true flank. The disk's tongue stands out of the plane of the slice; its rollers' forces enter
    the slice along the tongue's faces, spread over the patch of a roller.
    """
    contacts, reduce = at.contacts, study.reduce
    lobed = profile(study.design)
    turn = np.exp(-1j * disk_rotation(lobed, at.crank))
    centre = lobed.eccentricity * np.exp(1j * at.crank)
    point, normal = (contacts.point - centre) * turn, contacts.normal * turn
    pins = contacts.kind == PIN
    rollers = (contacts.kind == OUTPUT) & (contacts.body_a == "disk")
    return joined(
        boundary_patches(disk.mesh, "flank", point[pins], normal[pins], reduce.patch_half_width_mm),
        line_patches(
            disk.mesh,
            point[rollers],
            1j * normal[rollers],
            -normal[rollers],
            reduce.roller_patch_half_width_mm,
        ),
    )

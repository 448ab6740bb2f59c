"""Check of contact on a mesh: a meshed cylinder pressed between two flats, against Johnson's compression."""

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, relative, reported_number
from pipeline.model.contact.laws import LineContact, Material, meshed_share
from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches

RADIUS = 5.0
"""Of the cylinder [mm]."""
LOADS = np.array([10.0, 100.0, 1000.0])
"""[N/mm]"""
WIDTHS = (0.02, 0.05, 0.1)
"""Half widths of the patch over the radius."""
EDGES = (2, 4, 8)
"""Edges of the meshes under half a patch."""
SYMMETRY = 8
"""Equal sectors of its mesh."""
STEEL = Material(206e3, 0.3, "plane_strain")


def _mesh_compliance(width: float, edges: int) -> tuple[float, int]:
    """Mean approach of two opposed patches per force [mm/N] of a slice of 1 mm, and the triangles of its mesh."""
    n_edges = SYMMETRY * int(np.ceil(2 * np.pi * edges / (width * SYMMETRY)))
    circle = RADIUS * np.exp(2j * np.pi * np.arange(n_edges) / n_edges)
    mesh = lobed_disk_mesh(circle, SYMMETRY, 0.0, growth=0.25, largest_edge=RADIUS / 10)
    body = elastic_body(mesh, STEEL.youngs_modulus, STEEL.poisson_ratio, 1.0, "plane_strain", "flank")
    normal = np.exp(0.3j) * np.array([-1, 1])  # between the mesh's own axes of symmetry
    patches = boundary_patches(mesh, "flank", -RADIUS * normal, normal, width * RADIUS)
    return float(body.compliance(patches).matrix.sum()), mesh.nelements


def johnson_compression(load: Real) -> Real:
    """Shortening [mm] of the diameter by the line load (n,) [N/mm]: (2p/(pi E')) [2 ln(4R/b) - 1] (Johnson 5.57)."""
    b = np.sqrt(4 * load * RADIUS / (np.pi * STEEL.modulus / 2))
    return 2 * load / (np.pi * STEEL.modulus) * (2 * np.log(4 * RADIUS / b) - 1)


def check_cylinder_between_flats(specimen: Specimen) -> Iterator[Finding]:
    """Meshed cylinder between two flats: three loads, three patch widths, three meshes."""
    contact = LineContact(np.array([RADIUS]), 1.0, STEEL, STEEL)
    for width in WIDTHS:
        linear, logarithmic = meshed_share(contact, STEEL, width * RADIUS)
        local = LOADS * (linear - logarithmic * np.log(LOADS))
        mesh_values = [_mesh_compliance(width, edges) for edges in EDGES]
        computed_values = np.array([LOADS * value + 2 * local for value, _ in mesh_values])
        yield relative(
            f"compression, w/R = {width:g}, 3 loads, 3 meshes [mm]",
            np.broadcast_to(johnson_compression(LOADS), computed_values.shape),
            computed_values,
            2e-3,
        )
        coarse, fine = np.abs(np.diff([value for value, _ in mesh_values]))
        yield reported_number(
            f"observed order of the compression, w/R = {width:g}, edges under w 2, 4, 8", np.log2(coarse / fine)
        )

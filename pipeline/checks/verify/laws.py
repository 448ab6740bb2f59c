"""Check of the contact laws: energy, continuity, growth, and the scaling of the exponents.

Check of contact on a mesh: a meshed cylinder pressed between two flats, against Johnson's compression.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.arrays import Real
from pipeline.checks.specimen import Finding, Specimen, positive, relative, reported_number, vanishing
from pipeline.model.contact.laws import (
    ContactLaws,
    LineContact,
    Material,
    concatenated_laws,
    cylinder_share,
    meshed_share,
)
from pipeline.model.contact.line_laws.hertz import hertz_laws
from pipeline.model.contact.line_laws.palmgren import palmgren_laws
from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches

LIMIT = 1e-10
"""Largest error of an identity of a law: rounding, and the solution of its implicit equation."""
STEP = 1e-2
"""Share of the force in differences of eighth order: truncation near 1e-14, rounding 1e-13."""
STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Central first difference of eighth order, one side."""
STEEL = Material(206e3, 0.3, "plane_stress")
SCALE = 3.7
"""Factor of the similarity that laws must obey; any number will do."""
LINE = LineContact(np.array([0.4, 0.8, 48.0]), 1.0, STEEL, STEEL)


def _difference(function: Callable[..., Any], force: Real) -> Real:
    """Numerical derivative of eighth order by the logarithm of the force."""
    pairs = ((weight, force * (1 + k * STEP), force * (1 - k * STEP)) for k, weight in STENCIL.items())
    slope: Real = sum(weight * (function(upper) - function(lower)) for weight, upper, lower in pairs) / STEP
    return slope


def _energy_slope(laws: ContactLaws, force: Real) -> Real:
    """dE/d(deflection) [N], both followed along the force; E is the force's work, F delta less its complement."""

    def strain_energy(force: Real) -> Real:
        return force * laws.deflection(force) - laws.energy(force)

    return _difference(strain_energy, force) / _difference(laws.deflection, force)


def _grid(laws: ContactLaws) -> Real:
    """Forces (points, n) [N] on both sides of the limit, none within a stencil of it."""
    largest_force = np.where(np.isfinite(laws.force_limit), laws.force_limit, 1e4)
    return np.concatenate([np.geomspace(1e-4, 0.9, 40), np.geomspace(1.15, 20.0, 15)])[:, None] * largest_force


def _hertz(lengths: float, patch: float = 0.08) -> ContactLaws:
    """Pin on a meshed flank with every length scaled."""
    line = replace(LINE, radius=lengths * LINE.radius, length=lengths * LINE.length)
    shares = [cylinder_share(line, STEEL, 0.8 * lengths), meshed_share(line, STEEL, patch * lengths)]
    return hertz_laws(line, shares, 0.8 * lengths)


def _in_strain(line: LineContact) -> LineContact:
    in_strain = replace(STEEL, stress="plane_strain")
    return replace(line, first_material=in_strain, second_material=in_strain)


def _scaling() -> Iterator[Finding]:
    force = np.geomspace(0.1, 50, 20)[:, None]
    yield relative(
        "Hertz: lengths times s, force times s^2 give s times the deflection [mm]",
        SCALE * _hertz(1.0).deflection(force),
        _hertz(SCALE).deflection(SCALE**2 * force),
        LIMIT,
    )
    yield relative(
        "Hertz: half width grows with the root of the force [mm]",
        np.sqrt(SCALE) * LINE.half_width(force),
        LINE.half_width(SCALE * force),
        LIMIT,
    )
    yield relative(
        "Hertz: peak pressure is 2 p/(pi b), b in plane strain [MPa]",
        2 * force / (np.pi * LINE.length * _in_strain(LINE).half_width(force)),
        _hertz(1.0).peak_pressure(force),
        LIMIT,
    )
    slack, taut = (palmgren_laws(replace(LINE, length=length), 1, 0.0) for length in (1.0, SCALE))
    yield relative(
        "Palmgren: deflection with force^0.9 [mm]",
        SCALE**0.9 * slack.deflection(force),
        slack.deflection(SCALE * force),
        LIMIT,
    )
    yield relative(
        "Palmgren: deflection with length^-0.8 [mm]",
        SCALE**-0.8 * slack.deflection(force),
        taut.deflection(force),
        LIMIT,
    )


def _continuity(name: str, laws: ContactLaws) -> Iterator[Finding]:
    tiny = np.array([[1e-17], [1e-16]])
    at_micrometre = laws.force(np.full((1, len(laws)), 1e-3))
    yield vanishing(
        f"{name}: force 1e-17 and 1e-16 mm beyond the dead zone, over that at 1 um",
        laws.force(tiny) / at_micrometre,
        LIMIT,
    )
    yield vanishing(f"{name}: force in the dead zone [N]", laws.force(np.array([[-1.0], [-1e-9], [0.0]])), 0.0)
    limited_rows = np.flatnonzero(np.isfinite(laws.force_limit))
    bounded_laws, limit = laws[limited_rows], laws.force_limit[limited_rows]
    below_limit, above_limit = limit * (1 - 1e-13), limit * (1 + 1e-13)
    yield relative(
        f"{name}: deflection across the law's limit [mm]",
        bounded_laws.deflection(below_limit),
        bounded_laws.deflection(above_limit),
        LIMIT,
    )
    yield relative(
        f"{name}: slope across the law's limit [mm/N]",
        bounded_laws.compliance(below_limit),
        bounded_laws.compliance(above_limit),
        LIMIT,
    )


def check_contact_laws(specimen: Specimen) -> Iterator[Finding]:
    """Contact laws: force = dE/d(penetration), continuity, growth, exponents."""
    rigid = palmgren_laws(LINE, 2, 0.0)
    mesh_laws = palmgren_laws(LINE, 1, 2e-6)
    for name, laws in (("Hertz", specimen.laws), ("Palmgren", concatenated_laws([rigid, mesh_laws]))):
        force = _grid(laws)
        yield relative(f"{name}: force as derivative of the energy [N]", _energy_slope(laws, force), force, LIMIT)
        yield relative(f"{name}: force from the deflection [N]", force, laws.force(laws.deflection(force)), LIMIT)
        yield from _continuity(name, laws)
        rising = laws.force(np.linspace(0.0, 1.0, 4000)[:, None] * laws.deflection(force[-1]))
        yield positive(f"{name}: least growth of the force from point to point [N]", np.diff(rising, axis=0))
        forces = np.where(np.isfinite(laws.force_limit), laws.force_limit, 1e4) * np.geomspace(1e-9, 1e4, 400)[:, None]
        yield positive(f"{name}: least slope of the law [mm/N]", laws.compliance(forces))
    yield from _scaling()


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
CYLINDER_STEEL = Material(206e3, 0.3, "plane_strain")


def _mesh_compliance(width: float, edges: int) -> tuple[float, int]:
    """Mean approach of two opposed patches per force [mm/N] of a slice of 1 mm, and the triangles of its mesh."""
    n_edges = SYMMETRY * int(np.ceil(2 * np.pi * edges / (width * SYMMETRY)))
    circle = RADIUS * np.exp(2j * np.pi * np.arange(n_edges) / n_edges)
    mesh = lobed_disk_mesh(circle, SYMMETRY, 0.0, growth=0.25, largest_edge=RADIUS / 10)
    body = elastic_body(mesh, CYLINDER_STEEL.youngs_modulus, CYLINDER_STEEL.poisson_ratio, 1.0, "plane_strain", "flank")
    normal = np.exp(0.3j) * np.array([-1, 1])  # between the mesh's own axes of symmetry
    patches = boundary_patches(mesh, "flank", -RADIUS * normal, normal, width * RADIUS)
    return float(body.compliance(patches).matrix.sum()), mesh.nelements


def johnson_compression(load: Real) -> Real:
    """Shortening [mm] of the diameter by the line load (n,) [N/mm]: (2p/(pi E')) [2 ln(4R/b) - 1] (Johnson 5.57)."""
    b = np.sqrt(4 * load * RADIUS / (np.pi * CYLINDER_STEEL.modulus / 2))
    logarithm: Real = np.log(4 * RADIUS / b)
    return 2 * load / (np.pi * CYLINDER_STEEL.modulus) * (2 * logarithm - 1)


def check_cylinder_between_flats(specimen: Specimen) -> Iterator[Finding]:
    """Meshed cylinder between two flats: three loads, three patch widths, three meshes."""
    contact = LineContact(np.array([RADIUS]), 1.0, CYLINDER_STEEL, CYLINDER_STEEL)
    for width in WIDTHS:
        linear, logarithmic = meshed_share(contact, CYLINDER_STEEL, width * RADIUS)
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

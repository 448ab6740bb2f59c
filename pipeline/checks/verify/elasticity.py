"""Check of the elastic bodies: patch test, manufactured solution with its order, Lame's thick ring.

Check of the disk's compliance: symmetry, patch loads, and independence of mesh and patch width at every pin.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from skfem import Basis, ElementTriP2, ElementVector, FacetBasis, Functional, LinearForm, MeshTri

from pipeline import elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import Finding, Specimen, at_least, largest_difference, vanishing
from pipeline.config import Study
from pipeline.model.contact.laws import Material
from pipeline.model.elastic.condensed_body import ElasticBody, Stress, elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches
from pipeline.model.geometry.cycloid_profile import CycloidProfile

YOUNG, POISSON = 206e3, 0.3
"""Young's modulus [MPa] and Poisson's ratio of steel."""
SMALL = CycloidProfile(pins=12, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.55)
BORE = 2.5
"""Radius of the bore [mm]."""
WAVE = 0.25
"""Wave number of the manufactured displacement [rad/mm]."""
INNER, OUTER, PRESSURE = 1.0, 2.0, 100.0
"""Lame's ring [mm], [MPa]."""
SLOPE_TOLERANCE = 0.1
"""Of an observed order of convergence: meshes are not yet in the limit."""
STRESSES: tuple[Stress, Stress] = ("plane_stress", "plane_strain")


def lame_constants(stress: Stress) -> tuple[float, float]:
    """Lame's constants (lambda, mu) [MPa] of the two-dimensional body."""
    shear = YOUNG / 2 / (1 + POISSON)
    if stress == "plane_stress":
        return YOUNG * POISSON / (1 - POISSON**2), shear
    return YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON), shear


def _small_disk(edges: int, growth: float, largest_edge: float) -> MeshTri:
    return lobed_disk_mesh(flank_nodes(SMALL, edges), SMALL.lobes, BORE, growth, largest_edge)


def _nodal(body: ElasticBody, exact: Callable[[Real, Real], Real]) -> Real:
    """Freedoms (n_freedoms,) of the displacement field ``exact(x, y)``."""
    freedoms = np.zeros(body.freedoms.size)
    freedoms[body.freedoms] = np.transpose(exact(body.nodes.real, body.nodes.imag))
    return freedoms


def patch_test_error(stress: Stress) -> float:
    """Largest error of a linear displacement under its own tractions, relative to the displacement."""
    mesh = _small_disk(24, 0.35, 0.8)
    gradient = np.array([[1.0, 0.4], [0.4, -2.0]]) * 1e-3
    lame, shear = lame_constants(stress)
    sigma = lame * np.trace(gradient) * np.eye(2) + 2 * shear * gradient
    body = elastic_body(mesh, YOUNG, POISSON, 1.7, stress, "bore")
    traction = LinearForm(lambda v, w: sum(sigma[i, j] * w.n[j] * v[i] for i in range(2) for j in range(2)))
    loads = body.thickness * traction.assemble(FacetBasis(mesh, ElementVector(ElementTriP2())))
    exact = _nodal(body, lambda x, y: gradient @ np.array([x, y]))
    exact = exact - body.rigid_motions @ (body.reference.T @ exact)
    return float(np.abs(body.displacement(loads[:, None])[:, 0] - exact).max() / np.abs(exact).max())


def exact_displacement(x: Real, y: Real) -> Real:
    """Displacement u = (sin kx cos ky, cos 2kx sin ky)."""
    x, y = WAVE * x, WAVE * y
    return np.array([np.sin(x) * np.cos(y), np.cos(2 * x) * np.sin(y)])


def _stress_of_manufactured(stress: Stress, x: Real, y: Real) -> Real:
    lame, shear = lame_constants(stress)
    x, y = WAVE * x, WAVE * y
    gradient = WAVE * np.array(
        [[np.cos(x) * np.cos(y), -np.sin(x) * np.sin(y)], [-2 * np.sin(2 * x) * np.sin(y), np.cos(2 * x) * np.cos(y)]]
    )
    volume = lame * (gradient[0, 0] + gradient[1, 1])
    shearing = shear * (gradient[0, 1] + gradient[1, 0])
    return np.array([[volume + 2 * shear * gradient[0, 0], shearing], [shearing, volume + 2 * shear * gradient[1, 1]]])


def _force_of_manufactured(stress: Stress, x: Real, y: Real) -> Real:
    """Body force -div(sigma)."""
    lame, shear = lame_constants(stress)
    x, y = WAVE * x, WAVE * y
    xx = np.array([-np.sin(x) * np.cos(y), -4 * np.cos(2 * x) * np.sin(y)])
    yy = np.array([-np.sin(x) * np.cos(y), -np.cos(2 * x) * np.sin(y)])
    xy = np.array([-np.cos(x) * np.sin(y), -2 * np.sin(2 * x) * np.cos(y)])
    along_x = (lame + 2 * shear) * xx[0] + lame * xy[1] + shear * (yy[0] + xy[1])
    along_y = (lame + 2 * shear) * yy[1] + lame * xy[0] + shear * (xx[1] + xy[0])
    return -(WAVE**2) * np.array([along_x, along_y])


def manufactured_error(mesh: MeshTri, stress: Stress) -> float:
    """Error in L2 of the manufactured displacement under its own body force and tractions."""
    body = elastic_body(mesh, YOUNG, POISSON, 1.0, stress, "bore")
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=8)
    boundary = FacetBasis(mesh, ElementVector(ElementTriP2()), intorder=8)

    def force(v: Any, w: Any) -> Any:
        return sum(f * v[i] for i, f in enumerate(_force_of_manufactured(stress, *w.x)))

    def traction(v: Any, w: Any) -> Any:
        sigma = _stress_of_manufactured(stress, *w.x)
        return sum(sigma[i, j] * w.n[j] * v[i] for i in range(2) for j in range(2))

    loads = LinearForm(force).assemble(basis) + LinearForm(traction).assemble(boundary)
    displacement = body.displacement(loads[:, None])[:, 0]
    displacement = displacement + body.rigid_motions @ (body.reference.T @ _nodal(body, exact_displacement))
    squared_error = Functional(lambda w: ((w["u"] - exact_displacement(*w.x)) ** 2).sum(axis=0)).assemble(
        basis, u=displacement
    )
    return float(np.sqrt(squared_error))


def _ring(n_around: int) -> MeshTri:
    """Structured ring with the boundaries bore and rim."""
    radius = np.geomspace(INNER, OUTER, n_around // 8 + 1)
    row, column = np.meshgrid(np.arange(len(radius) - 1), np.arange(n_around), indexing="ij")
    corner = [(row + i) * n_around + (column + j) % n_around for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes = (radius[:, None] * np.exp(2j * np.pi * np.arange(n_around) / n_around)).ravel()
    triangles = np.hstack([[corner[k].ravel() for k in (0, 1, 2)], [corner[k].ravel() for k in (0, 2, 3)]])
    middle = (INNER + OUTER) / 2
    return MeshTri(np.array([nodes.real, nodes.imag]), triangles).with_boundaries(
        {"bore": lambda x: np.hypot(*x) < middle, "rim": lambda x: np.hypot(*x) > middle}
    )


def lame_error(n_around: int, stress: Stress) -> float:
    """Largest relative error of the radial displacement of a thick ring under inner pressure."""
    mesh = _ring(n_around)
    body = elastic_body(mesh, YOUNG, POISSON, 1.0, stress, "bore")
    bore = FacetBasis(mesh, ElementVector(ElementTriP2()), facets=mesh.boundaries["bore"])
    loads = LinearForm(lambda v, w: -PRESSURE * (w.n[0] * v[0] + w.n[1] * v[1])).assemble(bore)
    displacement = body.displacement(loads[:, None])[:, 0][body.freedoms]
    radius = np.abs(body.nodes)
    radial = (displacement[:, 0] * body.nodes.real + displacement[:, 1] * body.nodes.imag) / radius
    strain = stress == "plane_strain"
    modulus, ratio = (YOUNG / (1 - POISSON**2), POISSON / (1 - POISSON)) if strain else (YOUNG, POISSON)
    spread = PRESSURE * INNER**2 / modulus / (OUTER**2 - INNER**2)
    return float(np.abs(radial / (spread * ((1 - ratio) * radius + (1 + ratio) * OUTER**2 / radius)) - 1).max())


def check_elastic_bodies(specimen: Specimen) -> Iterator[Finding]:
    """Elastic bodies: patch test, manufactured solution, Lame's ring."""
    coarse = _small_disk(12, 0.5, 1.5)
    for stress in STRESSES:
        name = stress.replace("_", " ")
        yield vanishing(f"patch test, {name}, relative", patch_test_error(stress), 1e-10)
        errors = [manufactured_error(mesh, stress) for mesh in (coarse, coarse.refined(), coarse.refined(2))]
        slopes = -np.diff(np.log2(errors))
        yield largest_difference(f"order in L2 of the manufactured solution, {name}", 3.0, slopes, SLOPE_TOLERANCE)
        errors = [lame_error(n, stress) for n in (48, 96, 192)]
        yield vanishing(f"Lame's thick ring, {name}, relative", errors[-1], 1e-3)
        yield largest_difference(
            f"order of Lame's ring (of its polygon), {name}", 2.0, -np.diff(np.log2(errors)), SLOPE_TOLERANCE
        )


FINER = np.sqrt(2)
"""Edges are shorter by this factor everywhere in each refinement: twice the triangles."""


def _refined_study(study: Study, factor: float) -> Study:
    reduce = study.reduce
    return study.with_section(
        "reduce",
        flank_edges_per_lobe=round(factor * reduce.flank_edges_per_lobe),
        growth=reduce.growth / factor,
        largest_edge_mm=reduce.largest_edge_mm / factor,
    )


def _pin_compliances(specimen: Specimen, factor: float, widths: list[float]) -> list[Real]:
    """Compliance between the pins on a refined mesh, for patches of every half width [mm]."""
    disk = elastic.elastic_disk(_refined_study(specimen.study, factor))
    pins = specimen.reducer.pins
    centre = specimen.profile.eccentricity * np.exp(1j * specimen.reducer.crank)
    turn = np.exp(1j * specimen.reducer.crank / specimen.profile.lobes)
    point, normal = (pins.point - centre) * turn, pins.normal * turn
    return [disk.compliance(boundary_patches(disk.mesh, "flank", point, normal, width)).matrix for width in widths]


def _patch_loads(specimen: Specimen) -> tuple[Real, Real]:
    """Resultant (n, 3) of the unit loads of every patch: as assembled, and as the contact's point and normal say."""
    patches = specimen.patches
    load_resultants = specimen.disk.loads(patches).T @ specimen.disk.rigid_motions
    jacobian = specimen.reducer.contact_jacobian[specimen.disk_rows]
    directions, arms = jacobian[:, :2].T, jacobian[:, 2]
    turn = np.exp(1j * specimen.reducer.crank / specimen.profile.lobes)
    force = -(directions[0] + 1j * directions[1]) * turn
    return load_resultants, np.stack([force.real, force.imag, -arms], axis=-1)


def check_disk_compliance(specimen: Specimen) -> Iterator[Finding]:
    """Disk compliance: symmetry, patch integrals, mesh and patch independence."""
    study, compliance = specimen.study, specimen.disk_compliance
    load_resultants, resultants = _patch_loads(specimen)
    yield largest_difference("force of every patch per unit force", resultants[:, :2], load_resultants[:, :2], 1e-3)
    largest_arm = np.abs(resultants[:, 2]).max()
    yield largest_difference(
        "moment of every patch, over the largest arm", resultants[:, 2], load_resultants[:, 2], 1e-3, largest_arm
    )
    yield vanishing("asymmetry before symmetrising, over the largest entry", compliance.asymmetry, 1e-10)
    yield at_least("least eigenvalue of the compliance [mm/N]", 0.0, np.linalg.eigvalsh(compliance.matrix))

    steel = study.design.materials[study.design.disk.material]
    material = Material(steel.youngs_modulus_MPa, steel.poisson_ratio, study.design.disk.stress)
    unit = 2 / (np.pi * material.modulus * study.design.disk.thickness_mm)
    n, width = specimen.reducer.n_pins, study.reduce.patch_half_width_mm
    off_diagonal = ~np.eye(n, dtype=bool)
    base = compliance.matrix[:n, :n]
    (refined_compliance,) = _pin_compliances(specimen, FINER, [width])
    twice_refined, halved_patch_compliance = _pin_compliances(specimen, FINER**2, [width, width / 2])
    for name, finer, narrowing in (
        ("mesh refined once", refined_compliance, 1.0),
        ("mesh refined twice", twice_refined, 1.0),
        ("mesh refined twice, patch halved", halved_patch_compliance, 2.0),
    ):
        yield largest_difference(
            f"C_ii + unit ln(w) at every pin, {name}, over unit = 2/(pi E' t)",
            np.diag(base) / unit,
            np.diag(finer) / unit - np.log(narrowing),
            0.02,
        )
        yield largest_difference(
            f"off-diagonals of the pins, {name}, over the largest",
            base[off_diagonal],
            finer[off_diagonal],
            5e-3,
            np.abs(base[off_diagonal]).max(),
        )

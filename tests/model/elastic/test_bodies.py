"""Elastic bodies against exact solutions, observed orders, and the mesh independence of the condensed contact."""

import numpy as np
import pytest
from skfem import Basis, ElementTriP2, ElementVector, FacetBasis, Functional, LinearForm, MeshTri

from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches, joined, line_patches
from pipeline.model.geometry.cycloid_profile import CycloidProfile

E, NU = 206e3, 0.3
SMALL = CycloidProfile(pins=12, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.55)


def lame(stress):
    if stress == "plane_stress":
        return E * NU / (1 - NU**2), E / 2 / (1 + NU)
    return E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)


def disk_mesh(edges=24, growth=0.35, largest=0.8, bore=2.5):
    return lobed_disk_mesh(flank_nodes(SMALL, edges), SMALL.lobes, bore, growth, largest)


def field(body, displacement):
    return displacement[body.freedoms[:, 0]] + 1j * displacement[body.freedoms[:, 1]]


def without_rigid_motion(body, vector):
    return vector - body.rigid_motions @ (body.reference.T @ vector)


@pytest.mark.parametrize("stress", ["plane_stress", "plane_strain"])
def test_patch_test_constant_stress_is_exact(stress):
    mesh = disk_mesh()
    thickness, gradient = 1.7, np.array([[1.0, 0.4], [0.4, -2.0]]) * 1e-3
    first_lame, shear = lame(stress)
    sigma = first_lame * np.trace(gradient) * np.eye(2) + 2 * shear * gradient
    body = elastic_body(mesh, E, NU, thickness, stress, "bore")
    boundary = FacetBasis(mesh, ElementVector(ElementTriP2()))
    traction = LinearForm(lambda v, w: sum(sigma[i, j] * w.n[j] * v[i] for i in range(2) for j in range(2))).assemble(
        boundary
    )
    displacement = body.displacement(thickness * traction[:, None])[:, 0]
    exact = np.zeros_like(displacement)
    for i in range(2):
        exact[body.freedoms[:, i]] = gradient[i, 0] * body.nodes.real + gradient[i, 1] * body.nodes.imag
    np.testing.assert_allclose(displacement, without_rigid_motion(body, exact), atol=1e-12 * np.abs(exact).max() * 1e2)


def manufactured_error(mesh, stress):
    """Error in L2 of u = (sin kx cos ky, cos 2kx sin ky) under its own body force and tractions."""
    k = 0.25
    first_lame, shear = lame(stress)
    body = elastic_body(mesh, E, NU, 1.0, stress, "bore")
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=8)
    boundary = FacetBasis(mesh, ElementVector(ElementTriP2()), intorder=8)

    def exact(x, y):
        return np.array([np.sin(k * x) * np.cos(k * y), np.cos(2 * k * x) * np.sin(k * y)])

    def force(v, w):
        x, y = k * w.x[0], k * w.x[1]
        xx = k**2 * np.array([-np.sin(x) * np.cos(y), -4 * np.cos(2 * x) * np.sin(y)])
        yy = k**2 * np.array([-np.sin(x) * np.cos(y), -np.cos(2 * x) * np.sin(y)])
        xy = k**2 * np.array([-np.cos(x) * np.sin(y), -2 * np.sin(2 * x) * np.cos(y)])
        along_x = (first_lame + 2 * shear) * xx[0] + first_lame * xy[1] + shear * (yy[0] + xy[1])
        along_y = (first_lame + 2 * shear) * yy[1] + first_lame * xy[0] + shear * (xx[1] + xy[0])
        return -(along_x * v[0] + along_y * v[1])

    def traction(v, w):
        x, y = k * w.x[0], k * w.x[1]
        ux, uy = k * np.cos(x) * np.cos(y), -k * np.sin(x) * np.sin(y)
        vx, vy = -2 * k * np.sin(2 * x) * np.sin(y), k * np.cos(2 * x) * np.cos(y)
        normal = first_lame * (ux + vy)
        return ((normal + 2 * shear * ux) * w.n[0] + shear * (uy + vx) * w.n[1]) * v[0] + (
            shear * (uy + vx) * w.n[0] + (normal + 2 * shear * vy) * w.n[1]
        ) * v[1]

    loads = LinearForm(force).assemble(basis) + LinearForm(traction).assemble(boundary)
    displacement = body.displacement(loads[:, None])[:, 0]
    nodal = np.zeros_like(displacement)
    nodal[body.freedoms] = exact(body.nodes.real, body.nodes.imag).T
    displacement = displacement + body.rigid_motions @ (body.reference.T @ nodal)
    squared = Functional(lambda w: ((w["u"] - exact(*w.x)) ** 2).sum(axis=0)).assemble(basis, u=displacement)
    return np.sqrt(squared)


@pytest.mark.parametrize("stress", ["plane_stress", "plane_strain"])
def test_manufactured_solution_converges_with_order_three(stress):
    coarse = disk_mesh(edges=12, growth=0.5, largest=1.5)
    errors = [manufactured_error(mesh, stress) for mesh in (coarse, coarse.refined(), coarse.refined(2))]
    slopes = -np.diff(np.log2(errors))
    print(f"observed orders {slopes}")
    np.testing.assert_allclose(slopes, 3, atol=0.1)


def ring_mesh(inner, outer, n_around):
    """Structured ring of ``n_around`` edges around, with the boundaries bore and rim."""
    radius = np.geomspace(inner, outer, n_around // 8 + 1)
    row, circumference = np.meshgrid(np.arange(len(radius) - 1), np.arange(n_around), indexing="ij")
    corner = [(row + i) * n_around + (circumference + j) % n_around for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes = (radius[:, None] * np.exp(2j * np.pi * np.arange(n_around) / n_around)).ravel()
    triangles = np.hstack([[corner[k].ravel() for k in (0, 1, 2)], [corner[k].ravel() for k in (0, 2, 3)]])
    middle = (inner + outer) / 2
    return MeshTri(np.array([nodes.real, nodes.imag]), triangles).with_boundaries(
        {"bore": lambda x: np.hypot(*x) < middle, "rim": lambda x: np.hypot(*x) > middle}
    )


def lame_ring_error(n_around, stress):
    inner, outer, pressure = 1.0, 2.0, 100.0
    mesh = ring_mesh(inner, outer, n_around)
    body = elastic_body(mesh, E, NU, 1.0, stress, "bore")
    bore = FacetBasis(mesh, ElementVector(ElementTriP2()), facets=mesh.boundaries["bore"])
    loads = LinearForm(lambda v, w: -pressure * (w.n[0] * v[0] + w.n[1] * v[1])).assemble(bore)
    radial = np.real(field(body, body.displacement(loads[:, None])[:, 0]) * np.conj(body.nodes)) / np.abs(body.nodes)
    modulus, ratio = (E, NU) if stress == "plane_stress" else (E / (1 - NU**2), NU / (1 - NU))
    radius = np.abs(body.nodes)
    exact = (
        pressure * inner**2 / modulus / (outer**2 - inner**2) * ((1 - ratio) * radius + (1 + ratio) * outer**2 / radius)
    )
    return np.abs(radial / exact - 1).max()


@pytest.mark.parametrize("stress", ["plane_stress", "plane_strain"])
def test_thick_ring_under_inner_pressure_tends_to_lame(stress):
    errors = [lame_ring_error(n, stress) for n in (48, 96, 192)]
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 2, atol=0.1)  # straight edges: the order of the polygon


@pytest.mark.parametrize("width_ratio", [0.02, 0.05, 0.1])
def test_meshed_cylinder_between_flats_meets_johnson(width_ratio):
    """Johnson, Contact Mechanics (1985), eq. 5.57: a cylinder shortens by (2p/(pi E')) [2 ln(4R/b) - 1]."""
    radius, n_edges = 5.0, 8 * int(np.ceil(2 * np.pi * 4 / width_ratio / 8))
    circle = radius * np.exp(2j * np.pi * np.arange(n_edges) / n_edges)
    mesh = lobed_disk_mesh(circle, 8, 0.0, growth=0.25, largest_edge=radius / 10)
    body = elastic_body(mesh, E, NU, 1.0, "plane_strain", "flank")
    normal = np.exp(0.3j) * np.array([-1, 1])
    width = width_ratio * radius
    meshed = body.compliance(boundary_patches(mesh, "flank", -radius * normal, normal, width)).matrix.sum()
    modulus = E / (1 - NU**2)
    for line_load in (10.0, 100.0, 1000.0):
        b = np.sqrt(4 * line_load * radius / (np.pi * modulus / 2))
        local = 2 * line_load / (np.pi * modulus) * (np.log(width / b) + 0.25)
        exact = 2 * line_load / (np.pi * modulus) * (2 * np.log(4 * radius / b) - 1)
        assert line_load * meshed + 2 * local == pytest.approx(exact, rel=1e-3)


def pin_patches(mesh, width):
    psi = 2 * np.pi * (np.arange(SMALL.pins) + 0.37) / SMALL.pins
    return boundary_patches(mesh, "flank", SMALL.flank(psi), SMALL.normal(psi), width)


@pytest.fixture(scope="module")
def disk():
    return elastic_body(disk_mesh(edges=48), E, NU, 2.0, "plane_stress", "bore")


def test_contact_compliance_does_not_depend_on_mesh_and_patch(disk):
    unit = 2 / (np.pi * E * 2.0)
    edge = np.abs(np.diff(flank_nodes(SMALL, 48)[:2]))[0]
    width = 2 * edge
    base = disk.compliance(pin_patches(disk.mesh, width)).matrix
    fine = elastic_body(disk_mesh(edges=96, growth=0.25, largest=0.5), E, NU, 2.0, "plane_stress", "bore")
    for narrower in (1, 2):
        variant = fine.compliance(pin_patches(fine.mesh, width / narrower)).matrix
        shift = np.diagonal(variant - base) - unit * np.log(narrower)
        assert np.abs(shift).max() < 0.02 * unit
        off_diagonal = (variant - base)[~np.eye(len(base), dtype=bool)]
        assert np.abs(off_diagonal).max() < 0.005 * np.abs(base).max()


def test_compliance_is_symmetric_positive_and_held_at_the_bore(disk):
    inner_patches = line_patches(disk.mesh, [4.5j, 5 - 1j], [1, 1j], [1j, 1], 0.5)
    patches = joined(pin_patches(disk.mesh, 0.2), inner_patches)
    compliance = disk.compliance(patches)
    assert compliance.asymmetry < 1e-10
    np.testing.assert_array_equal(compliance.matrix, compliance.matrix.T)
    assert np.linalg.eigvalsh(compliance.matrix).min() > 0
    forces = np.linspace(-50, 100, len(patches))
    displacement = disk.nodal_displacement(patches, forces)
    bore = np.abs(np.abs(disk.nodes) - 2.5) < 5e-3
    assert np.abs(np.mean(displacement[bore])) < 1e-3 * np.abs(displacement).max()
    vector = np.zeros(disk.freedoms.size)
    vector[disk.freedoms[:, 0]], vector[disk.freedoms[:, 1]] = displacement.real, displacement.imag
    np.testing.assert_allclose(disk.reference.T @ vector, 0, atol=1e-15)
    np.testing.assert_allclose(disk.loads(patches).T @ vector, compliance.matrix @ forces, rtol=1e-8)
    energy = vector @ (disk.stiffness @ vector)
    assert energy == pytest.approx(forces @ compliance.matrix @ forces, rel=1e-9)


def test_plane_strain_is_plane_stress_with_the_equivalent_constants(disk):
    mesh = disk.mesh
    strain = elastic_body(mesh, E, NU, 2.0, "plane_strain", "bore").compliance(pin_patches(mesh, 0.2)).matrix
    stress = elastic_body(mesh, E / (1 - NU**2), NU / (1 - NU), 2.0, "plane_stress", "bore")
    np.testing.assert_allclose(strain, stress.compliance(pin_patches(mesh, 0.2)).matrix, rtol=1e-9, atol=1e-18)


def test_compliance_falls_with_thickness_and_modulus(disk):
    variant = elastic_body(disk.mesh, 2 * E, NU, 6.0, "plane_stress", "bore")
    np.testing.assert_allclose(
        variant.compliance(pin_patches(disk.mesh, 0.2)).matrix,
        disk.compliance(pin_patches(disk.mesh, 0.2)).matrix / 6,
        rtol=1e-9,
        atol=1e-18,
    )

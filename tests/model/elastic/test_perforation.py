"""The disk with holes: conforming, well shaped, and its compliance under pressure in a hole against exact answers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import edge_lengths, mesh_area, triangle_quality
from reducers import SMALL, profile_with

from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.perforated_mesh import hole_boundary, perforated_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches, joined_patches
from pipeline.model.geometry.cycloid_profile import CycloidProfile

E, NU = 206e3, 0.3
METAL = CycloidProfile(pins=40, pin_circle_radius=70.0, pin_radius=3.0, eccentricity=1.2)


def circle(n, radius, phase=0.0):
    return radius * np.exp(1j * (phase - 2 * np.pi * np.arange(n) / n))


def small_mesh(edges=48, edge=0.06, growth=0.35, largest=0.8, holes=5, radius=1.2):
    disk = lobed_disk_mesh(flank_nodes(SMALL, edges), SMALL.lobes, 2.5, growth, largest)
    return perforated_mesh(disk, circle(holes, 5.2, 0.3), radius, edge, growth)


@pytest.mark.parametrize(("holes", "phase"), [pytest.param(10, 0.0, marks=pytest.mark.attack), (11, 1.0)])
@pytest.mark.long
def test_a_commercial_disk_is_well_shaped(holes, phase):
    disk = lobed_disk_mesh(flank_nodes(METAL, 48), METAL.lobes, 24.0, 0.35, 2.0)
    mesh = perforated_mesh(disk, circle(holes, 45.0, phase), 7.205, 0.2, 0.35)
    assert triangle_quality(mesh).min() > 0.5
    for hole, centre in enumerate(circle(holes, 45.0, phase)):
        facets = mesh.boundaries[hole_boundary(hole)]
        corners = np.unique(mesh.facets[:, facets])
        np.testing.assert_allclose(np.abs(mesh.p[0, corners] + 1j * mesh.p[1, corners] - centre), 7.205)
        np.testing.assert_allclose(edge_lengths(mesh, facets), 0.2, rtol=0.01)


@settings(max_examples=2)
@given(
    pins=st.integers(9, 28),
    shortening=st.floats(0.3, 0.8),
    edges=st.integers(16, 24),
    growth=st.floats(0.2, 0.45),
    holes=st.integers(3, 10),
    phase=st.floats(0, 6),
    position=st.floats(0.3, 0.7),
    fill=st.floats(0.3, 0.9),
    fineness=st.floats(0.02, 0.15),
)
@pytest.mark.long
def test_every_design_gives_a_conforming_mesh(pins, shortening, edges, growth, holes, phase, position, fill, fineness):
    bore, profile = 10.0, profile_with(pins, shortening, pin_share=0.6, chord_share=0.6)
    root = profile.pin_circle_radius - profile.eccentricity - profile.pin_radius
    ring = bore + position * (root - bore)
    hole = fill * min(ring - bore, root - ring, ring * np.sin(np.pi / holes))
    flank = flank_nodes(profile, edges)
    disk = lobed_disk_mesh(flank, profile.lobes, bore, growth, largest_edge=3.0)
    mesh = perforated_mesh(disk, circle(holes, ring, phase), hole, fineness * hole, growth)
    circumference = {name: len(facets) for name, facets in mesh.boundaries.items()}
    assert list(circumference) == ["flank", *map(hole_boundary, range(holes)), "bore"]
    assert circumference["flank"] == len(flank)
    np.testing.assert_allclose(mesh.p[0, : len(flank)] + 1j * mesh.p[1, : len(flank)], flank)
    n = circumference["hole_0"]
    cut = holes * n / 2 * hole**2 * np.sin(2 * np.pi / n)
    assert mesh_area(mesh) == pytest.approx(mesh_area(disk) - cut, rel=1e-12)
    assert triangle_quality(mesh).min() > 0.4


def test_holes_that_leave_no_wall_are_refused():
    disk = lobed_disk_mesh(flank_nodes(SMALL, 24), SMALL.lobes, 2.5, 0.35, 0.8)
    with pytest.raises(ValueError, match="walls about the holes are too"):
        perforated_mesh(disk, circle(5, 5.2), 3.1, 0.2, 0.35)


@pytest.mark.long
def test_constant_stress_is_exact_about_the_holes():
    """A uniform compression by tractions on all boundaries, holes included, strains the disk uniformly."""
    from skfem import ElementTriP2, ElementVector, FacetBasis, LinearForm

    mesh = small_mesh(edges=24, edge=0.2)
    body = elastic_body(mesh, E, NU, 2.0, "plane_stress", "bore")
    boundary = FacetBasis(mesh, ElementVector(ElementTriP2()))
    traction = 2.0 * LinearForm(lambda v, w: -100.0 * (w.n[0] * v[0] + w.n[1] * v[1])).assemble(boundary)
    displacement = body.displacement(traction[:, None])[:, 0]
    field = displacement[body.freedoms[:, 0]] + 1j * displacement[body.freedoms[:, 1]]
    exact = -100.0 * (1 - NU) / E * body.nodes
    exact -= exact.mean() - field.mean()  # the bore's mesh has no exact symmetry
    np.testing.assert_allclose(field, exact, atol=1e-4 * np.abs(exact).max())


def opening_of_a_hole(width_ratio, modulus, thickness):
    """Mean approach of two opposite unit forces on a round hole in an infinite plate [mm/N].

    Of forces g cos(m theta) along x on the wall, m odd, Kolosov's functions give u_x = g a cos(m theta) 2/(E' m); so it
    is 8/(pi E' t) sum <cos(m theta)>^2/m over the odd m, <> being the mean over a patch.
    """
    angle = np.pi * np.arange(1, 401) / 401  # Gauss-Chebyshev points of the elliptical pressure over y
    theta, weight = np.arcsin(width_ratio * np.cos(angle)), 2 / 401 * np.sin(angle) ** 2
    order = np.arange(1, int(200 / width_ratio), 2)
    return 8 / (np.pi * modulus * thickness) * np.sum((np.cos(np.outer(order, theta)) @ weight) ** 2 / order)


@pytest.mark.parametrize(
    ("stress", "width_ratio"),
    [("plane_stress", 0.05), ("plane_stress", 0.2), ("plane_strain", 0.2)],
)
@pytest.mark.long
def test_opposite_forces_open_a_hole_as_in_an_infinite_plate(stress, width_ratio):
    outer, thickness = 40.0, 2.0
    rim = outer * np.exp(2j * np.pi * np.arange(240) / 240)
    disk = lobed_disk_mesh(rim, 8, 0.0, 0.3, 2.0)
    mesh = perforated_mesh(disk, np.zeros(1, complex), 1.0, width_ratio / 2, 0.25)
    assert triangle_quality(mesh).min() > 0.4
    body = elastic_body(mesh, E, NU, thickness, stress, "flank")
    exact = opening_of_a_hole(width_ratio, E if stress == "plane_stress" else E / (1 - NU**2), thickness)
    for turn in (0.0, 0.71, 2.0):
        directions = np.exp(1j * turn) * np.array([1, -1])
        patches = boundary_patches(mesh, "hole_0", directions, directions, width_ratio)
        error = body.compliance(patches).matrix.sum() / exact - 1
        print(f"w/r {width_ratio}, {stress}, turned {turn}: {error:.1e}")
        assert abs(error) < 3e-3


def wall_patches(mesh, crank, width, holes=5, radius=1.2):
    """On every hole, on the side away from the eccentric, pushed the same way: as output pins do."""
    direction = np.exp(1j * crank)
    return joined_patches(
        *(
            boundary_patches(mesh, hole_boundary(k), c - radius * direction, -direction, width)
            for k, c in enumerate(circle(holes, 5.2, 0.3))
        )
    )


@pytest.mark.parametrize("crank", [0.4, 3.3])
def test_patches_at_any_angle_carry_a_unit_force_with_its_arm(crank):
    mesh = small_mesh(edges=24, edge=0.1)
    body = elastic_body(mesh, E, NU, 2.0, "plane_stress", "bore")
    resultant = body.rigid_motions.T @ body.loads(wall_patches(mesh, crank, 0.2)).toarray()
    direction = np.exp(1j * crank)
    arms = np.imag(np.conj(circle(5, 5.2, 0.3)) * -direction)
    np.testing.assert_allclose(resultant[0] + 1j * resultant[1], np.full(5, -direction), atol=1e-12)
    np.testing.assert_allclose(resultant[2], arms, atol=2e-3)  # the wall is a polygon


@pytest.mark.long
def test_loads_eliminated_alone_work_as_they_do_on_the_displacement_of_the_whole_solve():
    mesh = small_mesh(edges=24, edge=0.1)
    body, patches = elastic_body(mesh, E, NU, 2.0, "plane_stress", "bore"), wall_patches(mesh, 0.77, 0.2)
    loads = body.loads(patches).toarray()
    whole = loads.T @ body.displacement(loads)
    np.testing.assert_allclose(body.compliance(patches).matrix, whole, rtol=0, atol=1e-12 * np.abs(whole).max())


@pytest.mark.long
def test_compliance_of_holes_does_not_depend_on_mesh_and_patch():
    unit, width = 2 / (np.pi * E * 2.0), 0.2
    coarse = small_mesh(edges=32, edge=0.1, largest=0.6)
    fine = small_mesh(edges=64, edge=0.05, growth=0.25, largest=0.6)
    bodies = [elastic_body(mesh, E, NU, 2.0, "plane_stress", "bore") for mesh in (coarse, fine)]
    matrices = []
    for body, ratio in ((bodies[0], 1.0), (bodies[1], 1.0), (bodies[1], 0.5)):
        result = body.compliance(wall_patches(body.mesh, 0.77, ratio * width))
        assert result.asymmetry < 1e-10
        assert np.all(np.linalg.eigvalsh(result.matrix) > 0)
        matrices.append(result.matrix + unit * np.log(ratio) * np.eye(5))
    for matrix in matrices[1:]:
        assert np.abs(matrix - matrices[0]).max() < 0.02 * unit

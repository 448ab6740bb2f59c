"""Patch loads: unit force, centre and spread of the elliptical pressure, wherever the nodes lie."""

import numpy as np
import pytest
from skfem import MeshTri

from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches, joined_patches, line_patches

HALF_WIDTH = 0.11


@pytest.fixture(scope="module")
def square():
    mesh = MeshTri.init_tensor(np.linspace(0, 1, 14), np.linspace(0, 1, 12)).with_defaults()
    mesh = mesh.with_boundaries({"outline": mesh.boundary_facets()})
    return elastic_body(mesh, 200e3, 0.3, 1.0, "plane_stress", "outline")


def work(body, patches, displacement):
    """Work of each unit patch force on a displacement field given as a function of the complex place."""
    field = displacement(body.nodes)
    nodal = np.zeros(body.freedoms.size)
    nodal[body.freedoms[:, 0]], nodal[body.freedoms[:, 1]] = field.real, field.imag
    return body.loads(patches).T @ nodal


def patches_of(body, position):
    centres = np.array([0.37, 0.5, 0.713]) + (0j if position == "boundary" else 0.4321j)
    direction = 1j * np.exp(0.2j * np.arange(3)) if position == "line" else [1j, 2j, 0.5j]
    if position == "boundary":
        return centres, boundary_patches(body.mesh, "outline", centres, direction, HALF_WIDTH)
    return centres, line_patches(body.mesh, centres, [1, -2, 3], direction, HALF_WIDTH)


@pytest.mark.parametrize("position", ["boundary", "line"])
def test_unit_force_acts_at_the_centre_with_the_spread_of_the_elliptical_pressure(square, position):
    centres, patches = patches_of(square, position)
    direction = patches.direction
    np.testing.assert_allclose(work(square, patches, lambda z: np.ones_like(z)), direction.real, atol=1e-14)
    np.testing.assert_allclose(work(square, patches, lambda z: 1j * np.ones_like(z)), direction.imag, atol=1e-14)
    np.testing.assert_allclose(work(square, patches, lambda z: 1j * z.real), direction.imag * centres.real)
    mean_of_square = centres.real**2 + HALF_WIDTH**2 / 4  # quadratic triangles hold x^2 exactly
    np.testing.assert_allclose(work(square, patches, lambda z: 1j * z.real**2), direction.imag * mean_of_square)


def test_on_a_curve_the_pressure_spreads_along_the_tangent():
    circle = 2 * np.exp(2j * np.pi * np.arange(720) / 720)
    mesh = lobed_disk_mesh(circle, 8, 0.5, growth=0.35, largest_edge=0.3)
    normal = -np.exp(1j * np.linspace(0, 6, 9))
    patches = boundary_patches(mesh, "flank", -2 * normal, normal, 0.7)
    transverse = np.real((patches.points + 2 * normal[:, None]) * np.conj(-1j * normal)[:, None])
    assert np.abs(patches.points).min() > 2 * np.cos(np.pi / 720) - 1e-12
    np.testing.assert_allclose(transverse @ patches.weights, 0, atol=1e-5)
    np.testing.assert_allclose(transverse**2 @ patches.weights, 0.7**2 / 4, rtol=1e-5)


def test_patches_of_a_bore_press_into_the_body():
    circle = 2 * np.exp(2j * np.pi * np.arange(240) / 240)
    mesh = lobed_disk_mesh(circle, 8, 0.5, growth=0.35, largest_edge=0.3)
    patches = boundary_patches(mesh, "bore", [0.5, 0.5j], [1, 1j], 0.05)
    np.testing.assert_allclose(np.abs(patches.points), 0.5, rtol=2e-3)
    np.testing.assert_allclose(patches.points @ patches.weights, [0.5, 0.5j], rtol=4e-3)


def test_joined_patches_keep_their_order(square):
    boundary, line = patches_of(square, "boundary")[1], patches_of(square, "line")[1]
    pair = square.loads(joined_patches(boundary, line))
    np.testing.assert_array_equal(pair[:, :3].toarray(), square.loads(boundary).toarray())
    np.testing.assert_array_equal(pair[:, 3:].toarray(), square.loads(line).toarray())


def test_a_patch_outside_the_body_is_refused(square):
    with pytest.raises(ValueError, match="lies outside the body"):
        line_patches(square.mesh, [0.95 + 0.5j], [1], [1j], HALF_WIDTH)
    with pytest.raises(ValueError, match=r"contact 1 .* off boundary outline"):
        boundary_patches(square.mesh, "outline", [0.5, 0.5 + 0.3j], [1j, 1j], HALF_WIDTH)
    with pytest.raises(ValueError, match="turns away from its force"):
        boundary_patches(square.mesh, "outline", [0.05], [1j], HALF_WIDTH)

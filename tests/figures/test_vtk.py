"""VTK files hold the quadratic mesh and its fields, as ParaView reads them."""

import sys

import meshio
import numpy as np
import pytest
from skfem import MeshTri

from pipeline.errors import InputError
from pipeline.figures.mesh import write_vtk
from pipeline.model.elastic.condensed_body import elastic_body


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_file_read_back_holds_nodes_triangles_and_fields(tmp_path, suffix):
    mesh = MeshTri().refined(2)
    mesh = mesh.with_boundaries({"outline": mesh.boundary_facets()})
    body = elastic_body(mesh, 1.0, 0.3, 1.0, "plane_stress", "outline")
    write_vtk(
        tmp_path / f"square{suffix}",
        body.nodes,
        body.triangles,
        {"displacement_mm": 2j * body.nodes, "pressure_MPa": body.nodes.real},
    )
    read = meshio.read(tmp_path / f"square{suffix}")
    (cells,) = read.cells
    assert cells.type == "triangle6"
    np.testing.assert_array_equal(cells.data, body.triangles)
    np.testing.assert_allclose(read.points[:, 0] + 1j * read.points[:, 1], body.nodes)
    corners, middles = read.points[cells.data[:, :3]], read.points[cells.data[:, 3:]]
    np.testing.assert_allclose(middles, (corners + np.roll(corners, -1, axis=1)) / 2)  # VTK: edges 01, 12, 20
    np.testing.assert_allclose(read.point_data["displacement_mm"][:, 0], -2 * body.nodes.imag)
    np.testing.assert_allclose(read.point_data["pressure_MPa"], body.nodes.real)


def test_field_of_the_wrong_length_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"field pressure_MPa has shape \(2,\); must be \(3,\)"):
        write_vtk(tmp_path / "bad.vtu", np.array([0, 1, 1j]), np.zeros((0, 6), int), {"pressure_MPa": np.zeros(2)})


def test_without_meshio_the_message_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(InputError, match=r"meshio is not installed.*cycloid-tolerance-study\[vtk\]"):
        write_vtk(tmp_path / "square.vtu", np.zeros(0, complex), np.zeros((0, 6), int), {})

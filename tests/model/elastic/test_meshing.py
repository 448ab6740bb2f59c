"""The graded mesh of the lobed disk: conforming, periodic, well shaped, for any design."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import edge_lengths, mesh_area, triangle_quality
from reducers import profile_with

from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.geometry.cycloid_profile import CycloidProfile

PAPER = CycloidProfile(pins=80, pin_circle_radius=32.5, pin_radius=0.8, eccentricity=0.35)


def polygon_area(corners):
    return np.imag(np.conj(corners) * np.roll(corners, -1)).sum() / 2


def test_flank_nodes_lie_on_the_true_flank_at_equal_spacing():
    nodes = flank_nodes(PAPER, 24)
    psi = np.linspace(0, PAPER.lobe_pitch, 40_001)
    from_locus = np.abs(nodes[:24, None] - PAPER.locus(psi)).min(axis=1)
    np.testing.assert_allclose(from_locus, PAPER.pin_radius, atol=1e-6)
    arc = np.abs(np.diff(PAPER.flank(psi))).sum() / 24
    spacing = np.abs(np.roll(nodes, -1) - nodes)
    assert spacing.max() <= arc * (1 + 1e-6)
    assert spacing.min() > 0.97 * arc
    np.testing.assert_allclose(nodes[1:24][::-1], np.conj(nodes[1:24]) * np.exp(1j * PAPER.lobe_pitch), atol=1e-6)


@pytest.mark.parametrize("edges_per_lobe", [24, 76])
def test_paper_disk_is_well_shaped_and_of_the_papers_size(edges_per_lobe):
    mesh = lobed_disk_mesh(flank_nodes(PAPER, edges_per_lobe), PAPER.lobes, 3.0, growth=0.35, largest_edge=1.0)
    assert triangle_quality(mesh).min() > 0.6
    if edges_per_lobe == 76:
        assert mesh.nelements > 29_000
        assert mesh.nvertices + mesh.nfacets > 74_000  # the paper's number of nodes, at the quadratic triangles' nodes


@settings(max_examples=12)
@given(
    pins=st.integers(6, 60),
    shortening=st.floats(0.3, 0.9),
    pin_share=st.floats(0.2, 0.9),
    edges=st.integers(24, 48),
    growth=st.floats(0.15, 0.45),
    bore_share=st.floats(0.02, 0.7),
)
@pytest.mark.long
def test_every_design_gives_a_conforming_mesh(pins, shortening, pin_share, edges, growth, bore_share):
    profile = profile_with(pins, shortening, pin_share, chord_share=0.8)
    flank, bore = flank_nodes(profile, edges), bore_share * profile.pin_circle_radius
    mesh = lobed_disk_mesh(flank, profile.lobes, bore, growth, largest_edge=2.0)

    np.testing.assert_allclose(mesh.p[0, : len(flank)] + 1j * mesh.p[1, : len(flank)], flank)
    assert len(mesh.boundaries["flank"]) == len(flank)
    n_bore = len(mesh.boundaries["bore"])
    bore_area = n_bore / 2 * bore**2 * np.sin(2 * np.pi / n_bore)
    assert mesh_area(mesh) == pytest.approx(polygon_area(flank) - bore_area, rel=1e-12)
    assert triangle_quality(mesh).min() > 0.4
    assert edge_lengths(mesh, slice(None)).max() < 1.6 * 2.0


def test_edges_grow_from_the_flank_as_asked():
    mesh = lobed_disk_mesh(flank_nodes(PAPER, 48), PAPER.lobes, 3.0, growth=0.3, largest_edge=1.0)
    ends = (mesh.p[0] + 1j * mesh.p[1])[mesh.facets]
    flank = mesh.p[0, : 48 * 79] + 1j * mesh.p[1, : 48 * 79]
    middle = ends.mean(axis=0)
    depth = np.array([np.abs(flank - m).min() for m in middle[::40]])
    expected = np.minimum(np.abs(flank[1] - flank[0]) + 0.3 * depth, 1.0)
    off_bore = np.abs(middle[::40]) > 8  # beyond the finer edges about the bore
    ratio = (np.abs(ends[1] - ends[0])[::40] / expected)[off_bore]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert ratio.max() < 1.7
    assert ratio.min() > 0.5


@pytest.mark.parametrize(("profile", "bore"), [(PAPER, 3.0), (PAPER, 28.4), (CycloidProfile(4, 10, 1, 0.8), 2.0)])
def test_the_mesh_of_every_lobe_is_the_first_one_turned(profile, bore):
    mesh = lobed_disk_mesh(flank_nodes(profile, 24), profile.lobes, bore, growth=0.35, largest_edge=1.0)
    corners = (mesh.p[0] + 1j * mesh.p[1])[mesh.t].reshape(3, profile.lobes, -1)
    turned_corners = corners[:, :1] * np.exp(1j * profile.lobe_pitch * np.arange(profile.lobes))[:, None]
    np.testing.assert_allclose(corners, turned_corners, atol=1e-12 * profile.pin_circle_radius)


def test_a_disk_without_bore_is_solid():
    circle = 5 * np.exp(2j * np.pi * np.arange(160) / 160)
    mesh = lobed_disk_mesh(circle, 8, 0.0, growth=0.3, largest_edge=0.5)
    assert set(mesh.boundaries) == {"flank"}
    assert mesh_area(mesh) == pytest.approx(polygon_area(circle), rel=1e-12)
    assert triangle_quality(mesh).min() > 0.5


@pytest.mark.parametrize(
    ("flank", "n_lobes", "bore", "message"),
    [
        (flank_nodes(PAPER, 24)[:-1], 79, 3.0, "multiple"),
        (flank_nodes(PAPER, 24) * (1 + 1e-4 * np.arange(79 * 24)), 79, 3.0, "periodic"),
        (np.conj(flank_nodes(PAPER, 24)), 79, 3.0, "periodic|counterclockwise"),
        (flank_nodes(PAPER, 24), 79, 40.0, "bore radius 40 mm; must be"),
    ],
)
def test_a_flank_that_cannot_be_meshed_is_refused(flank, n_lobes, bore, message):
    with pytest.raises(ValueError, match=message):
        lobed_disk_mesh(flank, n_lobes, bore, growth=0.35, largest_edge=1.0)


def test_quality_of_known_triangles():
    from skfem import MeshTri

    points = np.array([[0, 1, 0.5, 0, 3, 0], [0, 0, np.sqrt(3) / 2, 0, 0, 4.0]])
    mesh = MeshTri(points, np.array([[0, 3], [1, 4], [2, 5]]), validate=False)
    np.testing.assert_allclose(triangle_quality(mesh), [1, 4 * np.sqrt(3) * 6 / 50])

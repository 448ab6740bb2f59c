"""Graded triangle meshes of a lobed disk with a round bore, from SciPy's Delaunay triangulation alone.

One lobe's band of nodes is made (rows parallel to the flank, spacing growing with depth, a few smoothing
passes between its two neighbours), and below it the lobe's share of the rings that go down to the bore; the
triangles of this sector are turned ``n_lobes`` times, so the mesh is cyclic from the flank to the bore.
Points are complex numbers x + iy [mm] in the frame of the disk.

gmsh and netgen need system libraries that a bare machine lacks, and Triangle forbids commercial use.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from skfem import MeshTri

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError
from pipeline.model.elastic.polygon import ClosedPolygon, arc_length, coordinates, cross
from pipeline.model.elastic.triangulation import cyclic_triangulation, patch_centroids
from pipeline.model.geometry.cycloid_profile import CycloidProfile

ROW_HEIGHT = np.sqrt(3) / 2  # of a row of equilateral triangles, in edge lengths
BORE_EDGES = 180  # at least: its corners cost a compliance less than 0.01 of 2/(pi E' t), 0.04 with 64 edges
CLEARANCE = 0.6  # in edge lengths: no node of the band comes closer to the flank or to the ring below it
SMOOTHING_PASSES = 10  # the smallest quality gains nothing after that
ARC_SAMPLES = 64  # per flank edge, to invert the arc length


def flank_nodes(profile: CycloidProfile, edges_per_lobe: int) -> Complex:
    """Nodes at equal arc length along the whole flank, counterclockwise from a root.

    Returns
    -------
    (n_lobes * edges_per_lobe,) complex [mm], disk frame.
    """
    psi = np.linspace(0, profile.lobe_pitch, ARC_SAMPLES * edges_per_lobe + 1)
    arc = arc_length(profile.flank(psi))
    lobe = profile.flank(np.interp(np.arange(edges_per_lobe) * arc[-1] / edges_per_lobe, arc, psi))
    return _rotated_copies(lobe, profile.lobe_pitch, range(profile.lobes))


def lobed_disk_mesh(flank: Complex, n_lobes: int, bore_radius: float, growth: float, largest_edge: float) -> MeshTri:
    """Triangle mesh of the disk between a periodic flank and a round bore about the origin.

    Parameters
    ----------
    flank
        Corners of the closed flank polygon, counterclockwise, evenly spaced, each lobe a turned copy of the
        first (n_lobes * edges_per_lobe,) complex [mm]. All of them, and no others, lie on the meshed flank.
    n_lobes
        Number of lobes.
    bore_radius
        Radius of the bore [mm]; 0 is a disk without a bore.
    growth
        Growth of the edge length per unit of distance from the flank [-]; 0.35 is usual, above 0.6 poor.
    largest_edge
        Bound of the edge length [mm].

    Returns
    -------
    Mesh with the boundaries ``flank`` and ``bore`` (no ``bore`` without one). The flank's corners are its
    first vertices, in their order. Its triangles are those of the first sector, then those of the next in the
    same order and with the same corners, turned by a lobe's pitch, and so on.

    Raises
    ------
    ValueError
        The flank is not periodic or does not surround the bore, or the triangulation loses a flank edge.
    """
    _check_flank(flank, n_lobes, bore_radius)
    size = _EdgeLength.from_flank(flank, n_lobes, bore_radius, growth, largest_edge)
    innermost = np.abs(flank).min()
    band_radius = innermost - min(size.pitch * innermost, (innermost - bore_radius) / 2)
    rings = _rings(band_radius, size)
    n_bore = len(rings[-1]) if bore_radius > 0 else 0
    inner = np.concatenate([_lobe_band(flank, band_radius, size), *(rings if n_bore else rings[:-1])])
    points, triangles = cyclic_triangulation(flank[: len(flank) // n_lobes], inner, n_bore, n_lobes)
    mesh = MeshTri(coordinates(points).T.copy(), triangles.T.copy(), sort_t=False)  # sorted, corners change places
    return _with_boundaries(mesh, len(flank), n_lobes * n_bore)


@dataclass(frozen=True)
class _EdgeLength:
    """Wanted edge length [mm]: grows away from the flank and from the bore, up to a largest."""

    flank: ClosedPolygon
    pitch: float
    at_flank: float
    at_bore: float
    bore_radius: float
    growth: float
    largest_edge: float

    @classmethod
    def from_flank(
        cls, flank: Complex, n_lobes: int, bore_radius: float, growth: float, largest_edge: float
    ) -> "_EdgeLength":
        polygon, pitch = ClosedPolygon.through(flank), 2 * np.pi / n_lobes
        at_bore = largest_edge
        if bore_radius > 0:
            edge = min(largest_edge, 2 * np.pi * bore_radius / BORE_EDGES)
            at_bore = pitch * bore_radius / np.ceil(pitch * bore_radius / edge)
        return cls(polygon, pitch, polygon.length / len(flank), at_bore, bore_radius, growth, largest_edge)

    def flank_distance(self, points: Complex) -> Real:
        return self.flank.distance_and_arc(points)[0]

    def at_depth(self, depth: Real) -> Real:
        return np.minimum(self.at_flank + self.growth * depth, self.largest_edge)

    def __call__(self, points: Complex) -> Real:
        near_bore = self.at_bore + self.growth * np.maximum(np.abs(points) - self.bore_radius, 0)
        return np.minimum(self.at_depth(self.flank_distance(points)), near_bore)

    def edges_around(self, radius: Real) -> Index:
        """Edges of one sector's part of a ring: a whole number, for every sector has the same nodes."""
        return np.maximum(1, np.rint(self.pitch * radius / self(np.asarray(radius, complex)))).astype(int)


def _lobe_band(flank: Complex, inner_radius: float, size: _EdgeLength) -> Complex:
    """Nodes of one lobe's band below the flank, down to a ring of evenly spaced nodes at ``inner_radius``."""
    n_lobes = round(2 * np.pi / size.pitch)
    lobe, ring = flank[: len(flank) // n_lobes], _ring(inner_radius, 0.5, size)
    inner = _rows_below(lobe, inner_radius, size)
    for _ in range(SMOOTHING_PASSES):
        inner = _smoothed_nodes(inner, np.concatenate([lobe, ring]), size)
    return np.concatenate([inner, ring])


def _rows_below(lobe: Complex, inner_radius: float, size: _EdgeLength) -> Complex:
    """Nodes on parallels of one lobe's flank, a row height apart, staggered from row to row."""
    turn = np.exp(1j * size.pitch)
    corners = np.concatenate([lobe[-1:] / turn, lobe, lobe[:2] * turn])
    inward = 1j * (corners[2:] - corners[:-2]) / np.abs(corners[2:] - corners[:-2])
    rows = []
    for row, depth in enumerate(_levels(size.at_depth, np.abs(lobe).max() - inner_radius)[1:]):
        parallel = corners[1:-1] + depth * inward
        arc = arc_length(parallel)
        edge = float(size.at_depth(depth))
        n_nodes = max(1, round(arc[-1] / edge))
        arc_position = (np.arange(n_nodes) + 0.5 * (row % 2 == 0)) / n_nodes * arc[-1]
        nodes = np.asarray(np.interp(arc_position, arc, parallel), complex)
        # Below a convex flank the parallel crosses itself: what comes nearer to the flank than its depth is no row.
        on_row = size.flank_distance(nodes) > 0.99 * depth - 0.01 * size.at_flank
        rows.append(nodes[on_row & (np.abs(nodes) > inner_radius + CLEARANCE * edge)])
    return np.concatenate(rows)


def _smoothed_nodes(inner: Complex, fixed_nodes: Complex, size: _EdgeLength) -> Complex:
    """``inner`` nodes at the centroids of their patches, where these keep off the flank."""
    points = _rotated_copies(np.concatenate([inner, fixed_nodes]), size.pitch, [0, -1, 1, -2, 2])
    centroids = patch_centroids(points, len(inner), size)
    return np.where(size.flank_distance(centroids) > CLEARANCE * size.at_flank, centroids, inner)


def _rings(outer_radius: float, size: _EdgeLength) -> list[Complex]:
    """One sector's rings of nodes below ``outer_radius`` (without it) down to the bore, or to the centre."""

    def edge_at(depth: Real) -> Real:
        radius = outer_radius - depth
        edge = size(np.asarray(radius, complex))
        tangential_edge = size.pitch * radius / size.edges_around(radius)
        return (
            tangential_edge if size.bore_radius > 0 else np.maximum(tangential_edge, edge)
        )  # else rings without end at the centre

    depths = _levels(edge_at, outer_radius - size.bore_radius)[1:]
    return [_ring(outer_radius - depth, 0.5 * (row % 2), size) for row, depth in enumerate(depths)]


def _ring(radius: float, stagger: float, size: _EdgeLength) -> Complex:
    """One sector's evenly spaced nodes on a ring, from ``stagger`` edges on."""
    n_edges = int(size.edges_around(np.array([radius]))[0])
    ring: Complex = radius * np.exp(1j * size.pitch * (np.arange(n_edges) + stagger) / n_edges)
    return ring


def _levels(edge_at: Callable[[Real], Real], depth: float) -> Real:
    """Depths from 0 to ``depth`` [mm], a row height of the local edge length apart."""
    fine = np.linspace(0, depth, 4001)
    per_depth = 1 / (ROW_HEIGHT * edge_at(fine))
    rows = np.concatenate([[0], np.cumsum((per_depth[1:] + per_depth[:-1]) / 2 * np.diff(fine))])
    return np.interp(np.linspace(0, rows[-1], max(1, round(rows[-1])) + 1), rows, fine)


def _with_boundaries(mesh: MeshTri, n_flank: int, n_bore: int) -> MeshTri:
    """The mesh with its boundaries named, once they are seen to be the flank's and the bore's edges and no others."""
    edge = mesh.facets[:, mesh.boundary_facets()]
    on_flank = (edge < n_flank).all(axis=0)
    sorted_edges = np.sort([np.arange(n_flank), np.roll(np.arange(n_flank), -1)], axis=0)
    if not np.array_equal(_sorted_edges(sorted_edges), _sorted_edges(edge[:, on_flank])):
        raise ModelError(
            f"the mesh holds {on_flank.sum()} flank edges of {n_flank}: the flank is too coarse for its curvature; "
            "take more edges per lobe"
        )
    if (~on_flank).sum() != n_bore:
        raise ModelError(f"the mesh holds {(~on_flank).sum()} bore edges of {n_bore}; take a smaller largest_edge")
    boundaries = {"flank": mesh.boundary_facets()[on_flank], "bore": mesh.boundary_facets()[~on_flank]}
    return mesh.with_boundaries({name: facets for name, facets in boundaries.items() if len(facets)})


def _sorted_edges(edges: Index) -> Index:
    return edges[:, np.lexsort(edges)]


def _check_flank(flank: Complex, n_lobes: int, bore_radius: float) -> None:
    if len(flank) % n_lobes or len(flank) < 3 * n_lobes:
        raise ValueError(f"flank has {len(flank)} corners; must be a multiple, 3 or more, of the {n_lobes} lobes")
    shift = np.roll(flank, -(len(flank) // n_lobes)) - flank * np.exp(2j * np.pi / n_lobes)
    radius = np.abs(flank).max()
    if np.abs(shift).max() > 1e-6 * radius:
        raise ValueError(f"flank repeats from lobe to lobe only within {np.abs(shift).max():.3g} mm; must be periodic")
    if cross(flank, np.roll(flank, -1)).sum() <= 0:
        raise ValueError("flank runs clockwise about the origin; must run counterclockwise")
    if not 0 <= bore_radius < np.abs(flank).min():
        raise ValueError(f"bore radius {bore_radius:g} mm; must be at least 0 and below {np.abs(flank).min():g} mm")


def _rotated_copies(points: Complex, pitch: float, turns: ArrayLike) -> Complex:
    """Copies of ``points`` turned about the origin by every one of ``turns`` times the angle ``pitch`` [rad]."""
    return np.outer(np.exp(1j * pitch * np.asarray(turns)), points).ravel()

"""A mesh of a perforated disk that shares nothing with the model's: leaves of a quadtree, curved quadratic triangles.

Every boundary is a closed curve of one parameter; corners and midside nodes lie on it, not on a polygon. Points are
complex numbers x + iy [mm].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.path import Path
from scipy.spatial import Delaunay, KDTree

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError

SAMPLES = 1000
"""Of a boundary, by which its nodes are spread over its length and distances from it are taken."""
WALL = 0.55
"""Distance of inner nodes from a boundary, in edge lengths."""
PASSES = 6
"""Of moving each inner node to the mean of its neighbours."""
AREA = 1e-9
"""Share of the polygons' area by which that of the triangles may differ: rounding. A lost edge costs far more."""


@dataclass(frozen=True)
class Curve:
    """A closed boundary, run through once for parameters from 0 to 1 (counterclockwise or not).

    Attributes
    ----------
    point : of a parameter (n,) to complex [mm].
    edge : largest edge length on it [mm].
    has_even_corners : whether its corners divide the parameter evenly.
    """

    point: Callable[[Real], Complex]
    edge: float
    has_even_corners: bool = False

    def samples(self, count: int) -> tuple[Real, Complex]:
        """Parameters and points, (count,) each."""
        parameter = np.arange(count) / count
        return parameter, self.point(parameter)


@dataclass(frozen=True)
class Loop:
    """Nodes of a boundary.

    Attributes
    ----------
    parameter : of the corners (n,), ascending in [0, 1).
    corner, middle : numbers of the corners, and of the midside node of the edge behind each (n,).
    """

    parameter: Real
    corner: Index
    middle: Index


@dataclass(frozen=True)
class CurvedMesh:
    """Nodes (n_nodes,) complex [mm], triangles (n, 6) counterclockwise: corners, then midside nodes 01, 12, 20."""

    nodes: Complex
    triangles: Index
    loops: tuple[Loop, ...]


@dataclass(frozen=True)
class EdgeLength:
    """Wanted edge length: that of the nearest source, growing away from it, never beyond the largest [mm]."""

    sources: tuple[tuple[KDTree, float], ...]
    growth: float
    largest_edge: float

    def __call__(self, points: Complex) -> Real:
        length = np.full(points.shape, self.largest_edge)
        for tree, edge in self.sources:
            length = np.minimum(length, edge + self.growth * tree.query(_plane(points))[0])
        return length


def curved_mesh(outer: Curve, cuts: tuple[Curve, ...], fine: Complex, edge: float, growth: float) -> CurvedMesh:
    """Mesh between the outer boundary and the cuts in it.

    Parameters
    ----------
    outer, cuts : boundaries that do not meet.
    fine : points (n,) about which edges have the length ``edge`` [mm].
    growth : of the edge length per unit of distance from there and from the boundaries [-].

    Raises
    ------
    ModelError
        The triangles do not fill the polygons of the boundaries' corners.
    """
    curves = (outer, *cuts)
    dense = [curve.samples(SAMPLES) for curve in curves]
    radius = float(np.abs(dense[0][1]).max())
    size = EdgeLength(_sources(curves, [points for _, points in dense], fine, edge), growth, radius)
    parameters = [_spread(curve, *samples, size) for curve, samples in zip(curves, dense, strict=True)]
    corners = [curve.point(parameter) for curve, parameter in zip(curves, parameters, strict=True)]
    polygons = [Path(_plane(loop)) for loop in corners]
    inner = _leaves(radius, size)
    distance = KDTree(_plane(np.concatenate([points for _, points in dense]))).query(_plane(inner))[0]
    inner = inner[_inside_outline(polygons, inner) & (distance > WALL * size(inner))]
    boundary_points = np.concatenate(corners)
    for _ in range(PASSES):
        inner = _smoothed_nodes(np.concatenate([boundary_points, inner]), len(boundary_points))
    points = np.concatenate([boundary_points, inner])
    triangles = _counterclockwise(points, Delaunay(_plane(points)).simplices)
    triangles = triangles[_inside_outline(polygons, points[triangles].mean(axis=1))]
    area = sum(sign * abs(_area(loop)) for sign, loop in zip([1] + [-1] * len(cuts), corners, strict=True))
    filled_area = np.sum(_cross(points[triangles])) / 2
    if not abs(filled_area - area) < AREA * area:
        raise ModelError(f"triangles fill {filled_area:.9g} mm2 of {area:.9g} mm2; take shorter edges")
    return _quadratic(points, triangles, curves, parameters)


def _sources(
    curves: tuple[Curve, ...], points: list[Complex], fine: Complex, edge: float
) -> tuple[tuple[KDTree, float], ...]:
    """Points from which edges of one length grow: the fine ones, and boundaries of equal edges together."""
    lengths = {curve.edge for curve in curves}
    sources = [
        ([curve_points for curve, curve_points in zip(curves, points, strict=True) if curve.edge == length], length)
        for length in lengths
    ]
    return tuple((KDTree(_plane(np.concatenate(parts))), length) for parts, length in [([fine], edge), *sources])


def _spread(curve: Curve, parameter: Real, points: Complex, size: EdgeLength) -> Real:
    """Parameters of the corners, as far apart as the edge length wants."""
    chord = np.abs(np.roll(points, -1) - points)
    edges: Real = np.concatenate([[0.0], np.cumsum(chord / size(points))])
    count = int(np.ceil(edges[-1]))
    if curve.has_even_corners:
        return np.arange(count) / count
    spread: Real = np.interp(np.arange(count) * edges[-1] / count, edges, np.append(parameter, 1.0))
    return spread


def _leaves(radius: float, size: EdgeLength) -> Complex:
    """Centres of the leaves of a quadtree, each no larger than the edge length wanted there."""
    cell, side, leaves = np.zeros(1, complex), 2 * radius, []
    while len(cell):
        split = side > size(cell)
        leaves.append(cell[~split])
        side /= 2
        quarter = 0.5 * side * np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
        cell = (cell[split, None] + quarter).ravel()
    return np.concatenate(leaves)


def _inside_outline(polygons: list[Path], points: Complex) -> np.ndarray:
    """Whether points lie inside the first polygon and outside of the others."""
    plane = _plane(points)
    is_inside = polygons[0].contains_points(plane)
    for polygon in polygons[1:]:
        is_inside &= ~polygon.contains_points(plane)
    return is_inside


def _smoothed_nodes(points: Complex, n_fixed: int) -> Complex:
    """Nodes behind the first ``fixed``, each moved to the mean of its neighbours."""
    first_neighbour, neighbour = Delaunay(_plane(points)).vertex_neighbor_vertices
    count = np.diff(first_neighbour)
    total: Complex = np.add.reduceat(points[neighbour], first_neighbour[:-1])
    means: Complex = (total / count)[n_fixed:]
    return means


def _quadratic(points: Complex, triangles: Index, curves: tuple[Curve, ...], parameters: list[Real]) -> CurvedMesh:
    """The triangles with midside nodes, those of the boundaries on their curves."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    middle = points[edges].mean(axis=1)
    edge_number = {(int(a), int(b)): k for k, (a, b) in enumerate(edges)}
    loops, start = [], 0
    for curve, parameter in zip(curves, parameters, strict=True):
        corner = start + np.arange(len(parameter))
        pairs = np.sort(np.stack([corner, np.roll(corner, -1)], axis=1), axis=1)
        middle_node = np.array([edge_number[int(a), int(b)] for a, b in pairs])
        middle[middle_node] = curve.point(0.5 * (parameter + np.append(parameter[1:], 1.0)))
        loops.append(Loop(parameter, corner, len(points) + middle_node))
        start += len(parameter)
    six = np.hstack([triangles, len(points) + number.reshape(-1, 3)])
    return CurvedMesh(np.concatenate([points, middle]), six, tuple(loops))


def _counterclockwise(points: Complex, triangles: Index) -> Index:
    return np.where((_cross(points[triangles]) < 0)[:, None], triangles[:, ::-1], triangles)


def _cross(corners: Complex) -> Real:
    """Twice the signed area of triangles (n, 3)."""
    a, b, c = corners.T
    return np.imag(np.conj(b - a) * (c - a))


def _area(polygon: Complex) -> float:
    return float(np.sum(np.imag(np.conj(polygon) * np.roll(polygon, -1))) / 2)


def _plane(points: Complex) -> Real:
    return np.stack([points.real, points.imag], axis=-1)

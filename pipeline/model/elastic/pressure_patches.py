"""Contact pressures spread over small patches of a meshed body.

Each patch carries the elliptical pressure p(x) = 2/(pi w) sqrt(1 - (x/w)^2) of a unit force, in one fixed
direction, x being the coordinate along the tangent as in Hertz's theory: spread over the arc length instead,
a patch of w/R = 1/3 would be stiff by 0.02 of 2/(pi E' t). Points are complex numbers x + iy [mm]; arrays
(n_patches,) or (n_patches, n_points).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree
from skfem import MeshTri

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError
from pipeline.model.elastic.polygon import ClosedPolygon, coordinates, cross, points_of

QUADRATURE_POINTS = 128  # per patch: compliances within 1e-4 of 2/(pi E' t), wherever the nodes lie under the patch
SPREADING_STEPS = 100  # each leaves 1 - cos(slope) of the error: enough up to a slope of 75 degrees
SPREADING_ERROR = 1e-9  # of the half width
NEAR_TRIANGLES = 24  # by centroid, among which the one that holds a point is looked for
ON_TRIANGLE = 1e-9  # tolerance of barycentric coordinates


@dataclass(frozen=True)
class Patches:
    """Unit forces on patches of a meshed body, as quadrature points inside its triangles.

    Attributes
    ----------
    points
        Where the pressure acts (n_patches, n_points) complex [mm].
    triangles, barycentric
        Triangle of each point (n_patches, n_points) and its coordinates there (n_patches, n_points, 3).
    weights
        Share of the force at each point (n_points,); they sum to 1.
    direction
        Of the force on the body (n_patches,), complex of length 1.
    """

    points: Complex
    triangles: Index
    barycentric: Real
    weights: Real
    direction: Complex

    def __len__(self) -> int:
        return len(self.direction)


def joined_patches(*patches: Patches) -> Patches:
    """All ``patches`` of one body in one, in their order."""
    return Patches(
        points=np.concatenate([p.points for p in patches]),
        triangles=np.concatenate([p.triangles for p in patches]),
        barycentric=np.concatenate([p.barycentric for p in patches]),
        weights=patches[0].weights,
        direction=np.concatenate([p.direction for p in patches]),
    )


def boundary_patches(
    mesh: MeshTri, boundary: str, contacts: ArrayLike, direction: ArrayLike, half_width: float
) -> Patches:
    """Patches on a closed boundary, centred where the contact points fall on its polygon.

    Parameters
    ----------
    mesh, boundary
        Mesh of straight triangles and the name of one of its boundaries, one closed loop.
    contacts
        Contact points (n_patches,) complex [mm], on the boundary's true curve.
    direction
        Of the force on the body, its inward normal (n_patches,) complex; the length is ignored.
    half_width
        Half width w of the pressure along the tangent, across ``direction`` [mm].

    Raises
    ------
    ValueError
        A contact lies farther from the boundary than an edge's length, or the boundary turns away under a patch.
    """
    contacts, normal = _vector(contacts), _unit_vector(direction)
    polygon, triangle_behind = _boundary_loop(mesh, boundary)
    distance, arc = polygon.distance_and_arc(contacts)
    longest_edge = np.diff(polygon.arc).max()
    if distance.max() > longest_edge:
        worst_patch = np.argmax(distance)
        raise ModelError(
            f"contact {worst_patch} at {contacts[worst_patch]:.6g} mm lies {distance[worst_patch]:.3g} mm off boundary "
            f"{boundary}; must be within an edge's length of it, {longest_edge:.3g} mm"
        )
    abscissa, weights = _elliptical_rule()
    arc = _spread(polygon, arc, -1j * normal, half_width * abscissa)
    edge, points = polygon.edge_and_point(arc)
    triangles = triangle_behind[edge]
    return Patches(points, triangles, _barycentric(mesh, triangles, points), weights, normal)


def line_patches(
    mesh: MeshTri, centres: ArrayLike, tangent: ArrayLike, direction: ArrayLike, half_width: float
) -> Patches:
    """Patches along straight segments inside the body.

    Parameters
    ----------
    mesh
        Mesh of straight triangles.
    centres, tangent, direction
        Centre [mm], direction of the segment and direction of the force (n_patches,) complex; the lengths
        of the last two are ignored.
    half_width
        Half width w of the pressure along the segment [mm].

    Raises
    ------
    ValueError
        A segment leaves the body.
    """
    abscissa, weights = _elliptical_rule()
    points = _vector(centres)[:, None] + half_width * _unit_vector(tangent)[:, None] * abscissa
    triangles, barycentric = _locate_points(mesh, points)
    return Patches(points, triangles, barycentric, weights, _unit_vector(direction))


def _spread(polygon: ClosedPolygon, arc: Real, tangent: Complex, abscissa: Real) -> Real:
    """Arc length where the tangent's coordinate from the foot at ``arc`` (n,) is ``abscissa`` (m,): (n, m) [mm]."""
    foot = polygon.edge_and_point(arc)[1][:, None]
    spread = arc[:, None] + abscissa
    for _ in range(SPREADING_STEPS):
        short = abscissa - np.real((polygon.edge_and_point(spread)[1] - foot) * np.conj(tangent)[:, None])
        if np.abs(short).max() <= SPREADING_ERROR * np.abs(abscissa).max():
            return spread
        spread = spread + short
    raise ModelError(
        f"a patch of half width {np.abs(abscissa).max():.3g} mm turns away from its force by more than the boundary "
        "allows: narrow it, or give the force the direction of the inward normal"
    )


def _elliptical_rule() -> tuple[Real, Real]:
    """Gauss-Chebyshev points (second kind) on -1..1 and the shares of the elliptical pressure at them."""
    angle = np.pi * np.arange(1, QUADRATURE_POINTS + 1) / (QUADRATURE_POINTS + 1)
    return np.cos(angle), 2 / (QUADRATURE_POINTS + 1) * np.sin(angle) ** 2


def _boundary_loop(mesh: MeshTri, boundary: str) -> tuple[ClosedPolygon, Index]:
    """A closed boundary as a polygon with the body on its left, and the triangle behind each edge (n_edges,)."""
    facets = mesh.boundaries[boundary]
    triangle = mesh.f2t[0, facets]
    start, end = mesh.facets[:, facets]
    vertices = points_of(mesh.p)
    centroid = vertices[mesh.t[:, triangle]].mean(axis=0)
    on_right = cross(vertices[end] - vertices[start], centroid - vertices[start]) < 0
    start, end = np.where(on_right, end, start), np.where(on_right, start, end)
    edge_from = dict(zip(start.tolist(), range(len(start)), strict=True))
    order = [0]
    while (following := edge_from[int(end[order[-1]])]) != 0:
        order.append(following)
    if len(order) != len(start):
        raise ValueError(f"boundary {boundary} has {len(start)} edges, {len(order)} in one loop; must be one loop")
    return ClosedPolygon.through(vertices[start[order]]), triangle[order]


def _locate_points(mesh: MeshTri, points: Complex) -> tuple[Index, Real]:
    """Triangle that holds each point, and the barycentric coordinates there; ``points`` of any shape."""
    vertices = points_of(mesh.p)
    neighbours = min(NEAR_TRIANGLES, mesh.t.shape[1])
    candidates = KDTree(coordinates(vertices[mesh.t].mean(axis=0))).query(coordinates(points), k=neighbours)[1]
    barycentric = _barycentric(mesh, candidates, points[..., None])
    best_triangle = np.argmax(barycentric.min(axis=-1), axis=-1)[..., None]
    triangles = np.take_along_axis(candidates, best_triangle, axis=-1)[..., 0]
    weights = np.take_along_axis(barycentric, best_triangle[..., None], axis=-2)[..., 0, :]
    is_outside = weights.min(axis=-1) < -ON_TRIANGLE
    if is_outside.any():
        raise ModelError(f"patch point {points[is_outside][0]:.6g} mm lies outside the body; move or narrow its patch")
    return triangles, weights


def _barycentric(mesh: MeshTri, triangles: Index, points: Complex) -> Real:
    """Barycentric coordinates of ``points`` in ``triangles`` (shapes broadcast): (..., 3)."""
    a, b, c = points_of(mesh.p)[mesh.t[:, triangles]]
    area = cross(b - a, c - a)
    beta, gamma = cross(points - a, c - a) / area, cross(b - a, points - a) / area
    return np.stack([1 - beta - gamma, beta, gamma], axis=-1)


def _vector(values: ArrayLike) -> Complex:
    return np.atleast_1d(np.asarray(values, complex))


def _unit_vector(values: ArrayLike) -> Complex:
    return _vector(values) / np.abs(_vector(values))

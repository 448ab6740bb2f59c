"""Round holes cut into the mesh of a lobed disk, each within graded rings of its own.

Rings of nodes surround every hole, their spacing growing away from it until the disk's own edges are finer; there the
disk's nodes go on. A few smoothing passes settle the nodes where the two meet. SciPy's Delaunay triangulation is all
that it takes. Points are complex numbers x + iy [mm] in the frame of the disk.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from skfem import MeshTri

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError
from pipeline.model.elastic.disk_mesh import CLEARANCE, ROW_HEIGHT
from pipeline.model.elastic.polygon import ClosedPolygon, coordinates, points_of
from pipeline.model.elastic.triangulation import patch_centroids, triangles_between

SPACING = 0.75  # in edge lengths: of two nodes that come closer, one of the disk and one of a hole's rings, one goes
SMOOTHING_PASSES = 12  # the smallest quality gains nothing after that
SMOOTHED_LAYERS = 4.0  # in edge lengths about the holes' rings: nodes farther away stay where they are
HOLE_EDGES = 120  # at least: a hole's corners cost a compliance less than 0.01 of 2/(pi E' t), 0.02 with 75 edges


def hole_boundary(hole: int) -> str:
    """Name of a hole's boundary in the mesh."""
    return f"hole_{hole}"


def perforated_mesh(disk: MeshTri, centres: Complex, radius: float, edge: float, growth: float) -> MeshTri:
    """The mesh of a disk with equal round holes.

    Parameters
    ----------
    disk
        Mesh of ``lobed_disk_mesh``.
    centres, radius
        Of the holes (n_holes,) complex [mm] and [mm]; they meet neither each other nor the disk's boundaries.
    edge
        Wanted edge length at the holes [mm]; they are finer where so few edges would make a poor circle.
    growth
        Growth of the edge length per unit of distance from a hole [-].

    Returns
    -------
    Mesh with the boundaries of ``disk`` and ``hole_0``, ``hole_1``, ... in the order of the centres.

    Raises
    ------
    ValueError
        The triangulation loses edges of a boundary: the walls about a hole are thinner than its edges.
    """
    n_around = max(HOLE_EDGES, round(2 * np.pi * radius / edge))
    size = _EdgeLength.from_disk(disk, centres, radius, 2 * np.pi * radius / n_around, growth)
    circle = radius * np.exp(2j * np.pi * np.arange(n_around) / n_around)
    holes = (centres[:, None] + circle).ravel()
    rings = _rings(size, n_around)
    flank, inner, bore = _disk_nodes(disk)
    nodes = _kept_nodes(size, inner, np.concatenate([holes, rings]))
    free_nodes = _relaxed_nodes(np.concatenate([nodes, rings]), np.concatenate([flank, bore, holes]), rings, size)
    points = np.concatenate([flank, free_nodes, holes, bore])
    ends = np.cumsum([len(flank), len(free_nodes), *[n_around] * len(centres), len(bore)])
    cuts = [np.arange(start, stop) for start, stop in zip(ends[1:-1], ends[2:], strict=True)]
    triangles = triangles_between(points, len(flank), cuts)
    names = {hole_boundary(k): corners for k, corners in enumerate(cuts[:-1])}
    loops = {"flank": np.arange(len(flank)), **names} | ({"bore": cuts[-1]} if len(bore) else {})
    return _with_boundary_names(MeshTri(coordinates(points).T.copy(), triangles.T.copy()), loops)


@dataclass(frozen=True)
class _EdgeLength:
    """Wanted edge length [mm]: the disk's own, or less near a hole."""

    nodes: KDTree
    of_nodes: Real
    flank: ClosedPolygon
    bore_radius: float
    centres: Complex
    radius: float
    at_hole: float
    growth: float

    @classmethod
    def from_disk(cls, disk: MeshTri, centres: Complex, radius: float, edge: float, growth: float) -> "_EdgeLength":
        nodes = points_of(disk.p)
        ends = disk.facets
        length = np.abs(nodes[ends[1]] - nodes[ends[0]])
        total, number = (np.bincount(ends.ravel(), weights=w) for w in (np.tile(length, 2), np.ones(ends.size)))
        flank, _, bore = _disk_nodes(disk)
        bore_radius = float(np.abs(bore[0])) if len(bore) else 0.0
        tree = KDTree(coordinates(nodes))
        return cls(
            nodes=tree,
            of_nodes=total / number,
            flank=ClosedPolygon.through(flank),
            bore_radius=bore_radius,
            centres=centres,
            radius=radius,
            at_hole=edge,
            growth=growth,
        )

    def of_disk(self, points: Complex) -> Real:
        lengths: Real = self.of_nodes[self.nodes.query(coordinates(points))[1]]
        return lengths

    def hole_distance(self, points: Complex) -> Real:
        """Distance from the edge of the nearest hole, negative inside it."""
        distance: Real = KDTree(coordinates(self.centres)).query(coordinates(points))[0]
        return distance - self.radius

    def of_holes(self, points: Complex) -> Real:
        return self.at_hole + self.growth * np.maximum(self.hole_distance(points), 0.0)

    def __call__(self, points: Complex) -> Real:
        return np.minimum(self.of_disk(points), self.of_holes(points))

    def inside(self, points: Complex, edge: Real) -> np.ndarray:
        """Whether points lie in the disk, no closer to a boundary than is good for edges of the length ``edge``."""
        distance, arc = self.flank.distance_and_arc(points)
        foot = self.flank.edge_and_point(arc)[1]
        is_inside = (np.abs(points) < np.abs(foot)) & (distance > CLEARANCE * edge)
        return is_inside & (np.abs(points) > self.bore_radius + CLEARANCE * edge * (self.bore_radius > 0))


def _disk_nodes(disk: MeshTri) -> tuple[Complex, Complex, Complex]:
    """Nodes of the flank in their order, those inside, and those of the bore."""
    nodes = points_of(disk.p)
    on_flank = np.unique(disk.facets[:, disk.boundaries["flank"]])
    bore = disk.boundaries.get("bore")
    on_bore = np.unique(disk.facets[:, bore]) if bore is not None else np.zeros(0, int)
    interior = np.setdiff1d(np.arange(len(nodes)), np.concatenate([on_flank, on_bore]))
    return nodes[on_flank], nodes[interior], nodes[on_bore]


def _rings(size: _EdgeLength, n_around: int) -> Complex:
    """Nodes on staggered rings about every hole, where they are finer than the disk's own and nearest to their hole."""
    ring, depth, row = [], 0.0, 0
    while True:
        row += 1
        depth += ROW_HEIGHT * (size.at_hole + size.growth * depth) * (1 + 0.5 * ROW_HEIGHT * size.growth)
        edge = size.at_hole + size.growth * depth
        radius = size.radius + depth
        n_nodes = round(2 * np.pi * radius / edge) if row > 1 else n_around
        angle = (np.arange(n_nodes) + 0.5 * (row % 2)) / n_nodes
        points = (size.centres[:, None] + radius * np.exp(2j * np.pi * angle)).ravel()
        of_hole = np.abs(size.hole_distance(points) - depth) < 1e-9 * radius
        local = np.full(len(points), edge)
        points = points[of_hole & (local < size.of_disk(points)) & size.inside(points, local)]
        if not len(points):
            break
        ring.append(points)
    return _thin_points(np.concatenate(ring), size) if ring else np.zeros(0, complex)


def _thin_points(points: Complex, size: _EdgeLength) -> Complex:
    """``points`` without those that come too close to an earlier one."""
    limit = SPACING * size.of_holes(points)
    pairs = KDTree(coordinates(points)).query_pairs(float(limit.max()), output_type="ndarray")
    finer, second = pairs.min(axis=1), pairs.max(axis=1)
    close = np.abs(points[finer] - points[second]) < limit[second]
    is_removed = np.zeros(len(points), bool)
    for early, late in sorted(zip(finer[close], second[close], strict=True)):
        is_removed[late] |= not is_removed[early]
    return points[~is_removed]


def _kept_nodes(size: _EdgeLength, inner: Complex, of_holes: Complex) -> Complex:
    """The disk's inner nodes that lie in no hole and not too close to the nodes about one."""
    edge = size(inner)
    distance = KDTree(coordinates(of_holes)).query(coordinates(inner))[0]
    of_disk = size.of_disk(inner) <= size.of_holes(inner)
    kept: Complex = inner[of_disk & (size.hole_distance(inner) > CLEARANCE * edge) & (distance > SPACING * edge)]
    return kept


def _relaxed_nodes(free_nodes: Complex, fixed_nodes: Complex, rings: Complex, size: _EdgeLength) -> Complex:
    """``free`` nodes about the holes moved to the centroids of their patches of triangles (as in ``meshing``)."""
    if not len(rings):
        return free_nodes
    near_rings = KDTree(coordinates(rings)).query(coordinates(free_nodes))[0] < SMOOTHED_LAYERS * size(free_nodes)
    moving, fixed_points = free_nodes[near_rings], np.concatenate([free_nodes[~near_rings], fixed_nodes])
    for _ in range(SMOOTHING_PASSES):
        moving = _smoothed_nodes(moving, fixed_points, size)
    return np.concatenate([moving, free_nodes[~near_rings]])


def _smoothed_nodes(moving: Complex, fixed_points: Complex, size: _EdgeLength) -> Complex:
    """``moving`` nodes at the centroids of their patches, where these keep off flank, bore and holes."""
    centroids = patch_centroids(np.concatenate([moving, fixed_points]), len(moving), size)
    edge = size(centroids)
    good = size.inside(centroids, edge) & (size.hole_distance(centroids) > CLEARANCE * edge)
    return np.where(good, centroids, moving)


def _with_boundary_names(mesh: MeshTri, loops: dict[str, Index]) -> MeshTri:
    """The mesh with its boundaries named, once each is seen to be the closed polygon of its nodes and no other."""
    facets = mesh.boundary_facets()
    owner = np.full(mesh.nvertices, -1)
    for number, corners in enumerate(loops.values()):
        owner[corners] = number
    ends = owner[mesh.facets[:, facets]]
    boundaries = {}
    for number, (name, corners) in enumerate(loops.items()):
        of_boundary = facets[(ends == number).all(axis=0)]
        sorted_edges = np.sort([corners, np.roll(corners, -1)], axis=0)
        if not np.array_equal(_sorted_edges(sorted_edges), _sorted_edges(np.sort(mesh.facets[:, of_boundary], axis=0))):
            raise ModelError(
                f"the mesh holds {len(of_boundary)} edges of {name}, of {len(corners)}: the walls about the holes are "
                "too thin for these edges; take a smaller patch half width or less growth"
            )
        boundaries[name] = of_boundary
    if sum(map(len, boundaries.values())) != len(facets):
        raise ModelError("the mesh has edges between two of its boundaries: the walls about the holes are too thin")
    return mesh.with_boundaries(boundaries)


def _sorted_edges(edges: Index) -> Index:
    return edges[:, np.lexsort(edges)]

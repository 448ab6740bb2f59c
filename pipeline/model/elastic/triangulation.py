"""Delaunay triangles of given nodes: inside a flank and outside cut-outs, and of a disk of equal sectors.

Points are complex numbers x + iy [mm].
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import Delaunay

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError
from pipeline.model.elastic.polygon import coordinates, cross

STRIP = 5  # sectors triangulated at once: what lies beyond two neighbours does not touch a triangle of the middle one
TIE_BREAK = 1e-5  # of a flank edge, off the nodes' places: nodes on one circle have several Delaunay triangulations
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Turn from point to point [rad] that never lines them up."""


def triangles_between(points: Complex, n_flank: int, cuts: Sequence[Index]) -> Index:
    """Delaunay triangles of ``points`` inside the flank and outside the cuts, counterclockwise, (n_triangles, 3).

    Parameters
    ----------
    points
        (n_points,) complex [mm], the flank's ``n_flank`` corners first.
    cuts
        Points on the edge of each convex cut-out (bore, hole), in which no point lies.
    """
    triangles = Delaunay(coordinates(points)).simplices
    a, b, c = points[triangles.T]
    clockwise = cross(b - a, c - a) < 0
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    smallest_corner = np.argmin(triangles, axis=1)
    ordered_triangles = np.take_along_axis(triangles, (smallest_corner[:, None] + np.arange(3)) % 3, axis=1)
    # Three corners of a simple polygon follow counterclockwise in their own order inside it, in reverse outside.
    is_outside = (triangles < n_flank).all(axis=1) & (ordered_triangles[:, 1] > ordered_triangles[:, 2])
    cut = np.full(len(points), -1)
    for number, corners in enumerate(cuts):
        cut[corners] = number
    of_corner: Index = cut[triangles]
    is_outside |= (of_corner[:, 0] >= 0) & (of_corner == of_corner[:, :1]).all(axis=1)
    inside: Index = triangles[~is_outside]
    return inside


def patch_centroids(points: Complex, n_moving: int, edge_length: Callable[[Complex], Real]) -> Complex:
    """Centroids (n_moving,) [mm] of the triangles at each of the first points, weighted by area / edge length^2.

    Parameters
    ----------
    points
        (n_points,) complex [mm]
    edge_length
        Wanted length [mm] of an edge at each place (n,) complex [mm].

    Source
    ------
    Chen and Holst, Comput. Methods Appl. Mech. Engrg. 200 (2011) 967: centroid of patch (CPT) smoothing.
    """
    triangles = Delaunay(coordinates(points)).simplices
    triangles = triangles[(triangles < n_moving).any(axis=1)]
    a, b, c = points[triangles.T]
    centroid = np.asarray((a + b + c) / 3, complex)
    weight = np.abs(cross(b - a, c - a)) / edge_length(centroid) ** 2
    moment, total = np.zeros(len(points), complex), np.zeros(len(points))
    for corner in triangles.T:
        np.add.at(moment, corner, weight * centroid)
        np.add.at(total, corner, weight)
    return np.asarray(moment[:n_moving] / total[:n_moving], complex)


def cyclic_triangulation(lobe: Complex, inner: Complex, n_bore: int, n_sectors: int) -> tuple[Complex, Index]:
    """Nodes and triangles of a disk of equal sectors: the triangles of each are those of the one before, turned.

    Parameters
    ----------
    lobe
        Nodes of one sector's flank (n_lobe,) complex [mm], counterclockwise.
    inner
        The sector's other nodes (n_inner,) complex [mm], those of the bore last and counterclockwise.
    n_bore
        Number of the sector's nodes on the bore; 0 is a solid disk, which has a node in its centre.
    n_sectors
        Number of sectors, at least 3.

    Returns
    -------
    points
        (n_points,) complex [mm]: the flank's corners sector by sector, the other nodes sector by sector, the centre.
    triangles
        (n_sectors * n_triangles, 3), counterclockwise: those of the first sector, then as many of the next, ...

    Raises
    ------
    ValueError
        The triangles do not close to a disk: the nodes are too coarse for its sectors.

    Notes
    -----
    A triangle belongs to the earlier of the two sectors in which its corners lie.
    """
    nodes = np.concatenate([lobe, inner])
    shift = TIE_BREAK * np.abs(lobe[1] - lobe[0]) * np.exp(1j * GOLDEN_ANGLE * np.arange(len(nodes)))
    n_strip = min(n_sectors, STRIP)
    turns, pitch = np.arange(n_strip) - n_strip // 2, 2 * np.pi / n_sectors
    number = _numbers(n_strip, len(lobe), len(inner))
    bore = number[:, len(nodes) - n_bore : -1].ravel()
    points = _rotated_nodes(number, nodes + shift, np.asarray(turns * pitch, float), n_bore == 0)
    strip = triangles_between(points, n_strip * len(lobe), [bore])
    turn, node = np.full(number.max() + 1, np.nan), np.full(number.max() + 1, len(nodes))
    turn[number[:, :-1]] = turns[:, None]
    node[number[:, :-1]] = np.arange(len(nodes))
    corner_turn, corner = turn[strip], node[strip]
    is_in_sector = (np.nanmin(corner_turn, axis=1) == 0) & (np.nanmax(corner_turn, axis=1) <= 1)
    sector = np.arange(n_sectors)[:, None, None] + np.nan_to_num(corner_turn[is_in_sector]).astype(int)
    number = _numbers(n_sectors, len(lobe), len(inner))
    triangles = number[sector % n_sectors, corner[is_in_sector]].reshape(-1, 3)
    points = _rotated_nodes(number, nodes, pitch * np.arange(n_sectors, dtype=float), n_bore == 0)
    n_boundary = n_sectors * (len(lobe) + n_bore)
    if len(triangles) != 2 * len(points) - n_boundary - 2 * (n_bore == 0):  # Euler's formula
        raise ModelError(
            f"{len(triangles)} triangles of {len(points)} nodes make no disk of {n_sectors} equal sectors; take a "
            "smaller largest_edge, or more edges per lobe"
        )
    return points, triangles


def _numbers(n_sectors: int, n_lobe: int, n_inner: int) -> Index:
    """Number of every node of every sector, the flank's first, and in the last column the centre's."""
    flank = np.arange(n_sectors * n_lobe).reshape(n_sectors, n_lobe)
    inner = flank.size + np.arange(n_sectors * n_inner).reshape(n_sectors, n_inner)
    return np.hstack([flank, inner, np.full((n_sectors, 1), flank.size + inner.size)])


def _rotated_nodes(number: Index, nodes: Complex, angle: Real, solid: bool) -> Complex:
    """The ``nodes`` of one sector turned by every ``angle`` [rad], in their numbers, and a solid disk's centre."""
    points = np.zeros(number[:, :-1].size + solid, complex)
    points[number[:, :-1]] = np.exp(1j * angle)[:, None] * nodes
    return points

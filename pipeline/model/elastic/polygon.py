"""Closed polygons: the meshed boundary of a body, its arc length, and the nearest point on it.

Points are complex numbers x + iy [mm].
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from pipeline.arrays import Complex, Index, Real


def points_of(rows: Real) -> Complex:
    """Points (n,) from rows (2, n) of their x and y, as a mesh has them."""
    points: Complex = rows[0] + 1j * rows[1]
    return points


def coordinates(points: Complex) -> Real:
    """x and y of complex points (...), as (..., 2) [mm]."""
    return np.stack([points.real, points.imag], axis=-1)


def cross(a: Complex, b: Complex) -> Real:
    """Cross product a_x b_y - a_y b_x of plane vectors (...) as complex numbers, in the product of their units."""
    return np.imag(np.conj(a) * b)


def arc_length(points: Complex) -> Real:
    """Length along the chain of ``points`` (n,) from the first to each of them (n,) [mm]."""
    return np.concatenate([[0], np.cumsum(np.abs(np.diff(points)))])


@dataclass(frozen=True)
class ClosedPolygon:
    """A closed polygon with edges of similar length; edge k runs from corner k to corner k + 1.

    Attributes
    ----------
    corners
        (n_edges,) complex [mm].
    arc
        Length from corner 0 to every corner, and the whole length last (n_edges + 1,) [mm].
    tree
        Search tree over the corners.
    """

    corners: Complex
    arc: Real
    tree: KDTree

    @classmethod
    def through(cls, corners: Complex) -> "ClosedPolygon":
        """The polygon through ``corners`` (n_edges,) complex [mm], in their order."""
        return cls(corners, arc_length(np.append(corners, corners[0])), KDTree(coordinates(corners)))

    @property
    def length(self) -> float:
        """Length of the whole polygon [mm]."""
        return float(self.arc[-1])

    def distance_and_arc(self, points: Complex) -> tuple[Real, Real]:
        """Distance of ``points`` from the polygon, and the arc length at the nearest point of it [mm].

        Notes
        -----
        Looks at the two edges that meet in the nearest corner, which is right where edges are of similar length
        and shorter than the polygon's radius of curvature.
        """
        corner = self.tree.query(coordinates(points))[1]
        edges = np.stack([corner - 1, corner]) % len(self.corners)
        start = self.corners[edges]
        edge = self.corners[(edges + 1) % len(self.corners)] - start
        share = np.clip(np.real((points - start) * np.conj(edge)) / np.abs(edge) ** 2, 0, 1)
        distance = np.abs(points - start - share * edge)
        arc = self.arc[edges] + share * np.abs(edge)
        second = distance[1] < distance[0]
        return np.where(second, distance[1], distance[0]), np.where(second, arc[1], arc[0])

    def edge_and_point(self, arc: Real) -> tuple[Index, Complex]:
        """Edge and point at the arc length ``arc`` [mm], counted round and round."""
        wrapped_arc = np.mod(arc, self.length)
        edge = np.clip(np.searchsorted(self.arc, wrapped_arc, side="right") - 1, 0, len(self.corners) - 1)
        share = (wrapped_arc - self.arc[edge]) / np.diff(self.arc)[edge]
        start = self.corners[edge]
        return edge, start + share * (self.corners[(edge + 1) % len(self.corners)] - start)

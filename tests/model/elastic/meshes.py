"""Sizes of a triangle mesh, from its points alone."""

import numpy as np


def mesh_area(mesh):
    a, b, c = (mesh.p[0] + 1j * mesh.p[1])[mesh.t]
    return np.abs(np.imag(np.conj(b - a) * (c - a))).sum() / 2


def triangle_quality(mesh):
    """4 sqrt(3) area / (sum of squared edges): 1 = equilateral, 0 = flat; Bank and Smith, SIAM J. Numer. Anal. 34."""
    a, b, c = (mesh.p[0] + 1j * mesh.p[1])[mesh.t]
    area = np.abs(np.imag(np.conj(b - a) * (c - a))) / 2
    return 4 * np.sqrt(3) * area / (abs(b - a) ** 2 + abs(c - b) ** 2 + abs(a - c) ** 2)


def edge_lengths(mesh, facets):
    ends = mesh.p[:, mesh.facets[:, facets]]
    return np.hypot(*(ends[:, 1] - ends[:, 0]))

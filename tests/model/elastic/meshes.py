"""Sizes of a triangle mesh, from its points alone."""

import numpy as np


def mesh_area(mesh):
    a, b, c = (mesh.p[0] + 1j * mesh.p[1])[mesh.t]
    return np.abs(np.imag(np.conj(b - a) * (c - a))).sum() / 2


def edge_lengths(mesh, facets):
    ends = mesh.p[:, mesh.facets[:, facets]]
    return np.hypot(*(ends[:, 1] - ends[:, 0]))

"""Means of a curve that is given by its corners over stretches of its abscissa."""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import Real

APART = 1e-6
"""Share of the curve's range below which a stretch is a point."""


@part
def _corner(x, position):
    """Number of the segment (the end ones continued) in which a place lies."""
    low, high = 0, x.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] < position:
            low = middle
        else:
            high = middle
    return low


@entry
def _means(edges, x, y, mean, slope):
    """See ``means``."""
    n = x.shape[0]
    area, rise = np.zeros(n), np.empty(n - 1)
    for j in range(n - 1):
        width = max(x[j + 1] - x[j], 1e-12)
        rise[j] = (y[j + 1] - y[j]) / width
        area[j + 1] = area[j] + 0.5 * width * (y[j + 1] + y[j])
    smallest_step = APART * (x[-1] - x[0])
    for cell in range(edges.shape[0]):
        total, value, area_before, first_value, first_rise = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(edges.shape[1]):
            j = _corner(x, edges[cell, k])
            distance = edges[cell, k] - x[j]
            value_here = y[j] + rise[j] * distance
            area_here = area[j] + distance * (y[j] + 0.5 * rise[j] * distance)
            if k == 0:
                first_value, first_rise = value_here, rise[j]
            else:
                step = edges[cell, k] - edges[cell, k - 1]
                total += (area_here - area_before) / step if step > smallest_step else 0.5 * (value_here + value)
            value, area_before = value_here, area_here
        cell_width = edges[cell, -1] - edges[cell, 0]
        mean[cell] = total / (edges.shape[1] - 1)
        slope[cell] = (value - first_value) / cell_width if cell_width > smallest_step else first_rise


def means(edges: Real, x: Real, y: Real) -> tuple[Real, Real]:
    """Mean and slope over cells of the polyline (x ascending, y), its ends continued.

    Parameters
    ----------
    edges : (n_cells, n_edges) ascending edges of the parts of each cell, which count alike.
    x, y : (n_corners,)

    Returns
    -------
    Mean (n_cells,) and slope (n_cells,) from the first edge to the last; exact but for rounding. A part narrower than
    ``APART`` of the curve counts as the point in its middle.
    """
    mean, slope = np.empty(len(edges)), np.empty(len(edges))
    _means(np.ascontiguousarray(edges), np.ascontiguousarray(x), np.ascontiguousarray(y), mean, slope)
    return mean, slope

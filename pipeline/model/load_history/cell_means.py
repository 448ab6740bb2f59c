"""Means of a curve that is given by its corners over stretches of its abscissa."""

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import Real

APART = 1e-6
"""Share of the curve's range below which a stretch is a point."""


@part
def _corner(x, place):
    """Number of the segment (the end ones continued) in which a place lies."""
    low, high = 0, x.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] < place:
            low = middle
        else:
            high = middle
    return low


@entry
def _means(at, x, y, mean, slope):
    """See ``means``."""
    n = x.shape[0]
    area, rise = np.zeros(n), np.empty(n - 1)
    for j in range(n - 1):
        width = max(x[j + 1] - x[j], 1e-12)
        rise[j] = (y[j + 1] - y[j]) / width
        area[j + 1] = area[j] + 0.5 * width * (y[j + 1] + y[j])
    smallest_step = APART * (x[-1] - x[0])
    for cell in range(at.shape[0]):
        total, value, under, first_value, first_rise = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(at.shape[1]):
            j = _corner(x, at[cell, k])
            along = at[cell, k] - x[j]
            value_here = y[j] + rise[j] * along
            below = area[j] + along * (y[j] + 0.5 * rise[j] * along)
            if k == 0:
                first_value, first_rise = value_here, rise[j]
            else:
                step = at[cell, k] - at[cell, k - 1]
                total += (below - under) / step if step > smallest_step else 0.5 * (value_here + value)
            value, under = value_here, below
        cell_width = at[cell, -1] - at[cell, 0]
        mean[cell] = total / (at.shape[1] - 1)
        slope[cell] = (value - first_value) / cell_width if cell_width > smallest_step else first_rise


def means(at: Real, x: Real, y: Real) -> tuple[Real, Real]:
    """Mean and slope over cells of the polyline (x ascending, y), its ends continued.

    Parameters
    ----------
    at : (n_cells, n_edges) ascending edges of the parts of each cell, which count alike.
    x, y : (n_corners,)

    Returns
    -------
    Mean (n_cells,) and slope (n_cells,) from the first edge to the last; exact but for rounding. A part narrower than
    ``APART`` of the curve counts as the point in its middle.
    """
    mean, slope = np.empty(len(at)), np.empty(len(at))
    _means(np.ascontiguousarray(at), np.ascontiguousarray(x), np.ascontiguousarray(y), mean, slope)
    return mean, slope

"""Means of a curve that is given by its corners over stretches of its abscissa."""

import numpy as np

from pipeline.arrays import Index, Real, Truth
from pipeline.model.compiled import entry, part

SMALLEST_SPACING = 1e-6
"""Share of the curve's range below which a stretch is a point."""


@part
def _corner(x: Real, position: float) -> int:
    """Number of the segment (the end ones continued) in which a place lies."""
    low, high = 0, x.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] < position:
            low = middle
        else:
            high = middle
    return low


@part
def _integrate(x: Real, y: Real, area: Real, rise: Real) -> None:
    """Area below the polyline up to each corner, and the rise of each segment."""
    area[0] = 0.0
    for j in range(x.shape[0] - 1):
        width = max(x[j + 1] - x[j], 1e-12)
        rise[j] = (y[j + 1] - y[j]) / width
        area[j + 1] = area[j] + 0.5 * width * (y[j + 1] + y[j])


@part
def _of_cell(edges: Real, x: Real, y: Real, area: Real, rise: Real, smallest_step: float) -> tuple[float, float]:
    """Mean and slope over one cell."""
    total, value, area_before, first_value, first_rise = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(edges.shape[0]):
        j = _corner(x, edges[k])
        distance = edges[k] - x[j]
        value_here = y[j] + rise[j] * distance
        area_here = area[j] + distance * (y[j] + 0.5 * rise[j] * distance)
        if k == 0:
            first_value, first_rise = value_here, rise[j]
        else:
            step = edges[k] - edges[k - 1]
            total += (area_here - area_before) / step if step > smallest_step else 0.5 * (value_here + value)
        value, area_before = value_here, area_here
    cell_width = edges[-1] - edges[0]
    slope = (value - first_value) / cell_width if cell_width > smallest_step else first_rise
    return total / (edges.shape[0] - 1), slope


@entry
def _means(edges: Real, x: Real, y: Real, mean: Real, slope: Real) -> None:
    """See ``means``."""
    area, rise = np.empty(x.shape[0]), np.empty(x.shape[0] - 1)
    _integrate(x, y, area, rise)
    smallest_step = SMALLEST_SPACING * (x[-1] - x[0])
    for cell in range(edges.shape[0]):
        mean[cell], slope[cell] = _of_cell(edges[cell], x, y, area, rise, smallest_step)


@entry
def _means_along(
    edges: Real, leg: Index, corners: Real, ends: Index, is_wanted: Truth, mean: Real, slope: Real
) -> None:
    """See ``means_along``."""
    longest = 1 + np.max(ends[:, 1] - ends[:, 0])
    abscissa, ordinate, area, rise = np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest)
    is_followed = np.zeros(ends.shape[0], np.bool_)
    is_followed[leg[is_wanted]] = True
    for number in range(ends.shape[0]):
        first_corner, last_corner, sense = ends[number, 0], ends[number, 1], ends[number, 2]
        n = last_corner - first_corner + 1
        x, y = abscissa[:n], ordinate[:n]
        for i in range(n if is_followed[number] else 0):
            x[i] = corners[0, first_corner + i if sense > 0 else last_corner - i]
        smallest_step = SMALLEST_SPACING * (x[-1] - x[0])
        for row in range(1, corners.shape[0] if is_followed[number] else 0):
            for i in range(n):
                y[i] = corners[row, first_corner + i if sense > 0 else last_corner - i]
            _integrate(x, y, area, rise)
            for cell in range(edges.shape[0]):
                if leg[cell] == number and is_wanted[cell]:
                    mean[row - 1, cell], slope[row - 1, cell] = _of_cell(edges[cell], x, y, area, rise, smallest_step)


def means(edges: Real, x: Real, y: Real) -> tuple[Real, Real]:
    """Mean and slope over cells of the polyline (x ascending, y), its ends continued.

    Parameters
    ----------
    edges : (n_cells, n_edges) ascending edges of the parts of each cell, which count alike.
    x, y : (n_corners,)

    Returns
    -------
    Mean (n_cells,) and slope (n_cells,) from the first edge to the last; exact but for rounding. A part narrower than
    ``SMALLEST_SPACING`` of the curve counts as the point in its middle.
    """
    mean, slope = np.empty(len(edges)), np.empty(len(edges))
    _means(np.ascontiguousarray(edges), np.ascontiguousarray(x), np.ascontiguousarray(y), mean, slope)
    return mean, slope


def means_along(edges: Real, leg: Index, corners: Real, ends: Index, is_wanted: Truth, mean: Real, slope: Real) -> None:
    """Means and slopes, as ``means``, over the cells of a path that turns back: each on its own leg of it.

    Parameters
    ----------
    edges : (n_cells, n_edges) ascending edges of the parts of each cell.
    leg : (n_cells,) leg of the path on which each cell lies.
    corners : (1 + n_values, n_corners) abscissa of the path and values along it.
    ends : (n_legs, 3) first and last corner of each leg; 1 where its abscissa rises, -1 where it falls.
    is_wanted : (n_cells,) whether a cell is wanted.
    mean, slope : (n_values, n_cells), of which the cells wanted are filled.
    """
    _means_along(np.ascontiguousarray(edges), leg, np.ascontiguousarray(corners), ends, is_wanted, mean, slope)


def mean_torque(edges: Real) -> Real:
    """Mean (n_cells,) of torques within cells (n_cells, n_edges), as many rows between any two."""
    return np.asarray((0.5 * (edges[:, 1:] + edges[:, :-1])).mean(axis=1))

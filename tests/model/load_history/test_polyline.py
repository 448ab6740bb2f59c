"""Means of a polyline over cells against the integral of its segments by SciPy."""

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.model.load_history.cell_means import means, means_along

X = np.array([-3.0, -1.0, -0.5, 0.0, 2.0, 5.0])
Y = np.array([-1.0, -0.8, 0.3, 0.3, 2.0, 2.5])


def curve(x):
    """The polyline, its end segments continued."""
    if x < X[0]:
        return Y[0] + (x - X[0]) * (Y[1] - Y[0]) / (X[1] - X[0])
    if x > X[-1]:
        return Y[-1] + (x - X[-1]) * (Y[-1] - Y[-2]) / (X[-1] - X[-2])
    return np.interp(x, X, Y)


def mean(low, high):
    corners = [x for x in X if low < x < high]
    return quad(curve, low, high, points=corners or None, epsabs=1e-13)[0] / (high - low)


@pytest.mark.parametrize("edges", [(-0.9, -0.6), (-4.5, -3.5), (-2.0, 4.0), (4.0, 7.0), (-5.0, 8.0)])
def test_mean_of_a_cell_is_its_integral(edges):
    result, slope = means(np.array([edges]), X, Y)
    assert result[0] == pytest.approx(mean(*edges), abs=1e-12)
    assert slope[0] == pytest.approx((curve(edges[1]) - curve(edges[0])) / (edges[1] - edges[0]))


def test_parts_of_a_cell_count_alike_whatever_their_width():
    edges = np.array([-2.0, -1.9, 1.0, 4.0])
    result, _ = means(edges[None], X, Y)
    assert result[0] == pytest.approx(np.mean([mean(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]))


def test_a_part_without_width_is_a_point():
    result, slope = means(np.full((1, 4), 1.0), X, Y)
    assert result[0] == pytest.approx(curve(1.0))
    assert slope[0] == pytest.approx(0.85)


def test_a_jump_counts_on_both_sides_of_its_place():
    x, y = np.array([-1.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0, 2.0])
    result, slope = means(np.array([[-0.5, 0.5], [-0.25, 0.75], [-0.9, -0.1]]), x, y)
    np.testing.assert_allclose(result, [1.0, 1.5, 0.0], atol=1e-11)
    np.testing.assert_allclose(slope, [2.0, 2.0, 0.0], atol=1e-11)


def test_cells_of_a_path_that_turns_back_are_those_of_each_leg_by_itself():
    """A leg that falls is read from its end; cells of a leg that is not followed are left alone."""
    x = np.array([0.0, 0.7, 2.0, 1.1, -1.5, -0.4, 1.8])
    corners = np.array([x, x**3, np.cos(x)])
    ends = np.array([[0, 2, 1], [2, 4, -1], [4, 6, 1]])
    edges = np.array([[0.1, 0.5, 1.9], [-1.2, 0.3, 0.9], [-0.2, 0.0, 1.95], [0.2, 0.3, 0.3]])
    leg = np.array([0, 1, 1, 2])
    mean, slope = np.full((2, 4), 9.0), np.full((2, 4), 9.0)
    means_along(edges, leg, corners, ends, np.array([True, True, True, False]), mean, slope)
    for cell, sides in enumerate([slice(0, 3), slice(4, 1, -1), slice(4, 1, -1)]):
        for row in (0, 1):
            expected = means(edges[cell : cell + 1], corners[0, sides], corners[1 + row, sides])
            assert (mean[row, cell], slope[row, cell]) == (expected[0][0], expected[1][0])
    assert np.all(mean[:, 3] == 9.0)
    assert np.all(slope[:, 3] == 9.0)

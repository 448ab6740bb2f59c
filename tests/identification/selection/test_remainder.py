"""What a model leaves, in parts: alike at all positions, and of each position."""

import numpy as np
import pytest
from linear_unit import linear_data

from pipeline.identification.selection.statements.remainder import TORQUE_BINS, remainder

BRANCHES, CELLS = 2, 2 * TORQUE_BINS


def unit(residual):
    """Data whose angles are ``residual(position, torque share, sense)``; falling and rising branches alternate."""
    data = linear_data(positions=3, cycles=2, branches=BRANCHES, cells=CELLS)
    coordinate = np.tile(np.linspace(-1, 1, CELLS), len(data) // CELLS)
    sense = np.where(data.block % 2 == 0, 1.0, -1.0)
    data.torque[:] = coordinate * sense
    data.angle[:] = residual(data.position, data.torque, sense)
    return data, sense


def test_sense_of_loading_is_that_of_the_torque():
    data, sense = unit(lambda position, torque, sense: 0 * torque)
    np.testing.assert_array_equal(data.senses, sense)


def test_parts_of_a_residual_are_found_again():
    data, _ = unit(
        lambda position, torque, sense: 3.0 * sense + np.array([1.0, -1.0, 0.0])[position] * sense + position
    )
    remainder_found = remainder(data, np.zeros(len(data)), np.ones(len(data), bool), 2.0, 8.0)
    assert remainder_found.removed == 0.75
    assert remainder_found.common_arcmin == pytest.approx(3.0)
    assert remainder_found.scatter.size == pytest.approx(1.0, rel=0.01)  # of a position, from the population's mean
    assert remainder_found.scatter.ci_low > 0.5
    assert remainder_found.rms_arcmin == pytest.approx(np.sqrt(9 + 2 / 3))


def test_one_position_has_no_scatter_between_positions():
    data, _ = unit(lambda position, torque, sense: sense)
    remainder_found = remainder(data, np.zeros(len(data)), data.position == 0, 2.0, 8.0)
    assert remainder_found.scatter is None
    assert remainder_found.common_arcmin == pytest.approx(1.0)

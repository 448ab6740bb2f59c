"""What is left out at once."""

import numpy as np
import pytest
from linear_unit import linear_data

from pipeline.identification.selection.held_out import angle_error, splits_of


@pytest.mark.parametrize(
    ("positions", "lots"), [(2, [[0], [1]]), (6, [[k] for k in range(6)]), (7, [[0, 3, 6], [1, 4], [2, 5]])]
)
def test_many_positions_are_left_out_in_lots_that_hold_each_once(positions, lots):
    data = linear_data(positions=positions, cells=6)
    everything = np.ones(len(data), bool)
    splits = splits_of(data, everything)
    assert [np.unique(data.position[judged]).tolist() for _, judged in splits] == lots
    assert all(np.array_equal(training, ~judged) for training, judged in splits)
    first = data.position == 0
    assert [mask.tolist() for mask in splits_of(data, first)[0]] == [first.tolist(), (~first).tolist()]


def test_errors_of_a_prediction_are_over_the_cells_that_judge_and_expected_by_noise_and_what_is_open():
    data = linear_data(positions=2, cells=10, sigma=0.1)
    judges = data.position == 1
    predicted_angle = np.where(judges, 0.2, 9.0)
    error = angle_error(data, np.array([0.0, 40.0]), predicted_angle, np.full(len(data), 0.3), judges)
    assert (error.rms_arcmin, error.max_arcmin, error.to_noise) == pytest.approx((0.2, 0.2, 2.0))
    assert error.expected_to_noise == pytest.approx(np.sqrt(1 + 3**2))
    assert error.by_crank_deg == {40.0: pytest.approx(0.2)}
    assert error.cells == judges.sum()

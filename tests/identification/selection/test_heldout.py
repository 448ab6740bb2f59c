"""What is left out at once."""

import numpy as np
import pytest
from linear_unit import linear_data

from pipeline.identification.selection.held_out import splits_of


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

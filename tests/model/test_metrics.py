"""A metric, which another package may have registered, gives one number for each loop."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.model.metrics import Definitions, library
from pipeline.model.metrics.metric import LoopReadings

LOOPS = LoopReadings.from_bench(zero_falling=np.arange(3.0), zero_rising=np.ones(3))


@pytest.mark.parametrize("value", [lambda loop, _: np.max(loop.zero_falling), lambda loop, _: loop.zero_falling[:1]])
def test_one_number_for_all_loops_is_refused(value):
    """It would be repeated for each unit, and decide its yield."""
    metric = replace(library()["lost_motion_arcmin"], name="wound_arcmin", value=value)
    with pytest.raises(InputError, match=r"metric wound_arcmin: its value has the shape \(1?,?\) for 3 loops"):
        metric.values(LOOPS, Definitions(1.0, 2.0, 4.0))


def test_one_number_for_each_loop_is_taken():
    metric = replace(library()["lost_motion_arcmin"], value=lambda loop, _: loop.zero_rising - loop.zero_falling)
    np.testing.assert_array_equal(metric.values(LOOPS, Definitions(1.0, 2.0, 4.0)), [1.0, 0.0, -1.0])

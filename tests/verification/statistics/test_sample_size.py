"""The number of units for a yield: the interval of so many is as wide as was asked, and a closed form at the end."""

import numpy as np
import pytest

from pipeline.statistics.intervals import pass_share, units_for_yield


@pytest.mark.parametrize(("share", "half_width"), [(0.8, 0.02), (0.95, 0.005), (0.99, 0.003), (0.5, 0.05)])
def test_an_experiment_of_so_many_units_has_the_interval_that_was_asked(share, half_width):
    n = units_for_yield(share, half_width, 0.95)
    assert n == pytest.approx(1.96**2 * share * (1 - share) / half_width**2, rel=0.25)
    rng = np.random.default_rng(1)
    widths = [np.diff([(e := pass_share(rng.random(n) < share, 0.95)).ci_low, e.ci_high])[0] / 2 for _ in range(100)]
    assert np.mean(widths) == pytest.approx(half_width, rel=0.03)


def test_units_that_all_pass():
    """Interval 0.025^(1/n) to 1: 2 x 0.005 wide from ln 0.025/ln 0.99 = 367.04 units on."""
    assert units_for_yield(1.0, 0.005, 0.95) == 368
    with pytest.raises(ValueError, match="half width 0"):
        units_for_yield(0.9, 0.0, 0.95)

"""Intervals of the jackknife: against the t interval of a mean, and of positive numbers."""

import numpy as np
import pytest
from scipy import stats

from pipeline.statistics.resampling import jackknife_interval


def test_the_interval_of_a_mean_is_that_of_student():
    values = np.array([-1.0, 2.0, 0.5, -1.5, -0.5])
    left_out = [float(np.delete(values, k).mean()) for k in range(len(values))]
    reference = stats.t.interval(0.95, len(values) - 1, values.mean(), stats.sem(values))
    assert jackknife_interval(float(values.mean()), left_out) == pytest.approx(reference, rel=1e-12)


def test_the_interval_of_a_positive_number_stays_positive():
    low, high = jackknife_interval(1.0, [0.97, 1.04, 1.0, 0.99])
    assert 0 < low < 1 < high
    assert jackknife_interval(1.0, [0.01, 3.0, 0.02, 2.0])[0] == 0.0
    assert np.isnan(jackknife_interval(1.0, [])[0])

"""Yields: samples without a value count in the lower end of the interval as if they failed."""

import numpy as np
import pytest

from pipeline.statistics.intervals import pass_share


def test_samples_without_a_value_lower_the_lower_end_alone() -> None:
    known, all_samples = (pass_share(np.ones(25, bool), 0.95, n_missing=missing) for missing in (0, 15))
    assert (all_samples.value, all_samples.ci_high, all_samples.n) == (known.value, known.ci_high, 25)
    assert known.ci_low == pytest.approx(0.8628, abs=1e-4)  # Clopper and Pearson: 0.025 ** (1 / 25)
    assert all_samples.ci_low == pytest.approx(0.8628 * 25 / 40, abs=1e-4)

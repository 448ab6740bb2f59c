"""Units that differ by themselves are told from a shift of all units."""

import numpy as np
import pandas as pd

from pipeline.populations.comparison import measurable_metrics
from pipeline.populations.single_units import single_units

NAMES = list(measurable_metrics())
COVARIANCE = 0.02 * (np.eye(len(NAMES)) + 0.5)


def drawn(n: int, seed: int, shift: float = 0.0) -> np.ndarray:
    return np.random.default_rng(seed).multivariate_normal(np.full(len(NAMES), 2.0 + shift), COVARIANCE, n)


def metrics_of(values: np.ndarray) -> pd.DataFrame:
    frame = pd.DataFrame(values, columns=NAMES)
    return frame.assign(sample=np.arange(1, len(frame) + 1), crank_deg=0.0, status="ok")


def units_of(values: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(values, columns=NAMES).assign(unit=[f"u{k}" for k in range(len(values))])


def test_a_shift_of_all_units_names_none_and_one_unit_apart_is_named():
    metrics = metrics_of(drawn(2000, 0))
    units = drawn(12, 1, shift=1.0)
    (shared,) = single_units(units_of(units), metrics, "mean")
    assert shared.outlying == ()
    units[4, 0] += 1.5
    (single,) = single_units(units_of(units), metrics, "mean")
    assert single.outlying == ("u4",)
    assert "u4" in single.sentence


def test_sound_populations_are_named_in_about_one_of_twenty():
    metrics = metrics_of(drawn(2000, 0))
    named = sum(bool(single_units(units_of(drawn(10, 100 + k)), metrics, "mean")[0].outlying) for k in range(100))
    assert named <= 13  # of 100 at a level of 5 %: more than 13 have a probability below 1e-3


def test_too_few_samples_are_stated():
    (found,) = single_units(units_of(drawn(12, 1)), metrics_of(drawn(50, 0)), "mean")
    assert found.outlying == ()
    assert "needs 239 samples; it has 50" in found.sentence

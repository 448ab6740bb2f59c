"""Units that differ by themselves are told from a shift of all units."""

import numpy as np
import pandas as pd
import pytest

from pipeline.populations.comparison import measurable_metrics
from pipeline.populations.single_units import SingleUnits, single_units

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
    (shared,) = single_units(units_of(units), metrics, "mean", 0.0)
    assert shared.outlying == ()
    units[4, 0] += 1.5
    (single,) = single_units(units_of(units), metrics, "mean", 0.0)
    assert single.outlying == ("u4",)
    assert "u4" in single.sentence


@pytest.mark.long
def test_sound_populations_are_named_in_about_one_of_twenty():
    metrics = metrics_of(drawn(2000, 0))
    named = sum(bool(single_units(units_of(drawn(10, 100 + k)), metrics, "mean", 0.0)[0].outlying) for k in range(100))
    assert named <= 13  # of 100 at a level of 5 %: more than 13 have a probability below 1e-3


def test_noise_of_the_bench_is_no_difference_of_a_unit_and_without_it_none_is_tested():
    """Noise of three times the scatter of the study: counted it names none, left out it would name most."""
    metrics = metrics_of(drawn(2000, 0))
    rng = np.random.default_rng(7)
    units = drawn(10, 3) * (1 + 0.25 * rng.standard_normal((10, len(NAMES))))
    (exact,) = single_units(units_of(units), metrics, "mean", 0.0)
    (noisy,) = single_units(units_of(units), metrics, "mean", 0.25)
    (unknown,) = single_units(units_of(units), metrics, "mean", None)
    assert len(exact.outlying) > 2
    assert noisy.outlying == unknown.outlying == ()
    assert "--noise" in unknown.sentence
    assert "more than the tolerances allow" in noisy.sentence


def test_too_few_samples_are_stated():
    (found,) = single_units(units_of(drawn(12, 1)), metrics_of(drawn(50, 0)), "mean", 0.0)
    assert found.outlying == ()
    assert "requires 239 samples of the study, which has 50" in found.sentence


def test_names_follow_holms_steps():
    """Of four units the levels are 1.25, 1.67, 2.5 and 5 %; behind the first that is missed no other is named."""

    def outlying(*p_value: float) -> tuple[str, ...]:
        return SingleUnits(None, ("a", "b", "c", "d"), np.array(p_value), 79, 100, True).outlying

    assert outlying(0.016, 0.2, 0.0124, 0.03) == ("c", "a")
    assert outlying(0.013, 0.013, 0.013, 0.013) == ()
    assert outlying(0.0125, 0.01, 0.05, 0.025) == ("b", "a", "d", "c")


def test_p_values_count_samples_as_far_as_a_unit_from_the_median_of_the_others():
    """One metric: the others' median is shifted by 1, and its scatter widens the distance by pi/2 over their number."""
    samples = np.linspace(-3.0, 3.0, 601)
    metrics = pd.DataFrame(
        {**dict.fromkeys(NAMES, samples), "sample": np.arange(601), "crank_deg": 0.0, "status": "ok"}
    )
    values = [1.0, 1.0, 1.0, 1.0, 3.4]
    units = pd.DataFrame({NAMES[0]: values, "unit": list("abcde")})
    (found,) = single_units(units, metrics, "mean", 0.0)
    distance = 2.4 / np.sqrt(1 + np.pi / 2 / 4)
    assert found.p_value[4] == (1 + np.count_nonzero(np.abs(samples) >= distance)) / 602
    assert found.p_value[0] == 1.0

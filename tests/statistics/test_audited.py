"""Estimates from audited units, by hand."""

import numpy as np
import pytest
from scipy.special import betaincinv, stdtrit

from pipeline.statistics.intervals import QUANTILES
from pipeline.statistics.two_phase import audited_distribution, audited_share


def exact_interval(hits: float, n: float, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's, for numbers that need not be whole."""
    tail = (1 - confidence) / 2
    return betaincinv(hits, n - hits + 1, tail), betaincinv(hits + 1, n - hits, 1 - tail)


def test_audited_units_that_agree_leave_the_interval_of_the_units() -> None:
    """15 of 21 pass with any shortfall: the variance of the mean is p (1 - p) / 20, so that 20 units count."""
    passes = np.repeat(np.arange(21)[:, None] < 15, 5, axis=1)
    estimate = audited_share(passes.T, 0.9)
    assert (estimate.value, estimate.n) == (15 / 21, 21)
    assert (estimate.ci_low, estimate.ci_high) == pytest.approx(exact_interval(20 * 15 / 21, 20, 0.9), rel=1e-12)


def test_the_variances_of_units_and_of_audited_units_add() -> None:
    """Three of four audited units let all of 40 units pass, the fourth half of them."""
    passes = np.ones((40, 4), bool)
    passes[:20, 3] = False
    share = 140 / 160
    of_units = np.var([0.75] * 20 + [1.0] * 20, ddof=1) / 40
    of_audited = np.var([1.0, 1.0, 1.0, 0.5], ddof=1) / 4
    effective = share * (1 - share) / (of_units + of_audited)
    assert effective < 10
    estimate = audited_share(passes.T, 0.95)
    assert estimate.value == share
    expected = exact_interval(share * effective, effective, 0.95)
    assert (estimate.ci_low, estimate.ci_high) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "interval"), [(True, (0.025 ** (1 / 12), 1.0)), (False, (0.0, 1 - 0.025 ** (1 / 12)))]
)
def test_all_or_none_have_the_one_sided_interval(value: bool, interval: tuple[float, float]) -> None:
    estimate = audited_share(np.full((3, 12), value), 0.95)
    assert (estimate.ci_low, estimate.ci_high) == pytest.approx(interval, rel=1e-12)


def test_mean_and_quantiles_are_those_of_all_sums() -> None:
    rng = np.random.default_rng(4)
    found, shortfall = rng.normal(size=30), np.array([0.0, 0.0, 0.3, 0.1])
    estimates = audited_distribution(found, shortfall, 0.95)
    spread = np.sqrt(found.var(ddof=1) / 30 + shortfall.var(ddof=1) / 4)
    mean = estimates["mean"]
    assert mean.value == pytest.approx(found.mean() + 0.1)
    assert mean.ci_high - mean.value == pytest.approx(stdtrit(3, 0.975) * spread)
    assert mean.value - mean.ci_low == pytest.approx(stdtrit(3, 0.975) * spread)
    sums = np.sort([a + b for a in found for b in shortfall])
    for name, level in QUANTILES.items():
        value = np.quantile(sums, level)
        share = audited_share(np.add.outer(shortfall, found) <= value, 0.95)
        assert estimates[name].value == pytest.approx(value)
        expected = np.quantile(sums, [share.ci_low, share.ci_high])
        assert (estimates[name].ci_low, estimates[name].ci_high) == pytest.approx(expected)


def test_one_audited_unit_has_no_variance_of_its_own() -> None:
    found = np.arange(10.0)
    mean = audited_distribution(found, np.array([0.5]), 0.95)["mean"]
    assert mean.ci_high - mean.value == pytest.approx(stdtrit(1, 0.975) * np.sqrt(found.var(ddof=1) / 10))

"""Intervals of differences: published examples, other programs' closed forms, and how often they hold the truth."""

import numpy as np
import pytest
from scipy import stats

from pipeline.statistics import differences
from pipeline.statistics.differences import mean_difference, order_differences, replicated_difference, share_difference

CONFIDENCE = 0.95


def answers(*counts):
    """Pairs of answers: (yes, yes), (yes, no), (no, yes), (no, no)."""
    pairs = np.repeat(np.array([(1, 1), (1, 0), (0, 1), (0, 0)], bool), counts, axis=0)
    return pairs[:, 0], pairs[:, 1]


def test_independent_shares_are_newcombes_example():
    """Stat. Med. 17 (1998) 873, table II: 56/70 less 48/80 by method 10 is 0.0524 to 0.3339."""
    of_a = np.arange(80) < 48
    of_b = np.arange(70) < 56
    np.testing.assert_allclose(share_difference(of_a, of_b, CONFIDENCE, False), (0.0524, 0.3339), atol=5e-5)


def test_paired_shares_are_newcombes_example():
    """Stat. Med. 17 (1998) 2635: of 50 pairs 36 agree, 12 and 2 differ; by method 10 0.0569 to 0.3404."""
    first_order, second = answers(36, 12, 2, 0)
    np.testing.assert_allclose(share_difference(second, first_order, CONFIDENCE, True), (0.0569, 0.3404), atol=5e-5)


def test_many_shares_differ_as_their_binomial_errors_say():
    a, b = np.arange(40_000) < 12_000, np.arange(40_000) < 14_000
    half = stats.norm.ppf(0.975) * np.sqrt((0.3 * 0.7 + 0.35 * 0.65) / 40_000)
    np.testing.assert_allclose(share_difference(a, b, CONFIDENCE, False), (0.05 - half, 0.05 + half), atol=2e-5)


def test_means_are_those_of_scipy():
    rng = np.random.default_rng(1)
    a, b = rng.normal(1.0, 2.0, 30), rng.gamma(2.0, 1.0, 30)
    paired = stats.ttest_rel(b, a).confidence_interval(CONFIDENCE)
    distance = stats.ttest_ind(b, a[:20], equal_var=False).confidence_interval(CONFIDENCE)
    np.testing.assert_allclose(mean_difference(a, b, CONFIDENCE, True), paired)
    np.testing.assert_allclose(mean_difference(a[:20], b, CONFIDENCE, False), distance)


def test_pairs_leave_what_they_share_out():
    """A shift of a tenth of the spread is found among pairs and not without them."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=200)
    b = a + 0.1 + 0.05 * rng.normal(size=200)
    low, high = order_differences(a, b, CONFIDENCE, True, seed=3)["p50"]
    assert 0 < low < 0.1 < high < 0.2
    low, high = order_differences(a, b, CONFIDENCE, False, seed=3)["p50"]
    assert low < 0 < high


@pytest.mark.parametrize(("paired", "factor"), [(True, 1.0), (False, np.sqrt(5.0))])
def test_the_bootstrap_is_as_wide_as_large_samples_have_it(paired, factor):
    """b = 2 a of normal a, whose std has the error 1/sqrt(2n); without pairs that and twice that add in quadrature."""
    n, rng, widths = 2000, np.random.default_rng(4), []
    for seed in range(3):
        a = rng.normal(size=n)
        low, high = order_differences(a, 2 * (a if paired else rng.normal(size=n)), CONFIDENCE, paired, seed)["std"]
        widths.append(high - low)
    assert np.mean(widths) == pytest.approx(2 * 1.96 * factor / np.sqrt(2 * n), rel=0.08)


def test_resamples_that_are_drawn_in_parts_are_those_of_one_draw(monkeypatch):
    """Parts of 7 of the resamples, the last one shorter."""
    a, b = np.random.default_rng(8).normal(size=(2, 50))
    whole = order_differences(a, b, CONFIDENCE, False, seed=9)
    monkeypatch.setattr(differences, "RESAMPLED_VALUES", 7 * 50)
    assert differences.RESAMPLES % 7
    assert order_differences(a, b, CONFIDENCE, False, seed=9) == whole


def test_differences_are_in_the_unit_of_the_values():
    a, b = np.random.default_rng(10).normal(size=(2, 400))
    small, large = (order_differences(unit * a, unit * b, CONFIDENCE, False, seed=11) for unit in (1e-3, 1.0))
    for name, interval in large.items():
        np.testing.assert_allclose(small[name], 1e-3 * np.array(interval), rtol=1e-9)


def test_a_quantile_without_samples_beyond_has_no_interval():
    values = np.random.default_rng(5).normal(size=150)
    result = order_differences(values, values + 1, CONFIDENCE, True, seed=6)
    assert result["p05"] == (-np.inf, np.inf)
    np.testing.assert_allclose(result["p25"], (1.0, 1.0))


def test_replicates_are_compared_by_their_spread():
    """Eight randomisations whose means scatter by 1, in common: the difference of 3 is known exactly."""
    rng = np.random.default_rng(7)
    replicate = np.tile(np.arange(8), 16)
    a = rng.normal(size=8)[replicate] + rng.normal(size=128)
    low, high = replicated_difference(np.mean, (a, a + 3), (replicate, replicate), CONFIDENCE, True)
    assert low == pytest.approx(3)
    assert high == pytest.approx(3)
    low, high = replicated_difference(np.mean, (a, a + 3), (replicate, replicate), CONFIDENCE, False)
    assert 1 < high - low < 6

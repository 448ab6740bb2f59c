"""Rank correlations against distributions whose correlations are known exactly."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from pipeline.statistics.sensitivity import _sums_above, rank_correlation


def ishigami(x):
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_ishigami_ranks_see_the_monotone_input_only():
    x = np.random.default_rng(7).uniform(-np.pi, np.pi, (100_000, 3))
    ranks = rank_correlation({f"x{i + 1}": x[:, i] for i in range(3)}, ishigami(x)[:, None], 0.95)
    assert ranks.value[0, 0] == pytest.approx(stats.spearmanr(x[:, 0], ishigami(x))[0], abs=1e-12)
    assert ranks.value[0, 0] > 0.4
    for i in (1, 2):
        assert abs(ranks.value[i, 0]) < 0.01


@pytest.mark.parametrize("correlation", [0.0, -0.9])
@pytest.mark.long
def test_coverage_of_the_rank_correlation(correlation):
    rng = np.random.default_rng(8)
    exact = 6 / np.pi * np.arcsin(correlation / 2)  # Spearman's coefficient of a binormal pair
    pairs = rng.multivariate_normal([0, 0], [[1, correlation], [correlation, 1]], (1500, 100))
    runs = [rank_correlation({"x": pair[:, 0]}, np.exp(pair[:, [1]]), 0.95) for pair in pairs]
    covers = [run.ci_low[0, 0] <= exact <= run.ci_high[0, 0] for run in runs]
    assert 0.93 <= np.mean(covers) <= 0.975


def test_ranks_of_a_monotone_function_are_perfect_and_of_a_constant_unknown():
    x = np.linspace(0.1, 1, 30)
    ranks = rank_correlation({"x": x, "fixed": np.ones(30)}, np.column_stack([np.exp(x), 1 / x]), 0.95)
    np.testing.assert_allclose(ranks.value[0], [1, -1], atol=1e-12)
    assert np.all(np.isnan(ranks.value[1]))
    assert np.all(np.isnan(ranks.ci_low[1]))
    small_case = rank_correlation({"x": x[:3]}, x[:3, None] ** 2, 0.95)
    assert np.isnan(small_case.ci_low[0, 0])


@pytest.mark.parametrize("metric", [lambda x, noise: np.abs(x) + 0.05 * noise, lambda x, noise: x * noise])
def test_intervals_hold_no_correlation_of_an_even_metric_or_one_that_scatters_with_the_parameter(metric):
    """In 95 % of 500 samples; 86 and 90 % by the variance of Bonett and Wright alone."""
    rng = np.random.default_rng(9)
    covers = []
    for _ in range(500):
        x, noise = rng.standard_normal((2, 50))
        ranks = rank_correlation({"x": x}, metric(x, noise)[:, None], 0.95)
        covers.append(ranks.ci_low[0, 0] <= 0 <= ranks.ci_high[0, 0])
    assert 0.93 <= np.mean(covers) <= 0.98


def test_sums_over_larger_keys_count_equal_keys_half():
    sums = _sums_above(np.array([1.0, 2.0, 1.0, 0.0]), np.array([[1.0], [10.0], [100.0], [1000.0]]))
    assert sums[:, 0].tolist() == [60.5, 5.0, 60.5, 611.0]


def test_intervals_are_bonetts_of_one_sample_and_students_over_the_z_of_each_of_replicates():
    """Psychometrika 65 (2000) 23: z of Spearman's coefficient has the variance (1 + r^2 / 2) / (n - 3)."""
    rng, replicate = np.random.default_rng(3), np.repeat(np.arange(4), 50)
    x = rng.normal(size=200)
    y = x + rng.normal(size=200)
    z = [np.arctanh(stats.spearmanr(x[replicate == r], y[replicate == r])[0]) for r in range(4)]
    middle = np.arctanh(stats.spearmanr(x, y)[0])
    of_one = stats.norm.ppf(0.975) * np.sqrt((1 + np.tanh(middle) ** 2 / 2) / 197)
    of_replicates = stats.t.ppf(0.975, 3) * np.std(z, ddof=1) / 2
    for groups, half in ((None, of_one), (replicate, of_replicates)):
        ranks = rank_correlation({"x": x}, y[:, None], 0.95, groups)
        assert ranks.ci_low[0, 0] == pytest.approx(np.tanh(middle - half))
        assert ranks.ci_high[0, 0] == pytest.approx(np.tanh(middle + half))


@pytest.mark.long
def test_indices_of_replicates_have_intervals_over_the_replicates():
    rng = np.random.default_rng(9)
    replicate = np.repeat(np.arange(8), 128)
    exact = 6 / np.pi * np.arcsin(np.sqrt(1 / 1.25) / 2)
    covered = []
    for _ in range(300):
        points = np.concatenate([qmc.Sobol(2, rng=rng).random(128) for _ in range(8)])
        x = stats.norm.ppf(np.clip(points, 1e-9, 1 - 1e-9))
        y = (x[:, 0] + 0.5 * x[:, 1])[:, None]
        rank = rank_correlation({"a": x[:, 0]}, y, 0.95, replicate)
        covered.append(rank.ci_low[0, 0] <= exact <= rank.ci_high[0, 0])
    np.testing.assert_allclose(np.mean(covered), 0.95, atol=0.04)

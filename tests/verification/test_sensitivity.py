"""Sensitivity indices against functions whose indices are known exactly."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from pipeline.statistics import rank_correlation, variance_shares

NAMES = ("large", "small", "idle")
SLOPE = {"large": 1.0, "small": 0.4, "idle": 0.0}
ELEMENTS = 12
NOISE = 2.0


def elements(rng, n):
    """Three groups of element errors of unlike units, offsets and distributions; the first in thousandths."""
    return {
        "large": 5 + 1e-3 * rng.standard_normal((n, ELEMENTS)),
        "small": np.sqrt(12) * rng.random((n, ELEMENTS)),
        "idle": rng.standard_normal((n, ELEMENTS)),
    }


def response(groups, rng):
    signal = 1e3 * groups["large"].sum(axis=1) + SLOPE["small"] * groups["small"].sum(axis=1)
    return (signal + NOISE * rng.standard_normal(len(signal)))[:, None]


def exact_shares():
    carried = {name: ELEMENTS * slope**2 for name, slope in SLOPE.items()}
    total = sum(carried.values()) + NOISE**2
    return {**{name: part / total for name, part in carried.items()}, "remainder": NOISE**2 / total}


def test_shares_of_an_additive_function_are_unbiased_and_their_intervals_cover():
    rng = np.random.default_rng(1)
    runs = []
    for _ in range(500):
        groups = elements(rng, 150)  # 36 regressors: without its correction the idle group would get 3 % of the noise
        runs.append(variance_shares(groups, response(groups, rng), 0.95))
    assert runs[0].parameters == (*NAMES, "remainder")
    for i, (name, exact) in enumerate(exact_shares().items()):
        values = np.array([run.value[i, 0] for run in runs])
        assert np.mean(values) == pytest.approx(exact, abs=3 * np.std(values) / np.sqrt(500) + 2e-3), name
        inside = [run.ci_low[i, 0] <= exact <= run.ci_high[i, 0] for run in runs]
        # An idle group's estimate is a quadratic form about 0, whose variance the jackknife overstates.
        assert 0.92 <= np.mean(inside) <= (1.0 if name == "idle" else 0.98), name


def test_shares_add_to_one_without_noise():
    groups = {name: group for name, group in elements(np.random.default_rng(2), 20_000).items() if name != "idle"}
    y = 1e3 * groups["large"].sum(axis=1) + 0.4 * groups["small"].sum(axis=1)
    shares = variance_shares(groups, y[:, None], 0.95)
    np.testing.assert_allclose(shares.value[:, 0], [1 / 1.16, 0.16 / 1.16, 0.0], atol=0.02)
    assert shares.value[2, 0] < 1e-12


def test_metrics_are_treated_one_by_one_whatever_their_units():
    rng = np.random.default_rng(3)
    groups = elements(rng, 400)
    first, second = response(groups, rng), groups["idle"].sum(axis=1)[:, None]
    together = variance_shares(groups, np.hstack([first, 1e6 * second + 1e9, np.full_like(first, 0.1)]), 0.95)
    for column, alone in enumerate([first, second]):
        expected = variance_shares(groups, alone, 0.95)
        np.testing.assert_allclose(together.value[:, column], expected.value[:, 0], atol=1e-8)
        np.testing.assert_allclose(together.ci_high[:, column], expected.ci_high[:, 0], atol=1e-8)
    assert np.all(np.isnan(together.value[:, 2]))  # nothing varies, nothing is shared


def test_elements_of_a_group_may_be_correlated_or_dependent():
    rng = np.random.default_rng(4)
    theta = 2 * np.pi * np.arange(80) / 80
    drift = rng.standard_normal((4000, 80)) @ np.linalg.cholesky(np.exp(-np.abs(theta[:, None] - theta)) + 0)
    oval = rng.random((4000, 1)) * np.cos(2 * (theta - 2 * np.pi * rng.random((4000, 1))))  # rank 2
    fixed = np.full((4000, 5), 0.1)
    signal = drift[:, :3].sum(axis=1), 3 * oval[:, 0]
    shares = variance_shares({"drift": drift, "oval": oval, "fixed": fixed}, sum(signal)[:, None], 0.95)
    exact = np.array([np.var(signal[0]), np.var(signal[1]), 0, 0]) / np.var(sum(signal))
    np.testing.assert_allclose(shares.value[:, 0], exact, atol=0.03)


def test_shares_that_the_samples_do_not_determine_are_not_invented():
    rng = np.random.default_rng(5)
    groups = elements(rng, 2 * 3 * ELEMENTS)
    assert np.all(np.isnan(variance_shares(groups, response(groups, rng), 0.95).value))
    still = {"fixed": np.zeros((50, 4))}
    assert np.all(np.isnan(variance_shares(still, rng.random((50, 1)), 0.95).value))


def ishigami(x):
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_ishigami_what_linear_shares_see_and_what_they_do_not():
    """First-order indices are 0.314, 0.442, 0; x2 acts through an even function, and x3 through x1 only.

    Of x1 a regression sees cov(x1, f)^2/(var(x1) var(f)), with cov = 1 + 0.1 pi^4/5; of x2 and x3 nothing: their
    variance is in the remainder, which is how a reader is told that linear shares do not explain the metric.
    """
    x = np.random.default_rng(6).uniform(-np.pi, np.pi, (200_000, 3))
    shares = variance_shares({f"x{i + 1}": x[:, [i]] for i in range(3)}, ishigami(x)[:, None], 0.95)
    variance = 7**2 / 8 + 0.1 * np.pi**4 / 5 + 0.01 * np.pi**8 / 18 + 1 / 2
    linear = (1 + 0.1 * np.pi**4 / 5) ** 2 / (np.pi**2 / 3 * variance)
    np.testing.assert_allclose(shares.value[:, 0], [linear, 0, 0, 1 - linear], atol=3e-3)
    assert np.all((shares.ci_low[:, 0] < shares.value[:, 0]) & (shares.value[:, 0] < shares.ci_high[:, 0]))


def test_ishigami_ranks_see_the_monotone_input_only():
    x = np.random.default_rng(7).uniform(-np.pi, np.pi, (100_000, 3))
    ranks = rank_correlation({f"x{i + 1}": x[:, i] for i in range(3)}, ishigami(x)[:, None], 0.95)
    assert ranks.value[0, 0] == pytest.approx(stats.spearmanr(x[:, 0], ishigami(x))[0], abs=1e-12)
    assert ranks.value[0, 0] > 0.4
    for i in (1, 2):
        assert abs(ranks.value[i, 0]) < 0.01


@pytest.mark.parametrize("correlation", [0.0, 0.5, -0.9])
def test_coverage_of_the_rank_correlation(correlation):
    rng = np.random.default_rng(8)
    exact = 6 / np.pi * np.arcsin(correlation / 2)  # Spearman's coefficient of a binormal pair
    pairs = rng.multivariate_normal([0, 0], [[1, correlation], [correlation, 1]], (1500, 100))
    runs = [rank_correlation({"x": pair[:, 0]}, np.exp(pair[:, [1]]), 0.95) for pair in pairs]
    inside = [run.ci_low[0, 0] <= exact <= run.ci_high[0, 0] for run in runs]
    assert 0.93 <= np.mean(inside) <= 0.975


def test_ranks_of_a_monotone_function_are_perfect_and_of_a_constant_unknown():
    x = np.linspace(0.1, 1, 30)
    ranks = rank_correlation({"x": x, "fixed": np.ones(30)}, np.column_stack([np.exp(x), 1 / x]), 0.95)
    np.testing.assert_allclose(ranks.value[0], [1, -1], atol=1e-12)
    assert np.all(np.isnan(ranks.value[1]))
    assert np.all(np.isnan(ranks.ci_low[1]))
    few = rank_correlation({"x": x[:3]}, x[:3, None] ** 2, 0.95)
    assert np.isnan(few.ci_low[0, 0])


def test_indices_of_replicates_have_intervals_over_the_replicates():
    rng = np.random.default_rng(9)
    replicate = np.repeat(np.arange(8), 128)
    exact_share = 1 / (1 + 0.25)
    exact_rank = 6 / np.pi * np.arcsin(np.sqrt(exact_share) / 2)
    inside = []
    for _ in range(300):
        points = np.concatenate([qmc.Sobol(2, rng=rng).random(128) for _ in range(8)])
        x = stats.norm.ppf(np.clip(points, 1e-9, 1 - 1e-9))
        y = (x[:, 0] + 0.5 * x[:, 1])[:, None]
        share = variance_shares({"a": x[:, :1]}, y, 0.95, replicate)
        rank = rank_correlation({"a": x[:, 0]}, y, 0.95, replicate)
        inside.append(
            [
                share.ci_low[0, 0] <= exact_share <= share.ci_high[0, 0],
                rank.ci_low[0, 0] <= exact_rank <= rank.ci_high[0, 0],
            ]
        )
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.04)

"""Confidence intervals cover the truth as often as they say: exactly where a sum is finite, else by simulation."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from pipeline.statistics.intervals import (
    QUANTILES,
    distribution,
    mean_interval,
    pass_share,
    quantile_interval,
    share_interval,
    std_interval,
)
from pipeline.statistics.resampling import (
    effective_number,
    replicated_interval,
    replicated_quantile_interval,
    replicated_share_interval,
)

# Backlash of a drive is skewed like a gamma variable; the others bracket it.
POPULATIONS = {
    "normal": stats.norm(2, 0.5),
    "uniform": stats.uniform(0, 1),
    "gamma": stats.gamma(4),
    "triangular": stats.triang(0.2),
}


def covered(intervals, truth):
    low, high = np.array(intervals).T
    return np.mean((low <= truth) & (truth <= high))


@pytest.mark.parametrize(
    "population",
    [
        pytest.param(population, id=name, marks=() if name == "gamma" else pytest.mark.attack)
        for name, population in POPULATIONS.items()
    ],
)
@pytest.mark.long
def test_coverage_of_mean_and_std(population):
    samples = population.rvs((1500, 100), random_state=np.random.default_rng(1))
    assert covered([mean_interval(x, 0.95) for x in samples], population.mean()) == pytest.approx(0.95, abs=0.015)
    assert covered([std_interval(x, 0.95) for x in samples], population.std()) == pytest.approx(0.95, abs=0.025)
    assert covered([std_interval(x, 0.80) for x in samples], population.std()) == pytest.approx(0.80, abs=0.04)


def test_std_interval_is_that_of_normal_values_where_they_are_normal():
    values = stats.norm.ppf((np.arange(2000) + 0.5) / 2000)
    exact = np.sqrt(1999 / stats.chi2.ppf([0.975, 0.025], 1999)) * np.std(values, ddof=1)
    np.testing.assert_allclose(std_interval(values, 0.95), exact, rtol=2e-3)


def test_std_interval_is_that_of_bonetts_example():
    """Comput. Stat. Data Anal. 50 (2006) 775: eight values, to the four digits that are printed."""
    values = np.array([15.83, 16.01, 16.24, 16.42, 15.33, 15.44, 16.88, 16.31])
    np.testing.assert_allclose(std_interval(values, 0.90), (0.3592, 0.9359), atol=5e-5)
    np.testing.assert_allclose(std_interval(values, 0.95), (0.3263, 1.0841), atol=5e-5)


@pytest.mark.parametrize("n", [20, 200, 2000])
@pytest.mark.parametrize("level", QUANTILES.values())
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_quantile_interval_has_at_least_its_level_and_no_rank_to_spare(n, level, confidence):
    low, high = quantile_interval(np.arange(1.0, n + 1), confidence, level)  # values are their own ranks
    lower = stats.binom(n, level)  # number of values below the true quantile
    tail = (1 - confidence) / 2
    assert lower.cdf(low - 1 if np.isfinite(low) else -1) <= tail
    assert lower.sf(high - 1 if np.isfinite(high) else n) <= tail
    assert lower.cdf(low if np.isfinite(low) else 0) > tail
    assert lower.sf(high - 2 if np.isfinite(high) else n - 1) > tail


@pytest.mark.long
def test_std_interval_keeps_its_level_in_small_samples():
    samples = stats.norm().rvs((2000, 12), random_state=np.random.default_rng(4))
    assert covered([std_interval(x, 0.95) for x in samples], 1.0) == pytest.approx(0.95, abs=0.01)


@pytest.mark.long
def test_a_quantile_is_as_often_too_large_as_too_small():
    samples = stats.expon().rvs((400, 50), random_state=np.random.default_rng(5))
    runs = [distribution(x, 0.95) for x in samples]
    for name in ("p05", "p50", "p95"):
        upper = [run[name].value > stats.expon().ppf(QUANTILES[name]) for run in runs]
        assert np.mean(upper) == pytest.approx(0.5, abs=0.06), name


def test_coverage_of_a_quantile():
    samples = stats.gamma(4).rvs((2000, 200), random_state=np.random.default_rng(2))
    share = covered([quantile_interval(x, 0.95, 0.95) for x in samples], stats.gamma(4).ppf(0.95))
    assert 0.945 <= share <= 0.98


@pytest.mark.parametrize("truth", [0.02, 0.5, 0.97])
def test_yield_interval_has_at_least_its_level_for_every_outcome(truth):
    n = 120
    outcomes = [share_interval(np.arange(n) < passes, 0.95) for passes in range(n + 1)]
    chance = stats.binom(n, truth).pmf(np.arange(n + 1))
    covers = [low <= truth <= high for low, high in outcomes]
    assert 0.95 <= chance @ covers <= 0.995
    assert outcomes[0][0] == 0.0
    assert outcomes[n][1] == 1.0


@pytest.mark.parametrize("sequence", [qmc.Sobol, qmc.LatinHypercube])
@pytest.mark.long
def test_intervals_cover_the_truth_over_replicates(sequence):
    """Eight randomisations of a smooth function whose mean, 90 % point and yield are known."""
    rng = np.random.default_rng(3)
    truth = {"mean": 2.0, "p95": stats.norm(2, np.sqrt(2)).ppf(0.95)}
    replicate = np.repeat(np.arange(8), 64)
    runs, shares = [], []
    for _ in range(200):
        points = np.concatenate([sequence(2, rng=rng).random(64) for _ in range(8)])
        values = 2 + stats.norm.ppf(np.clip(points, 1e-9, 1 - 1e-9)).sum(axis=1)
        runs.append(distribution(values, 0.95, replicate))
        shares.append(pass_share(values < truth["p95"], 0.95, replicate))
    for name, exact in truth.items():
        share = covered([(run[name].ci_low, run[name].ci_high) for run in runs], exact)
        assert share == pytest.approx(0.95, abs=0.04), name
    assert covered([(s.ci_low, s.ci_high) for s in shares], 0.95) == pytest.approx(0.95, abs=0.04)


def test_replicates_tell_that_a_sobol_mean_is_sharper():
    points = np.concatenate([qmc.Sobol(2, rng=np.random.default_rng(r)).random(64) for r in range(8)])
    values = points.sum(axis=1)
    honest = distribution(values, 0.95, np.repeat(np.arange(8), 64))["mean"]
    naive = distribution(values, 0.95)["mean"]
    assert honest.value == naive.value
    assert honest.ci_high - honest.ci_low < 0.1 * (naive.ci_high - naive.ci_low)


def test_replicated_interval_is_a_t_interval_of_the_parts():
    parts = np.array([1.0, 2.0, 4.0, 5.0])
    np.testing.assert_allclose(replicated_interval(parts.mean(), parts, 0.95), mean_interval(parts, 0.95))


def test_effective_number_of_stated_replicates():
    """Shares 0.2, 0.4, 0.6, 0.8 have the variance 1/15; their mean is known to (1/15)/4, one of n samples to 0.25/n."""
    replicate = np.repeat(np.arange(4), 10)
    passes = np.concatenate([np.arange(10) < count for count in (2, 4, 6, 8)]).astype(float)
    for_few = (stats.norm.ppf(0.975) / stats.t.ppf(0.975, 3)) ** 2
    assert effective_number(passes, 0.5, 0.95, replicate) == pytest.approx(15 * for_few)


def test_equal_replicates_are_not_certain():
    """Replicates of 10 points whose shares are equal may each be wrong by the rounding of their shares."""
    passes, replicate = np.tile(np.arange(10) < 5, 4).astype(float), np.repeat(np.arange(4), 10)
    low, high = replicated_share_interval(passes, 0.95, replicate)
    half = stats.t.ppf(0.975, 3) * 0.1 / np.sqrt(12) / 2
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half), rel=0.02)


@pytest.mark.parametrize("name", ["p01", "p05", "p50", "p99"])
@pytest.mark.long
def test_replicates_of_independent_samples_have_the_level_of_independent_samples(name):
    """Nothing but chance lies between such replicates: quantile and yield of any population keep their level."""
    level, replicate, n = QUANTILES[name], np.arange(1024) % 8, 600
    samples = stats.gamma(4).rvs((n, 1024), random_state=np.random.default_rng(6))
    exact = stats.gamma(4).ppf(level)
    wholes = np.quantile(samples, level, axis=1, method="median_unbiased")
    intervals = [
        replicated_quantile_interval(whole, x, 0.95, level, replicate) for whole, x in zip(wholes, samples, strict=True)
    ]
    shares = [replicated_share_interval((x <= exact).astype(float), 0.95, replicate) for x in samples]
    error = 3 * np.sqrt(0.95 * 0.05 / n)
    assert 0.93 - error < covered(intervals, exact) < 0.97 + error
    assert 0.93 - error < covered(shares, level) < 0.97 + error


def test_a_quantile_of_few_replicated_samples_has_no_interval():
    values, replicate = np.arange(200.0), np.arange(200) % 8
    estimates = distribution(values, 0.95, replicate)
    for name in ("p01", "p99"):
        assert (estimates[name].ci_low, estimates[name].ci_high) == (-np.inf, np.inf)
    assert np.isfinite([estimates["p05"].ci_low, estimates["p05"].ci_high]).all()  # just 10 beyond


def test_statistics_of_known_values():
    estimates = distribution(np.arange(1.0, 1000.0), 0.95)
    assert list(estimates) == ["mean", "std", *QUANTILES]
    assert estimates["mean"].value == 500.0
    assert estimates["std"].value == pytest.approx(np.sqrt(999 * 1000 / 12))
    assert estimates["p50"].value == 500.0
    assert estimates["p95"].value == pytest.approx(950, abs=0.5)
    assert {estimate.n for estimate in estimates.values()} == {999}
    assert pass_share(np.arange(1000) < 950, 0.95).value == 0.95


def test_what_few_samples_do_not_determine_is_unbounded():
    estimates = distribution(np.arange(50.0), 0.95)
    assert estimates["p01"].ci_low == -np.inf
    assert estimates["p99"].ci_high == np.inf
    single = distribution(np.array([3.0]), 0.95)
    assert (single["mean"].ci_low, single["mean"].ci_high) == (-np.inf, np.inf)
    assert (single["std"].value, single["std"].ci_low, single["std"].ci_high) == (0.0, 0.0, np.inf)


def test_constant_values_have_no_spread():
    estimates = distribution(np.full(50, 0.1), 0.95)
    assert (estimates["std"].ci_low, estimates["std"].ci_high) == (0.0, 0.0)
    assert estimates["mean"].ci_high == pytest.approx(0.1)


def test_unanimous_replicates_are_not_certain():
    unanimous = pass_share(np.ones(80, bool), 0.95, np.arange(80) % 8)
    assert (unanimous.ci_low, unanimous.ci_high) == share_interval(np.ones(80), 0.95)
    assert unanimous.ci_low < 0.97


def test_failed_rows_must_be_selected_before():
    with pytest.raises(ValueError, match="1 of 3 values are not finite"):
        distribution(np.array([1.0, np.nan, 2.0]), 0.95)
    with pytest.raises(ValueError, match="0 of 0 values"):
        distribution(np.array([]), 0.95)

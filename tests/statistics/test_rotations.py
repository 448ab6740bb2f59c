"""Largest t by rotations: the t test of a single one, even p without an effect, and never behind Bonferroni."""

import numpy as np
import pytest
from scipy import stats

from pipeline.statistics import differences
from pipeline.statistics.differences import Family, family

N_TESTS, DRAWS = 8, 2000


def drawn(rng: np.random.Generator, freedom: int, mixing: np.ndarray, effect: float = 0.0) -> Family:
    """Tests of rows that ``mixing`` correlates; the effect is of its first cause."""
    causes = rng.standard_normal((freedom + 1, len(mixing)))
    causes[0, 0] += effect
    rows = causes @ mixing
    return family(rows[0], rows[1:], freedom)


def single_p(tests: Family) -> np.ndarray:
    t = np.sqrt(tests.freedom) * tests.shares / np.sqrt(1 - tests.shares**2)
    return 2 * stats.t.sf(t, tests.freedom)


@pytest.mark.parametrize("freedom", [2, 10])
@pytest.mark.parametrize("copies", [1, 5])
def test_a_single_test_and_copies_of_it_are_the_t_test(freedom, copies):
    tests = drawn(np.random.default_rng(3), freedom, np.full((1, copies), [2.0]), effect=2.0)
    assert tests.p == pytest.approx(single_p(tests), rel=0.02)
    assert tests.level(0.02) == pytest.approx(0.02, rel=0.05)


def test_what_comes_out_as_large_by_chance_counts_against_an_effect():
    """Three of four rotations are as large or larger, and the rows themselves are a fifth."""
    assert Family(np.array([0.5]), np.array([0.2, 0.5, 0.5, 0.9]), 3).p == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("freedom", "correlated"),
    [(2, 6.0), (10, 0.0), *(pytest.param(*case, marks=pytest.mark.attack) for case in ((2, 0.0), (4, 1.0), (10, 6.0)))],
)
@pytest.mark.long
def test_without_an_effect_the_least_p_is_even_whatever_correlates(monkeypatch, freedom, correlated):
    """The covariance is drawn anew each time and is not known to the test: an estimate of it would err here."""
    monkeypatch.setattr(differences, "ROTATIONS", 1999)
    rng, least = np.random.default_rng(int(10 * correlated) + freedom), []
    for _ in range(DRAWS):
        mixing = rng.standard_normal((N_TESTS, N_TESTS)) * rng.lognormal(0, 2, N_TESTS)
        mixing[0] += correlated * np.abs(mixing).max(axis=0)
        least.append(drawn(rng, freedom, mixing).p.min())
    assert stats.kstest(least, "uniform").pvalue > 1e-3
    assert np.sum(np.array(least) <= 0.02) <= stats.binom.ppf(1 - 1e-3, DRAWS, 0.02)


@pytest.mark.parametrize("freedom", [2, 10])
@pytest.mark.long
def test_bonferroni_is_never_ahead_and_a_common_cause_is_shown_more_often(monkeypatch, freedom):
    monkeypatch.setattr(differences, "ROTATIONS", 20_000)
    rng, shown, by_bonferroni = np.random.default_rng(9), 0, 0
    mixing = np.eye(N_TESTS) + np.outer(np.eye(N_TESTS)[0], np.full(N_TESTS, 3.0))
    for _ in range(150):
        tests = drawn(rng, freedom, mixing, effect=5.0 if freedom > 2 else 15.0)
        assert np.all(tests.p <= N_TESTS * single_p(tests) + 0.005)
        assert 0.02 / N_TESTS * 0.8 < tests.level(0.02) <= 0.02 * 1.1
        shown += tests.p[0] < 0.02
        by_bonferroni += N_TESTS * single_p(tests)[0] < 0.02
    assert shown > 1.1 * by_bonferroni > 0


def test_tests_without_scatter_or_data_are_not_numbers_gone_astray():
    tests = family(np.array([1.0, 0.0]), np.zeros((3, 2)), 2)
    assert tests.p[0] < 1e-4
    assert tests.p[1] == 1.0

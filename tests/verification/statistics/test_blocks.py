"""Block bootstrap: rates of error under the null, and power."""

from itertools import product

import numpy as np
from scipy.stats import binom

from pipeline.statistics.resampling import max_t, resampled_means

RUNS = 300
RESAMPLES = 300


def test_means_of_resamples_have_the_mean_and_error_of_the_blocks():
    values = np.random.default_rng(0).exponential(size=(30, 2, 3))
    resamples = resampled_means(values, 20000, 1)
    assert resamples.shape == (20000, 2, 3)
    np.testing.assert_allclose(resamples.mean(axis=0), values.mean(axis=0), rtol=0.01)
    np.testing.assert_allclose(resamples.std(axis=0), values.std(axis=0) / np.sqrt(30), rtol=0.03)
    np.testing.assert_array_equal(resamples, resampled_means(values, 20000, 1))


def test_one_of_twenty_families_without_gain_is_significant():
    rng, false = np.random.default_rng(1), 0
    for run in range(RUNS):
        shared = rng.normal(size=(40, 1))
        gains = 0.7 * shared + rng.normal(size=(40, 12))
        false += np.min(max_t(gains, RESAMPLES, run)[1]) <= 0.05
    low, high = binom.ppf([1e-3, 1 - 1e-3], RUNS, 0.05)
    assert low <= false <= high + 3  # the bootstrap of 40 blocks is a little narrow


def test_few_blocks_keep_the_level():
    """Of four models over eight blocks 17 % were significant with the standard error of the data in all resamples."""
    rng = np.random.default_rng(4)
    false = sum(np.min(max_t(rng.normal(size=(8, 4)), RESAMPLES, run)[1]) <= 0.05 for run in range(RUNS))
    assert false <= binom.ppf(1 - 1e-3, RUNS, 0.05)


def test_p_is_the_share_of_all_resamples_whose_largest_t_is_as_large():
    """All 3,125 of five blocks, each with its own standard error."""
    gains = np.random.default_rng(0).normal(size=(5, 3)) + [0.3, 0.8, 0.0]
    resamples = np.array(list(product(range(5), repeat=5)))
    drawn = (gains - gains.mean(axis=0))[resamples]
    error = drawn.std(axis=1, ddof=1) / np.sqrt(5)
    differ = error > 1e-12
    largest_t = np.where(differ, drawn.mean(axis=1) / np.where(differ, error, 1.0), 0.0).max(axis=1)
    t, p = max_t(gains, 20_000, 1)
    np.testing.assert_allclose(t, gains.mean(axis=0) / (gains.std(axis=0, ddof=1) / np.sqrt(5)))
    np.testing.assert_allclose(p, np.mean(largest_t[:, None] >= t, axis=0), atol=0.01)


def test_clear_gain_is_significant_and_its_neighbours_are_not():
    gains = np.random.default_rng(2).normal(size=(24, 10))
    gains[:, 4] += 2.0
    t, p = max_t(gains, 2000, 0)
    assert p[4] == 1 / 2001
    assert np.min(np.delete(p, 4)) > 0.05
    np.testing.assert_allclose(t[4], gains[:, 4].mean() / (gains[:, 4].std(ddof=1) / np.sqrt(24)))
    assert np.all(np.diff(p[np.argsort(t)]) <= 0)


def test_gain_that_is_the_same_everywhere_has_no_error_to_be_judged_by():
    gains = np.column_stack([np.zeros(12), np.random.default_rng(3).normal(size=12)])
    t, p = max_t(gains, 500, 0)
    assert t[0] == 0
    assert p[0] > 0.5

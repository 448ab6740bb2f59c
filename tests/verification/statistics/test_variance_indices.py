"""Variance-based indices by group against functions whose indices are known exactly."""

from itertools import chain, combinations

import numpy as np
import pytest
from scipy.stats import sobol_indices

from pipeline.config.studies.study import FEWEST_BASE_SAMPLES
from pipeline.statistics.sensitivity import two_fidelity_indices, variance_indices

A = np.array([0.0, 0.5, 3.0, 9.0, 99.0])
"""Of the g-function: the larger, the less its input matters."""


def pick_freeze(function, groups, inputs, n, rng):
    """The metric of both base sets and of the mixed ones; ``groups`` are columns of inputs uniform in [0, 1)."""
    base, variant = rng.random((2, n, inputs))
    mixed = []
    for columns in groups:
        unit = base.copy()
        unit[:, columns] = variant[:, columns]
        mixed.append(function(unit))
    return function(base), function(variant), np.array(mixed)


def ishigami(u):
    x = np.pi * (2 * u - 1)
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_parts():
    """Variances of the terms in the decomposition: x1 alone, x2 alone, x1 with x3."""
    return {
        (0,): (1 + 0.1 * np.pi**4 / 5) ** 2 / 2,
        (1,): 7**2 / 8,
        (0, 2): 0.1**2 * np.pi**8 * (1 / 18 - 1 / 50),
    }


def g_function(u):
    return np.prod((np.abs(4 * u - 2) + A) / (1 + A), axis=1)


def g_parts():
    isolated = 1 / (3 * (1 + A) ** 2)
    sets = chain.from_iterable(combinations(range(len(A)), size) for size in range(1, len(A) + 1))
    return {members: float(np.prod(isolated[list(members)])) for members in sets}


def exact(parts, groups):
    """First-order and total index of every group, and their sums, from the terms of the decomposition."""
    variance = sum(parts.values())
    isolated = [sum(v for members, v in parts.items() if set(members) <= set(group)) / variance for group in groups]
    touched = [sum(v for members, v in parts.items() if set(members) & set(group)) / variance for group in groups]
    return np.array([*isolated, sum(isolated)]), np.array([*touched, sum(touched)])


CASES = {
    "ishigami, single inputs": (ishigami, ishigami_parts(), ([0], [1], [2]), 3),
    "ishigami, x1 with x3": (ishigami, ishigami_parts(), ([0, 2], [1]), 3),
    "g-function, single inputs": (g_function, g_parts(), ([0], [1], [2], [3], [4]), 5),
    "g-function, groups": (g_function, g_parts(), ([0, 3], [1, 2], [4]), 5),
}


def test_exact_indices_of_ishigami_are_the_published_ones():
    parts = ishigami_parts()
    first_indices, total = exact(parts, ([0], [1], [2]))
    np.testing.assert_allclose(first_indices[:3], [0.3139, 0.4424, 0.0], atol=1e-4)
    np.testing.assert_allclose(total[:3], [0.5576, 0.4424, 0.2437], atol=1e-4)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.long
def test_indices_of_closed_forms(case):
    function, parts, groups, inputs = CASES[case]
    first_indices, total = exact(parts, groups)
    estimate = variance_indices(*pick_freeze(function, groups, inputs, 20_000, np.random.default_rng(1)), 0.95)
    np.testing.assert_allclose(estimate.first_order.value, first_indices, atol=0.04)
    np.testing.assert_allclose(estimate.total.value, total, atol=0.04)
    assert estimate.n == 20_000


@pytest.mark.parametrize("case", ["ishigami, single inputs", "g-function, groups"])
def test_values_are_those_of_scipy(case):
    """SciPy has the same two estimators; ours adds groups of rows without a value, sums, and intervals of both."""
    function, _, groups, inputs = CASES[case]
    base, second_base, mixed = pick_freeze(function, groups, inputs, 1024, np.random.default_rng(5))
    estimate = variance_indices(base, second_base, mixed, 0.95)
    answers = {"f_A": base[None], "f_B": second_base[None], "f_AB": mixed[:, None]}
    reference = sobol_indices(func=answers, n=len(base))
    np.testing.assert_allclose(estimate.first_order.value[:-1], reference.first_order, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(estimate.total.value[:-1], reference.total_order, rtol=1e-12)


def test_intervals_cover_and_estimates_are_unbiased():
    """A sum of a hundred small products is not quite normal: 93 to 96 % of longer runs, less three binomial errors."""
    function, parts, groups, inputs = CASES["g-function, groups"]
    truth = exact(parts, groups)
    rng = np.random.default_rng(2)
    runs = [variance_indices(*pick_freeze(function, groups, inputs, 250, rng), 0.95) for _ in range(150)]
    for i, kind in enumerate(("first_order", "total")):
        shares = [getattr(run, kind) for run in runs]
        values = np.array([share.value for share in shares])
        error = 3 * values.std(axis=0) / np.sqrt(len(runs))
        assert np.all(np.abs(values.mean(axis=0) - truth[i]) < error + 5e-3), kind
        coverage = np.mean([(s.ci_low <= truth[i]) & (truth[i] <= s.ci_high) for s in shares], axis=0)
        assert np.all((coverage >= 0.88) & (coverage < 1)), (kind, coverage)


def test_units_and_offset_of_a_metric_do_not_matter():
    sets = pick_freeze(g_function, ([0], [1], [2, 3, 4]), 5, 500, np.random.default_rng(3))
    reference, scaled = variance_indices(*sets, 0.95), variance_indices(*(5.0 - 1e-4 * values for values in sets), 0.95)
    for kind in ("first_order", "total"):
        for name in ("value", "ci_low", "ci_high"):
            expected = getattr(getattr(reference, kind), name)
            np.testing.assert_allclose(getattr(getattr(scaled, kind), name), expected, atol=1e-9)


def test_an_idle_group_has_no_share_and_no_doubt_of_it():
    groups = ([0], [1], [])
    estimate = variance_indices(*pick_freeze(ishigami, groups, 3, 200, np.random.default_rng(4)), 0.95)
    for shares in (estimate.first_order, estimate.total):
        assert shares.value[2] == shares.ci_low[2] == shares.ci_high[2] == 0.0


def test_a_row_counts_only_if_all_its_units_have_the_metric():
    base, variant, mixed = pick_freeze(g_function, ([0], [1]), 5, 300, np.random.default_rng(5))
    complete = np.ones(300, bool)
    complete[[3, 77, 200]] = False
    expected = variance_indices(base[complete], variant[complete], mixed[:, complete], 0.95)
    base[3], variant[77], mixed[1, 200] = np.nan, np.nan, np.nan
    estimate = variance_indices(base, variant, mixed, 0.95)
    assert estimate.n == 297
    np.testing.assert_array_equal(estimate.total.ci_low, expected.total.ci_low)
    np.testing.assert_array_equal(estimate.first_order.value, expected.first_order.value)


def test_what_the_rows_do_not_determine_is_not_invented():
    constant = variance_indices(np.full(100, 0.1), np.full(100, 0.1), np.full((2, 100), 0.1), 0.95)
    sets = pick_freeze(ishigami, ([0], [1]), 3, FEWEST_BASE_SAMPLES - 1, np.random.default_rng(6))
    small_case = variance_indices(*sets, 0.95)
    for indices in (constant, small_case):
        for shares in (indices.first_order, indices.total):
            assert np.all(np.isnan([shares.value, shares.ci_low, shares.ci_high]))
    assert small_case.n == FEWEST_BASE_SAMPLES - 1


def fidelities(rng, n, chosen, coupling):
    """A metric of the Ishigami function on some rows, and a cheap one that follows it as far as ``coupling``."""
    groups = ([0], [1], [2])
    rows = rng.random((2, n, 3))
    sets = [*rows, *(np.where(np.isin(np.arange(3), columns), rows[1], rows[0]) for columns in groups)]
    high = np.array([ishigami(unit) for unit in sets])
    low = 3 + 0.5 * (coupling * high + (1 - coupling) * np.array([np.sin(9 * unit.sum(axis=1)) for unit in sets]))
    high[:, chosen:] = np.nan
    return low, high


@pytest.mark.parametrize("coupling", [0.95, 0.0])
def test_indices_by_two_fidelities_have_no_bias_and_intervals_that_hold_the_truth(coupling):
    """However badly the cheap metric follows; of 100 experiments at least 88 intervals of each index hold it."""
    truth = exact(ishigami_parts(), ([0], [1], [2]))
    values, hits = [], np.zeros((2, 4))
    for seed in range(100):
        indices = two_fidelity_indices(*fidelities(np.random.default_rng(seed), 600, 200, coupling), 0.95)
        assert indices.n == 200
        for kind, shares in enumerate((indices.first_order, indices.total)):
            hits[kind] += (shares.ci_low <= truth[kind]) & (truth[kind] <= shares.ci_high)
        values.append([indices.first_order.value, indices.total.value])
    spread = np.std(values, axis=0, ddof=1)
    assert np.all(np.abs(np.mean(values, axis=0) - truth) < 3 * spread / 10 + 0.01)
    assert hits.min() >= 88, hits


def test_a_cheap_metric_that_follows_narrows_the_intervals_and_one_that_does_not_leaves_them():
    widths = {}
    for coupling in (0.95, 0.0):
        low, high = fidelities(np.random.default_rng(3), 2000, 300, coupling)
        chosen = high[:, :300]
        alone = variance_indices(chosen[0], chosen[1], chosen[2:], 0.95).total
        both = two_fidelity_indices(low, high, 0.95).total
        widths[coupling] = np.mean((both.ci_high - both.ci_low) / (alone.ci_high - alone.ci_low))
    assert widths[0.95] < 0.6
    assert 0.9 < widths[0.0] < 1.15


def test_with_all_rows_in_full_the_cheap_metric_counts_for_nothing():
    low, high = fidelities(np.random.default_rng(4), 300, 300, 0.5)
    both, alone = two_fidelity_indices(low, high, 0.95), variance_indices(high[0], high[1], high[2:], 0.95)
    np.testing.assert_allclose(both.total.value, alone.total.value, rtol=1e-12)
    np.testing.assert_allclose(both.first_order.value, alone.first_order.value, rtol=1e-12)


def test_a_cheap_metric_that_is_the_expensive_one_tells_of_all_rows():
    """With half of the rows in full the indices are those of all of them, but for the halves' own coefficients."""
    low, high = fidelities(np.random.default_rng(4), 1000, 500, 1.0)
    both, alone = two_fidelity_indices(low, high, 0.95), variance_indices(low[0], low[1], low[2:], 0.95)
    np.testing.assert_allclose(both.total.value, alone.total.value, atol=0.01)
    np.testing.assert_allclose(both.first_order.value, alone.first_order.value, atol=0.01)


def test_few_rows_in_full_give_no_indices():
    low, high = fidelities(np.random.default_rng(4), 300, FEWEST_BASE_SAMPLES - 1, 0.5)
    assert np.all(np.isnan(two_fidelity_indices(low, high, 0.95).total.value))

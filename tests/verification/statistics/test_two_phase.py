"""Two-phase sampling of the far tail: unbiased, with intervals that cover, and cheaper than solving every unit."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from pipeline.statistics.two_phase import (
    count_slope,
    exceedance_chance,
    inclusion_probability,
    tail_quantile,
    tail_share,
)

UNITS, BUDGET, REPEATS = 20_000, 800, 500
MISSED = 0.35
"""Standard deviation of what the prediction misses, in that of the prediction; both normal, so the sum is too."""
SPREAD = np.sqrt(1 + MISSED**2)
CONFIDENCE = 0.95


def drawn(rng, limit, misjudged=1.0):
    """Values and probabilities of the solved units of one experiment; the miss is believed wrong by a factor."""
    predicted = rng.standard_normal(UNITS)
    probability = inclusion_probability(exceedance_chance(predicted, limit, misjudged * MISSED), BUDGET)
    selected = rng.random(UNITS) < probability
    return predicted[selected] + MISSED * rng.standard_normal(selected.sum()), probability[selected]


def test_expectation_over_every_possible_selection_is_the_share():
    """Eight units, three beyond: the mean of the estimate over all 256 selections, weighted by their chances."""
    in_tail = np.array([True, False, True, False, False, True, False, False])
    probability = np.array([0.9, 0.3, 0.5, 0.7, 0.2, 0.8, 0.6, 0.4])
    mean = square = 0.0
    for selected in product([False, True], repeat=8):
        mask = np.array(selected)
        chance = np.prod(np.where(mask, probability, 1 - probability))
        value = tail_share(in_tail[mask], probability[mask], 8, CONFIDENCE).value
        mean, square = mean + chance * value, square + chance * value**2
    assert mean == pytest.approx(3 / 8)
    assert square - mean**2 == pytest.approx(np.sum((1 - probability[in_tail]) / probability[in_tail]) / 64)


@pytest.mark.parametrize("slope", [0.3, 0.9])
def test_the_count_of_the_taken_units_moves_no_expectation(slope):
    """Over all 256 selections in which some unit is beyond; the others are estimated as none by their bound."""
    in_tail = np.array([True, False, True, True, True, True, False, True])
    probability = np.array([0.9, 0.3, 0.5, 0.7, 0.2, 0.8, 0.6, 0.4])
    mean = mean_of_formula = 0.0
    for selected in product([False, True], repeat=8):
        mask = np.array(selected)
        chance = np.prod(np.where(mask, probability, 1 - probability))
        formula = slope + np.sum((in_tail[mask] - slope) / probability[mask]) / 8
        mean_of_formula += chance * formula
        value = tail_share(in_tail[mask], probability[mask], 8, CONFIDENCE, slope).value
        if np.any(in_tail[mask]):
            assert value == pytest.approx(np.clip(formula, 0, 1))
        mean += chance * value
    assert mean_of_formula == pytest.approx(6 / 8)


def test_a_share_near_one_does_not_follow_the_number_of_units_that_was_taken():
    """24 units that nearly all fail, 16 of them solved on average: with the count alone half of them seem to pass."""
    rng, chance = np.random.default_rng(2), np.full(24, 0.99)
    probability = np.linspace(0.4, 0.93, 24)
    slope = count_slope(chance, probability)
    assert slope == pytest.approx(0.99)
    for _ in range(200):
        taken = rng.random(24) < probability
        taken[0] = True
        fails = rng.random(24) < 0.99
        estimate = tail_share(fails[taken], probability[taken], 24, CONFIDENCE, slope)
        assert abs(estimate.value - np.mean(fails)) < 0.11
        assert estimate.ci_low < np.mean(fails) <= estimate.ci_high


def test_units_that_are_all_solved_are_plain_monte_carlo():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(5000)
    estimate = tail_share(values > 2, np.ones(5000), 5000, CONFIDENCE)
    count = np.sum(values > 2)
    assert estimate.value == count / 5000
    assert estimate.effective == pytest.approx(5000, rel=1e-3)
    assert (estimate.ci_low, estimate.ci_high) == pytest.approx(
        stats.beta.ppf([0.025, 0.975], count + 0.5, 5000 - count + 0.5), rel=1e-3
    )
    quantile = tail_quantile(values, np.ones(5000), 5000, 0.99, CONFIDENCE)
    assert quantile.value == pytest.approx(np.quantile(values, 0.99, method="hazen"))
    ordered = np.sort(values)
    low, high = (int(rank) for rank in stats.binom.ppf([0.025, 0.975], 5000, 0.99))
    assert ordered[low - 2] < quantile.ci_low < ordered[low]
    assert ordered[high - 1] < quantile.ci_high < ordered[high + 1]


@pytest.mark.parametrize("misjudged", [pytest.param(0.7, marks=pytest.mark.attack), 1.5])
@pytest.mark.long
def test_share_of_a_thousandth_is_unbiased_covered_and_five_times_cheaper(misjudged):
    exact = 1e-3
    limit = SPREAD * stats.norm.isf(exact)
    rng = np.random.default_rng(2)
    results = []
    for _ in range(REPEATS):
        values, probability = drawn(rng, limit, misjudged)
        results.append(tail_share(values > limit, probability, UNITS, CONFIDENCE))
    value = np.array([run_estimate.value for run_estimate in results])
    assert np.mean(value) == pytest.approx(exact, abs=3.5 * np.std(value) / np.sqrt(REPEATS))
    covered = sum(run_estimate.ci_low <= exact <= run_estimate.ci_high for run_estimate in results)
    assert stats.binom.ppf(1e-3, REPEATS, 0.93) <= covered <= stats.binom.ppf(1 - 1e-3, REPEATS, 0.97)
    mean_solved = np.mean([run_estimate.solved_units for run_estimate in results])
    assert mean_solved == pytest.approx(BUDGET, rel=0.01)
    reference = exact * (1 - exact) / np.var(value)  # units of Monte Carlo with the variance that the repeats have
    assert reference > 5 * mean_solved
    assert np.median([run_estimate.effective for run_estimate in results]) == pytest.approx(reference, rel=0.2)


@pytest.mark.long
def test_quantile_is_covered_and_as_often_too_large_as_too_small():
    level = 0.9973
    exact = SPREAD * stats.norm.ppf(level)
    rng = np.random.default_rng(3)
    estimate = [tail_quantile(*drawn(rng, exact + 0.1), UNITS, level, CONFIDENCE) for _ in range(REPEATS)]
    covered = sum(run_estimate.ci_low <= exact <= run_estimate.ci_high for run_estimate in estimate)
    assert stats.binom.ppf(1e-3, REPEATS, 0.93) <= covered <= stats.binom.ppf(1 - 1e-3, REPEATS, 0.97)
    larger = sum(run_estimate.value > exact for run_estimate in estimate)
    assert stats.binom.ppf(1e-3, REPEATS, 0.5) <= larger <= stats.binom.ppf(1 - 1e-3, REPEATS, 0.5)
    assert np.median([run_estimate.effective for run_estimate in estimate]) > 5 * BUDGET


@pytest.mark.long
def test_a_prediction_of_nothing_costs_width_not_truth():
    """The predictions have nothing to do with the values: the estimate is as wide as that of the solved units alone."""
    rng = np.random.default_rng(4)
    value = []
    for _ in range(REPEATS):
        chance = exceedance_chance(rng.standard_normal(UNITS), 3.0, MISSED)
        probability = inclusion_probability(chance, BUDGET)
        selected = rng.random(UNITS) < probability
        in_tail = rng.random(selected.sum()) < 0.02
        value.append(tail_share(in_tail, probability[selected], UNITS, CONFIDENCE).value)
    assert np.mean(value) == pytest.approx(0.02, abs=3.5 * np.std(value) / np.sqrt(REPEATS))
    assert 0.02 * 0.98 / np.var(value) < BUDGET


def test_allocation_has_its_budget_and_no_other_has_less_variance():
    rng = np.random.default_rng(5)
    chance = rng.random(50) ** 6 + 1e-6
    probability = inclusion_probability(chance, 15.0)
    assert np.sum(probability) == pytest.approx(15.0)
    assert np.max(probability) == 1.0
    variance = np.sum(chance / probability)
    for _ in range(500):
        variant = np.clip(probability * np.exp(0.2 * rng.standard_normal(50)), 0, 1)
        variant *= min(1.0, 15.0 / np.sum(variant))  # never more than the budget
        assert np.sum(chance / variant) >= variance * (1 - 1e-12)
    np.testing.assert_array_equal(inclusion_probability(chance, 50), np.ones(50))


def test_no_unit_beyond_is_not_certain_that_there_is_none():
    """Of 1,000 units at probability 0.1, 2.5 % of all experiments show none of a share of 3.7 %."""
    estimate = tail_share(np.zeros(100, bool), np.full(100, 0.1), 1000, CONFIDENCE)
    assert (estimate.value, estimate.ci_low, estimate.effective) == (0.0, 0.0, 0.0)
    assert (1 - 0.1 * estimate.ci_high) ** 1000 == pytest.approx(0.025, rel=0.1)


def test_what_can_never_be_taken_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        inclusion_probability(np.array([0.5, 0.0]), 1.0)
    with pytest.raises(ValueError, match="above 0"):
        inclusion_probability(np.array([0.5, 0.1]), 0.0)

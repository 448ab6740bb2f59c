"""The scatter of mounting over positions and states: against textbook tests, and its limits against drawn changes."""

import numpy as np
import pytest
from scipy import stats

from pipeline.identification.change.scatter import POWER, scatter

N_POSITIONS, DRAWS = 3, 4000


def drawn(rng: np.random.Generator, n_states: int, change: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Changes from the first state: mounting scatters each state at each position by 1, states and positions differ."""
    states = 5.0 * rng.standard_normal((n_states, 1)) + 7.0 * rng.standard_normal(N_POSITIONS)
    states[1] = states[0] + change
    mounted = states + rng.standard_normal((n_states, N_POSITIONS))
    return (mounted[1] - mounted[0])[:, None], (mounted[2:] - mounted[0])[:, :, None]


def test_two_states_are_the_test_of_the_mean_difference():
    estimates, others = drawn(np.random.default_rng(1), 2, 3.0)
    reference = stats.ttest_1samp(estimates[:, 0], 0.0)
    found = scatter(estimates, others)
    assert found.freedom == N_POSITIONS - 1
    assert found.p(estimates.mean(axis=0))[0] == pytest.approx(reference.pvalue, rel=1e-12)


@pytest.mark.parametrize(("n_states", "freedom"), [(2, 2), (4, 6), (6, 10)])
def test_without_a_change_p_is_even_and_the_limit_is_sure_as_often_as_it_says(n_states, freedom):
    """The scatter is known here: the limit of a drawn unit, over its error, is that of all."""
    rng, level = np.random.default_rng(n_states), 0.0025
    without, p_values = np.sqrt(2 / N_POSITIONS), []
    for _ in range(DRAWS):
        estimates, others = drawn(rng, n_states)
        found = scatter(estimates, others)
        p_values.append(found.p(estimates.mean(axis=0))[0])
    assert found.freedom == freedom
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    limit = without * float(found.detectable(level)[0] / found.error[0])
    shown = 0
    for _ in range(DRAWS):
        estimates, others = drawn(rng, n_states, limit)
        shown += scatter(estimates, others).p(estimates.mean(axis=0))[0] < level
    low, high = stats.binom.ppf([1e-3, 1 - 1e-3], DRAWS, POWER)
    assert low <= shown <= high


def test_further_states_show_a_fifth_of_the_change_that_two_of_three_positions_need():
    estimates, others = np.zeros((3, 1)), np.zeros((4, 3, 1))
    few, many = scatter(estimates, others[:0]), scatter(estimates, others)
    ratio = float(many.detectable(0.0025)[0] / few.detectable(0.0025)[0])
    assert 0.15 < ratio < 0.25

"""The scatter of mounting over positions and states: against textbook tests, and its limits against drawn changes."""

import numpy as np
import pytest
from scipy import stats

from pipeline.identification.change.kinds import KINDS
from pipeline.identification.change.loops import Curves, LoopSize
from pipeline.identification.change.scatter import POWER, Layout
from pipeline.identification.change.table import LoopNumber, LoopTable
from pipeline.statistics import differences

N_POSITIONS, DRAWS = 3, 300
LEVEL = 0.02


def drawn(rng: np.random.Generator, n_states: int, change: float = 0.0, n_numbers: int = 1) -> Layout:
    """Mounting scatters each state at each position by 1; states and positions differ; the second state changes."""
    shape = (n_states, N_POSITIONS, n_numbers)
    levels = 5.0 * rng.standard_normal((n_states, 1, n_numbers)) + 7.0 * rng.standard_normal((1, *shape[1:]))
    levels[1] += levels[0, 0] - levels[1, 0] + change
    state, position = (values.ravel() for values in np.indices(shape[:2]))
    return Layout(state, position, (levels + rng.standard_normal(shape)).reshape(-1, n_numbers))


@pytest.fixture(autouse=True)
def _fewer_rotations(monkeypatch):
    """A p of 2 % is known to 0.1 %, which is well below what so many draws see."""
    monkeypatch.setattr(differences, "ROTATIONS", 20_000)


def pair_weights(n_states: int) -> list[float]:
    return [-1.0, 1.0, *[0.0] * (n_states - 2)]


def table_of(shift: float, n_points: int = 5) -> LoopTable:
    """Three states at two positions; those of the first two err by 0.1 alike, the third lacks the halves.

    The torques of the second lie a share of their distance from those of the first.
    """
    state, position = np.repeat([0, 1, 2], 2), np.tile([0, 1], 3)
    size = LoopSize(4.0, 4.0)
    torques = [np.arange(5.0), np.arange(float(n_points)) + shift, np.arange(5.0), np.arange(5.0)]
    curves = [{size: Curves(dict.fromkeys((1, -1), torques[k]), {})} for k in state]
    number = LoopNumber(next(kind for kind in KINDS if not kind.positive), size)
    half = np.where(state < 2, 0.1, np.nan)[:, None]
    rows = np.zeros((6, 1))
    return LoopTable((), (number,), (), state, position, (), rows, (half, -half), (), tuple(curves))


@pytest.mark.parametrize(("shift", "n_points", "error"), [(0.0, 5, 0.0), (0.25, 5, 0.05), (0.0, 4, 0.2), (2.0, 5, 0.2)])
def test_what_states_measured_at_the_same_torques_err_alike_drops_out(shift, n_points, error):
    """Contrasts of the states that err by 0.1 each; the third has no weight."""
    assert table_of(shift, n_points).torque_error([-1.0, 1.0, 0.0])[0] == pytest.approx(error, abs=1e-12)


def test_loops_reach_what_both_senses_reach_on_both_sides():
    curves = {1: np.array([-2.0, 0.0, 3.0]), -1: np.array([-4.0, 1.0, 5.0])}
    assert Curves(curves, {}).reach == 2.0
    assert Curves(curves | {1: np.array([1.0, 3.0])}, {}).reach == 0.0
    assert Curves(curves | {1: np.zeros(0)}, {}).reach == 0.0


def test_a_weighted_state_whose_halves_lack_a_number_claims_nothing():
    error = table_of(0.0).torque_error([-1.0, 0.0, 1.0])
    assert np.isinf(error[0])
    found = drawn(np.random.default_rng(2), 3).contrast([-1.0, 0.0, 1.0], error)
    assert found.family.p[0] == pytest.approx(1.0)
    assert np.isnan(found.reach(0.95)[0])


def test_two_states_are_the_test_of_the_mean_difference():
    layout = drawn(np.random.default_rng(1), 2, 3.0)
    before, after = layout.values[:, 0].reshape(2, -1)
    reference = stats.ttest_rel(after, before)
    found = layout.contrast([-1.0, 1.0])
    assert layout.freedom == N_POSITIONS - 1
    assert found.p[0] == pytest.approx(reference.pvalue, rel=1e-9)
    assert found.mean[0] == pytest.approx(np.mean(after - before), rel=1e-12)


def test_missing_cells_keep_what_the_rest_determines():
    layout = drawn(np.random.default_rng(2), 3)
    rows = np.arange(len(layout.values)) != 8
    partial = Layout(layout.state[rows], layout.position[rows], layout.values[rows])
    assert partial.freedom == layout.freedom - 1
    exact = Layout(
        layout.state[rows], layout.position[rows], 2.0 * layout.state[rows, None] + layout.position[rows, None]
    )
    assert exact.contrast([-1.0, 0.0, 1.0]).mean[0] == pytest.approx(4.0, abs=1e-9)


def test_states_without_a_common_position_are_not_compared():
    state, position = np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1, 2, 3, 2, 3])
    layout = Layout(state, position, np.random.default_rng(3).standard_normal((6, 1)))
    assert layout.contrast([-1.0, 1.0, 0.0]) is None


@pytest.mark.parametrize(("n_states", "freedom"), [(2, 2), (4, 6), (6, 10)])
def test_without_a_change_p_is_even_and_the_limit_is_shown_as_often_as_it_says(n_states, freedom):
    """The scatter is known here: the limit of a drawn unit, over its error, is that of all."""
    rng, weights, p_values = np.random.default_rng(n_states), pair_weights(n_states), []
    for _ in range(DRAWS):
        found = drawn(rng, n_states).contrast(weights)
        p_values.append(found.p[0])
    assert found.freedom == freedom
    assert found.family.p[0] == pytest.approx(p_values[-1], abs=0.02)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    limit = np.sqrt(2 / N_POSITIONS) * float(found.detectable(LEVEL)[0] / found.error[0])
    shown = sum(drawn(rng, n_states, limit).contrast(weights).p[0] < LEVEL for _ in range(DRAWS))
    low, high = stats.binom.ppf([1e-3, 1 - 1e-3], DRAWS, POWER)
    assert low <= shown <= high


@pytest.mark.long
def test_of_pairs_without_a_change_two_in_a_hundred_are_named_over_all_numbers():
    rng = np.random.default_rng(8)
    alarms = sum(np.any(drawn(rng, 4, n_numbers=6).contrast(pair_weights(4)).family.p < LEVEL) for _ in range(DRAWS))
    low, high = stats.binom.ppf([1e-3, 1 - 1e-3], DRAWS, LEVEL)
    assert low <= alarms <= high


def test_further_states_show_a_third_of_the_change_that_two_of_three_positions_need():
    rng, limits = np.random.default_rng(9), []
    for n_states in (2, 5):
        found = drawn(rng, n_states).contrast(pair_weights(n_states))
        limits.append(float(found.detectable(LEVEL)[0] / found.error[0]))
    assert 0.3 < limits[1] / limits[0] < 0.5

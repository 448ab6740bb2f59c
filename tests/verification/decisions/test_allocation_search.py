"""The search of an allocation: shorter steps where the model misleads, no good point lost, no unit used twice."""

from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.decisions import allocation as allocation
from pipeline.decisions.allocation_search import Search, Trial, with_failures, yield_text
from pipeline.decisions.cheapest import LinearUnits, _log_loss, _soft_yield
from pipeline.statistics.intervals import pass_share

N = 4000
TARGET = 0.9
COSTS = 1.0, 1.0


class CurvedSearch(Search):
    """Badness that grows with the fourth power of the scales: a linear model of it oscillates without damping."""

    @property
    def bounds(self):
        return np.full(2, 0.2), np.full(2, 5.0)

    def cost(self, scale):
        return float(np.sum(np.array(COSTS) / scale))

    def costs(self):
        return [lambda scale, rate=rate: rate / scale for rate in COSTS]

    def drawn_badness(self, scale):
        rng = np.random.default_rng(next(self.sets))
        x = np.abs(rng.standard_normal((N, 2)))
        return x, np.sum(x * scale**4, axis=1) - 8.0

    def trial(self, scale):
        x, badness = self.drawn_badness(scale)
        slope = (4 * x * scale**3)[:, None, :]
        units = LinearUnits(scale, badness[:, None], slope)
        trial = Trial(scale, self.cost(scale), pass_share(badness <= 0, 0.95), units)
        self.tell(trial)
        return trial

    def check(self, scale):
        _, badness = self.drawn_badness(scale)
        return {"all_limits": pass_share(badness <= 0, 0.95)}


@pytest.fixture
def search():
    seen = []
    study = SimpleNamespace(metrics=SimpleNamespace(confidence=0.95))
    own_sets = count(1)
    told = CurvedSearch(study, (1, 2), ((0,), (1,)), N, None, None, 1, seen.append, own_sets)
    return told, seen


@pytest.mark.parametrize("start", [0.5, 1.0, 2.0])
def test_the_search_ends_at_the_cheapest_point_and_never_below_one_that_it_has_seen(search, start):
    own, seen = search
    first = own.trial(np.full(2, start))
    best = own.improve(first, TARGET, TARGET)
    trials = [item for item in seen if isinstance(item, Trial)]
    reaching = [trial.cost for trial in trials if trial.yield_estimate.value >= TARGET]
    assert best.yield_estimate.value >= TARGET
    assert best.cost == min(reaching)
    x = np.abs(np.random.default_rng(0).standard_normal((400_000, 2)))
    exact = (8.0 / np.quantile(x.sum(axis=1), TARGET)) ** 0.25  # by symmetry both scales are alike
    assert best.cost == pytest.approx(2 / exact, rel=0.03)


@pytest.mark.parametrize("value", [lambda units, logs: _soft_yield(units, 0.9, logs), _log_loss])
def test_slopes_of_the_soft_yield_and_the_loss_are_their_derivatives(value):
    rng, step = np.random.default_rng(5), 1e-6
    units = LinearUnits(np.ones(3), rng.normal(size=(40, 2)), rng.normal(size=(40, 2, 3)))
    logs = rng.normal(scale=0.1, size=3)
    slope = value(units, logs)[1]
    ends = [[value(units, logs + sign * step * axis)[0] for sign in (1, -1)] for axis in np.eye(3)]
    np.testing.assert_allclose(slope, [(high - low) / (2 * step) for high, low in ends], rtol=1e-5)


def test_a_unit_without_a_value_fails_as_much_as_the_worst():
    badness = np.array([[-1.0, 0.5], [np.nan, -2.0], [3.0, np.nan]])
    np.testing.assert_array_equal(with_failures(badness), [[-1.0, 0.5], [3.0, -2.0], [3.0, 3.0]])
    assert np.all(with_failures(np.array([[-1.0], [np.nan]])) == [[-1.0], [1.0]]), "where all others pass too"


def test_no_two_rounds_or_checks_share_a_unit(search):
    own, _ = search
    found = allocation._confirmed_trial(own, TARGET)
    used = next(own.sets)
    assert found.yield_estimate.value >= TARGET
    assert used > 4, "each trial and check took a set of its own"


def test_a_target_that_no_round_reached_is_not_aimed_at_again(search):
    """What no scale can mend, as play of a part without a cost: one search and one check."""
    own, _ = search
    checks = []

    class Stuck(CurvedSearch):
        def drawn_badness(self, scale):
            return super().drawn_badness(np.ones(2))[0], np.random.default_rng(next(self.sets)).normal(size=N)

        def check(self, scale):
            checks.append(scale)
            return super().check(scale)

    found = allocation._confirmed_trial(Stuck(**vars(own)), TARGET)
    assert found.yield_estimate.value == pytest.approx(0.5, abs=0.03)
    assert len(checks) == 1


def test_a_yield_is_said_with_its_interval_and_its_units():
    assert yield_text(pass_share(np.ones(4000, bool), 0.95)).endswith("(99.9 to 100.0; 4,000 units)")

"""Pairs of effects: linear least squares over two sizes that are not negative, and which pair comes first."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pipeline.identification.fitting.parameters import Vector
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.selection import pairs
from pipeline.identification.selection.pairs import LARGEST_AMOUNT, promising_pairs
from pipeline.identification.selection.screening import Promise

NAMES = ("coulomb", "torque_zero", "bearing_clearance")


@pytest.mark.parametrize("seed", range(12))
def test_amounts_are_the_least_squares_within_their_bounds(seed):
    rng = np.random.default_rng(seed)
    change, second_change, goal = rng.normal(size=(3, 20)) + rng.normal(size=(3, 1))
    best = lsq_linear(np.column_stack([change, second_change]), goal, (0.0, LARGEST_AMOUNT), tol=1e-12).x
    np.testing.assert_allclose(pairs._amounts(change, second_change, goal), best, atol=1e-6)


def test_a_pair_is_found_though_a_third_effect_is_the_best_alone(monkeypatch):
    """Two changes at right angles make the goal; a third one lies between them, and no pair with it gets there."""
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(50, 3)))[0].T
    changes = {
        "coulomb": axes[0],
        "torque_zero": 2.0 * axes[1],
        "bearing_clearance": axes[0] + axes[1] + 0.3 * axes[2],
    }
    base = SimpleNamespace(unknowns=Vector(np.zeros(0), np.zeros(0), np.zeros(0)), sigma=None, cost=1.0)

    class Looking:
        def __init__(self, fitter, cells, base, sigma):
            self.fitter, self.base = fitter, base
            self.residual_left = 0.7 * changes["coulomb"] + 0.4 * changes["torque_zero"]

        def unfollowed_part(self, values):
            return values

        def change(self, effect, shares):
            return changes[effect.name]

    monkeypatch.setattr(pairs, "Screening", Looking)
    effects = {name: candidates()[name] for name in NAMES}
    bounds = {"coulomb": (0.0, 5.0), "torque_zero": (-5.0, 5.0), "bearing_clearance": (0.0, 5.0)}
    fitter = SimpleNamespace(problem=SimpleNamespace(bounds=lambda effect: (bounds[effect.name],)))
    promises = {name: Promise(0.5, (Vector(np.zeros(0), np.array([0.9]), np.zeros(0)),)) for name in NAMES}
    (model, start), *remaining = promising_pairs(fitter, np.ones(50, bool), base, promises, effects, 3, 0.0)
    assert model.name == "coulomb+torque_zero"
    np.testing.assert_allclose(start.shares, [0.7 * 0.9, 0.5 + 0.4 * (0.9 - 0.5)], atol=1e-9)
    assert len(remaining) == 2

"""Reducers on their bearings for the tests of the equilibrium, and what a solution of theirs must fulfil."""

import numpy as np
import pytest
from reducers import SMALL, laws_of, random_compliance, reducer_at

from pipeline.model.equilibrium.solve import ACCEPTED_RESIDUAL, ElasticReducer, solve
from pipeline.model.geometry.reducer import Bearing

BEARINGS = {
    "linear": (Bearing(2e5, 1.0), 0.0),
    "clearance": (Bearing(2e5, 1.0), 4e-3),
    "hertzian": (Bearing(4e6, 1.5), 0.0),
    "hertzian with clearance": (Bearing(4e6, 1.5), 4e-3),
    "roller": (Bearing(5e5, 10 / 9), 2e-3),
}
EACH_BEARING = pytest.mark.parametrize(("bearing", "clearance"), BEARINGS.values(), ids=BEARINGS)
PLATES = pytest.mark.parametrize("floats", [False, True], ids=["rotates", "floats"])
TORQUES = np.array([50.0, 1500.0, 12000.0])  # [N mm]


class Model:
    """The small reducer with random compliance; ``solve`` and an independent check of what it returns."""

    def __init__(self, *, floats=False, bearing=BEARINGS["linear"][0], clearance=0.0, law="hertz", crank=0.4, seed=0):
        self.at = reducer_at(SMALL, crank, floats=floats)
        self.laws = laws_of(SMALL, self.at, law)
        self.bearing, self.clearance = bearing, clearance
        self.compliance = random_compliance(len(self.laws), np.random.default_rng(seed))

    def solve(self, gap, torque, start=None):
        n = len(gap)
        start = np.zeros((n, len(self.at.motions))) if start is None else start
        return solve(
            ElasticReducer(self.at, self.bearing, self.laws, self.compliance),
            gap,
            np.full(n, self.clearance),
            start,
            np.asarray(torque),
        )

    def bearing_force(self, motion):
        """Force of the disk on its bearing (..., 2) [N]: stiffness (d - clearance)^exponent along d."""
        shift = motion[..., :2]
        distance = np.linalg.norm(shift, axis=-1, keepdims=True)
        push = self.bearing.stiffness * np.maximum(distance - self.clearance, 0) ** self.bearing.exponent
        return push * shift / np.maximum(distance, 1e-300)

    def unbalanced(self, solution, torque):
        """Largest unbalanced force [N] or moment [N mm] over the largest contact force, over arms of 1 mm at least."""
        total = solution.force @ self.at.contact_jacobian
        total[..., :2] += self.bearing_force(solution.motion)
        total[..., self.at.output_motion] -= torque
        return (
            np.max(np.abs(total) / np.maximum(np.abs(self.at.contact_jacobian).max(axis=0), 1.0)) / solution.force.max()
        )

    def misfit(self, solution, gap):
        """Largest misfit of a closed contact and largest penetration of an open one [mm]."""
        room = gap[:, None] + solution.force @ self.compliance - solution.motion @ self.at.contact_jacobian.T
        in_contact = solution.force > 0
        of_closed = np.abs(room + self.laws.deflection(solution.force))[in_contact]
        return of_closed.max(initial=0), np.max(-room[~in_contact], initial=0)

    def complementary_energy(self, force, gap):
        """Energy whose least value over balanced forces is the solution (linear bearing)."""
        shift = -(force @ self.at.contact_jacobian)[:2]
        return (
            self.laws.energy(force).sum()
            + 0.5 * force @ self.compliance @ force
            + gap @ force
            + shift @ shift / (2 * self.bearing.stiffness)
        )


def random_gaps(model, n, seed, low=-1e-3, high=6e-3):
    return np.random.default_rng(seed).uniform(low, high, (n, len(model.laws)))


def assert_equilibrium(model, solution, gap, torque, tolerance=1e-8):
    assert solution.converged.all()
    assert solution.residual.max() <= ACCEPTED_RESIDUAL
    assert solution.force.min() >= 0
    assert model.unbalanced(solution, torque) < tolerance
    closing_values, opening = model.misfit(solution, gap)
    assert closing_values < 1e-9 * np.abs(solution.motion).max() + 1e-12
    assert opening < 1e-11

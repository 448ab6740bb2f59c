"""Levenberg and Marquardt's descent of one fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.identification.fitting import Fit, Fitter, Vector
    from pipeline.identification.problem import Model

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

SETTLED = 1e-6
"""Relative fall of the sum of squares at which a fit has settled."""
FIRST_DAMPING, LEAST_DAMPING = 1e-3, 1e-6
EASED, STIFFENED = 5.0, 8.0
"""Factors of the damping after a step that falls, and after one that does not."""
TRIES = 6


class Descent:
    """A fit on its way: unknowns, misfit and derivatives.

    Attributes
    ----------
    now : unknowns.
    misfit : (n_fitted,) residuals of the cells fitted, offsets removed, in sigmas.
    jacobian : (n_cells, n_unknowns) [arcmin], offsets removed within the cells fitted.
    penalty : (n_unknowns,) inverse standard deviations by which the unknowns are held.
    """

    def __init__(self, fitter: Fitter, model: Model, fitted: Truth, start: Vector, near: Fit | None, frozen: bool):
        self.fitter, self.model, self.fitted, self.near = fitter, model, fitted, near
        self.frozen = frozen and near is not None
        data = fitter.problem.data
        self.weight = np.where(fitted, 1 / data.sigma**2, 0.0)
        self.root = np.sqrt(self.weight[fitted])
        self.positions = np.unique(data.position[fitted]).tolist()
        self.prior = self.penalty = fitter.penalty(start)
        self.damping = FIRST_DAMPING
        self.known = None if near is None else (near.unknowns.scales, near.jacobian)
        self.angle, self.influence, _ = self._predicted(start)
        self.now, self.misfit = start, self._misfit(self.angle)
        self.cost = self._cost(self.misfit, start)
        self.jacobian = np.zeros((len(data), len(start.flat)))
        if np.isfinite(self.cost):
            self._derive()

    def run(self, iterations: int) -> None:
        """At most some steps, until the sum of squares settles."""
        for _ in range(iterations if np.isfinite(self.cost) else 0):
            # a model that misses the data by more than their noise knows as much less of tolerances
            self.penalty = self.prior * max(1.0, float(np.sqrt(np.mean(self.misfit**2))))
            self.cost = self._cost(self.misfit, self.now)
            fall = self._step()
            if fall == 0.0 and self.stale:
                self.known = None
                self._derive()
                fall = self._step()
            if fall > 0.0:
                self._derive()
            if fall < SETTLED * max(self.cost, 1.0):
                break

    def _step(self) -> float:
        """Fall of the sum of squares by the first damped step that falls; 0 where none does."""
        rows = self.jacobian[self.fitted] * self.root[:, None]
        hessian = rows.T @ rows + np.diag(self.penalty**2)
        gradient = rows.T @ self.misfit - self.penalty**2 * self.now.flat
        free = self.now.free(gradient)
        for _ in range(TRIES):
            trial = self.now.like(self.now.flat + damped_step(hessian, gradient, free, self.damping))
            angle, influence, _ = self._predicted(trial)
            misfit = self._misfit(angle)
            cost = self._cost(misfit, trial)
            if np.isfinite(cost) and cost < self.cost:
                fall = self.cost - cost
                self.now, self.angle, self.influence, self.misfit, self.cost = trial, angle, influence, misfit, cost
                self.damping = max(self.damping / EASED, LEAST_DAMPING)
                return fall
            self.damping *= STIFFENED
        return 0.0

    def _predicted(self, unknowns: Vector) -> tuple[Real, Real, bool]:
        return self.fitter.predict(self.model, unknowns, self.positions, modes=not self.frozen)

    def _misfit(self, angle: Real) -> Real:
        return self.fitter.centred(self.fitter.problem.data.angle - angle, self.weight)[self.fitted] * self.root

    def _cost(self, misfit: Real, unknowns: Vector) -> float:
        with np.errstate(over="ignore", invalid="ignore"):  # an equilibrium that was not found
            return float(misfit @ misfit + np.sum((self.penalty * unknowns.flat) ** 2))

    def _derive(self) -> None:
        if self.frozen and self.near is not None:
            self.jacobian, self.stale = self.fitter.centred(self.near.jacobian, self.weight), False
            return
        before = self.known
        self.jacobian, self.known = self.fitter.jacobian(
            self.model, self.now, self.angle, self.influence, self.positions, self.weight, before
        )
        self.stale = before is not None and self.known[0] is before[0]


def damped_step(hessian: Real, gradient: Real, free: Truth, damping: float) -> Real:
    """Levenberg and Marquardt's step (n_unknowns,) of the ``free`` unknowns; the others stay."""
    step = np.zeros_like(gradient)
    own = hessian[np.ix_(free, free)]
    scaled = own + damping * np.diag(np.maximum(np.diag(own), 1e-12))
    step[free] = np.linalg.lstsq(scaled, gradient[free], rcond=None)[0]
    return step

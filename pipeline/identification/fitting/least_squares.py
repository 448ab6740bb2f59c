"""Levenberg and Marquardt's descent of one fit.

Where contacts open and close, the misfit has kinks. Derivatives at a point hold on one side of a kink alone, and a
descent by them ends there, far from the least sum of squares. Derivatives that are averaged over draws of the unknowns,
with the spread that the data leave them, take both sides into account (``run_averaged``).

Source: posterior linearisation: Garcia-Fernandez, Svensson, Morelande and Sarkka, IEEE Trans. Signal Process. 63 (2015)
5561; averaged derivatives of functions with kinks: Duchi, Bartlett and Wainwright, SIAM J. Optim. 22 (2012) 674.
"""

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import brentq

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Rounding, Shortcut, ShortcutCount, ShortcutGrid
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.parameters import Fit, Prediction, Vector
from pipeline.identification.fitting.problem import Model

if TYPE_CHECKING:
    from pipeline.identification.fitting.fitter import Fitter


SETTLED_CHANGE: Shortcut = 0.02
"""Fall of the sum of squares, in mean squares of a cell, at which a fit has settled: 0.14 standard deviations."""
FIRST_DAMPING: Shortcut = 1e-3
"""Levenberg's damping at the start, relative to the diagonal."""
LEAST_DAMPING: Shortcut = 1e-6
"""The same at least."""
DAMPING_INCREASE: Shortcut = 8.0
"""Factor of the damping after a step that does not lower the misfit."""
SMALL: Rounding = 1e-6
"""Mean square of a cell, in noise, that only rounding leaves."""
TRIES: ShortcutCount = 6
"""Dampings that are tried, each eight times the one before, until a step lowers the misfit."""
SPREADS: ShortcutGrid = (1.0, 1.0, 1.0, 0.5, 0.5, 0.25, 0.25)
"""Of each step by averaged derivatives: spread of the draws, in that of the unknowns' posterior."""
PAIRS_OF_DRAWS: ShortcutCount = 8
"""Draws of a step, each with its opposite."""
AVERAGED_DAMPING: Shortcut = 1e-2
"""Damping of a step by averaged derivatives, relative to the diagonal."""


class Descent:
    """A fit on its way: unknowns, misfit and derivatives.

    Attributes
    ----------
    unknowns : unknowns.
    prediction : prediction there.
    sigma : (n_cells,) [arcmin] of the noise, and of what the form of the model misses.
    misfit : (n_fitted,) residuals of the cells fitted, offsets removed, in sigmas.
    jacobian : (n_cells, n_unknowns) [arcmin], offsets removed within the cells fitted.
    penalty, centre : (n_unknowns,) inverse standard deviations by which the unknowns are held, and where.
    """

    def __init__(self, fitter: "Fitter", model: Model, is_fitted: Truth, start: Vector, base_fit: Fit | None):
        self.fitter, self.model, self.is_fitted = fitter, model, is_fitted
        data = fitter.problem.data
        self.positions = np.unique(data.position[is_fitted]).tolist()
        self.penalty, self.centre = fitter.penalty(start), fitter.centre(model, start)
        self.repeats = _repeats(data, is_fitted)
        self.damping = FIRST_DAMPING
        self.base_slopes = None if base_fit is None else (base_fit.unknowns.scales, base_fit.jacobian)
        self.prediction = self._predict(start)
        self.unknowns = start
        self._weigh(data.sigma)
        self._jacobian: Real | None = None if np.isfinite(self.cost) else np.zeros((len(data), len(start.flat)))

    @property
    def jacobian(self) -> Real:
        """Derivatives where the descent is, made when they are asked for: of several starts one goes on."""
        if self._jacobian is None:
            self._jacobian = self._derivatives()
        return self._jacobian

    def run(self, iterations: int, rival_cost: float = np.inf, further: int = 0) -> None:
        """At most some steps, until the sum of squares settles.

        Or until it would stay beyond ``rival_cost``, in the noise, though all steps that are left, and ``further`` ones
        of another run, fell as the last.
        """
        former = np.inf
        for left in range(iterations if np.isfinite(self.cost) else 0, 0, -1):
            in_noise = self.in_noise
            if in_noise - (left + further) * (former - in_noise) > rival_cost:
                break
            former = in_noise
            self._weigh(self._with_form())
            fall = self._step()
            if fall < self.little and self.stale:
                self.base_slopes, self._jacobian = None, None
                fall = self._step()
            if fall > 0.0:
                self._jacobian = None
            if fall < self.little:
                break

    def run_averaged(self) -> None:
        """Take steps by derivatives that are averaged over draws of the tolerances.

        The draws are from the posterior of the tolerance modes, the other unknowns held, and their spread falls from
        step to step (``SPREADS``). A step lowers the sum of squares of the mean prediction of the draws; that at the
        unknowns themselves may rise. The generator has a fixed seed, so that a fit can be repeated.
        """
        n_modes, generator = self.prediction.influence.shape[1], np.random.default_rng(0)
        for spread in SPREADS if np.isfinite(self.cost) and n_modes else ():
            self._weigh(self._with_form())
            hessian, _ = self._system(self.jacobian, self.misfit)
            one_side = generator.standard_normal((n_modes, PAIRS_OF_DRAWS))
            draws = solve_triangular(cholesky(hessian[-n_modes:, -n_modes:]), spread * np.hstack([one_side, -one_side]))
            change, influence = self.fitter.mean_of_draws(
                self.model, self.unknowns, self.prediction, draws.T, self.positions
            )
            misfit = self._misfit(self.prediction.angle + change)
            hessian, gradient = self._system(np.hstack([self.jacobian[:, :-n_modes], influence]), misfit)
            if not np.all(np.isfinite(gradient)):
                break
            is_free = self.unknowns.is_free(gradient)
            step = damped_step(hessian, gradient, is_free, AVERAGED_DAMPING, self.unknowns.room)
            there = self.unknowns.like(self.unknowns.flat + step)
            prediction = self._predict(there)
            if not prediction.sound:
                break
            self.unknowns, self.prediction, self._jacobian = there, prediction, None
            self._weigh(self.sigma)

    def _rows(self, jacobian: Real) -> Real:
        """Derivatives (n_fitted, n_unknowns) of the predicted angle in sigmas, from those at all cells [arcmin]."""
        return np.asarray(self.fitter.centred_values(jacobian, self.weight)[self.is_fitted] * self.root[:, None])

    def _system(self, jacobian: Real, misfit: Real) -> tuple[Real, Real]:
        """Gauss-Newton matrix of half the sum of squares, and its negative gradient (n_unknowns,), with the priors."""
        rows = self._rows(jacobian)
        hessian = rows.T @ rows + np.diag(self.penalty**2)
        return hessian, rows.T @ misfit - self.penalty**2 * (self.unknowns.flat - self.centre)

    @property
    def little(self) -> float:
        """Fall of the sum of squares that is none."""
        return SETTLED_CHANGE * max(self.cost / max(len(self.misfit), 1), SMALL)

    def _with_form(self) -> Real:
        """Standard deviation of every cell with what the form of the model misses, alike over the rows of the cells.

        As much of it as makes the mean square residual 1: such a model knows as much less of tolerances, and cells that
        are measured best do not decide where it errs. It is the same in every cycle of a branch, which together count
        as one.
        """
        data = self.fitter.problem.data
        noise = data.sigma[self.is_fitted] ** 2
        square = (self.misfit * self.sigma[self.is_fitted]) ** 2
        spread = (np.mean(data.count) / data.count)[self.is_fitted]
        if np.mean(square / noise) <= 1.0:
            return data.sigma
        largest_form = float(np.mean(square / spread))
        form = brentq(lambda form: np.mean(square / (noise + form * spread)) - 1.0, 0.0, largest_form, xtol=1e-300)
        sigma: Real = np.sqrt(data.sigma**2 + form * self.repeats * np.mean(data.count) / data.count)
        return sigma

    def _weigh(self, sigma: Real) -> None:
        """Give the cells their weights."""
        self.sigma = sigma
        self.weight = np.where(self.is_fitted, 1 / sigma**2, 0.0)
        self.root = np.sqrt(self.weight[self.is_fitted])
        self.misfit = self._misfit(self.prediction.angle)
        self.cost = self._cost(self.misfit, self.unknowns)

    @property
    def in_noise(self) -> float:
        """Sum of squares in sigmas of the noise alone, and of the priors: it compares models."""
        misfit = self.misfit * (self.sigma / self.fitter.problem.data.sigma)[self.is_fitted]
        return self._cost(misfit, self.unknowns)

    def _step(self) -> float:
        """Fall of the sum of squares by the first damped step that falls; 0 where none does.

        Where contacts open and close, derivatives hold for short steps alone. The damping is therefore eased by how
        much of the fall that they promise came true (Nielsen, Damping parameter in Marquardt's method, report
        IMM-REP-1999-05, Technical University of Denmark), else the next step would be tried in vain.
        """
        hessian, gradient = self._system(self.jacobian, self.misfit)
        is_free = self.unknowns.is_free(gradient)
        for _ in range(TRIES):
            step = damped_step(hessian, gradient, is_free, self.damping, self.unknowns.room)
            expected_fall = step @ (2 * gradient - hessian @ step)
            if expected_fall < self.little:
                return 0.0
            trial = self.unknowns.like(self.unknowns.flat + step)
            trial_prediction = self._predict(trial)
            misfit = self._misfit(trial_prediction.angle)
            cost = self._cost(misfit, trial)
            if np.isfinite(cost) and cost < self.cost:
                fall = self.cost - cost
                self.unknowns, self.prediction, self.misfit, self.cost = trial, trial_prediction, misfit, cost
                easing = max(1 / 3, 1 - (2 * fall / float(expected_fall) - 1) ** 3)
                self.damping = max(self.damping * easing, LEAST_DAMPING)
                return fall
            self.damping *= DAMPING_INCREASE
        return 0.0

    def _predict(self, unknowns: Vector) -> Prediction:
        return self.fitter.predict(self.model, unknowns, self.positions, modes=True)

    def _misfit(self, angle: Real) -> Real:
        return (
            self.fitter.centred_values(self.fitter.problem.data.angle - angle, self.weight)[self.is_fitted] * self.root
        )

    def _cost(self, misfit: Real, unknowns: Vector) -> float:
        with np.errstate(over="ignore", invalid="ignore"):  # an equilibrium that was not found
            return float(misfit @ misfit + np.sum((self.penalty * (unknowns.flat - self.centre)) ** 2))

    def _derivatives(self) -> Real:
        known_before = self.base_slopes
        jacobian, self.base_slopes = self.fitter.jacobian(
            self.model, self.unknowns, self.prediction, self.positions, self.weight, known_before
        )
        self.stale = known_before is not None and self.base_slopes[0] is known_before[0]
        return jacobian


def _repeats(data: Data, is_fitted: Truth) -> Real:
    """Cycles in which the branch of each cell (n_cells,) was fitted, at least one."""
    pairs = np.unique(np.column_stack([data.branch, data.block])[is_fitted], axis=0)
    return np.maximum(np.bincount(pairs[:, 0], minlength=int(data.branch.max()) + 1)[data.branch], 1.0)


def damped_step(hessian: Real, gradient: Real, is_free: Truth, damping: float, room: tuple[Real, Real]) -> Real:
    """Levenberg and Marquardt's step (n_unknowns,) of the ``is_free`` unknowns; the others stay.

    An unknown that would leave its ``room`` (least and largest step, each (n_unknowns,)) stops there, and the others
    step on with it.
    """
    step, is_free = np.zeros_like(gradient), is_free.copy()
    damped_hessian = hessian + damping * np.diag(np.maximum(np.diag(hessian), 1e-12))
    while np.any(is_free):
        right_side = gradient[is_free] - damped_hessian[np.ix_(is_free, ~is_free)] @ step[~is_free]
        step[is_free] = np.linalg.solve(damped_hessian[np.ix_(is_free, is_free)], right_side)
        clipped_step = np.clip(step, *room)
        at_bound = is_free & (clipped_step != step)
        step = clipped_step
        if not np.any(at_bound):
            break
        is_free &= ~at_bound
    return step

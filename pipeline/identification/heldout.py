"""What a fitted model predicts of cells that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting import Fit, Fitter
from pipeline.identification.problem import Data

Real = NDArray[np.float64]
Whole = NDArray[np.int64]
Truth = NDArray[np.bool_]

LEAST_LOSS = 0.1
"""Loss below which blocks are alike: far under the noise floor."""
FOLD_ITERATIONS = 4
OPEN_SHARE = 0.3
"""Standard deviation, in shares of its bounds, of a parameter that the cells seen do not determine at all."""
FAILED = 1e3
"""Residual in sigmas of a cell that could not be predicted."""


@dataclass(frozen=True)
class Trial:
    """A model fitted to a set of cells and judged on held-out groups of it.

    Attributes
    ----------
    fit : to all the cells.
    held_out : (n_cells,) [arcmin] prediction of each cell by the fold that left it out; NaN outside the cells.
    losses : (n_blocks,) mean square of the held-out residuals of each block, in sigmas, with what it takes of the
        tolerances' uncertainty.
    """

    fit: Fit
    held_out: Real
    losses: Real

    @property
    def scores(self) -> Real:
        """Logarithms of the losses (n_blocks,): a few blocks that a model misses badly do not decide a test."""
        return np.log(LEAST_LOSS + self.losses)

    @property
    def rms(self) -> float:
        """Root of the mean loss, 1 at the noise floor."""
        return float(np.sqrt(np.mean(self.losses)))


def groups(data: Data, cells: Truth) -> Whole:
    """What is left out at once (n_cells,): positions if the cells have two, else cycles."""
    return data.position if len(np.unique(data.position[cells])) > 1 else data.cycle


def trial(fitter: Fitter, fit: Fit, cells: Truth) -> Trial:
    """Held-out losses of a fitted model, each group of the cells left out in turn.

    Notes
    -----
    The folds start from the fit to all cells and keep its derivatives: the optimum moves little.
    """
    data = fitter.problem.data
    group = groups(data, cells)
    held, strain = np.full(len(data), np.nan), np.zeros(len(data))
    for one in np.unique(group[cells]):
        left_out = cells & (group == one)
        fold = fitter.fit(fit.model, cells & ~left_out, fit.unknowns, FOLD_ITERATIONS, fit, frozen=True)
        held[left_out], strain[left_out] = conditioned(fitter, fold, cells & ~left_out, left_out)
    return Trial(fit, held, block_losses(data, held, strain, cells))


def conditioned(fitter: Fitter, fold: Fit, seen: Truth, left_out: Truth) -> tuple[Real, float]:
    """Prediction of the cells left out, and what it costs per cell.

    Notes
    -----
    The cells seen tell only part of what the prediction needs: of the offset, of unmeasured tolerances, of a phase
    over the crank angle. Like the offset, all unknowns are conditioned on the cells left out, with what the others
    leave open as their prior. With that prior's share in the loss this is the Mahalanobis distance of the residual
    under the covariance of its prediction, ``sigma^2 + J covariance J'``.

    Returns
    -------
    Angles (n_left_out,) [arcmin], and the square of the unknowns' shifts over their uncertainty, per cell.
    """
    data = fitter.problem.data
    predicted, sigma, penalty = fold.predicted[left_out], fold.sigma[left_out], fitter.penalty(fold.unknowns)
    if not penalty.size or not np.all(np.isfinite(predicted)):
        return predicted, 0.0
    rows = fold.jacobian[seen] / fold.sigma[seen][:, None]
    precision = rows.T @ rows + np.diag(np.maximum(penalty, 1 / OPEN_SHARE) ** 2)
    own = fold.jacobian[left_out] / sigma[:, None]
    shift = np.linalg.solve(own.T @ own + precision, own.T @ ((data.angle[left_out] - predicted) / sigma))
    return predicted + sigma * (own @ shift), float(shift @ precision @ shift) / len(sigma)


def block_losses(data: Data, predicted: Real, strain: Real, cells: Truth) -> Real:
    """Mean square residual of every block (n_blocks,), in sigmas, and its ``strain`` (n_cells,)."""
    square = ((data.angle - predicted) / data.sigma) ** 2 + strain
    square = np.where(np.isfinite(square), square, FAILED**2)
    _, index = np.unique(data.block[cells], return_inverse=True)
    return np.bincount(index, square[cells]) / np.bincount(index)

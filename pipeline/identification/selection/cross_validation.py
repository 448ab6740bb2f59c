"""What a fitted model predicts of cells that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

LEAST_LOSS = 0.1
"""Loss below which blocks are alike: far under the noise floor."""
FAILED = 1e3
"""Residual in sigmas of a cell that could not be predicted."""


@dataclass(frozen=True)
class Trial:
    """A model fitted to a set of cells and judged on held-out groups of it.

    Attributes
    ----------
    fit : to all the cells.
    losses : (n_blocks,) of each block when its group is left out: Mahalanobis distance of the cells' residuals under
        the covariance of their prediction, per cell; 1 where only noise is left.
    """

    fit: Fit
    losses: Real

    @property
    def scores(self) -> Real:
        """Logarithms of the losses (n_blocks,): a few blocks that a model misses badly do not decide a test."""
        return np.log(LEAST_LOSS + self.losses)

    @property
    def rms(self) -> float:
        """Root of the mean loss, 1 at the noise floor."""
        return float(np.sqrt(np.mean(self.losses)))


def trial(fitter: Fitter, fit: Fit, cells: Truth) -> Trial:
    """Held-out losses of a fitted model, each group of the cells left out in turn.

    Notes
    -----
    The cells seen tell only part of what the prediction of the others needs: of the offset, of tolerances, of a phase
    over the crank angle. So the distance is taken under ``sigma^2 + J C J'`` with C the covariance of the unknowns that
    the cells seen leave. By Woodbury's identity it is the residual of the fit to all cells, and on top of it the way
    that the fit moves when the group is left out, over its uncertainty: nothing is predicted anew. Linear in that way.
    """
    data, group = fitter.problem.data, fitter.problem.data.held_out_parts(cells)
    strain = np.zeros(len(data))
    parts = np.unique(group[cells])
    for part in parts if len(parts) > 1 else []:  # one loop alone is judged in sample
        left_out = cells & (group == part)
        step, precision = _moved(fitter, fit, cells & ~left_out)
        strain[left_out] = step @ precision @ step / left_out.sum()
    return Trial(fit, block_losses(data, fit.predicted, strain, cells))


def _moved(fitter: Fitter, fit: Fit, visible: Truth) -> tuple[Real, Real]:
    """How the unknowns (n_unknowns,) move if only the cells seen are fitted, and the precision that these give them."""
    data, penalty = fitter.problem.data, fitter.penalty(fit.unknowns)
    deviation = fit.unknowns.flat - fitter.centre(fit.model, fit.unknowns)
    rows = fit.jacobian[visible] / fit.sigma[visible][:, None]
    misfit = ((data.angle - fit.predicted) / fit.sigma)[visible]
    precision = precision_of(fitter, fit, visible)
    if data.common_offset:
        rows = np.column_stack([rows, 1 / fit.sigma[visible]])
        deviation, penalty = np.append(deviation, 0.0), np.append(penalty, 0.0)
        precision = np.pad(precision, (0, 1))
        precision[-1, :] = precision[:, -1] = rows.T @ rows[:, -1]
    gradient = rows.T @ misfit - penalty**2 * deviation
    free = np.ones(len(gradient), bool)
    free[: len(fit.unknowns.flat)] = fit.unknowns.free(gradient[: len(fit.unknowns.flat)])
    step = np.zeros(len(gradient))
    step[free] = np.linalg.solve(precision[np.ix_(free, free)], gradient[free])
    return step, precision


def precision_of(fitter: Fitter, fit: Fit, visible: Truth) -> Real:
    """Inverse covariance (n_unknowns, n_unknowns) of the unknowns of a fit, by the cells seen and the priors."""
    rows = fit.jacobian[visible] / fit.sigma[visible][:, None]
    precision = rows.T @ rows + np.diag(fitter.penalty(fit.unknowns) ** 2)
    return precision + 1e-12 * np.trace(precision) * np.eye(len(precision))


def block_losses(data: Data, predicted: Real, strain: Real, cells: Truth) -> Real:
    """Mean square residual of every block (n_blocks,), in sigmas, and its ``strain`` (n_cells,)."""
    square = ((data.angle - predicted) / data.sigma) ** 2 + strain
    square = np.where(np.isfinite(square), square, FAILED**2)
    _, index = np.unique(data.block[cells], return_inverse=True)
    return np.bincount(index, square[cells]) / np.bincount(index)

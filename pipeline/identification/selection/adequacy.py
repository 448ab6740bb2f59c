"""The test that ``adequate`` and every name have to pass: unused cells are predicted as a right model would."""

from collections.abc import Mapping

import numpy as np
from scipy.special import ndtri, stdtrit

from pipeline.arrays import Real
from pipeline.identification.fitting.data import Data
from pipeline.identification.selection.held_out import Folds
from pipeline.statistics.resampling import CONFIDENCE


def failed_test(data: Data, folds: Folds, baselines: Mapping[str, Real], form: float, is_named: bool = False) -> str:
    """Why a refitted model is not adequate, or "": the one without effects, or the one with those that are named.

    Parameters
    ----------
    baselines : by title, predictions without a reducer (n_cells,) [arcmin] of the same cells.
    form : structure, in the noise of a cell, that the form of the model may leave.

    Notes
    -----
    A right model leaves noise, what the training cells leave open, and a structure of the size of its form. The scatter
    between positions is not part of it: an effect of the crank angle that is missed is scatter, too. A baseline has to
    be ahead of a right model: by more than what the training cells leave open.
    """
    if folds.in_sample:
        return "nothing is held out, so the fit cannot be tested"
    predicted_angle, (right_squares, variance) = folds.recalibrated_curve, folds.right_recalibrated
    if is_named:
        predicted_angle, (right_squares, variance) = folds.best_curve, folds.right_best
    square = ((data.angle - predicted_angle) / data.sigma)[folds.cells] ** 2
    largest_square = right_squares + len(square) * form**2 + float(ndtri(CONFIDENCE)) * np.sqrt(variance)
    if not np.sum(square) <= largest_square:
        ratio = np.sqrt(np.sum(square) / right_squares)
        return f"unused data are missed by {ratio:.2g} times what a right model would leave"
    open_square = right_squares / len(square) - 1
    for title, curve in baselines.items():
        if _is_ahead(data, folds, square - open_square, curve, CONFIDENCE ** (1 / len(baselines))):
            return f"{title} predicts unused data better"
    return ""


def _is_ahead(data: Data, folds: Folds, square: Real, curve: Real, level: float) -> bool:
    """Whether a prediction (n_cells,) is better than squares (n_judged,) in noise, by a t test over the branches."""
    of_curve = ((data.angle - curve) / data.sigma)[folds.cells] ** 2
    _, block = np.unique(data.block[folds.cells], return_inverse=True)
    gain = np.bincount(block, square - of_curve) / np.bincount(block)
    if len(gain) < 2 or not np.all(np.isfinite(gain)):
        return False
    error = gain.std(ddof=1) / np.sqrt(len(gain))
    return bool(gain.mean() > float(stdtrit(len(gain) - 1, level)) * error)

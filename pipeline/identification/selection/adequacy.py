"""The test that ``adequate`` and every name have to pass: unused cells are predicted as a right model would."""

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri, stdtrit

from pipeline.arrays import Real
from pipeline.identification.fitting.data import Data
from pipeline.identification.selection.held_out import Folds
from pipeline.statistics.resampling import CONFIDENCE


def failed_test(data: Data, folds: Folds, baselines: Mapping[str, Real], form: float) -> str:
    """Why a refitted model is not adequate, or "": the one without effects, or the one with those that are named.

    Parameters
    ----------
    baselines : by title, predictions without a reducer (n_cells,) [arcmin] of the same cells.
    form : structure, in the noise of a cell, that the form of the model may leave.

    Notes
    -----
    Of a right model the cells left out add a sum of squares to the fit that is chi-square with one degree of freedom
    for each cell; a structure of the size of the model's form may come on top. The scatter between positions is not
    part of it: an effect of the crank angle that is missed is scatter, too. A baseline has to be ahead of a right
    model: by more than what the training cells leave open.
    """
    if folds.in_sample:
        return "nothing is held out, so the fit cannot be tested"
    n_cells = int(np.sum(folds.cells))
    if not folds.added_squares <= float(chdtri(n_cells, 1 - CONFIDENCE)) + n_cells * form**2:
        ratio = np.sqrt(folds.added_squares / n_cells)
        return f"unused data are missed by {ratio:.2g} times what a right model would leave"
    square = ((data.angle - folds.tested_curve) / data.sigma)[folds.cells] ** 2
    for title, curve in baselines.items():
        if _is_ahead(data, folds, square - folds.open_square, curve, CONFIDENCE ** (1 / len(baselines))):
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

"""Loops of several samples laid upon each other, and their spread as a frame that figures draw as a band."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

LOW, HIGH = 0.05, 0.95
"""Shares of the samples below the ends of a band."""


def spread_frame(values: NDArray[np.float64], **keys: NDArray) -> pd.DataFrame:
    """5th and 95th percentile and median of each column over the samples.

    Parameters
    ----------
    values : (n_samples, n_columns), in any unit.
    keys : (n_columns,) each; what the columns stand for.

    Returns
    -------
    Frame of n_columns rows with the keys, ``low``, ``middle`` and ``high``.
    """
    low, middle, high = np.quantile(values, [LOW, 0.5, HIGH], axis=0, method="median_unbiased")
    return pd.DataFrame({**keys, "low": low, "middle": middle, "high": high})


def centred_loops(angle: NDArray[np.float64], branch: NDArray, torque: NDArray[np.float64]) -> NDArray[np.float64]:
    """Loops (n, n_steps) about the middle of their width at zero torque, where a bench puts its zero.

    Parameters
    ----------
    angle : (n, n_steps) [arcmin]
    branch, torque : (n_steps,) names of the cycle's branches and [N m].
    """
    ends = [np.flatnonzero((branch == name) & (torque == 0))[0] for name in ("unloading+", "unloading-")]
    return angle - angle[:, ends].mean(axis=1, keepdims=True)

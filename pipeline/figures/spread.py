"""The spread over samples as a frame that figures draw as a band."""

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

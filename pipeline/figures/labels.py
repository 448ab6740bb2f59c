"""What tables call by a column name, as an engineer calls it, and the spread of several loops as a frame.

No plotting library is imported for them.
"""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.config.dimensions import dimension_library
from pipeline.model.metrics import Limited, library
from pipeline.model.metrics.turn import turn_library

METRICS = library()
"""The metrics by column name."""
LIMITED_METRICS: dict[str, Limited] = {**METRICS, **turn_library()}
"""What a limit may be set for: the metrics of loops, then those of the whole turn."""

FULL_TURN = 360.0
"""Crank angle [deg] beyond which loaded angles stand more than a turn of the crank apart: no line joins them."""
PARAMETERS = {name: dimension.title for name, dimension in dimension_library().items()} | {"sum": "sum of all"}


def parameter_title(name: str) -> str:
    """Name of an error of a sample or of a group of errors; ``pin_radial_mean_um`` is the pins' mean."""
    bare = name.removesuffix("_um")
    mean = bare.endswith("_mean")
    bare = bare.removesuffix("_mean").removesuffix("_amplitude")
    title = PARAMETERS.get(bare, bare.replace("_", " "))
    return f"{title}, mean" if mean else title


LOW, HIGH = 0.05, 0.95
"""Shares of the samples below the ends of a band."""


def spread_frame(values: Real, **keys: NDArray[Any]) -> pd.DataFrame:
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


def centred_loops(angle: Real, branch: NDArray[Any], torque: Real) -> Real:
    """Loops (n, n_steps) about the middle of their width at zero torque, where a bench puts its zero.

    Parameters
    ----------
    angle : (n, n_steps) [arcmin]
    branch, torque : (n_steps,) names of the cycle's branches and [N m].
    """
    ends = [np.flatnonzero((branch == name) & (torque == 0))[0] for name in ("unloading+", "unloading-")]
    centred: Real = angle - angle[:, ends].mean(axis=1, keepdims=True)
    return centred

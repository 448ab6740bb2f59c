"""What an incremental encoder reads: whole steps, white noise, and a slow wander that neighbours share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Real = NDArray[np.float64]

SLOW_SHARE = 0.15
"""Of the noise's standard deviation, that of the wander: over the rows of a cell it weighs as the rest."""
KEPT = 0.9
"""Of the wander from row to row: it forgets within some ten rows."""


def readings(angle: Real, deviation: float, step: float, rng: np.random.Generator) -> Real:
    """Angles (n_rows,) as read, in whole steps; deviation and step in the unit of the angle."""
    kicks = np.sqrt(1 - KEPT**2) * rng.standard_normal(len(angle))
    kicks[0] = rng.standard_normal()
    wander = lfilter([1.0], [1.0, -KEPT], kicks)
    noise = np.sqrt(1 - SLOW_SHARE**2) * rng.standard_normal(len(angle)) + SLOW_SHARE * wander
    return np.asarray(step * np.floor((angle + deviation * noise) / step), float)

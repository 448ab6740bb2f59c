"""Torques that the cells of a measurement went through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.measurement.measurement import Measurement

Real = NDArray[np.float64]

PARTS = 5
"""Parts of a cell, of as many rows each, over which its angle is averaged: the curve is bent within it."""


def within_cells(measurement: Measurement, numbers: NDArray[np.intp]) -> Real:
    """Torques within cells (n, PARTS + 1) [N m], as many rows between any two; each row stands for its surroundings."""
    rows, cells, usable = measurement.rows, measurement.cells, np.flatnonzero(measurement.usable)
    first_row = np.searchsorted(usable, cells.first_row[numbers])
    shares = np.arange(PARTS + 1) / PARTS
    edges = []
    for start, count in zip(first_row, cells.count[numbers], strict=True):
        torque = np.sort(rows.torque[usable[start : start + count]])
        low, high = 0.5 * (torque[1] - torque[0]), 0.5 * (torque[-1] - torque[-2])
        known_torque = np.concatenate([[torque[0] - low], torque, [torque[-1] + high]])
        places = np.concatenate([[0.0], (np.arange(count) + 0.5) / count, [1.0]])
        edges.append(np.interp(shares, places, known_torque))
    return np.array(edges)


def followed_torques(measurement: Measurement) -> Real:
    """Torques (n_cells, PARTS) [N m] that each cell went through, in time order: middles of parts of as many rows."""
    edges = within_cells(measurement, np.arange(len(measurement.cells)))
    middles = 0.5 * (edges[:, 1:] + edges[:, :-1])
    return np.where(measurement.cells.direction[:, None] > 0, middles, middles[:, ::-1])

"""Torques that the cells of a measurement went through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.identification.measurement.measurement import Measurement

PARTS = 5
"""Parts of a cell, of as many rows each, over which its angle is averaged: the curve is bent within it."""


def within_cells(measurement: Measurement, numbers: NDArray[np.intp]) -> Real:
    """Torques within cells (n, PARTS + 1) [N m], as many rows between any two.

    Each row stands for its surroundings, as far as the torque went: no further than where it turned or ended.
    """
    rows, cells, usable = measurement.rows, measurement.cells, np.flatnonzero(measurement.usable)
    turns, leg = measurement.history.torque, measurement.history.leg[cells.block[numbers]]
    ends = np.array([turns[p][k : k + 2] for p, k in zip(cells.position[numbers], leg, strict=True)]).reshape(-1, 2)
    first_row = np.searchsorted(usable, cells.first_row[numbers])
    shares = np.arange(PARTS + 1) / PARTS
    edges = []
    for start, count, lowest, highest in zip(
        first_row, cells.count[numbers], ends.min(axis=1), ends.max(axis=1), strict=True
    ):
        torque = np.sort(rows.torque[usable[start : start + count]])
        torque_before, first_place = _end(torque[1] - torque[0], torque[0] - lowest)
        torque_after, final_place = _end(torque[-1] - torque[-2], highest - torque[-1])
        known_torque = np.concatenate([[torque[0] - torque_before], torque, [torque[-1] + torque_after]])
        inner_places = np.arange(1, count - 1) + 0.5
        places = np.concatenate([[0.0, first_place], inner_places, [count - final_place, count]]) / count
        edges.append(np.interp(shares, places, known_torque))
    return np.array(edges)


def _end(step: float, reach: float) -> tuple[float, float]:
    """How far the surroundings of a cell's last row go [N m], and how many rows lie in them.

    Half of the ``step`` to the next row, as far as the torque's ``reach`` allows. Cut short they hold fewer rows, so
    many that the mean torque of the cell stays that of its rows.
    """
    beyond = min(0.5 * step, max(reach, 0.0))
    return beyond, 1.5 - (0.75 * step + 1.5 * beyond) / (step + beyond) if step > 0 else 0.5


def followed_torques(measurement: Measurement) -> Real:
    """Torques (n_cells, PARTS) [N m] that each cell went through, in time order: middles of parts of as many rows."""
    edges = within_cells(measurement, np.arange(len(measurement.cells)))
    middles = 0.5 * (edges[:, 1:] + edges[:, :-1])
    return np.where(measurement.cells.direction[:, None] > 0, middles, middles[:, ::-1])

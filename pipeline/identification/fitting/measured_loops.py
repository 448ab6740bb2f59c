"""Loops of a measurement as the turning crank needs them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.errors import InputError
from pipeline.identification.fitting.cell_torques import followed_torques
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.measurement.faults.plausibility import REVOLUTION
from pipeline.identification.measurement.measurement import Measurement


def crank_loops(measurement: Measurement, largest_torque: float = np.inf) -> CrankLoops:
    """The cells of a measurement with the crank angle at each.

    Parameters
    ----------
    largest_torque : [N m]; cells beyond it have no weight.

    Notes
    -----
    Cells count by their rows, as errors do. Of positions whose crank angle is unknown all start at nought.

    Raises
    ------
    InputError : the column of the crank angle is missing, or holds what is no number.
    """
    unit, cells, rows = measurement.unit, measurement.cells, measurement.rows
    settings = unit.settings.crank
    torque = followed_torques(measurement)
    known_crank = np.radians(rows.cranks[cells.position]) if measurement.known_cranks else np.zeros(len(cells))
    first_rows = np.array([np.flatnonzero(rows.position == p)[0] for p in range(len(rows.cranks))])
    crank_per_output, crank = 0.0, known_crank
    if settings.moves == "follows_angle":
        assert settings.ratio is not None
        crank_per_output = -settings.ratio * 2 * np.pi / REVOLUTION
    elif settings.moves == "column":
        column = _column(measurement, str(settings.column))
        crank = known_crank + np.radians(measurement.over_cells(column) - column[first_rows][cells.position])
    return CrankLoops(
        position=cells.position,
        torque=torque,
        angle=cells.angle_mean,
        weight=cells.count / np.mean(cells.count) * (np.max(np.abs(torque), axis=1) <= largest_torque),
        crank=crank,
        start=rows.angle[first_rows][cells.position],
        crank_per_output=crank_per_output,
        at_input=settings.torque_at == "input",
        ratio=settings.ratio or np.inf,
        behind_disk=1 - settings.twist_before_disk,
        common_zero=unit.settings.offset == "common",
        time=None if rows.time is None else _times(cells.time_mean, cells.position, torque.shape[1]),
    )


def _times(time: Real, position: NDArray[np.int64], parts: int) -> Real:
    """Times (n_cells, parts) [s] of the parts of cells, between the mean times (n_cells,) of a position's cells."""
    times = np.empty((len(time), parts))
    for number in np.unique(position):
        of_position = np.flatnonzero(position == number)
        places = (np.arange(len(of_position) * parts) + 0.5) / parts - 0.5
        times[of_position] = np.interp(places, np.arange(len(of_position)), time[of_position]).reshape(-1, parts)
    return times


def _column(measurement: Measurement, name: str) -> Real:
    extra = measurement.rows.extra
    if name not in extra:
        raise InputError(f'{measurement.unit.name}/unit.toml: crank.column = "{name}"; no file has it')
    values = np.asarray(extra[name], float)
    if not np.all(np.isfinite(values[measurement.usable])):
        raise InputError(f'{measurement.unit.name}/unit.toml: crank.column = "{name}"; some of its rows are no numbers')
    return values

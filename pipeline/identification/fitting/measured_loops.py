"""The loops that were measured: their torques by cells, and the path that the load took."""

import numpy as np

from pipeline.arrays import Index, Real, Truth, Whole
from pipeline.constant_kinds import Fineness
from pipeline.errors import InputError
from pipeline.identification.fitting.cells_in_noise import jump_heights, jumps_between
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.faults.shape_faults import REVOLUTION
from pipeline.identification.measurement.measurement import Measurement

PARTS: Fineness = 5
"""Parts of a cell, of as many rows each, over which its angle is averaged: the curve is bent within it."""


def within_cells(measurement: Measurement, numbers: Index) -> Real:
    """Torques within cells (n, PARTS + 1) [N m], as many rows between any two.

    Each row stands for its surroundings, as far as the torque went: no further than where it turned or ended. If the
    play was crossed between two cells, each ends at its own row. The torque of a cell of one row is that of the row
    with the scatter of its noise: the angle to expect is the mean over what the torque may have been.
    """
    rows, cells, usable = measurement.rows, measurement.cells, np.flatnonzero(measurement.usable)
    turns, leg = measurement.history.torque, measurement.history.leg[cells.block[numbers]]
    ends = np.array([turns[p][k : k + 2] for p, k in zip(cells.position[numbers], leg, strict=True)]).reshape(-1, 2)
    lowest_torques, highest_torques = ends.min(axis=1), ends.max(axis=1)
    crosses_below, crosses_above = (is_crossed[numbers] for is_crossed in _crossings_beside(cells))
    lowest_torques[crosses_below], highest_torques[crosses_above] = np.inf, -np.inf
    first_row = np.searchsorted(usable, cells.first_row[numbers])
    shares = np.arange(PARTS + 1) / PARTS
    scatter = measurement.torque_noise * np.sqrt(3) * (2 * shares - 1)
    edges = []
    for start, count, lowest, highest, of_leg in zip(
        first_row, cells.count[numbers], lowest_torques, highest_torques, np.sort(ends, axis=1), strict=True
    ):
        torque = np.sort(rows.torque[usable[start : start + count]])
        if count == 1:
            edges.append(np.clip(torque + scatter, min(of_leg[0], torque[0]), max(of_leg[1], torque[0])))
            continue
        torque_before, first_place = _end(torque[1] - torque[0], torque[0] - lowest)
        torque_after, final_place = _end(torque[-1] - torque[-2], highest - torque[-1])
        known_torque = np.concatenate([[torque[0] - torque_before], torque, [torque[-1] + torque_after]])
        inner_places = np.arange(1, count - 1) + 0.5
        places = np.concatenate([[0.0, first_place], inner_places, [count - final_place, count]]) / count
        edges.append(np.interp(shares, places, known_torque))
    return np.array(edges)


def rows_within(measurement: Measurement, numbers: Index) -> tuple[Real, Real, Real]:
    """Torques [N m], angles [arcmin] and times [s], each (n, PARTS + 1), at ends of parts of as many rows within cells.

    In order of time, or against it where the torque falls. The angles lie on a line over the rows, so that their noise
    is that of the cell. The torques are those of the rows and need not increase: with a ripple the torque read may stay
    or decrease while the angle increases.
    """
    rows, cells, usable = measurement.rows, measurement.cells, np.flatnonzero(measurement.usable)
    torques, angles, times = np.full((3, len(numbers), PARTS + 1), np.nan)
    for place, number in enumerate(numbers):
        start, count = np.searchsorted(usable, cells.first_row[number]), cells.count[number]
        of_cell = usable[start : start + count][:: 1 if cells.direction[number] > 0 else -1]
        from_middle = np.arange(count) - 0.5 * (count - 1)
        ends = count * (np.arange(PARTS + 1) / PARTS - 0.5)
        slope = from_middle @ rows.angle[of_cell] / max(from_middle @ from_middle, 1.0)
        torques[place] = np.interp(ends, from_middle, rows.torque[of_cell])
        angles[place] = cells.angle_mean[number] + slope * ends
        if rows.time is not None:
            times[place] = np.interp(ends, from_middle, rows.time[of_cell])
    return torques, angles, times


def readings(measurement: Measurement, position: int) -> tuple[Real, Real] | None:
    """Times [s] and torques [N m] (n_rows,) of all rows of a position that could be read; None without times."""
    rows = measurement.rows
    if rows.time is None:
        return None
    numbers = np.flatnonzero(measurement.is_readable & (rows.position == position) & np.isfinite(rows.time))
    return rows.time[numbers], rows.torque[numbers]


def _crossings_beside(cells: Cells) -> tuple[Truth, Truth]:
    """Whether the play was crossed between each cell (n_cells,) and the one below it in torque, and the one above."""
    is_crossed = jumps_between(cells, jump_heights(cells, np.ones(len(cells), bool)), 0.0) > 0
    before, after = np.append(False, is_crossed), np.append(is_crossed, False)
    rises = cells.direction > 0
    return np.where(rises, before, after), np.where(rises, after, before)


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


def crank_loops(measurement: Measurement) -> CrankLoops:
    """The cells of a measurement with the crank angle at each.

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
        weight=cells.count / np.mean(cells.count),
        crank=crank,
        start=rows.angle[first_rows][cells.position],
        crank_per_output=crank_per_output,
        at_input=settings.torque_at == "input",
        ratio=settings.ratio or np.inf,
        behind_disk=1 - settings.twist_before_disk,
        common_zero=unit.settings.offset == "common",
        time=None if rows.time is None else _times(cells.time_mean, cells.position, torque.shape[1]),
    )


def _times(time: Real, position: Whole, parts: int) -> Real:
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

"""Cells of two measurements of one drive that answer each other: same position, sense of loading, start and torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.identification.fitting.cell_torques import followed_torques
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.data import Data
from pipeline.identification.measurement.branches import ALIKE
from pipeline.identification.measurement.measurement import Measurement

Real = NDArray[np.float64]
Numbers = NDArray[np.intp]


@dataclass(frozen=True)
class State:
    """A measurement with its cells.

    Attributes
    ----------
    start : (n_blocks,) torque at which each branch starts [N m].
    followed : (n_cells, n_parts) torques that each cell went through [N m].
    """

    measurement: Measurement
    data: Data
    start: Real
    followed: Real

    @classmethod
    def of(cls, measurement: Measurement) -> State:
        """The state of a measurement without fatal faults."""
        start = measurement.rows.coordinate[measurement.branches.start]
        data = data_of(measurement, np.ones(len(measurement.cells), bool))
        return cls(measurement, data, start, followed_torques(measurement))

    def cells_at(self, crank: float) -> Numbers:
        """Cells at a crank angle, in time order."""
        return np.flatnonzero(self.measurement.rows.cranks[self.data.position] == crank)

    def repeated(self, cells: Numbers) -> Numbers:
        """Blocks among cells of a position, but for the first, whose start nobody knows."""
        return np.unique(self.data.block[cells])[1:]


@dataclass(frozen=True)
class Pair:
    """A position in both states.

    Attributes
    ----------
    crank_deg : of the position.
    torque, sigma : (n_cells,) [N m], [arcmin] of the second state's cells, in time order.
    followed : (n_cells, n_parts) [N m] torques that they went through.
    cycle, direction : (n_cells,) of them.
    difference : (n_cells,) [arcmin] second state less mean of the first at the same sense, start and torque; NaN where
        the first has no counterpart.
    before_followed, before_angle, before_sigma : the same of the first state's cells.
    angle : (n_cells,) [arcmin] of the second state.
    """

    crank_deg: float
    torque: Real
    followed: Real
    angle: Real
    sigma: Real
    cycle: NDArray[np.int64]
    direction: NDArray[np.int64]
    difference: Real
    before_followed: Real
    before_angle: Real
    before_sigma: Real

    @property
    def matched(self) -> NDArray[np.bool_]:
        """Cells (n_cells,) with a counterpart."""
        return np.isfinite(self.difference)

    def residual(self, explained: Real) -> Real:
        """What a change explains of the difference subtracted (n_known,), in noise, offset removed."""
        residual, weight = (self.difference - explained)[self.matched], 1 / self.sigma[self.matched]
        return (residual - np.average(residual, weights=weight**2)) * weight


def pairs(state_before: State, state_after: State) -> tuple[Pair, ...]:
    """Positions that both states have.

    Raises
    ------
    InputError : no crank angle, or no branch, is in both.
    """
    of_each = [state.measurement.rows.cranks for state in (state_before, state_after)]
    shared = sorted(set(of_each[0].tolist()) & set(of_each[1].tolist()))
    names = [state.measurement.unit.name for state in (state_before, state_after)]
    if not shared:
        differences_text = " and ".join(
            f"{name} {', '.join(f'{c:g}' for c in specific)}" for name, specific in zip(names, of_each, strict=True)
        )
        raise InputError(f"no crank angle was measured in both: {differences_text} deg; measure the same positions")
    results = tuple(_pair(state_before, state_after, crank) for crank in shared)
    usable = tuple(pair for pair in results if pair.matched.sum() > 2)
    if not usable:
        raise InputError(f"no branch of {names[1]} starts and runs as one of {names[0]}; measure the same loops")
    return usable


def difference(state_before: State, cells_before: Numbers, state_after: State, cells_after: Numbers) -> Real:
    """Angle [arcmin] of cells of the second state less that of their counterparts among cells of the first (n_new,)."""
    torque, angle = state_after.data.torque[cells_after], state_after.data.angle[cells_after]
    values = np.full(len(cells_after), np.nan)
    for block in state_after.repeated(cells_after):
        in_block = state_after.data.block[cells_after] == block
        values[in_block] = angle[in_block] - _counterpart(
            state_before, cells_before, state_after, int(block), torque[in_block]
        )
    return values


def _pair(state_before: State, state_after: State, crank: float) -> Pair:
    cells_before, cells_after = state_before.cells_at(crank), state_after.cells_at(crank)
    cells = state_after.measurement.cells
    return Pair(
        crank,
        state_after.data.torque[cells_after],
        state_after.followed[cells_after],
        state_after.data.angle[cells_after],
        state_after.data.sigma[cells_after],
        cells.cycle[cells_after],
        cells.direction[cells_after],
        difference(state_before, cells_before, state_after, cells_after),
        state_before.followed[cells_before],
        state_before.data.angle[cells_before],
        state_before.data.sigma[cells_before],
    )


def _counterpart(state_before: State, cells_before: Numbers, state_after: State, block: int, torque: Real) -> Real:
    """Mean angle (n,) [arcmin] at torques of those branches of the first state that are as a block of the second."""
    sense, span = state_after.measurement.branches.direction[block], np.ptp(state_before.data.torque[cells_before])
    total, count = np.zeros(len(torque)), np.zeros(len(torque))
    for number in state_before.repeated(cells_before):
        distant = abs(state_before.start[number] - state_after.start[block]) > ALIKE * span
        if distant or state_before.measurement.branches.direction[number] != sense:
            continue
        branch = cells_before[state_before.data.block[cells_before] == number]
        branch = branch[np.argsort(state_before.data.torque[branch])]
        angle = np.interp(torque, state_before.data.torque[branch], state_before.data.angle[branch], np.nan, np.nan)
        total, count = total + np.nan_to_num(angle), count + np.isfinite(angle)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)

"""The cells that a model is fitted to: of loops at standing cranks, or of a crank that turns."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.model.effects.effect import (
    CRANKS,
    CYCLES,
    FLANGE,
    LOOPS,
    MOVES,
    RATE,
    SENSES,
    STILL,
    TEMPERATURE,
    TIME,
    TORQUES,
)
from pipeline.model.units import TURN_DEG

SHORTFALLS: Mapping[str, str] = {
    CRANKS: f"fewer than {FEWEST_COMPARED} crank positions of known angle to fit",
    CYCLES: "fewer than 2 cycles",
    TIME: "no time stamps",
    TEMPERATURE: "no temperature that varies",
    RATE: "neither a change of the torque's rate nor a dwell: see rayleigh",
    FLANGE: "no angle of the flange beside that of the lever: see pin_circle_error",
    STILL: "the locked output lets the crank turn by more than half a pitch of the pins: see load_friction",
    MOVES: "the crank stands still in each loop, whose zero is free",
}
"""Of loops at a standing crank."""
SLID = "while the crank turns all that slides has slid: it shows in loops at a standing crank alone"
TURNING_SHORTFALLS: Mapping[str, str] = {
    **SHORTFALLS,
    LOOPS: SLID,
    RATE: "the torque is held",
    SENSES: "the crank turns in one sense alone",
    STILL: "the crank turns, and all pins slide on: see load_friction",
    TORQUES: "a single torque is held",
    MOVES: "it is read from loops against a locked output",
}
"""Of a turning crank."""


@dataclass(frozen=True)
class Data:
    """Cells of all positions, position by position.

    Attributes
    ----------
    position, cycle, block : (n_cells,) block: position x cycle x monotone branch.
    branch : (n_cells,) position x monotone branch: its blocks repeat each other from cycle to cycle, so that a fault of
        the model's form is alike in all of them.
    torque, angle : (n_cells,) [N m], [arcmin].
    count : rows in each cell.
    noise : floor of the angle of a cell [arcmin].
    sigma : (n_cells,) [arcmin]: the floor, and the noise of the torque where the measured curve is steep.
    row_error : (n_cells,) [arcmin]: of the mean angle beside a way through the play, whose place between two rows is
        not known; alike in all branches of one sense where their rows lie at the same torques. 0 elsewhere.
    common_offset : whether all positions share one zero of the angle.
    torque_noise : of a cell [N m].
    """

    position: Whole
    cycle: Whole
    block: Whole
    branch: Whole
    torque: Real
    angle: Real
    count: Whole
    noise: float
    sigma: Real
    row_error: Real
    common_offset: bool
    torque_noise: float

    def __len__(self) -> int:
        return len(self.angle)

    @cached_property
    def group(self) -> Whole:
        """Cells that share an offset (n_cells,)."""
        return np.zeros_like(self.position) if self.common_offset else self.position

    @cached_property
    def groups(self) -> tuple[Truth, ...]:
        """Of each group that shares an offset, whether a cell belongs to it (n_cells,)."""
        return tuple(self.group == number for number in np.unique(self.group))

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The same as ranges of the cells."""
        starts = np.flatnonzero(np.diff(self.group, prepend=-1)).tolist()
        return tuple(slice(start, end) for start, end in zip(starts, [*starts[1:], len(self)], strict=True))

    def held_out_parts(self, cells: Truth) -> Whole:
        """What is left out at once (n_cells,): positions if some ``cells`` (n_cells,) have two, else cycles."""
        return self.position if len(np.unique(self.position[cells])) > 1 else self.cycle

    @cached_property
    def senses(self) -> Real:
        """+1 for cells (n_cells,) of a branch on which the torque rises, -1 where it falls."""
        sense = np.zeros(len(self))
        for block in np.unique(self.block):
            block_cells = np.flatnonzero(self.block == block)
            sense[block_cells] = np.sign(self.torque[block_cells[-1]] - self.torque[block_cells[0]])
        return sense

    @property
    def shortfalls(self) -> Mapping[str, str]:
        """Why an effect cannot be tested, by what it needs and the data lack."""
        return SHORTFALLS

    def offsets(self, angle: Real, is_fitted: Truth, sigma: Real) -> Real:
        """Offset of every cell (n_cells,) [arcmin]: over the cells fitted of its group, or its own where none is."""
        offsets, weight = np.zeros(len(self)), 1 / sigma**2
        for in_group in self.groups:
            use = in_group & is_fitted if np.any(in_group & is_fitted) else in_group
            use = use & np.isfinite(angle)
            if np.any(use):
                offsets[in_group] = np.sum(weight[use] * (self.angle - angle)[use]) / np.sum(weight[use])
        return offsets


@dataclass(frozen=True)
class TurningData(Data):
    """Cells of a crank that turns while a torque is held; positions are intervals of its angle, blocks its turns.

    Attributes
    ----------
    part : (n_cells,) number of what a cell is held out with.
    direction : (n_cells,) 1 where the output slides in the sense of a positive torque, -1 against it.
    level : (n_cells,) number of the torque held.
    crank : (n_cells,) [deg] middle of the interval, over a turn of the output.
    per_turn : intervals in a turn of the crank; not a whole number where they do not divide it.
    """

    part: Whole
    direction: Whole
    level: Whole
    crank: Real
    per_turn: float

    @property
    def revolution(self) -> Whole:
        """Turn of the crank (n_cells,) within one of the output."""
        return np.floor(self.crank / TURN_DEG).astype(np.int64)

    def held_out_parts(self, cells: Truth) -> Whole:
        """What is left out at once (n_cells,): whole torques, cycles, revolutions or senses."""
        return self.part

    @cached_property
    def senses(self) -> Real:
        """Sense (n_cells,) in which the output slides."""
        return self.direction.astype(float)

    @property
    def shortfalls(self) -> Mapping[str, str]:
        """Why an effect cannot be tested, by what it needs and the data lack."""
        return TURNING_SHORTFALLS

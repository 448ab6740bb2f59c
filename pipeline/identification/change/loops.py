"""Loops of a measured state: the mean curves of rising and falling torque at each position, by the size of the loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Index, Real
from pipeline.constant_kinds import Fineness
from pipeline.identification.change.scatter import indicators
from pipeline.identification.fitting.cells_in_noise import data_of
from pipeline.identification.fitting.data import Data
from pipeline.identification.measurement.cells import cell_edges
from pipeline.identification.measurement.measurement import Measurement

Numbers = Index

SAME_SIZE = 1.3
"""Ratio of the largest torques of two loops below which they are loops of one size."""
POINTS: Fineness = 401
"""Torques at which a loop is read, from its largest negative to its largest positive one."""


@dataclass(frozen=True)
class State:
    """A measured state of a drive with its cells.

    Attributes
    ----------
    reach : (n_blocks,) largest torque of each branch [N m], commanded where that is known.
    """

    measurement: Measurement
    data: Data
    reach: Real

    @classmethod
    def from_measurement(cls, measurement: Measurement) -> "State":
        """The state of a measurement without fatal faults."""
        data = data_of(measurement, np.ones(len(measurement.cells), bool))
        coordinate = np.abs(measurement.rows.coordinate)
        reach = [float(np.nanmax(coordinate[rows], initial=0.0)) for rows in measurement.branches.rows]
        return cls(measurement, data, np.array(reach))

    @property
    def name(self) -> str:
        """The unit's name."""
        return self.measurement.unit.name

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names (n_positions,) of the positions: as unit.toml says, else the crank angle [deg]."""
        rows, files = self.measurement.rows, self.measurement.unit.files
        first_rows = [np.flatnonzero(rows.position == number)[0] for number in range(len(rows.cranks))]
        names = [files[rows.file[row]].position for row in first_rows]
        return tuple(name or f"{crank:g} deg" for name, crank in zip(names, rows.cranks, strict=True))

    def cells_at(self, position: int, size: "LoopSize") -> Numbers:
        """Cells of loops of a size at a position, in time order, without those of the position's first branch.

        Where the first branch of a position started is unknown.
        """
        cells = np.flatnonzero(self.data.position == position)
        blocks = np.unique(self.data.block[cells])[1:]
        blocks = blocks[(self.reach[blocks] >= size.lowest) & (self.reach[blocks] <= size.highest)]
        return cells[np.isin(self.data.block[cells], blocks)]


@dataclass(frozen=True)
class LoopSize:
    """Loops whose largest torques [N m] lie between two values, and the torque up to which they are compared."""

    lowest: float
    highest: float
    compared: float = np.inf

    @property
    def label(self) -> str:
        """The torque up to which they are compared, or the largest one, in words."""
        return f"{min(self.compared, self.highest):.3g} N m"


@dataclass(frozen=True)
class Curves:
    """Mean curves of the loops of one size at one position, each over rising torques.

    Attributes
    ----------
    torque, angle : by sense of loading, +1 and -1: (n_points,) [N m], [arcmin].
    """

    torque: Mapping[int, Real]
    angle: Mapping[int, Real]

    def half(self, first_point: int) -> "Curves":
        """Every second point of each sense from the ``first_point`` or second on, and its ends."""
        kept_points = {}
        for sense, values in self.torque.items():
            numbers = np.arange(len(values))
            kept_points[sense] = (numbers % 2 == first_point) | (numbers == 0) | (numbers == len(values) - 1)
        return Curves(
            {sense: self.torque[sense][points] for sense, points in kept_points.items()},
            {sense: self.angle[sense][points] for sense, points in kept_points.items()},
        )

    @property
    def reach(self) -> float:
        """Largest torque [N m] that both senses reach on both sides; 0 where one of them was not measured."""
        if any(values.size == 0 for values in self.torque.values()):
            return 0.0
        return max(0.0, min(float(min(-values[0], values[-1])) for values in self.torque.values()))


@dataclass(frozen=True)
class Loop:
    """A loop at torques from the largest negative to the largest positive one.

    Attributes
    ----------
    torque : (n,) [N m].
    rising, falling : (n,) [arcmin] angle of each sense of loading.
    """

    torque: Real
    rising: Real
    falling: Real

    @property
    def width(self) -> Real:
        """Angle (n,) [arcmin] between the two senses."""
        return self.falling - self.rising

    @property
    def middle(self) -> Real:
        """Mean angle (n,) [arcmin] of the two senses."""
        return 0.5 * (self.falling + self.rising)


def loop_sizes(states: Sequence[State]) -> tuple[LoopSize, ...]:
    """Sizes of the loops of all states, the smallest first."""
    reaches = np.unique(np.concatenate([state.reach[np.unique(state.data.block)] for state in states]))
    reaches = reaches[reaches > 0]
    cuts = np.flatnonzero(reaches[1:] > SAME_SIZE * reaches[:-1]) + 1
    return tuple(LoopSize(float(part[0]), float(part[-1])) for part in np.split(reaches, cuts) if part.size)


def curves_at(state: State, position: int, size: LoopSize) -> Curves:
    """Mean curves of a position over all of its loops of a size, the zero of each cycle's angle removed.

    Least squares of cells by an angle for each sense and torque and an offset for each cycle: the zero drifts, and
    cycles do not fill the same cells.
    """
    cells = state.cells_at(position, size)
    torque, angle = state.data.torque[cells], state.data.angle[cells]
    top = float(np.max(np.abs(torque), initial=0.0))
    edges = cell_edges(top)
    rising = state.measurement.cells.direction[cells] > 0
    interval = np.searchsorted(edges, torque) + rising * (len(edges) + 1)
    intervals, place = np.unique(interval, return_inverse=True)
    _, cycle = np.unique(state.data.cycle[cells], return_inverse=True)
    columns = np.column_stack([indicators(place), indicators(cycle)])
    means = np.linalg.lstsq(columns, angle, rcond=None)[0][: len(intervals)]
    mean_torque = np.bincount(place, torque) / np.maximum(np.bincount(place), 1)
    senses = {1: intervals > len(edges), -1: intervals <= len(edges)}
    return Curves(
        {sense: np.asarray(mean_torque[points], float) for sense, points in senses.items()},
        {sense: np.asarray(means[points], float) for sense, points in senses.items()},
    )


def loop_of(curves: Curves, top: float) -> Loop:
    """The loop of curves up to a torque ``top`` [N m] that they reach."""
    torque = np.linspace(-top, top, POINTS)
    rising, falling = (np.interp(torque, curves.torque[sense], curves.angle[sense]) for sense in (1, -1))
    return Loop(torque, rising, falling)

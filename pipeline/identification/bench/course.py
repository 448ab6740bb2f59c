"""What a position was put through: torques from turn to turn, or a torque that is held while the crank turns."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.model.contact.friction_elements import Sliders


@dataclass(frozen=True)
class CrankMotion:
    """How the crank turns within a loop whose output is locked: phi = start - ratio x twist.

    Attributes
    ----------
    stations : (n_stations,) ascending crank angles at which the drive is known [rad].
    ratio : turns of the crank per turn of the output, with its sign.
    cells : (n_cells,) crank angle at each cell as measured [rad]; its mean places the model's.
    at_input : whether the torque read is that of the motor times minus the ratio, which does the work on what varies
        over the crank angle; else that at the output.
    """

    stations: Real
    ratio: float
    cells: Real
    at_input: bool

    @cached_property
    def shares(self) -> Real:
        """Weights (n_cells, n_stations) of the cubic through the four stations next to each cell's crank angle.

        Of the parabola where there are three stations. Beyond the first and the last one their own values count.
        """
        count, stations = min(4, len(self.stations)), self.stations
        cells = np.clip(self.cells, stations[0], stations[-1])
        first = np.clip(np.searchsorted(stations, cells) - count // 2, 0, len(stations) - count)
        places = first[:, None] + np.arange(count)
        distance = cells[:, None] - stations[places]
        weights = np.zeros((len(cells), len(stations)))
        for k in range(count):
            others = np.arange(count) != k
            apart = stations[places[:, [k]]] - stations[places[:, others]]
            weights[np.arange(len(cells)), places[:, k]] = np.prod(distance[:, others] / apart, axis=1)
        return weights


@dataclass(frozen=True)
class Course:
    """What one position was put through, and where it was read.

    Attributes
    ----------
    torque : (n_turns,) [N m] from the first to the last, turning at each.
    leg : (n_cells,) the cell lies between torque[leg] and torque[leg + 1].
    state : (n_cells,) state of the drive at each cell. A value k + s stands for states k and k + 1 with the weights
        1 - s and s: the drive wears and warms on the way from one turn to the next.
    cell_torques : (n_cells, n_edges) torques [N m] within each cell, ascending, with as many rows between any two: the
        angle of a cell is the mean over them.
    time : (n_cells,) [s] from the unit's first cell, or zeros.
    rows : (n_cells, n_edges) torques [N m] and angles [arcmin] within each cell, in the order of its rows; None
        where no ripple is asked for.
    readings : (n_readings,) times [s] and torques [N m] of all rows, those within the play too; None without times.
    edge_times : (n_cells, n_edges) time [s] of each of the torques within the cells; None without times.
    is_output_locked : whether the output is locked and the input loaded. What is in series with the output then carries
        the torque that friction leaves; on a loaded output it carries all of the torque.
    encoder_turns : turns of the encoder per turn of the output.
    encoder_place : [rad] of the encoder at this position.
    sliding : (n_cells,) sense in which the output slides all along, 1 or -1, where the crank turns; None where the
        torques decide.
    crank : how the crank turns within the loop; None where it is held.
    """

    torque: Real
    leg: Whole
    state: Real | Whole
    cell_torques: Real
    time: Real
    encoder_turns: float
    encoder_place: float
    sliding: Whole | None = None
    crank: CrankMotion | None = None
    rows: tuple[Real, Real] | None = None
    readings: tuple[Real, Real] | None = None
    edge_times: Real | None = None
    is_output_locked: bool = False

    def without_states(self) -> "Course":
        """The course with all its cells in the drive's first state."""
        return replace(self, state=np.zeros_like(self.state))

    @cached_property
    def in_order(self) -> "Course":
        """The course with the torques within each cell in the order of its rows, not sorted.

        The two differ where the torque read decreases within a cell, as it may with a ripple.
        """
        return self if self.rows is None else replace(self, cell_torques=self.rows[0])

    @cached_property
    def states(self) -> tuple[int, ...]:
        """Numbers of the states that its cells lie between, ascending."""
        ends = np.concatenate([np.floor(self.state), np.ceil(self.state)])
        return tuple(np.unique(ends.astype(np.int64)).tolist())

    def share_of(self, state: int) -> Real:
        """Weight (n_cells,) of a state at each cell."""
        return np.asarray(np.maximum(1 - np.abs(self.state - state), 0.0))

    @cached_property
    def state_of_legs(self) -> Whole:
        """State (n_turns - 1,) nearest to the end of each leg: of its last cell, or without one of the leg before."""
        last_cells = np.searchsorted(self.leg, np.arange(len(self.torque) - 1), side="right") - 1
        return np.rint(self.state[np.maximum(last_cells, 0)]).astype(np.int64)

    @cached_property
    def edges_beside_turns(self) -> tuple[Whole, Whole]:
        """Cell and edge (n_turns,) next to each turn: the last edge before it, or the first edge of the record."""
        cells = np.searchsorted(self.leg, np.arange(len(self.torque))) - 1
        is_before = cells >= 0
        cells = np.maximum(cells, 0)
        return cells, np.where((self.sense[self.leg[cells]] > 0) == is_before, -1, 0)

    @cached_property
    def sense(self) -> Whole:
        """Of each leg (n_turns - 1,): 1 where the torque rises, -1 where it falls."""
        return np.where(np.diff(self.torque) > 0, 1, -1)


def slid_torque(torque: Real, sense: Whole, sliders: Sliders) -> tuple[Real, Real]:
    """Torque carried (n_cells, n_edges) [N mm] behind friction on the output that slides, and its share of each cell.

    Parameters
    ----------
    torque : (n_cells, n_edges) on the output [N mm].
    sense : (n_cells,) in which the output slides: friction resists it.
    sliders : of the output alone.

    Returns
    -------
    The torque carried, and d carried / d torque (n_cells,) at the first edge.

    Notes
    -----
    T = P + s (L + k |P|) with the sums L of the limits and k of the coefficients: the end of ``output_path`` once every
    slider has slid in the sense s.
    """
    limit, coefficient = float(sliders.limit.sum()), float(sliders.coefficient.sum())
    net_torque = torque - limit * sense[:, None]
    share = 1 / (1 + coefficient * sense[:, None] * np.sign(net_torque))
    return net_torque * share, share[:, 0]

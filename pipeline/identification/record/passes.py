"""A record of a drive that turned under held torques: passes of one torque and sense, and cells over the output angle.

The error is the angle of the output less that of the ideal ratio. A pass is a stretch of one file and cycle at one held
torque in one sense; its rows are averaged over intervals of the output angle that all passes share.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.measurement.enough import FEWEST_COMPARED, FEWEST_OF_A_WAVE, LEAST_PART
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.turning.motion import LEVEL_SHARE, held_torques, stretches
from pipeline.identification.measurement.turning.motion import groups as groups_of
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.identification.record.orders import Orders, orders_of

MOST_INTERVALS: Fineness = 720
"""Intervals of the output angle at most: orders up to a quarter of them in a turn have four to a wave."""
SAME_TEMPERATURE_K = 2.0
"""Range of the temperatures of passes that count as one."""
SAME_SPEED = 1.2
"""Quotient of the fastest and the slowest of passes that count as of one speed."""
SAME_TORQUE = 0.02
"""Share of the largest torque up to which held torques are one: less than the 3 % at which lost motion is read."""
DRIFT = 0.002
"""Share of the largest torque up to which a mean torque counts as none."""
CROSSED_SHARE: Rounding = 1e-3
"""Share of an interval by which an angle may lie beyond the last one by rounding."""


@dataclass(frozen=True)
class Passes:
    """Stretches of one file, cycle, held torque and sense.

    Attributes
    ----------
    level, temperature_group, speed_group : (n_passes,) numbers; levels ascend with the torque.
    sense : (n_passes,) 1 where the output turns forward, -1 backward.
    torque, temperature, speed : (n_passes,) means [N m], [deg C], [deg/s of the output]; NaN where not measured.
    """

    level: Whole
    sense: Whole
    temperature_group: Whole
    speed_group: Whole
    torque: Real
    temperature: Real
    speed: Real

    def __len__(self) -> int:
        return len(self.level)

    @cached_property
    def kind(self) -> Whole:
        """Number (n_passes,) of each held torque, sense, temperature and speed: equal ones repeat each other."""
        keys = np.column_stack([self.level, self.sense, self.temperature_group, self.speed_group])
        return np.unique(keys, axis=0, return_inverse=True)[1].ravel()


@dataclass(frozen=True)
class RecordCells:
    """Rows averaged over intervals of the output angle, pass by pass.

    Attributes
    ----------
    owner : (n_cells,) pass of each cell.
    interval : (n_cells,) interval of the output angle.
    error, torque : (n_cells,) means [arcmin], [N m].
    count : (n_cells,) rows.
    scatter : (n_cells,) standard deviation of the rows about the cell's line [arcmin].
    """

    owner: Whole
    interval: Whole
    error: Real
    torque: Real
    count: Whole
    scatter: Real

    def __len__(self) -> int:
        return len(self.error)


@dataclass(frozen=True, eq=False)
class RecordedPasses:
    """Rows of a record, its passes and cells, which can be computed only of data without a fatal fault.

    Attributes
    ----------
    unit : the file unit.toml.
    place : (n,) angle of the output by the ideal ratio [deg], counted on over the turns.
    error : (n,) [arcmin].
    torque, time, temperature, speed : (n,) [N m], [s], [deg C], [deg/s of the output]; NaN where not measured.
    run : (n,) number of the file and cycle of each row.
    reading_faults : what is wrong with the columns.
    """

    unit: UnitFile
    place: Real
    error: Real
    torque: Real
    time: Real
    temperature: Real
    speed: Real
    run: Whole
    reading_faults: tuple[Fault, ...]

    def __len__(self) -> int:
        return len(self.error)

    @cached_property
    def orders(self) -> Orders:
        """Orders of the drive, in waves per turn of the output."""
        return orders_of(self.unit)

    @cached_property
    def numeric(self) -> Truth:
        """Rows (n,) whose angles and torque are numbers."""
        return np.isfinite(self.place) & np.isfinite(self.error) & np.isfinite(self.torque)

    @cached_property
    def largest_torque(self) -> float:
        """Largest torque that is held in a run, or for as many rows as a run has on average [N m]."""
        sizes = np.abs(self.torque[self.numeric])
        runs = np.unique(self.run[self.numeric]).size
        return float(np.quantile(sizes, 1 - 0.5 / runs)) if sizes.size else 0.0

    @cached_property
    def _passes(self) -> tuple[Passes, Whole]:
        """The passes, and the number of each row's pass (n,), -1 in none."""
        ratio, is_numeric = self.orders.ratio, self.numeric
        _, one_way = stretches(ratio * self.place, self.run, np.zeros(len(self), np.int64), is_numeric)
        sense, stretch = stretches(ratio * self.place, one_way, self._torque_group(one_way), is_numeric)
        number = np.full(len(self), -1)
        spans = {k: float(np.ptp(self.place[stretch == k])) for k in np.unique(stretch[stretch >= 0])}
        longest = max(spans.values(), default=0.0)
        chosen_passes = [k for k, span in spans.items() if span >= LEAST_PART * longest > 0]
        for position, k in enumerate(chosen_passes):
            number[stretch == k] = position
        of_pass = [np.flatnonzero(number == k) for k in range(len(chosen_passes))]
        torque = np.array([self.torque[rows].mean() for rows in of_pass])
        temperature = np.array([self.temperature[rows].mean() for rows in of_pass])
        sense, group = (
            np.array([sense[rows[0]] for rows in of_pass], np.int64),
            _narrow_groups(temperature, SAME_TEMPERATURE_K),
        )
        speed = np.array([self._speed_of(rows) for rows in of_pass])
        if self.unit.settings.side == "input":
            torque = torque_of_both_senses(torque, sense, group, SAME_TORQUE * self.largest_torque)
        return (
            Passes(
                level=groups_of(torque, SAME_TORQUE * self.largest_torque),
                sense=sense,
                temperature_group=group,
                speed_group=_narrow_groups(np.log(speed), np.log(SAME_SPEED)),
                torque=torque,
                temperature=temperature,
                speed=speed,
            ),
            number,
        )

    def _speed_of(self, rows: Whole) -> float:
        """Speed of the output over some rows [deg/s], as stated or by the times; NaN without both."""
        if np.all(np.isfinite(self.speed[rows])):
            return float(np.median(np.abs(self.speed[rows]))) or float("nan")
        span = float(np.ptp(self.time[rows])) if np.all(np.isfinite(self.time[rows])) else 0.0
        return float(np.ptp(self.place[rows])) / span if span > 0 else float("nan")

    def _torque_group(self, one_way: Whole) -> Whole:
        """Number (n,) of the torque held by rows that turn one way (n,): waves of a torque are no other torque."""
        gap = LEVEL_SHARE * self.largest_torque
        is_apart = np.abs(self.torque - held_torques(self.torque, np.where(self.numeric, one_way, -1))) > gap
        group = np.zeros(len(self), np.int64)
        for number in np.unique(one_way[one_way >= 0]):
            rows = np.flatnonzero((one_way == number) & self.numeric)
            if np.mean(is_apart[rows]) > LEVEL_SHARE:
                group[rows] = groups_of(self.torque[rows], gap)
        return group

    @property
    def passes(self) -> Passes:
        """The passes, in the order of time."""
        return self._passes[0]

    @cached_property
    def levels(self) -> Real:
        """Held torques (n_levels,) [N m], ascending; zero where a torque meter drifts about it."""
        passes = self.passes
        means = [passes.torque[passes.level == k].mean() for k in range(int(passes.level.max(initial=-1)) + 1)]
        return np.array([mean if abs(mean) > DRIFT * self.largest_torque else 0.0 for mean in means])

    @cached_property
    def span_deg(self) -> float:
        """Angle of the output that the passes cover [deg], at most a turn."""
        places = self.place[self._passes[1] >= 0]
        return min(float(np.ptp(places)), self.period_deg) if len(places) else 0.0

    @property
    def period_deg(self) -> float:
        """Angle of the output after which the drive stands as before [deg]."""
        return 360.0 * self.orders.period

    @cached_property
    def n_intervals(self) -> int:
        """Intervals of the output angle: as many as have rows enough in each pass."""
        number = self._passes[1]
        rows = np.bincount(number[number >= 0])
        share = min(float(np.ptp(self.place[number >= 0])) / self.span_deg, 1e6)
        return int(np.clip(np.median(rows) / max(share, 1.0) / FEWEST_COMPARED, 1, MOST_INTERVALS))

    @cached_property
    def _cell_of_row(self) -> tuple[Whole, Whole]:
        """Rows that are averaged, and the cell of each."""
        number = self._passes[1]
        rows = np.flatnonzero(number >= 0)
        first_place = float(self.place[rows].min())
        width = self.span_deg / self.n_intervals
        folded_place = np.mod(
            self.place[rows] - first_place, self.period_deg * (1 + CROSSED_SHARE * width / self.period_deg)
        )
        interval = np.minimum((folded_place / width).astype(np.int64), self.n_intervals - 1)
        keys = number[rows] * self.n_intervals + interval
        _, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
        has_enough = count >= FEWEST_COMPARED
        new_numbers = np.cumsum(has_enough) - 1
        good = has_enough[cell]
        return rows[good], new_numbers[cell[good]]

    def cell_means(self, values: Real) -> Real:
        """Means (n_cells,) over the rows of each cell of values (n,)."""
        rows, cell = self._cell_of_row
        return np.bincount(cell, values[rows]) / np.bincount(cell)

    def wave(self, order: float) -> tuple[Real, Real]:
        """Means (n_cells,) of cosine and sine of so many waves per turn of the output."""
        angle = np.radians(order * self.place)
        return self.cell_means(np.cos(angle)), self.cell_means(np.sin(angle))

    @cached_property
    def cells(self) -> RecordCells:
        """The cells of all passes, pass by pass."""
        rows, cell = self._cell_of_row
        count = np.bincount(cell)
        place = self.place[rows] - self.cell_means(self.place)[cell]
        error = self.error[rows] - self.cell_means(self.error)[cell]
        slope = np.bincount(cell, place * error) / np.maximum(np.bincount(cell, place**2), 1e-300)
        squares = (error - slope[cell] * place) ** 2
        first_row = np.full(len(count), len(self))
        np.minimum.at(first_row, cell, rows)
        number = self._passes[1]
        width = self.span_deg / self.n_intervals
        first_place = float(self.place[number >= 0].min())
        owner = number[first_row]
        middle = np.mod(self.cell_means(self.place) - first_place, self.period_deg)
        return RecordCells(
            owner=owner,
            interval=np.minimum((middle / width).astype(np.int64), self.n_intervals - 1),
            error=self.cell_means(self.error),
            torque=self._torque_of_cells(owner),
            count=count,
            scatter=np.sqrt(np.bincount(cell, squares) / np.maximum(count - 2, 1)),
        )

    def _torque_of_cells(self, owner: Whole) -> Real:
        """Torque (n_cells,) of each pass with its waves per turn of the shafts; the scatter of a meter is left out.

        The noise of a torque in its cells would pull the compliance towards zero (errors in variables).
        """
        torque = self.passes.torque[owner]
        if self.unit.settings.side == "input":
            return torque
        waves = np.column_stack([part for _, order in self.orders.waves.values() for part in self.wave(order)])
        deviation = self.cell_means(self.torque) - torque
        for number in np.unique(owner):
            of_pass = owner == number
            if np.sum(of_pass) >= FEWEST_OF_A_WAVE * waves.shape[1]:
                sizes, *_ = np.linalg.lstsq(waves[of_pass], deviation[of_pass], rcond=1e-6)
                torque[of_pass] += waves[of_pass] @ sizes
        return torque


def torque_of_both_senses(torque: Real, sense: Whole, group: Whole, gap: float) -> Real:
    """Torque of the output (n_passes,) [N m] from that at the input times the ratio, which holds the drive's loss.

    Notes
    -----
    Under one load the input takes T + loss in one sense and T - loss in the other, so the mean is T: of losses in
    proportion to the load but for (1 - efficiency)^2 / 2 of it. The loads of each temperature ascend alike in both
    senses; where one sense has another number of them, the torque stays as measured.
    """
    found = torque.copy()
    for temperature in np.unique(group):
        by_sense = [
            groups_of(np.where((group == temperature) & (sense == way), torque, np.nan), gap) for way in (1, -1)
        ]
        if by_sense[0].max(initial=-1) != by_sense[1].max(initial=-1):
            continue
        for load in range(int(by_sense[0].max(initial=-1)) + 1):
            found[(by_sense[0] == load) | (by_sense[1] == load)] = np.mean(
                [torque[numbers == load].mean() for numbers in by_sense]
            )
    return found


def _narrow_groups(values: Real, width: float) -> Whole:
    """Number (n,) of each value's group, ascending: values of a group lie within a width; -1 of no numbers."""
    group, start, number = np.full(len(values), -1), -np.inf, -1
    for place in np.argsort(values):
        if np.isfinite(values[place]):
            start, number = (values[place], number + 1) if values[place] - start > width else (start, number)
            group[place] = number
    return group


def shift_of_repeats(of_pass: Real, kind: Whole) -> tuple[float, int]:
    """Standard deviation [arcmin] of the mean of a kind by what whole passes are shifted, and its degrees of freedom.

    ``of_pass``: means of the passes about that of their kind (n_passes,) [arcmin]; 0 and 0 without repeats.
    """
    count = np.unique(kind, return_counts=True)[1]
    freedom = int(np.sum(count - 1))
    size = np.sqrt(np.sum(of_pass**2) / freedom * np.mean(1 / count)) if freedom else 0.0
    return float(size), freedom


def drift_of_repeats(residual: Real, cells: RecordCells, is_repeated: Truth, reach: float) -> float:
    """Standard deviation [arcmin] of the mean of two passes of a kind over the angle, by how repeats differ.

    ``residual``: of every cell (n_cells,) [arcmin]; ``reach``: intervals over which the drift is alike. Two passes lie
    by half of their difference off the mean, and that mean by as much off the kind's own.
    """
    part = cells.owner * MOST_INTERVALS + (cells.interval / reach).astype(np.int64)
    _, part = np.unique(part[is_repeated], return_inverse=True)
    return float(np.sqrt(np.mean((np.bincount(part, residual[is_repeated]) / np.bincount(part)) ** 2)))

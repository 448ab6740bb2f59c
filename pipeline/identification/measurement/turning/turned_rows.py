"""A unit whose crank turned while a torque was held: its rows, turns, cells and noise."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.config.files.table_file import shortened_list
from pipeline.constant_kinds import Rounding
from pipeline.errors import InputError
from pipeline.identification.measurement.branches import BranchBlocks
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.load_history import History
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.repeatability import Noise
from pipeline.identification.measurement.rows import recorded_rows, rows_of
from pipeline.identification.measurement.turning.motion import CENTRED_SHARE, LEVEL_SHARE, Motion, unwrapped_crank
from pipeline.identification.measurement.turning.motion import motion as motion_of
from pipeline.identification.measurement.turning.turning_noise import turning_noise
from pipeline.identification.measurement.unit_file import UnitFile
from pipeline.model.units import ARCMIN_A_DEGREE, TURN_DEG

WHOLE_TOLERANCE: Rounding = 1e-6
"""Of an interval: what counts as a whole number of them."""


@dataclass(frozen=True, eq=False)
class TurnedRows(Measurement):
    """Rows of a turning drive, but for their faults: positions are intervals of the crank, branches are turns.

    Attributes
    ----------
    motion : of the rows, in their order: by interval, and in each in the order of time.
    """

    motion: Motion

    @classmethod
    def read(cls, unit: UnitFile) -> Self:
        """The measurement of a unit; raises as ``read_rows``."""
        record = recorded_rows(unit)
        gear = unit.study.design.cycloid
        cycle, integer = record.cycle
        run = np.where(integer, cycle * (int(record.source.max(initial=0)) + 1) + record.source, -1)
        crank = unwrapped_crank(record.quantity("crank_deg"), run)
        command = record.quantity("command_torque_Nm")
        torque = command if np.any(np.isfinite(command)) else record.quantity("torque_Nm")
        turning = motion_of(crank, run, torque, gear.pins, gear.lobes)
        if unit.settings.angle == "absolute":
            error = record.quantity("angle_arcmin") + ARCMIN_A_DEGREE * crank / gear.lobes
            record = replace(record, table=record.table.assign(angle_arcmin=error))
        intervals, is_known = np.unique(turning.interval[turning.turn >= 0]), np.isfinite(crank)
        last_interval = max(len(intervals) - 1, 0)  # a row in no turn is of any position: it is not used
        position = np.where(is_known, np.minimum(np.searchsorted(intervals, turning.interval), last_interval), -1)
        rows = rows_of(record, unit, np.asarray((intervals + 0.5) * turning.width, float), position)
        return cls(unit, rows, _in_order(turning, np.argsort(position, kind="stable")))

    @property
    def summary(self) -> list[str]:
        rows, motion = self.rows, self.motion
        torques = ", ".join(f"{level:g}" for level in motion.levels)
        turn_count = f"{motion.turn.max(initial=-1) + 1} turns of the crank at {torques} N m"
        return [
            f"{self.unit.name}: {len(rows)} rows in {len(rows.files)} files, {turn_count}",
            *shortened_list((fault.line for fault in self.faults), self.unit.name),
        ]

    @cached_property
    def torque_noise(self) -> float:
        """As declared: a torque that is held wavers by itself."""
        return self.unit.settings.instrument.torque_noise_Nm or 0.0

    @cached_property
    def is_fitted(self) -> Truth:
        is_fitted = np.zeros(len(self.rows), bool)
        is_fitted[self.cells.first_row[self.training_cells]] = True
        return is_fitted

    @cached_property
    def is_saturated(self) -> Truth:
        limit = self.unit.settings.instrument.torque_saturation_Nm
        return np.zeros(len(self.rows), bool) if limit is None else np.abs(self.rows.torque) >= limit

    @cached_property
    def usable(self) -> Truth:
        """Rows (n_rows,) that may be fitted: numbers of a whole turn at its held torque, not saturated."""
        return self.numeric & ~self.is_saturated & (self.motion.turn >= 0)

    @cached_property
    def branches(self) -> BranchBlocks:
        """The turns: `position` is the first interval of each, `direction` the sense in which the output slides."""
        turn, usable = self.motion.turn, self.usable
        count = int(turn.max(initial=-1)) + 1
        first_row, last_row = np.zeros((2, count), np.int64)
        for number in range(count):
            of_turn = np.flatnonzero((turn == number) & usable)
            first_row[number], last_row[number] = (of_turn[0], of_turn[-1]) if of_turn.size else (0, 0)
        direction = -self.motion.sense[first_row]
        kind = 2 * self.motion.level[first_row] + (direction > 0)
        none, numbers = np.zeros(0), np.arange(count)
        return BranchBlocks(
            position=self.rows.position[first_row],
            cycle=self.rows.cycle[first_row],
            direction=direction,
            branch=numbers,
            kind=kind,
            start=first_row,
            stop=last_row + 1,
            threshold=none,
            end_band=none,
        )

    @cached_property
    def cells(self) -> Cells:
        """Usable rows averaged over the intervals of each turn, held torque by held torque, in time order.

        The angle is that at the middle of its interval (``_at_middles``).
        """
        motion, rows = self.motion, self.rows
        usable = np.flatnonzero(self.usable)
        owner = motion.turn[usable] * (len(rows.cranks) + 1) + rows.position[usable]
        numbers, first_row, count = np.unique(owner, return_index=True, return_counts=True)
        parts = [usable[start : start + size] for start, size in zip(first_row, count, strict=True)]
        parts = [part for part in parts if len(part) >= FEWEST_COMPARED and self._is_centred(part)]
        level = np.array([motion.level[part[0]] for part in parts], np.int64)
        parts = [parts[k] for k in np.argsort(level, kind="stable")]
        first_rows = np.array([part[0] for part in parts], np.int64)
        block = motion.turn[first_rows]
        mean = {name: self._means(values, parts) for name, values in self._averaged_quantities.items()}
        return Cells(
            block=block,
            position=rows.position[first_rows],
            cycle=rows.cycle[first_rows],
            direction=-motion.sense[first_rows],
            torque_mean=mean["torque"],
            angle_mean=self._at_middles(mean["angle"], block, rows.position[first_rows]),
            count=np.array([len(part) for part in parts], np.int64),
            angle_spread=np.array([self._spread(part) for part in parts]),
            time_mean=mean["time"],
            temperature_mean=mean["temperature"],
            first_row=first_rows,
        )

    def _at_middles(self, means: Real, block: Whole, position: Whole) -> Real:
        """Angles [arcmin] at the middles of intervals, by the ``means`` over them and over both neighbours on the turn.

        Notes
        -----
        The mean over an interval exceeds the middle by a 24th of the second difference of the means: exact of a cubic.
        Of a wave that it makes smaller by sin(x)/x, x half of the wave's angle over an interval, 1 % is left at x = 36
        degrees where 6 % were. Before the first interval of a turn lies the last of it. Where a neighbour is missing
        the mean stays.
        """
        number = np.round(self.rows.cranks / self.motion.width - 0.5).astype(np.int64)[position]
        in_turn, in_output_turn = TURN_DEG / self.motion.width, round(self._output_turn / self.motion.width)
        turn = round(in_turn) if abs(in_turn - round(in_turn)) < WHOLE_TOLERANCE else 0
        rows = {(b, k): row for row, (b, k) in enumerate(zip(block.tolist(), number.tolist(), strict=True))}
        angles = means.copy()
        for (b, k), row in rows.items():
            sides = []
            for step in (-1, 1):
                places = ((k + step) % in_output_turn, (k + step - step * turn) % in_output_turn)
                sides.append(next((rows[b, place] for place in places if (b, place) in rows), None))
            side_before, side_after = sides
            if side_before is not None and side_after is not None and row not in sides:
                angles[row] -= (means[side_before] - 2 * means[row] + means[side_after]) / 24
        return angles

    @property
    def _averaged_quantities(self) -> dict[str, Real | None]:
        """Quantities of the rows that cells are means of; None where not measured."""
        rows = self.rows
        return {"torque": rows.torque, "angle": rows.angle, "time": rows.time, "temperature": rows.temperature}

    def _is_centred(self, part: Whole) -> bool:
        """Whether rows fill their interval about its middle: a piece of one would stand for another angle."""
        middle = self.rows.cranks[self.rows.position[part[0]]]
        offset = np.mod(self.motion.crank[part] - middle + 0.5 * self._output_turn, self._output_turn)
        return bool(abs(offset.mean() - 0.5 * self._output_turn) <= CENTRED_SHARE * self.motion.width)

    @property
    def _output_turn(self) -> float:
        """Crank angle [deg] of a turn of the output."""
        return TURN_DEG * self.unit.study.design.cycloid.lobes

    def _spread(self, part: Whole) -> float:
        """Standard deviation [arcmin] of the angle of some rows about its line over the crank."""
        crank, angle = self.motion.crank[part] - self.motion.crank[part].mean(), self.rows.angle[part]
        scatter = float(crank @ crank)
        line = crank * (crank @ angle / scatter) if scatter > 0 else 0.0
        return float(np.sqrt(np.sum((angle - angle.mean() - line) ** 2) / max(len(part) - 2, 1)))

    @cached_property
    def level(self) -> Whole:
        """Number of the held torque of each cell (n_cells,)."""
        return self.motion.level[self.cells.first_row]

    @cached_property
    def revolution(self) -> Whole:
        """Turn of the crank from the drawing's zero, within one of the output, that each cell lies in (n_cells,)."""
        return np.floor(self.rows.cranks[self.cells.position] / TURN_DEG).astype(np.int64)

    @cached_property
    def history(self) -> History:
        """Torques between the largest of both senses, a leg for each cycle of the unit: nothing depends on them."""
        cycles = np.unique(self.branches.cycle)
        top = float(np.max(np.abs(self.cells.torque_mean), initial=0.0))
        torque = np.where(np.arange(len(cycles) + 1) % 2, -top, top)
        return History((torque,) * len(self.rows.cranks), np.searchsorted(cycles, self.branches.cycle))

    @cached_property
    def repeatability(self) -> Noise:
        return self.noise_of(np.ones(len(self.cells), bool))

    def noise_of(self, visible: Truth) -> Noise:
        """Noise of some cells (n_cells,), from their rows alone."""
        cells = self.cells.some(visible)
        kind = self.branches.kind[cells.block]
        crank = self.rows.cranks[cells.position]
        return turning_noise(cells, kind, crank, self.revolution[visible], self.torque_noise, self._resolution)

    @cached_property
    def held_out_by(self) -> str:
        """What is left out at once: "torque", "cycle", "repeat", "revolution" or "sense"; "" where nothing can be."""
        if self.unit.settings.held_out.by:
            return self.unit.settings.held_out.by
        if len(np.unique(self.level)) >= FEWEST_COMPARED:
            return "torque"
        names = ("cycle", "repeat", "revolution", "torque", "sense")
        return next((name for name in names if len(np.unique(self._groups(name))) > 1), "")

    def _groups(self, name: str) -> Whole:
        """Number (n_cells,) of the torque, cycle, repeat, revolution or sense of each cell."""
        if name == "repeat":
            return self._repeat
        senses = (self.cells.direction < 0).astype(np.int64)
        return {"torque": self.level, "cycle": self.cells.cycle, "revolution": self.revolution, "sense": senses}[name]

    @property
    def _repeat(self) -> Whole:
        """How often the interval of each cell (n_cells,) was passed before in its sense at its torque."""
        places = np.column_stack([self.branches.kind[self.cells.block], self.cells.position])
        place = np.unique(places, axis=0, return_inverse=True)[1].ravel()
        order = np.lexsort((self.cells.block, place))
        starts = np.concatenate([[0], np.flatnonzero(np.diff(place[order])) + 1])
        repeat = np.empty(len(place), np.int64)
        repeat[order] = np.arange(len(place)) - np.repeat(starts, np.diff([*starts, len(place)]))
        return repeat

    @cached_property
    def parts(self) -> Whole:
        """Number of what each cell (n_cells,) is held out with: neighbours on a turn tell of each other."""
        return self._groups(self.held_out_by) if self.held_out_by else np.zeros(len(self.cells), np.int64)

    @cached_property
    def training_cells(self) -> Truth:
        """Cells (n_cells,) that unit.toml lets a fit see; all by default, which are then left out part by part.

        Raises
        ------
        InputError : `held_out.train` names what was not measured, or leaves nothing held out.
        """
        held_out = self.unit.settings.held_out
        if not held_out.train:
            return np.ones(len(self.cells), bool)
        values = {
            "torque": self.motion.levels[self.level],
            "cycle": self.cells.cycle.astype(float),
            "sense": -self.cells.direction.astype(float),
        }[self.held_out_by]
        reach = LEVEL_SHARE * float(np.max(np.abs(self.motion.levels))) if self.held_out_by == "torque" else 0.0
        matches = np.abs(values[:, None] - np.array(held_out.train)) <= reach
        key, measured_values = (
            f"{self.unit.name}/unit.toml: held_out.train",
            ", ".join(f"{v:g}" for v in np.unique(values)),
        )
        unknown_values = [f"{v:g}" for v, match in zip(held_out.train, matches.any(axis=0), strict=True) if not match]
        if unknown_values:
            raise InputError(f"{key} = {', '.join(unknown_values)}; measured are {measured_values}")
        if np.all(matches.any(axis=1)):
            raise InputError(f"{key} = {measured_values}; leaves nothing to judge the model with; leave one out")
        is_trained: Truth = matches.any(axis=1)
        return is_trained

    @staticmethod
    def _means(values: Real | None, parts: list[Whole]) -> Real:
        """Means (n_parts,) of values of rows; NaN where there are none."""
        return np.array([np.nan if values is None else values[part].mean() for part in parts], float)


def _in_order(motion: Motion, order: Whole) -> Motion:
    """The motion with its rows in another order."""
    rows = ("crank", "sense", "turn", "level", "interval")
    return replace(motion, **{name: getattr(motion, name)[order] for name in rows})

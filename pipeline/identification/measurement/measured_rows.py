"""What follows from the rows of a measured unit: which may be fitted, their branches, cells and noise."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Truth
from pipeline.identification.measurement import row_filters
from pipeline.identification.measurement.branches import BranchBlocks, find_blocks
from pipeline.identification.measurement.cells import Cells, are_rows_few, cells
from pipeline.identification.measurement.enough import SURE
from pipeline.identification.measurement.estimate import counted_step, smallest_step, torque_noise
from pipeline.identification.measurement.load_history import History, history
from pipeline.identification.measurement.repeatability import Noise, measured_noise, restrict_to_training
from pipeline.identification.measurement.repeated_branches import UsableRows
from pipeline.identification.measurement.rows import Rows, fitted_rows
from pipeline.identification.measurement.unit_file import UnitFile


@dataclass(frozen=True, eq=False)
class MeasuredRows:
    """A unit's rows and what follows from them; each part is computed once, when it is first asked for.

    Branches, cells and what rests on them can be computed only of data without a fatal fault.

    Attributes
    ----------
    unit : the file unit.toml.
    rows : of all its data files.
    """

    unit: UnitFile
    rows: Rows

    @cached_property
    def torque_noise(self) -> float:
        """Standard deviation of the torque of a row that may be fitted [N m]; 0 if unknown."""
        runs = [run for *_, run in self.rows.runs() if self.is_fitted[run.start]]
        return torque_noise(self.rows, self.unit.settings.instrument, runs)

    @cached_property
    def is_fitted(self) -> Truth:
        """Rows (n_rows,) that noise and limits are of: what unit.toml holds out is none of them."""
        return fitted_rows(self.unit, self.rows)

    @cached_property
    def angle_step(self) -> float:
        """Smallest step of the angle in these rows [arcmin], and at least the declared one; 0 if unknown."""
        return max(smallest_step(self.rows.angle[self.is_fitted]), self._resolution)

    @cached_property
    def numeric(self) -> Truth:
        """Rows (n_rows,) whose quantities are numbers."""
        return row_filters.numeric(self.rows)

    @cached_property
    def is_saturated(self) -> Truth:
        """Rows (n_rows,) whose torque is cut off."""
        return row_filters.saturated_rows(self.rows, self.unit.settings.instrument, self.torque_noise)

    @cached_property
    def spikes(self) -> Truth:
        """Rows (n_rows,) at which the encoder jumps."""
        smallest_jump = max(self.angle_step, self.unit.settings.instrument.angle_noise_arcmin or 0.0)
        return row_filters.spikes(self.rows, smallest_jump, self.torque_noise)

    @cached_property
    def is_clipped(self) -> Truth:
        """Rows (n_rows,) whose angle stands at the end of the instrument's range."""
        return row_filters.clipped_rows(self.rows, self.angle_step)

    @cached_property
    def is_readable(self) -> Truth:
        """Rows (n_rows,) with branches: numbers, not cut off, no jumps, not at rest before the first load."""
        at_rest = row_filters.at_rest(self.rows, self.smallest_torque)
        return self.numeric & ~self.is_saturated & ~self.is_clipped & ~self.spikes & ~at_rest

    @cached_property
    def is_in_play(self) -> Truth:
        """Rows (n_rows,) within the play or held at no torque, of a drive with a design.

        Of other drives the play is a knee.
        """
        if self.unit.design_study is None:
            return np.zeros(len(self.rows), bool)
        in_play = row_filters.rows_in_play(self.rows, self.is_readable, self.branches)
        fewest = 1 if are_rows_few(self.is_readable, self.branches) else 2
        return in_play | row_filters.rows_at_no_torque(
            self.rows, self.is_readable, self.branches, self.smallest_torque, fewest
        )

    @property
    def smallest_torque(self) -> float:
        """Torque [N m] that is surely none of the noise of a row and of the step of the sensor."""
        return SURE * self.torque_noise + (self.unit.settings.instrument.torque_resolution_Nm or 0.0)

    @cached_property
    def usable(self) -> Truth:
        """Rows (n_rows,) that may be fitted."""
        return self.is_readable & ~self.is_in_play

    @cached_property
    def usable_rows(self) -> UsableRows:
        """Torque and angle of the rows that may be fitted."""
        return UsableRows(np.flatnonzero(self.usable), self.rows.torque[self.usable], self.rows.angle[self.usable])

    @cached_property
    def branches(self) -> BranchBlocks:
        """Monotone branches of every cycle."""
        return find_blocks(self.rows, self.is_readable, self.torque_noise, self.is_fitted)

    @cached_property
    def cells(self) -> Cells:
        """Usable rows averaged over neighbouring torques of a branch.

        The play of a drive without a design is a knee, so that rows beside its jump must not count by themselves.
        """
        return cells(self.rows, self.usable, self.branches, may_be_single=self.unit.design_study is not None)

    @cached_property
    def history(self) -> History:
        """Turning torques of each position."""
        return history(self.rows, self.branches)

    @cached_property
    def repeatability(self) -> Noise:
        """Noise of the cells."""
        return measured_noise(self.branches, self.cells, self.usable_rows, self.torque_noise, self._resolution)

    def noise_of(self, visible: Truth) -> Noise:
        """Noise of some cells (n_cells,), whole branches, from their rows alone."""
        if np.all(visible):
            return self.repeatability
        blocks, restricted_cells = restrict_to_training(self.branches, self.cells, visible)
        pairs = {(position, cycle) for position, cycle in zip(blocks.position, blocks.cycle, strict=True)}
        runs = [run for position, cycle, run in self.rows.runs() if (position, cycle) in pairs]
        scatter = torque_noise(self.rows, self.unit.settings.instrument, runs)
        return measured_noise(blocks, restricted_cells, self.usable_rows, scatter, self._resolution)

    @cached_property
    def _resolution(self) -> float:
        """Step of the angle [arcmin], as declared or in which all readings of every position are; 0 if unknown."""
        steps = [
            counted_step(self.rows.angle[self.is_fitted & (self.rows.position == position)])
            for position in np.unique(self.rows.position[self.is_fitted])
        ]
        return max(self.unit.settings.instrument.angle_resolution_arcmin or 0.0, min(steps, default=0.0))

"""Loops of a drive with a locked end, and the angle of its crank, which may turn within them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Truth, Whole


@dataclass(frozen=True)
class CrankLoops:
    """Loops of one state of a drive, cells in time order.

    Attributes
    ----------
    position : (n_cells,) from 0; each position has a zero of its own, unless ``common_zero``.
    torque : (n_cells, n_parts) that each cell went through [N m].
    angle : (n_cells,) [arcmin].
    weight : (n_cells,) of the squared errors.
    crank : (n_cells,) angle of the crank [rad] at the position's first row, over a turn of the output; or, with
        ``crank_per_output`` = 0, at each cell.
    start : (n_cells,) reading of the angle at the position's first row [arcmin].
    crank_per_output : change of the crank angle with the reading [rad/arcmin]; 0 where the crank is fixed, or given by
        a column.
    at_input : whether the torque was measured at the input, so that virtual work counts.
    ratio : i, turns of the crank per turn of the output, with its sign.
    behind_disk : share of the twist that lies between the disk and the output: the disk turns by that share of phi/i.
    common_zero : whether all positions share one zero.
    time : (n_cells, n_parts) [s]; none where no stamps are known.
    """

    position: Whole
    torque: Real
    angle: Real
    weight: Real
    crank: Real
    start: Real
    crank_per_output: float = 0.0
    at_input: bool = True
    ratio: float = np.inf
    behind_disk: float = 1.0
    common_zero: bool = False
    time: Real | None = None

    @classmethod
    def standing(cls, position: Whole, torque: Real, angle: Real, weight: Real, common_zero: bool) -> "CrankLoops":
        """Loops of a crank that stands still."""
        none = np.zeros(len(angle))
        return cls(position, torque, angle, weight, none, none, common_zero=common_zero)

    @cached_property
    def top(self) -> float:
        """Largest torque [N m]."""
        return float(np.max(np.abs(self.torque)))

    @cached_property
    def span(self) -> float:
        """Largest range of the angle over the cells of a position that have a weight [arcmin]."""
        weighted = self.weight > 0
        return max(
            float(np.ptp(self.angle[weighted & (self.position == p)])) for p in np.unique(self.position[weighted])
        )

    @cached_property
    def group(self) -> Whole:
        """Cells (n_cells,) that share a zero."""
        return np.zeros_like(self.position) if self.common_zero else self.position

    @cached_property
    def runs(self) -> Whole:
        """Position of each part of a cell (n_cells n_parts,), in time order."""
        return np.repeat(self.position, self.torque.shape[1])

    def some(self, cells: Truth) -> "CrankLoops":
        """The loops with no weight but that of some cells (n_cells,), if their group has any; histories stay whole."""
        return replace(self, weight=np.where(cells, self.weight, 0.0))

    def zeros(self, residual: Real) -> Real:
        """Mean residual of each cell's group (n_cells,), weighed; of cells without weight where a group has none."""
        weight, total = self._weight_in_zero
        return np.asarray((np.bincount(self.group, weight * residual) / total)[self.group], float)

    @cached_property
    def _weight_in_zero(self) -> tuple[Real, Real]:
        """Weight (n_cells,) of each cell in the zero of its group, and their sum in each group (n_groups,)."""
        weight = np.where(np.bincount(self.group, self.weight)[self.group] > 0, self.weight, 1.0)
        return weight, np.asarray(np.bincount(self.group, weight), float)

    @cached_property
    def crank_of_parts(self) -> Real:
        """Angle of the crank [rad] (n_cells n_parts,) at the position's first row."""
        return np.repeat(self.crank, self.torque.shape[1])


@dataclass(frozen=True)
class CrankAngle:
    """Angle of the crank [rad] (n,) against the ``housing`` and against the ``disk``, and d disk / d housing."""

    housing: Real
    disk: Real
    disk_rate: float

    @classmethod
    def from_readings(cls, loops: "CrankLoops", from_start: Real) -> "CrankAngle":
        """At readings less that of the position's first row (n_cells n_parts,) [arcmin]."""
        start, turn = loops.crank_of_parts, loops.crank_per_output * from_start
        rate = 1 - loops.behind_disk / loops.ratio
        return cls(start + turn, start * (1 - 1 / loops.ratio) + rate * turn, rate)

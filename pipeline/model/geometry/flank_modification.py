"""What a drawing or a measurement says of the flank beside the numbers of the reducer: data, no geometry."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

Real = np.ndarray


@dataclass(frozen=True, eq=False)
class MeasuredFlank:
    """Measured deviation of the flank from the drawn one; equal where the numbers are.

    Attributes
    ----------
    phase : (n_points,) [rad] ascending in [0, 2 pi), clockwise from the root at which the lobe begins.
    material : (n_rows, n_points) [mm] along the normal, outward positive: excess of material; one row for all lobes or
        one a lobe, clockwise from lobe 0.
    """

    phase: Real
    material: Real

    @cached_property
    def _key(self) -> tuple[bytes, bytes, tuple[int, ...]]:
        return self.phase.tobytes(), self.material.tobytes(), self.material.shape

    def __eq__(self, other_flank: object) -> bool:
        return isinstance(other_flank, MeasuredFlank) and self._key == other_flank._key

    def __hash__(self) -> int:
        return hash(self._key)


@dataclass(frozen=True)
class FlankModification:
    """How the drawn flank differs from the one that the reducer's own pins generate, and what was measured beside.

    Attributes
    ----------
    equidistant : dr [mm] by which the generating roller is larger than a pin: material off along the normal.
    moved_distance : dR [mm] by which the generating pin circle is larger than the reducer's; negative takes material
        off.
    rotation : delta [rad]: |a| delta off both flanks of every lobe, with a the arm of the normal about the disk's
        centre. It ends in 0 at root and tip, which stay as they are.
    measured_flank : deviation from the flank so drawn, or None.
    """

    equidistant: float = 0.0
    moved_distance: float = 0.0
    rotation: float = 0.0
    measured_flank: MeasuredFlank | None = field(default=None)

    @property
    def deviates(self) -> bool:
        """Whether the flank is no parallel of a cycloid: turned or measured."""
        return self.rotation != 0.0 or self.measured_flank is not None


NOMINAL = FlankModification()
"""The flank that the reducer's own pins generate."""

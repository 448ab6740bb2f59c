"""An effect with a memory of its own in one file, as the recipe asks for it: a loose flange that friction holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.model.effects.effect import LOOPS, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import Hysteresis, Path
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN, NMM_PER_NM


@dataclass(frozen=True)
class ClampedFlange(Hysteresis):
    """Dead zone in series whose place friction keeps until the torque exceeds it, in either sense.

    Attributes
    ----------
    half : of the play [rad].
    clamp : torque from which the flange slips [N mm]; a closed loop beyond it takes 4 half clamp.
    """

    half: float
    clamp: float

    def start(self) -> float:
        """In the middle."""
        return 0.0

    def advance(self, state: float, path: Path) -> tuple[Real, float]:
        """Rotation [rad] (n,): to a stop where the torque exceeds the clamp, else where it was."""
        free = np.abs(path.torque) > self.clamp
        last = np.maximum.accumulate(np.where(free, np.arange(len(free)), -1))
        twist = np.where(last >= 0, self.half * np.sign(path.torque[last]), state)
        return twist, float(twist[-1])


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(ClampedFlange(0.5 * values[0] / ARCMIN, NMM_PER_NM * values[1]))


EFFECT = Effect(
    name="clamped_flange",
    title="flange that slips between its stops",
    physics="a flange held by friction turns between two stops once the torque exceeds the friction",
    source="dead zone in series with a friction element, Nordin and Gutman, Automatica 38 (2002) 1633",
    parameters=(
        Parameter("play_arcmin", "arcmin", "rotation between the stops"),
        Parameter("clamp_Nm", "N m", "torque from which the flange slips"),
    ),
    changes="adds half of the play on the side of the last torque beyond the clamp",
    signature="the loop jumps by the play at a torque of its own in either sense",
    confused_with=("coulomb", "bearing_clearance"),
    told_apart_by="the angle between flange and lever with a dial gauge",
    bounds=lambda drive: (
        (0.0, 1e-3 * drive.rated_torque * largest_twist(drive)),
        (0.0, 0.5 * drive.rated_torque / NMM_PER_NM),
    ),
    apply=_apply,
    needs=frozenset({LOOPS}),
)

"""Play of the output's flange, coupling or lever."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.model.effects.effect import FLANGE, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import Spring
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN


@dataclass(frozen=True)
class DeadZone(Spring):
    """Play in series with the output: the ``half`` of it [rad] in the sense of the torque, however small that is."""

    half: float

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] to one end of the play for 0.0 and beyond, to the other for -0.0 and below."""
        return np.copysign(self.half, torque)


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(DeadZone(0.5 * values[0] / ARCMIN))


EFFECT = Effect(
    name="loose_flange",
    title="play of the output's flange",
    physics="a flange, key or coupling that is not tight turns freely between two stops before it carries",
    source="dead zone in series with a spring, Nordin and Gutman, Automatica 38 (2002) 1633",
    parameters=(Parameter("play_arcmin", "arcmin", "rotation between the stops"),),
    changes="adds half of the play in the sense of the torque to the rotation of the output",
    signature="play grows, and the same at every crank angle: in the angle of the lever, not in that of the flange",
    confused_with=("bearing_clearance", "pin_circle_error", "pin_radius_error"),
    told_apart_by="the play between the reducer's flange and the lever with a dial gauge",
    bounds=lambda drive: ((0.0, 1e-3 * drive.rated_torque * largest_twist(drive)),),
    apply=_apply,
    needs=frozenset({FLANGE}),
)

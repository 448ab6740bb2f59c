"""Torsional compliance between the reducer's output and the torque."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.model.effects.effect import TORQUES, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import Spring
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN


@dataclass(frozen=True)
class LinearSpring(Spring):
    """A ``compliance`` [rad/(N mm)] in series with the output."""

    compliance: float

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] in proportion to the torque [N mm]."""
        return self.compliance * torque

    def energy(self, torque: Real) -> Real:
        """The integral of the twist in closed form [N mm rad]."""
        return 0.5 * self.compliance * torque**2


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(LinearSpring(1e-3 * values[0] / ARCMIN))


EFFECT = Effect(
    name="output_torsion",
    title="torsional compliance in series with the output",
    physics="shaft, flange and coupling twist in proportion to the torque",
    source="series of linear springs",
    parameters=(Parameter("compliance_arcmin_per_Nm", "arcmin/(N m)", "twist per torque"),),
    changes="adds torsion times torque to the rotation of the output",
    signature="the same angle per torque at every load and crank angle",
    confused_with=("seat_compliance", "torque_gain"),
    told_apart_by="the twist between the reducer's flange and the lever",
    bounds=lambda drive: ((0.0, largest_twist(drive)),),
    apply=_apply,
    needs=frozenset({TORQUES}),
)

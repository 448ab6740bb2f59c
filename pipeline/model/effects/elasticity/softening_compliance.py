"""Compliance in series with the output that softens towards no load."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.model.effects.effect import TORQUES, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import Spring
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN

KNEES = (0.02, 1.0)
"""Knees that are looked for, over the rated torque: below, the twist is as play; above, the spring is linear."""


@dataclass(frozen=True)
class CubicSpring(Spring):
    """Spring in series with the output, soft at first: torque / knee = x + x^3, twist = compliance knee x.

    Attributes
    ----------
    compliance : without load [rad/(N mm)].
    knee : torque [N mm]; at twice of it the cubic part carries as much as the linear one.

    Source
    ------
    Stiffness of strain-wave gears, Tuttle and Seering, IEEE Trans. Robot. Autom. 12 (1996) 368.
    """

    compliance: float
    knee: float

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] by the real root of the cubic, with hyperbolic functions."""
        scaled = np.asarray(torque, float) / self.knee
        root = 2 / np.sqrt(3) * np.sinh(np.arcsinh(1.5 * np.sqrt(3) * scaled) / 3)
        return self.compliance * self.knee * root


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(CubicSpring(1e-3 * values[0] / ARCMIN, 1e3 * values[1]))


EFFECT = Effect(
    name="softening_compliance",
    title="compliance of the output that softens towards no load",
    physics="printed and rubber parts, keys and bolted joints close up under load: their stiffness grows with it, "
    "beyond what contacts by Hertz do",
    source="cubic spring of joints with strain-wave gears, Tuttle and Seering, IEEE Trans. Robot. Autom. 12 (1996) 368",
    parameters=(
        Parameter("compliance_arcmin_per_Nm", "arcmin/(N m)", "twist per torque without load"),
        Parameter("knee_Nm", "N m", "torque of the knee: at twice of it half of the torque is the cubic part's"),
    ),
    changes="a cubic spring between the output and the torque",
    signature="steep near zero torque in both senses, without play; the rigidity grows with the load",
    confused_with=("output_torsion", "seat_compliance"),
    told_apart_by="the twist between the reducer's flange and the lever at a tenth, half and all of the load",
    bounds=lambda drive: (
        (0.0, largest_twist(drive)),
        (1e-3 * KNEES[0] * drive.rated_torque, 1e-3 * KNEES[1] * drive.rated_torque),
    ),
    apply=_apply,
    limit_case="output_torsion",
    needs=frozenset({TORQUES}),
)

"""Parts that deflect more than the model has: output, seats of the pins, softening, a loose flange, a soft modulus."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real
from pipeline.model.effects.effect import FLANGE, TEMPERATURE, TORQUES, Conditions, Effect, Parameter, largest_twist
from pipeline.model.elements import ElasticModulus, Spring
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


OUTPUT_TORSION = Effect(
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
    apply=lambda drive, values, conditions: drive.with_elements(LinearSpring(1e-3 * values[0] / ARCMIN)),
    needs=frozenset({TORQUES}),
)


def _apply_seat_compliance(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    linear = drive.laws.linear.copy()
    linear[: drive.reducer.n_pins] += 1e-3 * values[0]
    return replace(drive, laws=replace(drive.laws, linear=linear))


def _seat_compliance_bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
    share = drive.rated_torque / (0.25 * np.sum(np.abs(drive.reducer.pins.arm)))
    specific = drive.laws.compliance(np.full(len(drive.laws), share))[0]
    return ((0.0, 2e4 * specific),)


SEAT_COMPLIANCE = Effect(
    name="seat_compliance",
    title="compliance of the pins' seats and the housing",
    physics="every pin deflects elastically in its seat, in series with its contact",
    source="series of a linear spring with the law of the contact",
    parameters=(Parameter("compliance_um_per_N", "um/N", "of one seat"),),
    changes="the linear part of the pins' force laws",
    signature="rigidity falls at all loads, and more pins share the load",
    confused_with=("output_torsion",),
    told_apart_by="the twist of the housing ring against the frame under load",
    bounds=_seat_compliance_bounds,
    apply=_apply_seat_compliance,
)


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
        root: Real = 2 / np.sqrt(3) * np.sinh(np.arcsinh(1.5 * np.sqrt(3) * scaled) / 3)
        return self.compliance * self.knee * root


def _apply_softening_compliance(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return drive.with_elements(CubicSpring(1e-3 * values[0] / ARCMIN, 1e3 * values[1]))


SOFTENING_COMPLIANCE = Effect(
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
    apply=_apply_softening_compliance,
    limit_case="output_torsion",
    needs=frozenset({TORQUES}),
)


@dataclass(frozen=True)
class DeadZone(Spring):
    """Play in series with the output: the ``half`` of it [rad] in the sense of the torque, however small that is."""

    half: float

    def twist(self, torque: Real) -> Real:
        """Rotation [rad] to one end of the play for 0.0 and beyond, to the other for -0.0 and below."""
        return np.copysign(self.half, torque)


LOOSE_FLANGE = Effect(
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
    apply=lambda drive, values, conditions: drive.with_elements(DeadZone(0.5 * values[0] / ARCMIN)),
    needs=frozenset({FLANGE}),
)


STEEPEST = 0.02
"""Loss of modulus per kelvin that is looked for: polymers near their glass transition."""
SOFTEST, STIFFEST = 0.2, 5.0
"""Factors of the modulus beyond which the slope is no longer one: the part flows or is another material."""


def _apply_modulus_temperature(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    factor = np.clip(1 - values[0] * conditions.temperature_rise, SOFTEST, STIFFEST)
    return drive.with_elements(ElasticModulus(factor, of_bearing=True))


MODULUS_TEMPERATURE = Effect(
    name="modulus_temperature",
    title="modulus that falls with the temperature",
    physics="polymers soften as they warm, by 0.2 to 2 % a kelvin, steel by 0.03 %: forces on elastic parts and "
    "contacts enter as force over modulus, so that the curve is stretched along the torque, and play is left as it is",
    source="first order of the modulus in the temperature; a material's own slope is that of the storage modulus as "
    "ISO 6721-1 has it measured",
    parameters=(Parameter("loss_per_K", "1/K", "share of the modulus that is lost per kelvin"),),
    changes="stiffness of disk, contacts and bearing, with the temperature above that of the drawing",
    signature="rigidity falls as the drive warms, play does not",
    confused_with=("thermal_growth", "run_in"),
    told_apart_by="the same loop at two temperatures: its slope under load, not its width at zero torque",
    bounds=lambda drive: ((-STEEPEST / 4, STEEPEST),),
    apply=_apply_modulus_temperature,
    needs=frozenset({TEMPERATURE}),
)

EFFECTS = (OUTPUT_TORSION, SEAT_COMPLIANCE, SOFTENING_COMPLIANCE, LOOSE_FLANGE, MODULUS_TEMPERATURE)

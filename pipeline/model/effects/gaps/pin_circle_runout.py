"""Run-out of the pin circle against the axis of the input and the output."""

from collections.abc import Sequence

import numpy as np

from pipeline.model.effects.effect import CRANKS, LARGEST_CLEARANCE, MOVES, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    x, y = 1e-3 * values[0], 1e-3 * values[1]
    cosine, sine = np.cos(drive.profile.pin_angle()), np.sin(drive.profile.pin_angle())
    return drive.moved(pin_radial=x * cosine + y * sine, pin_tangential=y * cosine - x * sine)


def _bounds(drive: Drive) -> tuple[tuple[float, float], ...]:
    reach = 1e3 * LARGEST_CLEARANCE * drive.profile.eccentricity
    return ((-reach, reach),) * 2


EFFECT = Effect(
    name="pin_circle_runout",
    title="run-out of the pin circle",
    physics="the centre of the pin circle lies off the common axis of crank and output by d: the disk, whose pitch "
    "point lies Z e from its centre, turns by up to d / (Z e), once per turn of the crank",
    source="exact gaps of displaced pins; pitch point after Litvin and Fuentes, Gear Geometry (2004), ch. 13",
    parameters=(
        Parameter("x_um", "um", "centre of the pin circle along the crank angle 0"),
        Parameter("y_um", "um", "the same a quarter turn on"),
    ),
    changes="place of every pin",
    signature="the angle has one wave over the crank angle, and the motor's torque is off by its slope times the ratio",
    confused_with=("flank_runout", "crank_compliance_1", "encoder_eccentricity"),
    told_apart_by="positions a quarter of an output turn apart (flank); an unloaded turn of the crank (compliance); a "
    "second encoder (encoder)",
    bounds=_bounds,
    apply=_apply,
    needs=frozenset({CRANKS, MOVES}),
)

"""Clearance of the input bearing."""

from collections.abc import Sequence
from dataclasses import replace

from pipeline.model.effects.effect import Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    return replace(drive, bearing_clearance=drive.bearing_clearance + 1e-3 * values[0])


EFFECT = Effect(
    name="bearing_clearance",
    title="clearance of the input bearing",
    physics="the disk's centre is free within a circle before its bearing carries",
    source="the paper, section 2.2, which calls it very small and leaves it out",
    parameters=(Parameter("clearance_um", "um", "radial clearance beyond the declared one"),),
    changes="radial clearance of the bearing",
    signature="play grows, and the same at every crank angle; little at high torque",
    confused_with=("pin_circle_error", "pin_radius_error", "eccentricity_error"),
    told_apart_by="the radial play of the input bearing with a dial gauge",
    bounds=lambda drive: ((0.0, 1e3 * drive.profile.eccentricity / 3),),
    apply=_apply,
    of_one_disk=True,
)

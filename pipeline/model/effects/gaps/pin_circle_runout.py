"""Run-out of the pin circle against the axis of the input and the output."""

import numpy as np

from pipeline.model.effects.gaps._runout import runout
from pipeline.model.load_history.drive import Drive


def _moved(drive: Drive, x: float, y: float) -> Drive:
    cosine, sine = np.cos(drive.profile.pin_angle()), np.sin(drive.profile.pin_angle())
    return drive.with_added_errors(pin_radial=x * cosine + y * sine, pin_tangential=y * cosine - x * sine)


EFFECT = runout(
    "pin_circle_runout",
    "run-out of the pin circle",
    _moved,
    "offset of the pin circle's centre towards crank angle zero",
    physics="the centre of the pin circle lies off the common axis of crank and output by d: the disk, whose pitch "
    "point lies Z e from its centre, turns by up to d / (Z e), once per turn of the crank",
    changes="place of every pin",
    told_apart_by="positions a quarter of an output turn apart (flank); an unloaded turn of the crank (compliance); a "
    "second encoder (encoder)",
    signature="the angle has one wave over the crank angle, and the motor's torque is off by its slope times the ratio",
)

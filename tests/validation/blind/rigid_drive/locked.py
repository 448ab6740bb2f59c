"""The rigid drive with its output locked: the motor turns the crank, and does the work that the bodies store.

Nothing is differentiated by hand: at a crank angle the output stands where it is locked, the torque that this takes
follows from balanced poses, and the motor's torque is the change of the stored energy over its own angle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tests.validation.blind.rigid_drive.drive import RigidDrive

Real = NDArray[np.float64]

STEP = 1e-4
"""Of the output's angle [rad], by which the energy is differentiated."""


def locked_torques(
    drive_at: Callable[[float], RigidDrive], start: float, ratio: float, angle: Real, most: float
) -> Real:
    """Torques of the motor times the ratio, and of the output (2, n) [N mm], at twists (n,) of the output [rad].

    Parameters
    ----------
    drive_at : the drive at a crank angle [rad].
    start : crank angle [rad] where the output is locked in its nominal place.
    ratio : turns of the crank per turn of the output, with its sign.
    most : torque on the output [N mm] that is not exceeded.
    """

    def stored(twist: float) -> tuple[float, float]:
        drive = drive_at(start - ratio * twist)
        radius, pose = drive.flank.circle_radius, np.zeros(5)

        def beyond(torque: float) -> float:
            nonlocal pose
            pose = drive.balanced(torque, pose)
            return float(pose[4]) / radius - twist

        sense = 1.0 if twist > 0 else -1.0
        torque = brentq(beyond, *sorted((1e-3 * sense * most, sense * most)), xtol=1e-6 * most, rtol=1e-12)
        beyond(torque)
        return drive.energy_stored(pose), torque

    ends = [(stored(twist - STEP), stored(twist + STEP)) for twist in angle]
    motor = [(after - before) / (2 * STEP) for (before, _), (after, _) in ends]
    return np.array([motor, [0.5 * (before + after) for (_, before), (_, after) in ends]])

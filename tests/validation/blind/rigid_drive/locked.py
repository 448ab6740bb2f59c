"""The rigid drive with its output locked: the motor turns the crank, and does the work that the bodies store.

Nothing is differentiated by hand: at a crank angle the output stands where it is locked, the torque that this takes
follows from balanced poses, and the motor's torque is the change of the stored energy over its own angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tests.validation.blind.rigid_drive.drive import Curve, RigidDrive

Real = NDArray[np.float64]

STEP = 1e-5
"""Of the output's angle [rad], by which the energy is differentiated."""
NODES = 11
"""Torques of each sense at which a curve is solved."""
LEAST = 0.01
"""The smallest of them over the largest; a line through two goes on to the end of the play."""
NEAR = 0.6, 1.5
"""Shares of a torque between which it lies again after a ``STEP``."""
APART = 1e-7
"""Torque over the largest by which the two ends of the play are told apart."""
FOUND, ROUNDS = 1e-9, 40
"""Change of the angle [rad] at which it is found, and rounds to it at most."""


@dataclass(frozen=True)
class LockedDrive:
    """A drive whose output is locked.

    Attributes
    ----------
    drive_at : the drive at a crank angle [rad].
    ratio : turns of the crank per turn of the output, with its sign.
    twist : of a linear spring in series with the output [rad/(N mm)].
    wave : how much more it is at a crank angle, by cosine and sine, about the size of both [rad/(N mm)].
    """

    drive_at: Callable[[float], RigidDrive]
    ratio: float
    twist: float = 0.0
    wave: tuple[float, float] = (0.0, 0.0)

    def twist_at(self, crank: float) -> float:
        """Twist of the spring [rad/(N mm)] at a crank angle [rad]."""
        cosine, sine = self.wave
        return float(self.twist + np.hypot(cosine, sine) + cosine * np.cos(crank) + sine * np.sin(crank))

    def stored(self, start: float, angle: float, between: tuple[float, float]) -> tuple[float, float]:
        """Energy stored [N mm] and torque at the output [N mm] at a twist [rad], the crank at ``start`` without any.

        The torque is sought ``between`` two [N mm].
        """
        crank, pose = start - self.ratio * angle, np.zeros(5)
        drive, twist = self.drive_at(crank), self.twist_at(crank)
        radius = drive.flank.circle_radius

        def beyond(torque: float) -> float:
            nonlocal pose
            pose = drive.balanced(torque, pose)
            return float(pose[4]) / radius + twist * torque - angle

        torque = brentq(beyond, *between, xtol=1e-8 * max(map(abs, between)), rtol=1e-12)
        beyond(torque)
        return drive.energy_stored(pose) + 0.5 * twist * torque**2, torque

    def motor_torque(self, start: float, angle: float, between: tuple[float, float]) -> tuple[float, float]:
        """Torque of the motor times the ratio, and at the output [N mm], at a twist [rad]."""
        (before, low), (after, high) = (self.stored(start, angle + step, between) for step in (-STEP, STEP))
        return (after - before) / (2 * STEP), 0.5 * (low + high)

    def angle(self, start: float, torque: float) -> float:
        """Twist [rad] under a torque at the output [N mm]."""
        angle, pose = 0.0, np.zeros(5)
        for _ in range(ROUNDS):
            crank = start - self.ratio * angle
            drive = self.drive_at(crank)
            pose = drive.balanced(torque, pose)
            before, angle = angle, float(pose[4]) / drive.flank.circle_radius + self.twist_at(crank) * torque
            if abs(angle - before) < FOUND:
                break
        return angle

    def curve(self, start: float, largest: float) -> Curve:
        """Twist [rad] over the motor's torque times the ratio, up to about the ``largest`` at the output [N mm]."""
        shares = LEAST + (1 - LEAST) * np.linspace(0.0, 1.0, NODES) ** 2
        senses = []
        for sense in (-1.0, 1.0):
            torque = sense * largest * shares
            angle = np.array([self.angle(start, load) for load in torque])
            pairs = zip(angle, torque, strict=True)
            motor = np.array([self.motor_torque(start, a, (NEAR[0] * load, NEAR[1] * load))[0] for a, load in pairs])
            to_none = shares[0] / (shares[1] - shares[0])
            end = (values[0] - to_none * (values[1] - values[0]) for values in (motor, angle))
            at_end = next(end) + APART * sense * largest
            senses.append((np.append(at_end, motor), np.append(next(end), angle)))
        (falling, low), (rising, high) = senses
        return Curve(np.concatenate([falling[::-1], rising]), np.concatenate([low[::-1], high]))


def locked_torques(
    drive_at: Callable[[float], RigidDrive], start: float, ratio: float, angle: Real, most: float
) -> Real:
    """Torques of the motor times the ratio, and of the output (2, n) [N mm], at twists (n,) of the output [rad]."""
    locked = LockedDrive(drive_at, ratio)
    return np.array(
        [locked.motor_torque(start, float(a), (np.copysign(1e-3 * most, a), np.copysign(most, a))) for a in angle]
    ).T

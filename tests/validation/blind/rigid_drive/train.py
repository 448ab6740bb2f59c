"""What lies between the rigid drive and the bench: friction of the output, twists in series, creep.

The rigid drive with its output locked: the motor turns the crank, and does the work that the bodies store.

Nothing is differentiated by hand: at a crank angle the output stands where it is locked, the torque that this takes
follows from balanced poses, and the motor's torque is the change of the stored energy over its own angle.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from pipeline.arrays import Real
from tests.validation.blind.rigid_drive.drive import Curve, RigidDrive

BRISTLES = 24
"""Elements that yield before they slide; the library of effects has four."""
FIRST_REACH, LAST_REACH = 1 / 8, 9 / 8
"""Rotations at which the first and the last of them slide, over that of the library's last: the same mean."""
ABRUPT = 3e-6
"""Rotation [rad] over which constant friction is raised beside bristles: a hundredth of an arcmin."""
CUBIC_STEPS = 60
"""Newton steps to the root of a cubic that rises: from beyond it they fall to it, and settle within ten."""
TABLE = 4000
"""Torques at which a curve is tabled for a walk along it."""


@dataclass(frozen=True)
class Train:
    """Friction and compliance beside a drive, all referred to the output.

    The compliance lies between the friction and a loaded output: it carries all of the torque. A locked output carries
    what the friction leaves.

    Attributes
    ----------
    friction : constant, of either sense [N mm].
    load_friction : friction over the torque carried [1].
    drive_friction, backdrive_friction : the same beside it while the output turns with the torque on it, and against.
    bristles, reach : friction that yields first [N mm], and the rotation over which it is raised [rad].
    twist : in series [rad/(N mm)].
    soft_twist, knee : of a cubic spring in series: torque / knee = x + x^3, twist = soft_twist knee x.
    creep, creep_time : delayed twist [rad/(N mm)] and the time in which 63 % of it is reached [s].
    """

    friction: float = 0.0
    load_friction: float = 0.0
    drive_friction: float = 0.0
    backdrive_friction: float = 0.0
    bristles: float = 0.0
    reach: float = 1.0
    twist: float = 0.0
    soft_twist: float = 0.0
    knee: float = 1.0
    creep: float = 0.0
    creep_time: float = 1.0

    def walked(self, curve: Curve, torque: Real) -> tuple[Real, Real]:
        """Rotation [rad] of the drive, and torque [N mm] that it carries, from rest along torques (n,) in time."""
        if self.bristles:
            return self._yielding(curve, torque)
        carried_torque, drive_torque = np.empty(len(torque)), 0.0
        for k, load in enumerate(torque):
            drive_torque = min(max(drive_torque, self._least(load)), -self._least(-load))
            carried_torque[k] = drive_torque
        return curve.at(carried_torque), carried_torque

    def twisted(self, torque: Real) -> Real:
        """Rotations [rad] at once in series with the drive."""
        if not self.soft_twist:
            return self.twist * torque
        load = torque / self.knee
        root = np.sign(load) * np.minimum(np.abs(load), np.cbrt(np.abs(load)))
        for _ in range(CUBIC_STEPS):
            root = root - (root + root**3 - load) / (1 + 3 * root**2)
        return self.twist * torque + self.soft_twist * self.knee * root

    def crept(self, torque: Real, time: Real) -> Real:
        """Delayed rotations [rad] under torques that are linear in time between the readings."""
        twist, strain = np.zeros(len(torque)), 0.0
        for k in range(1, len(torque) if self.creep else 0):
            interval = time[k] - time[k - 1]
            if interval > 0:
                rate = (torque[k] - torque[k - 1]) / interval
                lagging = self.creep * (torque[k - 1] - self.creep_time * rate)
                strain = (
                    lagging + self.creep * rate * interval + (strain - lagging) * np.exp(-interval / self.creep_time)
                )
            twist[k] = strain
        return twist

    def _least(self, load: float) -> float:
        """Least torque that the drive may carry under a load: what exceeds it by all friction is that load."""
        net_load = load - self.friction
        if net_load > 0:
            return net_load / (1 + self.load_friction + self.drive_friction)
        return net_load / (1 - self.load_friction - self.backdrive_friction)

    def _loaded(self, torque: float, raised: float) -> float:
        """Torque carried and its friction, the share ``raised`` of it, which rises with the rotation (-1 to 1)."""
        one_way = self.drive_friction if raised * torque > 0 else self.backdrive_friction
        return torque + abs(torque) * (self.load_friction + one_way) * raised

    def _yielding(self, curve: Curve, torque: Real) -> tuple[Real, Real]:
        """As ``walked`` with bristles: at every step the torque carried balances load and all friction."""
        top = float(np.max(np.abs(curve.torque)))
        torques = np.linspace(-top, top, TABLE)
        angles = curve.at(torques)
        shares = np.linspace(FIRST_REACH, LAST_REACH, BRISTLES)
        limits = np.append(np.full(BRISTLES, self.bristles / BRISTLES), self.friction)
        reaches = np.append(shares * self.reach, ABRUPT)
        steepest = self.load_friction + max(self.drive_friction, self.backdrive_friction)
        carried_torque, anchors = np.empty(len(torque)), np.full(len(limits), np.interp(0.0, torques, angles))
        for k, load in enumerate(torque):

            def excess(trial_torque: float, load: float = load, anchors: Real = anchors) -> float:
                raised = np.clip((np.interp(trial_torque, torques, angles) - anchors) / reaches, -1, 1)
                return self._loaded(trial_torque, raised[-1]) + float(np.sum(limits * raised)) - load

            largest = (abs(load) + float(limits.sum())) / (1 - steepest) + 1.0  # what all friction holds under the load
            carried_torque[k] = brentq(excess, -largest, largest, xtol=1e-6 * top)
            spring_angle = np.interp(carried_torque[k], torques, angles)
            anchors = np.clip(anchors, spring_angle - reaches, spring_angle + reaches)
        return curve.at(carried_torque), carried_torque


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

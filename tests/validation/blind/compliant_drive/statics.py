"""Equilibrium of one cycloid disk on elastic contacts at one crank angle, by its least energy in a trust region.

The flank is the parallel of the curve that the centre of a housing pin draws in the disk (Litvin and Fuentes, Gear
Geometry and Applied Theory, 2004, ch. 13), taken at finite poses. A contact follows a power of the approach. The disk
adds a compliance that couples its pins: the elastic half-plane under line loads (Flamant; Johnson, Contact Mechanics,
1985, 2.3), its logarithm made finite at no distance and at large ones.

What lies between the elastic drive and the bench: friction, twists with and without memory, row by row.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize

from pipeline.arrays import Complex, Real

UM = 1e-3
"""Millimetres of a micrometre: energies are in N um, so that all unknowns are of order one to a hundred."""
NODES = 22
"""Torques of each sense at which the curve is solved."""
SMALLEST = 2e-4
"""Share of the largest torque at the ends of the play."""
UNBALANCED = 2e-6
"""Forces left over in that of the torque at the pin circle."""
FOOT_STEPS, FORCE_STEPS = 6, 40
"""Newton steps to a foot point and to the forces on a disk of coupled compliance."""


class UnbalancedError(RuntimeError):
    """No equilibrium was found."""


@dataclass(frozen=True)
class PowerLaw:
    """Force = ``stiffness`` times approach [um] to the ``power`` [N]."""

    stiffness: float
    power: float


@dataclass(frozen=True)
class Disk:
    """A drive at one crank angle, lengths in mm.

    Attributes
    ----------
    crank : [rad]
    radius, eccentricity : of the generating pin circle and of the generating crank.
    taken_off : (n_lobes,) by which the generating radius of each lobe is smaller.
    pins : (n_pins,) centres of the housing pins, complex, clockwise from angle 0.
    growth : (n_pins,) by which each pin is thicker than the one that generates.
    throw : eccentricity of the crank.
    holes : (n_out,) angles of output pins [rad]; ``hole_circle`` their radius, ``room`` (n_out,) of each in its hole.
    at_pins, at_holes : laws of a contact.
    bearing : radial stiffness [N/um], and clearance [um].
    compliance : (n_pins, n_pins) [um/N] of the disk.
    """

    crank: float
    radius: float
    eccentricity: float
    taken_off: Real
    pins: Complex
    growth: Real
    throw: float
    holes: Real
    hole_circle: float
    room: Real
    at_pins: PowerLaw
    at_holes: PowerLaw
    bearing: tuple[float, float]
    compliance: Real

    @property
    def turned(self) -> float:
        """Nominal rotation of the disk [rad]."""
        return -self.crank / (len(self.pins) - 1)

    def _locus(self, at: Real) -> tuple[Complex, Complex, Complex]:
        """The curve of the pins' centres and two derivatives at parameters (n_pins,)."""
        n = len(self.pins)
        lobe = np.floor(-at * (n - 1) / (2 * np.pi)).astype(int) % (n - 1)
        slow, fast = (self.radius - self.taken_off[lobe]) * np.exp(1j * at), self.eccentricity * np.exp(1j * n * at)
        return slow - fast, 1j * (slow - n * fast), -slow + n**2 * fast

    def approaches(self, pose: Real) -> tuple[Real, Real, Real, Real]:
        """Approaches [um] at pins and holes with their slopes by a pose (4,) [um]: shift x, y, disk and output on R."""
        shift = UM * complex(pose[0], pose[1])
        disk, output = UM * pose[2] / self.radius, UM * pose[3] / self.radius
        centre = self.throw * np.exp(1j * self.crank) + shift
        frame = np.exp(-1j * (self.turned + disk))
        seen = (self.pins - centre) * frame
        at = np.angle(self.pins) - self.turned
        for _ in range(FOOT_STEPS):
            point, slope, bend = self._locus(at)
            away = seen - point
            rise = np.abs(slope) ** 2 - np.real(np.conj(bend) * away)
            at = at + np.clip(
                np.real(np.conj(slope) * away) / np.where(rise > 0, rise, np.abs(slope) ** 2), -0.02, 0.02
            )
        point, slope, _ = self._locus(at)
        outwards = -1j * slope / np.abs(slope)
        pressed = (self.growth - np.real(np.conj(outwards) * (seen - point))) / UM
        normal = np.conj(outwards) * frame
        of_pins = np.column_stack(
            [
                np.real(normal),
                np.real(1j * normal),
                np.real(np.conj(outwards) * 1j * seen) / self.radius,
                np.zeros(len(seen)),
            ]
        )
        hole = self.hole_circle * np.exp(1j * (self.holes + self.turned + disk))
        pin = self.hole_circle * np.exp(1j * (self.holes + self.turned + output))
        apart = centre + hole - pin
        unit = np.conj(apart / np.abs(apart))
        of_holes = np.column_stack(
            [
                np.real(unit),
                np.real(1j * unit),
                np.real(unit * 1j * hole) / self.radius,
                -np.real(unit * 1j * pin) / self.radius,
            ]
        )
        return pressed, of_pins, (np.abs(apart) - self.room) / UM, of_holes

    def pin_forces(self, pressed: Real) -> tuple[Real, float, Real]:
        """Forces (n_pins,) [N], their energy [N um], and slope of the forces (n_pins, n_pins) by the approaches."""
        law = self.at_pins
        touching = np.maximum(pressed, 0.0)
        if not self.compliance.any():
            force = law.stiffness * touching**law.power
            slope = law.power * law.stiffness * touching ** (law.power - 1) * (pressed > 0)
            return force, float(np.sum(force * touching)) / (law.power + 1), np.diag(slope)
        local = 0.5 * touching
        for _ in range(FORCE_STEPS):
            force = law.stiffness * local**law.power
            rise = law.power * law.stiffness * np.maximum(local, 1e-9) ** (law.power - 1) * (local > 0)
            missing = np.maximum(pressed - self.compliance @ force, 0.0) - local
            open_pins = (pressed - self.compliance @ force) > 0
            matrix = np.eye(len(local)) + open_pins[:, None] * self.compliance * rise
            step = np.linalg.solve(matrix, missing)
            local = np.maximum(local + step, 0.0)
            if np.max(np.abs(step)) < 1e-10 * max(1.0, float(np.max(touching))):
                break
        force = law.stiffness * local**law.power
        rise = law.power * law.stiffness * np.maximum(local, 1e-9) ** (law.power - 1) * (local > 0)
        energy = float(np.sum(force * local)) / (law.power + 1) + 0.5 * float(force @ self.compliance @ force)
        softened = np.asarray(
            np.linalg.solve(np.eye(len(local)) + rise[:, None] * self.compliance, np.diag(rise)), float
        )
        return force, energy, 0.5 * (softened + softened.T)

    def energy(self, pose: Real, torque: float) -> tuple[float, Real, Real]:
        """Potential energy [N um] at a pose under a torque [N mm], its slope (4,) and curvature (4, 4)."""
        pressed, of_pins, in_holes, of_holes = self.approaches(pose)
        force, total, stiffness = self.pin_forces(pressed)
        law, touching = self.at_holes, np.maximum(in_holes, 0.0)
        out = law.stiffness * touching**law.power
        hold = law.power * law.stiffness * touching ** (law.power - 1) * (in_holes > 0)
        slope = of_pins.T @ force + of_holes.T @ out
        curvature = of_pins.T @ stiffness @ of_pins + of_holes.T @ (hold[:, None] * of_holes)
        total += float(np.sum(out * touching)) / (law.power + 1)
        spring, clearance = self.bearing
        travel = max(float(np.hypot(pose[0], pose[1])), 1e-9)
        if travel > clearance:
            direction = pose[:2] / travel
            total += 0.5 * spring * (travel - clearance) ** 2
            slope[:2] += spring * (travel - clearance) * direction
            outer = np.outer(direction, direction)
            curvature[:2, :2] += spring * outer + spring * (travel - clearance) / travel * (np.eye(2) - outer)
        slope[3] -= torque / self.radius
        return total - torque * pose[3] / self.radius, slope, curvature

    def balanced(self, torque: float, start: Real) -> Real:
        """Pose (4,) [um] of least energy under a torque [N mm].

        Raises
        ------
        UnbalancedError : forces are left over.
        """
        limit, radius = UNBALANCED * abs(torque) / self.radius, 5.0
        pose = start
        for _ in range(3):
            solved = minimize(
                lambda pose: self.energy(pose, torque)[:2],
                pose,
                jac=True,
                hess=lambda pose: self.energy(pose, torque)[2],
                method="trust-exact",
                options={"gtol": limit, "maxiter": 400, "initial_trust_radius": radius, "max_trust_radius": 20.0},
            )
            pose = np.asarray(solved.x, float)
            if np.linalg.norm(self.energy(pose, torque)[1]) <= 10 * limit:
                return pose
            radius *= 0.1
        raise UnbalancedError(f"forces do not balance at {torque:.3g} N mm")

    def curve(self, largest: float) -> "Curve":
        """Rotation of the output over torques to +- the ``largest`` [N mm]."""
        shares = np.linspace(1.0, 0.0, NODES) ** 2 * (1 - SMALLEST) + SMALLEST
        torque, angle = [], []
        for sense in (-1.0, 1.0):
            pose, solved = np.zeros(4), []
            for share in shares:
                pose = self.balanced(sense * share * largest, pose)
                solved.append(UM * pose[3] / self.radius)
            order = slice(None) if sense < 0 else slice(None, None, -1)
            torque.append((sense * largest * shares)[order])
            angle.append(np.array(solved)[order])
        return Curve(torque[0], angle[0], torque[1], angle[1])


@dataclass(frozen=True)
class Curve:
    """Elastic curve of either sense of the torque [N mm], [rad]; between them the play is crossed in a line."""

    below: Real
    angle_below: Real
    above: Real
    angle_above: Real

    def at(self, torque: Real) -> Real:
        """Rotations [rad] at torques (n,) [N mm]."""
        middle = np.interp(torque, [self.below[-1], self.above[0]], [self.angle_below[-1], self.angle_above[0]])
        low = PchipInterpolator(self.below, self.angle_below)(np.minimum(torque, self.below[-1]))
        high = PchipInterpolator(self.above, self.angle_above)(np.maximum(torque, self.above[0]))
        angle: Real = np.where(torque < self.below[-1], low, np.where(torque > self.above[0], high, middle))
        return angle


def coupled_compliance(
    places: Complex, normals: Real, thickness: float, modulus: float, depth: float, patch: float
) -> Real:
    """Compliance (n, n) [um/N] of a disk [mm, MPa] at places under loads along normals [rad].

    ``ln(1 + depth / (distance + patch))`` is completely monotone in the distance and so positive definite (Schoenberg),
    and stays so times the cosine of the angle between the normals (Schur's product theorem).
    """
    distance = np.abs(places[:, None] - places[None, :])
    size = 2 / (np.pi * modulus * thickness) / UM
    return np.asarray(size * np.log1p(depth / (distance + patch)) * np.cos(normals[:, None] - normals[None, :]))


def carried(torque: Real, constant: float, share: float) -> Real:
    """Torque (n,) that the drive carries under a load (n,): a play whose width is ``constant`` and ``share`` of it.

    Friction opposes the rotation: while it rises the load exceeds the torque carried by both, while it falls it is
    less by both.
    """
    inside, now = np.empty(len(torque)), 0.0
    for k, load in enumerate(torque):
        low, high = load - constant, load + constant
        low = low / (1 + share) if low > 0 else low / (1 - share)
        high = high / (1 - share) if high > 0 else high / (1 + share)
        now = min(max(now, low), high)
        inside[k] = now
    return inside


def rayleigh_twist(torque: Real, coefficient: float) -> Real:
    """Twist (n,) of Rayleigh's hysteresis after Madelung's rules: each branch a parabola from where the load turned.

    A branch that passes an earlier turn goes on along the branch that had been left there.
    """
    twist, past, now = np.empty(len(torque)), [(0.0, 0.0)], (0.0, 0.0)
    for k, load in enumerate(torque):
        if k and (load - now[0]) * (now[0] - past[-1][0]) < 0:
            past.append(now)
        while len(past) >= 3 and (load - past[-2][0]) * (past[-2][0] - past[-1][0]) > 0:
            past = past[:-2]
        if len(past) == 2 and abs(load) > abs(past[1][0]):
            past = [(0.0, 0.0)]
        turn, offset = past[-1]
        change = load - turn
        grown = np.sign(change) * change**2
        twist[k] = coefficient * grown if len(past) == 1 else offset + 0.5 * coefficient * grown
        now = (load, twist[k])
    return twist


def delayed(torque: Real, time: Real, constant: float) -> Real:
    """First-order lag (n,) of a torque behind time (n,) [s], implicit in each of its rows."""
    lagged, now = np.empty(len(torque)), 0.0
    for k, load in enumerate(torque):
        step = (time[k] - time[k - 1]) if k else 0.0
        now = (now + step / constant * load) / (1 + step / constant)
        lagged[k] = now
    return lagged

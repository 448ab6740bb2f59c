"""A drive of rigid bodies at one crank angle: its pose under a torque is that of least energy.

Poses are finite: pins slide along the curved flank as the disk moves, and nothing is linearised. Unknown are the disk's
shift and rotation and the output's, all as lengths; Newton's method on the energy, damped after Levenberg.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from pipeline.arrays import Complex, Real
from tests.validation.blind.rigid_drive.flank import Flank, LineContact, Output, Pose

NODES = 26
"""Torques of each sense at which the curve is solved; a monotone cubic joins them."""
NO_TORQUE = 1e-4
"""Share of the largest torque that stands for none on either side of the play."""
STEPS = 400
"""Newton steps of an equilibrium at most; the first one under load takes some 40, the others 4 to 8."""
BALANCED = 1e-6
"""Unbalanced force over that of the torque at the pins' circle."""
ROUNDED = 1e-9
"""The same over all contact forces, which a preload makes large: rounding of the energy leaves as much."""
FIRST_DAMPING, EASED, STIFFENED = 1e-6, 0.2, 10.0
"""Levenberg's damping at first, as a share of the stiffest direction, and its change after a good and a bad step."""
LEAST_DAMPING = 1e-15
"""Damping at least: what rounding leaves of the stiffest direction."""
LARGEST_MOVE = 0.02
"""Of a Newton step [mm]: some times the clearances, far less than a lobe."""
LEAST_WAY = 1e-12
"""Shift of a disk [mm] below which its direction is rounding."""
LESS = 0.5
"""Share of the unbalanced force that a step must leave, where the energy's rounding does not tell whether it fell."""
HOPELESS = 1e6
"""Damping beyond which no step is left."""


class NoBalanceError(RuntimeError):
    """An equilibrium was not found."""


@dataclass(frozen=True)
class Bearing:
    """Radial spring between eccentric and disk: stiffness (way - clearance)^exponent [N/mm^exponent], [mm]."""

    stiffness: float
    exponent: float
    clearance: float

    def held(self, shift: Real) -> tuple[float, Real, Real]:
        """Energy [N mm], its slope (2,) [N] and curvature (2, 2) [N/mm] at a shift (2,) [mm] of the disk."""
        travel = max(float(np.hypot(*shift)), LEAST_WAY)
        pressed = travel - self.clearance
        if pressed <= 0:
            return 0.0, np.zeros(2), np.zeros((2, 2))
        direction = shift / travel
        force = self.stiffness * pressed**self.exponent
        rise = self.exponent * force / pressed
        outer = np.outer(direction, direction)
        energy = force * pressed / (1 + self.exponent)
        return energy, force * direction, rise * outer + force / travel * (np.eye(2) - outer)


@dataclass(frozen=True)
class State:
    """A pose.

    Attributes
    ----------
    energy, slope, curvature : [N mm], its derivatives (n,) [N] and (n, n) [N/mm].
    pressed : sum of all forces [N].
    feet : of each disk, (n_pins,) places on the flank where the pins are nearest.
    """

    energy: float
    slope: Real
    curvature: Real
    pressed: float
    feet: tuple[Real, ...]


def balanced_pose(
    state_at: Callable[[Real, tuple[Real, ...] | None], State],
    start: Real,
    torque: float,
    radius: float,
    roughly: float = 0.0,
) -> Real:
    """Pose (n,) [mm] of least energy under a torque [N mm], by Newton's method, damped after Levenberg.

    Parameters
    ----------
    state_at : pose (n,) [mm] and feet of a neighbouring one, if there is one, to its state.
    radius : at which the torque is a force [mm].
    roughly : unbalanced force over that of the torque that is good enough where no step can be taken.

    Raises
    ------
    NoBalanceError
        If the forces do not balance.
    """
    pose, state, damping = start, state_at(start, None), FIRST_DAMPING
    for _ in range(STEPS):
        unbalanced = float(np.linalg.norm(state.slope))
        if unbalanced <= max(BALANCED * abs(torque) / radius, ROUNDED * state.pressed):
            return pose
        stiffest = max(float(np.max(np.diag(state.curvature))), abs(torque) / radius / LARGEST_MOVE)
        step = np.linalg.solve(state.curvature + damping * stiffest * np.eye(len(pose)), -state.slope)
        step *= min(1.0, LARGEST_MOVE / max(float(np.linalg.norm(step)), LEAST_WAY))
        trial = state_at(pose + step, state.feet)
        if trial.energy <= state.energy or np.linalg.norm(trial.slope) <= LESS * unbalanced:
            pose, state, damping = pose + step, trial, max(EASED * damping, LEAST_DAMPING)
        elif damping > HOPELESS:
            if unbalanced <= roughly * abs(torque) / radius:
                return pose
            break
        else:
            damping *= STIFFENED
    raise NoBalanceError(f"{np.linalg.norm(state.slope):.3g} N unbalanced at {torque:.3g} N mm")


@dataclass(frozen=True)
class Curve:
    """Rotation of the output over the torque, without friction.

    Attributes
    ----------
    torque : (2 NODES,) ascending [N mm]; the two in the middle stand for the ends of the play.
    angle : (2 NODES,) [rad].
    """

    torque: Real
    angle: Real

    def at(self, torque: Real) -> Real:
        """Rotations [rad] at torques [N mm]: a monotone cubic on either side of the play, a line across it."""
        middle = len(self.torque) // 2
        angle = np.interp(torque, self.torque, self.angle)
        for side, branch_mask in (
            (slice(None, middle), torque <= self.torque[middle - 1]),
            (slice(middle, None), torque >= self.torque[middle]),
        ):
            if np.any(branch_mask):
                angle[branch_mask] = PchipInterpolator(self.torque[side], self.angle[side])(torque[branch_mask])
        return angle


@dataclass(frozen=True)
class RigidDrive:
    """One crank angle of a drive.

    Attributes
    ----------
    crank : [rad]
    flank : of the disk.
    pin_centres : (n_pins,) actual, about the housing's axis, complex [mm]; clockwise from angle 0.
    pin_growth : (n_pins,) [mm] by which each pin is thicker than what generates the flank, or its gap closed otherwise.
    pin_contact : of every pin.
    eccentric : actual centre of the disk's bearing, complex [mm].
    """

    crank: float
    flank: Flank
    pin_centres: Complex
    pin_growth: Real
    pin_contact: LineContact
    eccentric: complex
    bearing: Bearing
    output: Output

    @property
    def rotation(self) -> float:
        """Nominal rotation of disk and output [rad]."""
        return -self.crank / self.flank.lobes

    def _pin_approaches(self, pose: Pose, parameter: Real | None) -> tuple[Real, Real, Real]:
        """Approaches (n_pins,) [mm], slopes (n_pins, 5) and parameters on the flank."""
        turn = np.exp(-1j * (self.rotation + pose.disk))
        pin_position = (self.pin_centres - self.eccentric - pose.shift) * turn
        if parameter is None:
            parameter = self.flank.nearest(pin_position, self.flank.nominal_parameters(self.rotation))
        else:
            parameter = self.flank.refined(pin_position, parameter)
        gap, outwards = self.flank.gaps(pin_position, parameter)
        slope = np.zeros((len(gap), 5))
        slope[:, 0] = np.real(np.conj(outwards) * turn)
        slope[:, 1] = np.real(np.conj(outwards) * 1j * turn)
        slope[:, 2] = np.real(np.conj(outwards) * 1j * pin_position)
        return self.pin_growth - gap, slope, parameter

    def _state(self, pose: Real, torque: float, feet: tuple[Real, ...] | None) -> State:
        """Energy and forces at a pose (5,) [mm] under a torque on the output [N mm]."""
        radius = self.flank.circle_radius
        rotation = pose[2:] / radius
        trial_pose = Pose(complex(pose[0], pose[1]), rotation[0], rotation[1], rotation[2])
        of_pins, pin_slopes, parameter = self._pin_approaches(trial_pose, feet[0] if feet else None)
        of_output, output_slopes = self.output.approaches(trial_pose, self.eccentric, self.rotation)
        energy, bearing_force, hold = self.bearing.held(pose[:2])
        pressed = 0.0
        slope, curvature = np.zeros(5), np.zeros((5, 5))
        slope[:2], curvature[:2, :2] = bearing_force, hold
        groups = (self.pin_contact, of_pins, pin_slopes), (self.output.contact, of_output, output_slopes)
        for contact, approach, slopes in groups:
            force, scaled = contact.force(approach), slopes / np.array([1, 1, radius, radius, radius])
            energy += float(np.sum(contact.energy(force)))
            pressed += float(force.sum())
            slope += force @ scaled
            curvature += scaled.T @ (contact.stiffness(force)[:, None] * scaled)
        slope[4] -= torque / radius
        return State(energy - torque * rotation[2], slope, curvature, pressed, (parameter,))

    def balanced(self, torque: float, start: Real) -> Real:
        """Pose (5,) [mm] under a torque on the output [N mm]: shift x, y and rotations times the pins' circle radius.

        Raises
        ------
        NoBalanceError
            If the forces do not balance.
        """
        radius = self.flank.circle_radius
        return balanced_pose(lambda pose, feet: self._state(pose, torque, feet), start, torque, radius)

    def energy_stored(self, pose: Real) -> float:
        """Elastic energy [N mm] at a pose (5,) [mm]."""
        return self._state(pose, 0.0, None).energy

    def curve(self, largest: float) -> Curve:
        """The curve to +- the ``largest`` torque [N mm], each sense from there down.

        Raises
        ------
        NoBalanceError
            If an equilibrium is not found.
        """
        shares = np.linspace(1.0, 0.0, NODES) ** 2 * (1 - NO_TORQUE) + NO_TORQUE
        senses = []
        for sense in (-1.0, 1.0):
            pose, rotations = np.zeros(5), []
            for torque in sense * largest * shares:
                pose = self.balanced(torque, pose)
                rotations.append(pose[4] / self.flank.circle_radius)
            senses.append((sense * largest * shares, np.array(rotations)))
        (falling, low), (rising, high) = senses
        return Curve(np.concatenate([falling, rising[::-1]]), np.concatenate([low, high[::-1]]))

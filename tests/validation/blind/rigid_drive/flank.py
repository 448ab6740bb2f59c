"""Pins against the flank of a rigid disk at any pose: distance and slope, by the nearest point of the pins' locus.

The flank is the parallel, at a pin's radius, of the curve that a pin's centre draws in the disk. So the gap between a
pin and the flank is the distance of the pin's actual centre from that curve, less what the pin is too thick.

Source: Litvin and Fuentes, Gear Geometry and Applied Theory (2004), ch. 13: the flank as an envelope.

Line contacts of steel cylinders after Palmgren, with a linear spring behind them.

What lies between a rigid disk and the output: crossed slides on rollers, or pins in holes of the disk.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import Complex, Index, Real

FIRST_STARTS = (-0.12, 0.0, 0.12)
"""Starts of the nearest point about the nominal one, in pitches of the lobes: a pin above a root has two of them."""
FOOT_STEPS = 12
"""Newton steps to a nearest point at most; 3 or 4 are needed."""
LARGEST_STEP = 0.1
"""Of these, in pitches of the lobes."""
FOOT_ERROR = 1e-13
"""Step [rad] below which the nearest point is found: 1e-11 mm on the largest disk, and its square in the distance."""


@dataclass(frozen=True)
class Flank:
    """A disk's flank, lobe by lobe, in the disk's frame [mm].

    Attributes
    ----------
    pins : number of pins, one more than lobes.
    circle_radius : of the pins' circle that generates the flank.
    eccentricity : that generates it.
    taken_off : (n_lobes,) by which the generating circle of each lobe is smaller: material off its flank.
    turned : (n_lobes,) rotation of each lobe about the disk's centre [rad], counterclockwise positive.
    centre : of the flank from the bore's, complex [mm].
    """

    pins: int
    circle_radius: float
    eccentricity: float
    taken_off: Real
    turned: Real
    centre: complex

    @property
    def lobes(self) -> int:
        """Number of lobes, the ratio of the drive."""
        return self.pins - 1

    def lobe_at(self, parameter: Real) -> Index:
        """Lobe of a place on the flank; they are counted clockwise from the root at angle 0."""
        return np.floor(-parameter * self.lobes / (2 * np.pi)).astype(int) % self.lobes

    def nominal_parameters(self, rotation: float) -> Real:
        """Where the pins touch the flank nominally, once the disk has turned by ``rotation`` [rad]."""
        clockwise = -2 * np.pi * np.arange(self.pins) / self.pins
        return clockwise - rotation

    def nearest(self, point: Complex, nominal: Real) -> Real:
        """Parameters (n_pins,) of the nearest points to pin centres in the disk's frame, the least of some starts."""
        pitch = 2 * np.pi / self.lobes
        feet = [self.refined(point, nominal + share * pitch) for share in FIRST_STARTS]
        distances = np.array([np.abs(self._in_lobe(point, foot)[0] - self._curve(foot)[0]) for foot in feet])
        nearest: Real = np.array(feet)[np.argmin(distances, axis=0), np.arange(len(point))]
        return nearest

    def refined(self, pin_position: Complex, start: Real) -> Real:
        """Parameters of the nearest points, from those of a neighbouring pose."""
        largest, parameter = LARGEST_STEP * 2 * np.pi / self.lobes, start
        for _ in range(FOOT_STEPS):
            in_lobe, _ = self._in_lobe(pin_position, parameter)
            point, slope, bend = self._curve(parameter)
            offset = in_lobe - point
            along_flank = np.real(np.conj(slope) * offset)
            turn = np.abs(slope) ** 2 - np.real(np.conj(bend) * offset)
            step = np.clip(along_flank / np.where(turn > 0, turn, np.abs(slope) ** 2), -largest, largest)
            parameter = parameter + step
            if np.max(np.abs(step)) < FOOT_ERROR:
                break
        return parameter

    def gaps(self, pin_position: Complex, parameter: Real) -> tuple[Real, Complex]:
        """Distances (n_pins,) [mm] of pin centres outside of the curve, and their slopes by the centres, complex."""
        in_lobe, turn = self._in_lobe(pin_position, parameter)
        point, slope, _ = self._curve(parameter)
        outwards = -1j * slope / np.abs(slope)
        return np.real(np.conj(outwards) * (in_lobe - point)), outwards / turn

    def _in_lobe(self, point: Complex, parameter: Real) -> tuple[Complex, Complex]:
        """Centres as the lobe sees them that lies where the parameter says, and the turn between the two frames."""
        turn = np.exp(-1j * self.turned[self.lobe_at(parameter)])
        return (point - self.centre) * turn, turn

    def _curve(self, parameter: Real) -> tuple[Complex, Complex, Complex]:
        """The pin centre's curve R exp(i psi) - e exp(i N psi) with its first two derivatives."""
        radius = self.circle_radius - self.taken_off[self.lobe_at(parameter)]
        first_circle, fast_circle = (
            radius * np.exp(1j * parameter),
            self.eccentricity * np.exp(1j * self.pins * parameter),
        )
        return (
            first_circle - fast_circle,
            1j * (first_circle - self.pins * fast_circle),
            -first_circle + self.pins**2 * fast_circle,
        )


APPROACH_MM, BY_FORCE, BY_LENGTH = 3.84e-5, 0.9, 0.8
"""Approach [mm] of a roller and a raceway of steel: 3.84e-5 Q^0.9 / L^0.8 with Q in N, L in mm; Palmgren, Ball and
Roller Bearing Engineering (1959)."""
INVERSION_STEPS = 60
"""Newton steps to a force at most; the approach is concave, so that they rise to it from below."""
SETTLED = 1e-14
"""Relative step at which a force is found."""


@dataclass(frozen=True)
class LineContact:
    """Approach ``interfaces`` times Palmgren's and ``compliance`` [mm/N] times the force, over ``length`` [mm].

    ``softness`` multiplies Palmgren's part.
    """

    length: float
    interfaces: int = 1
    compliance: float = 0.0

    @property
    def _scale(self) -> float:
        return float(self.interfaces * APPROACH_MM / self.length**BY_LENGTH)

    def force(self, approach: Real) -> Real:
        """Forces (n,) [N] at approaches [mm]; none where bodies are apart."""
        penetration = np.maximum(approach, 0.0)
        force = (penetration / self._scale) ** (1 / BY_FORCE)
        if self.compliance == 0.0:
            return force
        force = np.minimum(force, penetration / self.compliance)
        for _ in range(INVERSION_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = self.compliance + BY_FORCE * self._scale * force ** (BY_FORCE - 1)
            deviation = penetration - self._scale * force**BY_FORCE - self.compliance * force
            step = np.where(force > 0, deviation / slope, 0.0)
            force = np.maximum(force + step, 0.1 * force)
            if np.all(np.abs(step) <= SETTLED * np.maximum(force, SETTLED)):
                break
        return force

    def stiffness(self, force: Real) -> Real:
        """Slopes (n,) [N/mm] of the force; none where there is no force."""
        with np.errstate(divide="ignore"):
            soft = self.compliance + BY_FORCE * self._scale * force ** (BY_FORCE - 1)
        return np.where(force > 0, 1 / soft, 0.0)

    def energy(self, force: Real) -> Real:
        """Elastic energy (n,) [N mm] under forces."""
        return BY_FORCE / (1 + BY_FORCE) * self._scale * force ** (1 + BY_FORCE) + 0.5 * self.compliance * force**2


@dataclass(frozen=True)
class Pose:
    """Where the bodies stand, counted from the nominal mesh.

    Attributes
    ----------
    shift : of the disk's centre from its eccentric, complex [mm].
    disk, output : rotations [rad].
    between : rotation of a body between them [rad].
    """

    shift: complex
    disk: float
    between: float
    output: float


class Output(Protocol):
    """An output mechanism."""

    @property
    def contact(self) -> LineContact:
        """Of every roller or pin."""
        ...

    def approaches(self, pose: Pose, eccentric: complex, rotation: float) -> tuple[Real, Real]:
        """Approaches (n,) [mm] and slopes (n, 5) by shift x, shift y, disk, between, output [1], [mm/rad].

        ``eccentric`` is the disk's actual centre without shift [mm], ``rotation`` that of disk and output nominally.
        """
        ...


@dataclass(frozen=True)
class CrossedSlides:
    """A plate that only rotates, between two crossed slides: the disk's and the output's.

    Attributes
    ----------
    direction : of the disk's slide at crank angle 0 [rad].
    reach : (n_stations,) distances of the rollers of a row from the axis [mm].
    gap : (8 n_stations,) [mm]: slide by slide, face by face, end by end, station by station.
    """

    contact: LineContact
    direction: float
    reach: Real
    gap: Real

    def approaches(self, pose: Pose, eccentric: complex, rotation: float) -> tuple[Real, Real]:
        """Every roller is pressed as its face nears: by the disk's shift across its slide, and by relative rotation."""
        normal = 1j * np.exp(1j * (self.direction + rotation))
        parts, slopes = [], []
        for slide, rotation_between in enumerate((pose.disk - pose.between, pose.between - pose.output)):
            for face in (1, -1):
                for end in (1, -1):
                    arm = face * end * self.reach
                    slope = np.zeros((len(arm), 5))
                    translation = 0.0
                    if slide == 0:
                        translation = face * (normal.real * pose.shift.real + normal.imag * pose.shift.imag)
                        slope[:, 0], slope[:, 1] = face * normal.real, face * normal.imag
                    slope[:, 2 + slide], slope[:, 3 + slide] = arm, -arm
                    parts.append(translation + arm * rotation_between)
                    slopes.append(slope)
        return np.concatenate(parts) - self.gap, np.concatenate(slopes)


@dataclass(frozen=True)
class PinsInHoles:
    """Output pins about the housing's axis in holes of the disk.

    Attributes
    ----------
    angle : (n,) of the pins about the axis, and of the holes about the disk's centre, at crank angle 0 [rad].
    circle_radius : of both [mm].
    room : (n,) radius of each hole less that of its pin [mm].
    """

    contact: LineContact
    angle: Real
    circle_radius: float
    room: Real

    def approaches(self, pose: Pose, eccentric: complex, rotation: float) -> tuple[Real, Real]:
        """A pin touches once its axis lies farther from that of its hole than there is room."""
        holes = self.circle_radius * np.exp(1j * (self.angle + rotation + pose.disk))
        pins = self.circle_radius * np.exp(1j * (self.angle + rotation + pose.output))
        separation = eccentric + pose.shift + holes - pins
        normal = separation / np.abs(separation)
        slope = np.zeros((len(separation), 5))
        slope[:, 0], slope[:, 1] = normal.real, normal.imag
        slope[:, 2] = np.real(np.conj(normal) * 1j * holes)
        slope[:, 4] = -np.real(np.conj(normal) * 1j * pins)
        return np.abs(separation) - self.room, slope

"""Pins against the flank of a rigid disk at any pose: distance and slope, by the nearest point of the pins' locus.

The flank is the parallel, at a pin's radius, of the curve that a pin's centre draws in the disk. So the gap between a
pin and the flank is the distance of the pin's actual centre from that curve, less what the pin is too thick.

Source: Litvin and Fuentes, Gear Geometry and Applied Theory (2004), ch. 13: the flank as an envelope.

Line contacts of steel cylinders after Palmgren, with a linear spring behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Complex, Real

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

    def lobe_at(self, parameter: Real) -> NDArray[np.intp]:
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
        return np.array(feet)[np.argmin(distances, axis=0), np.arange(len(point))]

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
        return self.interfaces * APPROACH_MM / self.length**BY_LENGTH

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

"""An RV reducer of rigid bodies at one place of its output: its pose under a torque is that of least energy.

Cranks stand on a carrier, each with one eccentric for every disk; a planet on each crank meshes with the sun, which is
held where the input stands. Poses are finite, positions are complex numbers in the housing's frame, and no part of the
product's carrier is used. Unknown are the shift and rotation of each disk, the rotation of each crank and that of the
carrier, all as lengths; Newton's method on the energy, damped after Levenberg.

Source: planet train with the carrier as output, Willis's equation; Litvin and Fuentes, Gear Geometry (2004), ch. 23.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Complex, Real
from tests.validation.blind.rigid_drive.drive import Bearing, NoBalanceError, State, balanced_pose
from tests.validation.blind.rigid_drive.flank import Flank, LineContact

ROUGHLY = 1e-4
"""Unbalanced force over that of the torque that is good enough where rounding of the energy lets no step be taken."""


@dataclass(frozen=True)
class Gears:
    """Sun and planets.

    Attributes
    ----------
    sun_teeth, planet_teeth : numbers.
    circle_radius : of the cranks about the axis [mm].
    backlash : way of a planet from flank to flank [mm].
    stiffness : of one mesh [N/mm].
    runout, runout_phase : (n_cranks,) wave of each mesh over the planet's turn against the carrier [mm], [rad].
    sun_runout : the same over the sun's turn against the carrier [mm].
    """

    sun_teeth: int
    planet_teeth: int
    circle_radius: float
    backlash: float
    stiffness: float
    runout: Real
    runout_phase: Real
    sun_runout: float = 0.0

    @property
    def planet_radius(self) -> float:
        """Radius of a planet's pitch circle [mm]."""
        return self.circle_radius * self.planet_teeth / (self.sun_teeth + self.planet_teeth)


@dataclass(frozen=True)
class CarrierDrive:
    """An RV reducer.

    Attributes
    ----------
    flanks : of each disk.
    pins : (n_pins,) actual centres about the housing's axis, complex [mm]; clockwise from angle 0.
    pin_growth : (n_pins,) [mm] by which each pin is thicker than what generates the flanks.
    pin_contact : of every pin.
    cranks : (n_cranks,) actual places in the carrier's frame, complex [mm].
    holes : (n_disks, n_cranks) actual places in each disk's frame, complex [mm].
    thrown : (n_disks, n_cranks) eccentric of each disk on each crank, in the crank's frame, complex [mm].
    bearings : of each crank, in every disk.
    """

    flanks: Sequence[Flank]
    pins: Complex
    pin_growth: Real
    pin_contact: LineContact
    cranks: Complex
    holes: Complex
    thrown: Complex
    bearings: Sequence[Bearing]
    gears: Gears

    @property
    def ratio(self) -> float:
        """Turns of the sun per turn of the carrier, by Willis's equation with cranks that turn -Z times."""
        return 1 + self.gears.planet_teeth * len(self.pins) / self.gears.sun_teeth

    @property
    def _size(self) -> int:
        return 3 * len(self.flanks) + len(self.cranks) + 1

    def _ideal(self, place: float) -> tuple[float, Complex]:
        """Angle of the cranks [rad] and ideal centre of each disk, where the carrier stands at ``place`` [rad]."""
        angle = -self.flanks[0].lobes * place
        thrown = self.flanks[0].eccentricity * np.exp(1j * (angle + self._phases))
        return angle, thrown

    @property
    def _phases(self) -> Real:
        """Phase of the eccentric of each disk [rad]."""
        return 2 * np.pi * np.arange(len(self.flanks)) / len(self.flanks)

    def _state(self, place: float, pose: Real, torque: float, feet: Sequence[Real] | None) -> State:
        """Energy and forces of a pose (n,) [mm] at a place of the ideal output [rad] under a torque on it [N mm]."""
        radius, n_disks = self.flanks[0].circle_radius, len(self.flanks)
        crank_angle, centres = self._ideal(place)
        slope, curvature = np.zeros(self._size), np.zeros((self._size, self._size))
        energy, pressed, found = 0.0, 0.0, []
        output = place + pose[-1] / radius
        turned = crank_angle + pose[3 * n_disks : -1] / radius
        for k, flank in enumerate(self.flanks):
            own = slice(3 * k, 3 * k + 3)
            centre = centres[k] + complex(pose[3 * k], pose[3 * k + 1])
            rotation = place + pose[3 * k + 2] / radius
            frame = np.exp(-1j * (rotation - self._phases[k] / flank.lobes))
            seen = (self.pins - centre) * frame
            if feet is None:
                foot = flank.nearest(seen, flank.nominal_parameters(place - self._phases[k] / flank.lobes))
            else:
                foot = flank.refined(seen, feet[k])
            found.append(foot)
            gap, outwards = flank.gaps(seen, foot)
            rows = np.stack(
                [
                    np.real(np.conj(outwards) * frame),
                    np.real(np.conj(outwards) * 1j * frame),
                    np.real(np.conj(outwards) * 1j * seen) / radius,
                ],
                axis=1,
            )
            force = self.pin_contact.force(self.pin_growth - gap)
            energy += float(np.sum(self.pin_contact.energy(force)))
            pressed += float(force.sum())
            slope[own] += force @ rows
            curvature[own, own] += rows.T @ (self.pin_contact.stiffness(force)[:, None] * rows)
            for j, bearing in enumerate(self.bearings):
                held = self.holes[k, j] * np.exp(1j * rotation)
                crank = self.cranks[j] * np.exp(1j * output)
                thrown = self.thrown[k, j] * np.exp(1j * turned[j])
                apart = crank + thrown - centre - held
                columns = np.zeros((2, self._size))
                for column, way in (
                    (3 * k, -1.0),
                    (3 * k + 1, -1j),
                    (3 * k + 2, -1j * held / radius),
                    (3 * n_disks + j, 1j * thrown / radius),
                    (self._size - 1, 1j * crank / radius),
                ):
                    columns[0, column], columns[1, column] = np.real(way), np.imag(way)
                stored, push, stiff = bearing.held(np.array([apart.real, apart.imag]))
                energy += stored
                pressed += float(np.hypot(*push))
                slope += push @ columns
                curvature += columns.T @ stiff @ columns
        for j in range(len(self.cranks)):
            stored, tooth_force, row = self._mesh(j, place, output, turned[j])
            energy += stored
            pressed += abs(tooth_force)
            slope += tooth_force * row
            curvature += self.gears.stiffness * (tooth_force != 0) * np.outer(row, row)
        slope[-1] -= torque / radius
        return State(energy - torque * (output - place), slope, curvature, pressed, tuple(found))

    def _mesh(self, j: int, place: float, output: float, turned: float) -> tuple[float, float, Real]:
        """Energy [N mm], force [N] and way (n,) of the mesh of one planet with the held sun."""
        gears, radius = self.gears, self.flanks[0].circle_radius
        planet, sun = gears.planet_radius, gears.circle_radius - gears.planet_radius
        waves = gears.runout[j] * np.sin(turned - output + gears.runout_phase[j])
        waves += gears.sun_runout * np.sin((self.ratio - 1) * place + 2 * np.pi * j / len(self.cranks))
        way = planet * (turned - output) + sun * (self.ratio * place - output) + waves
        pressed = max(abs(way) - 0.5 * gears.backlash, 0.0) * np.sign(way)
        columns = np.zeros(self._size)
        columns[3 * len(self.flanks) + j] = planet / radius
        columns[-1] = -gears.circle_radius / radius
        return 0.5 * gears.stiffness * float(pressed) ** 2, gears.stiffness * float(pressed), columns

    def balanced(self, place: float, torque: float, start: Real | None = None) -> Real:
        """Pose (n,) [mm] at a place of the ideal output [rad] under a torque [N mm]; its last is the carrier's.

        Raises
        ------
        NoBalanceError
            If the forces do not balance.
        """
        start = np.zeros(self._size) if start is None else start
        radius = self.flanks[0].circle_radius
        return balanced_pose(lambda pose, feet: self._state(place, pose, torque, feet), start, torque, radius, ROUGHLY)

    def error(self, place: float, torques: Sequence[float]) -> Real:
        """Error of the carrier (n_torques,) [rad] at a place of the ideal output [rad] under torques [N mm]."""
        pose, errors = None, []
        for torque in torques:
            try:
                pose = self.balanced(place, torque, pose)
            except NoBalanceError:  # a pin at the end of a lobe, where flanks of two errors meet
                pose = self.balanced(place, torque)
            errors.append(float(pose[-1]) / self.flanks[0].circle_radius)
        return np.array(errors)

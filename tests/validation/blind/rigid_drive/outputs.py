"""What lies between a rigid disk and the output: crossed slides on rollers, or pins in holes of the disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import Real
from tests.validation.blind.rigid_drive.flank import LineContact


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

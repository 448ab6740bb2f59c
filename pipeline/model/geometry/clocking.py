"""How the lobes of several disks stand against their holes, and whether the disks can be one part."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Complex, Index

COINCIDENT = 1e-9
"""Distance of holes or contacts that coincide, over the radius of their circle."""


@dataclass(frozen=True)
class Clocking:
    """One disk against the first one, in whose frame the lobes stand.

    Attributes
    ----------
    hole_rotation : rotation of its holes [rad] from those of the first disk.
    lobes : whole lobes by which the first disk, turned on, has its holes there too; None where no turn does.
    """

    hole_rotation: float
    lobes: int | None

    @property
    def first_part(self) -> bool:
        """Whether the disk is the first one's part."""
        return self.lobes is not None


def clocking(centres: Complex, lobes: int, disk: int, count: int) -> Clocking:
    """How disk number ``disk`` of ``count`` is made, with holes at ``centres`` (n_holes,) of the first one [mm].

    Notes
    -----
    The disks hang on one output, so their holes stand alike as they are mounted, while the lobes of disk k mesh at the
    eccentric that is k/count of a turn ahead, which turns them by k/count of their pitch, clockwise.
    """
    pitch = 2 * np.pi / lobes
    disk_turn = pitch * disk / count
    for lobes_turned in range(lobes):
        places = centres * np.exp(1j * (disk_turn + pitch * lobes_turned))
        distance = np.abs(places[:, None] - centres)
        if np.all(np.min(distance, axis=1, initial=np.inf) <= COINCIDENT * np.max(np.abs(centres), initial=0.0)):
            return Clocking(disk_turn, lobes_turned)
    return Clocking(disk_turn, None)


def same_places(points: Complex, of_first: Complex) -> Index | None:
    """Which of the first disk's contacts stands where each of a disk's does; None where some stand elsewhere.

    Parameters
    ----------
    points, of_first : (n,) of both disks' contacts [mm], each from its disk's centre.
    """
    distance = np.abs(points[:, None] - of_first)
    places = np.argmin(distance, axis=1)
    nearest_distance = distance[np.arange(len(points)), places]
    return places if np.all(nearest_distance <= COINCIDENT * np.max(np.abs(points))) else None

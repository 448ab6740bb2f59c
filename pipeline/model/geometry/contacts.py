"""The contacts of a reducer as lists: where two bodies touch, their normals and arms; how several disks stand."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Complex, Index, Real
from pipeline.model.geometry.cycloid_profile import PinContacts

PIN, OUTPUT = "pin", "output"
HOUSING = "housing"
DISK = "disk"
"""Name of a disk among the bodies; of several ones their numbers follow it."""
COINCIDENT = 1e-9
"""Distance of holes or contacts that coincide, over the radius of their circle."""


@dataclass(frozen=True)
class DiskPose:
    """Where a disk stands at one crank angle, nominally: what an output mechanism needs to know of it.

    Attributes
    ----------
    body : its name among the bodies.
    crank : direction of its eccentric [rad].
    eccentricity : [mm]
    pins : nominal contacts of every pin with it.
    rotation : of its holes, or of what else carries the output, and of the output [rad].
    number : of the disk, in the sense of the crank.
    """

    body: str
    crank: float
    eccentricity: float
    pins: PinContacts
    rotation: float
    number: int = 0

    @property
    def eccentric(self) -> complex:
        """Its centre from the housing axis, complex [mm]."""
        return complex(self.eccentricity * np.exp(1j * self.crank))

    def part(self, name: str) -> str:
        """Name of a body that belongs to this disk alone: the first disk's is ``name`` itself."""
        return name + self.body.removeprefix(DISK)


@dataclass(frozen=True)
class Contacts:
    """Every contact of a reducer, pins first; arrays (n_contacts,).

    Attributes
    ----------
    kind : ``"pin"`` or ``"output"``.
    body_a, body_b : the bodies; the normal points from a into b.
    interface, face, end, station : place of an output contact; -1 for pins. An output pin in its hole has interface,
        face and end 0, and its own number as station.
    hole : number of the disk's hole on whose wall it lies, -1 elsewhere.
    gap : of nominal bodies at the nominal pose [mm].
    two_sided : whether the errors of a diameter open a pair of contacts, on either side of a body that lies loose;
        else half of them opens this one.
    per_eccentricity : growth of the gap with an error of the eccentricity [-]; 0 for pins, whose gaps are exact.
    curvature : of the disk at a pin or in a hole, convex positive, 0 of flats [1/mm].
    point, normal : [mm], [-], complex, housing frame.
    arm : moment of the unit normal force on body b about the axis that it turns about in the model [mm]: of a disk its
        centre, of the sliding plate, whose centre moves by up to the eccentricity, that of the housing.
    """

    kind: np.ndarray
    body_a: np.ndarray
    body_b: np.ndarray
    interface: np.ndarray
    face: np.ndarray
    end: np.ndarray
    station: np.ndarray
    hole: np.ndarray
    label: np.ndarray
    gap: Real
    two_sided: np.ndarray
    per_eccentricity: Real
    curvature: Real
    point: Complex
    normal: Complex
    arm: Real

    def __len__(self) -> int:
        return len(self.arm)

    def some(self, rows: np.ndarray | slice) -> "Contacts":
        """Some of the contacts."""
        return Contacts(*(getattr(self, name)[rows] for name in Contacts.__dataclass_fields__))


def contact_list(bodies: tuple[str, str], labels: Sequence[str], **columns: object) -> Contacts:
    """The contacts between two bodies, as many as they have labels.

    Parameters
    ----------
    columns : of ``Contacts``, (n_contacts,) each; a single value stands for every contact. What is not given is that of
        flat output contacts without a gap or a hole, whose diameters open one contact each; point, normal and arm have
        no such value.
    """
    bare: dict[str, object] = {"kind": OUTPUT, "interface": 0, "face": 0, "end": 0, "hole": -1, "two_sided": False}
    bare |= {"gap": 0.0, "per_eccentricity": 0.0, "curvature": 0.0, "body_a": bodies[0], "body_b": bodies[1]}
    full_columns = {name: np.full(len(labels), value) for name, value in (bare | columns).items()}
    return Contacts(label=np.array(labels, str), **full_columns)


def pin_list(disk: DiskPose) -> Contacts:
    """The nominal contacts of the pins with a disk."""
    pins = disk.pins
    no_place = dict.fromkeys(("interface", "face", "end", "station"), -1)
    shape = {"curvature": pins.flank_curvature, "point": pins.point, "normal": pins.normal, "arm": pins.arm}
    labels = [f"pin {i}" for i in range(len(pins.arm))]
    return contact_list((HOUSING, disk.body), labels, kind=PIN, **no_place, **shape)


def no_contacts() -> Contacts:
    """A list without contacts."""
    return contact_list(("", ""), [], station=0, point=0j, normal=0j, arm=0.0)


def joined_contacts(lists: list[Contacts]) -> Contacts:
    """The contacts of several lists in one, in their order."""
    return Contacts(
        *(np.concatenate([getattr(part, name) for part in lists]) for name in Contacts.__dataclass_fields__)
    )


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

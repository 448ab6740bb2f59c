"""A reducer at one crank angle: rigid bodies, and the contacts through which they push each other.

Everything after this file (clearance, equilibrium, cycle) is generic in the list of contacts; an output mechanism
(``pipeline.config.mechanisms``) is another way to fill it. A contact pushes its second body along the normal and its
first body against it, so its penetration is ``contact_jacobian @ q - gap`` for the small rigid motions q of the bodies.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pipeline.model.geometry.cycloid_profile import (
    Complex,
    CycloidProfile,
    PinContacts,
    Real,
    disk_rotation,
    pin_contacts,
)

PIN, OUTPUT = "pin", "output"
HOUSING = "housing"
DISK = "disk"
"""Name of the disk among the bodies."""


@dataclass(frozen=True)
class Bearing:
    """Input bearing: radial spring between crank and disk centre, F = stiffness (d - clearance)^exponent.

    Attributes
    ----------
    stiffness : [N/mm^exponent]
    exponent : [-], at least 1
    """

    stiffness: float
    exponent: float

    def depth(self, force: Real) -> Real:
        """How far the spring gives way [mm] under a force (...) [N], its clearance not counted."""
        return (force / self.stiffness) ** (1 / self.exponent)


@dataclass(frozen=True)
class DiskPose:
    """Where a disk stands at one crank angle, nominally: what an output mechanism needs to know of it.

    Attributes
    ----------
    body : its name among the bodies.
    eccentricity : [mm]
    eccentric : its centre from the housing axis, complex [mm].
    rotation : of the disk, and of the output [rad].
    """

    body: str
    eccentricity: float
    eccentric: complex
    rotation: float

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
    arm : moment of the unit normal force on body b about that body's centre [mm].
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

    def some(self, rows: np.ndarray) -> "Contacts":
        """Some of the contacts."""
        return Contacts(*(getattr(self, name)[rows] for name in Contacts.__dataclass_fields__))


@dataclass(frozen=True)
class Reducer:
    """Bodies and contacts at one crank angle.

    Attributes
    ----------
    crank : against the housing [rad].
    pins : the nominal pin contacts.
    disks : the disk, where it stands.
    contacts : all contacts, pins first.
    motions : names of the free rigid motions (n_motions,), the disk's translation first.
    contact_jacobian : d penetration / d q (n_contacts, n_motions) [-] for translations, [mm] for rotations.
    flange_ratio : rotation of the flange, the crank held to the housing, per rotation of the output: 1 where the flange
        is the output.
    rolling : rotation of the disk about the pitch point, on the pins, per rotation of the output.
    """

    crank: float
    pins: PinContacts
    disks: tuple[DiskPose, ...]
    contacts: Contacts
    motions: tuple[str, ...]
    contact_jacobian: Real
    flange_ratio: float = 1.0
    rolling: float = 0.0

    @property
    def n_pins(self) -> int:
        return len(self.pins.arm)

    @property
    def disk_motions(self) -> np.ndarray:
        """Columns (n_disks, 2) of the disks' translations: the input bearings carry what pushes along them."""
        along = [k for k, motion in enumerate(self.motions) if motion.startswith("disk") and motion.endswith("_x")]
        return np.array(along)[:, None] + np.arange(2)

    @property
    def output_motion(self) -> int:
        """Index of the rotation of the output, flange or housing, among the motions: its torque is the load."""
        return self.motions.index("output_phi")


class OutputContacts(Protocol):
    """An output mechanism as the reducer sees it: contacts and motions between a disk and the output."""

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The contacts, nominal."""

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """Names of the free rigid motions of the bodies after the disk, ``output_phi`` among them."""


def _pin_list(pins: PinContacts) -> Contacts:
    n = len(pins.arm)
    nowhere = np.full(n, -1)
    return Contacts(
        kind=np.full(n, PIN),
        body_a=np.full(n, HOUSING),
        body_b=np.full(n, "disk"),
        interface=nowhere,
        face=nowhere,
        end=nowhere,
        station=nowhere,
        hole=nowhere,
        label=np.array([f"pin {i}" for i in range(n)]),
        gap=np.zeros(n),
        two_sided=np.zeros(n, bool),
        per_eccentricity=np.zeros(n),
        curvature=pins.flank_curvature,
        point=pins.point,
        normal=pins.normal,
        arm=pins.arm,
    )


def joined(lists: list[Contacts]) -> Contacts:
    """The contacts of several lists in one, in their order."""
    return Contacts(
        *(np.concatenate([getattr(part, name) for part in lists]) for name in Contacts.__dataclass_fields__)
    )


def _contact_jacobian(contacts: Contacts, motions: tuple[str, ...]) -> Real:
    """Penetration per unit motion: body b moving along the normal opens the contact, body a closes it."""
    jacobian = np.zeros((len(contacts), len(motions)))
    for sign, bodies in ((1.0, contacts.body_a), (-1.0, contacts.body_b)):
        for column, motion in enumerate(motions):
            body, component = motion.rsplit("_", 1)
            along = {"x": contacts.normal.real, "y": contacts.normal.imag, "phi": contacts.arm}[component]
            jacobian[:, column] += np.where(bodies == body, sign * along, 0.0)
    return jacobian


def with_fixed_flange(reducer: Reducer, lobes: int) -> Reducer:
    """The reducer whose housing is the output, while its flange and the crank are held.

    Notes
    -----
    Seen from the housing, which turns by psi, the flange and the crank turn by -psi together. The crank's part alone
    rolls the disk about the pitch point by psi/Z: pins and flank keep their distance, the disk has turned by psi/Z and
    takes the flange along, which thus has -psi - psi/Z = -psi N/Z left to turn as if the crank were held. So the forces
    are those of the reducer with a fixed housing, whose flange turns -N/Z times as far as the housing here under -Z/N
    times the torque on it. The motions of the disk are counted from where it has rolled to.
    """
    ratio = -(lobes + 1) / lobes
    jacobian = reducer.contact_jacobian.copy()
    jacobian[:, reducer.output_motion] *= ratio
    return replace(reducer, contact_jacobian=jacobian, flange_ratio=ratio, rolling=1 / lobes)


def nominal_reducer(profile: CycloidProfile, output: OutputContacts, crank: float, fixed: str = HOUSING) -> Reducer:
    """Housing, disk and output at the crank angle ``crank`` [rad] against the housing.

    ``fixed`` is the body that is held, ``"housing"`` or the output's ``"flange"``.
    """
    pins = pin_contacts(profile, crank)
    rotation, eccentric = disk_rotation(profile, crank), profile.eccentricity * np.exp(1j * crank)
    disk = DiskPose(DISK, profile.eccentricity, eccentric, rotation)
    contacts = joined([_pin_list(pins), output.contacts_of(disk)])
    motions = (f"{DISK}_x", f"{DISK}_y", f"{DISK}_phi", *output.motions_of(disk))
    reducer = Reducer(crank, pins, (disk,), contacts, motions, _contact_jacobian(contacts, motions))
    return reducer if fixed == HOUSING else with_fixed_flange(reducer, profile.lobes)

"""A reducer at one crank angle: rigid bodies, and the contacts through which they push each other.

Everything after this file (clearance, equilibrium, cycle) is generic in the list of contacts; an output mechanism
(``pipeline.config.mechanisms``) is another way to fill it. A contact pushes its second body along the normal and its
first body against it, so its penetration is ``contact_jacobian @ q - gap`` for the small rigid motions q of the bodies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from pipeline.arrays import Complex, Index, Real
from pipeline.model.geometry.contacts import DISK, HOUSING, Contacts, DiskPose, joined_contacts, pin_list
from pipeline.model.geometry.cycloid_profile import (
    KEPT_ANGLES,
    CycloidProfile,
    PinContacts,
    disk_rotation,
    pin_contacts,
)


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
class Reducer:
    """Bodies and contacts at one crank angle.

    Attributes
    ----------
    crank : against the housing [rad].
    disks : where each disk stands, (n_disks,).
    contacts : the pins of one disk after the other, then the output contacts of one after the other, then those behind
        all disks.
    motions : names of the free rigid motions (n_motions,), the translation of each disk first.
    contact_jacobian : d penetration / d q (n_contacts, n_motions) [-] for translations, [mm] for rotations.
    is_centred : whether input bearings hold the disks' centres.
    flange_ratio : rotation of the flange, the crank held to the housing, per rotation of the output: 1 where the flange
        is the output.
    rolling : rotation of the disk about the pitch point, on the pins, per rotation of the output.
    n_behind : number of the last contacts, which lie behind all disks and touch none.
    displacements : complex (n_contacts, n_elements) by toleranced dimension: an element that is displaced by v, complex
        in a frame of its own, opens a contact by the real part of the complex conjugate of its entry times v.
    """

    crank: float
    disks: tuple[DiskPose, ...]
    contacts: Contacts
    motions: tuple[str, ...]
    contact_jacobian: Real
    is_centred: bool = True
    flange_ratio: float = 1.0
    rolling: float = 0.0
    n_behind: int = 0
    displacements: Mapping[str, Complex] = field(default_factory=dict)

    @cached_property
    def output_rows(self) -> list[Index]:
        """Numbers (n,) of the contacts between each disk and the output, disk after disk."""
        return np.split(np.arange(self.n_pins, len(self.contacts) - self.n_behind), self.n_disks)

    @cached_property
    def output_contacts(self) -> list[Contacts]:
        """Contacts between each disk and the output, disk after disk."""
        return [self.contacts.some(rows) for rows in self.output_rows]

    @cached_property
    def pins(self) -> PinContacts:
        """The nominal pin contacts, disk after disk."""
        names = PinContacts.__dataclass_fields__
        return PinContacts(*(np.concatenate([getattr(disk.pins, name) for disk in self.disks]) for name in names))

    @cached_property
    def disk_of_contact(self) -> Index:
        """Number of the disk that each contact touches (n_contacts,), -1 if none."""
        number = np.full(len(self.contacts), -1)
        for disk, pose in enumerate(self.disks):
            number[(self.contacts.body_a == pose.body) | (self.contacts.body_b == pose.body)] = disk
        return number

    @property
    def n_disks(self) -> int:
        """Number of disks, and of input bearings."""
        return len(self.disks)

    @property
    def n_pins(self) -> int:
        """Number of pin contacts: every pin touches every disk."""
        return len(self.pins.arm)

    @cached_property
    def bearings(self) -> Index:
        """Disk and number within it (n_bearings, 2) of every bearing that stands on an eccentric, disk after disk.

        A disk has one input bearing, or where the output mechanism carries it one in each hole.
        """
        of_a_disk = 1 if self.is_centred else int(self.contacts.hole.max()) + 1
        return np.stack(np.divmod(np.arange(self.n_disks * of_a_disk), of_a_disk), axis=1)

    @property
    def disk_motions(self) -> np.ndarray:
        """Columns (n_disks, 2) of the disks' translations: the input bearings carry what pushes along them."""
        translations = [
            k for k, motion in enumerate(self.motions) if motion.startswith("disk") and motion.endswith("_x")
        ]
        return np.array(translations)[:, None] + np.arange(2)

    @property
    def planar(self) -> Real:
        """Columns of ``contact_jacobian`` of the disks' translations, (n_contacts, 2 n_disks)."""
        return self.contact_jacobian[:, : 2 * self.n_disks]

    @property
    def output_motion(self) -> int:
        """Index of the rotation of the output, flange or housing, among the motions: its torque is the load.

        The first disk's, where the disk is the output.
        """
        return self.motions.index("output_phi" if "output_phi" in self.motions else f"{DISK}_phi")

    def thrust(self, force: Real) -> Real:
        """Force (..., n_disks) [N] on the input bearing of each disk under contact forces (..., n_contacts) [N]."""
        resultant = force @ self.planar
        thrust: Real = np.linalg.norm(resultant.reshape(*resultant.shape[:-1], self.n_disks, 2), axis=-1)
        return thrust


class OutputContacts(Protocol):
    """An output mechanism as the reducer sees it: contacts and motions between a disk and the output."""

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The contacts, nominal."""

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """Names of the free rigid motions after the disk's: ``output_phi``, unless the disk is the output."""

    def contacts_behind(self, disk: DiskPose) -> Contacts:
        """The contacts behind all disks, nominal; ``disk`` is the first one."""

    def couplings_of(self, disk: DiskPose, contacts: Contacts) -> Mapping[str, Real]:
        """What further motions close of some ``contacts`` of these (n_contacts,), by the motions' names."""

    def displacements(self, disks: Sequence[DiskPose], contacts: Contacts) -> Mapping[str, Complex]:
        """How its displaced elements open all contacts (n_contacts, n_elements), see ``Reducer.displacements``."""

    @property
    def carries_disks(self) -> bool:
        """Whether it holds the disks' centres, in place of an input bearing."""


def of_each_disk(values: Real, count: int) -> Real:
    """Values (n, count) of each disk, from those or from values (n,) of all disks alike."""
    return values if values.ndim == 2 else np.repeat(values[:, None], count, axis=1)


def _contact_jacobian(contacts: Contacts, motions: tuple[str, ...]) -> Real:
    """Penetration per unit motion: body b moving along the normal opens the contact, body a closes it."""
    parts = {"x": contacts.normal.real, "y": contacts.normal.imag, "phi": contacts.arm}
    jacobian, closing = np.zeros((len(contacts), len(motions))), dict[str, Real]()
    for column, motion in enumerate(motions):
        body, component = motion.rsplit("_", 1)
        if component in parts:  # else of no body in the list: ``couplings_of`` has it
            if body not in closing:
                closing[body] = (contacts.body_a == body) * 1.0 - (contacts.body_b == body)
            jacobian[:, column] = closing[body] * parts[component]
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


def disk_poses(profile: CycloidProfile, crank: float, count: int) -> tuple[DiskPose, ...]:
    """Disks whose eccentrics stand evenly over the turn, the first one's at the crank angle ``crank`` [rad].

    Notes
    -----
    Holes stand alike in all disks as they are mounted, while the lobes of disk k are turned by k/count of a lobe's
    pitch, clockwise, to mesh at its own eccentric.
    """
    rotation, angles = disk_rotation(profile, crank), [crank + 2 * np.pi * disk / count for disk in range(count)]
    names = [DISK] if count == 1 else [f"{DISK} {disk}" for disk in range(count)]
    return tuple(
        DiskPose(name, angle, profile.eccentricity, pin_contacts(profile, angle), rotation, number)
        for number, (name, angle) in enumerate(zip(names, angles, strict=True))
    )


@lru_cache(maxsize=KEPT_ANGLES)
def _on_pins(profile: CycloidProfile, crank: float, count: int) -> tuple[tuple[DiskPose, ...], tuple[Contacts, ...]]:
    """``disk_poses`` and the contacts of the pins with each disk; kept, since many reducers differ in their output."""
    poses = disk_poses(profile, crank, count)
    return poses, tuple(_with_disk_labels(pin_list(pose), pose) for pose in poses)


def _with_disk_labels(contacts: Contacts, disk: DiskPose) -> Contacts:
    """The contacts of a disk, its name in their labels where it is one of several."""
    if disk.body == DISK:
        return contacts
    return replace(contacts, label=_labels_of_disk(tuple(contacts.label.tolist()), disk.body))


@lru_cache
def _labels_of_disk(labels: tuple[str, ...], disk: str) -> np.ndarray:
    return np.array([f"{label}, {disk}" for label in labels])


def nominal_reducer(
    profile: CycloidProfile, output: OutputContacts, crank: float, fixed_part: str = HOUSING, disks: int = 1
) -> Reducer:
    """Housing, ``disks`` disks and output at the crank angle ``crank`` [rad] against the housing.

    ``fixed_part`` is the body that is held, ``"housing"`` or the output's ``"flange"``.
    """
    poses, on_pins = _on_pins(profile, crank, disks)
    behind_disks = output.contacts_behind(poses[0])
    contacts = joined_contacts(
        [*on_pins, *(_with_disk_labels(output.contacts_of(pose), pose) for pose in poses), behind_disks]
    )
    output_motions = dict.fromkeys(motion for pose in poses for motion in output.motions_of(pose))
    planar = [f"{pose.body}_{axis}" for pose in poses for axis in "xy"]
    motions = (*planar, *(f"{pose.body}_phi" for pose in poses), *output_motions)
    jacobian = _contact_jacobian(contacts, motions)
    reducer = Reducer(
        crank,
        poses,
        contacts,
        motions,
        jacobian,
        is_centred=not output.carries_disks,
        n_behind=len(behind_disks),
        displacements=output.displacements(poses, contacts),
    )
    rows_behind = np.arange(len(contacts) - len(behind_disks), len(contacts))
    for pose, rows in zip((*poses, poses[0]), (*reducer.output_rows, rows_behind), strict=True):
        for motion, coupling in output.couplings_of(pose, contacts.some(rows)).items():
            jacobian[rows, motions.index(motion)] += coupling
    return reducer if fixed_part == HOUSING else with_fixed_flange(reducer, profile.lobes)

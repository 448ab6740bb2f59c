"""A reducer at one crank angle: rigid bodies, and the contacts through which they push each other.

Everything after this file (clearance, equilibrium, cycle) is generic in the list of contacts; an output
mechanism is another way to fill it. A contact pushes its second body along the normal and its first body
against it, so its penetration is ``closing @ q - gap`` for the small rigid motions q of the bodies.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.model.profile import Complex, CycloidProfile, PinContacts, Real, disk_rotation, pin_contacts

PIN, OUTPUT = "pin", "output"


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


@dataclass(frozen=True)
class RollerPlate:
    """Output by a sliding plate between two crossed slides, each a tongue in a slot (paper, Fig. 2).

    The disk's tongue slides in the plate along s1, the plate's tongue in the output along s2, which is s1
    turned by 90 degrees. A row of rollers lies along each of the two faces of a tongue.

    Attributes
    ----------
    stations : distances of the rollers from the axis along the slide (n_stations,) [mm], outermost first.
    face_offset : distance h of the faces from the axis [mm].
    slide_angle : direction of s1 at crank angle 0 [rad].
    floats : whether the plate may translate; else it only rotates, as in the paper.
    """

    stations: tuple[float, ...]
    face_offset: float
    slide_angle: float
    floats: bool


@dataclass(frozen=True)
class Contacts:
    """Every contact of a reducer, pins first; arrays (n_contacts,).

    Attributes
    ----------
    kind : ``"pin"`` or ``"output"``.
    body_a, body_b : the bodies; the normal points from a into b.
    interface, face, end, station : place of an output contact; -1 for pins.
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
    label: np.ndarray
    point: Complex
    normal: Complex
    arm: Real

    def __len__(self) -> int:
        return len(self.arm)


@dataclass(frozen=True)
class Reducer:
    """Bodies and contacts at one crank angle.

    Attributes
    ----------
    crank : [rad]
    pins : the nominal pin contacts.
    contacts : all contacts, pins first.
    motions : names of the free rigid motions (n_motions,), the disk's translation first.
    closing : d penetration / d q (n_contacts, n_motions) [-] for translations, [mm] for rotations.
    """

    crank: float
    pins: PinContacts
    contacts: Contacts
    motions: tuple[str, ...]
    closing: Real

    @property
    def n_pins(self) -> int:
        return len(self.pins.arm)

    @property
    def output_motion(self) -> int:
        """Index of the output's rotation among the motions: its torque is the load."""
        return self.motions.index("output_phi")


def _pin_list(pins: PinContacts) -> Contacts:
    n = len(pins.arm)
    nowhere = np.full(n, -1)
    return Contacts(
        kind=np.full(n, PIN),
        body_a=np.full(n, "housing"),
        body_b=np.full(n, "disk"),
        interface=nowhere,
        face=nowhere,
        end=nowhere,
        station=nowhere,
        label=np.array([f"pin {i}" for i in range(n)]),
        point=pins.point,
        normal=pins.normal,
        arm=pins.arm,
    )


def _slide(
    interface: int, bodies: tuple[str, str], stations: np.ndarray, direction: complex, centre: complex, offset: float
) -> Contacts:
    """Rollers of one tongue in its slot: faces 0 and 1 at +-h, ends 0 and 1 at +-x, stations from outside."""
    face, end, station = (grid.ravel() for grid in np.meshgrid([0, 1], [0, 1], np.arange(len(stations)), indexing="ij"))
    side, reach = 1 - 2 * face, (1 - 2 * end) * stations[station]
    across: Complex = 1j * direction * side
    name, places = f"{bodies[0]}-{bodies[1]}", list(zip(face, end, station, strict=True))
    n = len(side)
    return Contacts(
        kind=np.full(n, OUTPUT),
        body_a=np.full(n, bodies[0]),
        body_b=np.full(n, bodies[1]),
        interface=np.full(n, interface),
        face=face,
        end=end,
        station=station,
        label=np.array([f"{name} face {'+-'[f]} end {'+-'[e]} roller {s}" for f, e, s in places]),
        point=centre + reach * direction + offset * across,
        normal=across,
        arm=(side * reach).astype(float),
    )


def _joined(lists: list[Contacts]) -> Contacts:
    return Contacts(*(np.concatenate([getattr(one, name) for one in lists]) for name in Contacts.__dataclass_fields__))


def _closing(contacts: Contacts, motions: tuple[str, ...]) -> Real:
    """Penetration per unit motion: body b moving along the normal opens the contact, body a closes it."""
    closing = np.zeros((len(contacts), len(motions)))
    for sign, bodies in ((1.0, contacts.body_a), (-1.0, contacts.body_b)):
        for column, motion in enumerate(motions):
            body, component = motion.rsplit("_", 1)
            along = {"x": contacts.normal.real, "y": contacts.normal.imag, "phi": contacts.arm}[component]
            closing[:, column] += np.where(bodies == body, sign * along, 0.0)
    return closing


def roller_plate_reducer(profile: CycloidProfile, mechanism: RollerPlate, crank: float) -> Reducer:
    """The paper's reducer: pins, disk, sliding plate and output at the crank angle ``crank`` [rad].

    Notes
    -----
    The arm of a roller is its distance along the slide for both bodies: the rollers lie half-way between
    bodies whose centres differ by at most the eccentricity, an effect that the two ends cancel.
    """
    pins = pin_contacts(profile, crank)
    s1 = np.exp(1j * (mechanism.slide_angle + disk_rotation(profile, crank)))
    stations = np.array(mechanism.stations)
    disk_centre = profile.eccentricity * np.exp(1j * crank)
    contacts = _joined(
        [
            _pin_list(pins),
            _slide(0, ("disk", "plate"), stations, s1, disk_centre, mechanism.face_offset),
            _slide(1, ("plate", "output"), stations, 1j * s1, 0j, mechanism.face_offset),
        ]
    )
    motions: tuple[str, ...] = ("disk_x", "disk_y", "disk_phi", "plate_phi", "output_phi")
    if mechanism.floats:
        motions += ("plate_x", "plate_y")
    return Reducer(crank, pins, contacts, motions, _closing(contacts, motions))

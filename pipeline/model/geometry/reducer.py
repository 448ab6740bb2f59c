"""A reducer at one crank angle: rigid bodies, and the contacts through which they push each other.

Everything after this file (clearance, equilibrium, cycle) is generic in the list of contacts; an output
mechanism is another way to fill it. A contact pushes its second body along the normal and its first body
against it, so its penetration is ``closing @ q - gap`` for the small rigid motions q of the bodies.
"""

from dataclasses import dataclass

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
class PinInHole:
    """Output by pins of the output flange that reach into holes of the disk.

    Attributes
    ----------
    pins : number of output pins, and of holes.
    circle_radius : radius of the circle of the pins about the housing axis, and of the holes about the disk's
        centre [mm].
    pin_radius, hole_radius : [mm]; the hole is larger by the eccentricity and the clearance.
    phase : direction of pin 0 at crank angle 0 [rad]; pins are counted clockwise from it.
    """

    pins: int
    circle_radius: float
    pin_radius: float
    hole_radius: float
    phase: float

    def centres(self) -> Complex:
        """Centres of the holes in the disk's frame, and of the pins in the output's (n_pins,) complex [mm]."""
        return self.circle_radius * np.exp(1j * (self.phase - 2 * np.pi * np.arange(self.pins) / self.pins))


@dataclass(frozen=True)
class Contacts:
    """Every contact of a reducer, pins first; arrays (n_contacts,).

    Attributes
    ----------
    kind : ``"pin"`` or ``"output"``.
    body_a, body_b : the bodies; the normal points from a into b.
    interface, face, end, station : place of an output contact; -1 for pins. An output pin in its hole has interface,
        face and end 0, and its own number as station.
    gap : of nominal bodies at the nominal pose [mm].
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
    label: np.ndarray
    gap: Real
    curvature: Real
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
        gap=np.zeros(n),
        curvature=pins.flank_curvature,
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
        gap=np.zeros(n),
        curvature=np.zeros(n),
        point=centre + reach * direction + offset * across,
        normal=across,
        arm=(side * reach).astype(float),
    )


def _pins_in_holes(mechanism: PinInHole, eccentric: complex, turn: complex) -> Contacts:
    """Output pins in the disk's holes; ``eccentric`` is C - O, ``turn`` the rotation of disk and output.

    Every hole stands off its pin by C - O, so every pin touches its hole's wall on the side away from C, and the wall
    pushes it along C - O.
    """
    n, along = mechanism.pins, eccentric / abs(eccentric)
    centre = mechanism.centres() * turn
    place = np.zeros(n, int)
    return Contacts(
        kind=np.full(n, OUTPUT),
        body_a=np.full(n, "disk"),
        body_b=np.full(n, "output"),
        interface=place,
        face=place,
        end=place,
        station=np.arange(n),
        label=np.array([f"output pin {k}" for k in range(n)]),
        gap=np.full(n, mechanism.hole_radius - mechanism.pin_radius - abs(eccentric)),
        curvature=np.full(n, -1 / mechanism.hole_radius),
        point=eccentric + centre - mechanism.hole_radius * along,
        normal=np.full(n, along),
        arm=np.imag(np.conj(centre) * along),
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


def pin_in_hole_reducer(profile: CycloidProfile, mechanism: PinInHole, crank: float) -> Reducer:
    """A reducer whose output pins reach into holes of the disk, at the crank angle ``crank`` [rad].

    Notes
    -----
    All output contacts have one normal, the direction of the eccentric, so disk and output differ by e along it and
    the arm R_o sin(crank - angle of the pin) is the same about both centres. The pins ahead of the eccentric carry one
    sense of torque, those behind it the other. A shift d of the disk across the normal turns it and closes the gap by
    d^2/(2 e), which is left out.
    """
    pins = pin_contacts(profile, crank)
    turn = np.exp(1j * disk_rotation(profile, crank))
    eccentric = profile.eccentricity * np.exp(1j * crank)
    contacts = _joined([_pin_list(pins), _pins_in_holes(mechanism, eccentric, turn)])
    motions = ("disk_x", "disk_y", "disk_phi", "output_phi")
    return Reducer(crank, pins, contacts, motions, _closing(contacts, motions))

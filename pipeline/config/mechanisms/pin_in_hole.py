"""Output by pins of the output flange that reach into holes of the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import pi, sin
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.config.mechanisms.drawing import Circles, Panel, Points
from pipeline.config.mechanisms.mechanism import Holes, LawInputs, OutputMechanism, Words
from pipeline.config.section import Clearance, Millimetres, Problem
from pipeline.model.contact.laws import ContactLaws, LineContact
from pipeline.model.geometry.cycloid_profile import Complex, Index
from pipeline.model.geometry.reducer import OUTPUT, Contacts, DiskPose

if TYPE_CHECKING:
    from pipeline.config.cycloid import Cycloid
    from pipeline.config.design import Disk


class PinInHole(OutputMechanism):
    """Output pins, held in the output flange, in round holes of the disk.

    Pins (about the housing axis) and holes (about the disk's centre) stand on circles of one radius; a hole's radius is
    that of the pin, plus the eccentricity, plus `hole_clearance_um`. Pins are counted clockwise from `phase_deg`, the
    direction of pin 0 at crank angle 0. A pin is as long as the disk is thick; what it bends in the flange is left out.
    """

    words = Words(
        contact="output pin",
        station="output pin",
        drawing="Output pins are counted clockwise from the first; in brackets stand the numbers of their contacts in "
        "the tables. Dots: where a hole's wall faces its output pin.",
        loads="the output pins on one side of the eccentric carry one sense of torque; the longer its arm, the sooner "
        "a pin closes.",
    )
    diameter_readings = {"half_diameter": "half of an output pin's diameter error at its one contact"}
    material_keys = ("pin_material",)
    interfaces = 1

    mechanism: Literal["pin_in_hole"]
    pins: Annotated[int, Field(ge=3, le=100)]
    pin_radius_mm: Millimetres
    pin_circle_radius_mm: Millimetres
    pin_material: str
    hole_clearance_um: Clearance
    phase_deg: Annotated[float, Field(ge=-360, le=360)]

    @property
    def contacts(self) -> int:
        """Output contacts, one for each output pin."""
        return self.pins

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact, the output pin."""
        return self.pin_radius_mm

    def hole_radius(self, eccentricity: float) -> float:
        """Radius of the disk's holes [mm]."""
        return self.pin_radius_mm + eccentricity + 1e-3 * self.hole_clearance_um

    def centres(self) -> Complex:
        """Centres of the holes in the disk's frame, and of the pins in the output's (n_pins,) complex [mm]."""
        phase = np.radians(self.phase_deg)
        return self.pin_circle_radius_mm * np.exp(1j * (phase - 2 * np.pi * np.arange(self.pins) / self.pins))

    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Problem]:
        """Holes that cut each other, the lobes or the bore."""
        if not cycloid:
            return
        hole, circle = self.hole_radius(cycloid.eccentricity_mm), self.pin_circle_radius_mm
        what = f"a hole's radius is {hole:.4g} mm: pin, eccentricity and clearance"
        pitch = 2 * circle * sin(pi / self.pins)
        if pitch <= 2 * hole:
            yield Problem(
                "output.pin_radius_mm",
                self.pin_radius_mm,
                f"{what}; must be < {pitch / 2:.4g} mm, half the distance between the {self.pins} holes, which overlap "
                "each other; take thinner or fewer output pins, or a larger circle",
            )
        root = cycloid.root_radius_mm
        if circle + hole >= root:
            yield Problem(
                "output.pin_circle_radius_mm",
                circle,
                f"{what}; the holes reach {circle + hole:.4g} mm from the disk's centre, must be < {root:.4g} mm, the "
                "radius at the lobes' roots; move them inwards or take thinner output pins",
            )
        if disk and circle - hole <= disk.bore_radius_mm:
            yield Problem(
                "output.pin_circle_radius_mm",
                circle,
                f"{what}; the holes reach within {circle - hole:.4g} mm of the disk's centre, must be > "
                f"{disk.bore_radius_mm:g} mm, the bore's radius; move them outwards, or take thinner output pins or a "
                "smaller bore",
            )

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """The output's rotation."""
        return ("output_phi",)

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """Output pins in the disk's holes.

        Notes
        -----
        Every hole stands off its pin by the eccentric C - O, so every pin touches its hole's wall on the side away from
        C, and the wall pushes it along C - O. All output contacts have this one normal, so disk and output differ by e
        along it and the arm R_o sin(crank - angle of the pin) is the same about both centres. The pins ahead of the
        eccentric carry one sense of torque, those behind it the other. A shift d of the disk across the normal turns it
        and closes the gap by d^2/(2 e), which is left out. A pin's axis stays where the flange holds it, so half of its
        diameter's error opens its one contact, and a larger eccentricity moves the walls of all holes towards their
        pins.
        """
        n, along = self.pins, disk.eccentric / abs(disk.eccentric)
        hole = self.hole_radius(disk.eccentricity)
        centre = self.centres() * np.exp(1j * disk.rotation)
        zero = np.zeros(n, int)
        return Contacts(
            kind=np.full(n, OUTPUT),
            body_a=np.full(n, disk.body),
            body_b=np.full(n, "output"),
            interface=zero,
            face=zero,
            end=zero,
            station=np.arange(n),
            hole=np.arange(n),
            label=np.array([f"output pin {k}" for k in range(n)]),
            gap=np.full(n, hole - self.pin_radius_mm - abs(disk.eccentric)),
            two_sided=np.zeros(n, bool),
            per_eccentricity=np.full(n, -1.0),
            curvature=np.full(n, -1 / hole),
            point=disk.eccentric + centre - hole * along,
            normal=np.full(n, along),
            arm=np.imag(np.conj(centre) * along),
        )

    def laws(self, inputs: LawInputs) -> ContactLaws:
        """An output pin in a hole of the meshed disk: a line contact of a cylinder with a larger concave one.

        Hertz' half plane holds while the contact is narrow against the pin; the law ends at half of its radius.
        """
        pin, radius = inputs.materials[self.pin_material], self.pin_radius_mm
        relative = 1 / (1 / radius - 1 / self.hole_radius(inputs.eccentricity))
        contact = LineContact(np.full(self.pins, relative), inputs.thickness, pin, inputs.disk)
        return inputs.law.on_mesh(contact, radius, inputs.patch_half_width)

    def holes(self, cycloid: Cycloid) -> Holes:
        """One hole for each output pin."""
        return Holes(self.centres(), self.hole_radius(cycloid.eccentricity_mm))

    def fact(self, cycloid: Cycloid, plain: Callable[[float], str]) -> str:
        """Output pins and holes in words."""
        return (
            f"{self.pins} output pins of radius {plain(self.pin_radius_mm)} mm on a circle of radius "
            f"{plain(self.pin_circle_radius_mm)} mm, in holes of the disk of radius "
            f"{plain(self.hole_radius(cycloid.eccentricity_mm))} mm"
        )

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The disk with its holes and the output pins in them, numbered."""
        hole = self.hole_radius(disk.eccentricity)
        centre = contacts.point + hole * contacts.normal
        texts = tuple(f"{pin}\n({number})" for pin, number in zip(contacts.station, numbers, strict=True))
        shapes = (
            Circles(centre, hole, "disk"),
            Circles(centre - disk.eccentric, self.pin_radius_mm, "output", texts),
            Points(contacts.point),
        )
        return [Panel(f"Output pins 0 to {self.pins - 1} in the disk's holes", shapes, disk=True)]


MECHANISM = PinInHole

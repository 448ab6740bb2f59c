"""Output by pins of the output flange that reach into holes of the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import pi, sin
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.arrays import Complex, Index, Real
from pipeline.config.files.section import Clearance, Millimetres, Mistake, Section
from pipeline.config.mechanisms.mechanism import Circles, Holes, LawInputs, OutputMechanism, Panel, Points, Words
from pipeline.model.contact.laws import ContactLaws, LineContact, Material, in_series, scaled_laws
from pipeline.model.elastic.beam import LONGEST, SHORTEST, pin_flexibility
from pipeline.model.geometry.contacts import Contacts, DiskPose, contact_list

if TYPE_CHECKING:
    from pipeline.config.designs.design import Disk
    from pipeline.config.designs.sections import Cycloid


class Bush(Section):
    """Bush on each output pin, loose by a radial clearance: it rolls on the hole's wall.

    Pin and bush touch where bush and hole do, so the two radial clearances add up along the line of contact, and so do
    the deflections of the two contacts. The wall counts from either side down to its middle; the ring's change of shape
    is left out.
    """

    outer_radius_mm: Millimetres
    clearance_um: Annotated[float, Field(ge=1, le=1000)]
    material: str


class Bending(Section):
    """Bending and shear of the output pins: `cantilever`, or `both_ends` clamped over the span between two flanges.

    The first disk's middle plane lies `plane_mm` from the flange, each further disk's `disk_pitch_mm` farther on, and
    forces act in these planes. The flanges are rigid, and a pin's diameter is its own, without a bush.
    """

    support: Literal["cantilever", "both_ends"]
    plane_mm: Millimetres
    disk_pitch_mm: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    span_mm: Millimetres | None = None

    def problems(self, diameter: float, disks: int) -> Iterator[Mistake]:
        """A span without its support, planes beyond it, disks in one plane, and pins that are no beams."""
        ends = self.support == "both_ends"
        if ends != (self.span_mm is not None):
            requirement = 'must be there with support = "both_ends", and only there: the distance between the flanges'
            yield Mistake("output.bending.span_mm", self.span_mm, requirement)
            return
        last_plane_mm = self.plane_mm + (disks - 1) * self.disk_pitch_mm
        if disks > 1 and self.disk_pitch_mm == 0:
            yield Mistake("output.bending.disk_pitch_mm", 0.0, "must be > 0: the disks lie beside each other")
        if self.span_mm is not None and last_plane_mm >= self.span_mm:
            requirement = f"must be > {last_plane_mm:g} mm, the plane of the last disk"
            yield Mistake("output.bending.span_mm", self.span_mm, requirement)
        key, free_length = ("span_mm", self.span_mm) if self.span_mm is not None else ("plane_mm", self.plane_mm)
        if not SHORTEST * diameter <= free_length <= LONGEST * diameter:
            requirement = (
                f"must be {SHORTEST * diameter:g} to {LONGEST * diameter:g} mm, {SHORTEST:g} to {LONGEST:g} diameters "
                "of the pin: beyond it is no beam of this theory; correct it, or delete [output.bending]"
            )
            yield Mistake(f"output.bending.{key}", free_length, requirement)


class PinInHole(OutputMechanism):
    """Output pins, held in the output flange, in round holes of the disk.

    Pins (about the housing axis) and holes (about the disk's centre) stand on circles of one radius; a hole's radius is
    that of the pin or of its bush, plus the eccentricity, plus `hole_clearance_um`. Pins are counted clockwise from
    `phase_deg`, the direction of pin 0 at crank angle 0. A pin is as long as the disk is thick; without `bending` it is
    rigid.
    """

    words = Words(
        contact="output pin",
        station="output pin",
        drawing="Output pins are counted clockwise from the first; numbers in brackets are those of their contacts "
        "in the tables. Dots: where a hole's wall faces its output pin.",
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
    bush: Bush | None = None
    bending: Bending | None = None

    @property
    def outer_radius_mm(self) -> float:
        """Radius of what touches the hole, a pin or its bush."""
        return self.bush.outer_radius_mm if self.bush else self.pin_radius_mm

    @property
    def loose_um(self) -> float:
        """Radial clearance between a pin and its hole, its bush's included."""
        return self.hole_clearance_um + (self.bush.clearance_um if self.bush else 0.0)

    @property
    def material_names(self) -> Mapping[str, str]:
        """Materials of pins and bushes, by the settings that name them."""
        return {"pin_material": self.pin_material} | ({"bush.material": self.bush.material} if self.bush else {})

    @property
    def contacts(self) -> int:
        """Output contacts, one for each output pin."""
        return self.pins

    @property
    def pins_in_holes(self) -> int:
        """All output pins."""
        return self.pins

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact, the output pin or its bush."""
        return self.outer_radius_mm

    @property
    def seat_radius_mm(self) -> float:
        """Radius of the pin, on which a bush turns."""
        return self.pin_radius_mm

    @property
    def has_bushes(self) -> bool:
        """Whether there are bushes on the pins."""
        return self.bush is not None

    def hole_radius(self, eccentricity: float) -> float:
        """Radius of the disk's holes [mm]."""
        return self.outer_radius_mm + eccentricity + 1e-3 * self.hole_clearance_um

    def centres(self) -> Complex:
        """Centres of the holes in the disk's frame, and of the pins in the output's (n_pins,) complex [mm]."""
        phase = np.radians(self.phase_deg) - 2 * np.pi * np.arange(self.pins) / self.pins
        centres: Complex = self.pin_circle_radius_mm * np.exp(1j * phase)
        return centres

    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Mistake]:
        """Holes that cut each other, the lobes or the bore."""
        bush = self.bush
        if bush and bush.outer_radius_mm <= self.pin_radius_mm + 1e-3 * bush.clearance_um:
            requirement = (
                f"must be > {self.pin_radius_mm + 1e-3 * bush.clearance_um:g} mm, its bore on the pin: no wall is left"
            )
            yield Mistake("output.bush.outer_radius_mm", bush.outer_radius_mm, requirement)
        if self.bending:
            yield from self.bending.problems(2 * self.pin_radius_mm, disk.count if disk else 1)
        if cycloid:
            yield from self._hole_problems(cycloid, disk)

    def _hole_problems(self, cycloid: Cycloid, disk: Disk | None) -> Iterator[Mistake]:
        hole, circle = self.hole_radius(cycloid.eccentricity_mm), self.pin_circle_radius_mm
        size = f"a hole's radius is {hole:.4g} mm: pin, eccentricity and clearance"
        pitch = 2 * circle * sin(pi / self.pins)
        if pitch <= 2 * hole:
            requirement = (
                f"{size}; must be < {pitch / 2:.4g} mm, half the distance between the {self.pins} holes, which overlap "
                "each other; take thinner or fewer output pins, or a larger circle"
            )
            yield Mistake("output.pin_radius_mm", self.pin_radius_mm, requirement)
        root = cycloid.root_radius_mm
        if circle + hole >= root:
            requirement = (
                f"{size}; the holes reach {circle + hole:.4g} mm from the disk's centre, must be < {root:.4g} mm, the "
                "radius at the lobes' roots; move them inwards or take thinner output pins"
            )
            yield Mistake("output.pin_circle_radius_mm", circle, requirement)
        if disk and circle - hole <= disk.bore_radius_mm:
            requirement = (
                f"{size}; the holes reach within {circle - hole:.4g} mm of the disk's centre, must be > "
                f"{disk.bore_radius_mm:g} mm, the bore's radius; move them outwards, or take thinner output pins or a "
                "smaller bore"
            )
            yield Mistake("output.pin_circle_radius_mm", circle, requirement)

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
        n, direction = self.pins, disk.eccentric / abs(disk.eccentric)
        hole = self.hole_radius(disk.eccentricity)
        centre = self.centres() * np.exp(1j * disk.rotation)
        return contact_list(
            (disk.body, "output"),
            [f"output pin {k}" for k in range(n)],
            station=np.arange(n),
            hole=np.arange(n),
            gap=hole - self.outer_radius_mm - abs(disk.eccentric) + 1e-3 * (self.loose_um - self.hole_clearance_um),
            per_eccentricity=-1.0,
            curvature=-1 / hole,
            point=disk.eccentric + centre - hole * direction,
            normal=direction,
            arm=np.imag(np.conj(centre) * direction),
        )

    def laws(self, inputs: LawInputs) -> ContactLaws:
        """An output pin in a hole of the meshed disk: a line contact of a cylinder with a larger concave one.

        Hertz' half plane holds while the contact is narrow against the pin; the law ends at half of its radius.
        """
        hole, radius = self.hole_radius(inputs.eccentricity), self.outer_radius_mm
        material = inputs.materials[self.bush.material if self.bush else self.pin_material]
        relative = 1 / (1 / radius - 1 / hole)
        contact = LineContact(np.full(self.pins, relative), inputs.thickness, material, inputs.disk)
        if not self.bush:
            return inputs.law.on_mesh(contact, radius, inputs.patch_half_width)
        bore = self.pin_radius_mm + 1e-3 * self.bush.clearance_um
        middle = 0.5 * (radius - bore)
        # of the radius r at which a cylinder's ln(4 r/b) - 1/2 is what a flat of the depth d has, ln(2 d/b) - nu/2
        wall = 0.5 * middle * np.exp(0.5 - 0.5 * material.lateral)
        outer = inputs.law.on_mesh(contact, wall, inputs.patch_half_width)
        relative = 1 / (1 / self.pin_radius_mm - 1 / bore)
        hole_contact = LineContact(
            np.full(self.pins, relative), inputs.thickness, inputs.materials[self.pin_material], material
        )
        double_law = inputs.law.between_flats((hole_contact, hole_contact), self.pin_radius_mm, middle)
        return in_series(outer, scaled_laws(double_law, 0.5))

    def compliance(self, contacts: Contacts, disk: Index, materials: Mapping[str, Material]) -> Real | None:
        """Bending of each pin by the forces of all disks on it, along their own normals."""
        if not self.bending:
            return None
        planes = self.bending.plane_mm + self.bending.disk_pitch_mm * np.arange(disk.max() + 1)
        pin = pin_flexibility(planes, 2 * self.pin_radius_mm, materials[self.pin_material], self.bending.span_mm)
        cosine = np.real(np.conj(contacts.normal)[:, None] * contacts.normal)
        return np.where(contacts.station[:, None] == contacts.station, pin[np.ix_(disk, disk)] * cosine, 0.0)

    def holes(self, cycloid: Cycloid) -> Holes:
        """One hole for each output pin."""
        return Holes(self.centres(), self.hole_radius(cycloid.eccentricity_mm))

    def fact(self, cycloid: Cycloid, number_text: Callable[[float], str]) -> str:
        """Output pins and holes in words."""
        bush = f", with loose bushes of outer radius {number_text(self.bush.outer_radius_mm)} mm" if self.bush else ""
        supports = {"cantilever": "cantilevers", "both_ends": "beams clamped at both ends"}
        bending = f"; the pins bend as {supports[self.bending.support]}" if self.bending else ""
        return (
            f"{self.pins} output pins of radius {number_text(self.pin_radius_mm)} mm on a circle of radius "
            f"{number_text(self.pin_circle_radius_mm)} mm{bush}, in holes of the disk of radius "
            f"{number_text(self.hole_radius(cycloid.eccentricity_mm))} mm{bending}"
        )

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The disk with its holes and the output pins in them, numbered."""
        hole = self.hole_radius(disk.eccentricity)
        centre = contacts.point + hole * contacts.normal
        texts = tuple(f"{pin}\n({number})" for pin, number in zip(contacts.station, numbers, strict=True))
        shapes: tuple[Circles | Points, ...] = (
            Circles(centre, hole, "disk"),
            *([Circles(centre - disk.eccentric, self.outer_radius_mm, "between")] if self.bush else []),
            Circles(centre - disk.eccentric, self.pin_radius_mm, "output", texts),
            Points(contacts.point),
        )
        return [Panel(f"Output pins 0 to {self.pins - 1}, {disk.body}", shapes, disk=True)]


MECHANISM = PinInHole

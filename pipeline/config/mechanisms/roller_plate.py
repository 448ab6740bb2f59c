"""Output by a sliding plate between two crossed slides on rollers (paper, Fig. 2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from math import hypot
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.arrays import Complex, Index, Real
from pipeline.config.files.section import Millimetres, Mistake
from pipeline.config.mechanisms.mechanism import Circles, LawInputs, OutputMechanism, Panel, Part, RowLabel, Words
from pipeline.model.contact.laws import ContactLaws, LineContact, concatenated_laws
from pipeline.model.geometry.contacts import Contacts, DiskPose, contact_list, joined_contacts

if TYPE_CHECKING:
    from pipeline.config.designs.design import Disk
    from pipeline.config.designs.sections import Cycloid

PLATE = {"rotates": "only rotates", "floats": "rotates and floats"}
PARTS: tuple[Part, Part] = ("output", "between")
"""How the two interfaces are drawn."""
ROLLERS_BESIDE = 12
"""Roller radii between the outermost roller of a drawing and its edge."""

SPREAD = 0.8
"""Default half width of the stretch over which a roller's force enters the slice, over its radius."""


class RollerPlate(OutputMechanism):
    """Sliding plate between disk and output, on two crossed tongues with rows of rollers along their faces.

    The disk's tongue slides in the plate along s1, the plate's tongue in the output along s2, which is s1 turned by 90
    degrees. Each of the two interfaces has two faces at +-`face_offset_mm` from the axis; on each face a row of rollers
    stands at each end of the slide, at stations equally spaced from `outer_station_mm` to `inner_station_mm`.
    `slide_angle_deg` is the direction of s1 at crank angle 0; a plate that floats may also translate.
    """

    words = Words(
        contact="output roller",
        station="roller, 0 outside",
        drawing="The rollers of each row are counted from outside to inside; beside each row are the numbers of its "
        "contacts in the tables.",
        loads="one sense of torque loads one face at each end of a slide. Solid: end 0, dotted: end 1. The outermost "
        "roller (0) has the longest arm and closes first.",
    )
    diameter_readings = {
        "half_diameter": "half of a roller's diameter error at each of its two faces",
        "diameter": "a roller's whole diameter error at each contact",
    }
    material_keys = ("roller_material", "plate_material")
    interfaces = 2
    one_disk_because = (
        "a plate lies against its disk and the output against the plate: a second disk would need its own"
    )

    mechanism: Literal["roller_plate"]
    roller_radius_mm: Millimetres
    rollers: Annotated[int, Field(ge=8, le=800, multiple_of=8)]
    roller_length_mm: Millimetres
    roller_material: str
    inner_station_mm: Millimetres
    outer_station_mm: Millimetres
    face_offset_mm: Millimetres
    slide_angle_deg: Annotated[float, Field(ge=-360, le=360)]
    plate: Literal["rotates", "floats"]
    flat_depth_mm: Millimetres
    plate_material: str

    @property
    def stations(self) -> int:
        """Rollers in a row: 2 interfaces x 2 faces x 2 ends share all rollers."""
        return self.rollers // 8

    @property
    def stations_mm(self) -> Real:
        """Distances of the rollers of a row from the axis (n_stations,) [mm], outermost first."""
        return np.array(np.linspace(self.outer_station_mm, self.inner_station_mm, self.stations))

    @property
    def contacts(self) -> int:
        """Output contacts, one for each roller."""
        return self.rollers

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact, the roller."""
        return self.roller_radius_mm

    def patch_half_width_mm(self, share: float) -> float:
        """Most of the radius of a roller: the tongue spreads its force before it enters the slice."""
        return SPREAD * self.roller_radius_mm

    def contact_length_mm(self, thickness_mm: float) -> float:
        """Length of a roller."""
        return self.roller_length_mm

    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Mistake]:
        """Rollers that overlap, a tongue inside the bore, rollers beyond the disk."""
        yield from self._row_problems()
        if disk and self.face_offset_mm <= disk.bore_radius_mm:
            requirement = (
                f"must be > {disk.bore_radius_mm:g} mm, the bore's radius: the boss's face lies inside the bore"
            )
            yield Mistake("output.face_offset_mm", self.face_offset_mm, requirement)
        if cycloid:
            yield from self._reach_problems(cycloid)

    def _row_problems(self) -> Iterator[Mistake]:
        diameter = 2 * self.roller_radius_mm
        length = self.outer_station_mm - self.inner_station_mm
        if self.stations > 1 and length < diameter * (self.stations - 1):
            requirement = (
                f"must be >= {self.inner_station_mm + diameter * (self.stations - 1):.4g} mm, or the {self.stations} "
                f"rollers of diameter {diameter:g} mm between the stations overlap; "
                "move the stations apart or take smaller or fewer rollers"
            )
            yield Mistake("output.outer_station_mm", self.outer_station_mm, requirement)
        if self.inner_station_mm < self.roller_radius_mm:
            requirement = f"must be >= {self.roller_radius_mm:g} mm, or the innermost rollers of the two ends overlap"
            yield Mistake("output.inner_station_mm", self.inner_station_mm, requirement)

    def _reach_problems(self, cycloid: Cycloid) -> Iterator[Mistake]:
        # The eccentric moves the disk under rollers that stand still along the other slide.
        reach = hypot(self.outer_station_mm + self.roller_radius_mm, self.face_offset_mm + self.roller_radius_mm)
        available = cycloid.root_radius_mm - cycloid.eccentricity_mm
        if reach > available:
            requirement = (
                f"the outermost rollers reach {reach:.4g} mm from the axis, the disk ends at {available:.4g} mm "
                "(lobes' roots less eccentricity); move the stations inwards"
            )
            yield Mistake("output.outer_station_mm", self.outer_station_mm, requirement)

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """The rotations of plate and output, and the translation of a plate that floats."""
        plate = disk.part("plate")
        shifts = (f"{plate}_x", f"{plate}_y") if self.plate == "floats" else ()
        return f"{plate}_phi", "output_phi", *shifts

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The rollers of the disk's slide, then those of the output's.

        Notes
        -----
        The arm of a roller is its distance along the slide for both bodies: the rollers lie half-way between
        bodies whose centres differ by at most the eccentricity, an effect that the two ends cancel.
        """
        slide_direction: complex = np.exp(1j * (np.radians(self.slide_angle_deg) + disk.rotation))
        plate = disk.part("plate")
        of_disk = self._slide(0, (disk.body, plate), slide_direction, disk.eccentric)
        return joined_contacts([of_disk, self._slide(1, (plate, "output"), 1j * slide_direction, 0j)])

    def _slide(self, interface: int, bodies: tuple[str, str], direction: complex, centre: complex) -> Contacts:
        """Rollers of one tongue in its slot: faces 0 and 1 at +-h, ends 0 and 1 at +-x, stations from outside."""
        (face, end, station), labels = _places(bodies, self.stations)
        side, reach = 1 - 2 * face, (1 - 2 * end) * self.stations_mm[station]
        normal: Complex = np.multiply(1j * direction, side)
        return contact_list(
            bodies,
            labels,
            interface=interface,
            face=face,
            end=end,
            station=station,
            two_sided=True,
            point=centre + reach * direction + self.face_offset_mm * normal,
            normal=normal,
            arm=(side * reach).astype(float),
        )

    def laws(self, inputs: LawInputs) -> ContactLaws:
        """A roller between the flats of two bodies: the disk's tongue and the plate, or the plate and the output.

        The output is taken to be of the plate's material.
        """
        roller, plate = (inputs.materials[name] for name in (self.roller_material, self.plate_material))
        radius = np.full(self.rollers // 2, self.roller_radius_mm)
        laws = []
        for flats in ((inputs.disk, plate), (plate, plate)):
            first_law, second = (LineContact(radius, self.roller_length_mm, roller, flat) for flat in flats)
            laws.append(inputs.law.between_flats((first_law, second), self.roller_radius_mm, self.flat_depth_mm))
        return concatenated_laws(laws)

    def fact(self, cycloid: Cycloid, number_text: Callable[[float], str]) -> str:
        """Slides and rollers in words."""
        return (
            f"sliding plate between two crossed slides, {self.rollers} rollers of radius "
            f"{number_text(self.roller_radius_mm)} mm; the plate {PLATE[self.plate]}"
        )

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The rollers of each interface, with their places in their rows."""
        return [self._panel(interface, contacts, numbers) for interface in range(self.interfaces)]

    def _panel(self, interface: int, contacts: Contacts, numbers: Index) -> Panel:
        of_slide = np.flatnonzero(contacts.interface == interface)
        centre, part = contacts.point[of_slide], PARTS[interface]
        texts = tuple(str(station) for station in contacts.station[of_slide])
        bodies = f"{contacts.body_a[of_slide[0]]} to {contacts.body_b[of_slide[0]]}"
        edge = np.max(np.abs([centre.real, centre.imag])) + ROLLERS_BESIDE * self.roller_radius_mm
        rollers = Circles(centre, self.roller_radius_mm, part, texts, 6.0)
        labels = self._row_labels(contacts, of_slide, numbers, part)
        return Panel(f"Interface {interface}: {bodies}", (rollers, *labels), edge)

    def _row_labels(self, contacts: Contacts, of_slide: Index, numbers: Index, part: Part) -> Iterator[RowLabel]:
        """Numbers of the contacts of each row of rollers, beyond its outermost one."""
        for row in np.split(of_slide, 4):
            outer, inner = contacts.point[row[0]], contacts.point[row[-1]]
            direction = (outer - inner) / abs(outer - inner) if len(row) > 1 else outer / abs(outer)
            point = outer + direction * 1.6 * self.roller_radius_mm
            yield RowLabel(point, direction, f"{numbers[row].min()}–{numbers[row].max()}", part)


@lru_cache(maxsize=64)
def _places(bodies: tuple[str, str], stations: int) -> tuple[tuple[Index, ...], list[str]]:
    """Face, end and station (n,) of the rollers between two bodies, and their labels."""
    grids = np.meshgrid([0, 1], [0, 1], np.arange(stations), indexing="ij")
    places = tuple(grid.ravel() for grid in grids)
    labels = [f"{'-'.join(bodies)} face {'+-'[f]} end {'+-'[e]} roller {s}" for f, e, s in zip(*places, strict=True)]
    return places, labels


MECHANISM = RollerPlate

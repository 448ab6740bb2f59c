"""Second stage of an RV reducer: cranks on the carrier turn the disks, planets and a held sun turn the cranks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import gamma, pi, sin, sqrt
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.config.files.section import Clearance, Millimetres, Mistake, Section
from pipeline.config.mechanisms.drawing import Circles, Panel, Points
from pipeline.config.mechanisms.mechanism import Holes, LawInputs, OutputMechanism, Words
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.contacts import OUTPUT, Contacts, DiskPose, joined
from pipeline.model.geometry.cycloid_profile import Complex, Index, Real

if TYPE_CHECKING:
    from pipeline.config.designs.cycloid import Cycloid
    from pipeline.config.designs.design import Disk


class FirstStage(Section):
    """Sun on the input, held, and a planet on each crank.

    `backlash_um` along the pitch circle is the way of a planet from flank to flank; `mesh_stiffness_N_per_mm` is that
    of one planet's mesh along it.
    """

    sun_teeth: Annotated[int, Field(ge=5, le=1000)]
    planet_teeth: Annotated[int, Field(ge=5, le=1000)]
    backlash_um: Clearance
    mesh_stiffness_N_per_mm: Annotated[float, Field(ge=1, le=1e9)]


class Carrier(OutputMechanism):
    """Cranks on the carrier, which is the output, with an eccentric for each disk; no bearing holds a disk's centre.

    The cranks stand on a circle about the housing axis, counted clockwise from `phase_deg` at crank angle 0. Each
    eccentric runs in a bearing in a hole of the disk: `[bearing]` of the design is the radial law of one of them, and
    its clearance theirs. A ring of `bearing_rollers` carries it, which push along their own directions; together and
    without clearance they have the stated law, a linear one alike in all directions (16 rollers with an exponent of
    3/2: within 0.3 %).
    """

    words = Words(
        contact="crank bearing and gear contact",
        station="roller of the crank bearing, and flank of the tooth",
        drawing="Cranks are counted clockwise from the first; dots are the rollers of their bearings.",
        loads="each line is the bearing of one crank; a pair of points is the mesh of its planet.",
        without_pressure="Rollers of the crank bearings and teeth of the first stage have none: a peak pressure, and "
        "the shear below it, are those of the pins alone.",
        bearing="bearing of a crank",
        rows=("roller of a crank's bearing", "flank of a planet's tooth"),
    )
    diameter_readings = {"half_diameter": "no diameter of the output has a tolerance"}
    material_keys = ()
    interfaces = 1
    toleranced_diameters = False
    carries_disks = True

    mechanism: Literal["carrier"]
    cranks: Annotated[int, Field(ge=2, le=3)]
    crank_circle_radius_mm: Millimetres
    bearing_radius_mm: Millimetres
    bearing_rollers: Annotated[int, Field(ge=8, le=60, multiple_of=2)]
    phase_deg: Annotated[float, Field(ge=-360, le=360)]
    first_stage: FirstStage

    @property
    def contacts(self) -> int:
        """Rollers of the crank bearings of a disk, and two flanks of each planet."""
        return self.cranks * (self.bearing_rollers + 2)

    @property
    def holes_in_disk(self) -> int:
        """One for each crank."""
        return self.cranks

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the hole in which the rollers run."""
        return self.bearing_radius_mm

    @property
    def planet_pitch_radius_mm(self) -> float:
        """Radius of a planet's pitch circle, by the distance of sun and planet."""
        stage = self.first_stage
        return self.crank_circle_radius_mm * stage.planet_teeth / (stage.sun_teeth + stage.planet_teeth)

    def centres(self) -> Complex:
        """Centres of the holes in a disk's frame, and of the cranks in the carrier's (n_cranks,) complex [mm]."""
        phase = np.radians(self.phase_deg)
        return self.crank_circle_radius_mm * np.exp(1j * (phase - 2 * np.pi * np.arange(self.cranks) / self.cranks))

    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Mistake]:
        """Holes that cut each other, the lobes or the bore, a crank circle outside of the disk, a turning housing."""
        hole, circle = self.bearing_radius_mm, self.crank_circle_radius_mm
        pitch = 2 * circle * sin(pi / self.cranks)
        if pitch <= 2 * hole:
            yield Mistake(
                "output.bearing_radius_mm",
                hole,
                f"must be < {pitch / 2:.4g} mm, half the distance of the {self.cranks} cranks, or the holes overlap",
            )
        if cycloid and circle + hole >= cycloid.root_radius_mm:
            yield Mistake(
                "output.crank_circle_radius_mm",
                circle,
                f"the holes reach {circle + hole:.4g} mm from the disk's centre, must be < "
                f"{cycloid.root_radius_mm:.4g} mm, the radius at the lobes' roots; "
                "move the cranks inwards or take smaller bearings",
            )
        if disk and circle - hole <= disk.bore_radius_mm:
            yield Mistake(
                "output.crank_circle_radius_mm",
                circle,
                f"the holes reach within {circle - hole:.4g} mm of the disk's centre, must be > "
                f"{disk.bore_radius_mm:g} mm, the bore's radius; "
                "move the cranks outwards or take smaller bearings or a smaller bore",
            )
        if cycloid and cycloid.fixed != "housing":
            allowed = 'must be "housing" with a carrier, whose sun is held to the housing'
            yield Mistake("cycloid.fixed", cycloid.fixed, allowed)

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """The carrier's rotation, and that of each crank about its own axis in space."""
        return ("output_phi", *(f"crank {j}_psi" for j in range(self.cranks)))

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The rollers of each crank's bearing, from crank to crank.

        Notes
        -----
        The hole of crank j moves by q + phi_disk z x c_j and the eccentric in it by phi z x c_j + e psi_j z x u: a
        roller in the direction n carries what is left of their difference. What an error of the eccentricity shifts,
        the disk follows.
        """
        return joined([self._bearing(j, disk) for j in range(self.cranks)])

    def _bearing(self, crank: int, disk: DiskPose) -> Contacts:
        n = self.bearing_rollers
        centre = self.centres()[crank] * np.exp(1j * disk.rotation)
        outwards = np.exp(1j * (disk.rotation + 2 * np.pi * np.arange(n) / n))
        return Contacts(
            kind=np.full(n, OUTPUT),
            body_a=np.full(n, disk.body),
            body_b=np.full(n, "output"),
            interface=np.zeros(n, int),
            face=np.zeros(n, int),
            end=np.full(n, crank),
            station=np.arange(n),
            hole=np.full(n, crank),
            label=np.array([f"crank {crank} roller {k}" for k in range(n)]),
            gap=np.zeros(n),
            two_sided=np.zeros(n, bool),
            per_eccentricity=np.zeros(n),
            curvature=np.full(n, -1 / self.bearing_radius_mm),
            point=disk.eccentric + centre + self.bearing_radius_mm * outwards,
            normal=-outwards,
            arm=np.imag(np.conj(centre) * -outwards),
        )

    def contacts_behind(self, disk: DiskPose) -> Contacts:
        """Both flanks of each planet with the sun: the cranks turn all disks.

        Notes
        -----
        When the carrier turns by phi, the planet on the held sun has psi = (1 + z1/z2) phi, and
        r2 (psi - (1 + z1/z2) phi) = r2 psi - r_c phi is what the mesh yields to either side.
        """
        n = 2 * self.cranks
        crank, flank = np.repeat(np.arange(self.cranks), 2), np.tile([0, 1], self.cranks)
        direction = self.centres()[crank] / self.crank_circle_radius_mm * np.exp(1j * disk.rotation)
        side = 1 - 2 * flank
        return Contacts(
            kind=np.full(n, OUTPUT),
            body_a=np.full(n, "sun"),
            body_b=np.full(n, "output"),
            interface=np.ones(n, int),
            face=flank,
            end=crank,
            station=flank,
            hole=np.full(n, -1),
            label=np.array([f"planet {j} flank {k}" for j, k in zip(crank, flank, strict=True)]),
            gap=np.full(n, 0.5e-3 * self.first_stage.backlash_um),
            two_sided=np.zeros(n, bool),
            per_eccentricity=np.zeros(n),
            curvature=np.zeros(n),
            point=(self.crank_circle_radius_mm - self.planet_pitch_radius_mm) * direction,
            normal=1j * side * direction,
            arm=side * self.crank_circle_radius_mm,
        )

    def couplings_of(self, disk: DiskPose, contacts: Contacts) -> Mapping[str, Real]:
        """What the contacts close by the rotation of each crank, its eccentrics and its planet."""
        eccentric = -np.imag(np.conj(disk.eccentric) * contacts.normal)
        planet = self.planet_pitch_radius_mm * (1 - 2 * contacts.face)
        lever = np.where(contacts.interface == 0, eccentric, planet)
        return {f"crank {j}_psi": np.where(contacts.end == j, lever, 0.0) for j in range(self.cranks)}

    def bearing_rows(self, contacts: Contacts) -> Index:
        """Those of the output contacts that a clearance of the design's bearing opens: the rollers of the cranks."""
        return np.flatnonzero(contacts.hole >= 0)

    def laws(self, inputs: LawInputs) -> ContactLaws:
        """Rollers that together have the bearing's law; they have no Hertz pressure here.

        Notes
        -----
        A deflection d of the ring loads its rollers by k (d cos)^n on one half: in all K d^n with K/k = the number of
        rollers times the mean of cos^(n + 1) over that half, by their mean over the turn.
        """
        exponent = inputs.bearing.exponent
        mean = gamma(exponent / 2 + 1) / (2 * sqrt(pi) * gamma((exponent + 3) / 2))
        roller = inputs.bearing.stiffness / (self.bearing_rollers * mean)
        n = self.cranks * self.bearing_rollers
        if exponent == 1:
            return _law(n, 1 / roller, 0.0, 1.0)
        return _law(n, 0.0, roller ** (-1 / exponent), 1 / exponent)

    def laws_behind(self) -> ContactLaws:
        """The planets' meshes, linear, without a Hertz pressure."""
        return _law(2 * self.cranks, 1 / self.first_stage.mesh_stiffness_N_per_mm, 0.0, 1.0)

    def holes(self, cycloid: Cycloid) -> Holes:
        """One hole for each crank."""
        return Holes(self.centres(), self.bearing_radius_mm)

    def crank_turns(self, cycloid: Cycloid) -> float:
        """The carrier turns 1 + z2 N/z1 times slower than the sun, and Z times slower than the cranks."""
        return cycloid.lobes / self.ratio(cycloid)

    def crank_torque_ratio(self, cycloid: Cycloid) -> float:
        """All cranks take z2/z1 times the torque on the sun, which is that on the output over N + z1/z2."""
        return cycloid.pins + self.first_stage.sun_teeth / self.first_stage.planet_teeth

    def ratio(self, cycloid: Cycloid) -> float:
        """Turns of the sun for one of the carrier, the housing held."""
        return 1 + self.first_stage.planet_teeth * cycloid.pins / self.first_stage.sun_teeth

    def fact(self, cycloid: Cycloid, number_text: Callable[[float], str]) -> str:
        """Cranks, first stage and total ratio in words."""
        stage = self.first_stage
        return (
            f"carrier with {self.cranks} cranks on a circle of radius {number_text(self.crank_circle_radius_mm)} mm, "
            f"a sun of {stage.sun_teeth} and planets of {stage.planet_teeth} teeth before them: "
            f"total ratio {number_text(self.ratio(cycloid))}"
        )

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The disk with its holes, the eccentrics in them and the rollers of their bearings."""
        centre = disk.eccentric + self.centres() * np.exp(1j * disk.rotation)
        texts = tuple(str(j) for j in range(self.cranks))
        rollers = contacts.point[contacts.hole >= 0]
        shapes = (Circles(centre, self.bearing_radius_mm, "output", texts), Points(rollers))
        return [Panel(f"Cranks 0 to {self.cranks - 1}, {disk.body}", shapes, disk=True)]


def _law(n: int, linear: float, power: float, exponent: float) -> ContactLaws:
    zero = np.zeros(n)
    return ContactLaws(zero + linear, zero, zero + power, zero + exponent, zero + np.inf, zero)


MECHANISM = Carrier

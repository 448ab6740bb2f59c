"""Second stage of an RV reducer: cranks on the carrier turn the disks, planets and a held sun turn the cranks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from math import gamma, pi, radians, sin, sqrt, tan
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.arrays import Complex, Index, Real
from pipeline.config.files.section import Millimetres, Mistake, Positive
from pipeline.config.mechanisms.crankshaft import Crankshaft, FirstStage, kept_flexibility
from pipeline.config.mechanisms.mechanism import Circles, Holes, LawInputs, OutputMechanism, Panel, Points, Words
from pipeline.model.contact.laws import ContactLaws, Material, concatenated_laws
from pipeline.model.geometry.contacts import Contacts, DiskPose, contact_list, joined_contacts

if TYPE_CHECKING:
    from pipeline.config.designs.design import Disk
    from pipeline.config.designs.sections import Cycloid

RING, MESH, SUPPORT = range(3)
"""Interfaces: rollers about an eccentric, flanks of a planet, rollers of a crank's supports."""


class Carrier(OutputMechanism):
    """Cranks on the carrier, which is the output, with an eccentric for each disk; no bearing holds a disk's centre.

    The cranks stand on a circle about the housing axis, counted clockwise from `phase_deg` at crank angle 0. Each
    eccentric runs in a bearing in a hole of the disk: `[bearing]` of the design is the radial law of one of them, and
    its clearance theirs. A ring of `bearing_rollers` carries it, which push along their own directions; together and
    without clearance they have the stated law, a linear one alike in all directions (16 rollers with an exponent of
    3/2: within 0.3 %). Without `crankshaft` the cranks are rigid and turn in rigid bearings of the carrier;
    `stiffness_of_cranks` are factors of all bearings of each crank.
    """

    words = Words(
        contact="crank bearing and gear contact",
        station="roller of the crank bearing, and flank of the tooth",
        drawing="Cranks are counted clockwise from the first; dots are the rollers of their bearings.",
        loads="each line is the bearing of one crank; a pair of points is the mesh of its planet.",
        without_pressure="Rollers of the crank bearings and teeth of the first stage have none: a peak pressure, and "
        "the shear below it, are those of the pins alone.",
        bearing="bearing of a crank",
        rows=("roller of a crank's bearing", "flank of a planet's tooth", "roller of a crank's support"),
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
    crankshaft: Crankshaft | None = None
    stiffness_of_cranks: tuple[Positive, ...] | None = None

    @property
    def has_loose_supports(self) -> bool:
        """Whether the cranks move in rollers of their supports."""
        return self.crankshaft is not None and self.crankshaft.has_clearance

    @property
    def material_names(self) -> Mapping[str, str]:
        """Material of the crankshafts, by its setting."""
        return {"crankshaft.material": self.crankshaft.material} if self.crankshaft else {}

    @property
    def contacts(self) -> int:
        """Rollers of the crank bearings of a disk, two flanks of each planet, and rollers of loose supports."""
        return self.cranks * (self.bearing_rollers * (3 if self.has_loose_supports else 1) + 2)

    @property
    def bearing_factors(self) -> Real:
        """Factor (n_cranks,) of the stiffness of all bearings of each crank."""
        return np.ones(self.cranks) if self.stiffness_of_cranks is None else np.array(self.stiffness_of_cranks)

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
        return self.first_stage.planet_share * self.crank_circle_radius_mm

    def centres(self) -> Complex:
        """Centres of the holes in a disk's frame, and of the cranks in the carrier's (n_cranks,) complex [mm]."""
        phase = np.radians(self.phase_deg) - 2 * np.pi * np.arange(self.cranks) / self.cranks
        centres: Complex = self.crank_circle_radius_mm * np.exp(1j * phase)
        return centres

    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Mistake]:
        """Holes that cut each other, the lobes or the bore, a crank circle outside of the disk, a turning housing."""
        hole, circle = self.bearing_radius_mm, self.crank_circle_radius_mm
        pitch = 2 * circle * sin(pi / self.cranks)
        if pitch <= 2 * hole:
            requirement = (
                f"must be < {pitch / 2:.4g} mm, half the distance of the {self.cranks} cranks, or the holes overlap"
            )
            yield Mistake("output.bearing_radius_mm", hole, requirement)
        if pitch <= 2 * self.planet_pitch_radius_mm:
            most = self.first_stage.sun_teeth / (1 / sin(pi / self.cranks) - 1)
            requirement = f"must be < {most:.4g}, or the pitch circles of the {self.cranks} planets overlap"
            yield Mistake("output.first_stage.planet_teeth", self.first_stage.planet_teeth, requirement)
        if cycloid and circle + hole >= cycloid.root_radius_mm:
            requirement = (
                f"the holes reach {circle + hole:.4g} mm from the disk's centre, must be < "
                f"{cycloid.root_radius_mm:.4g} mm, the radius at the lobes' roots; "
                "move the cranks inwards or take smaller bearings"
            )
            yield Mistake("output.crank_circle_radius_mm", circle, requirement)
        if disk and circle - hole <= disk.bore_radius_mm:
            requirement = (
                f"the holes reach within {circle - hole:.4g} mm of the disk's centre, must be > "
                f"{disk.bore_radius_mm:g} mm, the bore's radius; "
                "move the cranks outwards or take smaller bearings or a smaller bore"
            )
            yield Mistake("output.crank_circle_radius_mm", circle, requirement)
        if cycloid and cycloid.fixed != "housing":
            requirement = 'must be "housing" with a carrier, whose sun is the input, locked to the housing'
            yield Mistake("cycloid.fixed", cycloid.fixed, requirement)
        if self.stiffness_of_cranks and len(self.stiffness_of_cranks) != self.cranks:
            requirement = f"must be {self.cranks} factors, one of each crank"
            yield Mistake("output.stiffness_of_cranks", self.stiffness_of_cranks, requirement)
        if self.crankshaft:
            yield from self.crankshaft.problems("output.crankshaft", disk.count if disk else 1)

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """The carrier's rotation, that of each crank about its own axis in space, and its shifts in loose supports."""
        turns = [f"crank {j}_psi" for j in range(self.cranks)]
        return ("output_phi", *turns, *(name for j in range(self.cranks) for name in self._shifts(j)))

    def _shifts(self, crank: int) -> list[str]:
        """Names of the motions of a crank's shaft in its two supports, x and y of the first, then of the second."""
        return [f"crank {crank}_{s}{axis}" for s in "ab" for axis in "xy"] if self.has_loose_supports else []

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The rollers of each crank's bearing, from crank to crank.

        Notes
        -----
        The hole of crank j moves by q + phi_disk z x c_j and the eccentric in it by phi z x c_j + e psi_j z x u: a
        roller in the direction n carries what is left of their difference. What an error of the eccentricity shifts,
        the disk follows.
        """
        return _turned(_on_eccentrics(self, disk.body), disk, disk.eccentric)

    def contacts_behind(self, disk: DiskPose) -> Contacts:
        """Both flanks of each planet with the sun, then the rollers of loose supports: the cranks turn all disks."""
        return _turned(_behind_disks(self), disk, 0.0)

    def bearing(self, crank: int, body: str) -> Contacts:
        """Rollers between an eccentric of a crank and the disk named ``body``, on the axis at rotation 0."""
        n = self.bearing_rollers
        centre, outwards = self.centres()[crank], np.exp(2j * np.pi * np.arange(n) / n)
        return contact_list(
            (body, "output"),
            [f"crank {crank} roller {k}" for k in range(n)],
            interface=RING,
            end=crank,
            station=np.arange(n),
            hole=crank,
            curvature=-1 / self.bearing_radius_mm,
            point=centre + self.bearing_radius_mm * outwards,
            normal=-outwards,
            arm=np.imag(np.conj(centre) * -outwards),
        )

    def support(self, crank: int, support: int) -> Contacts:
        """Rollers between the carrier at rotation 0 and a crank's shaft; of their own radius nothing depends."""
        ring, shaft = self.bearing(crank, "output"), self.crankshaft
        clearance = 1e-3 * (shaft.support_clearance_um or 0.0) if shaft else 0.0
        n = len(ring)
        return replace(
            ring,
            body_b=np.full(n, f"crank {crank}"),
            interface=np.full(n, SUPPORT),
            face=np.full(n, support),
            hole=np.full(n, -1),
            label=np.array([f"crank {crank} support {support} roller {k}" for k in range(n)]),
            gap=np.full(n, clearance),
            curvature=np.zeros(n),
            arm=np.zeros(n),
        )

    def couplings_of(self, disk: DiskPose, contacts: Contacts) -> Mapping[str, Real]:
        """What the contacts close by the rotation of each crank, its eccentrics and its planet."""
        eccentric = -np.imag(np.conj(disk.eccentric) * contacts.normal)
        planet = self.planet_pitch_radius_mm * (1 - 2 * contacts.face)
        lever = np.choose(contacts.interface, [eccentric, planet, np.zeros(len(contacts))])
        turns = {f"crank {j}_psi": np.where(contacts.end == j, lever, 0.0) for j in range(self.cranks)}
        if not (self.crankshaft and self.crankshaft.has_clearance):
            return turns
        of_disk, *_, of_planet = self.crankshaft.shares(disk.number + 1)[[disk.number, -1]]
        at_support = np.eye(2)[contacts.face * (contacts.interface == SUPPORT)]
        share = np.choose(contacts.interface[:, None], [of_disk, of_planet, at_support])
        push = self.push(contacts)
        closing = -np.stack([push.real, push.imag], axis=1)[:, None, :] * share[:, :, None]
        names = [(j, k, name) for j in range(self.cranks) for k, name in enumerate(self._shifts(j))]
        shifts = {name: np.where(contacts.end == j, closing[:, k // 2, k % 2], 0.0) for j, k, name in names}
        return turns | shifts

    def push(self, contacts: Contacts) -> Complex:
        """Force on the crank (n_contacts,) per unit normal force, that of a mesh along its line of action."""
        outwards = contacts.point / np.abs(contacts.point)
        radial_part = tan(radians(self.first_stage.pressure_angle_deg)) * outwards
        return contacts.normal + np.where(contacts.interface == MESH, radial_part, 0.0)

    def displacements(self, disks: Sequence[DiskPose], contacts: Contacts) -> Mapping[str, Complex]:
        """How errors of cranks and gears open their contacts, by the toleranced dimensions' names.

        Notes
        -----
        A crank, an eccentric or a planet that is displaced by v opens a contact by the part of v along its push. A
        crank's place turns with the carrier, an eccentric and a planet's run-out with the crank, that of the sun with
        the sun, and with the opposite sign: the sun is the first body of the mesh.
        """
        first_disk, pins = disks[0], len(disks[0].pins.arm)
        sun_turn = first_disk.rotation * float(self.first_stage.ratio(pins))
        at_rest = _displacements(self, len(disks), pins)
        of_disks = np.repeat([np.exp(1j * (disk.rotation - disk.crank)) for disk in disks], self.cranks)
        eccentrics = at_rest["crank_eccentricity"] * of_disks
        return dict(at_rest) | {
            "crank_eccentricity": eccentrics,
            "crank_phase": -1j * eccentrics,
            "planet_runout": at_rest["planet_runout"] * of_disks[0],
            "sun_runout": at_rest["sun_runout"] * np.exp(1j * (first_disk.rotation - sun_turn)),
        }

    def compliance(self, contacts: Contacts, disk: Index, materials: Mapping[str, Material]) -> Real | None:
        """What the shaft of each crank gives way between the contacts that push it, in its bending and its supports."""
        if not self.crankshaft:
            return None
        return _compliance(self, int(disk.max()) + 1, materials[self.crankshaft.material])

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
        return self._rings(inputs.bearing.stiffness * self.bearing_factors, inputs.bearing.exponent)

    def _rings(self, stiffness: Real, exponent: float) -> ContactLaws:
        """Laws of the rollers of rings of so much stiffness each (n_rings,)."""
        mean = gamma(exponent / 2 + 1) / (2 * sqrt(pi) * gamma((exponent + 3) / 2))
        roller = np.repeat(stiffness / (self.bearing_rollers * mean), self.bearing_rollers)
        if exponent == 1:
            return _law(1 / roller, np.zeros(len(roller)), 1.0)
        return _law(np.zeros(len(roller)), roller ** (-1 / exponent), 1 / exponent)

    def laws_behind(self) -> ContactLaws:
        """The planets' meshes, linear, and the rollers of loose supports; without a Hertz pressure."""
        meshes = np.full(2 * self.cranks, 1 / self.first_stage.mesh_stiffness_N_per_mm)
        laws, shaft = _law(meshes, 0 * meshes, 1.0), self.crankshaft
        if shaft is None or not shaft.has_clearance:
            return laws
        stiffness = np.outer(self.bearing_factors, shaft.support_stiffness_N_per_mm_power).ravel()
        return concatenated_laws([laws, self._rings(stiffness, shaft.support_exponent)])

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
        return float(self.first_stage.ratio(cycloid.pins))

    def output_turns(self, cycloid: Cycloid) -> int:
        """Turns of the carrier after which sun, cranks and disks all stand as before: the ratio's denominator."""
        return self.first_stage.ratio(cycloid.pins).denominator

    def fact(self, cycloid: Cycloid, number_text: Callable[[float], str]) -> str:
        """Cranks, first stage and total ratio in words."""
        stage, turns = self.first_stage, self.output_turns(cycloid)
        shaft = "; the cranks bend between their supports" if self.crankshaft else ""
        period = f", which repeats after {turns} turns of the output" if turns > 1 else ""
        return (
            f"carrier with {self.cranks} cranks on a circle of radius {number_text(self.crank_circle_radius_mm)} mm, "
            f"a sun of {stage.sun_teeth} and planets of {stage.planet_teeth} teeth before them: "
            f"total ratio {number_text(self.ratio(cycloid))}{period}{shaft}"
        )

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The disk with its holes, the eccentrics in them and the rollers of their bearings."""
        centre = disk.eccentric + self.centres() * np.exp(1j * disk.rotation)
        texts = tuple(str(j) for j in range(self.cranks))
        rollers = contacts.point[contacts.hole >= 0]
        shapes = (Circles(centre, self.bearing_radius_mm, "output", texts), Points(rollers))
        return [Panel(f"Cranks 0 to {self.cranks - 1}, {disk.body}", shapes, disk=True)]


def _law(linear: Real, power: Real, exponent: float) -> ContactLaws:
    zero = np.zeros(len(linear))
    return ContactLaws(linear, zero, power, zero + exponent, zero + np.inf, zero)


def _turned(contacts: Contacts, disk: DiskPose, shift: complex) -> Contacts:
    """Contacts that turn with a disk and the carrier from rotation 0, and are shifted [mm]."""
    turn = np.exp(1j * disk.rotation)
    return replace(contacts, point=shift + contacts.point * turn, normal=contacts.normal * turn)


@lru_cache
def _on_eccentrics(output: Carrier, body: str) -> Contacts:
    """Rollers of the cranks' bearings in the disk named ``body``, which stands at rotation 0 on the axis."""
    return joined_contacts([output.bearing(j, body) for j in range(output.cranks)])


@lru_cache
def _behind_disks(output: Carrier) -> Contacts:
    """Flanks of the planets, and rollers of loose supports, the carrier at rotation 0."""
    places = [(crank, support) for crank in range(output.cranks) for support in (0, 1)]
    supports = [output.support(*place) for place in places] if output.has_loose_supports else []
    return joined_contacts([output.first_stage.meshes(output.centres(), MESH), *supports])


def _at_rest(output: Carrier, disks: int) -> Contacts:
    """All contacts of the output, those of each disk and those behind, the carrier at rotation 0."""
    return joined_contacts([*[_on_eccentrics(output, "disk")] * disks, _behind_disks(output)])


@lru_cache
def _displacements(output: Carrier, disks: int, pins: int) -> Mapping[str, Complex]:
    """``Carrier.displacements`` of so many ``disks`` where nothing has turned."""
    contacts = _at_rest(output, disks)
    of_crank = contacts.end[:, None] == np.arange(output.cranks)
    ring, mesh, support = (of_crank & (contacts.interface == k)[:, None] for k in (RING, MESH, SUPPORT))
    of_disk = np.arange(len(contacts)) // (output.cranks * output.bearing_rollers)
    eccentrics = np.hstack([ring & (of_disk == disk)[:, None] for disk in range(disks)])
    side, push = (1 - 2 * contacts.face)[:, None], output.push(contacts)[:, None]
    at_rest = {
        "crank_position": (ring | mesh) * push,
        "crank_eccentricity": eccentrics * push,
        "crank_phase": -1j * eccentrics * push,
        "planet_runout": mesh * push,
        "planet_timing": -side * mesh + 0j,
        "planet_backlash": 0.5 * mesh + 0j,
        "sun_runout": -1.0 * np.any(mesh, axis=1)[:, None] * push,
        "first_support_clearance": support * (contacts.face == 0)[:, None] + 0j,
        "second_support_clearance": support * (contacts.face == 1)[:, None] + 0j,
    }
    return {name: np.pad(values, ((disks * pins, 0), (0, 0))) for name, values in at_rest.items()}


@lru_cache
def _compliance(output: Carrier, disks: int, material: Material) -> Real:
    """``Carrier.compliance``, which turns with the carrier and so is alike at all angles."""
    assert output.crankshaft is not None
    contacts = _at_rest(output, disks)
    push, of_disk = output.push(contacts), np.arange(len(contacts)) // (output.cranks * output.bearing_rollers)
    plane = np.where(contacts.interface == RING, of_disk, disks)
    full = np.zeros((len(contacts), len(contacts)))
    for crank, factor in enumerate(output.bearing_factors.tolist()):
        rows = np.flatnonzero((contacts.end == crank) & (contacts.interface != SUPPORT))
        shaft = kept_flexibility(output.crankshaft, disks, material, factor)[np.ix_(plane[rows], plane[rows])]
        full[np.ix_(rows, rows)] = shaft * np.real(np.conj(push[rows])[:, None] * push[rows])
    return full


MECHANISM = Carrier

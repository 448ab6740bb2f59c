"""Shafts with eccentrics between two supports (a plain input, cranks of a carrier), and the gears before them."""

from collections.abc import Iterator, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field

from pipeline.arrays import Complex, Real
from pipeline.config.files.section import Clearance, Millimetres, Mistake, Section
from pipeline.model.contact.laws import Material
from pipeline.model.elastic.beam import LONGEST, SHORTEST, shaft_flexibility, support_shares
from pipeline.model.geometry.contacts import Contacts, contact_list

Stiffness = Annotated[float, Field(ge=1, le=1e12)]


class Shaft(Section):
    """Shaft of one diameter on two preloaded support bearings, linear springs that leave its slope free.

    Planes are counted from the first support: the first disk's middle plane lies at `plane_mm`, each further disk's
    `disk_pitch_mm` farther on. All disks lie between the supports.
    """

    span_mm: Millimetres
    plane_mm: Millimetres
    disk_pitch_mm: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    diameter_mm: Millimetres
    material: str
    support_stiffness_N_per_mm_power: tuple[Stiffness, Stiffness]

    @property
    def has_clearance(self) -> bool:
        """Whether the supports are rings of rollers in which the shaft moves."""
        return False

    def planes(self, disks: int) -> Real:
        """Distances (n_planes,) [mm] of the planes in which forces act, the disks' first, from the first support."""
        return self.plane_mm + self.disk_pitch_mm * np.arange(disks, dtype=float)

    def shares(self, disks: int) -> Real:
        """Share (n_planes, 2) of each support in a force in each of the planes."""
        return support_shares(self.planes(disks), self.span_mm)

    def flexibility(self, disks: int, materials: Mapping[str, Material], factor: float = 1.0) -> Real:
        """Deflection (n_planes, n_planes) [mm/N] in each plane by a unit force in each; ``factor`` of the supports.

        Bending, and of preloaded supports what they give way: the deflection of each by its share of the force.
        """
        bending = shaft_flexibility(self.planes(disks), self.span_mm, self.diameter_mm, materials[self.material])
        if self.has_clearance:
            return bending
        shares = self.shares(disks)
        return bending + (shares / (factor * np.array(self.support_stiffness_N_per_mm_power))) @ shares.T

    def problems(self, key: str, disks: int) -> Iterator[Mistake]:
        """Disks beside the supports or in one plane, and a shaft that is no beam; ``key`` is its section."""
        last_plane_mm = self.plane_mm + (disks - 1) * self.disk_pitch_mm
        if disks > 1 and self.disk_pitch_mm == 0:
            yield Mistake(f"{key}.disk_pitch_mm", 0.0, "must be > 0: the disks lie beside each other")
        if last_plane_mm >= self.span_mm:
            yield Mistake(f"{key}.span_mm", self.span_mm, f"must be > {last_plane_mm:g} mm, the plane of the last disk")
        if not SHORTEST * self.diameter_mm <= self.span_mm <= LONGEST * self.diameter_mm:
            requirement = (
                f"must be {SHORTEST * self.diameter_mm:g} to {LONGEST * self.diameter_mm:g} mm, {SHORTEST:g} to "
                f"{LONGEST:g} diameters of the shaft: beyond it is no beam of this theory; correct it, or delete "
                f"[{key}]"
            )
            yield Mistake(f"{key}.span_mm", self.span_mm, requirement)


class Crankshaft(Shaft):
    """Shaft of each crank of a carrier, which also carries a planet.

    The planet's plane lies at `planet_plane_mm`, which may overhang. Without `support_clearance_um` the supports are
    preloaded, and springs alike to both sides; with it each is a ring of rollers of the radial law.
    """

    planet_plane_mm: Annotated[float, Field(ge=-1e4, le=1e4)]
    support_exponent: Annotated[float, Field(ge=1, le=3)] = 1.0
    support_clearance_um: Clearance | None = None

    @property
    def has_clearance(self) -> bool:
        """Whether the supports are rings of rollers in which the shaft moves."""
        return self.support_clearance_um is not None

    def planes(self, disks: int) -> Real:
        """Distances (disks + 1,) [mm] of the disks' planes, and last the planet's, from the first support."""
        return np.append(super().planes(disks), self.planet_plane_mm)

    def problems(self, key: str, disks: int) -> Iterator[Mistake]:
        """Those of a shaft, and a preload of a law that has none."""
        yield from super().problems(key, disks)
        if not self.has_clearance and self.support_exponent != 1:
            requirement = "must be 1 of preloaded supports; add support_clearance_um, 0 of supports that just touch"
            yield Mistake(f"{key}.support_exponent", self.support_exponent, requirement)


@lru_cache
def kept_flexibility(shaft: Crankshaft, disks: int, material: Material, factor: float) -> Real:
    """`Crankshaft.flexibility`, kept."""
    return shaft.flexibility(disks, {shaft.material: material}, factor)


class FirstStage(Section):
    """Sun on the input, held, and a planet on each crank.

    `backlash_um` along the pitch circle is the way of a planet from flank to flank; `mesh_stiffness_N_per_mm` is that
    of one planet's mesh along it. By the pressure angle a mesh also pushes sun and planet apart.
    """

    sun_teeth: Annotated[int, Field(ge=5, le=1000)]
    planet_teeth: Annotated[int, Field(ge=5, le=1000)]
    backlash_um: Clearance
    mesh_stiffness_N_per_mm: Annotated[float, Field(ge=1, le=1e9)]
    pressure_angle_deg: Annotated[float, Field(ge=10, le=35)] = 20.0

    @property
    def planet_share(self) -> float:
        """Radius of a planet's pitch circle over the distance of sun and planet."""
        return self.planet_teeth / (self.sun_teeth + self.planet_teeth)

    def ratio(self, pins: int) -> Fraction:
        """Turns of the sun for one of the carrier, the housing held: cranks turn ``pins`` - 1 times against it."""
        return 1 + Fraction(self.planet_teeth * pins, self.sun_teeth)

    def meshes(self, centres: Complex, interface: int) -> Contacts:
        """Both flanks of each planet on cranks at some centres (n_cranks,) complex [mm] with the sun.

        Notes
        -----
        When the carrier turns by phi, the planet on the held sun has psi = (1 + z1/z2) phi, and
        r2 (psi - (1 + z1/z2) phi) = r2 psi - r_c phi is what the mesh yields to either side.
        """
        crank, flank = np.repeat(np.arange(len(centres)), 2), np.tile([0, 1], len(centres))
        distance = np.abs(centres[crank])
        direction = centres[crank] / distance
        side = 1 - 2 * flank
        return contact_list(
            ("sun", "output"),
            [f"planet {j} flank {k}" for j, k in zip(crank, flank, strict=True)],
            interface=interface,
            face=flank,
            end=crank,
            station=flank,
            gap=0.5e-3 * self.backlash_um,
            point=(1 - self.planet_share) * distance * direction,
            normal=1j * side * direction,
            arm=side * distance,
        )

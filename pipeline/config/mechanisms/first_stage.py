"""Gears before the disks of an RV reducer: a held sun on the input, and a planet on each crank of the carrier."""

from fractions import Fraction
from typing import Annotated

import numpy as np
from pydantic import Field

from pipeline.arrays import Complex
from pipeline.config.files.section import Clearance, Section
from pipeline.model.geometry.contacts import OUTPUT, Contacts


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
        n = 2 * len(centres)
        crank, flank = np.repeat(np.arange(len(centres)), 2), np.tile([0, 1], len(centres))
        distance = np.abs(centres[crank])
        direction = centres[crank] / distance
        side = 1 - 2 * flank
        return Contacts(
            kind=np.full(n, OUTPUT),
            body_a=np.full(n, "sun"),
            body_b=np.full(n, "output"),
            interface=np.full(n, interface),
            face=flank,
            end=crank,
            station=flank,
            hole=np.full(n, -1),
            label=np.array([f"planet {j} flank {k}" for j, k in zip(crank, flank, strict=True)]),
            gap=np.full(n, 0.5e-3 * self.backlash_um),
            two_sided=np.zeros(n, bool),
            per_eccentricity=np.zeros(n),
            curvature=np.zeros(n),
            point=(1 - self.planet_share) * distance * direction,
            normal=1j * side * direction,
            arm=side * distance,
        )

"""The design file: the nominal reducer, its materials, and where each number comes from.

`plausible_range` is what a calibrated number may be: its stated range, or that of its kind.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pipeline.config.designs.flank import FlankSection
from pipeline.config.designs.sections import Cycloid, Operation, Thermal
from pipeline.config.files.section import Clearance, Millimetres, Section, number_at
from pipeline.config.mechanisms import OutputMechanism
from pipeline.config.mechanisms import library as mechanism_library
from pipeline.config.mechanisms.crankshaft import Shaft


class HousingRing(Section):
    """What of the housing bends as a thin ring in its plane, from the pin circle to the outer diameter.

    It is as wide along the axis as `width_mm` says; its mean displacement and rotation are held, and nothing else.
    """

    width_mm: Millimetres
    material: str


class Housing(Section):
    """Ring that holds the pins; rigid without `ring`."""

    outer_diameter_mm: Millimetres
    ring: HousingRing | None = None


class MaterialSection(Section):
    """Isotropic linear elastic material.

    Expansion and the slope of the modulus, relative to it, matter where a study states temperatures.
    """

    # Rubber has 1 MPa, diamond 1.2e6: anything else was typed in another unit.
    youngs_modulus_MPa: Annotated[float, Field(ge=1, le=1.3e6)]
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5)]
    # Invar has 1e-6, polymers up to 2e-4; they lose up to 1 % of their modulus a kelvin, steel 0.03 %.
    expansion_per_K: Annotated[float, Field(ge=0, le=5e-4)] | None = None
    modulus_slope_per_K: Annotated[float, Field(ge=-0.05, le=0.01)] | None = None


class Disk(Section):
    """Cycloid disks: slices of constant thickness, each carried on an input bearing of its own in its bore.

    Their eccentrics share out the turn of the crank evenly, at 0, 360/`count`, ... degrees from its angle. The disks
    hang on one output, so the lobes of disk k stand k/`count` of a lobe's pitch farther clockwise of its holes than
    those of disk 0. `clocking` says how they are made: each with `own_holes`, or as the `same_part`, put in turned by
    some holes, where a turn by whole holes makes up for that share of a lobe.
    """

    material: str
    thickness_mm: Millimetres
    bore_radius_mm: Millimetres
    stress: Literal["plane_stress", "plane_strain"]
    count: Annotated[int, Field(ge=1, le=3)] = 1
    clocking: Literal["own_holes", "same_part"] = "own_holes"


class Pins(Section):
    """Pins in the housing."""

    material: str


class BearingSection(Section):
    """Input bearing between crank and disk: F = K (d - c)^n beyond its radial clearance c, with d in mm."""

    # 1e12 N/mm moves an angstrom under a tonne: rigid; 1e-3 N/mm carries nothing.
    stiffness_N_per_mm_power: Annotated[float, Field(ge=1e-3, le=1e12)]
    # Balls have 3/2, rollers 10/9.
    exponent: Annotated[float, Field(ge=1, le=3)]
    clearance_um: Clearance


if TYPE_CHECKING:
    Output = OutputMechanism
else:
    Output = Annotated[reduce(or_, mechanism_library().values()), Field(discriminator="mechanism")]


class SeriesPart(Section):
    """Part between the reducer and the torque that twists: the carrier's pillars, the housing, the output flange."""

    # A thin plastic shaft has 1e-6, a flange of a metre 1e6.
    stiffness_Nm_per_arcmin: Annotated[float, Field(ge=1e-6, le=1e6)]


class Provenance(Section):
    """Where a number comes from, why it can be trusted or not, and within which values it is plausible.

    `in_sight_of` names published or measured data that a chosen number was picked in sight of: their agreement with the
    design owes something to it, as to a number fitted to them. A calibrated number without `plausible` has the range
    of its kind (``config.designs.plausible_range``).
    """

    status: Literal["published", "given", "chosen", "calibrated"]
    reason: Annotated[str, Field(min_length=1)]
    in_sight_of: Annotated[str, Field(min_length=1)] | None = None
    plausible: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] | None = None


class Design(Section):
    """A nominal one-stage cycloid reducer. Lengths in mm, moduli in MPa, as the names say.

    `input_shaft` carries the eccentrics of a reducer with input bearings, and is rigid where it is left out. `series`
    are parts in series with the output, by names of their own; each stiffness has a provenance.
    `effects` are of the library `pipeline.model.effects`, by name, each with all of its parameters; those of the
    temperature act at `temperature_rise_K` over that of the drawing. `thermal` is no key of a file: it is there where a
    study draws temperatures.
    """

    title: str
    source: str
    cycloid: Cycloid
    housing: Housing
    materials: Annotated[dict[str, MaterialSection], Field(min_length=1)]
    disk: Disk
    pins: Pins
    bearing: BearingSection
    flank: FlankSection | None = None
    input_shaft: Shaft | None = None
    output: Output
    operation: Operation | None = None
    series: dict[str, SeriesPart] = {}
    effects: dict[str, dict[str, float]] = {}
    temperature_rise_K: Annotated[float, Field(ge=-100, le=300)] | None = None
    provenance: dict[str, Provenance] = {}
    thermal: Thermal | None = None

    def with_(self, changes: Mapping[str, Any]) -> "Design":
        """The design with other values at dotted keys, as ``{"disk.thickness_mm": 2.0}``, checked.

        Raises
        ------
        InputError
            With everything that is wrong with the new values.
        """
        from pipeline.config.changing import changed_design  # which needs this class

        return changed_design(self, changes)


DIMENSION = 1.05
"""Factor within which a length lies: also where it stands for a part that is not drawn, nobody builds it 5 % off."""
STIFFNESS = 3.0
"""Factor of a stiffness that was not measured: preload, fit and seat make as much of a bearing's catalogue value."""
METAL_MODULUS, OTHER_MODULUS = 1.1, 1.6
"""Factor of Young's modulus: alloys of a metal differ by some per cent (steel 190 to 215 GPa), polymers by fillers,
moisture and printing."""
METAL_MPA = 40e3
"""Young's modulus above which a material is a metal: magnesium has 45 GPa, filled polymers less than 30."""


@dataclass(frozen=True)
class PlausibleRange:
    """Factors of the declared number between which it is plausible, and why."""

    low: float
    high: float
    reason: str

    @property
    def log(self) -> tuple[float, float]:
        """Logarithms of the factors."""
        return float(np.log(self.low)), float(np.log(self.high))


def range_within(factor: float, reason: str) -> PlausibleRange:
    """The range from a number divided by a factor to the number times it."""
    return PlausibleRange(1 / factor, factor, reason)


def plausible_range(design: Design, key: str) -> PlausibleRange:
    """Range of the number at a dotted key of the design."""
    value, provenance = number_at(design, key), design.provenance.get(key)
    if provenance is not None and provenance.plausible is not None:
        low, high = provenance.plausible
        return PlausibleRange(low / value, high / value, "stated with the number")
    if key.endswith("youngs_modulus_MPa"):
        metal = value >= METAL_MPA
        factor, reason = (METAL_MODULUS, "metals") if metal else (OTHER_MODULUS, "polymers")
        return range_within(factor, f"modulus of {reason}")
    factor, reason = (DIMENSION, "dimension") if key.endswith("_mm") else (STIFFNESS, "stiffness that was not measured")
    return range_within(factor, reason)

"""The design file: the nominal reducer, its materials, and where each number comes from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.cycloid import Cycloid
from pipeline.config.flank import Flank
from pipeline.config.section import Clearance, Millimetres, Section


class Housing(Section):
    """Ring that holds the pins."""

    outer_diameter_mm: Millimetres


class Material(Section):
    """Isotropic linear elastic material."""

    # Rubber has 1 MPa, diamond 1.2e6: anything else was typed in another unit.
    youngs_modulus_MPa: Annotated[float, Field(ge=1, le=1.3e6)]
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5)]


class Disk(Section):
    """Cycloid disk: a slice of constant thickness, carried on the input bearing in its bore."""

    material: str
    thickness_mm: Millimetres
    bore_radius_mm: Millimetres
    stress: Literal["plane_stress", "plane_strain"]


class Pins(Section):
    """Pins in the housing."""

    material: str


class Bearing(Section):
    """Input bearing between crank and disk: F = K (d - c)^n beyond its radial clearance c, with d in mm."""

    # 1e12 N/mm moves an angstrom under a tonne: rigid; 1e-3 N/mm carries nothing.
    stiffness_N_per_mm_power: Annotated[float, Field(ge=1e-3, le=1e12)]
    # Balls have 3/2, rollers 10/9.
    exponent: Annotated[float, Field(ge=1, le=3)]
    clearance_um: Clearance


class RollerPlate(Section):
    """Sliding plate between disk and output, on two crossed tongues with rows of rollers along their faces.

    Each of the two interfaces has two faces at +-`face_offset_mm` from the axis; on each face a row of rollers stands
    at each end of the slide, at stations equally spaced from `outer_station_mm` to `inner_station_mm`.
    """

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
    def interfaces(self) -> int:
        """Disk to plate, and plate to output."""
        return 2

    @property
    def contacts(self) -> int:
        """Output contacts, one for each roller."""
        return self.rollers

    @property
    def contact_name(self) -> str:
        """What one output contact is called."""
        return "output roller"

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact, the roller."""
        return self.roller_radius_mm

    @property
    def material_keys(self) -> tuple[str, ...]:
        """Keys that name materials."""
        return "roller_material", "plate_material"


class PinInHole(Section):
    """Output pins, held in the output flange, in round holes of the disk.

    Pins (about the housing axis) and holes (about the disk's centre) stand on circles of one radius; a hole's radius is
    that of the pin, plus the eccentricity, plus `hole_clearance_um`. Pins are counted clockwise from `phase_deg`, the
    direction of pin 0 at crank angle 0. A pin is as long as the disk is thick; what it bends in the flange is left out.
    """

    mechanism: Literal["pin_in_hole"]
    pins: Annotated[int, Field(ge=3, le=100)]
    pin_radius_mm: Millimetres
    pin_circle_radius_mm: Millimetres
    pin_material: str
    hole_clearance_um: Clearance
    phase_deg: Annotated[float, Field(ge=-360, le=360)]

    @property
    def interfaces(self) -> int:
        """Disk to output."""
        return 1

    @property
    def contacts(self) -> int:
        """Output contacts, one for each output pin."""
        return self.pins

    @property
    def contact_name(self) -> str:
        """What one output contact is called."""
        return "output pin"

    @property
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact, the output pin."""
        return self.pin_radius_mm

    @property
    def material_keys(self) -> tuple[str, ...]:
        """Keys that name materials."""
        return ("pin_material",)

    def hole_radius_mm(self, cycloid: Cycloid) -> float:
        """Radius of the disk's holes [mm]."""
        return self.pin_radius_mm + cycloid.eccentricity_mm + 1e-3 * self.hole_clearance_um


class Provenance(Section):
    """Where a number comes from, why it can be trusted or not, and within which values it is plausible.

    `in_sight_of` names published or measured data that a chosen number was picked in sight of: their agreement with the
    design owes something to it, as to a number fitted to them. A calibrated number without `plausible` has the range
    of its kind (``identification.fitting.plausible_range``).
    """

    status: Literal["published", "given", "chosen", "calibrated"]
    reason: Annotated[str, Field(min_length=1)]
    in_sight_of: Annotated[str, Field(min_length=1)] | None = None
    plausible: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] | None = None


class Design(Section):
    """A nominal one-stage cycloid reducer. Lengths in mm, moduli in MPa, as the names say.

    `effects` are of the library `pipeline.model.effects`, by name, each with all of its parameters.
    """

    title: str
    source: str
    cycloid: Cycloid
    housing: Housing
    materials: Annotated[dict[str, Material], Field(min_length=1)]
    disk: Disk
    pins: Pins
    bearing: Bearing
    flank: Flank | None = None
    output: Annotated[RollerPlate | PinInHole, Field(discriminator="mechanism")]
    effects: dict[str, dict[str, float]] = {}
    provenance: dict[str, Provenance] = {}

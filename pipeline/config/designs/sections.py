"""Sections of a design: the cycloid stage, how the reducer runs, and what its parts do whose temperatures are drawn."""

from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from pipeline.arrays import Real
from pipeline.config.files.section import Millimetres, Section


class Cycloid(Section):
    """Cycloid stage: ring of pins and disks with `pins - 1` lobes.

    The `fixed` body is the housing or the flange of the output mechanism; the other one is the output. The rated torque
    is the output's.
    """

    pins: Annotated[int, Field(ge=4, le=1000)]
    pin_radius_mm: Millimetres
    pin_circle_radius_mm: Millimetres
    eccentricity_mm: Millimetres
    # From a watch to a wind turbine.
    rated_torque_Nm: Annotated[float, Field(ge=1e-6, le=1e7)]
    fixed: Literal["housing", "flange"] = "housing"

    @property
    def lobes(self) -> int:
        """Number of lobes of a disk."""
        return self.pins - 1

    @property
    def ratio(self) -> int:
        """Turns of the crank for one of the output: of the flange against the crank, or of the housing with it."""
        return self.lobes if self.fixed == "housing" else self.pins

    @property
    def torque_ratio(self) -> int:
        """Torque on the output per torque that the eccentrics take from the crank, both in one sense of rotation."""
        return self.lobes if self.fixed == "housing" else -self.pins

    @property
    def root_radius_mm(self) -> float:
        """Radius of the disk at the roots of its lobes: pin circle less eccentricity less pin."""
        return self.pin_circle_radius_mm - self.eccentricity_mm - self.pin_radius_mm


Coefficient = Annotated[float, Field(ge=0, le=0.5)]


class FrictionSection(Section):
    """Coefficients of friction while running: of pins and output pins where they slide, of the disks' bearings.

    `output_coefficient` is asked for where output pins slide in holes, or bushes on them. A bearing's friction torque
    is half of its coefficient times its force times `bearing_bore_mm`.
    """

    pin_coefficient: Coefficient
    output_coefficient: Coefficient | None = None
    bearing_coefficient: Coefficient
    bearing_bore_mm: Millimetres


class Rating(Section):
    """Basic dynamic load rating of a disk's bearing, on the input or on a crank, from its maker."""

    kind: Literal["ball", "roller"]
    # From a watch to a wind turbine.
    dynamic_load_N: Annotated[float, Field(ge=1, le=1e8)]

    @property
    def exponent(self) -> float:
        """Of the life over the load (ISO 281:2007, 5.3 and 7.3)."""
        return 3.0 if self.kind == "ball" else 10.0 / 3.0


class Operation(Section):
    """Speed of the input, what the pins do under the flank, friction and the bearing's rating where they are known.

    Pins that are `fixed` slide on the flank; `rolling` ones roll on it and slide in their seats. `output_pins` likewise
    of output pins in holes; bushes roll there and slide on their pins, the rollers of a plate roll.
    """

    input_speed_rpm: Annotated[float, Field(gt=0, le=1e6)]
    pins: Literal["fixed", "rolling"]
    output_pins: Literal["fixed", "rolling"] = "fixed"
    friction: FrictionSection | None = None
    rating: Rating | None = None


Number = TypeVar("Number", float, Real)
CHANGED_BY = {"pin_radial": "housing", "pin_radius": "pins", "eccentricity": "crank"}
"""Deviation of a unit and the part whose growth beyond the disk's changes it."""


class ThermalPart(Section):
    """A part at its mean temperature.

    Attributes
    ----------
    follows : the part whose temperature it has: its own name, or that of another whose draw it shares.
    size_um : length by whose growth a draw is told [um].
    expansion_per_K, slope_per_K : of its size and of its modulus, relative to those of the drawing.
    rise_K : its mean temperature less that of the drawing.
    """

    follows: str
    size_um: float
    expansion_per_K: float
    slope_per_K: float
    rise_K: float

    def growth_um(self, warmer: Number) -> Number:
        """Growth of the size [um] by a temperature above the mean [K]."""
        return self.size_um * self.expansion_per_K * warmer

    def factor(self, warmer: Number) -> Number:
        """Size over that on the drawing."""
        return 1 + self.expansion_per_K * (self.rise_K + warmer)

    def softening(self, warmer: Number) -> Number:
        """Modulus over that at the mean temperature."""
        return 1 + self.slope_per_K * warmer / (1 + self.slope_per_K * self.rise_K)


class Thermal(Section):
    """The four parts `disk`, `pins`, `housing` and `crank` of a design at mean temperatures.

    Attributes
    ----------
    drawn_parts : parts whose temperature is drawn.
    """

    drawn_parts: tuple[str, ...]
    parts: dict[str, ThermalPart]

    def warmer(self, growth_um: Mapping[str, Real]) -> dict[str, Real]:
        """Temperature of each part above its mean (n,) [K], by the growths (n,) [um] of those that are drawn."""
        zeros = np.zeros_like(next(iter(growth_um.values())))
        rises = {part: growth / self.parts[part].growth_um(1.0) for part, growth in growth_um.items()}
        return {name: rises.get(part.follows, zeros) for name, part in self.parts.items()}

    def shifts_um(self, growth_um: Mapping[str, Real]) -> dict[str, Real]:
        """What units (n,) deviate more from the reducer that has grown as their disk has [um], by deviation.

        Notes
        -----
        A reducer that grows by one factor in all lengths keeps its angles. So the disk's size is the unit of length,
        and the others grow by their factor over the disk's. That the tolerances themselves grow is left out: it is
        their size times the expansion.
        """
        warmer = self.warmer(growth_um)
        disk = self.parts["disk"]
        shifts = {}
        for deviation, name in CHANGED_BY.items():
            part = self.parts[name]
            ratio = part.factor(warmer[name]) / disk.factor(warmer["disk"])
            shifts[deviation] = part.size_um * (ratio - part.factor(0.0) / disk.factor(0.0))
        return shifts

    def modulus(self, growth_um: Mapping[str, Real]) -> Real:
        """Torque (n,) that turns the reducer as far as a torque of 1 does at mean temperatures.

        Notes
        -----
        By similarity: in the disk's unit of length forces grow with the modulus and the square of its factor of
        growth, and their arms with the factor itself. All elastic parts soften as the disk does.
        """
        disk, warmer = self.parts["disk"], self.warmer(growth_um)["disk"]
        return np.asarray(disk.softening(warmer) * (disk.factor(warmer) / disk.factor(0.0)) ** 3)

"""How the reducer runs: what sliding, the life of its bearings and its efficiency need beyond the drawing."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.files.section import Millimetres, Section

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

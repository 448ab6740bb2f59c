"""The cycloid stage of a design: pins, eccentricity and torque."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

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

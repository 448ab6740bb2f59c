"""The cycloid stage of a design: pins, eccentricity and torque."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline.config.section import Millimetres, Section


class Cycloid(Section):
    """Cycloid stage: ring of pins and one disk with `pins - 1` lobes."""

    pins: Annotated[int, Field(ge=4, le=1000)]
    pin_radius_mm: Millimetres
    pin_circle_radius_mm: Millimetres
    eccentricity_mm: Millimetres
    # From a watch to a wind turbine.
    rated_torque_Nm: Annotated[float, Field(ge=1e-6, le=1e7)]

    @property
    def lobes(self) -> int:
        """Number of lobes of the disk, which is also the reduction ratio."""
        return self.pins - 1

    @property
    def root_radius_mm(self) -> float:
        """Radius of the disk at the roots of its lobes: pin circle less eccentricity less pin."""
        return self.pin_circle_radius_mm - self.eccentricity_mm - self.pin_radius_mm

"""Distributions of a position in a circular zone: uniform over the disc, and normal."""

from collections.abc import Callable, Iterator
from typing import ClassVar, Literal

import numpy as np

from pipeline.arrays import Real
from pipeline.config.distributions.distribution import Distribution
from pipeline.config.files.section import Clearance


class InDisc(Distribution):
    """A point in a disc of the radius `radius_um`, half of the zone's diameter."""

    lowest_key: ClassVar[str] = "radius_um"
    in_disc: ClassVar[bool] = True

    radius_um: Clearance

    @property
    def limits_um(self) -> tuple[float, float]:
        """Least and largest way from the centre [um]."""
        return 0.0, self.radius_um

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """The zone as a drawing has it."""
        yield f"zone of diameter {number_text(2 * self.radius_um)} µm"


ZONE_IN_SIGMA = 3.0
"""Radius of the zone over the standard deviation of either coordinate, as of limits at 3 sigma."""


class NormalInDisc(InDisc):
    """Normal in both coordinates with the zone's radius at 3 sigma, and truncated there."""

    distribution: Literal["normal_in_disc"]

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function (Rayleigh's, truncated) of the way at `probability` (any shape) [um]."""
        zone_share = -np.expm1(-0.5 * ZONE_IN_SIGMA**2)
        return self.radius_um / ZONE_IN_SIGMA * np.sqrt(-2 * np.log1p(-zone_share * probability))

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """The zone and the standard deviation of a coordinate."""
        yield from super().details(number_text)
        yield f"σ {self.radius_um / ZONE_IN_SIGMA:.3g} µm of either coordinate"


class UniformInDisc(InDisc):
    """Every point of a circular zone equally likely."""

    distribution: Literal["uniform_in_disc"]

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function of the way from the centre at `probability` (any shape) [um]."""
        return self.radius_um * np.sqrt(probability)


DISTRIBUTIONS = (NormalInDisc, UniformInDisc)

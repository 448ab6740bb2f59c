"""Normal distribution in the plane, truncated at a circular zone."""

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np

from pipeline.config.distributions._in_disc import InDisc
from pipeline.config.distributions.distribution import Real

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


DISTRIBUTION = NormalInDisc

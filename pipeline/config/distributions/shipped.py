"""Distributions of one deviation between its limits: fixed, uniform, triangular, truncated normal; in a zone.

A position in a circular zone is uniform over the disc, or normal.
"""

from collections.abc import Callable, Iterator
from typing import ClassVar, Literal

import numpy as np

from pipeline.arrays import Real
from pipeline.config.distributions.distribution import Distribution, Spread
from pipeline.config.files.section import Clearance, Micrometres


class Fixed(Distribution):
    """The same deviation in every sample."""

    varies: ClassVar[bool] = False
    lowest_key: ClassVar[str] = "value_um"

    distribution: Literal["fixed"]
    value_um: Micrometres

    @property
    def limits_um(self) -> tuple[float, float]:
        """Lower and upper limit of the deviation [um]."""
        return self.value_um, self.value_um

    def deviation(self, probability: Real) -> Real:
        """The value, in the shape of `probability` [um]."""
        return np.full_like(probability, self.value_um)


class Normal(Spread):
    """Normal distribution truncated at the limits; unless stated, centred between them with limits at 3 sigma."""

    within_limits: ClassVar[tuple[str, ...]] = ("mean_um",)

    distribution: Literal["normal"]
    sigma_um: Clearance | None = None
    mean_um: Micrometres | None = None

    @property
    def location_um(self) -> float:
        """Mean before truncation [um]."""
        return self.middle_um if self.mean_um is None else self.mean_um

    @property
    def scale_um(self) -> float:
        """Standard deviation before truncation [um]."""
        return (self.upper_um - self.lower_um) / 6 if self.sigma_um is None else self.sigma_um

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function at `probability` (any shape) [um]."""
        from scipy.special import ndtr, ndtri  # slow to import, and reading a study draws nothing

        location, scale, limits = self.location_um, self.scale_um, np.array(self.limits_um)
        if scale == 0:
            return np.full_like(probability, location)
        low_share, high_share = ndtr((limits - location) / scale)
        deviation: Real = np.clip(location + scale * ndtri(low_share + (high_share - low_share) * probability), *limits)
        return deviation

    def density(self, deviation: Real) -> Real:
        """Probability density [1/um] at deviations (any shape) [um]."""
        from scipy.special import ndtr  # slow to import, and reading a study draws nothing

        location, scale, (lower, upper) = self.location_um, self.scale_um, self.limits_um
        if scale == 0:
            return super().density(deviation)
        low_share, high_share = ndtr((np.array([lower, upper]) - location) / scale)
        bell = np.exp(-0.5 * ((deviation - location) / scale) ** 2) / (
            np.sqrt(2 * np.pi) * scale * (high_share - low_share)
        )
        return np.where((deviation >= lower) & (deviation <= upper), bell, 0.0)

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """Standard deviation, and the mean where it is stated."""
        yield f"σ {self.scale_um:.3g} µm, truncated at the limits"
        if self.mean_um is not None:
            yield f"mean {number_text(self.mean_um)} µm"
        yield from super().details(number_text)


class Triangular(Spread):
    """Density rising from the lower limit to the mode and falling to the upper limit."""

    within_limits: ClassVar[tuple[str, ...]] = ("mode_um",)

    distribution: Literal["triangular"]
    mode_um: Micrometres | None = None

    @property
    def peak_um(self) -> float:
        """Most likely deviation [um]."""
        return self.middle_um if self.mode_um is None else self.mode_um

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function at `probability` (any shape) [um]."""
        (lower, upper), peak = self.limits_um, self.peak_um
        width = upper - lower
        rising = lower + np.sqrt(width * (peak - lower) * probability)
        falling = upper - np.sqrt(width * (upper - peak) * (1 - probability))
        return np.where(probability * width < peak - lower, rising, falling)

    def density(self, deviation: Real) -> Real:
        """Probability density [1/um] at deviations (any shape) [um]."""
        (lower, upper), peak = self.limits_um, self.peak_um
        top = 2 / (upper - lower)
        sides = [
            np.divide(top * distance, width, out=np.full_like(distance, top), where=width > 0)
            for distance, width in ((deviation - lower, peak - lower), (upper - deviation, upper - peak))
        ]
        return np.where((deviation >= lower) & (deviation <= upper), np.minimum(*sides), 0.0)

    def details(self, number_text: Callable[[float], str]) -> Iterator[str]:
        """The mode."""
        yield f"mode {number_text(self.peak_um)} µm"
        yield from super().details(number_text)


class Uniform(Spread):
    """Every deviation between the limits equally likely."""

    distribution: Literal["uniform"]

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function at `probability` (any shape) [um]."""
        lower, upper = self.limits_um
        return lower + (upper - lower) * probability

    def density(self, deviation: Real) -> Real:
        """Probability density [1/um] at deviations (any shape) [um]."""
        lower, upper = self.limits_um
        return np.where((deviation >= lower) & (deviation <= upper), 1 / (upper - lower), 0.0)


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
        deviation: Real = self.radius_um / ZONE_IN_SIGMA * np.sqrt(-2 * np.log1p(-zone_share * probability))
        return deviation

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


DISTRIBUTIONS = (Fixed, Normal, Triangular, Uniform, NormalInDisc, UniformInDisc)

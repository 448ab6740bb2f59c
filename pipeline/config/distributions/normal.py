"""Normal distribution truncated at the limits."""

from collections.abc import Callable, Iterator
from typing import ClassVar, Literal

import numpy as np

from pipeline.config.distributions.distribution import Real, Spread
from pipeline.config.files.section import Clearance, Micrometres


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
        return np.clip(location + scale * ndtri(low_share + (high_share - low_share) * probability), *limits)

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


DISTRIBUTION = Normal

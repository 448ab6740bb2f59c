"""Density rising from the lower limit to the mode and falling to the upper limit."""

from collections.abc import Callable, Iterator
from typing import ClassVar, Literal

import numpy as np

from pipeline.config.distributions.distribution import Real, Spread
from pipeline.config.files.section import Micrometres


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


DISTRIBUTION = Triangular

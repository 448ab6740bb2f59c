"""Every deviation between the limits equally likely."""

from typing import Literal

import numpy as np

from pipeline.config.distributions.distribution import Real, Spread


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


DISTRIBUTION = Uniform

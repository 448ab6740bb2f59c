"""Every deviation between the limits equally likely."""

from typing import Literal

from pipeline.config.distributions.distribution import Real, Spread


class Uniform(Spread):
    """Every deviation between the limits equally likely."""

    distribution: Literal["uniform"]

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function at `probability` (any shape) [um]."""
        lower, upper = self.limits_um
        return lower + (upper - lower) * probability


DISTRIBUTION = Uniform

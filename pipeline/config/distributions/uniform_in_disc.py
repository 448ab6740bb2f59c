"""Every point of a circular zone equally likely."""

from typing import Literal

import numpy as np

from pipeline.config.distributions._in_disc import InDisc
from pipeline.config.distributions.distribution import Real


class UniformInDisc(InDisc):
    """Every point of a circular zone equally likely."""

    distribution: Literal["uniform_in_disc"]

    def deviation(self, probability: Real) -> Real:
        """Inverse distribution function of the way from the centre at `probability` (any shape) [um]."""
        return self.radius_um * np.sqrt(probability)


DISTRIBUTION = UniformInDisc

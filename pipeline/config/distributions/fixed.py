"""The same deviation in every sample."""

from typing import ClassVar, Literal

import numpy as np

from pipeline.config.distributions.distribution import Distribution, Real
from pipeline.config.files.section import Micrometres


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


DISTRIBUTION = Fixed

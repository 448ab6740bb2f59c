"""Play in series with the output that is taken up little by little."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.model.elements.element import Spring


@dataclass(frozen=True)
class RoundedPlay(Spring):
    """Gaps that close one after the other: twist = half sign(T) (1 - exp(-|T| / knee)).

    Attributes
    ----------
    half : of the play.
    knee : torque over which it is taken up, but for a share of 1/e; towards 0 it is a dead zone.

    Source
    ------
    Gaps whose closing torques are distributed exponentially; of a single gap the dead zone of Nordin and Gutman,
    Automatica 38 (2002) 1633.
    """

    half: float
    knee: float

    def twist(self, torque: Real) -> Real:
        """Rotation, in the unit of ``half``, under torques of any shape."""
        return np.copysign(self.half * -np.expm1(-np.abs(torque) / self.knee), torque)

    def energy(self, torque: Real) -> Real:
        """The integral of the twist over torques of any shape, in closed form."""
        size = np.abs(torque)
        return self.half * (size + self.knee * np.expm1(-size / self.knee))

"""What a fit seeks, and what it found: unknowns within their bounds, a prediction at them, and a fitted model."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Rounding
from pipeline.identification.fitting.problem import LIMIT, Model

SCALE_REACH = 4.4
"""Largest change of the logarithm of a scale that is not held to its range: a factor of 80."""
AT_END: Rounding = 1e-3
"""Share of its reach from an end at which a scale stands there."""
WIDE = 30.0
"""Ratio of positive bounds beyond which a parameter is fitted by its logarithm."""


@dataclass(frozen=True)
class Vector:
    """Unknowns of a fit: logarithms of scales, parameters as shares of their bounds in [0, 1], modes.

    ``reach`` holds the least and the largest logarithm of each scale (2, n_scales), or of all.
    """

    scales: Real
    shares: Real
    modes: Real
    reach: Real = field(default_factory=lambda: np.array([[-SCALE_REACH], [SCALE_REACH]]), compare=False)

    @property
    def flat(self) -> Real:
        return np.concatenate([self.scales, self.shares, self.modes])

    def like(self, flat: Real) -> "Vector":
        """The flat vector (n_unknowns,), held to its bounds."""
        first_share, first_mode = len(self.scales), len(self.scales) + len(self.shares)
        scales, shares, modes = flat[:first_share], flat[first_share:first_mode], flat[first_mode:]
        return Vector(
            np.clip(scales, *self.reach), np.clip(shares, 0.0, 1.0), np.clip(modes, -LIMIT, LIMIT), self.reach
        )

    def with_shares(self, shares: Real) -> "Vector":
        """The same with shares of further parameters (n_further,) behind its own."""
        return replace(self, shares=np.concatenate([self.shares, shares]))

    @property
    def at_reach(self) -> Truth:
        """Scales (n_scales,) that stand at an end of their reach."""
        low, high = self.reach
        at_reach: Truth = (self.scales <= low + AT_END * (high - low)) | (self.scales >= high - AT_END * (high - low))
        return at_reach

    @property
    def room(self) -> tuple[Real, Real]:
        """Least and largest step to the bounds, each (n_unknowns,)."""
        no_bounds = np.full(len(self.flat), np.inf)
        return self.like(-no_bounds).flat - self.flat, self.like(no_bounds).flat - self.flat

    def is_free(self, gradient: Real) -> Truth:
        """Unknowns (n_unknowns,) that do not stand at a bound that the gradient of a descent pushes against."""
        reach = self.flat + np.sign(gradient) * 1e-9
        moves: Truth = self.like(reach).flat != self.flat
        return moves


class Prediction(NamedTuple):
    """What a model says of the cells; NaN at positions that were not asked for.

    Attributes
    ----------
    angle : (n_cells,) without offsets [arcmin].
    influence : of the modes (n_cells, n_modes) [arcmin], zeros unless asked for.
    carried_torque : (n_cells,) torque in the reducer [N mm].
    slope : (n_cells,) d angle / d torque [arcmin/(N m)].
    response : (n_cells,) change of the angle for a change of the drive's own angle: 1 but where a ripple answers it.
    balances : (n_cells,) angles at which drive and ripple are in balance at one torque, in the mean over its phases.
    sound : whether nearly every equilibrium was found.
    is_in_range : whether a crank that turns stays between the angles at which drives were made. A search may pass
        through predictions where it does not; a fit that ends at one is not sound.
    """

    angle: Real
    influence: Real
    carried_torque: Real
    slope: Real
    response: Real
    balances: Real
    sound: bool
    is_in_range: bool = True


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : its effects.
    unknowns : at the least sum of squares.
    values : (n_parameters,) of the effects, in their units.
    predicted_angle : (n_cells,) [arcmin] of all cells, offsets included; NaN at positions that were not asked for.
    cost : sum of squares over the cells fitted, in units of their sigma, priors included.
    jacobian : (n_cells, n_unknowns) [arcmin], offsets removed within the cells fitted.
    sigma : (n_cells,) [arcmin] by which the cells were weighted: their noise, and what the form of the model misses.
    balances : (n_cells,) of the prediction, of which the nearest to each angle was taken.
    sound : whether nearly every equilibrium was found, and a crank that turns stays where drives were made.
    """

    model: Model
    unknowns: Vector
    values: Real
    predicted_angle: Real
    cost: float
    jacobian: Real
    sigma: Real
    balances: Real
    sound: bool


def values_at_shares(bounds: Sequence[tuple[float, float]], shares: Real) -> Real:
    """Parameters at shares of their bounds, even in the logarithm where these are positive and far apart."""
    return np.array(
        [
            low * (high / low) ** share if low > 0 and high / low > WIDE else low + share * (high - low)
            for (low, high), share in zip(bounds, shares, strict=True)
        ]
    )


def shares_of_zero(bounds: Sequence[tuple[float, float]], elsewhere: Sequence[float] | Real) -> Real:
    """Shares (n_parameters,) of the bounds at which parameters are zero; ``elsewhere`` of those that cannot be."""
    pairs = zip(bounds, elsewhere, strict=True)
    return np.array([-low / (high - low) if low <= 0 <= high else share for (low, high), share in pairs])


def shares_of_values(bounds: Sequence[tuple[float, float]], values: Sequence[float]) -> Real:
    """Shares of the bounds at which parameters stand; inverse of ``values_at_shares``."""
    return np.array(
        [
            np.log(value / low) / np.log(high / low) if low > 0 and high / low > WIDE else (value - low) / (high - low)
            for (low, high), value in zip(bounds, values, strict=True)
        ]
    )

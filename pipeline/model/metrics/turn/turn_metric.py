"""What a metric of a whole turn is, what it is read from, and the library of all."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pipeline.arrays import Complex, Real, Truth
from pipeline.model.metrics.metric import Limited
from pipeline.registry import TURN_METRICS

FEWEST_ANGLES = 8
"""Crank angles, evenly over the turn, from which a peak to peak says anything of it."""


LARGEST_IMBALANCE = 0.05
"""Share of the input's torque, in the mean over the turn, that may be missing from the forces on its bearings."""
TURN, BALANCE, SPEED, RATING, FRICTION = "turn", "balance", "speed", "rating", "friction"
NEEDS = {
    TURN: f"{FEWEST_ANGLES} crank angles evenly over the turn or more",
    BALANCE: "forces on the disks' bearings that balance the torque on the output over the ratio within "
    f"{100 * LARGEST_IMBALANCE:g} %",
    SPEED: "the speed of the input ([operation] input_speed_rpm of the design)",
    RATING: "the load rating of a bearing of the disks ([operation.rating] of the design), at least twice the load",
    FRICTION: "coefficients of friction ([operation.friction] of the design) by which less than a fifth of the input "
    "is lost",
}
"""What metrics of a turn may need, in words."""


@dataclass(frozen=True)
class RunningConditions:
    """How the reducer runs while the torque is held; missing what the design does not state.

    Attributes
    ----------
    bearing_speed_rpm : of the rings of a disk's bearing, one against the other.
    output_power_W : what the output gives.
    bearing_friction_mm : friction torque of a disk's bearing over its force.
    load_rating_N, life_exponent : basic dynamic load rating of a disk's bearing, exponent of its life.
    """

    bearing_speed_rpm: float = np.nan
    output_power_W: float = np.nan
    bearing_friction_mm: float = np.nan
    load_rating_N: float = np.nan
    life_exponent: float = np.nan


@dataclass(frozen=True)
class TurnReadings:
    """What the metrics of a turn are read from: ``n`` units, both senses of the torque (+, -) on the second axis.

    Attributes
    ----------
    loaded_angle : (n, 2, n_angles) [arcmin] of the output under the torque held, from its nominal position; missing
        where the unit has no result.
    free_angle : (n, 2, n_rigid_angles) [arcmin] of the output at the end of its play in that sense, likewise.
    bearing_force : (n, 2, n_angles, n_bearings) complex [N], of the disks on their bearings under the torque held.
    input_share : (n, 2, n_angles) torque on the cranks that those forces need, over the output's over the ratio.
    pressure_speed : (n, n_angles) [MPa m/s] largest of any contact, both senses; missing where no speed is stated.
    shear : (n, n_angles) [MPa] largest shear stress below any contact.
    shear_depth : (n, n_angles) [um] depth of that stress, of the contact in which it lies deepest.
    friction_power : (n, 2, n_angles) [W] of all contacts; missing where no friction is named.
    conditions : of all units alike.
    loaded_even : (n_angles,) which of the loaded angles stand evenly over the turn; none of them where they do not.
    free_even : (n_rigid_angles,) which angles of the play do.
    """

    loaded_angle: Real
    free_angle: Real
    bearing_force: Complex
    input_share: Real
    pressure_speed: Real
    shear: Real
    shear_depth: Real
    friction_power: Real
    conditions: RunningConditions
    loaded_even: Truth
    free_even: Truth

    @property
    def is_balanced(self) -> Truth:
        """(n,) whether the forces on the bearings balance the torque on the output."""
        balanced: Truth = np.all(np.abs(np.mean(self.input_share, axis=2) - 1) <= LARGEST_IMBALANCE, axis=1)
        return balanced

    def with_stride(self, stride: int) -> "TurnReadings":
        """The readings at every so many of the even angles."""
        loaded_angles = np.flatnonzero(self.loaded_even)[::stride]
        free_angles = np.flatnonzero(self.free_even)[::stride]
        return replace(
            self,
            loaded_angle=self.loaded_angle[..., loaded_angles],
            free_angle=self.free_angle[..., free_angles],
            bearing_force=self.bearing_force[:, :, loaded_angles],
            input_share=self.input_share[..., loaded_angles],
            pressure_speed=self.pressure_speed[:, loaded_angles],
            shear=self.shear[:, loaded_angles],
            shear_depth=self.shear_depth[:, loaded_angles],
            friction_power=self.friction_power[..., loaded_angles],
            loaded_even=self.loaded_even[loaded_angles],
            free_even=self.free_even[free_angles],
        )


@dataclass(frozen=True, kw_only=True)
class TurnMetric(Limited):
    """One number of a unit over the whole turn, at the torque held: ``{rigidity_high}`` of its definition [N m].

    Attributes
    ----------
    value : readings of ``n`` units to the metric (n,); missing where the unit has no result.
    of_play : whether it is read from the play, at the crank angles of rigid bodies, instead of the loaded ones.
    needs : what it says nothing without, of ``NEEDS``.
    angles : readings of a loop whose range over the turn it is, of each sense; none of another metric. The range over
        all pitches of the turn is known of the units that are solved there.
    """

    value: Callable[[TurnReadings], Real]
    of_play: bool = False
    needs: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()

    def metric_values(self, readings: TurnReadings) -> Real:
        """The metric (n,) of readings, missing where a unit has not what it needs."""
        even_angles = readings.free_even if self.of_play else readings.loaded_even
        if TURN in self.needs and np.count_nonzero(even_angles) < FEWEST_ANGLES:
            return np.full(len(readings.loaded_angle), np.nan)
        if BALANCE in self.needs:
            return np.where(readings.is_balanced, self.value(readings), np.nan)
        return self.value(readings)


def peak_to_peak(angle: Real) -> Real:
    """The larger of both senses' peak to peak (n,) [arcsec] of angles (n, 2, n_angles) [arcmin]."""
    range_of_angle: Real = 60.0 * np.max(np.max(angle, axis=2) - np.min(angle, axis=2), axis=1)
    return range_of_angle


READ_AT = {
    ("high_plus", "high_minus"): "torsional_rigidity_Nm_per_arcmin",
    ("limit_plus", "limit_minus"): "clearance_backlash_arcmin",
}
"""Angles of a loop in both senses, under the torque held and at the ends of the play, and the metric that is read there
too: where it holds, so do they."""


@cache
def turn_library() -> Mapping[str, TurnMetric]:
    """All metrics of a turn by name, in their order: the files beside this one and what packages register."""
    metrics = TURN_METRICS.declarations()
    return dict(sorted(metrics.items(), key=lambda item: item[1].rank))

"""What a metric is, what of a loop it is read from, and the library of all."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache, cached_property

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.errors import InputError
from pipeline.registry import METRICS

WHOLE_TURN = "whole_turn"
"""What estimates for the whole turn are over in tables: the worst that was found, corrected by the audited units."""
CONTINUOUS_TURN = "continuous_turn"
"""What bounds for all angles between the pitches and their phases are over."""


@dataclass(frozen=True)
class Definitions:
    """Torques [N m] at which a loop is read: of the lost motion, and the two between which rigidity is taken."""

    lost_motion: float
    rigidity_low: float
    rigidity_high: float


@dataclass(frozen=True)
class LoopReadings:
    """What the metrics of ``n`` loops 0 -> +T -> -T -> +T are read from; angles of the output (n,) [arcmin].

    Attributes
    ----------
    limit_minus, limit_plus : without friction, in the limits T -> 0- and T -> 0+.
    zero_falling, zero_rising : at T = 0 on the way down from +T and up from -T.
    lost_motion_minus, lost_motion_plus : of the loop's centre line at -+ the torque of the lost motion.
    low_minus, high_minus : on the way to -T, at the lower and the higher torque of the rigidity.
    low_plus, high_plus : on the way back to +T, at the same torques.
    peak_pressure : (n,) [MPa] largest Hertz pressure of any contact at any torque.
    load_share : (n,) largest share of a disk in the higher torque of the rigidity, in either sense; 1 of one disk.
    """

    limit_minus: Real
    limit_plus: Real
    zero_falling: Real
    zero_rising: Real
    lost_motion_minus: Real
    lost_motion_plus: Real
    low_minus: Real
    high_minus: Real
    low_plus: Real
    high_plus: Real
    peak_pressure: Real
    load_share: Real

    @classmethod
    def from_bench(cls, **readings: Real) -> "LoopReadings":
        """Readings of ``n`` loops on a bench (n,), by name; what no bench reads is NaN."""
        missing = np.full(len(readings["zero_falling"]), np.nan)
        return cls(**{field.name: readings.get(field.name, missing) for field in fields(cls)})


ON_A_BENCH = frozenset(
    {
        "zero_falling",
        "zero_rising",
        "lost_motion_minus",
        "lost_motion_plus",
        "low_minus",
        "high_minus",
        "low_plus",
        "high_plus",
    }
)
"""The readings that a measured loop has."""


DIGITS = 3
"""Digits of a number that people read: more are told by no study."""


@dataclass(frozen=True)
class Quantity:
    """Name, unit and digits after the point of a number that people read."""

    title: str
    unit: str
    decimals: int

    @property
    def inline(self) -> str:
        """The title inside a sentence."""
        return self.title[0].lower() + self.title[1:]

    @property
    def axis(self) -> str:
        """Label of an axis; a pure number has no unit there."""
        return self.title if self.unit == "1" else f"{self.title} ({self.unit})"

    def text(self, value: float) -> str:
        """The value without the unit: three digits, more only before the point; at most its digits after the point."""
        before_point = math.floor(math.log10(abs(value))) + 1 if math.isfinite(value) and abs(value) >= 1 else 0
        return signed_number(value, min(self.decimals, max(DIGITS - before_point, 0)))


@dataclass(frozen=True, kw_only=True)
class Limited(Quantity):
    """A number that a limit may be set for.

    Attributes
    ----------
    name : of its column, with its unit.
    definition : one sentence, with ``{lost_motion}``, ``{rigidity_low}``, ``{rigidity_high}`` for torques [N m].
    rank : place among its like in tables and pages, ascending.
    smaller_is_worse : whether its limit is a lower one.
    """

    name: str
    definition: str
    rank: int
    smaller_is_worse: bool = False

    def keeps(self, value: Real, limit: float) -> Truth:
        """Whether values (n,) keep a limit; a missing value keeps none."""
        return value >= limit if self.smaller_is_worse else value <= limit


@dataclass(frozen=True, kw_only=True)
class Metric(Limited):
    """A number read off a loop.

    Attributes
    ----------
    value : readings of ``n`` loops and definitions to the metric (n,).
    headline : whether the page leads with it.
    needs_friction : whether it says nothing new of a loop without friction.
    needs_disks : whether it says nothing of a reducer with one disk.
    turn_of_rigid_bodies : whether rigid bodies tell it at crank angles that are not loaded.
    largest_torque : definitions to the largest torque [N m] that it is read at: rotations up to there must be small.
    moves_at : definitions to a torque [N m] at which friction must let the output move, or None.
    not_negative : whether a value below zero says that friction holds the output within its play.
    """

    value: Callable[[LoopReadings, Definitions], Real]
    headline: bool = False
    needs_friction: bool = False
    needs_disks: bool = False
    turn_of_rigid_bodies: bool = False
    largest_torque: Callable[[Definitions], float] = lambda _: np.inf
    moves_at: Callable[[Definitions], float] | None = None
    not_negative: bool = False

    def values(self, readings: LoopReadings, definitions: Definitions) -> Real:
        """The metric (n,) of ``n`` loops.

        Raises
        ------
        InputError
            If the function of a metric, which another package may have registered, does not give one number a loop.
        """
        values = np.asarray(self.value(readings, definitions))
        if values.shape != readings.limit_plus.shape:
            raise InputError(
                f"metric {self.name}: its value has the shape {values.shape} for {len(readings.limit_plus)} loops; "
                "it must give one number for each loop"
            )
        return values

    @cached_property
    def measurable(self) -> bool:
        """Whether a measured loop has all that the metric is read from."""
        some = LoopReadings.from_bench(**{name: np.array([k**2 + 1.0]) for k, name in enumerate(sorted(ON_A_BENCH))})
        return bool(np.isfinite(self.value(some, Definitions(1.0, 2.0, 4.0))[0]))

    @property
    def valid_column(self) -> str:
        """Column that says whether the number means what its definition says."""
        return f"{self.name}_valid"

    def over_turn(self, values: Real) -> tuple[Real, Real]:
        """The worst and the best (n,) of values (n, n_angles) over the turn; missing where any is missing."""
        lowest, highest = values.min(axis=1), values.max(axis=1)
        return (lowest, highest) if self.smaller_is_worse else (highest, lowest)


def signed_number(value: float, decimals: int) -> str:
    """A number with grouped digits and a true minus sign; what rounds to 0 has none."""
    return f"{round(value, decimals) + 0.0:,.{decimals}f}".replace("-", "\u2212")


@cache
def library() -> Mapping[str, Metric]:
    """All metrics by name, in their order: the files beside this one and what packages register."""
    metrics = METRICS.declarations()
    return dict(sorted(metrics.items(), key=lambda item: item[1].rank))


@cache
def measurable_metrics() -> Mapping[str, Metric]:
    """The metrics that a measured unit has too, by name, in their order."""
    return {name: metric for name, metric in library().items() if metric.measurable}

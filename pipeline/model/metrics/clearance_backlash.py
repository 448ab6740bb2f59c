"""Clearance backlash of the frictionless loop."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return loop.limit_plus - loop.limit_minus


METRIC = Metric(
    name="clearance_backlash_arcmin",
    title="Clearance backlash",
    unit="arcmin",
    definition="Width of the loop at zero torque of the frictionless model: the angle in the limit of vanishing "
    "positive torque less that of vanishing negative torque.",
    rank=0,
    decimals=3,
    value=_value,
    headline=True,
    turn_of_rigid_bodies=True,
    largest_torque=lambda _: 0.0,
)

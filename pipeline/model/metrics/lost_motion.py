"""Lost motion of the loop's centre line."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return loop.lost_motion_plus - loop.lost_motion_minus


METRIC = Metric(
    name="lost_motion_arcmin",
    title="Lost motion",
    unit="arcmin",
    definition="Difference in angle of the loop's centre line between +{lost_motion:g} and −{lost_motion:g} N m.",
    rank=3,
    decimals=3,
    value=_value,
    headline=True,
    largest_torque=lambda torque: torque.lost_motion,
    moves_at=lambda torque: torque.lost_motion,
)

"""Torsional rigidity of the loading branches."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, torque: Definitions) -> Real:
    step = torque.rigidity_high - torque.rigidity_low
    return 0.5 * step * (1 / (loop.high_plus - loop.low_plus) + 1 / (loop.low_minus - loop.high_minus))


METRIC = Metric(
    name="torsional_rigidity_Nm_per_arcmin",
    title="Torsional rigidity",
    unit="N m/arcmin",
    definition="Torque over angle between {rigidity_low:g} and {rigidity_high:g} N m, mean of both senses.",
    rank=4,
    decimals=3,
    value=_value,
    smaller_is_worse=True,
    headline=True,
    largest_torque=lambda torque: torque.rigidity_high,
    moves_at=lambda torque: torque.rigidity_low,
)

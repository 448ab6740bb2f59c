"""Hysteresis loss: what friction adds to the play."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return (loop.zero_falling - loop.zero_rising) - (loop.limit_plus - loop.limit_minus)


METRIC = Metric(
    name="hysteresis_loss_arcmin",
    title="Hysteresis loss",
    unit="arcmin",
    definition="Zero-torque width less the clearance backlash; zero without friction.",
    rank=2,
    decimals=3,
    value=_value,
    needs_friction=True,
    largest_torque=lambda _: 0.0,
    not_negative=True,
)

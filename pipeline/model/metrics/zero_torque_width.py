"""Width of the loop at zero torque."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return loop.zero_falling - loop.zero_rising


METRIC = Metric(
    name="zero_torque_width_arcmin",
    title="Zero-torque width",
    unit="arcmin",
    definition="Width of the loop at zero torque as a bench sees it, friction included.",
    rank=1,
    decimals=3,
    value=_value,
    needs_friction=True,
    largest_torque=lambda _: 0.0,
)

"""Peak Hertz pressure in the loop."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return loop.peak_pressure


METRIC = Metric(
    name="peak_pressure_MPa",
    title="Peak Hertz pressure",
    unit="MPa",
    definition="Largest Hertz pressure of any contact at any torque of the load cycle.",
    rank=5,
    decimals=0,
    value=_value,
)

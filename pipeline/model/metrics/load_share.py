"""How unevenly several disks share the torque."""

from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric, Real


def _value(loop: LoopReadings, _: Definitions) -> Real:
    return loop.load_share


METRIC = Metric(
    name="load_share",
    title="Largest share of a disk",
    unit="1",
    definition="Largest share of a disk in {rigidity_high} N m on the output, in either sense; even shares are 1 over "
    "the number of disks.",
    rank=6,
    decimals=3,
    value=_value,
    needs_disks=True,
    largest_torque=lambda definitions: definitions.rigidity_high,
)

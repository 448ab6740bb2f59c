"""The metrics of a loop."""

from pipeline.arrays import Real
from pipeline.model.metrics.metric import Definitions, LoopReadings, Metric


def _rigidity(loop: LoopReadings, torque: Definitions) -> Real:
    step = torque.rigidity_high - torque.rigidity_low
    return 0.5 * step * (1 / (loop.high_plus - loop.low_plus) + 1 / (loop.low_minus - loop.high_minus))


METRICS = (
    # Clearance backlash of the frictionless loop.
    Metric(
        name="clearance_backlash_arcmin",
        title="Clearance backlash",
        unit="arcmin",
        definition="Width of the loop at zero torque of the frictionless model: the angle in the limit of vanishing "
        "positive torque less that of vanishing negative torque.",
        rank=0,
        decimals=3,
        value=lambda loop, _: loop.limit_plus - loop.limit_minus,
        headline=True,
        turn_of_rigid_bodies=True,
        largest_torque=lambda _: 0.0,
    ),
    # Width of the loop at zero torque.
    Metric(
        name="zero_torque_width_arcmin",
        title="Zero-torque width",
        unit="arcmin",
        definition="Width of the loop at zero torque as a bench sees it, friction included.",
        rank=1,
        decimals=3,
        value=lambda loop, _: loop.zero_falling - loop.zero_rising,
        needs_friction=True,
        largest_torque=lambda _: 0.0,
    ),
    # Hysteresis loss: what friction adds to the play.
    Metric(
        name="hysteresis_loss_arcmin",
        title="Hysteresis loss",
        unit="arcmin",
        definition="Zero-torque width less the clearance backlash; zero without friction.",
        rank=2,
        decimals=3,
        value=lambda loop, _: (loop.zero_falling - loop.zero_rising) - (loop.limit_plus - loop.limit_minus),
        needs_friction=True,
        largest_torque=lambda _: 0.0,
        not_negative=True,
    ),
    # Lost motion of the loop's centre line.
    Metric(
        name="lost_motion_arcmin",
        title="Lost motion",
        unit="arcmin",
        definition="Difference in angle of the loop's centre line between +{lost_motion:g} and −{lost_motion:g} N m.",
        rank=3,
        decimals=3,
        value=lambda loop, _: loop.lost_motion_plus - loop.lost_motion_minus,
        headline=True,
        largest_torque=lambda torque: torque.lost_motion,
        moves_at=lambda torque: torque.lost_motion,
    ),
    # Torsional rigidity of the loading branches.
    Metric(
        name="torsional_rigidity_Nm_per_arcmin",
        title="Torsional rigidity",
        unit="N m/arcmin",
        definition="Torque over angle between {rigidity_low:g} and {rigidity_high:g} N m, mean of both senses.",
        rank=4,
        decimals=3,
        value=_rigidity,
        smaller_is_worse=True,
        headline=True,
        largest_torque=lambda torque: torque.rigidity_high,
        moves_at=lambda torque: torque.rigidity_low,
    ),
    # Peak Hertz pressure in the loop.
    Metric(
        name="peak_pressure_MPa",
        title="Peak Hertz pressure",
        unit="MPa",
        definition="Largest Hertz pressure of any contact, in plane strain, at any torque of the load cycle.",
        rank=5,
        decimals=0,
        value=lambda loop, _: loop.peak_pressure,
    ),
    # How unevenly several disks share the torque.
    Metric(
        name="load_share",
        title="Largest share of a disk",
        unit="1",
        definition="Largest share of a disk in {rigidity_high:g} N m on the output, in either sense; even shares are 1 "
        "over the number of disks.",
        rank=6,
        decimals=3,
        value=lambda loop, _: loop.load_share,
        needs_disks=True,
        largest_torque=lambda definitions: definitions.rigidity_high,
    ),
)

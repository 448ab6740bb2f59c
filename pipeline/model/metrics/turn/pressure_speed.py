"""Pressure times sliding speed."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import SPEED, TurnMetric

TURN_METRIC = TurnMetric(
    name="pressure_speed_MPa_m_per_s",
    title="Pressure times sliding speed",
    unit="MPa m/s",
    definition="Largest product of pressure and sliding speed at any contact over the loaded crank angles under "
    "{rigidity_high:g} N m, at the stated speed of the input: Hertz' peak pressure where a pin slides on the disk, the "
    "mean pressure on its projected area where it rolls there and slides in its seat.",
    rank=6,
    decimals=1,
    value=lambda turn: np.max(turn.pressure_speed, axis=1),
    needs=(SPEED,),
)

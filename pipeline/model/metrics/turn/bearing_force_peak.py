"""Peak force on a disk's bearing."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import BALANCE, TURN, TurnMetric

TURN_METRIC = TurnMetric(
    name="bearing_force_peak_N",
    title="Peak force on a disk's bearing",
    unit="N",
    definition="Largest radial force of a disk on its input bearing, with a carrier on one of its cranks' bearings, "
    "over the loaded crank angles, {rigidity_high:g} N m held in either sense.",
    rank=2,
    decimals=0,
    needs=(TURN, BALANCE),
    value=lambda turn: np.max(np.abs(turn.bearing_force), axis=(1, 2, 3)),
)

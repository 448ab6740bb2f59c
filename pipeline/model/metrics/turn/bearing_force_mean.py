"""Mean force on a disk's bearing."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import BALANCE, TURN, TurnMetric

TURN_METRIC = TurnMetric(
    name="bearing_force_mean_N",
    title="Mean force on a disk's bearing",
    unit="N",
    definition="Mean radial force of a disk on its input bearing, with a carrier on one of its cranks' bearings, over "
    "the loaded crank angles, {rigidity_high:g} N m held; of the sense and bearing in which it is largest.",
    rank=3,
    decimals=0,
    needs=(TURN, BALANCE),
    value=lambda turn: np.max(np.mean(np.abs(turn.bearing_force), axis=2), axis=(1, 2)),
)

"""Mean force on the input bearing."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import BALANCE, TURN, TurnMetric

TURN_METRIC = TurnMetric(
    name="bearing_force_mean_N",
    title="Mean force on the input bearing",
    unit="N",
    definition="Mean radial force of a disk on its input bearing over the loaded crank angles, {rigidity_high:g} N m "
    "held; of the sense and disk in which it is larger.",
    rank=3,
    decimals=0,
    needs=(TURN, BALANCE),
    value=lambda turn: np.max(np.mean(np.abs(turn.bearing_force), axis=2), axis=(1, 2)),
)

"""Efficiency by named friction."""

import numpy as np

from pipeline.model.metrics.metric import Real
from pipeline.model.metrics.turn.turn_metric import BALANCE, FRICTION, SPEED, TURN, TurnMetric, TurnReadings

LARGEST_LOSS = 0.2
"""Share of the input that friction may take: forces are those of bodies without it, which errs by its square."""


def _value(turn: TurnReadings) -> Real:
    run = turn.conditions
    torque = 1e-3 * run.bearing_friction_mm * np.sum(np.abs(turn.bearing_force), axis=3)
    power_loss = np.mean(turn.friction_power + torque * run.bearing_speed_rpm * 2 * np.pi / 60, axis=2)
    share = np.max(power_loss / (run.output_power_W + power_loss), axis=1)
    return np.where(share <= LARGEST_LOSS, 100 * (1 - share), np.nan)


TURN_METRIC = TurnMetric(
    name="efficiency_percent",
    title="Efficiency",
    unit="%",
    definition="Power of the output over that of the input in the mean over the turn, {rigidity_high:g} N m held "
    "against the motion: lost is what friction takes at pins, output contacts and the disks' bearings by the "
    "coefficients of the design, under the forces of bodies without friction; the worse of both senses. Seals, "
    "churning, teeth of a first stage and other bearings are not in it.",
    rank=8,
    decimals=2,
    value=_value,
    smaller_is_worse=True,
    needs=(TURN, BALANCE, SPEED, FRICTION),
)

"""Basic rating life of the disks' bearings, and efficiency by named friction."""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.metrics.turn.turn_metric import BALANCE, FRICTION, RATING, SPEED, TURN, TurnMetric, TurnReadings

LARGEST_LOAD = 0.5
"""Equivalent load over the load rating up to which the life formula holds (ISO 281:2007, 5.3)."""


def equivalent_load(force: Real, exponent: float) -> Real:
    """The constant load (...) that tires a bearing as loads (..., n) do which act equally long.

    Source
    ------
    Palmgren and Miner's sum with the life formula of ISO 281: the mean of the load's power ``exponent``.
    """
    load: Real = np.mean(force**exponent, axis=-1) ** (1 / exponent)
    return load


def rating_life(load: Real, rating: float, exponent: float, speed_rpm: float) -> Real:
    """Basic rating life L10h (...) [h] at the equivalent ``load`` [N]; missing beyond half of the rating.

    Source
    ------
    ISO 281:2007, (C/P)^p million revolutions of one ring against the other.
    """
    life = 1e6 / (60 * speed_rpm) * (rating / load) ** exponent
    return np.where(load <= LARGEST_LOAD * rating, life, np.nan)


def _life(turn: TurnReadings) -> Real:
    run = turn.conditions
    load = equivalent_load(np.moveaxis(np.abs(turn.bearing_force), 2, 3), run.life_exponent)
    life: Real = np.min(rating_life(load, run.load_rating_N, run.life_exponent, run.bearing_speed_rpm), axis=(1, 2))
    return life


LIFE = TurnMetric(
    name="bearing_life_h",
    title="Basic rating life of the disks' bearings",
    unit="h",
    definition="ISO 281: time that nine of ten such bearings reach, {rigidity_high:g} N m held at the stated speed, "
    "from the load rating of the design and the power mean of the force over the turn; of the sense and "
    "bearing in which it is shortest, input bearings or with a carrier those between cranks and disks. Lubrication, "
    "cleanliness and misalignment are not in it; of all bearings together fewer reach it.",
    rank=7,
    decimals=0,
    value=_life,
    smaller_is_worse=True,
    needs=(TURN, BALANCE, SPEED, RATING),
)


LARGEST_LOSS = 0.2
"""Share of the input that friction may take: forces are those of bodies without it, which errs by its square."""


def _efficiency(turn: TurnReadings) -> Real:
    run = turn.conditions
    torque = 1e-3 * run.bearing_friction_mm * np.sum(np.abs(turn.bearing_force), axis=3)
    power_loss = np.mean(turn.friction_power + torque * run.bearing_speed_rpm * 2 * np.pi / 60, axis=2)
    share = np.max(power_loss / (run.output_power_W + power_loss), axis=1)
    return np.where(share <= LARGEST_LOSS, 100 * (1 - share), np.nan)


EFFICIENCY = TurnMetric(
    name="efficiency_percent",
    title="Efficiency",
    unit="%",
    definition="Power of the output over that of the input in the mean over the turn, {rigidity_high:g} N m held "
    "against the motion: lost is what friction takes at pins, output contacts and the disks' bearings by the "
    "coefficients of the design, under the forces of bodies without friction; the worse of both senses. Seals, "
    "churning, teeth of a first stage and other bearings are not in it.",
    rank=8,
    decimals=2,
    value=_efficiency,
    smaller_is_worse=True,
    needs=(TURN, BALANCE, SPEED, FRICTION),
)

TURN_METRICS = (LIFE, EFFICIENCY)

"""What a bench reads of rigid drives, position by position, with effects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from pipeline.arrays import Real, Truth, Whole
from tests.validation.blind.rigid_drive.drive import Curve, RigidDrive
from tests.validation.blind.rigid_drive.effects import EFFECTS, NMM_PER_NM, RAD_PER_ARCMIN, Sensors
from tests.validation.blind.rigid_drive.train import Train

SECONDS_AN_HOUR = 3600.0
"""Seconds of an hour."""
BEYOND = 1.01
"""Reach of a curve over the largest torque read."""


PIECES = 24
"""Parts of a cycle in which wear stands still."""


@dataclass(frozen=True)
class Loading:
    """What one position is put through.

    Attributes
    ----------
    torque, time : (n_rows,) as read [N m], from the measurement's start [s].
    turns : (n_turns,) torques as read [N m] from the first to the last, turning at each.
    leg : (n_rows,) between which turns each row lies.
    cycle : (n_rows,)
    warmer : (n_cycles,) temperature over that of the drawing [K].
    travelled : (n_rows,) way of the torque from the start, over the usual one of a cycle.
    """

    torque: Real
    time: Real
    turns: Real
    leg: Whole
    cycle: Whole
    warmer: Real
    travelled: Real

    @property
    def pieces(self) -> Whole:
        """Number of the part of a cycle (n_rows,) in which wear stands still."""
        return np.floor(PIECES * self.travelled).astype(int) + PIECES * self.cycle


@dataclass
class Position:
    """A drive as it is measured at one position.

    Attributes
    ----------
    loading : that it is put through.
    encoder_turns, encoder_angle : of the encoder per turn of the output, and where it stands [rad].
    at_output : whether the output is loaded; else it is locked, and the input is loaded.
    """

    drive: RigidDrive
    loading: Loading
    encoder_turns: float
    encoder_angle: float
    at_output: bool = True
    _curves: dict[tuple[Any, ...], Curve] = field(default_factory=dict)

    def angle(self, effects: Mapping[str, Sequence[float]]) -> Real:
        """Angle (n_rows,) [arcmin] as read, without noise, with effects by their names and values."""
        loading = self.loading
        train, sensors = Train(**_numbers("train", effects)), Sensors(**_numbers("sensors", effects))
        torque = NMM_PER_NM * (loading.torque - sensors.torque_zero) / (1 + sensors.torque_gain)
        turns = NMM_PER_NM * (loading.turns - sensors.torque_zero) / (1 + sensors.torque_gain)
        steps, is_row = _with_turns(torque, turns, loading.leg)
        output_angle, carried_torque = np.empty(len(torque)), np.empty(len(torque))
        wears = any(EFFECTS[name].changes_with == "cycle" for name in effects)
        states = loading.pieces if wears else loading.cycle
        for state in np.unique(states):
            rows = states == state
            condition = float(np.mean(loading.travelled[rows])), float(loading.warmer[loading.cycle[rows][0]])
            curve = self.curve(effects, condition, float(np.max(np.abs(steps))))
            angle, play_position = train.walked(curve, steps)
            output_angle[rows], carried_torque[rows] = angle[is_row][rows], play_position[is_row][rows]
        in_series = torque if self.at_output else carried_torque
        output_angle = output_angle + train.twisted(in_series) + train.crept(in_series, loading.time)
        encoder = self.encoder_turns * output_angle + self.encoder_angle
        wave = sensors.encoder_cosine * np.cos(encoder) + sensors.encoder_sine * np.sin(encoder)
        return output_angle / RAD_PER_ARCMIN + wave + sensors.drift * loading.time / SECONDS_AN_HOUR

    def curve(self, effects: Mapping[str, Sequence[float]], condition: tuple[float, float], largest: float) -> Curve:
        """The curve without friction [rad] to the ``largest`` torque [N mm], in a condition; kept."""
        acting = {name: tuple(values) for name, values in effects.items() if EFFECTS[name].drive}
        with_state = any(EFFECTS[name].changes_with for name in acting)
        key = tuple(acting.items()), condition if with_state else 0, largest
        if key not in self._curves:
            drive = self.drive
            for name, values in acting.items():
                effect_of = EFFECTS[name].drive
                assert effect_of is not None
                drive = effect_of(values)(drive, *condition)
            self._curves[key] = drive.curve(BEYOND * largest)
        return self._curves[key]


def _numbers(part: str, effects: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Numbers of the train or of the sensors with all effects."""
    return {
        name: number
        for effect, values in effects.items()
        for name, number in getattr(EFFECTS[effect], part)(values).items()
    }


def _with_turns(torque: Real, turns: Real, leg: Whole) -> tuple[Real, Truth]:
    """Torques of the rows with the turns among them, and which of them are rows."""
    steps, is_row = [turns[0]], [False]
    for number, end in enumerate(turns[1:]):
        leg_torques = torque[leg == number].tolist()
        steps += [*leg_torques, end]
        is_row += [True] * len(leg_torques) + [False]
    return np.array(steps), np.array(is_row)


SLOW_SHARE = 0.15
"""Of the noise's standard deviation, that of the wander: over the rows of a cell it weighs as the rest."""
KEPT = 0.9
"""Of the wander from row to row: it forgets within some ten rows."""


def readings(angle: Real, deviation: float, step: float, rng: np.random.Generator) -> Real:
    """Angles (n_rows,) as read, in whole steps; deviation and step in the unit of the angle."""
    kicks = np.sqrt(1 - KEPT**2) * rng.standard_normal(len(angle))
    kicks[0] = rng.standard_normal()
    wander = lfilter([1.0], [1.0, -KEPT], kicks)
    noise = np.sqrt(1 - SLOW_SHARE**2) * rng.standard_normal(len(angle)) + SLOW_SHARE * wander
    return np.asarray(step * np.floor((angle + deviation * noise) / step), float)

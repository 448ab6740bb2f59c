"""Predictions of turns that were held out, which ask no reducer: what a model of a turning drive has to beat."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.measurement.turning.motion import TURN_DEG
from pipeline.identification.selection.baselines import Cycles

HARMONICS = 6
"""Orders of the crank that a description without a reducer has."""


def replay(data: Data, cycles: Cycles, training: Truth) -> Real:
    """The mean training angle of each cell's kind at its crank angle (n_cells,) [arcmin]; NaN where there is none.

    At an angle over the turn of the output that was not trained, that at the same angle of a turn of the crank.
    """
    crank = np.round(_turning(data).crank, 6)
    replay_angle = np.full(len(data), np.nan)
    for place in (np.round(np.mod(crank, TURN_DEG), 6), crank):
        keys = np.unique(np.column_stack([cycles.kind, place]), axis=0, return_inverse=True)[1].ravel()
        count = np.bincount(keys[training], minlength=keys.max() + 1)
        total = np.bincount(keys[training], data.angle[training], minlength=keys.max() + 1)
        is_known = count[keys] > 0
        replay_angle[is_known] = total[keys][is_known] / count[keys][is_known]
    return replay_angle


def harmonics(data: Data, cycles: Cycles, training: Truth) -> Real:
    """Orders of the crank with play, a softening spring, Coulomb and load friction (n_cells,) [arcmin]."""
    crank, torque, sense = np.radians(_turning(data).crank), data.torque, data.senses
    places = len(np.unique(np.round(np.mod(_turning(data).crank[training], TURN_DEG), 6)))
    orders = range(1, min(HARMONICS, (places - 2) // 2) + 1)  # more would go through all intervals of a turn
    waves = [wave(order * crank) for order in orders for wave in (np.cos, np.sin)]
    springs = [np.sign(torque), torque, torque * np.abs(torque), sense, sense * np.abs(torque)]
    columns = np.column_stack([np.ones(len(data)), *waves, *springs])
    root = 1 / data.sigma[training]
    amounts = np.linalg.lstsq(columns[training] * root[:, None], data.angle[training] * root, rcond=None)[0]
    return np.asarray(columns @ amounts, float)


def _turning(data: Data) -> TurningData:
    assert isinstance(data, TurningData)
    return data


TURN_METHODS: Mapping[str, Callable[[Data, Cycles, Truth], Real]] = {
    "replay of the training turns": replay,
    f"{HARMONICS} orders of the crank, play, softening spring, Coulomb and load friction": harmonics,
}

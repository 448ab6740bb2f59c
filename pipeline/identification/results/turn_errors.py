"""Transmission error and its orders, read off the turns of a crank by one procedure, measured and of each curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.identify import Identification
from pipeline.identification.measurement.turning.turned_rows import WHOLE_TOLERANCE
from pipeline.identification.results.prediction_errors import NO_LOSS, SEPARATION, LoopError
from pipeline.identification.results.turn_signatures import ORDERS
from pipeline.model.metrics import measurable_metrics
from pipeline.model.turn import orders

NO_LOOP = "a crank that turns draws no loop"
SPAN, ORDER = "transmission_error_arcmin", "order_{}_arcmin"


def turn_errors(identification: Identification) -> dict[str, LoopError]:
    """Span of the transmission error over a turn and amplitudes of its orders: measured, and of each curve.

    Notes
    -----
    Of the mean over the turns at each crank angle, for each held torque, sense and revolution that is whole; then the
    mean over these. Only cells that judge count.
    """
    data = identification.problem.data
    assert isinstance(data, TurningData)
    readings = [
        {name: _read(angles) for name, angles in turn.items()}
        for turn in mean_turns(data, {"measured": data.angle} | identification.curves, identification.folds.cells)
    ]
    errors = {metric: LoopError(None, {}, 0, NO_LOOP) for metric in (*measurable_metrics(), SEPARATION)}
    errors["hysteresis_loss_arcmin"] = LoopError(None, {}, 0, NO_LOSS)
    for metric in (SPAN, *(ORDER.format(order) for order in ORDERS)):
        complete_turns = [turn for turn in readings if all(metric in numbers for numbers in turn.values())]
        if not complete_turns:
            errors[metric] = LoopError(None, {}, 0, "no whole turn of enough intervals was held out")
            continue
        mean = {name: float(np.mean([turn[name][metric] for turn in complete_turns])) for name in complete_turns[0]}
        errors[metric] = LoopError(mean.pop("measured"), mean, len(complete_turns))
    return errors


def mean_turns(data: TurningData, curves: dict[str, Real], cells: NDArray[np.bool_]) -> list[dict[str, Real]]:
    """Mean angle over each whole turn of the crank (n_intervals,) [arcmin], of each curve, by torque and sense."""
    turns = []
    revolution = data.revolution
    for level in np.unique(data.level):
        for direction in np.unique(data.direction):
            for number in np.unique(revolution):
                in_turn = cells & (data.level == level) & (data.direction == direction) & (revolution == number)
                places, place = np.unique(data.position[in_turn], return_inverse=True)
                if len(places) and abs(len(places) - data.per_turn) < WHOLE_TOLERANCE:
                    count = np.bincount(place)
                    turns.append({name: np.bincount(place, angle[in_turn]) / count for name, angle in curves.items()})
    return turns


def _read(angle: Real) -> dict[str, float]:
    """Span and orders [arcmin] of angles evenly over a turn."""
    waves = orders(angle[None])
    amplitude = dict(zip(waves.order.astype(int).tolist(), waves.amplitude[0].tolist(), strict=True))
    of_orders = {ORDER.format(k): amplitude[k] for k in ORDERS if k in amplitude}
    return {SPAN: float(np.ptp(angle))} | of_orders

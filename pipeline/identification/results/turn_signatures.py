"""Prediction errors and signatures of a unit whose crank turned."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Shown
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.identify import Identification
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turned_rows import WHOLE_TOLERANCE
from pipeline.identification.results.prediction_errors import NO_LOSS, SEPARATION, LoopError
from pipeline.identification.results.residual_signatures import (
    Signature,
    SignatureCells,
    cells_of,
    not_testable,
    signature_of,
)
from pipeline.model.metrics import measurable_metrics
from pipeline.model.turn import orders
from pipeline.model.units import TURN_DEG

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
    errors = {metric: LoopError(why_not=NO_LOOP) for metric in (*measurable_metrics(), SEPARATION)}
    errors["hysteresis_loss_arcmin"] = LoopError(why_not=NO_LOSS)
    for metric in (SPAN, *(ORDER.format(order) for order in ORDERS)):
        complete_turns = [turn for turn in readings if all(metric in numbers for numbers in turn.values())]
        of_metric = [{name: numbers[metric] for name, numbers in turn.items()} for turn in complete_turns]
        errors[metric] = LoopError.from_readings(of_metric, "no whole turn of enough intervals was held out")
    return errors


def mean_turns(data: TurningData, curves: dict[str, Real], cells: Truth) -> list[dict[str, Real]]:
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


ORDERS = range(1, 5)
"""Orders of the crank that are looked for."""
LEAST_OUTPUT_TURN: Shown = 0.5
"""Share of a turn of the output from which its own order is told from a slope."""
ARCMIN, PER_TORQUE = "arcmin", "arcmin/(N m)"


def turn_signatures(measurement: Measurement, data: TurningData, predicted_angle: Real) -> tuple[Signature, ...]:
    """Signatures of the residual of predicted angles (n_cells,) [arcmin]; cells without a prediction are left out."""
    all_cells = cells_of(measurement, data, predicted_angle)
    cells = replace(all_cells, position=np.zeros_like(all_cells.position))  # one zero for all
    lobes = measurement.unit.study.design.cycloid.lobes
    return (
        *_senses(cells),
        _compliance(cells),
        *_orders(cells, len(measurement.rows.cranks)),
        *_output_order(cells, lobes),
        *_over_time(cells),
    )


def _senses(cells: SignatureCells) -> Iterator[Signature]:
    names = "sense_half_difference", "half-difference of the senses of the crank", ARCMIN
    growth = "sense_growth", "half-difference of the senses, growth with the torque", PER_TORQUE
    if len(np.unique(cells.falling)) < 2:
        yield not_testable(*names, "the crank turns in one sense alone")
        yield not_testable(*growth, "the crank turns in one sense alone")
        return
    yield signature_of(cells, names, cells.falling, cells.torque)
    size = np.abs(cells.torque)
    if np.ptp(size) > 0.1 * size.max():
        yield signature_of(cells, growth, cells.falling * size, cells.falling, cells.torque)
    else:
        yield not_testable(*growth, "all torques are of one size")


def _compliance(cells: SignatureCells) -> Signature:
    names = "compliance", "slope of the mean of both senses over the torque", PER_TORQUE
    if np.ptp(cells.torque) <= 0.1 * np.abs(cells.torque).max():
        return not_testable(*names, "a single torque is held")
    return signature_of(cells, names, cells.torque, cells.falling)


def _orders(cells: SignatureCells, positions: int) -> Iterator[Signature]:
    turns = np.ptp(cells.crank) / (2 * np.pi)
    for order in ORDERS:
        is_held = positions >= 2 * order + 1 and turns >= LEAST_OUTPUT_TURN
        reason = "" if is_held else "too few intervals of the crank"
        yield from _wave(cells, order * cells.crank, f"crank_{order}", f"order {order} of the crank", reason)


def _output_order(cells: SignatureCells, lobes: int) -> Iterator[Signature]:
    turns = np.ptp(cells.crank) / np.radians(TURN_DEG) / lobes
    reason = f"the record holds {turns:.2g} turns of the output, {LEAST_OUTPUT_TURN:g} are needed"
    reason = "" if turns >= LEAST_OUTPUT_TURN else reason
    yield from _wave(cells, cells.crank / lobes, "output_1", "order 1 of the output", reason)


def _wave(cells: SignatureCells, angle: Real, name: str, title: str, reason: str) -> Iterator[Signature]:
    """Signatures of cosine and sine of an angle (n,) [rad], each beside the other, or the reason against them."""
    waves = {"cosine": np.cos(angle), "sine": np.sin(angle)}
    for word, other in (("cosine", "sine"), ("sine", "cosine")):
        names = f"{name}_{word}", f"{title}, {word}", ARCMIN
        if reason:
            yield not_testable(*names, reason)
        else:
            yield signature_of(cells, names, waves[word], waves[other], cells.falling, cells.torque)


def _over_time(cells: SignatureCells) -> Iterator[Signature]:
    shift = "shift_per_cycle", "shift of the angle from cycle to cycle", ARCMIN
    drift = "drift", "drift of the angle with time", "arcmin/h"
    if len(np.unique(cells.cycle)) < 2:
        yield not_testable(*shift, "fewer than 2 cycles")
    else:
        yield signature_of(cells, shift, cells.cycle, cells.falling, cells.torque)
    if not np.all(np.isfinite(cells.hours)) or np.ptp(cells.hours) == 0:
        yield not_testable(*drift, "no time stamps")
    else:
        yield signature_of(cells, drift, cells.hours, cells.falling, cells.torque)

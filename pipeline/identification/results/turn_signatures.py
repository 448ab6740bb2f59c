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
    judged_signature,
    not_testable,
    trend,
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


def _of_columns(cells: SignatureCells, name: str, title: str, unit: str, *columns: Real) -> Signature:
    """The signature of the first of some columns (n,)."""
    is_selected = np.ones(len(cells.residual), bool)
    return judged_signature(name, title, unit, trend(cells, is_selected, np.column_stack(columns), 0))


def _senses(cells: SignatureCells) -> Iterator[Signature]:
    names = "sense_half_difference", "half-difference of the senses of the crank"
    growth = "sense_growth", "half-difference of the senses, growth with the torque"
    if len(np.unique(cells.falling)) < 2:
        yield not_testable(*names, ARCMIN, "the crank turns in one sense alone")
        yield not_testable(*growth, PER_TORQUE, "the crank turns in one sense alone")
        return
    yield _of_columns(cells, *names, ARCMIN, cells.falling, cells.torque)
    size = np.abs(cells.torque)
    if np.ptp(size) > 0.1 * size.max():
        yield _of_columns(cells, *growth, PER_TORQUE, cells.falling * size, cells.falling, cells.torque)
    else:
        yield not_testable(*growth, PER_TORQUE, "all torques are of one size")


def _compliance(cells: SignatureCells) -> Signature:
    name, title = "compliance", "slope of the mean of both senses over the torque"
    if np.ptp(cells.torque) <= 0.1 * np.abs(cells.torque).max():
        return not_testable(name, title, PER_TORQUE, "a single torque is held")
    return _of_columns(cells, name, title, PER_TORQUE, cells.torque, cells.falling)


def _orders(cells: SignatureCells, positions: int) -> Iterator[Signature]:
    turns = np.ptp(cells.crank) / (2 * np.pi)
    for order in ORDERS:
        cosine, sine = np.cos(order * cells.crank), np.sin(order * cells.crank)
        for word, columns in (("cosine", (cosine, sine)), ("sine", (sine, cosine))):
            name, title = f"crank_{order}_{word}", f"order {order} of the crank, {word}"
            if positions < 2 * order + 1 or turns < LEAST_OUTPUT_TURN:
                yield not_testable(name, title, ARCMIN, "too few intervals of the crank")
            else:
                yield _of_columns(cells, name, title, ARCMIN, *columns, cells.falling, cells.torque)


def _output_order(cells: SignatureCells, lobes: int) -> Iterator[Signature]:
    turns = np.ptp(cells.crank) / np.radians(TURN_DEG) / lobes
    place = cells.crank / lobes
    for word, columns in (
        ("cosine", (np.cos(place), np.sin(place))),
        ("sine", (np.sin(place), np.cos(place))),
    ):
        name, title = f"output_1_{word}", f"order 1 of the output, {word}"
        if turns < LEAST_OUTPUT_TURN:
            reason = f"the record holds {turns:.2g} turns of the output, {LEAST_OUTPUT_TURN:g} are needed"
            yield not_testable(name, title, ARCMIN, reason)
        else:
            yield _of_columns(cells, name, title, ARCMIN, *columns, cells.falling, cells.torque)


def _over_time(cells: SignatureCells) -> Iterator[Signature]:
    name, title = "shift_per_cycle", "shift of the angle from cycle to cycle"
    if len(np.unique(cells.cycle)) < 2:
        yield not_testable(name, title, ARCMIN, "fewer than 2 cycles")
    else:
        yield _of_columns(cells, name, title, ARCMIN, cells.cycle, cells.falling, cells.torque)
    name, title = "drift", "drift of the angle with time"
    if not np.all(np.isfinite(cells.hours)) or np.ptp(cells.hours) == 0:
        yield not_testable(name, title, "arcmin/h", "no time stamps")
    else:
        yield _of_columns(cells, name, title, "arcmin/h", cells.hours, cells.falling, cells.torque)

"""What the residual of a turning drive depends on: sense, torque, orders of crank and output, cycle, time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.motion import TURN_DEG
from pipeline.identification.results.residual_signatures import (
    Signature,
    SignatureCells,
    judged_signature,
    not_testable,
    trend,
)

ORDERS = range(1, 5)
"""Orders of the crank that are looked for."""
LEAST_OUTPUT_TURN = 0.5
"""Share of a turn of the output from which its own order is told from a slope."""
ARCMIN, PER_TORQUE = "arcmin", "arcmin/(N m)"


def turn_signatures(measurement: Measurement, data: TurningData, predicted_angle: Real) -> tuple[Signature, ...]:
    """Signatures of the residual of predicted angles (n_cells,) [arcmin]; cells without a prediction are left out."""
    cells = _cells(measurement, data, predicted_angle)
    lobes = measurement.unit.study.design.cycloid.lobes
    return (
        *_senses(cells),
        _compliance(cells),
        *_orders(cells, len(measurement.rows.cranks)),
        *_output_order(cells, lobes),
        *_over_time(cells),
    )


def _cells(measurement: Measurement, data: TurningData, predicted_angle: Real) -> SignatureCells:
    cells, residual = measurement.cells, data.angle - predicted_angle
    finite = np.isfinite(residual)
    return SignatureCells(
        residual=residual[finite],
        torque=data.torque[finite],
        falling=-data.direction[finite].astype(float),
        crank=np.radians(data.crank[finite]),
        angle=data.angle[finite],
        cycle=data.cycle[finite].astype(float),
        hours=cells.time_mean[finite] / 3600,
        warmer=cells.temperature_mean[finite],
        position=np.zeros(int(finite.sum()), np.int64),  # one zero for all
        block=data.block[finite],
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

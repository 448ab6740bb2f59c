"""Orders of the error of a record: of the shafts, and the largest others, with what grows with the torque."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from pipeline.arrays import Real, Whole
from pipeline.constant_kinds import ShownCount
from pipeline.identification.measurement.enough import FEWEST_OF_A_WAVE
from pipeline.identification.measurement.turning.motion import LEVEL_SHARE
from pipeline.identification.record.evidence import REACH, Points
from pipeline.identification.record.terms import LEAST_WAVES, Covariates
from pipeline.identification.record.turn_record import TurnRecord
from pipeline.statistics.resampling import CONFIDENCE, LEVEL

WIDTH = float(ndtri(0.5 + 0.5 * CONFIDENCE))
"""Half of an interval, in standard deviations."""
CLEAR_OF_ZERO = float(np.sqrt(-2 * np.log(LEVEL)))
"""Amplitude in its error that noise alone exceeds in 5 %: its distribution is Rayleigh's."""
SHOWN_ORDERS: ShownCount = 12
"""Orders that the page lists beside those of the shafts: the largest."""


@dataclass(frozen=True)
class OrderRow:
    """An order of the error that all passes share.

    Attributes
    ----------
    order : waves per turn of the output.
    of : what turns so often; empty of an order of no shaft.
    amplitude, ci_low, ci_high : [arcsec].
    per_torque : amplitude of what grows with the torque, at the largest one [arcsec]; 0 of one size of torque.
    senses : amplitude of half the difference of the senses [arcsec].
    significant : whether noise and drift alone would give one so large with at most 5 % over all orders.
    """

    order: float
    of: str
    amplitude: float
    ci_low: float
    ci_high: float
    per_torque: float
    senses: float
    significant: bool


def error_orders(record: TurnRecord, points: Points) -> list[OrderRow]:
    """Orders of the shafts and the largest others, from the means of all intervals.

    Growth with the torque is that between torques of one sign: from one sign to the other, other flanks carry, which
    have errors of their own. Beside noise, what passes drift by over the angle makes low orders uncertain; without
    repeats it may be all that the error varies by.
    """
    residual = _about_mean(points.error, points.kind)
    intervals, signals, squares = _signals(record, points, residual)
    turns = record.span_deg / 360.0
    place = 2 * np.pi * turns * (intervals + 0.5) / record.n_intervals
    highest = record.n_intervals / turns / FEWEST_OF_A_WAVE
    grid = np.arange(max(1.0, 1 / turns), highest, 1 / turns)
    shafts = {order: title for title, order in record.orders.waves.values()} | _mesh_orders(record)
    named_orders = {order: title for order, title in shafts.items() if LEAST_WAVES <= order * turns <= highest * turns}
    noise = 60 * float(np.median(points.noise)) * np.sqrt(2 / len(intervals))
    drift = 60 * min(points.drift, float(np.std(residual)))
    share = np.exp(-0.5 * (np.subtract.outer(intervals, intervals) / (REACH * record.n_intervals)) ** 2)
    weights = np.array([1 / np.sqrt(max(float(np.median(square)), 1e-12)) for square in squares])
    threshold = np.sqrt(-2 * np.log(LEVEL / max(len(signals) * len({*named_orders, *grid}), 1)))
    half = 0.5 * 2 * np.pi * turns / record.n_intervals

    def amplitudes(order: float) -> Real:
        columns = np.column_stack([np.cos(order * place), np.sin(order * place), np.ones(len(place))])
        sizes, *_ = np.linalg.lstsq(columns, np.nan_to_num(signals.T), rcond=None)
        amplitude: Real = 60 * np.hypot(sizes[0], sizes[1]) / float(np.sinc(order * half / np.pi))
        return amplitude

    def errors(order: float) -> Real:
        """Standard deviations (3,) of the sizes of a cosine."""
        waves = np.exp(1j * order * place) - np.mean(np.exp(1j * order * place))
        of_drift = 2 / len(place) ** 2 * float(np.real(np.conj(waves) @ share @ waves))
        return np.asarray(np.sqrt(noise**2 + drift**2 * of_drift) * weights, float)

    amplitudes_found = {float(order): amplitudes(order) for order in {*named_orders, *grid}}
    separate_orders = [
        order for order in grid if all(abs(order - other_order) > 0.5 / turns for other_order in named_orders)
    ]
    errors_found = {order: errors(order) for order in amplitudes_found}
    ratios = {order: amplitudes_found[order] / errors_found[order] for order in amplitudes_found}
    other_orders = sorted(separate_orders, key=lambda order: -float(np.max(ratios[float(order)])))[:SHOWN_ORDERS]
    rows = []
    for order in sorted({*named_orders, *other_orders}):
        size, growth, lag = amplitudes_found[float(order)].tolist()
        reach = WIDTH * float(errors_found[order][0])
        low = size - reach if ratios[order][0] > CLEAR_OF_ZERO else 0.0
        high, strong = size + reach, bool(np.any(ratios[order] > threshold))
        rows.append(
            OrderRow(
                order=float(order),
                of=named_orders.get(order, ""),
                amplitude=size,
                ci_low=low,
                ci_high=high,
                per_torque=growth,
                senses=lag,
                significant=strong,
            )
        )
    return [row for row in rows if row.of or row.significant]


def _signals(record: TurnRecord, points: Points, residual: Real) -> tuple[Whole, Real, Real]:
    """Intervals (n,), and at each the error, its growth with the torque and with the sense (3, n), by least squares.

    Also the sums of squares (3, n) of the regressors.
    """
    values = Covariates.from_record(record)
    torque, sense = (points.means(column[:, None])[:, 0] for column in (values.torque, values.sense))
    intervals, number = np.unique(points.interval, return_inverse=True)
    parts = (np.ones(len(points)), _load_about_mean(record, points), _about_mean(sense, number))
    columns = (np.ones(len(points)), torque, sense)
    sums = np.stack([np.bincount(number, part * residual) for part in parts])
    squares = np.array([np.bincount(number, part * column) for part, column in zip(parts, columns, strict=True)], float)
    return intervals, sums / np.maximum(squares, 1e-12), squares


def _mesh_orders(record: TurnRecord) -> dict[float, str]:
    """Multiples of the order of the crank, at which pins and lobes repeat; none of a drive without a known crank."""
    turns = record.orders.shafts.get("crank")
    return {times * turns: f"{times} times per turn of the crank" for times in (3, 4)} if turns else {}


def _load_about_mean(record: TurnRecord, points: Points) -> Real:
    """Held torque (n_points,) about the mean of one sign at each interval, over the largest; 0 without load."""
    torque = record.levels[points.level] / max(record.largest_torque, 1e-12)
    is_loaded = np.abs(torque) >= LEVEL_SHARE
    about_mean = np.zeros(len(points))
    about_mean[is_loaded] = _about_mean(torque[is_loaded], points.zero[is_loaded])
    return about_mean


def _about_mean(x: Real, group: Whole) -> Real:
    """Values (n,) about the mean of their group."""
    return x - (np.bincount(group, x) / np.maximum(np.bincount(group), 1))[group]

"""What the data of a unit have of what effects need."""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Truth
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.model.effects.effect import CRANKS, CYCLES, LOOPS, MOVES, RATE, SENSES, STILL, TEMPERATURE, TIME, TORQUES
from pipeline.model.load_history.load_cycle import ARCMIN

LEAST_WARMING = 0.2
"""Standard deviation of the temperature [K] from which it varies."""
OTHER_RATE = 1.5
"""Ratio of the rates of two branches from which a delay shows beside a hysteresis that knows no rate."""
DWELL = 0.2
"""Time in which the torque stands still, over that of a usual branch, from which it is a dwell."""


def met_needs(measurement: Measurement, training: Truth) -> frozenset[str]:
    """What the training cells (n_cells,) have of what effects need."""
    if isinstance(measurement, TurningMeasurement):
        present = _of_turns(measurement, training)
    else:
        present = _of_loops(measurement, training)
    rows, cells = measurement.rows, measurement.cells
    position, cycle = cells.position[training], cells.cycle[training]
    positions = np.unique(position)
    if measurement.known_cranks and len(positions) >= FEWEST_COMPARED:
        present.add(CRANKS)
    if any(len(np.unique(cycle[position == p])) > 1 for p in positions):
        present.add(CYCLES)
    time, temperature = cells.time_mean[training], cells.temperature_mean[training]
    if rows.time is not None and np.any(np.isfinite(time)) and np.nanstd(time) > 0:
        present.add(TIME)
    if rows.temperature is not None and np.nanstd(temperature) > LEAST_WARMING:
        present.add(TEMPERATURE)
    if TIME in present and LOOPS in present and rate_changes(measurement, training):
        present.add(RATE)
    return frozenset(present)


def _of_loops(measurement: Measurement, training: Truth) -> set[str]:
    """What loops at standing cranks have, and whether the crank stays where it is."""
    settings = measurement.unit.settings
    if settings.crank.moves != "fixed":
        return {LOOPS, SENSES, TORQUES, *([MOVES] if measurement.known_cranks else [])}
    return {LOOPS, SENSES, TORQUES, *([] if turn_of_held_crank(measurement, training).leaves_pitch else [STILL])}


class CrankTurn(NamedTuple):
    """Turn of a crank [deg] that a model holds still, and whether it is more than half a pitch of the pins."""

    deg: float
    leaves_pitch: bool


def turn_of_held_crank(measurement: Measurement, training: Truth | None = None) -> CrankTurn:
    """Largest turn within a position, of an angle read at the motor, by its training cells (n_cells,) or by all.

    None is left out where the input is locked or unit.toml says how the crank moves.
    """
    gear, cells, settings = measurement.unit.study.design.cycloid, measurement.cells, measurement.unit.settings
    if settings.locked == "input" or settings.crank.moves != "fixed":
        return CrankTurn(0.0, False)
    chosen_cells = slice(None) if training is None else training
    position, angle = cells.position[chosen_cells], cells.angle_mean[chosen_cells]
    turned = float(max(np.ptp(angle[position == p]) for p in np.unique(position)) * gear.lobes / ARCMIN)
    return CrankTurn(float(np.degrees(turned)), turned >= np.pi / gear.pins)


def _of_turns(measurement: TurningMeasurement, training: Truth) -> set[str]:
    """What a turning crank has: one or both senses, one or several torques."""
    several = {SENSES: measurement.cells.direction, TORQUES: measurement.level}
    return {name for name, values in several.items() if len(np.unique(values[training])) > 1}


def rate_changes(measurement: Measurement, training: Truth) -> bool:
    """Whether the torque of the training cells (n_cells,) goes at unlike rates, dwells somewhere, or goes by steps.

    Only then is a delay (creep) told from a hysteresis that does not depend on the rate.
    """
    if _goes_by_steps(measurement, training):
        return True
    cells, history = measurement.cells, measurement.history
    rates, durations, extra = [], [], []
    for position in np.unique(cells.position[training]):
        cells_chosen = np.flatnonzero(training & (cells.position == position) & np.isfinite(cells.time_mean))
        time, torque, leg = (
            cells.time_mean[cells_chosen],
            cells.torque_mean[cells_chosen],
            history.leg[cells.block[cells_chosen]],
        )
        travel = np.array(
            [
                np.sum(np.abs(np.diff([start, *history.torque[position][leg_before + 1 : leg_after + 1], end])))
                for start, end, leg_before, leg_after in zip(torque[:-1], torque[1:], leg[:-1], leg[1:], strict=True)
            ]
        )
        interval, in_leg = np.diff(time), (np.diff(leg) == 0) & (travel > 0)
        for number in np.unique(leg):
            on_leg = in_leg & (leg[1:] == number)
            if np.sum(interval[on_leg]) > 0:
                durations.append(np.sum(interval[on_leg]))
                rates.append(np.sum(travel[on_leg]) / durations[-1])
        if rates:
            extra += (interval - travel / np.median(rates)).tolist()
    if not rates:
        return False
    return bool(max(rates) > OTHER_RATE * min(rates) or max(extra) > DWELL * np.median(durations))


def _goes_by_steps(measurement: Measurement, training: Truth) -> bool:
    """Whether a bench holds each torque for several rows: between most rows the torque then changes only by noise."""
    rows, blocks = measurement.rows, np.unique(measurement.cells.block[training])
    runs = [measurement.branches.rows[block] for block in blocks]
    steps = np.concatenate([np.abs(np.diff(rows.torque[run][measurement.usable[run]])) for run in runs])
    return bool(np.median(steps) * OTHER_RATE < np.mean(steps))

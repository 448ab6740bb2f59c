"""The metrics of units over the turn of the crank, from the readings of their loops and the play of rigid bodies."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.assembly import definitions
from pipeline.config.study import Study
from pipeline.engine.table import Column
from pipeline.model.metrics import LoopReadings, library
from stages.clearance import rigid_angles
from stages.hysteresis import READINGS

OVER = ("worst", "mean", "best")
"""What is made of a metric's values over the turn."""
OVER_TURN = tuple(
    Column(f"{name}_{over}", "float64", metric.unit, f"{metric.inline}, {over} over the turn")
    for name, metric in library().items()
    for over in OVER
)
"""Columns of a unit's metrics over the turn."""


@dataclass(frozen=True)
class Turn:
    """A metric of ``n`` samples over the turn.

    Attributes
    ----------
    values : (n, n_angles); all missing of a sample without a result at some loaded angle.
    even : (n_angles,) which of them stand evenly over the turn, as far as they are of one kind.
    """

    values: np.ndarray
    even: np.ndarray


def loop_metrics(study: Study, loops: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every metric of loops (n_loops,) and whether it holds; missing where it does not or there is no result.

    Parameters
    ----------
    loops : columns of the table of loops.
    """
    readings = LoopReadings(**{field: loops[column.name] for field, column in READINGS.items()})
    torques = definitions(study)
    columns = {}
    for name, metric in library().items():
        valid = loops["solved"] & loops[metric.valid_column]
        columns[name] = np.where(valid, metric.value(readings, torques), np.nan)
        columns[metric.valid_column] = valid
    return columns


def metric_turns(study: Study, metrics: Mapping[str, np.ndarray], rigid_backlash: np.ndarray) -> dict[str, Turn]:
    """Every metric over the turn: at the loaded angles, and the clearance backlash of rigid bodies between them.

    Parameters
    ----------
    metrics : (n_loops,) each, the loaded angles of a unit one after the other.
    rigid_backlash : (n, n_rigid_angles) [arcmin] at `rigid_angles`; missing where contacts interfere.

    Notes
    -----
    Where contacts interfere rigid bodies know the play of the other parts alone, which no unit has: there the limit of
    the elastic ones runs straight from one loaded angle to the next, and no worst or best comes of it.
    """
    turns = {}
    for name, metric in library().items():
        values = np.asarray(metrics[name]).reshape(len(rigid_backlash), -1)
        values = np.where(np.isnan(values).any(axis=1)[:, None], np.nan, values)
        even = np.full(values.shape[1], True)
        if metric.turn_of_rigid_bodies:
            loaded, rigid_deg = values, rigid_angles(study)
            values = rigid_backlash.copy()
            values[np.isnan(loaded[:, 0])] = np.nan
            values[:, np.isin(rigid_deg, study.cycle.crank_deg)] = loaded
            for unit in np.flatnonzero(np.isnan(values).any(axis=1) & ~np.isnan(loaded[:, 0])):
                gaps = np.isnan(values[unit])
                values[unit, gaps] = np.interp(rigid_deg[gaps], study.cycle.crank_deg, loaded[unit], period=360.0)
            even = np.isin(rigid_deg, study.cycle.rigid_crank_deg)
        turns[name] = Turn(values, even)
    return turns


def over_turn_columns(turns: Mapping[str, Turn]) -> dict[str, np.ndarray]:
    """Worst, mean and best of every metric over the turn (n,), by column; missing of a unit without a result."""
    columns: dict[str, np.ndarray] = {}
    for name, turn in turns.items():
        worst, best = library()[name].over_turn(turn.values)
        mean = turn.values[:, turn.even].mean(axis=1)
        columns |= {f"{name}_worst": worst, f"{name}_mean": mean, f"{name}_best": best}
    return columns


def unit_status(status: np.ndarray, angles: int) -> np.ndarray:
    """Status (n,) of units: of the first of their ``angles`` loops that has no result, or `ok`."""
    by_unit = np.asarray(status).reshape(-1, angles)
    return by_unit[np.arange(len(by_unit)), np.argmax(by_unit != "ok", axis=1)]

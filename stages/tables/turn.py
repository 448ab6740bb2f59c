"""The metrics of units over the turn, from the readings of their loops and the play of rigid bodies.

The worst of units over the whole turn: what the search found, and what the audited samples correct it by.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.assembly import definitions
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns
from pipeline.model.metrics import LoopReadings, library
from pipeline.model.metrics.turn import READ_AT, TurnReadings, turn_library
from pipeline.model.turn import crank_torque
from pipeline.model.units import NMM_PER_NM
from pipeline.mounting import conditions
from pipeline.statistics.intervals import Estimate
from pipeline.statistics.two_phase import audited_distribution, audited_share
from stages.clearance import rigid_angles
from stages.hysteresis import READINGS
from stages.tables.over_turn import FRICTION_POWER, PRESSURE_SPEED, RUNNING, SHEAR, SHEAR_DEPTH
from stages.worst import N_PHASES, OF_PITCHES, RANGES

TURN_VALUES = ("worst", "mean", "best")
"""What is made of a metric's values over the turn."""
OVER_TURN = tuple(
    Column(f"{name}_{turn_value}", "float64", metric.unit, f"{metric.inline}, {turn_value} over the turn")
    for name, metric in library().items()
    for turn_value in TURN_VALUES
)
"""Columns of a unit's metrics over the turn."""
OF_TURN = tuple(
    Column(name, "float64", metric.unit.replace("µ", "u"), f"{metric.inline}: one number of the whole turn")
    for name, metric in turn_library().items()
)
"""Columns of a unit's metrics of the turn."""


@dataclass(frozen=True)
class Turn:
    """A metric of ``n`` samples over the turn.

    Attributes
    ----------
    values : (n, n_angles); all missing of a sample without a result at some loaded angle.
    worst_values : (n, n_angles) likewise, with what finite motions add where the backlash is largest.
    is_even : (n_angles,) which of them stand evenly over the turn, as far as they are of one kind.
    """

    values: np.ndarray
    worst_values: np.ndarray
    is_even: np.ndarray


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
        columns[name] = np.where(valid, metric.values(readings, torques), np.nan)
        columns[metric.valid_column] = valid
    return columns


def metric_turns(
    study: Study, metrics: Mapping[str, np.ndarray], rigid_backlash: np.ndarray, finite_motion: np.ndarray | None = None
) -> dict[str, Turn]:
    """Every metric over the turn: at the loaded angles, and the clearance backlash of rigid bodies between them.

    Parameters
    ----------
    metrics : (n_loops,) each, the loaded angles of a unit one after the other.
    rigid_backlash : (n, n_rigid_angles) [arcmin] at `rigid_angles`; missing where contacts interfere.
    finite_motion : (n, n_rigid_angles) [arcmin] what finite motions add to the backlash; None: small ones alone.

    Notes
    -----
    Where contacts interfere rigid bodies know the play of the other parts alone, which no unit has: there the limit of
    the elastic ones runs straight from one loaded angle to the next, and no worst or best comes of it.
    """
    turns = {}
    for name, metric in library().items():
        values = np.asarray(metrics[name]).reshape(len(rigid_backlash), -1)
        values = np.where(np.isnan(values).any(axis=1)[:, None], np.nan, values)
        even_angles = np.full(values.shape[1], True)
        if metric.turn_of_rigid_bodies:
            values, even_angles = _with_rigid(study, values, rigid_backlash), _rigid_even(study)
        with_motion = metric.turn_of_rigid_bodies and finite_motion is not None
        turns[name] = Turn(values, values + finite_motion if with_motion else values, even_angles)
    return turns


def _rigid_even(study: Study) -> np.ndarray:
    """Which of the `rigid_angles` stand evenly over the turn (n_rigid_angles,)."""
    return np.isin(rigid_angles(study), study.cycle.even_crank_deg)


def _with_rigid(study: Study, loaded_values: np.ndarray, rigid: np.ndarray) -> np.ndarray:
    """Values of elastic bodies (n, n_angles) at the loaded angles, of rigid ones (n, n_rigid_angles) between them.

    Where the ``rigid`` ones are missing, straight from one loaded angle to the next.
    """
    rigid_deg, values, turn_deg = rigid_angles(study), rigid.copy(), study.cycle.turn_deg
    values[np.isnan(loaded_values[:, 0])] = np.nan
    values[:, np.isin(rigid_deg, study.cycle.crank_deg)] = loaded_values
    for unit in np.flatnonzero(np.isnan(values).any(axis=1) & ~np.isnan(loaded_values[:, 0])):
        gaps = np.isnan(values[unit])
        values[unit, gaps] = np.interp(rigid_deg[gaps], study.cycle.crank_deg, loaded_values[unit], period=turn_deg)
    return values


def turn_readings(
    study: Study, loops: Mapping[str, np.ndarray], bearing_force: np.ndarray, rigid_ends: np.ndarray
) -> TurnReadings:
    """What the metrics of a turn are read from, of ``n`` units.

    Parameters
    ----------
    loops : columns of the table of loops, the loaded angles of a unit one after the other.
    bearing_force : (n, 2, n_angles, n_bearings) complex [N], as `hysteresis.bearing_forces` has it.
    rigid_ends : (n, 2, n_rigid_angles) [arcmin], as `clearance.rigid_turn` has it.
    """
    angles = np.array(study.cycle.crank_deg)
    loaded_angles, free_angles = (_angles_of(loops, names, metric, len(angles)) for names, metric in READ_AT.items())
    missing = np.isnan(loaded_angles[:, :1, :1, None])
    running = {
        column.name: np.where(missing[:, 0, :, 0], np.nan, loops[column.name].reshape(-1, len(angles)))
        for column in RUNNING
    }
    design, sense = study.design, np.array([1.0, -1.0])[:, None]
    ideal = sense * NMM_PER_NM * definitions(study).rigidity_high / design.output.crank_torque_ratio(design.cycloid)
    input_torque = crank_torque(design.cycloid.eccentricity_mm, np.radians(angles), design.disk.count, bearing_force)
    return TurnReadings(
        loaded_angle=loaded_angles,
        free_angle=np.stack([_with_rigid(study, free_angles[:, k], rigid_ends[:, k]) for k in range(2)], axis=1),
        bearing_force=np.where(missing, np.nan, bearing_force),
        input_share=input_torque / ideal,
        pressure_speed=running[PRESSURE_SPEED.name],
        shear=running[SHEAR.name],
        shear_depth=running[SHEAR_DEPTH.name],
        friction_power=np.stack([running[column.name] for column in FRICTION_POWER], axis=1),
        conditions=conditions(study),
        loaded_even=np.full(len(angles), study.cycle.evenly_loaded),
        free_even=_rigid_even(study),
    )


def _angles_of(loops: Mapping[str, np.ndarray], readings: tuple[str, str], metric: str, n_angles: int) -> np.ndarray:
    """Angles (n, 2, n_angles) [arcmin] of two readings of the loops; missing of a unit where some loop has none."""
    valid = loops["solved"] & loops[library()[metric].valid_column]
    values = [np.where(valid, loops[READINGS[name].name], np.nan).reshape(-1, n_angles) for name in readings]
    angle = np.stack(values, axis=1)
    return np.where(np.isnan(angle).any(axis=(1, 2))[:, None, None], np.nan, angle)


def turn_columns(readings: TurnReadings) -> dict[str, np.ndarray]:
    """Every metric of the turn (n,), by column."""
    return {name: metric.metric_values(readings) for name, metric in turn_library().items()}


def over_turn_columns(turns: Mapping[str, Turn]) -> dict[str, np.ndarray]:
    """Worst, mean and best of every metric over the turn (n,), by column; missing of a unit without a result."""
    columns: dict[str, np.ndarray] = {}
    for name, turn in turns.items():
        worst_values, best_values = (
            library()[name].over_turn(turn.worst_values)[0],
            library()[name].over_turn(turn.values)[1],
        )
        # in the order of rows, in which a single unit is summed as among many: to the bit
        mean = np.ascontiguousarray(turn.values[:, turn.is_even]).mean(axis=1)
        columns |= {f"{name}_worst": worst_values, f"{name}_mean": mean, f"{name}_best": best_values}
    return columns


def unit_status(status: np.ndarray, angles: int) -> np.ndarray:
    """Status (n,) of units: of the first of their ``angles`` loops that has no result, or `ok`."""
    by_unit: np.ndarray = np.asarray(status).reshape(-1, angles)
    first_other: np.ndarray = by_unit[np.arange(len(by_unit)), np.argmax(by_unit != "ok", axis=1)]
    return first_other


CRANK_DEG_PER_TURN = 360.0
"""Degrees of a turn of the crank."""
FOUND_AT = tuple(
    column
    for name, metric in library().items()
    for column in (
        Column(f"{name}_at_crank_deg", "float64", "deg", f"crank angle of the worst {metric.inline}"),
        Column(f"{name}_at_crank_turn", "float64", "1", "turn of the crank in which that lies"),
    )
)
"""Columns of where a unit's worst values were found."""


def found_columns(study: Study, turns: Mapping[str, Turn], search: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The worst of every metric (n,) of the angles of the study and of the search, and where it was found.

    Parameters
    ----------
    search : columns of the table of the search; none where the study looks at its angles alone.
    """
    columns: dict[str, np.ndarray] = {}
    for name, turn in turns.items():
        metric = library()[name]
        angles = rigid_angles(study) if metric.turn_of_rigid_bodies else np.array(study.cycle.crank_deg)
        values = turn.worst_values
        bad = np.where(np.isnan(values), -np.inf, -values if metric.smaller_is_worse else values)
        place = bad.argmax(axis=1)
        worst_values, crank = values[np.arange(len(place)), place], angles[place]
        if len(search):
            found_values = search[f"{name}_worst"]
            worse = found_values < worst_values if metric.smaller_is_worse else found_values > worst_values
            lost = np.isnan(found_values) & (search["n_solved"] > 0)
            worst_values = np.where(lost, np.nan, np.where(worse, found_values, worst_values))
            crank = np.where(worse, search[f"{name}_at_crank_deg"], crank)
        missing = np.isnan(values).any(axis=1) | np.isnan(worst_values)
        columns[f"{name}_worst"] = np.where(missing, np.nan, worst_values)
        columns[f"{name}_at_crank_deg"] = np.where(missing, np.nan, crank)
        columns[f"{name}_at_crank_turn"] = columns[f"{name}_at_crank_deg"] // CRANK_DEG_PER_TURN
    return columns


def searched_ranges(of_turn: Mapping[str, np.ndarray], search: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Transmission errors (n,) over the angles of the study and the pitches of the search; missing where either is.

    Parameters
    ----------
    of_turn : metrics of the turn at the angles of the study.
    search : columns of the table of the search; none where the study looks at its angles alone.
    """
    return {name: np.maximum(of_turn[name], search[name]) if len(search) else of_turn[name] for name in RANGES}


def shortfalls(units: pd.DataFrame, audit: Columns) -> pd.DataFrame:
    """What worst values and transmission errors of audited units lie beyond those in the table of units, by sample."""
    audit_rows = pd.DataFrame(dict(audit)).set_index("sample")
    found_rows = units[units["sample"].isin(audit_rows.index)].set_index("sample").loc[audit_rows.index]
    beyond = {}
    for name, metric in library().items():
        difference = audit_rows[f"{name}_worst"] - found_rows[f"{name}_worst"]
        beyond[name] = difference.clip(upper=0.0) if metric.smaller_is_worse else difference.clip(lower=0.0)
    for name in RANGES:
        beyond[name] = (audit_rows[name] - found_rows[name]).clip(lower=0.0)
    return pd.DataFrame(beyond)


def left_between(audit: Columns) -> pd.DataFrame | None:
    """What angles between those of the audit add to each metric's worst of the audited units in the mean, at most.

    None where one phase of each pitch is looked at. Missing of the transmission error, of which it is not known.

    Notes
    -----
    A worst value that lies between angles is missed by some power of their distance: by the first at a kink, where
    another contact becomes the worst, by the second at a smooth peak. For kinks, what angles leave to denser ones is
    in proportion to their distance: angles ``n`` times as dense add n - 1 parts of n, and leave one.
    """
    rows = pd.DataFrame(dict(audit)).set_index("sample")
    if not len(rows) or rows[N_PHASES.name].iloc[0] < 2:
        return None
    share = 1.0 / (rows[N_PHASES.name] - 1)
    added = {name: share * (rows[f"{name}_worst"] - rows[OF_PITCHES[name].name]) for name in library()}
    return pd.DataFrame({**added, **dict.fromkeys(RANGES, np.nan * share)})


def whole_turn_estimates(
    study: Study, values: pd.DataFrame, shortfall: pd.DataFrame
) -> Iterator[tuple[str, str, Estimate]]:
    """Metric, statistic and estimate for the whole turn, with an interval for the sampling and the search together.

    Parameters
    ----------
    values : (n, n_metrics) the worst of each unit as it was found, and the metrics of the turn, by sample.
    shortfall : (n_audited, n_metrics) as `shortfalls`.
    """
    confidence = study.metrics.confidence
    for name in shortfall:
        found_values, missed_values = values[name].dropna().to_numpy(float), shortfall[name].dropna().to_numpy(float)
        if len(found_values) and len(missed_values):
            for statistic, estimate in audited_distribution(found_values, missed_values, confidence).items():
                yield name, statistic, estimate
    for name in study.limits.pass_flags({column: values[column].to_numpy(float) for column in values}):
        if study.limits.over != "worst" and name not in RANGES:
            continue  # the audited units have the worst of a metric alone
        limited_metrics = study.limits.limited_metrics(name, values)
        counted_values = values[limited_metrics].dropna()
        missed_values = shortfall[[m for m in limited_metrics if m in shortfall]].dropna()
        if len(counted_values) and len(missed_values):
            yield name, "yield", audited_share(_passes(study, name, counted_values, missed_values), confidence)


def _passes(study: Study, name: str, counted_values: pd.DataFrame, missed_values: pd.DataFrame) -> Iterator[np.ndarray]:
    """Whether each unit keeps a limit, or all (n,), with the shortfall of each audited one."""
    for row in range(len(missed_values)):
        true = {
            metric: counted_values[metric].to_numpy(float)
            + (missed_values[metric].iloc[row] if metric in missed_values else 0.0)
            for metric in counted_values
        }
        yield study.limits.pass_flags(true)[name]

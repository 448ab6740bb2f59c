"""The worst of units over the whole turn: what the search found, and what the audited samples correct it by."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns
from pipeline.model.metrics import library
from pipeline.statistics.intervals import Estimate
from pipeline.statistics.two_phase import audited_distribution, audited_share
from stages.clearance import rigid_angles
from stages.tables.turn import Turn
from stages.worst import N_PHASES, OF_PITCHES

WHOLE_TURN = "whole_turn"
"""What estimates for the whole turn are over."""
CONTINUOUS_TURN = "continuous_turn"
"""What bounds for all angles between the pitches and their phases are over."""
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


def shortfalls(units: pd.DataFrame, audit: Columns) -> pd.DataFrame:
    """What each metric's worst of the audited units lies beyond that in the table of units, by sample."""
    audit_rows = pd.DataFrame(dict(audit)).set_index("sample")
    found_rows = units.set_index("sample").loc[audit_rows.index]
    beyond = {}
    for name, metric in library().items():
        difference = audit_rows[f"{name}_worst"] - found_rows[f"{name}_worst"]
        beyond[name] = difference.clip(upper=0.0) if metric.smaller_is_worse else difference.clip(lower=0.0)
    return pd.DataFrame(beyond)


def left_between(audit: Columns) -> pd.DataFrame | None:
    """What angles between those of the audit add to each metric's worst of the audited units in the mean, at most.

    None where one phase of each pitch is looked at.

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
    return pd.DataFrame({name: share * (rows[f"{name}_worst"] - rows[OF_PITCHES[name].name]) for name in library()})


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
    for name in library():
        found_values, missed_values = values[name].dropna().to_numpy(float), shortfall[name].dropna().to_numpy(float)
        if len(found_values) and len(missed_values):
            for statistic, estimate in audited_distribution(found_values, missed_values, confidence).items():
                yield name, statistic, estimate
    if study.limits.over != "worst":
        return
    for name in study.limits.pass_flags({column: values[column].to_numpy(float) for column in values}):
        limited_metrics = study.limits.limited_metrics(name, values)
        counted_values, missed_values = (
            values[limited_metrics].dropna(),
            shortfall[[m for m in limited_metrics if m in shortfall]].dropna(),
        )
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

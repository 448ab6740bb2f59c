"""How worst values, yields and quantiles move with the number of crank angles and of samples."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS, ANGLES_TO_CONTINUE, Study
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.sampling.designs import replicates
from pipeline.statistics.intervals import Estimate, distribution, pass_share
from stages.clearance import rigid_angles
from stages.tables.turn import Turn
from stages.worst import RANGES

STRIDES = (8, 4, 2, 1)
"""Every so many of the crank angles: how the worst value moves as they double."""
FEWEST_ANGLES = ANGLES_TO_CONTINUE // 4
"""Crank angles that a worst is looked at from at least, to see how it moves."""

CONVERGENCE = Table(
    "convergence",
    "metric, number of crank angles",
    (
        Column("metric", "label", "", "column of metrics; all_limits: against all limits together"),
        Column("n_angles", "int32", "1", "crank angles, evenly among those of the run; or twice its own"),
        Column("worst_mean", "float64", "the metric's", "mean over the samples of the worst over these angles"),
        Column("yield", "float64", "1", "share of the samples whose worst over these angles keeps the limit"),
        Column("extrapolated", "bool", "", "whether the run has fewer angles: as far again as in the last row"),
        Column(
            "worst_mean_settled",
            "float64",
            "the metric's",
            "worst_mean, if each further change is a quarter of the one before",
        ),
        Column("yield_settled", "float64", "1", "yield, if each further change is a quarter of the one before"),
    ),
)


def angles_of_turn(study: Study, stride: int, of_play: bool) -> int:
    """Crank angles that a metric of the turn rests on, if every so many of the even ones are looked at."""
    if stride == 1:
        return len(rigid_angles(study) if of_play else study.cycle.crank_deg)
    return -(-len(study.cycle.even_crank_deg if of_play else study.cycle.crank_deg) // stride)


def searched_pitches(study: Study) -> int:
    """Pitches of the output turn among which the worst of units is searched for; 0 where it is not."""
    return study.design.cycloid.pins * study.design.cycloid.lobes if study.cycle.has_turn_search else 0


def strides_of(study: Study) -> list[int]:
    """Strides over the crank angles of a study that leave enough of them, descending to 1; 1 alone of uneven angles."""
    if not study.cycle.evenly_loaded:
        return [1]
    fewest = min(len(study.cycle.crank_deg), len(study.cycle.even_crank_deg))
    return [stride for stride in STRIDES if stride == 1 or fewest // stride >= FEWEST_ANGLES]


def worst_of_stride(turns: Mapping[str, Turn], stride: int) -> dict[str, np.ndarray]:
    """The worst of every metric (n,) over every so many of its even angles; over all angles for a stride of 1."""
    worst = {}
    for name, turn in turns.items():
        values = turn.worst_values[:, turn.is_even][:, ::stride] if stride > 1 else turn.worst_values
        worst[name] = library()[name].over_turn(values)[0]
    return worst


def convergence_rows(
    study: Study,
    of_strides: Mapping[int, Mapping[str, np.ndarray]],
    is_counted: np.ndarray,
    units: Mapping[str, np.ndarray],
) -> Columns:
    """How worst values and yields move with the number of crank angles, and how they would with twice as many.

    Parameters
    ----------
    of_strides : the worst of every metric and the metrics of the turn (n,) by name, at every so many of the angles, as
        `strides_of` has them.
    is_counted : (n,) samples of the statistics.
    units : columns of the table of units; a worst that was searched for is the last row of its metric.
    """
    rows: list[dict[str, object]] = []
    turns = library()
    for stride, columns in of_strides.items():
        worst_values = {name: values[is_counted] for name, values in columns.items()}
        angles = {name: angles_of_turn(study, stride, metric.of_play) for name, metric in turn_library().items()}
        for name, metric in turns.items():
            angles[name] = angles_of_turn(study, stride, metric.turn_of_rigid_bodies)
        rows += _rows(study, worst_values, angles)
    if study.cycle.has_turn_search:
        worst_values |= {name: units[f"{name}_worst"][is_counted] for name in turns}
        worst_values |= {name: units[name][is_counted] for name in RANGES}
        search_rows = _rows(study, worst_values, dict.fromkeys((*turns, *RANGES), searched_pitches(study)))
        rows += [row for row in search_rows if row["metric"] in RANGES or row["metric"] not in turn_library()]
    frame = pd.DataFrame(rows)
    for name, part in (
        frame.groupby("metric", sort=False) if len(of_strides) > 2 and not study.cycle.has_turn_search else ()
    ):
        doubled_values: dict[str, float] = {}
        for key in ("worst_mean", "yield"):
            doubled_values[key], doubled_values[f"{key}_settled"] = continuation(part[key].to_numpy())
        for key in ("yield", "yield_settled"):
            doubled_values[key] = float(np.clip(doubled_values[key], 0.0, 1.0))
        rows.append(
            {"metric": name, "n_angles": 2 * int(part["n_angles"].iloc[-1]), **doubled_values, "extrapolated": True}
        )
    return CONVERGENCE.columns_of_rows(rows)


def _rows(study: Study, worst_values: Mapping[str, np.ndarray], angles: Mapping[str, int]) -> list[dict[str, object]]:
    """Mean worst values and yields of units (n,) from so many crank angles."""
    rows: list[dict[str, object]] = []
    passes_limit = study.limits.pass_flags(worst_values)
    for name in (*worst_values, *([ALL_LIMITS] if passes_limit else [])):
        limited_metrics = study.limits.limited_metrics(name, worst_values)
        holding = ~np.isnan([worst_values[metric] for metric in limited_metrics]).any(axis=0)
        share = float(passes_limit[name][holding].mean()) if name in passes_limit and holding.any() else np.nan
        mean = float(worst_values[name][holding].mean()) if name in worst_values and holding.any() else np.nan
        n_angles = angles.get(name, min(angles.values()))
        rows.append({"metric": name, "n_angles": n_angles, "worst_mean": mean, "yield": share, "extrapolated": False})
    return rows


SETTLED_RATE = 0.25
"""Ratio of successive changes once the angles are close: the largest of evenly spaced values of a smooth curve misses
its peak by a second order of their distance."""


def continuation(values: np.ndarray) -> tuple[float, float]:
    """The next of values whose number of crank angles doubles, as far again and by ``SETTLED_RATE`` of the last change.

    As far again is what angles that each show something of their own give, and more only where they are few; a quarter
    is what a curve gives that is smooth between them. The next value lies between the two but for those few angles.
    """
    last_change = values[-1] - values[-2]
    return float(values[-1] + last_change), float(values[-1] + SETTLED_RATE * last_change)


FEWEST_SAMPLES = 20
"""A 5 % quantile of fewer is their least."""
NUMBERS_PER_DECADE = 10
"""Of samples, so that neighbours are 26 % apart."""
QUANTILES = ("p05", "p50", "p95")

SAMPLE_CONVERGENCE = Table(
    "sample_convergence",
    "metric, statistic, number of samples",
    (
        Column("metric", "label", "", "headline metric, over the turn as its limit means it; or all_limits"),
        Column("statistic", "label", "", "p05, p50, p95: quantile; yield: the share within all limits together"),
        Column("n", "int32", "1", "samples, the first of the study, that it rests on"),
        Column("value", "float64", "the metric's", "estimate"),
        *interval_columns("the metric's"),
    ),
)


def sample_convergence_rows(study: Study, values: pd.DataFrame) -> Columns:
    """Estimates from the first 20, 25, 32, ... samples, up to all of them.

    Parameters
    ----------
    values : metrics of every sample of the statistics, by sample, over the turn as the limits mean it.
    """
    parts: list[tuple[str, pd.DataFrame]] = []
    for name, metric in library().items():
        if metric.headline:
            parts.append((name, values[[name]].dropna()))
    within_limits = study.limits.pass_flags(values)
    if ALL_LIMITS in within_limits:
        holding = values[study.limits.limited_metrics(ALL_LIMITS, values)].notna().all(axis=1)
        parts.append((ALL_LIMITS, pd.DataFrame({ALL_LIMITS: within_limits[ALL_LIMITS]}, index=values.index)[holding]))
    rows = []
    for name, column in parts if study.samples.experiment != "cases" else ():
        for n in numbers_of_samples(len(column), study.samples.randomisations if study.samples.has_replicates else 1):
            for statistic, estimate in _estimates(study, name, column.iloc[:n]).items():
                rows.append({"metric": name, "statistic": statistic, **vars(estimate)})
    return SAMPLE_CONVERGENCE.columns_of_rows(rows)


def numbers_of_samples(n: int, multiple: int) -> list[int]:
    """Numbers of samples from `FEWEST_SAMPLES` on, evenly by their logarithm and each a ``multiple``, and ``n``."""
    steps = np.log10(max(n, FEWEST_SAMPLES) / FEWEST_SAMPLES) * NUMBERS_PER_DECADE
    spread = FEWEST_SAMPLES * 10 ** (np.arange(int(steps) + 1) / NUMBERS_PER_DECADE)
    numbers = {-(-round(number) // multiple) * multiple for number in spread}
    return sorted({number for number in numbers if number < n} | ({n} if n else set()))


def _estimates(study: Study, name: str, values: pd.DataFrame) -> dict[str, Estimate]:
    confidence, replicate = study.metrics.confidence, replicates(study.samples, values.index.to_numpy())
    if name == ALL_LIMITS:
        return {"yield": pass_share(values[name].to_numpy(bool), confidence, replicate)}
    estimates = distribution(values[name].to_numpy(float), confidence, replicate)
    return {statistic: estimates[statistic] for statistic in QUANTILES}

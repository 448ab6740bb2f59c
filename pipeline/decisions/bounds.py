"""Tables of the worst cases, the linear stacks and the capabilities of a study."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.decisions.box import Box, Capability, Evaluate, capability, coordinate_search, stack, statistics_of
from pipeline.decisions.play_bounds import Bound, play_bounds
from pipeline.engine.store import write_tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.model.metrics import library
from pipeline.sampling.designs import uniforms
from pipeline.sampling.errors import Errors, dimensions, errors_at

SolveAt = Callable[[float, Errors], Mapping[str, Real]]
"""Crank angle [deg] and errors of ``n`` units to each metric there (n,)."""

WORST_FOUND = "worst found under load: a worse one may exist"
WORST_OF_VALID = "worst found under load where the model is valid: some errors within the limits lead beyond it"
STARTS = 4
"""Vertices drawn at random from which the worst under load is sought, beside the centre: from that alone the largest
pressure of the study ``quick`` is 14 % too small at one angle."""
UNITS = 2000
"""Drawn units of which linear stack and full model are compared: their standard deviations to 1.6 %."""

BOUNDS = Table(
    "bounds",
    "metric, crank angle, kind of bound",
    (
        Column("metric", "label", "", "column of metrics"),
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("what", "label", "", "which extreme over the tolerance box, and whether exact or from which side"),
        Column("value", "float64", "the metric's", "the bound"),
    ),
)
STACKS = Table(
    "stacks",
    "metric, crank angle, statistic",
    (
        Column("metric", "label", "", "column of metrics"),
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("statistic", "label", "", "mean, std (linear: root sum of squares), far (99.73 % on the worse side)"),
        Column("linear", "float64", "the metric's", "of the linear stack about the middle of the zones"),
        Column("full", "float64", "the metric's", "of the full model, the same units"),
    ),
)
CONTRIBUTIONS = Table(
    "contributions",
    "metric, crank angle, tolerance",
    (
        Column("metric", "label", "", "column of metrics"),
        Column("crank_deg", "float64", "deg", "crank angle"),
        Column("parameter", "label", "", "tolerance"),
        Column("percent", "float64", "%", "of the variance of the linear stack"),
    ),
)
CAPABILITY = Table(
    "capability",
    "metric that has a limit",
    (
        Column("metric", "label", "", "column of metrics, over the turn as the limits mean it"),
        Column("mean", "float64", "the metric's", "of the samples"),
        Column("std", "float64", "the metric's", "of the samples"),
        Column("cpk", "float64", "1", "limit less mean over three standard deviations"),
        Column("yield_if_normal", "float64", "1", "yield that C_pk implies where the metric is normal"),
        Column("yield", "float64", "1", "share of the samples within the limit"),
        *interval_columns("1"),
        Column("n", "int32", "1", "samples"),
        Column("is_normal_plausible", "bool", "", "whether the yield of C_pk lies within that interval"),
    ),
)


@dataclass(frozen=True)
class BoundFindings:
    """What was found of a study.

    Attributes
    ----------
    stacks : rows (metric, crank_deg, statistic, linear, full).
    contributions : rows (metric, crank_deg, tolerance, percent).
    """

    study: Study
    bounds: tuple[Bound, ...]
    stacks: tuple[tuple[str, float, str, float, float], ...]
    contributions: tuple[tuple[str, float, str, float], ...]
    capabilities: tuple[Capability, ...]


def bounded_metrics(study: Study) -> list[str]:
    """Metrics under load that are bounded: the headlines and those that have a limit."""
    limits = study.limits.of_metrics
    return [
        name
        for name, metric in library().items()
        if (metric.headline or name in limits) and not metric.turn_of_rigid_bodies
    ]


def all_bounded(study: Study) -> list[str]:
    """Every metric that is bounded: those of rigid bodies, and those under load."""
    return [*(name for name, metric in library().items() if metric.turn_of_rigid_bodies), *bounded_metrics(study)]


def findings(
    study: Study, cranks: Sequence[float], solve: SolveAt, units: pd.DataFrame, advance: Callable[[], None]
) -> BoundFindings:
    """Worst cases, stacks and capabilities.

    Parameters
    ----------
    cranks : crank angles [deg] of bounds and stacks.
    units : metrics of the study's samples over the turn as its limits mean them, one column each.
    advance : called when one of `all_bounded` is done at one crank angle.

    Raises
    ------
    InputError
        If the study has no tolerance box.
    """
    box = Box.from_study(study)
    samples = study.samples.model_copy(update={"experiment": "monte_carlo", "count": UNITS})
    numbers = uniforms(samples, sum(dimensions(study).values()), 0, UNITS)
    bounds, stacks, contributions = [], [], []
    for crank in cranks:
        rigid = [name for name, metric in library().items() if metric.turn_of_rigid_bodies]
        bounds += [bound for name in rigid for bound in play_bounds(box, crank, name)]
        drawn_metrics = solve(crank, errors_at(study, numbers))
        for metric in all_bounded(study):
            evaluate = partial(_metric_at, solve, box, crank, metric)
            if metric not in rigid:
                sign = -1.0 if library()[metric].smaller_is_worse else 1.0
                quantity, worst_value = _worst_found(box, partial(_signed_value, evaluate, sign))
                bounds.append(Bound(metric, crank, quantity, sign * worst_value))
            linear = stack(study, box, evaluate, numbers)
            is_finite = np.isfinite(drawn_metrics[metric])
            full = statistics_of(metric, drawn_metrics[metric][is_finite])
            of_stack = statistics_of(metric, linear.values[is_finite])
            of_stack["std"] = linear.rss
            stacks += [(metric, crank, name, of_stack[name], full[name]) for name in full]
            contributions += [(metric, crank, name, 100 * share) for name, share in linear.shares.items()]
            advance()
    capabilities = [
        capability(name, units[name].dropna().to_numpy(float), limit, study.metrics.confidence)
        for name, limit in study.limits.of_metrics.items()
        if name in library() and units[name].notna().sum() > 1
    ]
    return BoundFindings(study, tuple(bounds), tuple(stacks), tuple(contributions), tuple(capabilities))


def _worst_found(box: Box, evaluate: Evaluate) -> tuple[str, float]:
    """The largest value that a search from the centre or from a drawn vertex finds, and what it is."""
    climbs = [coordinate_search(box, evaluate, start) for start in (box.centre, *box.drawn_vertices(STARTS))]
    quantity = WORST_FOUND if all(climb.is_complete for climb in climbs) else WORST_OF_VALID
    return quantity, max(climb.value for climb in climbs)


def _metric_at(solve: SolveAt, box: Box, crank_deg: float, metric: str, points: Real) -> Real:
    return solve(crank_deg, box.errors(points))[metric]


def _signed_value(evaluate: Evaluate, sign: float, points: Real) -> Real:
    return sign * evaluate(points)


def table_rows(bound_findings: BoundFindings) -> dict[Table, Columns]:
    """Rows of the four tables."""
    capabilities = []
    for of_limit in bound_findings.capabilities:
        of_normal = (of_limit.metric, of_limit.mean, of_limit.std, of_limit.cpk, of_limit.yield_if_normal)
        share = of_limit.pass_estimate
        passing = (share.value, share.ci_low, share.ci_high, share.n)
        capabilities.append((*of_normal, *passing, of_limit.is_normal_plausible))
    bounds = [(entry.metric, entry.crank_deg, entry.quantity, entry.value) for entry in bound_findings.bounds]
    rows = {
        BOUNDS: bounds,
        STACKS: bound_findings.stacks,
        CONTRIBUTIONS: bound_findings.contributions,
        CAPABILITY: capabilities,
    }
    return {table: table.columns_of_rows(content) for table, content in rows.items()}


def write(bound_findings: BoundFindings, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the tables as CSV and Parquet into ``folder``; their frames by name."""
    return write_tables(table_rows(bound_findings), folder, as_csv=True)

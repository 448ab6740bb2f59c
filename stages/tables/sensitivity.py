"""Which errors drive the metrics: rank correlations of the samples, and shares of the variance by group of errors."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config.dimensions import dimension_library
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Job
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.sampling.designs import replicates
from pipeline.sampling.pick_freeze import drawn_units, error_groups
from pipeline.statistics.sensitivity import (
    FIRST_ORDER,
    RANK_CORRELATION,
    SUM,
    TOTAL,
    rank_correlation,
    two_fidelity_indices,
    variance_indices,
)
from stages.sample import SAMPLED_TABLES
from stages.worst import RANGES

RANKED_SAMPLES = 20_000
"""Samples that rank correlations are taken from at most: their intervals are below 0.02 by then."""
EXPLAINED_VALUES = ("worst", "mean")
"""What of a metric over the turn has shares of its variance."""

SENSITIVITY = Table(
    "sensitivity",
    "metric, parameter, kind",
    (
        Column("metric", "label", "", "column of metrics"),
        Column("over", "label", "", "worst or mean: of each unit over the turn; turn: a metric of the whole turn"),
        Column("parameter", "label", "", "error of a sample, group of errors, or sum: all groups' shares together"),
        Column(
            "kind",
            "label",
            "",
            "rank_correlation; share of the variance that a group causes by itself (first_order), or that would remain "
            "if all others were known (total)",
        ),
        Column("index", "float64", "1", "the index; null: the samples do not determine it"),
        *interval_columns("1"),
        Column("n", "int32", "1", "samples, or base samples of the pick-freeze design, that it rests on"),
    ),
)


def sensitivity(job: Job, units: Columns, of_angles: Columns, worst_values: pd.DataFrame) -> Columns:
    """Rows of the table of indices.

    Parameters
    ----------
    units : table of units, all samples.
    of_angles : worst, mean and best of every metric over the angles of the study alone.
    worst_values : metrics by sample, worst over the turn; the nominal sample and those without a result left out.
    """
    study: Study = job.study
    if study.samples.experiment == "cases":  # stated units are no sample of anything
        return SENSITIVITY.empty()
    rows = [
        *(_ranks(job, worst_values.iloc[:RANKED_SAMPLES]) if len(worst_values) else []),
        *_shares(job, units, of_angles),
    ]
    return SENSITIVITY.columns_of_rows(rows)


def _row(
    metric: str, turn_value: str, parameter: str, kind: str, values: tuple[float, float, float], n: int
) -> dict[str, Any]:
    index, low, high = values
    row = {"metric": metric, "over": turn_value, "parameter": parameter, "kind": kind}
    return {**row, "index": index, "ci_low": low, "ci_high": high, "n": n}


def _ranks(job: Job, worst_values: pd.DataFrame) -> list[dict[str, Any]]:
    """Rank correlations of every metric, each over the samples for which it holds."""
    study: Study = job.study
    scalar_table, rows = _scalars(job, worst_values.index.to_numpy()), []
    for metric in (*library(), *turn_library()):
        holding = worst_values[metric].notna().to_numpy()
        if not holding.any():
            continue
        scalars = {name: values[holding] for name, values in scalar_table.items()}
        samples = worst_values.index.to_numpy()[holding]
        values = worst_values[metric].to_numpy()[holding, None]
        indices = rank_correlation(scalars, values, study.metrics.confidence, replicates(study.samples, samples))
        triples = zip(indices.value[:, 0], indices.ci_low[:, 0], indices.ci_high[:, 0], strict=True)
        rows += [
            _row(metric, "worst" if metric in library() else "turn", parameter, RANK_CORRELATION, triple, len(samples))
            for parameter, triple in zip(indices.parameters, triples, strict=True)
        ]
    return rows


def _scalars(job: Job, samples: np.ndarray) -> Mapping[str, np.ndarray]:
    """One number (n,) per error of the given samples: of errors of elements their mean."""
    stop = int(samples[-1]) + 1
    tables = {name: job.read_items("sample", name, 0, stop) for name in SAMPLED_TABLES}
    several = len(tables["disks"]["disk"]) > stop
    means, reducer = {}, dict(tables["reducer"])
    varying = {name for name in dimension_library() if getattr(job.study.tolerances, name).varies}
    carriers = {dimension.acts_on for dimension in dimension_library().values() if dimension.name in varying} - varying
    for dimension in dimension_library().values():
        if dimension.name in carriers:  # what it holds is that of the dimension that acts through it
            reducer.pop(dimension.column, None)
            continue
        table = "disks" if dimension.of_disk and not dimension.elements else dimension.table
        if (dimension.elements or (several and dimension.of_disk)) and len(tables[table][dimension.column]):
            means[f"{dimension.name}_mean_um"] = tables[table][dimension.column].reshape(stop, -1).mean(axis=1)
            reducer.pop(dimension.column, None)
    scalar_columns = {
        name: values for name, values in reducer.items() if name != "sample" and not name.endswith("_rad")
    }
    return {name: np.asarray(values)[samples] for name, values in {**scalar_columns, **means}.items()}


def _shares(job: Job, units: Columns, of_angles: Columns) -> list[dict[str, Any]]:
    """First-order and total indices of every group; none where the study asks for none or nothing varies.

    Those of the worst over a turn that is searched, and of transmission errors over it, rest on the searched units,
    with the help of the values over the angles of the study, which all units have.
    """
    study: Study = job.study
    groups, n = error_groups(study), study.drivers.base_samples
    if not (n and groups):
        return []
    extra, shift = job.read("drivers", "units"), int(study.samples.nominal_first)
    drawn_rows = slice(shift, shift + drawn_units(study))
    rows = []
    columns = {
        (metric, turn_value): f"{metric}_{turn_value}" for metric in library() for turn_value in EXPLAINED_VALUES
    }
    for (metric, turn_value), column in (columns | {(metric, "turn"): metric for metric in turn_library()}).items():
        samples = (of_angles if column in of_angles else units)[column]
        values = np.concatenate([np.asarray(samples)[drawn_rows], extra[column]]).reshape(-1, n)
        if study.cycle.has_turn_search and (turn_value == "worst" or metric in RANGES):
            worse_values = worse_of_two(metric, extra[column], extra[f"{metric}_found"])
            worse_values = np.concatenate([np.asarray(units[column])[drawn_rows], worse_values]).reshape(-1, n)
            indices = two_fidelity_indices(values, worse_values, study.metrics.confidence)
        else:
            indices = variance_indices(values[0], values[1], values[2:], study.metrics.confidence)
        for kind, shares in ((FIRST_ORDER, indices.first_order), (TOTAL, indices.total)):
            triples = zip(shares.value, shares.ci_low, shares.ci_high, strict=True)
            rows += [
                _row(metric, turn_value, parameter, kind, triple, indices.n)
                for parameter, triple in zip((*groups, SUM), triples, strict=True)
            ]
    return rows


def worse_of_two(metric: str, first_values: np.ndarray, second_values: np.ndarray) -> np.ndarray:
    """The worse of two values of a metric (n,), missing where either is."""
    worse_of = np.minimum if metric in library() and library()[metric].smaller_is_worse else np.maximum
    worse: np.ndarray = worse_of(first_values, second_values)
    return worse

"""Two runs side by side: which inputs differ, and by how much mean, spread, quantiles and yield of every metric."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.sampling.designs import replicates, uniforms
from pipeline.sampling.errors import dimensions
from pipeline.statistics.differences import (
    Replicate,
    enough_beyond,
    mean_difference,
    order_differences,
    replicated_difference,
    share_difference,
)
from pipeline.statistics.intervals import QUANTILES, mean, quantile, standard_deviation
from pipeline.statistics.resampling import FEWEST_BEYOND

DIFFERENCES = Table(
    "differences",
    "metric, statistic",
    (
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits of each run"),
        Column("statistic", "label", "", "mean, std, quantile, yield, or the label of a listed case"),
        Column("a", "float64", "the metric's", "of run A, over the samples compared"),
        Column("b", "float64", "the metric's", "of run B"),
        Column("difference", "float64", "the metric's", "b less a"),
        *interval_columns("the metric's", "confidence interval of the difference"),
        Column("n_a", "int32", "1", "samples of run A that it rests on"),
        Column("n_b", "int32", "1", "samples of run B"),
        Column("paired", "bool", "", "whether the samples share their draws, and are compared one by one"),
    ),
)
INPUTS = Table(
    "inputs",
    "setting that differs",
    (
        Column("key", "label", "", "of the study, or of its design"),
        Column("a", "label", "", "in run A; null where it is absent"),
        Column("b", "label", "", "in run B; null where it is absent"),
    ),
)
DRIVER_CHANGES = Table(
    "drivers",
    "metric, parameter, kind",
    (
        Column("metric", "label", "", "column of metrics"),
        Column("parameter", "label", "", "error of a sample, or group of errors"),
        Column("kind", "label", "", "as in the table of sensitivity"),
        *(
            Column(f"{name}_{run}", "float64", "1", f"{meaning}, of run {run.upper()}; null: not determined")
            for run in "ab"
            for name, meaning in (("index", "the index"), ("ci_low", "its lower end"), ("ci_high", "its upper end"))
        ),
    ),
)
UNCOMPARED_KEYS = ("name", "title", "description", "run", "costs", "design.title", "design.source", "design.provenance")
"""Settings that change no result."""


@dataclass(frozen=True)
class ComparedRun:
    """A study with the metrics of its units over the turn, as its limits mean them, (n,) each, indexed by sample.

    The nominal reducer is none of the units.
    """

    study: Study
    units: pd.DataFrame
    sensitivity: pd.DataFrame

    @property
    def label(self) -> str:
        """How the run is called."""
        return self.study.name


def differing_inputs(a: Study, b: Study) -> list[tuple[str, Any, Any]]:
    """Dotted key and both values of every setting that differs; None where a study has none."""
    settings = [dict(_flat(study.model_dump())) for study in (a, b)]
    keys = sorted(set(settings[0]) | set(settings[1]))
    rows = [(key, settings[0].get(key), settings[1].get(key)) for key in keys]
    return [row for row in rows if row[1] != row[2] and not _is_uncompared(row[0])]


def _is_uncompared(key: str) -> bool:
    return any(key == name or key.startswith(f"{name}.") for name in UNCOMPARED_KEYS)


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, value


def shared_draws(a: Study, b: Study) -> int:
    """Draws that two studies have in common, from the first on: those of the shorter one, or 0.

    Notes
    -----
    They share them where a draw has as many numbers for each tolerance and the numbers are equal; the first and the
    last are compared.
    """
    sizes = dimensions(a)
    if sizes != dimensions(b) or "cases" in (a.samples.experiment, b.samples.experiment):
        return 0
    if a.samples.has_replicates and a.samples.randomisations != b.samples.randomisations:
        return 0
    n = min(a.samples.count, b.samples.count)
    for k in (0, n - 1):
        of_a, of_b = (uniforms(study.samples, sum(sizes.values()), k, k + 1) for study in (a, b))
        if not np.array_equal(of_a, of_b):
            return 0
    return n


def check_comparable(a: Study, b: Study) -> None:
    """Refuse two studies that cannot be compared.

    Raises
    ------
    InputError
        If they share a name though they differ, one lists cases and the other draws samples, or no case is in both.
    """
    if a.name == b.name and differing_inputs(a, b):
        raise InputError(f"A and B are both named {a.name}, and a run is stored by its name; rename one of the files")
    has_cases = [study.samples.experiment == "cases" for study in (a, b)]
    if any(has_cases) and not all(has_cases):
        name = (a if has_cases[0] else b).name
        raise InputError(f"study {name}: it lists cases, the other study draws samples; compare two lists of cases")
    if all(has_cases) and not {case.label for case in a.cases} & {case.label for case in b.cases}:
        raise InputError(f"studies {a.name} and {b.name}: no case has the same label in both; rename some")


def differences(a: ComparedRun, b: ComparedRun) -> Columns:
    """Rows of `DIFFERENCES`: `b` less `a`."""
    rows = _case_rows(a, b) if a.study.samples.experiment == "cases" else _sample_rows(a, b)
    return DIFFERENCES.columns_of_rows(rows)


def _case_rows(a: ComparedRun, b: ComparedRun) -> list[tuple[Any, ...]]:
    """The cases of equal labels, one by one: nothing about them is random."""
    values = [_by_label(run) for run in (a, b)]
    common = [label for label in values[0].index if label in values[1].index]
    rows = []
    for label in common:
        for metric in library():
            pair = [float(entry.loc[label, metric]) for entry in values]
            rows.append((metric, label, *pair, pair[1] - pair[0], np.nan, np.nan, 1, 1, True))
    return rows


def _by_label(run: ComparedRun) -> pd.DataFrame:
    shift = int(run.study.samples.nominal_first)
    labels = {shift + k: case.label for k, case in enumerate(run.study.cases)}
    units = run.units[run.units.index.isin(labels)]
    return units.set_axis([labels[int(sample)] for sample in units.index])


@dataclass(frozen=True)
class _Pair:
    """Values of both runs with what their intervals need: rows in common if paired."""

    values: tuple[pd.DataFrame, pd.DataFrame]
    replicate: tuple[Replicate, Replicate]
    confidence: float
    is_paired: bool
    seed: int

    @property
    def has_replicates(self) -> bool:
        """Whether both come in independent randomisations."""
        return all(entry is not None for entry in self.replicate)


def _sample_rows(a: ComparedRun, b: ComparedRun) -> list[tuple[Any, ...]]:
    n = shared_draws(a.study, b.study)
    frames = [run.units.set_axis(run.units.index - int(run.study.samples.nominal_first)) for run in (a, b)]
    if n:
        common = frames[0].index.intersection(frames[1].index)
        frames = [frame.loc[common[common < n]] for frame in frames]
    draws = [
        replicates(run.study.samples, frame.index.to_numpy() + int(run.study.samples.nominal_first))
        for run, frame in zip((a, b), frames, strict=True)
    ]
    pair = _Pair((frames[0], frames[1]), (draws[0], draws[1]), a.study.metrics.confidence, n > 0, a.study.samples.seed)
    rows = [row for metric in library() for row in _metric_rows(pair, metric)]
    within_limits = [run.study.limits.pass_flags(frame) for run, frame in zip((a, b), frames, strict=True)]
    for name in (name for name in within_limits[0] if name in within_limits[1]):
        limited_metrics = [
            run.study.limits.limited_metrics(name, frame) for run, frame in zip((a, b), frames, strict=True)
        ]
        has_value = [
            frame[names].notna().all(axis=1).to_numpy() for frame, names in zip(frames, limited_metrics, strict=True)
        ]
        rows += _yield_rows(pair, name, (within_limits[0][name], within_limits[1][name]), (has_value[0], has_value[1]))
    return rows


def _known_values(
    pair: _Pair, has_value: tuple[Any, ...], values: tuple[Any, ...]
) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Values and replicates of what is known, of both runs where they are paired."""
    if pair.is_paired:
        has_value = (has_value[0] & has_value[1],) * 2
    replicate = tuple(None if r is None else r[k] for r, k in zip(pair.replicate, has_value, strict=True))
    return tuple(v[k] for v, k in zip(values, has_value, strict=True)), replicate


def _metric_rows(pair: _Pair, metric: str) -> Iterator[tuple[Any, ...]]:
    total = tuple(frame[metric].to_numpy(float) for frame in pair.values)
    (a, b), replicate = _known_values(pair, tuple(np.isfinite(entry) for entry in total), total)
    if min(a.size, b.size) == 0:
        return
    if min(a.size, b.size) == 1:  # which has no spread, and so no interval
        yield (metric, "mean", mean(a), mean(b), mean(b) - mean(a), -np.inf, np.inf, a.size, b.size, pair.is_paired)
        return
    statistics: dict[str, Callable[[Real], float]] = {"mean": mean, "std": standard_deviation}
    statistics |= {name: partial(quantile, level=level) for name, level in QUANTILES.items()}
    if pair.has_replicates:
        ends = {
            name: replicated_difference(statistic, (a, b), replicate, pair.confidence, pair.is_paired)
            if enough_beyond(min(a.size, b.size), QUANTILES.get(name, 0.5))
            else (-np.inf, np.inf)
            for name, statistic in statistics.items()
        }
    else:
        ends = {"mean": mean_difference(a, b, pair.confidence, pair.is_paired)}
        ends |= order_differences(a, b, pair.confidence, pair.is_paired, pair.seed)
    for name, statistic in statistics.items():
        of_a, of_b = statistic(a), statistic(b)
        yield (metric, name, of_a, of_b, of_b - of_a, *ends[name], a.size, b.size, pair.is_paired)


def _yield_rows(
    pair: _Pair, name: str, within_limit: tuple[Any, ...], has_value: tuple[Any, ...]
) -> Iterator[tuple[Any, ...]]:
    (a, b), replicate = _known_values(pair, has_value, within_limit)
    if min(a.size, b.size) == 0:
        return
    n_different = np.count_nonzero(a != b) if pair.is_paired else a.size
    varies = 0 < np.mean(a) < 1 and 0 < np.mean(b) < 1
    if pair.has_replicates and varies and n_different >= FEWEST_BEYOND:  # fewer pairs show no spread of replicates
        passes = (a.astype(float), b.astype(float))
        ends = replicated_difference(mean, passes, replicate, pair.confidence, pair.is_paired)
    else:
        ends = share_difference(a, b, pair.confidence, pair.is_paired)
    of_a, of_b = float(a.mean()), float(b.mean())
    yield (name, "yield", of_a, of_b, of_b - of_a, *ends, a.size, b.size, pair.is_paired)


def driver_changes(a: ComparedRun, b: ComparedRun) -> Columns:
    """Rows of `DRIVER_CHANGES`: indices of the worst over the turn in both runs."""
    keys = ["metric", "parameter", "kind"]
    parts = []
    for run in (a, b):
        table = run.sensitivity[run.sensitivity["over"] == "worst"]
        parts.append(table.astype(dict.fromkeys(keys, str))[[*keys, "index", "ci_low", "ci_high"]])
    indices = parts[0].merge(parts[1], on=keys, how="outer", suffixes=("_a", "_b"))
    return {column.name: indices[column.name].to_numpy() for column in DRIVER_CHANGES.columns}

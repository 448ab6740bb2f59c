"""How the yield and the quantiles of a study, and what is known of them, move with the number of samples."""

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.metrics import library
from pipeline.sampling import replicates
from pipeline.statistics import Estimate, distribution, pass_share

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
        Column("ci_low", "float64", "the metric's", "lower end of the confidence interval"),
        Column("ci_high", "float64", "the metric's", "upper end of the confidence interval"),
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
    frame = pd.DataFrame(rows, columns=[column.name for column in SAMPLE_CONVERGENCE.columns])
    return {name: frame[name].to_numpy() for name in frame} if rows else SAMPLE_CONVERGENCE.empty()


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

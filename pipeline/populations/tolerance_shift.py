"""Which tolerance would close the difference between measured units and a study, if any within its limits does."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy  # its statistics are slow to import: they are when they are called

from pipeline.arrays import Real
from pipeline.config import Study
from pipeline.config.dimensions import dimension_library
from pipeline.errors import InputError
from pipeline.model.metrics import measurable_metrics
from pipeline.populations.comparison import MetricComparison, metrics_at

ALPHA = 0.05
"""Level at which what a shift leaves is called a difference."""
SPARE_SAMPLES = 10
"""Samples beyond the number of slopes and metrics: with fewer the scatter about the slopes is not known."""
ITERATIONS = 10
"""Of the shift and its weights, which depend on each other weakly."""


@dataclass(frozen=True)
class StudyPopulation:
    """A run as the comparison needs it, without the nominal reducer.

    Attributes
    ----------
    study : its settings.
    metrics : the table of that name.
    deviations : mean deviation of each tolerance of every sample [um], indexed by sample.
    """

    study: Study
    metrics: pd.DataFrame
    deviations: pd.DataFrame


@dataclass(frozen=True)
class Candidate:
    """A shift of one tolerance that comes closest to closing the differences of all metrics at once.

    Attributes
    ----------
    tolerance : name.
    shift_um : of the mean, with its interval `shift_low_um` to `shift_high_um`.
    room_um : how far the mean can go in that direction within the tolerance's limits.
    within_limits : whether the interval reaches into `room_um`; else it takes an effect, or parts beyond their limits.
    explained : share of the weighted squared bias that the shift takes away, the slopes' error allowed for.
    p_value : of what it leaves, all metrics together; nan with a single metric, which any shift closes.
    """

    tolerance: str
    shift_um: float
    shift_low_um: float
    shift_high_um: float
    room_um: float
    within_limits: bool
    explained: float
    p_value: float

    @property
    def is_beyond_room(self) -> bool:
        """Whether only a part of the interval, without the shift itself, lies within the limits."""
        return self.within_limits and abs(self.shift_um) > self.room_um

    @property
    def closes(self) -> bool:
        """Whether the shift is known to have its sense, keeps the limits and leaves no significant difference.

        A tolerance whose slopes the samples do not determine would explain anything.
        """
        excludes_zero = self.shift_low_um * self.shift_high_um > 0
        return excludes_zero and self.within_limits and not self.p_value < ALPHA


@dataclass(frozen=True)
class Closing:
    """What would close the differences.

    Attributes
    ----------
    p_value : of no bias at all; nan where `why_not` says why it is not tested.
    candidates : every tolerance that varies in the study; those that close come first, then by what they leave.
    why_not : empty where the biases are tested.
    """

    p_value: float
    candidates: tuple[Candidate, ...]
    why_not: str = ""

    @property
    def has_bias(self) -> bool:
        """Whether the biases differ from zero, all metrics together, at the level of 5 %."""
        return self.p_value < ALPHA

    @property
    def takes_an_effect(self) -> bool:
        """Whether there is a difference that no single tolerance closes within its limits."""
        return self.has_bias and not any(candidate.closes for candidate in self.candidates)


def read_population_run(run: Path, study: Study) -> StudyPopulation:
    """The tables of a finished run that the comparison needs.

    Raises
    ------
    InputError : the run has not got them, or too few samples.
    """
    stages = {
        "metrics": "aggregate",
        **dict.fromkeys(("reducer", "pins", "lobes", "rollers", "holes", "cranks"), "sample"),
    }
    paths = {name: run / stage / f"{name}.parquet" for name, stage in stages.items()}
    missing = [
        f"{run.name}: {path.relative_to(run)} is missing; run the study first"
        for path in paths.values()
        if not path.exists()
    ]
    if missing:
        raise InputError(missing)
    tables = {name: pd.read_parquet(path) for name, path in paths.items()}
    if study.samples.nominal_first:
        tables = {name: table[table["sample"] > 0] for name, table in tables.items()}
    deviations = mean_deviations(tables)
    least = deviations.shape[1] + len(measurable_metrics()) + SPARE_SAMPLES
    if len(deviations) < least:
        raise InputError(
            f"study {study.name}: {len(deviations)} samples; a comparison with units takes {least} for "
            f"{deviations.shape[1]} tolerances; raise samples.count and run it again"
        )
    return StudyPopulation(study, tables["metrics"], deviations)


def mean_deviations(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Mean deviation [um] of each tolerance that the samples have, of every sample, from the tables of `sample`."""
    columns = {}
    for dimension in sorted(dimension_library().values(), key=lambda dimension: dimension.draw_columns):
        table = tables[dimension.table]
        if dimension.column in table and len(table):  # one disk has no phase of its eccentric, and many have no holes
            columns[dimension.name] = table.groupby("sample")[dimension.column].mean()
    return pd.DataFrame(columns)


def closing(
    comparisons: Sequence[MetricComparison],
    population: StudyPopulation,
    confidence: float = 0.95,
    noise: float | None = None,
) -> Closing:
    """Rank the tolerances by how well a shift of their mean closes the biases.

    Parameters
    ----------
    comparisons : of one crank angle, or of the worst over the crank angles.
    population : the study's samples.
    noise : standard deviation of a value of the bench over the value; None if it is not known.

    Notes
    -----
    Linear regression of the metrics on the mean deviations of the study's own samples gives the slopes B (metric by
    tolerance). With the covariance C of the biases b a shift d of tolerance t leaves r = (b - B_t d)' C^-1 (b - B_t d),
    which is least at d = B_t' C^-1 b / B_t' C^-1 B_t. b' C^-1 b is Hotelling's with as many degrees of freedom as
    metrics, r with one less. With f degrees of freedom of C and p metrics d has Student's distribution, of f - p + 1
    degrees of freedom and the variance (f + r) / (f - p + 1) / B_t' C^-1 B_t. The error of the slopes times d is part
    of C: the mean of eighty pins varies little and its slope is poorly known. A shift beyond the samples' range
    extrapolates the line.

    Source
    ------
    Hotelling, The generalization of Student's ratio, Ann. Math. Stat. 2 (1931) 360; Rao, Some problems involving linear
    hypotheses in multivariate analysis, Biometrika 46 (1959) 49.
    """
    metrics, deviations = _compared_samples(comparisons, population)
    bias = np.array([comparison.bias.value for comparison in comparisons])
    scatter = _bias_scatter(comparisons, metrics, noise)
    if scatter is None:
        reason = f"that takes {bias.size + 2} units with every metric, or the bench's repeatability (--noise)"
        return Closing(np.nan, (), reason)
    covariance, freedom = scatter
    distance = float(bias @ np.linalg.solve(covariance, bias))
    p_value = _tail(distance, bias.size, freedom)
    slopes, uncertainty = _slopes(deviations.to_numpy(), metrics.to_numpy())
    quantile = float(scipy.stats.t.ppf((1 + confidence) / 2, freedom - bias.size + 1))

    def candidate(name: str, slope: Real, error: Real) -> Candidate:
        shift, deviation, remaining = closest_shift(bias, slope, (covariance, freedom), error)
        reach, room = quantile * deviation, _room(population.study, name, float(deviations[name].mean()), shift)
        return Candidate(
            tolerance=name,
            shift_um=shift,
            shift_low_um=shift - reach,
            shift_high_um=shift + reach,
            room_um=room,
            within_limits=abs(shift) - reach <= room,
            explained=1 - remaining / distance if distance > 0 else 0.0,
            p_value=_tail(remaining, bias.size - 1, freedom) if bias.size > 1 else np.nan,
        )

    candidates = [candidate(*of_tolerance) for of_tolerance in zip(deviations, slopes, uncertainty, strict=True)]
    candidates.sort(key=lambda one: (not one.closes, -one.explained, abs(one.shift_um)))
    return Closing(p_value, tuple(candidates))


def _compared_samples(
    comparisons: Sequence[MetricComparison], population: StudyPopulation
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Metrics of the samples that are compared, and those of their mean deviations that vary.

    Raises
    ------
    ValueError
        If the comparisons are of more than one crank angle.
    """
    crank, *others = {comparison.crank_deg for comparison in comparisons}
    if others:
        raise ValueError("comparisons of one crank angle are asked for")
    names = [comparison.metric for comparison in comparisons]
    metrics = metrics_at(population.metrics, crank, comparisons[0].turn_statistic)[names]
    deviations = population.deviations.loc[metrics.index]
    return metrics, deviations.loc[:, deviations.std() > 1e-9 * (1e-3 + deviations.abs().max())]


def _bias_scatter(
    comparisons: Sequence[MetricComparison], samples: pd.DataFrame, noise: float | None
) -> tuple[Real, int] | None:
    """Covariance (n_metrics, n_metrics) of the biases and its degrees of freedom; None where the units do not show it.

    Notes
    -----
    Units that outnumber the metrics by two show their own covariance, which includes the noise of the bench. Its
    degrees of freedom are taken to be those of the units alone, which is conservative (Yao, Biometrika 52 (1965) 139).
    For fewer units it is that of the study with the declared noise added: the metrics are correlated in the study, and
    not in the noise.
    """
    units = pd.DataFrame({c.metric: pd.Series(c.units, c.labels) for c in comparisons}).dropna()
    study_scatter = np.atleast_2d(np.cov(samples.to_numpy(), rowvar=False))
    if len(units) >= len(comparisons) + 2:
        own_scatter = np.atleast_2d(np.cov(units.to_numpy(), rowvar=False))
        return own_scatter / len(units) + study_scatter / len(samples), len(units) - 1
    if noise is None:
        return None
    fewest = min(comparison.units.size for comparison in comparisons)
    scatter = study_scatter + np.diag((noise * samples.mean().to_numpy()) ** 2)
    return scatter / fewest + study_scatter / len(samples), len(samples) - 1


def _tail(value: float, n_metrics: int, freedom: int) -> float:
    """Probability of Hotelling's statistic of so many metrics above `value`."""
    rest = freedom - n_metrics + 1
    return float(scipy.stats.f.sf(value * rest / (n_metrics * freedom), n_metrics, rest))


def closest_shift(
    bias: Real, slope: Real, scatter: tuple[Real, int], slope_covariance: Real
) -> tuple[float, float, float]:
    """Shift [um] that leaves least, its standard deviation [um], and what it leaves.

    Parameters
    ----------
    bias, slope : (n_metrics,), the second [1/um].
    scatter : covariance of the biases and its degrees of freedom.
    slope_covariance : of the slope.
    """
    covariance, freedom = scatter
    shift, deviation, remaining = 0.0, np.inf, 0.0
    for _ in range(ITERATIONS):
        weighted_columns = np.linalg.solve(covariance + shift**2 * slope_covariance, np.column_stack([slope, bias]))
        information = float(slope @ weighted_columns[:, 0])
        shift, deviation = float(slope @ weighted_columns[:, 1]) / information, information**-0.5
        remaining = max(float(bias @ weighted_columns[:, 1]) - information * shift**2, 0.0)
    return shift, deviation * float(np.sqrt((freedom + remaining) / (freedom - bias.size + 1))), remaining


def _slopes(deviations: Real, metrics: Real) -> tuple[Real, Real]:
    """Slopes (n_tolerances, n_metrics) of one least-squares plane over all tolerances, and the covariance of each."""
    design = np.column_stack([np.ones(len(deviations)), deviations - deviations.mean(axis=0)])
    slopes = np.linalg.lstsq(design, metrics, rcond=None)[0]
    remainder = metrics - design @ slopes
    residual = remainder.T @ remainder / (len(design) - design.shape[1])
    leverage = np.diagonal(np.linalg.inv(design.T @ design))
    return np.asarray(slopes[1:], float), np.asarray(leverage[1:, None, None] * residual, float)


def _room(study: Study, name: str, mean: float, shift: float) -> float:
    """How far the mean deviation can go in the direction of `shift` within the limits [um]."""
    tolerance = getattr(study.tolerances, name)
    lower, upper = (tolerance.allowance_um + limit for limit in tolerance.limits_um)
    return float(max(upper - mean if shift > 0 else mean - lower, 0.0))

"""Measured units against the distributions of a study: bias, spread, quantiles, and tests of the same distribution."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy  # its statistics are slow to import: they are when they are called

from pipeline.arrays import Real, Truth
from pipeline.config.files.section import nearest_name
from pipeline.config.files.table_file import LARGEST_VALUE, TableFile, read_table, shortened_list
from pipeline.errors import InputError
from pipeline.model.metrics import library, measurable_metrics
from pipeline.model.units import ARCMIN
from pipeline.statistics.differences import welch_interval
from pipeline.statistics.intervals import Estimate

TESTS = ("kolmogorov_smirnov", "cramer_von_mises", "anderson_darling")
PERMUTATIONS = 1999
"""Of the test: p is known to 0.5 % at 5 %, and no smaller than 1/2000."""
PERMUTED_AT_ONCE = 2_000_000
"""Labels that are permuted together: some 50 MB."""
QUANTILE_POINTS = 19
"""Of the quantile-quantile figure: every 5 %."""
FEWEST_UNITS = 3
"""Units below which neither a spread nor a test says anything."""
FURTHEST = 20.0
"""Ratio of the medians of units and study beyond which the values are in another unit; a degree has 60 minutes."""
LIKELY = 5.0
"""The same ratio, within which another unit is suggested."""
FACTOR_APART, FACTOR_ALIKE = 3.0, 1.5
"""Ratios of medians of two metrics: beyond the first as they are, and within the second when exchanged."""
LEAST_EXPECTED = 0.05
"""Median of the study [arcmin or N m/arcmin] below which a ratio says nothing, as of drives with hardly any play."""


@dataclass(frozen=True)
class Test:
    """A permutation test that the units come from the study's distribution.

    Its size is exact: where they do, the p value is at most a with a probability of at most a, for any distribution and
    any number of units.
    """

    __test__ = False  # no test of pytest

    name: str
    statistic: float
    p_value: float


@dataclass(frozen=True)
class MetricComparison:
    """One metric of the measured units against the study.

    Attributes
    ----------
    metric : column, with its unit.
    crank_deg : where it was measured; None where the units name no crank angle.
    turn_statistic : "angle", or "mean" or "worst" over the crank angles of the study, which the samples are then of.
    labels : (n_units,) which units have a value.
    units, samples : (n_units,), (n_samples,) values.
    bias : mean of the units less mean of the samples, in the metric's unit, Welch's interval.
    spread_ratio : standard deviation of the units over that of the samples.
    quantiles : (n_points, 3) probability, the samples' quantile, the units' quantile.
    tests : empty below three units.
    """

    metric: str
    crank_deg: float | None
    turn_statistic: str
    labels: tuple[str, ...]
    units: Real
    samples: Real
    bias: Estimate
    spread_ratio: Estimate
    quantiles: Real
    tests: tuple[Test, ...]


def load_population(path: Path) -> pd.DataFrame:
    """The table units.csv, one row per unit: `unit`, the metrics (any value may be empty), and `crank_deg` if given.

    Raises
    ------
    InputError : no such file, no table, no metric in it, repeated units, or values that are no positive numbers.
    """
    try:
        table = read_table(path, path.name, names_in=("unit",))
    except OSError as error:
        raise InputError(f"{path.name}: no table: {error}; give a CSV file with one row per unit") from None
    frame = table.cells
    problems = [] if len(frame) else [f"{path.name}: no unit; give one row per unit below the header"]
    columns = ("unit", "crank_deg", *measurable_metrics())
    problems += [
        f"{path.name}: column {name!r}; unknown; {nearest_name(name, columns)}" for name in frame if name not in columns
    ]
    if "unit" not in frame:
        problems.append(f"{path.name}: column 'unit' is missing; add it")
    metrics = [name for name in measurable_metrics() if name in frame]
    if not metrics:
        problems.append(f"{path.name}: no metric; give at least one of {', '.join(measurable_metrics())}")
    values = frame.copy()
    for name in [*metrics, *({"crank_deg"} & set(frame))]:
        values[name] = table.numbers(name)
        is_wrong = ~table.is_blank(name) & ~((values[name] >= 0) & (values[name] <= LARGEST_VALUE)).to_numpy()
        problems += table.faults(name, is_wrong, f"must be 0 to {LARGEST_VALUE:g}, or empty")
    problems += [
        f"{path.name}: column {name!r} has no value; fill it or remove it"
        for name in metrics
        if len(frame) and table.is_blank(name).all()
    ]
    problems += _wrong_keys(table)
    if problems:
        raise InputError(shortened_list(problems, path.name))
    return values.reset_index(drop=True)


def _wrong_keys(table: TableFile) -> list[str]:
    """Units without a name, and those that stand twice."""
    keys = [name for name in ("unit", "crank_deg") if name in table.cells]
    if "unit" not in keys:
        return []
    return [
        *table.faults("unit", table.is_blank("unit"), "must be the name of the unit"),
        *table.faults("unit", table.cells.duplicated(keys).to_numpy(), "occurs twice; name each unit once"),
    ]


def metrics_at(metrics: pd.DataFrame, crank_deg: float | None, turn_statistic: str = "mean") -> pd.DataFrame:
    """The metrics of each sample (index) at a crank angle, or over all of them; samples that failed are left out.

    Parameters
    ----------
    metrics : the table of that name of a run; the nominal reducer is to be left out before.
    turn_statistic : "mean" or "worst" over the crank angles, where `crank_deg` is None.

    Raises
    ------
    InputError : the study has no such crank angle.
    """
    names = list(measurable_metrics())
    failed_samples = metrics.loc[metrics["status"] != "ok", "sample"].unique()
    if crank_deg is None:
        by_sample = metrics.groupby("sample")
        if turn_statistic == "mean":
            return by_sample[names].mean().drop(index=failed_samples)
        worst_statistic = {
            name: "min" if metric.smaller_is_worse else "max" for name, metric in measurable_metrics().items()
        }
        return by_sample.agg(worst_statistic).drop(index=failed_samples)
    of_crank = metrics[np.isclose(metrics["crank_deg"], crank_deg)]
    if of_crank.empty:
        cranks = ", ".join(f"{crank:g}" for crank in np.unique(metrics["crank_deg"]))
        raise InputError(
            f"table of units: crank_deg = {crank_deg:g}; the study has {cranks}; add it to its cycle.crank_deg"
        )
    return of_crank.set_index("sample")[names].drop(index=failed_samples)


def metric_comparisons(
    population: pd.DataFrame,
    metrics: pd.DataFrame,
    confidence: float = 0.95,
    seed: int = 0,
    turn_statistic: str = "mean",
) -> list[MetricComparison]:
    """Each measured metric against the study, at each crank angle that the units name.

    Parameters
    ----------
    population : of `load_population`.
    metrics : the table of that name of a run, without the nominal reducer.
    confidence : level of the intervals.
    seed : of the permutations.
    turn_statistic : "mean" or "worst" over the crank angles of the study, for units without a crank angle.

    Raises
    ------
    InputError : the study has no such crank angle, or values that are in another unit than their column says.
    """
    rng = np.random.default_rng(seed)
    cranks = population["crank_deg"].to_numpy() if "crank_deg" in population else np.full(len(population), np.nan)
    groups: list[tuple[float | None, Truth]] = [(None, np.isnan(cranks))]
    groups += [(float(crank), cranks == crank) for crank in np.unique(cranks[np.isfinite(cranks)])]
    pairs = []
    for crank, of_crank in groups:
        if not of_crank.any():
            continue
        samples = metrics_at(metrics, crank, turn_statistic)
        for metric in [name for name in measurable_metrics() if name in population]:
            units = population.loc[of_crank].set_index("unit")[metric].dropna()
            if units.size:
                pairs.append((metric, crank, units, samples[metric].to_numpy()))
    medians = {metric: (float(np.median(units)), float(np.nanmedian(samples))) for metric, _, units, samples in pairs}
    if implausible := [*_exchange_sentences(medians), *filter(None, (_implausible(*item) for item in medians.items()))]:
        raise InputError(implausible)
    return [
        _comparison(metric, crank, "angle" if crank is not None else turn_statistic, units, samples, confidence, rng)
        for metric, crank, units, samples in pairs
    ]


def _exchange_sentences(medians: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    """Pairs of metrics whose medians (units, study) lie far apart as they are and agree when they are exchanged."""
    for first_metric, second_metric in itertools.combinations(medians, 2):
        (a, expected_a), (b, expected_b) = medians[first_metric], medians[second_metric]
        if min(a, b, expected_a, expected_b) <= 0:
            continue
        least_distance = min(abs(np.log(a / expected_a)), abs(np.log(b / expected_b)))
        if least_distance > np.log(FACTOR_APART) and max(
            abs(np.log(a / expected_b)), abs(np.log(b / expected_a))
        ) < np.log(FACTOR_ALIKE):
            yield (
                f"table of units: {first_metric} has the values of {second_metric} in the study, and the reverse; "
                "exchange the columns"
            )


def _implausible(metric: str, medians: tuple[float, float]) -> str:
    """Why values, by their medians (units, study), cannot be in the unit of their column; empty if they can."""
    measured_median, expected_median = medians
    if expected_median < LEAST_EXPECTED or expected_median / FURTHEST <= measured_median <= expected_median * FURTHEST:
        return ""
    factors = {"deg": 60.0, "arcsec": 1 / 60, "rad": ARCMIN, "mrad": ARCMIN / 1000}
    torque, _, angle = library()[metric].unit.rpartition("/")
    if angle != "arcmin":
        factors = {}
    elif torque:
        factors = {f"{torque}/{unit}": 1 / factor for unit, factor in factors.items()}
    likely = [
        unit
        for unit, factor in factors.items()
        if expected_median / LIKELY <= measured_median * factor <= expected_median * LIKELY
    ]
    advice = f"it would be likely in {' or '.join(likely)}; convert it" if likely else "is it the right column?"
    medians_text = f"a median of {measured_median:.4g}, the study one of {expected_median:.4g}"
    return f"table of units: {metric} has {medians_text}; {advice}"


def permutation_tests(units: Real, samples: Real, rng: np.random.Generator) -> tuple[Test, ...]:
    """Kolmogorov-Smirnov, Cramer-von Mises and Anderson-Darling distances with permutation p values.

    Notes
    -----
    p = (1 + number of permutations at least as far) / (1 + permutations). Equal values count as one step of both
    distribution functions.

    Source
    ------
    Pettitt, A two-sample Anderson-Darling rank statistic, Biometrika 63 (1976) 161; Anderson, On the distribution of
    the two-sample Cramer-von Mises criterion, Ann. Math. Stat. 33 (1962) 1148.
    """
    pooled_values = np.concatenate([units, samples])
    order = np.argsort(pooled_values, kind="stable")
    label = (order < units.size)[None, :]
    group_end = np.append(np.diff(pooled_values[order]) > 0, True)
    observed_distances = _distances(label, group_end)[:, 0]
    n_reached = np.ones(len(TESTS))
    at_once = max(1, PERMUTED_AT_ONCE // pooled_values.size)
    n_permuted = 0
    while n_permuted < PERMUTATIONS:
        rows = min(at_once, PERMUTATIONS - n_permuted)
        permuted_labels = rng.permuted(np.repeat(label, rows, axis=0), axis=1)
        n_reached += np.sum(_distances(permuted_labels, group_end) >= observed_distances[:, None] * (1 - 1e-12), axis=1)
        n_permuted += rows
    return tuple(
        Test(name, float(value), float(count / (1 + PERMUTATIONS)))
        for name, value, count in zip(TESTS, observed_distances, n_reached, strict=True)
    )


def _distances(label: Truth, group_end: Truth) -> Real:
    """The three statistics (3, n_rows) of rows of labels (n_rows, n) in ascending order of value.

    `group_end` marks the last of each group of equal values, where the distribution functions are compared.
    """
    n = label.shape[1]
    m = int(label[0].sum())
    rank = np.flatnonzero(group_end) + 1
    weight = np.diff(np.concatenate([[0], rank]))
    count_below = np.cumsum(label, axis=1)[:, group_end]
    difference = count_below / m - (rank - count_below) / (n - m)
    pairs = m * (n - m)
    inner = rank < n
    spread = rank[inner] * (n - rank[inner])
    kolmogorov = np.max(np.abs(difference), axis=1)
    cramer = pairs / n**2 * np.sum(weight * difference**2, axis=1)
    anderson = pairs * np.sum(weight[inner] * difference[:, inner] ** 2 / spread, axis=1)
    return np.stack([kolmogorov, cramer, anderson])


def _comparison(
    metric: str,
    crank: float | None,
    turn_statistic: str,
    unit_values: pd.Series,
    samples: Real,
    confidence: float,
    rng: np.random.Generator,
) -> MetricComparison:
    units = unit_values.to_numpy(float)
    comparable = units.size >= FEWEST_UNITS and samples.size >= FEWEST_UNITS
    probability = np.arange(1, QUANTILE_POINTS + 1) / (QUANTILE_POINTS + 1)
    quantiles = [np.quantile(values, probability, method="median_unbiased") for values in (samples, units)]
    return MetricComparison(
        metric=metric,
        crank_deg=crank,
        turn_statistic=turn_statistic,
        labels=tuple(map(str, unit_values.index)),
        units=units,
        samples=samples,
        bias=_bias(units, samples, confidence),
        spread_ratio=_spread_ratio(units, samples, confidence) if comparable else _missing_estimate(units.size),
        quantiles=np.column_stack([probability, *quantiles]),
        tests=permutation_tests(units, samples, rng) if comparable else (),
    )


def _missing_estimate(n: int) -> Estimate:
    return Estimate(np.nan, np.nan, np.nan, n)


def _bias(units: Real, samples: Real, confidence: float) -> Estimate:
    """Difference of means with Welch's interval; unbounded for one unit."""
    low, high = welch_interval(samples, units, confidence)
    return Estimate(float(units.mean() - samples.mean()), low, high, units.size)


def _spread_ratio(units: Real, samples: Real, confidence: float) -> Estimate:
    """Ratio of standard deviations; the variance of a log variance is that of the common kurtosis k, (k - 1)/n.

    Source
    ------
    Shoemaker, Fixing the F test for equal variances, Am. Stat. 57 (2003) 105.
    """
    spread = units.std(ddof=1), samples.std(ddof=1)
    if min(spread) == 0:
        return _missing_estimate(units.size)
    n = units.size + samples.size
    centred_values = [values - values.mean() for values in (units, samples)]
    pooled_variance = sum(np.sum(values**2) for values in centred_values) / n
    kurtosis = sum(np.sum(values**4) for values in centred_values) / n / pooled_variance**2
    freedom = [2 * k / (kurtosis - (k - 3) / (k - 1)) for k in (units.size, samples.size)]
    f = scipy.stats.f(*freedom)
    ratio = (spread[0] / spread[1]) ** 2
    low, high = ratio / f.ppf((1 + confidence) / 2), ratio / f.ppf((1 - confidence) / 2)
    return Estimate(float(np.sqrt(ratio)), float(np.sqrt(low)), float(np.sqrt(high)), units.size)

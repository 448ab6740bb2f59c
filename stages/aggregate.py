"""Stage 5: backlash, lost motion and torsional rigidity of every sample; their distributions, yield and drivers."""

import numpy as np
import pandas as pd

from pipeline.config.study import Study
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.load_history.load_cycle import curve_metrics
from pipeline.sampling import replicates
from pipeline.statistics import Estimate, distribution, pass_share, rank_correlation, variance_shares
from stages.keys import CRANK, SAMPLE, STATUS

METRIC_COLUMNS = {
    "clearance_backlash_arcmin": ("arcmin", "width of the loop at zero torque of the frictionless model"),
    "zero_torque_width_arcmin": ("arcmin", "width of the loop at zero torque"),
    "lost_motion_arcmin": ("arcmin", "centre line of the loop between + and - the lost-motion torque"),
    "torsional_rigidity_Nm_per_arcmin": (
        "N m/arcmin",
        "torque over angle between the rigidity torques, mean of both senses",
    ),
    "hysteresis_loss_arcmin": ("arcmin", "zero-torque width less the clearance backlash"),
    "peak_pressure_MPa": ("MPa", "largest Hertz pressure of any contact in the cycle"),
}
SMALLER_IS_WORSE = "torsional_rigidity_Nm_per_arcmin"
SAMPLES_AT_ONCE = 10_000
"""Samples whose curves are read together: at most a few million rows."""
SENSITIVITY_SAMPLES = 20_000
"""Samples that the indices are taken from at most; their intervals are below 0.02 by then, and each holds 3 kB."""

METRICS = Table(
    "metrics",
    "sample, crank",
    (
        SAMPLE,
        CRANK,
        *(Column(name, "float64", unit, meaning) for name, (unit, meaning) in METRIC_COLUMNS.items()),
        Column("preloaded", "bool", "", "whether the gaps of some part interfere"),
        STATUS,
    ),
)
DISTRIBUTIONS = Table(
    "distributions",
    "metric, crank, statistic",
    (
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column("crank_deg", "float64", "deg", "crank angle; null: the worst over the crank angles"),
        Column("statistic", "label", "", "mean, std, quantile, or yield: the share within the limit"),
        Column("value", "float64", "the metric's", "estimate"),
        Column("ci_low", "float64", "the metric's", "lower end of the confidence interval"),
        Column("ci_high", "float64", "the metric's", "upper end of the confidence interval"),
        Column("n", "int32", "1", "samples that it rests on"),
    ),
)
SENSITIVITY = Table(
    "sensitivity",
    "metric, parameter",
    (
        Column("metric", "label", "", "column of metrics, the worst over the crank angles"),
        Column("parameter", "label", "", "error of a sample, or a group of errors"),
        Column(
            "kind", "label", "", "rank_correlation (of one number per sample) or variance_share (of a group of errors)"
        ),
        Column("index", "float64", "1", "the index; null: the samples do not determine it"),
        Column("ci_low", "float64", "1", "lower end of the confidence interval"),
        Column("ci_high", "float64", "1", "upper end of the confidence interval"),
    ),
)


def _metrics(job: Job) -> Columns:
    """The metrics of every sample and crank angle; missing where there is no result."""
    rows = job.study.samples.rows
    parts = [_metrics_of(job, start, min(start + SAMPLES_AT_ONCE, rows)) for start in range(0, rows, SAMPLES_AT_ONCE)]
    columns: Columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["status"] = job.read("hysteresis", "status")["status"]
    return columns


def _metrics_of(job: Job, start: int, stop: int) -> dict[str, np.ndarray]:
    """The metrics of the samples from ``start`` to ``stop``, read from their curves."""
    study: Study = job.study
    status, curves = (job.read_items("hysteresis", name, start, stop) for name in ("status", "curves"))
    loops = len(status["sample"])
    steps = len(curves["step"]) // loops
    branch = np.asarray(curves["branch"][:steps])
    numbers = curve_metrics(
        branch,
        curves["torque_Nm"][:steps],
        curves["angle_arcmin"].reshape(loops, steps),
        study.design.cycloid.rated_torque_Nm,
        study.metrics.lost_motion_percent / 100,
        (study.metrics.rigidity_percent[0] / 100, study.metrics.rigidity_percent[1] / 100),
    )
    width = numbers.zero_torque_width
    kinematic = job.read_items("clearance", "kinematic", start, stop)
    backlash = kinematic["backlash_arcmin"] if study.design.effects else width  # without friction the loop is the play
    values = {
        "clearance_backlash_arcmin": backlash,
        "zero_torque_width_arcmin": width,
        "lost_motion_arcmin": numbers.lost_motion,
        "torsional_rigidity_Nm_per_arcmin": numbers.torsional_rigidity,
        "hysteresis_loss_arcmin": width - backlash,
        "peak_pressure_MPa": curves["peak_pressure_MPa"].reshape(loops, steps).max(axis=1),
    }
    failed = np.asarray(status["status"]) != "ok"
    return {
        "sample": status["sample"],
        "crank_deg": status["crank_deg"],
        **{name: np.where(failed, np.nan, value) for name, value in values.items()},
        "preloaded": kinematic["preloaded"],
    }


def worst_over_cranks(metrics: pd.DataFrame) -> pd.DataFrame:
    """The worst value of each metric over the crank angles, per sample; missing if any crank angle failed."""
    names = [*METRIC_COLUMNS, "preloaded"]
    grouped = metrics.groupby("sample")
    worst = grouped[names].max()
    worst[SMALLER_IS_WORSE] = grouped[SMALLER_IS_WORSE].min()
    failed = metrics.loc[metrics["status"] != "ok", "sample"].unique()
    return worst.drop(index=failed)


def _within(study: Study, values: pd.DataFrame) -> dict[str, np.ndarray]:
    """Whether each sample keeps each limit that the study sets, and all of them."""
    limits = {name: limit for name, limit in study.limits.model_dump().items() if limit is not None}
    within = {
        name: (values[name] >= limit if name == SMALLER_IS_WORSE else values[name] <= limit).to_numpy()
        for name, limit in limits.items()
    }
    return {**within, "all_limits": np.logical_and.reduce(list(within.values()))} if within else {}


def _distribution_rows(study: Study, values: pd.DataFrame, crank_deg: float) -> list[dict[str, object]]:
    """Rows of the distributions of one population, indexed by sample."""
    confidence, replicate = study.metrics.confidence, replicates(study.samples, values.index.to_numpy())
    estimates: list[tuple[str, str, Estimate]] = []
    if len(values):
        for metric in METRIC_COLUMNS:
            statistics = distribution(values[metric].to_numpy(), confidence, replicate)
            estimates += [(metric, name, estimate) for name, estimate in statistics.items()]
        shares = _within(study, values)
        estimates += [(name, "yield", pass_share(passed, confidence, replicate)) for name, passed in shares.items()]
        preloaded = values["preloaded"].to_numpy(bool)
        estimates.append(("preloaded", "mean", pass_share(preloaded, confidence, replicate)))
    return [
        {"metric": metric, "crank_deg": crank_deg, "statistic": name, **vars(estimate)}
        for metric, name, estimate in estimates
    ]


def _distributions(study: Study, metrics: pd.DataFrame, worst: pd.DataFrame) -> Columns:
    rows = []
    for crank, part in metrics[metrics["status"] == "ok"].groupby("crank_deg"):
        rows += _distribution_rows(study, part.set_index("sample"), float(crank))
    rows += _distribution_rows(study, worst, np.nan)
    if not rows:
        return DISTRIBUTIONS.empty()
    frame = pd.DataFrame(rows, columns=[column.name for column in DISTRIBUTIONS.columns])
    return {name: frame[name].to_numpy() for name in frame}


def _element_errors(job: Job, samples: np.ndarray) -> dict[str, np.ndarray]:
    """Errors of the elements of each group, (n, n_elements) [um], of the given samples."""
    stop = int(samples[-1]) + 1
    pins, lobes, rollers = (job.read_items("sample", name, 0, stop) for name in ("pins", "lobes", "rollers"))
    columns = {
        "pin_radial": pins["radial_um"],
        "pin_tangential": pins["tangential_um"],
        "pin_radius": pins["radius_um"],
        "lobe_profile": lobes["profile_um"],
        "roller_diameter": rollers["diameter_um"],
    }
    return {name: column.reshape(stop, -1)[samples] for name, column in columns.items()}


def _sensitivity(job: Job, every: pd.DataFrame) -> Columns:
    study: Study = job.study
    if study.samples.experiment == "cases" or every.empty:  # stated units are no sample of anything
        return SENSITIVITY.empty()
    worst = every.iloc[:SENSITIVITY_SAMPLES]
    samples = worst.index.to_numpy()
    replicate = replicates(study.samples, samples)
    reducer = (
        pd.DataFrame(job.read_items("sample", "reducer", 0, int(samples[-1]) + 1)).set_index("sample").loc[samples]
    )
    amplitudes = {name: reducer[name].to_numpy() for name in reducer if not name.endswith("_rad")}
    elements = _element_errors(job, samples)
    scalars = amplitudes | {f"{name}_mean_um": values.mean(axis=1) for name, values in elements.items()}
    groups = {name.removesuffix("_um"): values[:, None] for name, values in amplitudes.items()} | elements
    names = list(METRIC_COLUMNS)
    values = worst[names].to_numpy()
    rows = []
    for kind, indices in (
        ("rank_correlation", rank_correlation(scalars, values, study.metrics.confidence, replicate)),
        ("variance_share", variance_shares(groups, values, study.metrics.confidence, replicate)),
    ):
        rows += [
            {
                "metric": metric,
                "parameter": parameter,
                "kind": kind,
                "index": indices.value[p, m],
                "ci_low": indices.ci_low[p, m],
                "ci_high": indices.ci_high[p, m],
            }
            for m, metric in enumerate(names)
            for p, parameter in enumerate(indices.parameters)
        ]
    frame = pd.DataFrame(rows)
    return {name: frame[name].to_numpy() for name in frame}


def _run(job: Job) -> Tables:
    study: Study = job.study
    columns = _metrics(job)
    metrics = pd.DataFrame(columns)
    counted = metrics[metrics["sample"] > 0] if study.samples.nominal_first else metrics
    worst = worst_over_cranks(counted)
    return {
        "metrics": columns,
        "distributions": _distributions(study, counted, worst),
        "sensitivity": _sensitivity(job, worst),
    }


AGGREGATE = Stage(
    name="aggregate",
    reads=("sample", "clearance", "hysteresis"),
    sections=("samples", "design.cycloid.rated_torque_Nm", "design.effects", "metrics", "limits"),
    tables=(METRICS, DISTRIBUTIONS, SENSITIVITY),
    module="stages.aggregate",
    run=_run,
)

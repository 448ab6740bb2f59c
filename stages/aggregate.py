"""Stage 5: backlash, lost motion and torsional rigidity of every sample; their distributions, yield and drivers."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.config.study import ALL_LIMITS, Study
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.metrics import library
from pipeline.sampling import replicates
from pipeline.statistics import Estimate, distribution, pass_share
from stages.keys import CRANK, SAMPLE, STATUS
from stages.sensitivity import SENSITIVITY, sensitivity
from stages.turn import OVER, OVER_TURN, Turn, loop_metrics, metric_turns, over_turn_columns, unit_status

SAMPLES_AT_ONCE = 10_000
"""Samples whose loops are read together: at most a few million rows."""
STRIDES = (8, 4, 2, 1)
"""Every so many of the crank angles: how the worst value moves as they double."""
FEWEST_ANGLES = 3
"""Crank angles that a worst is looked at from at least, to see how it moves."""
METRICS = Table(
    "metrics",
    "sample, loaded crank",
    (
        SAMPLE,
        CRANK,
        *(
            column
            for name, metric in library().items()
            for column in (
                Column(name, "float64", metric.unit, f"{metric.inline}; null where it does not hold"),
                Column(metric.valid_column, "bool", "", f"whether the {metric.inline} holds; if not, status says why"),
            )
        ),
        Column("preloaded", "bool", "", "whether the gaps of some part interfere"),
        STATUS,
    ),
)
UNITS = Table(
    "units",
    "sample",
    (
        SAMPLE,
        *OVER_TURN,
        Column("preloaded", "bool", "", "whether the gaps of some part interfere at some crank angle"),
        Column("n_angles", "int32", "1", "loaded crank angles"),
        Column("n_rigid_angles", "int32", "1", "crank angles of the clearance backlash: of rigid bodies, and loaded"),
        STATUS,
    ),
)
DISTRIBUTIONS = Table(
    "distributions",
    "metric, crank or turn, statistic",
    (
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column("over", "label", "", "angle: at one crank angle; worst, mean or best: of each unit over the turn"),
        Column("crank_deg", "float64", "deg", "crank angle; null but for over = angle"),
        Column("statistic", "label", "", "mean, std, quantile, or yield: the share within the limit"),
        Column("value", "float64", "the metric's", "estimate"),
        Column("ci_low", "float64", "the metric's", "lower end of the confidence interval"),
        Column("ci_high", "float64", "the metric's", "upper end of the confidence interval"),
        Column("n", "int32", "1", "samples that it rests on"),
        Column("n_angles", "int32", "1", "crank angles that each sample's value rests on"),
    ),
)
CONVERGENCE = Table(
    "convergence",
    "metric, number of crank angles",
    (
        Column("metric", "label", "", "column of metrics; all_limits: against all limits together"),
        Column("n_angles", "int32", "1", "crank angles, evenly among those of the run; or twice its own"),
        Column("worst_mean", "float64", "the metric's", "mean over the samples of the worst over these angles"),
        Column("yield", "float64", "1", "share of the samples whose worst over these angles keeps the limit"),
        Column("extrapolated", "bool", "", "whether the run has fewer angles: continued from the rows before"),
    ),
)


def _metrics(job: Job) -> Columns:
    """The metrics of every sample and loaded crank angle; missing where there is no result."""
    rows = job.study.samples.rows
    parts = [_metrics_of(job, start, min(start + SAMPLES_AT_ONCE, rows)) for start in range(0, rows, SAMPLES_AT_ONCE)]
    columns: Columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["status"] = job.read("hysteresis", "status")["status"]
    return columns


def _metrics_of(job: Job, start: int, stop: int) -> dict[str, np.ndarray]:
    """The metrics of the samples from ``start`` to ``stop``, from the readings of their loops."""
    study: Study = job.study
    status, loops = (job.read_items("hysteresis", name, start, stop) for name in ("status", "loops"))
    kinematic = job.read_items("clearance", "kinematic", start, stop)
    loaded = np.isin(kinematic["crank_deg"], study.cycle.crank_deg)
    return {
        "sample": status["sample"],
        "crank_deg": status["crank_deg"],
        **loop_metrics(study, loops),
        "preloaded": kinematic["preloaded"][loaded],
    }


def _units(job: Job, metrics: Columns, turns: Mapping[str, Turn]) -> Columns:
    """Worst, mean and best of every sample over the turn; missing where some crank angle has no result."""
    study: Study = job.study
    n, angles = study.samples.rows, len(study.cycle.crank_deg)
    return {
        "sample": np.arange(n),
        **over_turn_columns(turns),
        "preloaded": job.read("clearance", "kinematic")["preloaded"].reshape(n, -1).any(axis=1),
        "n_angles": np.full(n, angles),
        "n_rigid_angles": np.full(n, turns["clearance_backlash_arcmin"].values.shape[1]),
        "status": unit_status(metrics["status"], angles),
    }


def _part(replicate: np.ndarray | None, rows: np.ndarray) -> np.ndarray | None:
    return None if replicate is None else replicate[rows]


def _distribution_rows(
    study: Study, values: pd.DataFrame, over: str, crank_deg: float, angles: Mapping[str, int]
) -> list[dict[str, object]]:
    """Rows of the distributions of one population, indexed by sample; ``angles`` behind each of its columns."""
    confidence, replicate = study.metrics.confidence, replicates(study.samples, values.index.to_numpy())
    estimates: list[tuple[str, str, Estimate]] = []
    for metric in library():
        holding = ~np.isnan(values[metric].to_numpy(float))
        if holding.any():
            statistics = distribution(values[metric].to_numpy()[holding], confidence, _part(replicate, holding))
            estimates += [(metric, name, estimate) for name, estimate in statistics.items()]
    for name, passed in study.limits.kept(values).items():
        limited = study.limits.limited(name)
        holding = ~np.isnan(values[limited].to_numpy(float)).any(axis=1)
        if holding.any():
            estimates.append((name, "yield", pass_share(passed[holding], confidence, _part(replicate, holding))))
    if len(values):
        estimates.append(("preloaded", "mean", pass_share(values["preloaded"].to_numpy(bool), confidence, replicate)))
    fewest = min(angles.values())
    return [
        {
            "metric": metric,
            "over": over,
            "crank_deg": crank_deg,
            "statistic": name,
            **vars(estimate),
            "n_angles": angles.get(metric, fewest),
        }
        for metric, name, estimate in estimates
    ]


def over_turn(units: pd.DataFrame, over: str) -> pd.DataFrame:
    """The metrics of the units that have a result, (n, n_metrics) by sample, as `worst`, `mean` or `best`.

    A metric that does not hold at some crank angle is missing.
    """
    named = {f"{name}_{over}": name for name in library()}
    solved = units[units[list(named)].notna().any(axis=1)].set_index("sample")
    return solved[[*named, "preloaded"]].rename(columns=named)


def _distributions(study: Study, metrics: pd.DataFrame, units: pd.DataFrame) -> Columns:
    rows = []
    single = dict.fromkeys(library(), 1)
    for crank, part in metrics[metrics[list(library())].notna().any(axis=1)].groupby("crank_deg"):
        rows += _distribution_rows(study, part.set_index("sample"), "angle", float(crank), single)
    if len(units):
        counts = units.iloc[0]
        turn = {
            name: int(counts["n_rigid_angles" if metric.turn_of_rigid_bodies else "n_angles"])
            for name, metric in library().items()
        }
        for over in OVER:
            rows += _distribution_rows(study, over_turn(units, over), over, np.nan, turn)
    if not rows:
        return DISTRIBUTIONS.empty()
    frame = pd.DataFrame(rows, columns=[column.name for column in DISTRIBUTIONS.columns])
    return {name: frame[name].to_numpy() for name in frame}


def convergence_rows(study: Study, turns: Mapping[str, Turn], counted: np.ndarray) -> Columns:
    """How worst values and yields move with the number of crank angles, and how they would with twice as many.

    Parameters
    ----------
    counted : (n,) samples of the statistics.
    """
    rows: list[dict[str, object]] = []
    fewest = min(int(turn.even.sum()) for turn in turns.values())
    strides = [stride for stride in STRIDES if stride == 1 or fewest // stride >= FEWEST_ANGLES]
    for stride in strides:
        worst, angles = {}, {}
        for name, turn in turns.items():
            values = turn.values[counted]
            part = values[:, turn.even][:, ::stride] if stride > 1 else values
            worst[name], angles[name] = library()[name].over_turn(part)[0], part.shape[1]
        within = study.limits.kept(worst)
        for name in (*turns, *([ALL_LIMITS] if within else [])):
            limited = study.limits.limited(name)
            holding = ~np.isnan([worst[metric] for metric in limited]).any(axis=0)
            share = float(within[name][holding].mean()) if name in within and holding.any() else np.nan
            mean = float(worst[name][holding].mean()) if name in worst and holding.any() else np.nan
            n_angles = angles.get(name, min(angles.values()))
            rows.append(
                {"metric": name, "n_angles": n_angles, "worst_mean": mean, "yield": share, "extrapolated": False}
            )
    frame = pd.DataFrame(rows)
    for name, part in frame.groupby("metric", sort=False) if len(strides) > 2 else ():
        doubled = {key: continued(part[key].to_numpy()) for key in ("worst_mean", "yield")}
        doubled["yield"] = float(np.clip(doubled["yield"], 0.0, 1.0))
        rows.append({"metric": name, "n_angles": 2 * int(part["n_angles"].iloc[-1]), **doubled, "extrapolated": True})
    frame = pd.DataFrame(rows)
    return {name: frame[name].to_numpy() for name in frame}


def continued(values: np.ndarray) -> float:
    """The next of values whose number of crank angles doubles from each to the next.

    The last change goes on at the rate at which the changes shrank, or as large as it was where they did not.
    """
    changes = np.diff(values)
    before, last = changes[-2], changes[-1]
    rate = min(abs(last / before), 1.0) if before != 0 else 1.0
    return float(values[-1] + rate * last)


def _run(job: Job) -> Tables:
    study: Study = job.study
    columns = _metrics(job)
    kinematic = job.read("clearance", "kinematic")
    rigid = np.where(kinematic["preloaded"], np.nan, kinematic["backlash_arcmin"])
    turns = metric_turns(study, columns, rigid.reshape(study.samples.rows, -1))
    of_units = _units(job, columns, turns)
    counted = np.any([~np.isnan(of_units[f"{name}_worst"]) for name in library()], axis=0)
    counted[: int(study.samples.nominal_first)] = False
    metrics, units = pd.DataFrame(columns), pd.DataFrame(of_units)
    if study.samples.nominal_first:
        metrics, units = (table[table["sample"] > 0] for table in (metrics, units))
    return {
        "metrics": columns,
        "units": of_units,
        "distributions": _distributions(study, metrics, units),
        "convergence": convergence_rows(study, turns, counted),
        "sensitivity": sensitivity(job, of_units, over_turn(units, "worst")),
    }


AGGREGATE = Stage(
    name="aggregate",
    reads=("sample", "clearance", "hysteresis", "drivers"),
    sections=(
        "samples",
        "tolerances",
        "drivers",
        "design.cycloid.rated_torque_Nm",
        "metrics",
        "limits",
        "cycle.crank_deg",
        "cycle.rigid_crank_deg",
    ),
    tables=(METRICS, UNITS, DISTRIBUTIONS, CONVERGENCE, SENSITIVITY),
    module="stages.aggregate",
    run=_run,
)

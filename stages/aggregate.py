"""Stage 5: backlash, lost motion and torsional rigidity of every sample; their distributions, yield and drivers."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.engine.stage import Job, Stage, WholeTables
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import TurnReadings, turn_library
from pipeline.sampling import replicates
from pipeline.statistics import Estimate, distribution, pass_share
from stages.tables.bearings import bearing_forces
from stages.tables.convergence import CONVERGENCE, angles_of_turn, convergence_rows, searched_pitches, strides_of
from stages.tables.keys import CRANK, SAMPLE, STATUS
from stages.tables.sample_convergence import SAMPLE_CONVERGENCE, sample_convergence_rows
from stages.tables.sensitivity import SENSITIVITY, sensitivity
from stages.tables.transmission import ORDERS, TRANSMISSION, order_rows, transmission_rows
from stages.tables.turn import (
    OF_TURN,
    OVER,
    OVER_TURN,
    Turn,
    loop_metrics,
    metric_turns,
    over_turn_columns,
    turn_columns,
    turn_readings,
    unit_status,
)
from stages.tables.whole_turn import FOUND_AT, WHOLE_TURN, found_columns, shortfalls, whole_turn_estimates

OVER_ALL = "turn"
"""What a metric of the whole turn is over."""
LOST = "a metric has no value at some pitch of the output turn"
"""Status of a unit whose loops at the angles of the study have results."""
SAMPLES_AT_ONCE = 10_000
"""Samples whose loops are read together: at most a few million rows."""
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
        *FOUND_AT,
        *OF_TURN,
        Column("preloaded", "bool", "", "whether the gaps of some part interfere at some crank angle"),
        Column("n_angles", "int32", "1", "loaded crank angles: of means, bests and metrics of the turn"),
        Column("n_searched", "int32", "1", "pitches of the output turn among which the worst was searched; 0: none"),
        Column("n_rigid_angles", "int32", "1", "crank angles of the clearance backlash: of rigid bodies, and loaded"),
        STATUS,
    ),
)
DISTRIBUTIONS = Table(
    "distributions",
    "metric, crank or turn, statistic",
    (
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column(
            "over",
            "label",
            "",
            "angle: at one crank angle; worst, mean or best: of each unit over the turn, as in the table units; turn: "
            "metric of the turn; whole_turn: the worst over the whole turn of the output, corrected by the audited "
            "units, with an interval for the sampling and the search together",
        ),
        Column("crank_deg", "float64", "deg", "crank angle; null but for over = angle"),
        Column("statistic", "label", "", "mean, std, quantile, or yield: the share within the limit"),
        Column("value", "float64", "the metric's", "estimate"),
        Column("ci_low", "float64", "the metric's", "lower end of the confidence interval"),
        Column("ci_high", "float64", "the metric's", "upper end of the confidence interval"),
        Column("n", "int32", "1", "samples that it rests on"),
        Column("n_angles", "int32", "1", "crank angles that each sample's value rests on"),
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
    is_loaded = np.isin(kinematic["crank_deg"], study.cycle.crank_deg)
    return {
        "sample": status["sample"],
        "crank_deg": status["crank_deg"],
        **loop_metrics(study, loops),
        "preloaded": kinematic["preloaded"][is_loaded],
    }


def _rigid_play(job: Job) -> tuple[np.ndarray, np.ndarray]:
    """Play of rigid bodies (n, n_angles) [arcmin], missing where preloaded; whether a unit is so at some angle (n,)."""
    rows = job.study.samples.rows
    plays, preloaded = [], []
    for start in range(0, rows, SAMPLES_AT_ONCE):
        stop = min(start + SAMPLES_AT_ONCE, rows)
        kinematic = job.read_items("clearance", "kinematic", start, stop)
        plays.append(np.where(kinematic["preloaded"], np.nan, kinematic["backlash_arcmin"]).reshape(stop - start, -1))
        preloaded.append(kinematic["preloaded"].reshape(stop - start, -1).any(axis=1))
    return np.concatenate(plays), np.concatenate(preloaded)


def _turn_blocks(job: Job) -> Iterator[tuple[np.ndarray, TurnReadings]]:
    """Numbers of samples and what the metrics of their turn are read from, block by block."""
    study: Study = job.study
    rows = study.samples.rows
    for start in range(0, rows, SAMPLES_AT_ONCE):
        stop = min(start + SAMPLES_AT_ONCE, rows)
        loops, bearings = (job.read_items("hysteresis", name, start, stop) for name in ("loops", "bearings"))
        kinematic = job.read_items("clearance", "kinematic", start, stop)
        ends = [
            np.where(kinematic["preloaded"], np.nan, kinematic[name]).reshape(stop - start, -1)
            for name in ("angle_plus_arcmin", "angle_minus_arcmin")
        ]
        thrust = bearing_forces(bearings, len(study.cycle.crank_deg))
        yield np.arange(start, stop), turn_readings(study, loops, thrust, np.stack(ends, axis=1))


def _of_turn(job: Job) -> dict[int, dict[str, np.ndarray]]:
    """Metrics of the turn of every sample (n,), at every so many of the crank angles."""
    study: Study = job.study
    by_block = [
        {stride: turn_columns(readings.thinned(stride) if stride > 1 else readings) for stride in strides_of(study)}
        for _, readings in _turn_blocks(job)
    ]
    return {
        stride: {name: np.concatenate([block[stride][name] for block in by_block]) for name in turn_library()}
        for stride in strides_of(study)
    }


def _units(
    job: Job,
    metrics: Columns,
    turns: Mapping[str, Turn],
    of_turn: Mapping[str, np.ndarray],
    search: Columns,
    preloaded: np.ndarray,
) -> Columns:
    """Worst, mean and best of every sample over the turn; missing where some crank angle has no result."""
    study: Study = job.study
    n, angles = study.samples.rows, len(study.cycle.crank_deg)
    of_angles, found = over_turn_columns(turns), found_columns(study, turns, search)
    status = unit_status(metrics["status"], angles)
    lost = np.any([np.isnan(found[f"{name}_worst"]) & ~np.isnan(of_angles[f"{name}_worst"]) for name in turns], axis=0)
    return {
        "sample": np.arange(n),
        **of_angles,
        **found,
        **of_turn,
        "preloaded": preloaded,
        "n_angles": np.full(n, angles),
        "n_searched": np.full(n, searched_pitches(study)),
        "n_rigid_angles": np.full(n, turns["clearance_backlash_arcmin"].values.shape[1]),
        "status": np.where((status == "ok") & lost, LOST, status),
    }


def _part(replicate: np.ndarray | None, rows: np.ndarray) -> np.ndarray | None:
    return None if replicate is None else replicate[rows]


def _distribution_rows(
    study: Study, values: pd.DataFrame, turn_value: str, crank_deg: float, angles: Mapping[str, int]
) -> list[dict[str, object]]:
    """Rows of the distributions of one population, indexed by sample; ``angles`` behind each metric that is told."""
    confidence, replicate = study.metrics.confidence, replicates(study.samples, values.index.to_numpy())
    estimates: list[tuple[str, str, Estimate]] = []
    for metric in angles:
        holding = ~np.isnan(values[metric].to_numpy(float))
        if holding.any():
            statistics = distribution(values[metric].to_numpy()[holding], confidence, _part(replicate, holding))
            estimates += [(metric, name, estimate) for name, estimate in statistics.items()]
    for name, passes in study.limits.kept(values).items():
        limited = study.limits.limited(name, values)
        if name not in angles and (name != ALL_LIMITS or turn_value == OVER_ALL):
            continue
        holding = ~np.isnan(values[limited].to_numpy(float)).any(axis=1)
        if holding.any():
            estimates.append((name, "yield", pass_share(passes[holding], confidence, _part(replicate, holding))))
    if len(values) and turn_value != OVER_ALL:
        estimates.append(("preloaded", "mean", pass_share(values["preloaded"].to_numpy(bool), confidence, replicate)))
    fewest = min(angles.values())
    return [
        {
            "metric": metric,
            "over": turn_value,
            "crank_deg": crank_deg,
            "statistic": name,
            **vars(estimate),
            "n_angles": angles.get(metric, fewest),
        }
        for metric, name, estimate in estimates
    ]


def over_turn(units: pd.DataFrame, turn_value: str) -> pd.DataFrame:
    """The metrics of the units that have a result, (n, n_metrics) by sample, as `worst`, `mean` or `best`.

    Those of the whole turn stand beside them. A metric that does not hold at some crank angle is missing.
    """
    metric_columns = {f"{name}_{turn_value}": name for name in library()}
    solved_units = units[units[list(metric_columns)].notna().any(axis=1)].set_index("sample")
    return solved_units[[*metric_columns, *turn_library(), "preloaded"]].rename(columns=metric_columns)


def _distributions(study: Study, metrics: pd.DataFrame, units: pd.DataFrame, shortfall: pd.DataFrame) -> Columns:
    rows = []
    for metric, name, estimate in whole_turn_estimates(study, over_turn(units, "worst"), shortfall):
        keys = {"metric": metric, "over": WHOLE_TURN, "crank_deg": np.nan, "statistic": name}
        rows.append({**keys, **vars(estimate), "n_angles": searched_pitches(study)})
    single = dict.fromkeys(library(), 1)
    for crank, part in metrics.groupby("crank_deg"):
        solved = part[part[list(library())].notna().any(axis=1)]
        if len(solved):
            rows += _distribution_rows(study, solved.set_index("sample"), "angle", float(crank), single)
    if len(units):
        counts = units.iloc[0]
        turn = {
            name: int(counts["n_rigid_angles" if metric.turn_of_rigid_bodies else "n_angles"])
            for name, metric in library().items()
        }
        for turn_value in OVER:
            searched = searched_pitches(study) if turn_value == "worst" else 0
            counts_of_turn = {name: max(count, searched) for name, count in turn.items()}
            rows += _distribution_rows(study, over_turn(units, turn_value), turn_value, np.nan, counts_of_turn)
        of_turn = {name: angles_of_turn(study, 1, metric.of_play) for name, metric in turn_library().items()}
        rows += _distribution_rows(study, over_turn(units, OVER[0]), OVER_ALL, np.nan, of_turn)
    if not rows:
        return DISTRIBUTIONS.empty()
    frame = pd.DataFrame(rows, columns=[column.name for column in DISTRIBUTIONS.columns])
    return {name: frame[name].to_numpy() for name in frame}


def _blocks(columns: Columns, rows: int) -> Iterator[Columns]:
    """Columns in parts of so many rows: as a whole they would be held a second time while they are written."""
    for start in range(0, len(columns["sample"]), rows):
        yield {name: values[start : start + rows] for name, values in columns.items()}


def _run(job: Job) -> WholeTables:
    study: Study = job.study
    columns = _metrics(job)
    rigid, preloaded = _rigid_play(job)
    turns = metric_turns(study, columns, rigid)
    of_turn, search = _of_turn(job), job.read("worst", "found") if study.cycle.searched else {}
    of_units = _units(job, columns, turns, of_turn[1], search, preloaded)
    audit = job.read("worst", "audit")
    shortfall = shortfalls(pd.DataFrame(of_units), audit)
    counted = np.any([~np.isnan(of_units[f"{name}_worst"]) for name in library()], axis=0)
    counted[: int(study.samples.nominal_first)] = False
    metrics, units, angles = pd.DataFrame(columns, copy=False), pd.DataFrame(of_units), len(study.cycle.crank_deg)
    if study.samples.nominal_first:  # its rows are the first: slices are no copies
        metrics, units = metrics.iloc[angles:], units.iloc[1:]
    return {
        "metrics": _blocks(columns, SAMPLES_AT_ONCE * angles) if study.samples.rows > SAMPLES_AT_ONCE else columns,
        "units": of_units,
        "distributions": _distributions(study, metrics, units, shortfall),
        "convergence": convergence_rows(study, turns, of_turn, counted, of_units),
        "sample_convergence": sample_convergence_rows(study, over_turn(units, study.limits.over)),
        "sensitivity": sensitivity(job, of_units | over_turn_columns(turns), over_turn(units, "worst")),
        "transmission": (transmission_rows(study, *block) for block in _turn_blocks(job)),
        "orders": (order_rows(study, *block) for block in _turn_blocks(job)),
    }


AGGREGATE = Stage(
    name="aggregate",
    reads=("sample", "clearance", "hysteresis", "worst", "drivers"),
    sections=(
        "samples",
        "tolerances",
        "drivers",
        "design.cycloid",
        "design.operation",
        "design.output",
        "design.disk",
        "metrics",
        "limits",
        "cycle.crank_deg",
        "cycle.crank_turns",
        "cycle.evenly_loaded",
        "cycle.searched",
        "cycle.turn_deg",
        "cycle.rigid_crank_deg",
    ),
    tables=(METRICS, UNITS, DISTRIBUTIONS, CONVERGENCE, SAMPLE_CONVERGENCE, SENSITIVITY, TRANSMISSION, ORDERS),
    module="stages.aggregate",
    run=_run,
)

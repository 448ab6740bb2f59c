"""Stage 5: backlash, lost motion and torsional rigidity of every sample; their distributions, yield and drivers."""

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.engine.parallel import end_idle_workers
from pipeline.engine.stage import Job, Stage, WholeTables
from pipeline.engine.table import Column, Columns, Table
from pipeline.model.metrics import CONTINUOUS_TURN, WHOLE_TURN, library
from pipeline.model.metrics.turn import TurnReadings, turn_library
from pipeline.sampling.pick_freeze import drawn_units
from stages.tables import turn
from stages.tables.convergence import (
    CONVERGENCE,
    SAMPLE_CONVERGENCE,
    angles_of_turn,
    convergence_rows,
    sample_convergence_rows,
    searched_pitches,
    strides_of,
    worst_of_stride,
)
from stages.tables.distributions import DISTRIBUTIONS, PerAngle, distribution_rows, over_turn
from stages.tables.keys import CRANK, SAMPLE, STATUS
from stages.tables.over_turn import ORDERS, TRANSMISSION, bearing_forces, order_rows, transmission_rows
from stages.tables.sensitivity import SENSITIVITY, sensitivity

LOST = "a metric has no value at some pitch of the output turn"
"""Status of a unit whose loops at the angles of the study have results."""
UNFOUND = "the play of finite motions is not found at the crank angle of the largest one"
"""Status of a unit whose clearance backlash is missing for it."""
SAMPLES_AT_ONCE = 10_000
"""Samples that are read together at most."""
ROWS_AT_ONCE = 2_000_000
"""Rows of a table that are read together at most: many crank angles leave fewer samples."""
UNITS_AT_ONCE = 65_536
"""Rows of the table of units that are written together at most: each is held four times while it is."""
READ_IN_BLOCKS = (("clearance", "kinematic"), ("hysteresis", "loops"), ("hysteresis", "bearings"))
"""Stage and table of what is read of some samples at a time."""
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
        *turn.OVER_TURN,
        *turn.FOUND_AT,
        *turn.OF_TURN,
        Column("preloaded", "bool", "", "whether the gaps of some part interfere at some crank angle"),
        Column("n_angles", "int32", "1", "loaded crank angles: of all means and bests but the clearance backlash's"),
        Column("n_searched", "int32", "1", "pitches of the output turn among which the worst was searched; 0: none"),
        Column("n_rigid_angles", "int32", "1", "crank angles of the clearance backlash, loaded ones too"),
        STATUS,
    ),
)


@dataclass(frozen=True)
class _Block:
    """Some samples of a study, from ``start`` to ``stop``, whose tables are read together."""

    job: Job
    start: int
    stop: int

    @property
    def samples(self) -> np.ndarray:
        return np.arange(self.start, self.stop)

    def _read(self, stage: str, table: str) -> Columns:
        return self.job.read_items(stage, table, self.start, self.stop)

    @cached_property
    def _loops(self) -> Columns:
        return self._read("hysteresis", "loops")

    @cached_property
    def _kinematic(self) -> Columns:
        return self._read("clearance", "kinematic")

    @cached_property
    def metrics(self) -> Columns:
        """Rows of the table of metrics."""
        study: Study = self.job.study
        status = self._read("hysteresis", "status")
        is_loaded = np.isin(self._kinematic["crank_deg"], study.cycle.crank_deg)
        return {
            "sample": status["sample"],
            "crank_deg": status["crank_deg"],
            **turn.loop_metrics(study, self._loops),
            "preloaded": self._kinematic["preloaded"][is_loaded],
            "status": status["status"],
        }

    def _of_rigid_bodies(self, column: str) -> np.ndarray:
        """A column of rigid bodies (n, n_angles); missing where they are preloaded."""
        values = np.where(self._kinematic["preloaded"], np.nan, self._kinematic[column])
        return values.reshape(self.stop - self.start, -1)

    @cached_property
    def is_preloaded(self) -> np.ndarray:
        """Whether a unit is preloaded at some angle (n,)."""
        is_preloaded: np.ndarray = self._kinematic["preloaded"].reshape(self.stop - self.start, -1).any(axis=1)
        return is_preloaded

    @cached_property
    def turns(self) -> dict[str, turn.Turn]:
        """The metrics over the turn."""
        backlash = self._of_rigid_bodies("backlash_arcmin")
        return turn.metric_turns(self.job.study, self.metrics, backlash, self._finite_motion)

    @cached_property
    def _finite_motion(self) -> np.ndarray:
        """What finite motions add to the backlash (n, n_angles) [arcmin]; missing where it is not found."""
        motion: np.ndarray = self._kinematic["finite_motion_arcmin"].reshape(self.stop - self.start, -1)
        return motion

    @cached_property
    def readings(self) -> TurnReadings:
        """What the metrics of the turn are read from."""
        study: Study = self.job.study
        ends = [self._of_rigid_bodies(name) for name in ("angle_plus_arcmin", "angle_minus_arcmin")]
        thrust = bearing_forces(self._read("hysteresis", "bearings"), len(study.cycle.crank_deg))
        return turn.turn_readings(study, self._loops, thrust, np.stack(ends, axis=1))

    def of_strides(self) -> dict[int, dict[str, np.ndarray]]:
        """The worst of every metric and the metrics of the turn (n,), at every so many of the crank angles."""
        study: Study = self.job.study
        return {
            stride: worst_of_stride(self.turns, stride)
            | turn.turn_columns(self.readings.with_stride(stride) if stride > 1 else self.readings)
            for stride in strides_of(study)
        }

    def units(self, of_turn: Mapping[str, np.ndarray]) -> Columns:
        """Rows of the table of units: worst, mean and best over the turn; missing where some angle has no result."""
        study: Study = self.job.study
        angles = len(study.cycle.crank_deg)
        search = self._read("worst", "found") if study.cycle.has_turn_search else {}
        of_angles, searched_columns = turn.over_turn_columns(self.turns), turn.found_columns(study, self.turns, search)
        status = turn.unit_status(self.metrics["status"], angles)
        worst = [f"{name}_worst" for name in self.turns]
        lost = np.any([np.isnan(searched_columns[name]) & ~np.isnan(of_angles[name]) for name in worst], axis=0)
        unfound = np.isnan(self._finite_motion).any(axis=1)
        n = self.stop - self.start
        return {
            "sample": self.samples,
            **of_angles,
            **searched_columns,
            **{name: of_turn[name] for name in turn_library()},
            **turn.searched_ranges(of_turn, search),
            "preloaded": self.is_preloaded,
            "n_angles": np.full(n, angles),
            "n_searched": np.full(n, searched_pitches(study)),
            "n_rigid_angles": np.full(n, angles_of_turn(study, 1, of_play=True)),
            "status": np.select([status != "ok", unfound, lost], [status, UNFOUND, LOST], "ok"),
        }


def _blocks(job: Job) -> Iterator[_Block]:
    samples = job.study.samples.rows
    at_once = _samples_at_once(job)
    for start in range(0, samples, at_once):
        yield _Block(job, start, min(start + at_once, samples))


def _samples_at_once(job: Job) -> int:
    rows = max(job.inputs[stage].record["tables"][table]["rows"] for stage, table in READ_IN_BLOCKS)
    return int(max(1, min(SAMPLES_AT_ONCE, ROWS_AT_ONCE * job.study.samples.rows // max(1, rows))))


@dataclass(frozen=True)
class _Columns:
    """What is kept of samples (n,), filled block by block: blocks that are joined at the end would be held twice.

    Attributes
    ----------
    units : rows of the table of units.
    of_angles : worst, mean and best over the angles of the study alone, and the metrics of the turn at them, of the
        samples that drivers need.
    of_strides : the worst of every metric and the metrics of the turn, by stride.
    """

    units: Columns
    of_angles: Columns
    of_strides: Mapping[int, Columns]


def _columns(job: Job, per_angle: PerAngle) -> _Columns:
    """The columns of all samples, read block by block; the metrics at each crank angle go to ``per_angle``."""
    study: Study = job.study
    rows, drawn_rows = study.samples.rows, int(study.samples.nominal_first) + drawn_units(study)
    kept = _Columns({}, {}, {stride: {} for stride in strides_of(study)})
    for block in _blocks(job):
        per_angle.add(block.metrics)
        of_strides = block.of_strides()
        for stride, columns in of_strides.items():
            _fill(kept.of_strides[stride], columns, block.start, rows)
        _fill(kept.units, block.units(of_strides[1]), block.start, rows)
        of_angles = turn.over_turn_columns(block.turns) | {name: of_strides[1][name] for name in turn_library()}
        _fill(kept.of_angles, of_angles, block.start, min(drawn_rows, rows))
    return kept


def _fill(kept: Columns, columns: Mapping[str, np.ndarray], start: int, rows: int) -> None:
    """Put the columns of a block in its place, from ``start``, among the first ``rows`` that are kept."""
    for name, values in columns.items():
        if name not in kept:
            kept[name] = np.empty(rows, values.dtype)
        kept[name][start : start + len(values)] = values[: max(0, rows - start)]


def _parts(units: Columns) -> Iterator[Columns]:
    """Rows of the table of units, as many as are written together."""
    for start in range(0, len(units["sample"]), UNITS_AT_ONCE):
        yield {name: values[start : start + UNITS_AT_ONCE] for name, values in units.items()}


def _run(job: Job) -> WholeTables:
    end_idle_workers()
    study: Study = job.study
    with tempfile.TemporaryFile(dir=job.folder) as file:  # without a name: nothing is left of it, however this ends
        per_angle = PerAngle(file, (*library(), "preloaded"), len(study.cycle.crank_deg))
        columns = _columns(job, per_angle)
        units = pd.DataFrame(columns.units, copy=False)
        audit = job.read("worst", "audit")
        missed, between = {WHOLE_TURN: turn.shortfalls(units, audit)}, turn.left_between(audit)
        if between is not None:
            missed[CONTINUOUS_TURN] = missed[WHOLE_TURN] + between
        is_counted = units[[f"{name}_worst" for name in library()]].notna().any(axis=1).to_numpy(copy=True)
        is_counted[: int(study.samples.nominal_first)] = False
        units = units.iloc[int(study.samples.nominal_first) :]
        distributions = distribution_rows(study, per_angle, units, missed)
    fits_memory = study.samples.rows <= _samples_at_once(job)
    return {
        "metrics": next(_blocks(job)).metrics if fits_memory else (block.metrics for block in _blocks(job)),
        "units": columns.units if study.samples.rows <= UNITS_AT_ONCE else _parts(columns.units),
        "distributions": distributions,
        "convergence": convergence_rows(study, columns.of_strides, is_counted, columns.units),
        "sample_convergence": sample_convergence_rows(study, over_turn(units, study.limits.over)),
        "sensitivity": sensitivity(job, columns.units, columns.of_angles, over_turn(units, "worst")),
        "transmission": (transmission_rows(study, block.samples, block.readings) for block in _blocks(job)),
        "orders": (order_rows(study, block.samples, block.readings) for block in _blocks(job)),
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
        "cycle.has_turn_search",
        "cycle.turn_deg",
        "cycle.rigid_crank_deg",
        "cycle.even_crank_deg",
    ),
    tables=(METRICS, UNITS, DISTRIBUTIONS, CONVERGENCE, SAMPLE_CONVERGENCE, SENSITIVITY, TRANSMISSION, ORDERS),
    module="stages.aggregate",
    run=_run,
    proportional_to=("samples.count",),
    unit_seconds=6e-4,
)

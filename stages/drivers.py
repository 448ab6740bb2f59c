"""Stage 4c: the units beyond the study's own samples that variance-based indices need, solved like them.

Where the worst over the whole turn is searched for, that of some units is too: the indices of the worst follow from
both, see ``sensitivity.two_fidelity_indices``.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.config.studies.study import FEWEST_BASE_SAMPLES, Study
from pipeline.engine.parallel import end_idle_workers
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import turn_library
from pipeline.populations.turn_drives import TurnDrives, Units
from pipeline.populations.turn_ranking import Ranking
from pipeline.populations.turn_search import search
from pipeline.sampling.errors import Errors
from pipeline.sampling.pick_freeze import draw_mixed, drawn_units, error_groups
from stages import hysteresis
from stages.clearance import rigid_turn
from stages.hysteresis import HYSTERESIS, solved_loops
from stages.tables.keys import STATUS
from stages.tables.turn import (
    OF_TURN,
    OVER_TURN,
    loop_metrics,
    metric_turns,
    over_turn_columns,
    turn_columns,
    turn_readings,
    unit_status,
)
from stages.worst import RANGES, ranked_drives

SETS = ("base", "other")
"""Labels of the two sets; the units of a further one carry the name of the group that is exchanged."""
SEARCHED_SHARE = 0.2
"""Base samples of each set whose worst over the whole turn is searched for: as many seconds as the others take."""

SEARCHED = {**library(), **{name: turn_library()[name] for name in RANGES}}
"""Metrics that are searched for over the whole turn."""
UNITS = Table(
    "units",
    "unit of the pick-freeze design that is no sample of the study",
    (
        Column("unit", "int32", "1", "number in the design: a set after the other"),
        Column("set", "label", "", "base, other, or the errors that a unit of base has from that of other"),
        Column("base_sample", "int32", "1", "number within the set; units of equal number belong together"),
        *OVER_TURN,
        *(
            Column(f"{name}_found", "float64", metric.unit, f"{metric.inline}, worst by search; null if not searched")
            for name, metric in SEARCHED.items()
        ),
        *OF_TURN,
        STATUS,
    ),
    item="unit",
)


@dataclass(frozen=True)
class Shared:
    """What every chunk needs: of the loops at the angles of the study, and of the search; None without one."""

    loops: hysteresis.Shared
    turn: tuple[TurnDrives, Ranking] | None


def prepare(job: Job) -> Shared:
    """As the stages of the loops and of the search prepare them; no curve is kept."""
    end_idle_workers()
    loops, study = hysteresis.prepare(job), job.study
    searches = study.cycle.has_turn_search and _items(job) > 0
    return Shared(replace(loops, curve=loops.brief), ranked_drives(job) if searches else None)


def searched_rows(study: Study) -> int:
    """Base samples of each set, the first ones, whose worst over the whole turn is searched for."""
    if not study.cycle.has_turn_search:
        return 0
    return max(FEWEST_BASE_SAMPLES, round(SEARCHED_SHARE * study.drivers.base_samples))


def _items(job: Job) -> int:
    study: Study = job.study
    return (len(SETS) + len(error_groups(study))) * study.drivers.base_samples - drawn_units(study)


def _solve(loop_inputs: Shared, chunk: Chunk) -> Tables:
    study = loop_inputs.loops.study
    unit = np.arange(chunk.start, chunk.stop) + drawn_units(study)
    sampled_errors = draw_mixed(study, int(unit[0]), int(unit[-1]) + 1)
    loops, (ends, finite_motion) = solved_loops(loop_inputs.loops, sampled_errors), rigid_turn(study, sampled_errors)
    turns = metric_turns(study, loop_metrics(study, loops.columns), ends[:, 0] - ends[:, 1], finite_motion)
    readings = turn_readings(study, loops.columns, loops.bearing_force, ends)
    kind, base_sample = np.divmod(unit, study.drivers.base_samples)
    return {
        "units": {
            "unit": unit,
            "set": np.array([*SETS, *error_groups(study)], object)[kind],
            "base_sample": base_sample,
            **over_turn_columns(turns),
            **_search_worst(loop_inputs, sampled_errors, np.flatnonzero(base_sample < searched_rows(study))),
            **turn_columns(readings),
            "status": unit_status(loops.status, len(study.cycle.crank_deg)),
        }
    }


def _search_worst(loop_inputs: Shared, sampled_errors: Errors, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The worst of every metric (n,), and transmission errors, that a search finds of some units; missing of others."""
    columns = {f"{name}_found": np.full(len(sampled_errors), np.nan) for name in SEARCHED}
    if loop_inputs.turn is not None and len(rows):
        units = Units.from_errors(loop_inputs.loops.study, sampled_errors).some(rows)
        for name, values in search(*loop_inputs.turn, units).of_turn.items():
            columns[f"{name}_found"][rows] = values
    return columns


def _failures(tables: Tables) -> int:
    return int(np.count_nonzero(np.asarray(tables["units"]["status"]) != "ok"))


DRIVERS = Stage(
    name="drivers",
    reads=("sample", "springs", "reduce"),
    sections=(
        *(section for section in HYSTERESIS.sections if section != "cycle.keep_contacts"),
        "design",
        "springs",
        "reduce",
        "tolerances",
        "drivers",
        "cycle.crank_turns",
        "cycle.has_turn_search",
        "cycle.evenly_loaded",
        "cycle.turn_deg",
        "cycle.rigid_crank_deg",
        "cycle.even_crank_deg",
    ),
    tables=(UNITS,),
    module="stages.drivers",
    unit="units",
    items=_items,
    prepare=prepare,
    solve=_solve,
    failures=_failures,
    chunk_factor=14,
    proportional_to=("cycle.crank_deg", "design.cycloid.pins"),
    unit_seconds=4.6e-6,
)

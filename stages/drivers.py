"""Stage 4c: the units beyond the study's own samples that variance-based indices need, solved like them."""

import numpy as np

from pipeline.config.studies.study import Study
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.sampling import draw_mixed, drawn_units, error_groups
from stages.clearance import rigid_ends
from stages.hysteresis import HYSTERESIS, Shared, prepare, solved_loops
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

SETS = ("base", "other")
"""Labels of the two sets; the units of a further one carry the name of the group that is exchanged."""

UNITS = Table(
    "units",
    "unit of the pick-freeze design that is no sample of the study",
    (
        Column("unit", "int32", "1", "number in the design: a set after the other"),
        Column("set", "label", "", "base, other, or the errors that a unit of base has from that of other"),
        Column("base_sample", "int32", "1", "number within the set; units of equal number belong together"),
        *OVER_TURN,
        *OF_TURN,
        STATUS,
    ),
)


def _items(job: Job) -> int:
    study: Study = job.study
    return (len(SETS) + len(error_groups(study))) * study.drivers.base_samples - drawn_units(study)


def _solve(shared: Shared, chunk: Chunk) -> Tables:
    study = shared.study
    unit = np.arange(chunk.start, chunk.stop) + drawn_units(study)
    sampled = draw_mixed(study, int(unit[0]), int(unit[-1]) + 1)
    loops, ends = solved_loops(shared, sampled), rigid_ends(study, sampled)
    turns = metric_turns(study, loop_metrics(study, loops.columns), ends[:, 0] - ends[:, 1])
    readings = turn_readings(study, loops.columns, loops.bearing_force, ends)
    kind, base_sample = np.divmod(unit, study.drivers.base_samples)
    return {
        "units": {
            "unit": unit,
            "set": np.array([*SETS, *error_groups(study)], object)[kind],
            "base_sample": base_sample,
            **over_turn_columns(turns),
            **turn_columns(readings),
            "status": unit_status(loops.status, len(study.cycle.crank_deg)),
        }
    }


def _failures(tables: Tables) -> int:
    return int(np.count_nonzero(np.asarray(tables["units"]["status"]) != "ok"))


DRIVERS = Stage(
    name="drivers",
    reads=("springs", "reduce"),
    sections=(
        *(section for section in HYSTERESIS.sections if section != "cycle.keep_contacts"),
        "design",
        "springs",
        "reduce",
        "tolerances",
        "drivers",
        "cycle.crank_turns",
        "cycle.evenly_loaded",
        "cycle.turn_deg",
        "cycle.rigid_crank_deg",
    ),
    tables=(UNITS,),
    module="stages.drivers",
    unit="units",
    items=_items,
    prepare=prepare,
    solve=_solve,
    failures=_failures,
)

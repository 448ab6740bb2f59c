"""Stage 5b: the first units solved again at other scales of each tolerance, and the yields that follow."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.arrays import Real, joined_columns
from pipeline.config.studies.study import Study
from pipeline.engine.parallel import batches, end_idle_workers, worker_results
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Table, interval_columns
from pipeline.model.metrics import WHOLE_TURN, library
from pipeline.populations.scaled_tolerances import (
    removed_variances,
    scaled_points,
    scaled_tolerances,
    scaled_values,
    scaled_yields,
)
from pipeline.sampling.errors import Errors
from pipeline.statistics.intervals import Estimate
from stages.clearance import rigid_ends
from stages.hysteresis import Shared, prepare, solved_loops
from stages.tables.distributions import OVER_ALL, over_turn
from stages.tables.keys import SAMPLE
from stages.tables.turn import OF_TURN, loop_metrics, metric_turns, over_turn_columns, turn_columns, turn_readings
from stages.tails import OF_FRESH_UNITS

LOOPS = 200_000
"""Loops that are solved, units times loaded angles times scales of all tolerances: some minutes of processor time."""
CARRIER_FACTOR = 3
"""Times that a loop of an RV reducer takes."""
MOST_ANGLES = 31
"""Loaded angles of a unit that are solved at most, evenly among those of the study."""
FEWEST = 16
"""Units that are solved at every scale at least, where the study has as many."""
BATCH = 8
"""Units that are solved together at all scales, whatever the chunks of the run: a bit of a product depends on it."""

UNITS = Table(
    "units",
    "sample, tolerance, scale",
    (
        SAMPLE,
        Column("tolerance", "label", "", "the tolerance that is scaled; empty: none"),
        Column("scale", "float64", "1", "factor on its limits about nominal; its allowance stays"),
        *(
            Column(name, "float64", metric.unit, f"{metric.inline} over some angles; null where it does not hold")
            for name, metric in library().items()
        ),
        *OF_TURN,
    ),
)


YIELDS = Table(
    "yields",
    "tolerance, scale, limit",
    (
        Column("tolerance", "label", "", "the tolerance that is scaled, all others as the study states them"),
        Column("scale", "float64", "1", "factor on its limits about nominal; its allowance stays"),
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column(
            "value", "float64", "1", "yield of the study plus the difference of its first units, solved at both scales"
        ),
        *interval_columns("1"),
        Column("n", "int32", "1", "units of the difference"),
    ),
)


VARIANCES = Table(
    "variances",
    "tolerance, metric",
    (
        Column(
            "tolerance", "label", "", "the tolerance that is scaled to a quarter, all others as the study states them"
        ),
        Column("metric", "label", "", "column of metrics, over some angles, or of metrics of the turn"),
        Column("value", "float64", "1", "share of the variance that this removes"),
        *interval_columns("1"),
        Column("n", "int32", "1", "units solved at both scales"),
    ),
)


SECTIONS = ("samples", "cycle", *(name for name in OF_FRESH_UNITS if not name.startswith("cycle.")))
"""Sections of a study that scaled units depend on."""


def _run(job: Job) -> Tables:
    end_idle_workers()
    study: Study = job.study
    if not scaled_tolerances(study):
        return {table.name: table.empty() for table in (UNITS, YIELDS, VARIANCES)}
    first_unit = int(study.samples.nominal_first)
    stop = min(study.samples.rows, first_unit + units_solved(study))
    loops = _at_some_angles(prepare(job))
    solve = partial(metrics_of_units, loops, study.limits.over)
    inputs = ((study, *ends, solve) for ends in batches(first_unit, stop, BATCH))
    scaled_units = pd.DataFrame(joined_columns(worker_results(job.jobs, scaled_values, inputs)))
    distributions = pd.DataFrame(job.read("aggregate", "distributions"))
    units = pd.DataFrame(job.read_items("aggregate", "units", first_unit, stop))
    stated_values, stated_yields = over_turn(units, study.limits.over), _stated_yields(study, distributions)
    yields = scaled_yields(study, scaled_units, stated_values, stated_yields)
    variances = removed_variances(scaled_units, study.metrics.confidence)
    return {
        UNITS.name: {str(name): values.to_numpy() for name, values in scaled_units.items()},
        YIELDS.name: YIELDS.columns_of_rows([vars(row) for row in yields]),
        VARIANCES.name: VARIANCES.columns_of_rows([vars(row) for row in variances]),
    }


def units_solved(study: Study) -> int:
    """Units that are solved at the scales of each tolerance, at most."""
    factor = CARRIER_FACTOR if study.design.output.carries_disks else 1
    angles = len(study.cycle.crank_deg[:: _stride(study)])
    return max(FEWEST, LOOPS // (factor * len(scaled_points(study)) * angles))


def _stride(study: Study) -> int:
    """Every so many of the loaded angles are solved."""
    return -(-len(study.cycle.crank_deg) // MOST_ANGLES)


def _at_some_angles(loop_inputs: Shared) -> Shared:
    """The inputs of the loops, and the study, at every so many of the loaded angles."""
    study, every = loop_inputs.study, slice(None, None, _stride(loop_inputs.study))
    cycle = study.cycle.model_copy(update={"crank_deg": study.cycle.crank_deg[every]})
    return replace(
        loop_inputs.at_some(every),
        study=Study.model_construct(
            cycle=cycle, **{name: getattr(study, name) for name in SECTIONS if name != "cycle"}
        ),
    )


def metrics_of_units(loop_inputs: Shared, over: str, sampled_errors: Errors) -> dict[str, Real]:
    """Metrics of units (n,), ``over`` the loaded angles and those of rigid bodies, and their metrics of the turn.

    Finite motions are left out of the play: they change by less than the play does.
    """
    study, ends = loop_inputs.study, rigid_ends(loop_inputs.study, sampled_errors)
    loops = solved_loops(replace(loop_inputs, curve=loop_inputs.brief), sampled_errors)
    turns = metric_turns(study, loop_metrics(study, loops.columns), ends[:, 0] - ends[:, 1])
    readings = turn_readings(study, loops.columns, loops.bearing_force, ends)
    readings = replace(readings, loaded_even=np.ones_like(readings.loaded_even))  # some of even ones are even enough
    values = over_turn_columns(turns)
    return {**{name: values[f"{name}_{over}"] for name in library()}, **turn_columns(readings)}


def _stated_yields(study: Study, distributions: pd.DataFrame) -> dict[str, Estimate]:
    """Yields of the whole study by metric, of the whole turn where that was searched."""
    turn_values = [study.limits.over, OVER_ALL, WHOLE_TURN]  # the last one there counts
    yields = distributions[distributions["statistic"] == "yield"]
    rows = pd.concat([yields[yields["over"] == name] for name in turn_values])
    values = zip(*(rows[name] for name in ("metric", "value", "ci_low", "ci_high", "n")), strict=True)
    return {str(metric): Estimate(*numbers) for metric, *numbers in values}


SCALES = Stage(
    name="scales",
    reads=("springs", "reduce", "aggregate"),
    sections=SECTIONS,
    tables=(UNITS, YIELDS, VARIANCES),
    module="stages.scales",
    run=_run,
    unit_seconds=40.0,
)

"""Stage 5b: metrics of the first units at other scales of each tolerance, by a rough model fitted to their loops."""

from functools import partial

import pandas as pd

from pipeline.arrays import joined_columns
from pipeline.config.studies.study import Study
from pipeline.engine.parallel import batches, end_idle_workers, worker_results
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.model.metrics import WHOLE_TURN, library
from pipeline.populations.prediction import rough_metrics
from pipeline.populations.scaled_tolerances import scaled_points, scaled_tolerances, scaled_yields, surrogate_values
from pipeline.sampling.errors import draw
from pipeline.statistics.intervals import Estimate
from stages.hysteresis import prepare
from stages.tables.distributions import OVER_ALL, over_turn
from stages.tables.keys import SAMPLE
from stages.tables.turn import loop_metrics
from stages.tails import OF_FRESH_UNITS, springs

UNIT_ANGLES = 16_000
"""Units times loaded angles that are looked at: half a minute of processor time with nine tolerances."""
LOOKS = 55 * UNIT_ANGLES
"""The same times the scales of all tolerances, which are 55 of nine: a study of more tolerances has fewer units."""
CARRIER_FACTOR, LEAST = 3, 64
"""Times that a look at an RV reducer takes, whose rigid play is a program of its own; its units that are looked at all
the same."""
TRIAL = 10
"""Units whose contact forces give the springs of the rough model; a fit to all units then corrects its metrics."""
BATCH = 64
"""Units that are looked at together, whatever the chunks of the run: a bit of a product depends on their number."""

SURROGATE = Table(
    "surrogate",
    "sample, tolerance, scale",
    (
        SAMPLE,
        Column("tolerance", "label", "", "the tolerance that is scaled; empty: none"),
        Column("scale", "float64", "1", "factor on its limits about nominal; its allowance stays"),
        *(
            Column(name, "float64", metric.unit, f"estimated {metric.inline}, over the loaded angles alone")
            for name, metric in library().items()
        ),
    ),
)


YIELDS = Table(
    "yields",
    "tolerance, scale, limit",
    (
        Column("tolerance", "label", "", "the tolerance that is scaled, all others as the study states them"),
        Column("scale", "float64", "1", "factor on its limits about nominal; its allowance stays"),
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column("value", "float64", "1", "yield of the study plus the estimated difference of its first units"),
        *interval_columns("1", "confidence interval, without the error of the surrogate"),
        Column("n", "int32", "1", "units of the difference"),
        Column("explained", "float64", "1", "squared correlation with the load-solved metric; all_limits: the least"),
    ),
)


def _run(job: Job) -> Tables:
    end_idle_workers()
    study: Study = job.study
    if not scaled_tolerances(study):
        return {SURROGATE.name: SURROGATE.empty(), YIELDS.name: YIELDS.empty()}
    stop = min(study.samples.rows, 1 + units_looked_at(study))
    surrogate = _surrogate(job, stop)
    distributions = pd.DataFrame(job.read("aggregate", "distributions"))
    units = pd.DataFrame(job.read_items("aggregate", "units", int(study.samples.nominal_first), stop))
    solved_values = over_turn(units, study.limits.over)
    rows = [
        vars(row)
        for row in scaled_yields(study, pd.DataFrame(surrogate), solved_values, _stated_yields(study, distributions))
    ]
    yields = {name: values.to_numpy() for name, values in pd.DataFrame(rows).items()} if rows else YIELDS.empty()
    return {SURROGATE.name: surrogate, YIELDS.name: yields}


def units_looked_at(study: Study) -> int:
    """Units at the scales of each tolerance, at most."""
    units = min(UNIT_ANGLES, LOOKS // len(scaled_points(study))) // len(study.cycle.crank_deg)
    return max(units // CARRIER_FACTOR, min(units, LEAST)) if study.design.output.carries_disks else units


def _surrogate(job: Job, stop: int) -> Columns:
    """Metrics of the samples up to ``stop`` at every scale."""
    study: Study = job.study
    first_unit = int(study.samples.nominal_first)
    rough = partial(rough_metrics, study, springs(prepare(job), draw(study, first_unit, min(first_unit + TRIAL, stop))))
    metrics = loop_metrics(study, job.read_items("hysteresis", "loops", 0, stop))
    loaded_values = {name: metrics[name].reshape(stop, -1) for name in library()}
    pilot = dict(rough(draw(study, 0, stop)))
    inputs = ((study, *ends, rough, loaded_values, pilot) for ends in batches(0, stop, BATCH))
    return joined_columns(worker_results(job.jobs, surrogate_values, inputs))


def _stated_yields(study: Study, distributions: pd.DataFrame) -> dict[str, Estimate]:
    """Yields of the whole study by metric, of the whole turn where that was searched."""
    turn_values = [study.limits.over, OVER_ALL, WHOLE_TURN]  # the last one there counts
    yields = distributions[distributions["statistic"] == "yield"]
    rows = pd.concat([yields[yields["over"] == name] for name in turn_values])
    values = zip(*(rows[name] for name in ("metric", "value", "ci_low", "ci_high", "n")), strict=True)
    return {str(metric): Estimate(*numbers) for metric, *numbers in values}


SCALES = Stage(
    name="scales",
    reads=("springs", "reduce", "hysteresis", "aggregate"),
    sections=("samples", *OF_FRESH_UNITS),
    tables=(SURROGATE, YIELDS),
    module="stages.scales",
    run=_run,
    proportional_to=("samples.count", "cycle.crank_deg"),
    unit_seconds=6.5e-5,
)

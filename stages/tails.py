"""Stage 4d: units beyond each limit down to parts per million, and far quantiles, from few load-solved units."""

from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Table, interval_columns
from pipeline.model.load_history.winkler import secant_compliance
from pipeline.model.metrics import library
from pipeline.populations import prediction
from pipeline.populations.tails import far_tails, population
from pipeline.sampling.errors import Errors, draw
from stages.hysteresis import Shared, prepare, solve_samples, solved_loops
from stages.tables.turn import loop_metrics

TRIAL = 50
"""Units of the pilot whose contact forces tell the springs of the rough model."""

FAR_TAILS = Table(
    "tails",
    "metric, statistic",
    (
        Column("metric", "label", "", "metric under load that has a limit"),
        Column("statistic", "label", "", "beyond: share of units beyond the limit; p99.73 or p0.27: quantile"),
        Column("value", "float64", "1 or the metric's", "estimate"),
        *interval_columns("1 or the metric's"),
        Column("units", "int32", "1", "units evaluated with the surrogate"),
        Column("solved", "int32", "1", "of them load-solved"),
        Column("effective", "float64", "1", "effective sample size: fully solved units with the same accuracy"),
    ),
)


def springs(loop_inputs: Shared, sampled_errors: Errors) -> list[np.ndarray]:
    """Compliance of independent springs (n_contacts,) [mm/N] at each loaded angle, by the forces of ``n`` units."""
    compliances = []
    for solution in solve_samples(replace(loop_inputs, curve=loop_inputs.brief), sampled_errors):
        states = solution.response.equilibria
        compliances.append(secant_compliance(solution.drive, states.force[states.converged]))
    return compliances


def at_angles(loop_inputs: Shared, sampled_errors: Errors) -> dict[str, np.ndarray]:
    """Every metric of ``n`` units at the loaded angles (n, n_angles); missing where an angle has no result."""
    loops = solved_loops(replace(loop_inputs, curve=loop_inputs.brief), sampled_errors)
    metrics = loop_metrics(loop_inputs.study, loops.columns)
    return {name: metrics[name].reshape(len(sampled_errors), -1) for name in library()}


def _run(job: Job) -> Tables:
    study, tails = job.study, job.study.tails
    if tails is None:
        return {FAR_TAILS.name: FAR_TAILS.empty()}
    loop_inputs = prepare(job)
    trial = draw(population(study, tails.units), tails.units, tails.units + TRIAL)
    rough = partial(prediction.rough_metrics, study, springs(loop_inputs, trial))
    rows = far_tails(study, tails.units, tails.solve, rough, partial(at_angles, loop_inputs), job.jobs)
    return {FAR_TAILS.name: FAR_TAILS.columns_of_rows([vars(row) for row in rows])}


OF_FRESH_UNITS = (
    "tolerances",
    "design",
    "clearance",
    "springs",
    "reduce",
    "cycle.crank_deg",
    "cycle.curve_crank_deg",
    "cycle.levels_per_branch",
    "cycle.torque_fraction",
    "metrics",
    "limits",
)
"""Sections of a study that the metrics of units of other draws or tolerances depend on."""
TAILS = Stage(
    name="tails",
    reads=("springs", "reduce"),
    sections=("tails", "samples.experiment", "samples.seed", *OF_FRESH_UNITS),
    tables=(FAR_TAILS,),
    module="stages.tails",
    run=_run,
)

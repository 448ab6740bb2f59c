"""The command of a study's far tails: load-solves what a rough model picks, with what the stages have condensed."""

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.cli import settings
from pipeline.config import load_study
from pipeline.engine.cache import Cache
from pipeline.engine.runner import run
from pipeline.engine.stage import Job
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.model.load_history.winkler import secant_compliance
from pipeline.model.metrics import library
from pipeline.population import prediction, tails
from pipeline.sampling import Errors, draw
from stages import hysteresis
from stages.chain import STAGES
from stages.turn import loop_metrics

TRIAL = 50
"""Units of the pilot whose contact forces tell the springs of the rough model."""


def find_tails(options: argparse.Namespace) -> None:
    """Write shares beyond the limits and far quantiles of a study."""
    if not 0 < options.solve <= options.units:
        raise InputError(f"--solve = {options.solve}; must be from 1 to --units = {options.units}")
    study = load_study(options.study, settings.ROOT)
    tails.tails_of(study)  # says what is missing before anything is condensed
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["springs", "reduce"], settings.RUNS, resources)
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, outputs, Cache(settings.RUNS / ".cache", "")))
    trial = draw(tails.population(study, options.units), options.units, options.units + TRIAL)
    rough = partial(prediction.rough_metrics, study, springs(shared, trial))
    rows = tails.far_tails(study, options.units, options.solve, rough, partial(at_angles, shared), resources.jobs)
    table = settings.RUNS / "tails" / f"{study.name}.csv"
    write_atomic(table, tails.text(rows).encode())
    print(table.read_text(), end="")
    print(f"table: {settings.shown(table)}")


def springs(shared: hysteresis.Shared, sampled: Errors) -> list[np.ndarray]:
    """Compliance of independent springs (n_contacts,) [mm/N] at each loaded angle, by the forces of ``n`` units."""
    compliances = []
    for solved in hysteresis.solve_samples(replace(shared, curve=shared.brief), sampled):
        states = solved.response.equilibria
        compliances.append(secant_compliance(solved.drive, states.force[states.converged]))
    return compliances


def at_angles(shared: hysteresis.Shared, sampled: Errors) -> dict[str, np.ndarray]:
    """Every metric of ``n`` units at the loaded angles (n, n_angles); missing where an angle has no result."""
    loops = hysteresis.solved_loops(replace(shared, curve=shared.brief), sampled)
    metrics = loop_metrics(shared.study, loops.columns)
    return {name: metrics[name].reshape(len(sampled), -1) for name in library()}

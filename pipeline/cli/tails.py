"""The command of a study's far tails: load-solves what the rigid play picks, with what the stages have condensed."""

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
from pipeline.model.metrics import library
from pipeline.population import tails
from pipeline.sampling import Errors
from stages import hysteresis
from stages.chain import STAGES
from stages.turn import loop_metrics


def find_tails(options: argparse.Namespace) -> None:
    """Write shares beyond the limits and far quantiles of a study."""
    if not 0 < options.solve <= options.units:
        raise InputError(f"--solve = {options.solve}; must be from 1 to --units = {options.units}")
    study = load_study(options.study, settings.ROOT)
    tails.tails_of(study)  # says what is missing before anything is condensed
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["springs", "reduce"], settings.RUNS, resources)
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, outputs, Cache(settings.RUNS / ".cache", "")))
    rows = tails.far_tails(study, options.units, options.solve, partial(over_turn, shared), resources.jobs)
    table = settings.RUNS / "tails" / f"{study.name}.csv"
    write_atomic(table, tails.text(rows).encode())
    print(table.read_text(), end="")
    print(f"table: {settings.shown(table)}")


def over_turn(shared: hysteresis.Shared, sampled: Errors) -> dict[str, np.ndarray]:
    """Every metric of ``n`` units over the loaded angles, as limits mean it; missing where an angle has no result."""
    study = shared.study
    loops, _ = hysteresis.solved_loops(replace(shared, curve=shared.brief), sampled)
    metrics, values_over_turn = loop_metrics(study, loops), {}
    for name, metric in library().items():
        turn = metrics[name].reshape(len(sampled), -1)
        worst, best = metric.over_turn(turn)
        values_over_turn[name] = {"worst": worst, "best": best, "mean": turn.mean(axis=1)}[study.limits.over]
    return values_over_turn

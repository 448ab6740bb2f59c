"""Yields of units that decided nothing: load-solved behind the draws that a study has counted already."""

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.arrays import Real, Truth, joined_columns
from pipeline.config.studies.study import Study
from pipeline.engine.parallel import batches, worker_results
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.sampling.errors import Errors, draw
from pipeline.statistics.intervals import Estimate, pass_share

Angles = Mapping[str, Real]
Solve = Callable[[Errors], tuple[Angles, Angles]]
"""Errors of ``n`` units to each metric at the loaded angles (n, n_angles), and over the turn as limits mean it (n,)."""

PRELOADED = "preloaded"
"""Name, beside the metrics over the turn, of whether the gaps of a unit interfere at some crank angle."""
WITHOUT_RESULT = "without result"
"""Name, as ``PRELOADED``, of whether a unit lacks a metric with a limit: invalid for the model, or no state found."""
BATCH = 500
"""Units that are solved together."""


def refuse_limits_of_turn(study: Study, question: str) -> None:
    """Refuse a study with limits that a decision by metrics of a loop, named ``question``, would leave out.

    Raises
    ------
    InputError
        If a limit is on a metric of the turn, as the transmission error.
    """
    of_turn = [name for name in study.limits.of_metrics if name not in library()]
    if of_turn:
        raise InputError(
            f"study {study.name}: limits.{name}: {question} uses metrics of a loop, {name} is one of the turn; "
            "take it out of a copy of the study"
            for name in of_turn
        )


def fresh_study(study: Study, count: int) -> Study:
    """The study with so many independent draws as its samples."""
    return study.with_section("samples", count=count, experiment="monte_carlo", nominal_first=False)


def fresh_values(study: Study, start: int, units: int, solve: Solve, jobs: int) -> dict[str, Real]:
    """Each metric over the turn (units,) of independent draws of the study's seed, from ``start`` on."""
    stop = start + units
    larger_study = fresh_study(study, stop)
    inputs = ((larger_study, solve, *ends) for ends in batches(start, stop, BATCH))
    return joined_columns(worker_results(jobs, _over_turn, inputs))


def yields(study: Study, values: Mapping[str, Real], missing_fail: bool = False) -> dict[str, Estimate]:
    """Yield by metric and against all limits of units (n,).

    Units without a value fail if ``missing_fail``. Otherwise they are left out, but the lower end of the interval
    counts them as failed; a yield of none is missing.
    """
    shares = {}
    for name, within_limits in study.limits.pass_flags(values).items():
        has_metrics = has_values(study, values, name)
        if missing_fail:
            shares[name] = pass_share(within_limits & has_metrics, study.metrics.confidence)
        elif not has_metrics.any():
            shares[name] = Estimate(np.nan, 0.0, 1.0, 0)
        else:
            n_missing = int(np.count_nonzero(~has_metrics))
            shares[name] = pass_share(within_limits[has_metrics], study.metrics.confidence, n_missing=n_missing)
    return shares


def preloaded_share(values: Mapping[str, Real]) -> float:
    """Share of units (n,) whose parts interfere without load at some crank angle."""
    return float(np.mean(values[PRELOADED]))


def has_values(study: Study, values: Mapping[str, Real], limit: str) -> Truth:
    """Whether units (n,) have every metric of a limit, by the name of its metric or ``ALL_LIMITS``."""
    limited_metrics = study.limits.limited_metrics(limit, values)
    return np.asarray(np.all([np.isfinite(values[metric]) for metric in limited_metrics], axis=0), bool)


def fresh_yields(study: Study, start: int, units: int, solve: Solve, jobs: int) -> dict[str, Estimate]:
    """Yields by metric and against all limits of ``units`` independent draws of the study's seed, from ``start`` on."""
    return yields(study, fresh_values(study, start, units, solve, jobs))


def _over_turn(study: Study, solve: Solve, start: int, stop: int) -> Angles:
    return solve(draw(study, start, stop))[1]

"""Yields of parts per million and the 99.73 % quantile of a study: a rough model decides which units are load-solved.

Rigid play and a loop on independent springs (``load_history.winkler``) are cheap for every unit; its metrics under load
are not. A pilot of other units tells how these follow from the rough ones at each crank angle, and how far they stray;
by that the units are taken (``statistics.two_phase``). A metric that the rough ones do not tell gets units taken nearly
alike, and its interval is then as wide as that of plain sampling: ``effective`` says so.
"""

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, replace

import numpy as np

from pipeline.arrays import Index, Real, joined_columns
from pipeline.config.designs.design import Design
from pipeline.config.studies.optional import limited_under_load, without_tails
from pipeline.config.studies.study import Samples, Study
from pipeline.config.studies.tolerances import Case, Tolerances
from pipeline.engine.parallel import batches, worker_results
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.populations.prediction import LEVEL, Tail, TailPrediction
from pipeline.sampling.errors import Errors, draw, joined_errors
from pipeline.statistics.resampling import FEWEST_BEYOND
from pipeline.statistics.two_phase import count_slope, inclusion_probability, tail_quantile, tail_share

Solve = Callable[[Errors], Mapping[str, Real]]
"""Errors of ``n`` units to each metric at the loaded crank angles (n, n_angles), missing where it has no result."""

PILOT = 500
"""Units that are solved beforehand and count in no estimate: slopes to a few percent, the scatter to 3 %."""
BATCH = 500
"""Units that are drawn and solved together."""
SELECTION = 2**31
"""Key of the random numbers by which units are taken, beside those of their errors."""


@dataclass(frozen=True)
class TailRow:
    """One row of the table: a statistic of ``units`` units of which ``solved`` have been load-solved.

    ``effective`` units, all solved, would know it as well. A share is that of the units beyond the limit.
    """

    metric: str
    statistic: str
    value: float
    ci_low: float
    ci_high: float
    units: int
    solved: int
    effective: float


def tails_of(study: Study) -> tuple[Tail, ...]:
    """The metrics that have a limit, but for those that rigid bodies tell: their units need no load.

    Raises
    ------
    InputError
        If there is none, or the samples are listed cases.
    """
    if reason := without_tails(study.samples, study.limits):
        raise InputError(f"study {study.name}: {reason}")
    tails = []
    for name, limit in limited_under_load(study.limits).items():
        sign = -1.0 if library()[name].smaller_is_worse else 1.0
        tails.append(Tail(name, study.limits.over, sign, sign * limit))
    return tuple(tails)


@dataclass(frozen=True)
class Population:
    """What is drawn of a study: so many independent units, and the pilot's behind them."""

    samples: Samples
    tolerances: Tolerances
    design: Design
    cases: tuple[Case, ...] = ()


def population(study: Study, units: int) -> Population:
    """The study with so many independent units, and the pilot's behind them."""
    samples = Samples(count=units + PILOT, seed=study.samples.seed, experiment="monte_carlo", nominal_first=False)
    return Population(samples, study.tolerances, study.design)


def far_tails(study: Study, units: int, budget: int, rough: Solve, solve: Solve, jobs: int = 1) -> list[TailRow]:
    """Share beyond the limit and far quantile of every metric under load that has a limit.

    Parameters
    ----------
    units : whose rough metrics are looked at.
    budget : units that are load-solved on average, besides the pilot.
    rough, solve : cheap metrics of units, in which those under load are nearly linear, and these.
    """
    tails, large_population = tails_of(study), population(study, units)
    inputs = ((large_population, rough, *ends) for ends in batches(0, units, BATCH))
    rough_units = joined_columns(worker_results(jobs, _rough_metrics, inputs))
    pilot = draw(large_population, units, units + PILOT)
    loaded_pilot, rough_pilot = solve(pilot), rough(pilot)
    predictions = [
        TailPrediction.from_pilot(tail, loaded_pilot[tail.metric], rough_pilot, rough_units) for tail in tails
    ]
    probability = inclusion_probability(np.sum([metric.demand for metric in predictions], axis=0), budget)
    rng = np.random.default_rng(np.random.SeedSequence(study.samples.seed, spawn_key=(SELECTION,)))
    selected_units = np.flatnonzero(rng.random(units) < probability)
    ranges = batches(0, selected_units.size, BATCH)
    selected_inputs = ((large_population, solve, selected_units[first:stop]) for first, stop in ranges)
    values = joined_columns(worker_results(jobs, _solve_units, selected_inputs))
    rows = []
    for tail, prediction in zip(tails, predictions, strict=True):
        bad, expected_counts = tail.over_turn(values[tail.metric]), prediction.effective_counts(probability)
        slope = count_slope(prediction.chance_beyond, probability)
        rows += _rows(tail, bad, probability[selected_units], units, study.metrics.confidence, expected_counts, slope)
    return rows


def _rough_metrics(population: Population, rough: Solve, start: int, stop: int) -> Mapping[str, Real]:
    return rough(draw(population, start, stop))


def _solve_units(population: Population, solve: Solve, selected_units: Index) -> Mapping[str, Real]:
    """Metrics of the taken units; each is drawn by its own number."""
    return solve(joined_errors(*(draw(population, int(unit), int(unit) + 1) for unit in selected_units)))


def _rows(
    tail: Tail, bad: Real, probability: Real, units: int, confidence: float, expected_counts: list[float], slope: float
) -> list[TailRow]:
    """Share and quantile of one metric; units without equilibrium, and those that they stand for, are left out.

    An estimate that may expect too few units beyond has no interval: its spread does not show what was missed.
    """
    finite = np.isfinite(bad)
    units -= round(float(np.sum(1 / probability[~finite])))
    share = tail_share(bad[finite] > tail.limit, probability[finite], units, confidence, slope)
    quantile = tail_quantile(bad[finite], probability[finite], units, LEVEL, confidence)
    if expected_counts[0] < FEWEST_BEYOND:
        share = replace(share, ci_low=0.0, ci_high=1.0)
    if expected_counts[1] < FEWEST_BEYOND:
        quantile = replace(quantile, ci_low=-np.inf, ci_high=np.inf)
    low, high = sorted((tail.sign * quantile.ci_low, tail.sign * quantile.ci_high))
    quantile = replace(quantile, value=tail.sign * quantile.value, ci_low=low, ci_high=high)
    name = f"p{100 * LEVEL:.2f}" if tail.sign > 0 else f"p{100 * (1 - LEVEL):.2f}"
    return [TailRow(tail.metric, kind, *astuple(estimate)) for kind, estimate in (("beyond", share), (name, quantile))]

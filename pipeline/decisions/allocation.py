"""The loosest tolerances of a study that keep all its limits at a wanted yield for the least cost.

Rounds of load-solved units lead to the cheapest scales within a trust region about the best ones
(``allocation_search``). Units that no round has seen then judge the result, which is written as tables and as a study
file that runs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arrays import Real
from pipeline.config.changing import study_file
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.allocation_search import TRUST, Rough, Search, Tell, Trial
from pipeline.decisions.cheapest import LinearUnits, Priced, cheapest, priced_tolerances, with_scaled_tolerances
from pipeline.decisions.fresh_units import PRELOADED, WITHOUT_RESULT, Solve
from pipeline.engine.store import write_tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.statistics.differences import share_difference
from pipeline.statistics.intervals import Estimate

REAIMS = 2
"""How often the aim is raised where fresh units miss the target."""
DIGITS = 3
"""Of a scale, rounded down."""
YIELDS = (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998)
"""Of the trade-off."""


@dataclass(frozen=True)
class Choice:
    """Scales of the priced tolerances, what they cost, and what fresh units say of them by limit and of all.

    The ``check`` holds the yields, in which units without a result fail; under `PRELOADED` the share of the units that
    is preloaded at some crank angle, under `WITHOUT_RESULT` the share that has no result.
    """

    scale: Real
    cost: float
    check: Mapping[str, Estimate]

    @property
    def yield_estimate(self) -> Estimate:
        """Yield against all limits."""
        return self.check[ALL_LIMITS]

    def has_more_preload(self, other: "Choice", confidence: float) -> bool:
        """Whether more units are preloaded than with another choice, beyond what the units of the checks leave open."""
        shares = (choice.check[PRELOADED] for choice in (other, self))
        before, now = (np.arange(share.n) < round(share.n * share.value) for share in shares)
        return share_difference(before, now, confidence, are_paired=False)[0] > 0


@dataclass(frozen=True)
class Allocation:
    """What was found.

    Attributes
    ----------
    study : with the new tolerances.
    stated_choice, equal, cheapest : the study's tolerances, all scaled alike to the yield, and those of least cost
        or, where the yield is not reached, those that come nearest to it; None where scaling alike does not reach it.
    hardest_limit : the limit that most units break there.
    tradeoff : (n, 2) yields and least costs by the linear model there; missing beyond its reach.
    unmoved_reasons : tolerances that were not moved, and why.
    units : in each round and in each check.
    solved_units : units that were load-solved in all.
    """

    study: Study
    target: float
    priced_dimensions: tuple[Priced, ...]
    stated_choice: Choice
    equal: Choice | None
    cheapest: Choice
    hardest_limit: str
    tradeoff: Real
    unmoved_reasons: Mapping[str, str]
    units: int
    solved_units: int

    @property
    def reaches_target(self) -> bool:
        """Whether the yield of the cheapest tolerances reaches the target within the accuracy of its check."""
        return self.cheapest.yield_estimate.ci_high >= self.target


def allocate(
    study: Study, target: float, units: int, solve: Solve, rough: Rough, jobs: int = 1, tell: Tell = lambda line: None
) -> Allocation:
    """The cheapest tolerances of a study at the yield ``target`` against all its limits, or those that come nearest.

    Parameters
    ----------
    units : load-solved in each round and in each check.
    solve, rough : metrics of units under load, and of a cheap model in which they are nearly linear.
    tell : is told what rounds and checks gave.

    Raises
    ------
    InputError
        If nothing can be moved.

    Notes
    -----
    The aim is the target plus one standard error, and plus the miss where a round reached the target but fresh units do
    not. No two rounds or checks share a unit, and the reported checks decide nothing.
    """
    priced_dimensions, unmoved_reasons = priced_tolerances(study)
    groups = tuple((k,) for k in range(len(priced_dimensions)))
    one_group = (tuple(range(len(priced_dimensions))),)
    sets = count()
    new_search = partial(Search, study, priced_dimensions, units=units, solve=solve, rough=rough, jobs=jobs, tell=tell)
    search, equal_search = (new_search(groups=g, sets=sets) for g in (groups, one_group))
    best_trial = _confirmed_trial(search, target)
    equal = _confirmed_trial(equal_search, target)
    low, high = search.bounds
    for k, tolerance in enumerate(priced_dimensions):
        if np.isclose(best_trial.scale[k], low[k], rtol=2e-3) or np.isclose(best_trial.scale[k], high[k], rtol=2e-3):
            unmoved_reasons[tolerance.name] = f"lies at the bound of its scale, {best_trial.scale[k]:.3g}"
    return Allocation(
        study=with_scaled_tolerances(study, search.names, best_trial.scale),
        target=target,
        priced_dimensions=priced_dimensions,
        stated_choice=_choice(search, np.ones(len(priced_dimensions))),
        equal=_choice(search, equal_search.spread(equal.scale)) if equal.yield_estimate.value >= target else None,
        cheapest=_choice(search, best_trial.scale),
        hardest_limit=search.hardest_limit(best_trial.units),
        tradeoff=_tradeoff(search, best_trial.units),
        unmoved_reasons=unmoved_reasons,
        units=units,
        solved_units=next(sets) * units,
    )


def _choice(search: Search, scale: Real) -> Choice:
    return Choice(scale, search.cost(scale), search.check(scale))


def _confirmed_trial(search: Search, target: float) -> Trial:
    """The best trial, its yield by units that took no part in the search."""
    low, high = search.bounds
    aim = target + np.sqrt(target * (1 - target) / search.units)
    trial = search.trial(np.clip(np.ones(len(search.groups)), low, high))
    trials: list[Trial] = []
    for _ in range(REAIMS + 1):
        trial = search.improve(trial, min(aim, 1 - 1 / search.units), target)
        reached_target = trial.yield_estimate.value >= target
        scale = np.maximum(np.floor(trial.scale * 10**DIGITS) / 10**DIGITS, low)
        yield_estimate = search.check(search.spread(scale))[ALL_LIMITS]
        trial = replace(trial, scale=scale, cost=search.cost(search.spread(scale)), yield_estimate=yield_estimate)
        trials.append(trial)
        is_worse = len(trials) > 1 and not trial.is_better(trials[-2], target)
        if yield_estimate.value >= target or not reached_target or is_worse:
            break
        aim += target - yield_estimate.value
    best_trial = trials[0]
    for trial in trials[1:]:
        best_trial = trial if trial.is_better(best_trial, target) else best_trial
    return best_trial


def _tradeoff(search: Search, units: LinearUnits) -> Real:
    low, high = search.bounds
    low, high = np.maximum(low, units.scale / TRUST), np.minimum(high, units.scale * TRUST)
    rows = []
    for share in YIELDS:
        cheapest_scales = cheapest(units, search.costs(), share, low, high)
        is_interior = cheapest_scales.meets_yield and units.pass_share(cheapest_scales.scale) < share + 0.5 * (
            1 - share
        )
        rows.append((share, search.cost(cheapest_scales.scale) if is_interior else np.nan))
    return np.array(rows)


ALLOCATION = Table(
    "allocation",
    "tolerance that has a cost",
    (
        Column("dimension", "label", "", "tolerance"),
        Column("lower_um", "float64", "um", "new lower limit"),
        Column("upper_um", "float64", "um", "new upper limit"),
        Column("was", "float64", "um", "width of the zone before"),
        Column("width_um", "float64", "um", "new width of the zone"),
        Column("was_cost", "float64", "as stated", "cost before, all elements"),
        Column("cost", "float64", "as stated", "new cost, all elements"),
        Column("price_per_um", "float64", "as stated", "what one um of the zone more would save"),
    ),
)
CHECK = Table(
    "check",
    "tolerances, limit",
    (
        Column("tolerances", "label", "", "before; equal: all scaled alike to the yield; found: the cheapest"),
        Column("metric", "label", "", "column of metrics; all_limits: all together"),
        Column("yield", "float64", "1", "share of fresh units within the limit; without a result they are beyond it"),
        *interval_columns("1"),
        Column("preloaded", "float64", "1", "share of all fresh units whose gaps interfere at some crank angle"),
        Column("without_result", "float64", "1", "share of them for which the model is not valid or found no state"),
        Column("n", "int32", "1", "units"),
        Column("cost", "float64", "as stated", "of all priced tolerances"),
    ),
)
TRADEOFF = Table(
    "tradeoff",
    "yield",
    (
        Column("yield", "float64", "1", "asked of the last linear model; not checked"),
        Column("cost", "float64", "as stated", "least cost; null beyond the reach of the model"),
    ),
)


def allocation_rows(allocation: Allocation) -> Columns:
    """Rows of `ALLOCATION`."""
    tolerances, scales = allocation.priced_dimensions, allocation.cheapest.scale
    limits = np.array([getattr(allocation.study.tolerances, tolerance.name).limits_um for tolerance in tolerances])
    scaled_tolerances = list(zip(tolerances, scales, strict=True))
    return {
        "dimension": np.array([tolerance.name for tolerance in tolerances], object),
        "lower_um": limits[:, 0],
        "upper_um": limits[:, 1],
        "was": np.array([tolerance.width_um for tolerance in tolerances]),
        "width_um": limits[:, 1] - limits[:, 0],
        "was_cost": np.array([float(tolerance.cost_at(np.array(1.0))) for tolerance in tolerances]),
        "cost": np.array([float(tolerance.cost_at(scale)) for tolerance, scale in scaled_tolerances]),
        "price_per_um": np.array([tolerance.price_per_um(scale) for tolerance, scale in scaled_tolerances], float),
    }


def check_rows(allocation: Allocation) -> Columns:
    """Rows of `CHECK`."""
    choices = {"before": allocation.stated_choice, "equal": allocation.equal, "found": allocation.cheapest}
    rows = []
    for label, choice in choices.items():
        if choice is None:
            continue
        shares = dict(choice.check)
        beside = [shares.pop(name).value for name in (PRELOADED, WITHOUT_RESULT)]
        for metric, share in shares.items():
            rows.append((label, metric, share.value, share.ci_low, share.ci_high, *beside, share.n, choice.cost))
    return CHECK.columns_of_rows(rows)


def study_name(study: Study) -> str:
    """Of the study with the new tolerances."""
    return f"allocated-{study.name}"


def study_text(allocation: Allocation, design: str) -> str:
    """The study with the new tolerances as a TOML file; ``design`` names its design."""
    study = allocation.study
    goal = f"at {100 * allocation.target:g} %"
    found = "cheapest tolerances" if allocation.reaches_target else "best tolerances found, below the target,"
    tolerances = study.tolerances.model_dump(exclude_defaults=True)
    changes = {
        "title": f"{study.title or study.name}: {found} {goal}",
        "tolerances": {name: _rounded_lengths(section) for name, section in tolerances.items()},
    }
    passing = allocation.cheapest.yield_estimate
    comment = (
        f"# {found[0].upper()}{found[1:]} {goal} yield, of {study.name}.\n"
        f"# {passing.n} fresh units: {passing.value:.4f} ({passing.ci_low:.4f} to {passing.ci_high:.4f}).\n"
    )
    return comment + study_file(study, study_name(study), design, changes)


def _rounded_lengths(section: dict[str, Any]) -> dict[str, Any]:
    """Lengths without the last bits of a product."""
    return {key: float(f"{value:.9g}") if isinstance(value, float) else value for key, value in section.items()}


def write(allocation: Allocation, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the three tables as CSV and Parquet into ``folder``; their frames by name."""
    tradeoff = {"yield": allocation.tradeoff[:, 0], "cost": allocation.tradeoff[:, 1]}
    tables = {ALLOCATION: allocation_rows(allocation), CHECK: check_rows(allocation), TRADEOFF: tradeoff}
    return write_tables(tables, folder, as_csv=True)

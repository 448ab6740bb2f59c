"""The loosest tolerances of a study that keep all its limits at a wanted yield for the least cost.

The cheapest scales of a linear model of load-solved units are the next round's, until they settle (``search``). Units
that no round has seen then judge the result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.allocation.cheapest import LinearUnits, cheapest
from pipeline.decisions.allocation.priced import Priced, priced_tolerances, scaled
from pipeline.decisions.allocation.search import TRUST, Rough, Search, Tell
from pipeline.decisions.fresh_units import Solve
from pipeline.errors import InputError
from pipeline.statistics import Estimate

Real = NDArray[np.float64]

REAIMS = 2
"""How often the aim is raised where fresh units miss the target."""
DIGITS = 3
"""Of a scale, rounded down."""
YIELDS = (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998)
"""Of the trade-off."""


@dataclass(frozen=True)
class Choice:
    """Scales of the priced tolerances, what they cost, and what fresh units say of them by limit and of all."""

    scale: Real
    cost: float
    check: Mapping[str, Estimate]

    @property
    def passed(self) -> Estimate:
        """Yield against all limits."""
        return self.check[ALL_LIMITS]


@dataclass(frozen=True)
class Allocation:
    """What was found.

    Attributes
    ----------
    study : with the new tolerances.
    stated, equal, cheapest : the study's tolerances, all scaled alike to the yield, and those of least cost; None where
        scaling alike does not reach it.
    tradeoff : (n, 2) yields and least costs by the last linear model; missing beyond its reach.
    unmoved : tolerances that were not moved, and why.
    solved : units that were load-solved.
    """

    study: Study
    target: float
    priced: tuple[Priced, ...]
    stated: Choice
    equal: Choice | None
    cheapest: Choice
    tradeoff: Real
    unmoved: Mapping[str, str]
    solved: int


def allocate(
    study: Study, target: float, units: int, solve: Solve, rough: Rough, jobs: int = 1, tell: Tell = lambda line: None
) -> Allocation:
    """The cheapest tolerances of a study at the yield ``target`` against all its limits.

    Parameters
    ----------
    units : load-solved in each round and in each check.
    solve, rough : metrics of units under load, and of a cheap model in which they are nearly linear.
    tell : is told what rounds and checks gave.

    Raises
    ------
    InputError
        If nothing can be moved, or the yield is out of reach: then with how near one gets.

    Notes
    -----
    One standard error more than the target is aimed at; where fresh units still miss it, the miss is added to the aim
    and all is done again on other units. The last check is by units that decided nothing.
    """
    priced, unmoved = priced_tolerances(study)
    single = tuple((k,) for k in range(len(priced)))
    search = Search(study, priced, single, units, solve, rough, jobs, tell)
    scale, model, counted = _aimed(search, target)
    equal_scaling = Search(study, priced, (tuple(range(len(priced))),), units, solve, rough, jobs, tell)
    sets = 2 * (REAIMS + 1)
    try:
        equal_scale = equal_scaling.spread(_aimed(equal_scaling, target)[0])
        equal = Choice(equal_scale, equal_scaling.cost(equal_scale), search.check(equal_scale, sets * units))
    except InputError:
        equal = None
    low, high = search.bounds
    for k, tolerance in enumerate(priced):
        if np.isclose(scale[k], low[k], rtol=2e-3) or np.isclose(scale[k], high[k], rtol=2e-3):
            unmoved[tolerance.name] = f"stands at the bound of its scale, {scale[k]:.3g}"
    unscaled = np.ones(len(priced))
    return Allocation(
        study=scaled(study, search.names, scale),
        target=target,
        priced=priced,
        stated=Choice(unscaled, search.cost(unscaled), search.check(unscaled, sets * units)),
        equal=equal,
        cheapest=Choice(scale, search.cost(scale), search.check(scale, sets * units)),
        tradeoff=_tradeoff(search, model),
        unmoved=unmoved,
        solved=counted,
    )


def _aimed(search: Search, target: float) -> tuple[Real, LinearUnits, int]:
    """Scales (n_groups,) whose yield fresh units confirm, the last linear model, and units that were solved."""
    n, n_solved, start = search.units, 0, 0
    low, high = search.bounds
    scale = np.clip(np.ones(len(search.groups)), low, high)
    aim = target + np.sqrt(target * (1 - target) / n)
    for _ in range(REAIMS + 1):
        scale, units, rounds = search.settled(scale, min(aim, 1 - 1 / n), start)
        scale = np.maximum(np.floor(scale * 10**DIGITS) / 10**DIGITS, low)
        pass_share = search.check(search.spread(scale), start + n)[ALL_LIMITS].value
        n_solved, start = n_solved + (rounds + 1) * n, start + 2 * n
        if pass_share >= target:
            break
        aim += target - pass_share
    return scale, units, n_solved


def _tradeoff(search: Search, units: LinearUnits) -> Real:
    low, high = search.bounds
    low, high = np.maximum(low, units.scale / TRUST), np.minimum(high, units.scale * TRUST)
    rows = []
    for share in YIELDS:
        best = cheapest(units, search.costs(), share, low, high)
        is_interior = best.meets_yield and units.passed(best.scale) < share + 0.5 * (1 - share)
        rows.append((share, search.cost(best.scale) if is_interior else np.nan))
    return np.array(rows)

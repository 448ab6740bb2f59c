"""Rounds of an allocation: units are load-solved at the scales of a round; how they follow is told by a rough model.

The same draws are rescaled: unit k keeps its random numbers at any tolerance. Each metric under load is taken to be
linear in the rough model's (``population.prediction``), fitted to the round's own solves at each crank angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.allocation.cheapest import LinearUnits, cheapest
from pipeline.decisions.allocation.priced import Priced, scaled
from pipeline.decisions.fresh_units import BATCH, Angles, Solve, fresh_yields
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.population.prediction import Tail, predicted_turn
from pipeline.sampling import Errors, draw
from pipeline.statistics import Estimate

Real = NDArray[np.float64]
Rough = Callable[[Errors], Angles]
Tell = Callable[[str], None]
"""Is told in a line what a round or a check gave."""

TRUST = 1.8
"""Factor by which a scale may change in one round."""
STEP = 0.15
"""Share by which a scale is changed to see how units follow."""
ROUNDS = 6
"""Linear models at most; four settled in the paper's study."""
SETTLED = 0.03
"""Change of the scales between two rounds, in the logarithm, below which they have settled."""


@dataclass(frozen=True)
class Search:
    """Looks for the cheapest scales of groups of tolerances that are scaled alike.

    Attributes
    ----------
    groups : positions among the priced tolerances.
    units : that are load-solved in each round, and in each check.
    """

    study: Study
    priced: tuple[Priced, ...]
    groups: tuple[tuple[int, ...], ...]
    units: int
    solve: Solve
    rough: Rough
    jobs: int
    tell: Tell

    @property
    def names(self) -> list[str]:
        """Of the priced tolerances."""
        return [tolerance.name for tolerance in self.priced]

    @property
    def bounds(self) -> tuple[Real, Real]:
        """Of the scales of the groups."""
        low = [max(self.priced[k].bounds[0] for k in group) for group in self.groups]
        high = [min(self.priced[k].bounds[1] for k in group) for group in self.groups]
        return np.array(low), np.array(high)

    def spread(self, scale: Real) -> Real:
        """Scales of the groups (n_groups,) as scales of the tolerances (n_priced,)."""
        spread = np.ones(len(self.priced))
        for group, factor in zip(self.groups, scale, strict=True):
            spread[list(group)] = factor
        return spread

    def cost(self, scale: Real) -> float:
        """Of the whole reducer, at scales (n_priced,)."""
        return float(sum(tolerance.at(factor) for tolerance, factor in zip(self.priced, scale, strict=True)))

    def costs(self) -> list[Callable[[Real], Real]]:
        """Of each group by its scale."""
        return [partial(_group_cost, [self.priced[k] for k in group]) for group in self.groups]

    def drawn(self, scale: Real, start: int, stop: int) -> Errors:
        """Errors of units at scales (n_priced,); those behind the study's own are fresh."""
        first_unit = self.study.samples.count
        samples = {"count": first_unit + stop, "experiment": "monte_carlo", "nominal_first": False}
        larger_study = self.study.model_copy(update={"samples": self.study.samples.model_copy(update=samples)})
        return draw(scaled(larger_study, self.names, scale), first_unit + start, first_unit + stop)

    def batches(self, start: int) -> list[tuple[int, int]]:
        """Units of the set that begins at ``start``, some at a time."""
        stop = start + self.units
        return [(k, min(k + BATCH, stop)) for k in range(start, stop, BATCH)]

    def check(self, scale: Real, start: int) -> dict[str, Estimate]:
        """Yields at scales (n_priced,) by the units from ``start`` on."""
        at_scale = scaled(self.study, self.names, scale)
        yields = fresh_yields(at_scale, self.study.samples.count + start, self.units, self.solve, self.jobs)
        self.tell(f"{100 * yields[ALL_LIMITS].value:.1f} % of {self.units} fresh units at cost {self.cost(scale):.3g}")
        return yields

    def linear(self, scale: Real, start: int) -> LinearUnits:
        """The units from ``start`` on about scales (n_groups,): load-solved there, their slopes by the rough model."""
        parts = Parallel(self.jobs)(delayed(_followed)(self, scale, *ends) for ends in self.batches(start))
        angles, turns, chosen, *moved_parts = (_joined([part[k] for part in parts]) for k in range(len(parts[0])))
        values, slopes = [], []
        for tail in tails(self.study):
            value = tail.sign * turns[tail.metric]
            spread = float(np.nanstd(value)) or 1.0
            changes = []
            for k, present in enumerate(moved_parts):
                of_here, of_there = predicted_turn(angles[tail.metric], chosen, present)
                changes.append((tail.over_turn(of_there) - tail.over_turn(of_here)) / (STEP * scale[k]) / spread)
            values.append((value - tail.limit) / spread)
            slopes.append(np.stack(changes, axis=-1))
        value, slope = np.stack(values, axis=1), np.stack(slopes, axis=1)
        is_finite = np.isfinite(value).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
        return LinearUnits(scale, value[is_finite], slope[is_finite])

    def settled(self, scale: Real, aim: float, start: int) -> tuple[Real, LinearUnits, int]:
        """Cheapest scales (n_groups,) by rounds on one set of units, the last linear model, and rounds.

        Raises
        ------
        InputError
            If the tightest tolerances do not reach the yield either.
        """
        low, high = self.bounds
        for rounds in range(1, ROUNDS + 1):  # noqa: B007  the number of the last is returned
            units = self.linear(scale, start)
            floor, ceiling = np.maximum(low, scale / TRUST), np.minimum(high, scale * TRUST)
            best = cheapest(units, self.costs(), aim, floor, ceiling)
            change = float(np.max(np.abs(np.log(best.scale / scale))))
            cost = self.cost(self.spread(best.scale))
            yielded = 100 * units.passed(units.scale)
            self.tell(f"round {rounds}: {yielded:.1f} % of {len(units.value)} units, by them to cost {cost:.3g}")
            scale = best.scale
            if change < SETTLED:
                break
        if not best.meets_yield:
            raise InputError(self._impossible(units, scale, aim))
        return scale, units, rounds

    def _impossible(self, units: LinearUnits, scale: Real, aim: float) -> str:
        worst = tails(self.study)[int(np.argmax(np.mean(units.value > 0, axis=0)))].metric
        return (
            f"study {self.study.name}: a yield of {100 * aim:.4g} % (the target and a standard error) "
            f"is not reached: with every priced tolerance at "
            f"{np.min(scale):.2g} to {np.max(scale):.2g} of its zone {100 * units.passed(units.scale):.4g} % of "
            f"{len(units.value)} units keep all limits; most of the others break {worst} = "
            f"{self.study.limits.of_metrics[worst]:g}; loosen it, change an allowance, or price further tolerances"
        )


def tails(study: Study) -> list[Tail]:
    """The limits of a study, the larger value the worse."""
    signs = {name: -1.0 if library()[name].smaller_is_worse else 1.0 for name in library()}
    limits = study.limits.of_metrics.items()
    return [Tail(name, study.limits.over, signs[name], signs[name] * limit) for name, limit in limits]


def _group_cost(group: Sequence[Priced], scale: Real) -> Real:
    return np.sum([entry.at(scale) for entry in group], axis=0)


def _followed(search: Search, scale: Real, start: int, stop: int) -> list[Angles]:
    """Of units their metrics at the loaded angles and over the turn, and those of the rough model, here and moved."""
    angles, turns = search.solve(search.drawn(search.spread(scale), start, stop))
    results = [angles, turns, search.rough(search.drawn(search.spread(scale), start, stop))]
    for k in range(len(scale)):
        trial_scale = scale * np.where(np.arange(len(scale)) == k, 1 + STEP, 1.0)
        results.append(search.rough(search.drawn(search.spread(trial_scale), start, stop)))
    return results


def _joined(parts: Sequence[Angles]) -> dict[str, Real]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

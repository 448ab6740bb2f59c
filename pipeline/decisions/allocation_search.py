"""Rounds of an allocation: fresh units are load-solved at the scales of a round; a rough model gives their slopes.

Slopes are of the same draws rescaled: unit k keeps its random numbers at any tolerance. Each metric under load is taken
to be linear in the rough model's (``population.prediction``), fitted to the round's own solves at each crank angle.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.arrays import Real, joined_columns
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.cheapest import LinearUnits, Priced, cheapest, with_scaled_tolerances
from pipeline.decisions.fresh_units import (
    BATCH,
    PRELOADED,
    WITHOUT_RESULT,
    Angles,
    Solve,
    fresh_study,
    fresh_values,
    has_values,
    yields,
)
from pipeline.engine.parallel import batches, worker_results
from pipeline.model.metrics import library
from pipeline.populations.prediction import Tail, predicted_turn
from pipeline.sampling.errors import Errors, draw
from pipeline.statistics.intervals import Estimate, pass_share

Rough = Callable[[Errors], Angles]
Tell = Callable[[str], None]
"""Is told in a line what a round or a check gave."""

TRUST = 1.8
"""Largest factor by which a scale changes in one round."""
SHRINKAGE = 0.5
"""Of the trust region, in the logarithm of a scale, after a round that brought nothing better."""
GROWTH = 1.5
"""Of the trust region after a round that brought something better."""
STEP = 0.15
"""Share by which a scale is changed for the slopes of the rough model."""
ROUNDS = 10
"""Trials at most in one search."""
SETTLED_STEP = 0.02
"""Change of the scales, in the logarithm, below which a round would solve the same point again."""


@dataclass(frozen=True)
class Trial:
    """Scales that were load-solved.

    Attributes
    ----------
    scale : (n_groups,) scales of the groups.
    cost : of the whole reducer.
    yield_estimate : yield against all limits, by units that took no part in choosing the scales.
    units : the linear model about the scales.
    """

    scale: Real
    cost: float
    yield_estimate: Estimate
    units: LinearUnits

    def is_better(self, other_trial: "Trial", target: float) -> bool:
        """Whether it is cheaper where both reach the target; else whether it reaches it, or comes nearer."""
        reaches_target = self.yield_estimate.value >= target
        other_reaches_target = other_trial.yield_estimate.value >= target
        if reaches_target and other_reaches_target:
            return self.cost < other_trial.cost
        return reaches_target or (
            not other_reaches_target and self.yield_estimate.value >= other_trial.yield_estimate.value
        )  # 0 % at both: go on


@dataclass(frozen=True)
class Search:
    """Looks for the cheapest scales of groups of tolerances that are scaled alike.

    Attributes
    ----------
    groups : positions among the priced tolerances.
    units : that are load-solved in each round, and in each check.
    sets : numbers of sets of units; each round and each check takes the next one, so that no two share a unit.
    """

    study: Study
    priced_dimensions: tuple[Priced, ...]
    groups: tuple[tuple[int, ...], ...]
    units: int
    solve: Solve
    rough: Rough
    jobs: int
    tell: Tell
    sets: Iterator[int]

    @property
    def names(self) -> list[str]:
        """Of the priced tolerances."""
        return [tolerance.name for tolerance in self.priced_dimensions]

    @property
    def bounds(self) -> tuple[Real, Real]:
        """Of the scales of the groups."""
        low = [max(self.priced_dimensions[k].bounds[0] for k in group) for group in self.groups]
        high = [min(self.priced_dimensions[k].bounds[1] for k in group) for group in self.groups]
        return np.array(low), np.array(high)

    def spread(self, scale: Real) -> Real:
        """Scales of the groups (n_groups,) as scales of the tolerances (n_priced,)."""
        spread = np.ones(len(self.priced_dimensions))
        for group, factor in zip(self.groups, scale, strict=True):
            spread[list(group)] = factor
        return spread

    def cost(self, scale: Real) -> float:
        """Of the whole reducer, at scales (n_priced,)."""
        return float(
            sum(tolerance.cost_at(factor) for tolerance, factor in zip(self.priced_dimensions, scale, strict=True))
        )

    def costs(self) -> list[Callable[[Real], Real]]:
        """Of each group by its scale."""
        return [partial(_group_cost, [self.priced_dimensions[k] for k in group]) for group in self.groups]

    def draw_units(self, scale: Real, start: int, stop: int) -> Errors:
        """Errors of units at scales (n_priced,); those behind the study's own are fresh."""
        first_unit = self.study.samples.count
        larger_study = fresh_study(self.study, first_unit + stop)
        return draw(with_scaled_tolerances(larger_study, self.names, scale), first_unit + start, first_unit + stop)

    def check(self, scale: Real) -> dict[str, Estimate]:
        """Yields of a fresh set of units at scales (n_priced,), and the shares preloaded and without result.

        A unit without a result counts as one that fails: else tolerances so loose that the model is not valid would
        seem good.
        """
        at_scale = with_scaled_tolerances(self.study, self.names, scale)
        start = self.study.samples.count + next(self.sets) * self.units
        values = fresh_values(at_scale, start, self.units, self.solve, self.jobs)
        shares = yields(self.study, values, missing_fail=True)
        self.tell(f"check: {yield_text(shares[ALL_LIMITS])} at cost {self.cost(scale):.3g}")
        flags = {PRELOADED: values[PRELOADED] != 0, WITHOUT_RESULT: ~has_values(self.study, values, ALL_LIMITS)}
        return shares | {name: pass_share(flag, self.study.metrics.confidence) for name, flag in flags.items()}

    def trial(self, scale: Real) -> Trial:
        """A fresh set of units, load-solved at scales (n_groups,), and the linear model about them."""
        units = self.linear(scale, next(self.sets) * self.units)
        yield_estimate = pass_share(units.value.max(axis=1) <= 0, self.study.metrics.confidence)
        return Trial(scale, self.cost(self.spread(scale)), yield_estimate, units)

    def linear(self, scale: Real, start: int) -> LinearUnits:
        """The units from ``start`` on about scales (n_groups,): load-solved there, their slopes by the rough model."""
        inputs = ((self, scale, *ends) for ends in batches(start, start + self.units, BATCH))
        parts = worker_results(self.jobs, _solve_units, inputs)
        angles, turns, chosen_angles, *moved_parts = map(joined_columns, zip(*parts, strict=True))
        values, slopes = [], []
        for tail in tails(self.study):
            value = tail.sign * turns[tail.metric]
            spread = float(np.nanstd(value)) or 1.0
            changes = []
            for k, present in enumerate(moved_parts):
                of_here, of_there = predicted_turn(angles[tail.metric], chosen_angles, present)
                changes.append((tail.over_turn(of_there) - tail.over_turn(of_here)) / (STEP * scale[k]) / spread)
            values.append((value - tail.limit) / spread)
            slopes.append(np.stack(changes, axis=-1))
        value, slope = np.stack(values, axis=1), np.stack(slopes, axis=1)
        typical = np.nan_to_num(np.nanmedian(slope, axis=0))  # of units for which the rough model has no value
        slope = np.where(np.isfinite(slope), slope, typical)
        return LinearUnits(scale, with_failures(value), slope)

    def improve(self, best_trial: Trial, aim: float, target: float) -> Trial:
        """The best trial of a search from ``best``.

        Each round solves the cheapest scales of the best trial's linear model at the yield ``aim``, within a trust
        region about that trial. Where this brings nothing better the region shrinks and the trial is kept.
        """
        low, high = self.bounds
        radius = np.log(TRUST)
        for number in range(1, ROUNDS + 1):
            step = np.exp(radius)
            floor, ceiling = np.maximum(low, best_trial.scale / step), np.minimum(high, best_trial.scale * step)
            scale = cheapest(best_trial.units, self.costs(), aim, floor, ceiling).scale
            if np.max(np.abs(np.log(scale / best_trial.scale))) < SETTLED_STEP:
                break
            trial = self.trial(scale)
            is_better = trial.is_better(best_trial, target)
            self.tell(
                f"round {number}: {yield_text(trial.yield_estimate)} at cost {trial.cost:.3g}; "
                f"{'best so far' if is_better else 'not better, shorter steps from the best'}"
            )
            best_trial, radius = (
                (trial, min(GROWTH * radius, np.log(TRUST))) if is_better else (best_trial, SHRINKAGE * radius)
            )
        return best_trial

    def hardest_limit(self, units: LinearUnits) -> str:
        """The limit that most units break, as the study states it."""
        worst_limit = tails(self.study)[int(np.argmax(np.mean(units.value > 0, axis=0)))].metric
        return f"{worst_limit} = {self.study.limits.of_metrics[worst_limit]:g}"


def with_failures(badness: Real) -> Real:
    """Badness (n, n_limits) with the worst known value, at least 1, for a missing one, so that the unit fails."""
    failing = max(float(np.nanmax(badness, initial=0.0)), 1.0)
    return np.where(np.isfinite(badness), badness, failing)


def yield_text(yield_estimate: Estimate) -> str:
    """A yield with its interval and the units behind it."""
    ends = f"{100 * yield_estimate.ci_low:.1f} to {100 * yield_estimate.ci_high:.1f}"
    return f"yield {100 * yield_estimate.value:.1f} % ({ends}; {yield_estimate.n:,} units)"


def tails(study: Study) -> list[Tail]:
    """The limits of a study, the larger value the worse."""
    signs = {name: -1.0 if library()[name].smaller_is_worse else 1.0 for name in library()}
    limits = study.limits.of_metrics.items()
    return [Tail(name, study.limits.over, signs[name], signs[name] * limit) for name, limit in limits]


def _group_cost(group: Sequence[Priced], scale: Real) -> Real:
    cost: Real = np.sum([entry.cost_at(scale) for entry in group], axis=0)
    return cost


def _solve_units(search: Search, scale: Real, start: int, stop: int) -> list[Angles]:
    """Of units their metrics at the loaded angles and over the turn, and those of the rough model, here and moved."""
    angles, turns = search.solve(search.draw_units(search.spread(scale), start, stop))
    results = [angles, turns, search.rough(search.draw_units(search.spread(scale), start, stop))]
    for k in range(len(scale)):
        trial_scale = scale * np.where(np.arange(len(scale)) == k, 1 + STEP, 1.0)
        results.append(search.rough(search.draw_units(search.spread(trial_scale), start, stop)))
    return results

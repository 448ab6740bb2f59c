"""Each unit's worst over a turn of the output, by a guided search; some units solved at every pitch tell how well.

A rough model ranks every pitch of a unit for each metric, the most promising are load-solved, and each solution serves
all metrics. What the rough model misses at them corrects the ranking of the others, in a few rounds. What the search
misses is seen on units that are solved at every pitch and beside the worst of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.model.metrics import library
from pipeline.model.units import ARCMIN
from pipeline.populations.turn_drives import TurnDrives, Units
from pipeline.populations.turn_forces import PinForces
from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_ranking import Ranking, place_compliance
from pipeline.populations.turn_residuals import upper_bounds
from pipeline.populations.turn_springs import Springs

TRAINING_UNITS, TRAINING_PITCHES = 60, 150
"""Units that are solved at each of some pitches, drawn for each, for the slopes of the ranking."""
PROMISING = {
    "clearance_backlash_arcmin": (2, 1),
    "lost_motion_arcmin": (4, 2),
    "torsional_rigidity_Nm_per_arcmin": (10, 6),
    "peak_pressure_MPa": (8, 3),
}
"""Pitches of a unit that are solved for a metric at first, and in each further round."""
PROMISING_OTHERWISE = 2, 0
"""Likewise of a metric that is not named."""
ROUNDS = 4
"""Further rounds, each ranked anew by what the ranking missed at the pitches solved so far."""
CANDIDATES = 150
"""Pitches of a unit among which those of further rounds are chosen, of each metric the best ranked: the worst of 3,000
was always among them."""
RANKED_AT_ONCE = 50
"""Units whose features at all pitches are held together: 250 MB at 6,320 pitches."""
MANY_PINS = 60
"""Pins above which two steps beside the worst pitch are enough: of 80 pins a pitch alone misses 0.1 %, of 14 0.8 %. So
they are of carriers: 12 units of an RV reducer miss 0.01 % in the median and at most 1.3 % of what all steps find."""
SHORT = 0.05
"""Mean shortfall over the spread of the units above which given steps do not serve: a median is off by 2 % of units."""
BEST_CLIMBED = 3
"""Pitches of a unit from which neighbouring steps are looked at, of each metric."""


@dataclass(frozen=True)
class Worst:
    """The worst of each metric of ``n`` units, by name.

    Attributes
    ----------
    value : metric -> (n,); missing of a unit without a result at some step.
    step : metric -> (n,) step of the turn where it was found.
    best_steps : (n, n_steps) that step of every metric and those of the values next to it.
    n_solved : (n,) solutions of each unit.
    """

    value: dict[str, Real]
    step: dict[str, Index]
    best_steps: Index
    n_solved: Index


class _Best:
    """The worst that were found so far of ``n`` units: of every metric as many as are climbed from, the worst first."""

    def __init__(self, n: int) -> None:
        self.sign = np.array([-1.0 if metric.smaller_is_worse else 1.0 for metric in library().values()])
        self.value = np.full((n, len(self.sign), BEST_CLIMBED), -np.inf)
        self.step = np.zeros((n, len(self.sign), BEST_CLIMBED), np.intp)
        self.missing = np.zeros((n, len(self.sign)), bool)
        self.n_solved = np.zeros(n, np.intp)

    def take(self, steps: Index, rows: Index, values: Real) -> None:
        """Note metrics (n_pairs, n_metrics) of pairs (n_pairs,) of a step and a unit; of equal ones the first stays."""
        np.logical_or.at(self.missing, rows, np.isnan(values))
        self.n_solved += np.bincount(rows, minlength=len(self.n_solved))
        signed_values = np.where(np.isnan(values), -np.inf, self.sign * values)
        for metric in range(len(self.sign)):
            value, step = self.value[:, metric], self.step[:, metric]
            unit = np.concatenate([np.repeat(np.arange(len(value)), BEST_CLIMBED), rows])
            all_values = np.concatenate([value.ravel(), signed_values[:, metric]])
            all_steps = np.concatenate([step.ravel(), steps])
            order = np.lexsort((-all_values, unit))
            first_rows = np.searchsorted(unit[order], np.arange(len(value)))
            best_rows = order[first_rows[:, None] + np.arange(BEST_CLIMBED)]
            self.value[:, metric], self.step[:, metric] = all_values[best_rows], all_steps[best_rows]

    def move_finitely(self, drives: TurnDrives, units: Units) -> None:
        """Give metrics of the play what finite motions add at the worst steps, and put the worst first again."""
        for number, metric in enumerate(library().values()):
            if not metric.turn_of_rigid_bodies:
                continue
            value, step = self.value[:, number], self.step[:, number]
            rows, place = np.nonzero(np.isfinite(value))
            change = drives.backlash_change_at(step[rows, place], rows, units)
            self.missing[rows[np.isnan(change)], number] = True
            value[rows, place] += self.sign[number] * ARCMIN * change
            order = np.argsort(-value, axis=1, kind="stable")
            self.value[:, number] = np.take_along_axis(value, order, axis=1)
            self.step[:, number] = np.take_along_axis(step, order, axis=1)

    def worst_values(self) -> Worst:
        worst, step = self.value[..., 0], self.step[..., 0]
        values = np.where(self.missing | ~np.isfinite(worst), np.nan, self.sign * worst)
        names = list(library())
        best_steps = self.step.reshape(len(step), -1)
        value, steps = (dict(zip(names, columns.T, strict=True)) for columns in (values, step))
        return Worst(value, steps, best_steps, self.n_solved)


def train_ranking(drives: TurnDrives, units: Units, seed: np.random.SeedSequence) -> Ranking:
    """The ranking of pitches, from some ``units`` at pitches drawn at random."""
    rng = np.random.default_rng(seed)
    pitches = rng.choice(drives.pitches, min(TRAINING_PITCHES, drives.pitches), replace=False)
    n_places = drives.study.design.cycloid.pins * drives.study.design.disk.count
    place_forces, deflections, metrics = [], [], []
    for pitch in pitches:
        drive, response, values = drives.solve_step(int(pitch) * drives.phases, units)
        states = response.equilibria
        deflection = drive.laws_of_states.deflection(states.force) + drive.elastic_deflection(states.force)
        order = np.argsort(drives.places(int(pitch)))
        place_forces.append(states.force[..., order])
        deflections.append(deflection[..., order])
        metrics.append(values)
    force, gaps = np.stack(place_forces, axis=1), SeparateGaps.from_units(drives, units)  # (n, n_pitches, n_states, n)
    n_contacts = force.shape[-1]
    compliance = place_compliance(np.stack(deflections, axis=1).reshape(-1, n_contacts), force.reshape(-1, n_contacts))
    springs, top = Springs.from_compliance(drives, compliance), force[:, :, _top_states(drives), :n_places]
    forces = PinForces.from_pairs(springs, drives.laws[0].pressure[:n_places], gaps, pitches, top)
    of_metrics = dict(zip(library(), np.moveaxis(np.stack(metrics, axis=1), -1, 0), strict=True))
    return Ranking.from_pairs(springs, forces, gaps, pitches, of_metrics)


def _top_states(drives: TurnDrives) -> list[int]:
    """States of the cycle under the highest torque that turns a disk one way, and the other."""
    torque = drives.cycle.state_torque
    ends = [int(np.argmax(torque)), int(np.argmin(torque))]
    return ends if assembly.reducer(drives.study.design, 0.0).flange_ratio > 0 else ends[::-1]


def search(drives: TurnDrives, ranking: Ranking, units: Units) -> Worst:
    """The worst of units as found at their most promising pitches."""
    best_values = _Best(len(units))
    if ranking.names:
        blocks = [np.arange(k, min(k + RANKED_AT_ONCE, len(units))) for k in range(0, len(units), RANKED_AT_ONCE)]
        pools = [_Pool.from_ranking(drives, ranking, units, rows) for rows in blocks]
        for further in range(ROUNDS + 1):
            candidates = [pool.promising(ranking) if further else pool.first_pairs() for pool in pools]
            parts = np.split(
                _solve_pairs(
                    drives, units, np.concatenate([pairs * [drives.phases, 1] for pairs in candidates]), best_values
                ),
                np.cumsum([len(pairs) for pairs in candidates])[:-1],
            )
            for pool, pairs, values in zip(pools, candidates, parts, strict=True):
                pool.take(pairs, values)
    if drives.phases > 1:
        is_ranked = [name in ranking.names for name in library()]
        offsets, count = _offsets(drives), BEST_CLIMBED
        if drives.study.design.cycloid.pins > MANY_PINS or drives.study.design.output.carries_disks:
            offsets, count = [offsets[0], offsets[-1]], 1
        _solve_beside(drives, units, _steps(best_values.step[:, is_ranked, :count]), offsets, best_values)
    best_values.move_finitely(drives, units)
    return best_values.worst_values()


def worst_at(drives: TurnDrives, units: Units, steps: Index) -> Worst:
    """The worst of units at steps (n_units, n_steps) of each, as where drives that differ little have theirs."""
    best_values = _Best(len(units))
    pairs = np.stack([steps.ravel(), np.repeat(np.arange(len(units)), steps.shape[1])], axis=1)
    _solve_pairs(drives, units, np.unique(pairs, axis=0), best_values)
    best_values.move_finitely(drives, units)
    return best_values.worst_values()


def lies_elsewhere(found: Worst, searched: Worst) -> bool:
    """Whether the worst of units that were found at given steps fall short of what a search of the first ones finds."""
    for name, values in searched.value.items():
        short = _sign(name) * (values - found.value[name][: len(values)])
        finite = np.isfinite(short)
        if finite.any() and np.mean(short[finite]) > SHORT * np.std(values[finite]):
            return True
    return False


@dataclass(frozen=True)
class _Pool:
    """The best ranked pitches of some units, and what is known of them.

    Attributes
    ----------
    rows : (n,) numbers of the units.
    pitches : (n, n_pitches) ascending, -1 where there are fewer.
    predicted_values, solved_values : (n_metrics, n, n_pitches) the ranking's metrics and true ones, larger ones being
        worse; missing where not solved.
    names : metrics that are ranked.
    """

    rows: Index
    pitches: NDArray[np.int32]
    predicted_values: NDArray[np.float32]
    solved_values: NDArray[np.float32]
    names: tuple[str, ...]

    @classmethod
    def from_ranking(cls, drives: TurnDrives, ranking: Ranking, units: Units, rows: Index) -> _Pool:
        """The best ranked pitches of each metric."""
        rankings = ranking.predict_metrics(SeparateGaps.from_units(drives, units.some(rows)))
        count = min(CANDIDATES, drives.pitches)
        bad = np.stack([_sign(name) * values for name, values in rankings.items()])
        best_pitches = np.sort(np.concatenate(np.argpartition(-bad, count - 1, axis=2)[:, :, :count], axis=1), axis=1)
        is_repeated = np.zeros(best_pitches.shape, bool)
        is_repeated[:, 1:] = best_pitches[:, 1:] == best_pitches[:, :-1]
        columns = np.argsort(is_repeated, axis=1, kind="stable")[:, : int((~is_repeated).sum(axis=1).max())]
        best_pitches, is_repeated = (
            np.take_along_axis(best_pitches, columns, axis=1),
            np.take_along_axis(is_repeated, columns, axis=1),
        )
        predicted_values = np.take_along_axis(bad, best_pitches[None], axis=2).astype(np.float32)
        pitches = np.where(is_repeated, -1, best_pitches).astype(np.int32)
        return cls(
            rows, pitches, predicted_values, np.full(predicted_values.shape, np.nan, np.float32), tuple(rankings)
        )

    def first_pairs(self) -> Index:
        """Pairs (n_pairs, 2) of a pitch and a unit: of each metric the best ranked."""
        return self._pairs(self.predicted_values.astype(float), 0)

    def promising(self, ranking: Ranking) -> Index:
        """Likewise of those that are not solved yet, by the ranking and what it missed at the solved ones."""
        is_known = np.isfinite(self.solved_values).any(axis=0)
        width = max(1, int(is_known.sum(axis=1).max()))
        columns = np.argsort(~is_known, axis=1, kind="stable")[:, :width]
        pitches = np.where(
            np.take_along_axis(is_known, columns, axis=1), np.take_along_axis(self.pitches, columns, 1), -1
        )
        scores = np.full(self.predicted_values.shape, -np.inf)
        for k, name in enumerate(self.names):
            if PROMISING.get(name, PROMISING_OTHERWISE)[1] == 0:
                continue
            residuals = np.take_along_axis(self.solved_values[k] - self.predicted_values[k], columns, axis=1)
            count = min(CANDIDATES, self.pitches.shape[1])
            best_columns = np.argpartition(
                -np.where(self.pitches < 0, -np.inf, self.predicted_values[k]), count - 1, axis=1
            )[:, :count]
            other_pitches, predicted_values = (
                np.take_along_axis(values, best_columns, 1) for values in (self.pitches, self.predicted_values[k])
            )
            bounds = upper_bounds(
                ranking.correlations[name], pitches, residuals, np.abs(other_pitches), predicted_values
            )
            np.put_along_axis(scores[k], best_columns, np.stack(list(bounds)), axis=1)
        return self._pairs(np.where(is_known, -np.inf, scores), 1)

    def _pairs(self, scores: Real, further: int) -> Index:
        """Pairs of the largest scores (n_metrics, n, n_pitches): so many of each metric."""
        scores = np.where(self.pitches < 0, -np.inf, scores)
        is_chosen = np.zeros(self.pitches.shape, bool)
        for name, of_metric in zip(self.names, scores, strict=True):
            count = min(PROMISING.get(name, PROMISING_OTHERWISE)[further], of_metric.shape[1])
            if count == 0:
                continue
            best_columns = np.argpartition(-of_metric, count - 1, axis=1)[:, :count]
            np.put_along_axis(
                is_chosen, best_columns, np.take_along_axis(of_metric, best_columns, axis=1) > -np.inf, axis=1
            )
        unit, column = np.nonzero(is_chosen)
        return np.stack([self.pitches[unit, column], self.rows[unit]], axis=1).astype(np.intp)

    def take(self, pairs: Index, values: Real) -> None:
        """Note the metrics (n_pairs, n_metrics of the library) of pairs."""
        unit = pairs[:, 1] - self.rows[0]
        column = np.argmax(self.pitches[unit] == pairs[:, :1], axis=1)
        for k, name in enumerate(self.names):
            self.solved_values[k, unit, column] = _sign(name) * values[:, list(library()).index(name)]


def _sign(name: str) -> float:
    """By which a metric is multiplied so that larger values are worse."""
    return -1.0 if library()[name].smaller_is_worse else 1.0


def _steps(steps: Index) -> Index:
    """Steps (n_units, n_metrics, n_best) by unit (n_steps, n_units)."""
    return steps.reshape(len(steps), -1).T.copy()


def _offsets(drives: TurnDrives) -> list[int]:
    """Steps on both sides of a pitch that lie nearer to it than to the next one."""
    reach = drives.phases // 2
    return [offset for offset in range(-reach, reach + 1) if offset]


def _solve_beside(drives: TurnDrives, units: Units, steps: Index, offsets: Sequence[int], best_values: _Best) -> None:
    """Solve each unit at offsets from its steps (n_steps, n_units)."""
    neighbours = np.concatenate([steps + offset for offset in offsets]) % (drives.pitches * drives.phases)
    pairs = np.stack([neighbours, np.broadcast_to(np.arange(len(units)), neighbours.shape)], axis=-1)
    _solve_pairs(drives, units, np.unique(pairs.reshape(-1, 2), axis=0), best_values)


def _solve_pairs(drives: TurnDrives, units: Units, pairs: Index, best_values: _Best) -> Real:
    """Metrics (n_pairs, n_metrics) of pairs (n_pairs, 2) of a step and a unit."""
    steps, rows = pairs.T
    values = drives.metrics_at(steps, rows, units)
    best_values.take(steps, rows, values)
    return values


def audit(drives: TurnDrives, units: Units) -> tuple[Worst, Worst]:
    """The worst of units solved at every pitch; and with the steps between them beside the worst of each metric."""
    best_values = _Best(len(units))
    pitches, rows = np.meshgrid(np.arange(drives.pitches), np.arange(len(units)), indexing="ij")
    _solve_pairs(drives, units, np.stack([drives.phases * pitches.ravel(), rows.ravel()], axis=1), best_values)
    of_pitches = deepcopy(best_values)
    if drives.phases > 1:
        _solve_beside(drives, units, _steps(best_values.step), _offsets(drives), best_values)
    for worst_values in (of_pitches, best_values):
        worst_values.move_finitely(drives, units)
    return of_pitches.worst_values(), best_values.worst_values()

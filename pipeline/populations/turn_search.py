"""Each unit's worst over a turn of the output, by a guided search; some units solved at every pitch tell how well.

A rough model ranks every pitch of a unit for each metric, and for both ends of each angle of the output, whose range is
a transmission error. The most promising are load-solved, and each solution serves all of them. What the rough model
misses at them corrects the ranking of the others, in a few rounds. What the search misses is seen on units that are
solved at every pitch and beside the worst of these.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.arrays import Index, Real, Single, Truth
from pipeline.model.metrics import library
from pipeline.model.metrics.turn import peak_to_peak, turn_library
from pipeline.model.units import ARCMIN
from pipeline.populations.turn_drives import TURN_ANGLES, TurnDrives, Units
from pipeline.populations.turn_forces import PinForces
from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_ranking import Ranking, SpringWork
from pipeline.populations.turn_residuals import Correlation, upper_bounds
from pipeline.populations.turn_springs import Springs

TRAINING_UNITS, TRAINING_PITCHES = 60, 150
"""Units that are solved at each of some pitches, drawn for each, for the slopes of the ranking."""
RANKED_AT_ONCE, GAPS_AT_ONCE = 50, 250
"""Units whose features at all pitches are held together, and whose gaps are: 150 MB at 6,320 pitches."""
MANY_PINS = 60
"""Pins above which phases are looked at beside the worst pitch alone: of 80 pins a pitch misses 0.1 %, of 14 0.8 %."""
SHORT = 0.05
"""Mean shortfall over the spread of the units above which given steps do not serve: a median is off by 2 % of units."""
BEST_CLIMBED = 3
"""Pitches of a unit beside which other phases are looked at, of each metric."""


@dataclass(frozen=True)
class _Effort:
    """How many pitches of a unit are solved, of each metric.

    Attributes
    ----------
    shared : pitches over the turn at which all units are solved at first, for all metrics.
    first : the best ranked ones that are, too.
    rounds : further rounds at most, each ranked anew by what the ranking missed at the pitches solved so far. Angles of
        the output are looked at in the first of them alone: the later ones add 0.4 % to a range at most.
    share, count : of those that may be worse, and at most, in each further round.
    candidates : the best ranked ones among which these are chosen.
    spreads : standard deviations that a metric may lie above what is expected of it.
    """

    shared: int
    first: int
    rounds: int
    share: float
    count: int
    candidates: int
    spreads: float


RANKED = _Effort(shared=0, first=3, rounds=6, share=0.1, count=1_000, candidates=150, spreads=2.0)
"""The ranking knows what decides: the worst of 3,000 units was always among the candidates. Of 120 units of the paper's
drive the rigidity has 71 pitches solved and misses 0.10 %; with 1.75 standard deviations these are 58 and 0.13 %."""
SPREAD = _Effort(shared=60, first=0, rounds=4, share=1.0, count=38, candidates=10_000, spreads=1.35)
"""Of carriers: where a few contacts carry and cranks err, the ranking foretells half of what varies over the turn, and
the worst may have any rank. What is solved all over the turn foretells the rest."""
GOLDEN = 0.5 * (5**0.5 - 1)
"""Multiples of it lie evenly on a circle, however many there are."""


class _Quantity(NamedTuple):
    """A metric, or an end of an angle of the output over the turn; times ``sign`` larger values are worse."""

    name: str
    sign: float


def _quantities() -> list[_Quantity]:
    """What is searched: every metric, the largest of every angle, and the least of every angle."""
    metrics = [_Quantity(name, _sign(name)) for name in library()]
    return metrics + [_Quantity(name, sign) for sign in (1.0, -1.0) for name in TURN_ANGLES]


@dataclass(frozen=True)
class Worst:
    """The worst of each metric of ``n`` units, by name.

    Attributes
    ----------
    value : metric -> (n,); missing of a unit without a result at some step.
    step : metric -> (n,) step of the turn where it was found.
    best_steps : (n, n_steps) that step of every metric, those of the values next to it, and of the ends of angles.
    n_solved : (n,) solutions of each unit.
    ends_of_angles : (n, n_angles, 2) [arcmin] largest and least angle of the output at the steps that were solved, in
        the order of ``TURN_ANGLES``, as missing as the metrics.
    """

    value: dict[str, Real]
    step: dict[str, Index]
    best_steps: Index
    n_solved: Index
    ends_of_angles: Real

    @property
    def of_turn(self) -> dict[str, Real]:
        """The worst of each metric, and those metrics of the turn (n,) that are the range of an angle."""
        ranges = {
            name: peak_to_peak(self.ends_of_angles[:, [TURN_ANGLES.index(angle) for angle in metric.angles]])
            for name, metric in turn_library().items()
            if metric.angles
        }
        return {**self.value, **ranges}


class _Best:
    """The worst found so far of ``n`` units: of every quantity as many as are climbed from, the worst first."""

    def __init__(self, n: int) -> None:
        self.sign = np.array([quantity.sign for quantity in _quantities()])
        self.value = np.full((n, len(self.sign), BEST_CLIMBED), -np.inf)
        self.step = np.zeros((n, len(self.sign), BEST_CLIMBED), np.intp)
        self.missing = np.zeros((n, len(self.sign)), bool)
        self.n_solved = np.zeros(n, np.intp)

    def take(self, steps: Index, rows: Index, values: Real) -> None:
        """Note quantities (n_pairs, n_quantities) of pairs (n_pairs,) of a step and a unit; of equal ones the first."""
        np.logical_or.at(self.missing, rows, np.isnan(values))
        self.n_solved += np.bincount(rows, minlength=len(self.n_solved))
        signed_values = np.where(np.isnan(values), -np.inf, self.sign * values)
        for number in range(len(self.sign)):
            value, step = self.value[:, number], self.step[:, number]
            unit = np.concatenate([np.repeat(np.arange(len(value)), BEST_CLIMBED), rows])
            all_values = np.concatenate([value.ravel(), signed_values[:, number]])
            all_steps = np.concatenate([step.ravel(), steps])
            order = np.lexsort((-all_values, unit))
            first_rows = np.searchsorted(unit[order], np.arange(len(value)))
            best_rows = order[first_rows[:, None] + np.arange(BEST_CLIMBED)]
            self.value[:, number], self.step[:, number] = all_values[best_rows], all_steps[best_rows]

    def move_finitely(self, drives: TurnDrives, units: Units) -> None:
        """Give metrics of the play what finite motions add at the worst steps, and put the worst first again.

        Of carriers to the worst alone, since each takes as long as 30 load cycles: of `rv_80e` they add 0.3 % at most,
        alike at neighbouring steps.
        """
        n_moved = 1 if drives.study.design.output.carries_disks else BEST_CLIMBED
        for number, metric in enumerate(library().values()):
            if not metric.turn_of_rigid_bodies:
                continue
            value, step = self.value[:, number, :n_moved], self.step[:, number, :n_moved]
            rows, place = np.nonzero(np.isfinite(value))
            change = drives.backlash_change_at(step[rows, place], rows, units)
            self.missing[rows[np.isnan(change)], number] = True
            value[rows, place] += self.sign[number] * ARCMIN * change
            order = np.argsort(-value, axis=1, kind="stable")
            value[:], step[:] = np.take_along_axis(value, order, axis=1), np.take_along_axis(step, order, axis=1)

    def some(self, rows: Index) -> "_Best":
        """The worst of some of the units."""
        best_values = _Best(len(rows))
        for name in ("value", "step", "missing", "n_solved"):
            setattr(best_values, name, getattr(self, name)[rows])
        return best_values

    def worst_values(self) -> Worst:
        worst, step = self.value[..., 0], self.step[..., 0]
        values = np.where(self.missing | ~np.isfinite(worst), np.nan, self.sign * worst)
        names = list(library())
        best_steps = self.step[:, : len(names)].reshape(len(step), len(names) * BEST_CLIMBED)
        best_steps = np.hstack([best_steps, step[:, len(names) :]])
        value, steps = (dict(zip(names, columns.T, strict=False)) for columns in (values, step))
        ends = np.reshape(values[:, len(names) :], (len(values), 2, len(TURN_ANGLES))).swapaxes(1, 2)
        return Worst(value, steps, best_steps, self.n_solved, ends)


def train_ranking(drives: TurnDrives, units: Units, seed: np.random.SeedSequence) -> Ranking:
    """The ranking of pitches, from some ``units`` at pitches drawn at random."""
    rng = np.random.default_rng(seed)
    pitches = rng.choice(drives.pitches, min(TRAINING_PITCHES, drives.pitches), replace=False)
    n_places = drives.study.design.cycloid.pins * drives.study.design.disk.count
    work, ends, top_forces, quantities = SpringWork(len(drives.laws[0])), _top_states(drives), [], []
    for pitch in pitches:
        drive, response, values = drives.solve_step(int(pitch) * drives.phases, units)
        order, force = np.argsort(drives.places(int(pitch))), response.equilibria.force
        deflection = drive.laws_of_states.deflection(force) + drive.elastic_deflection(force)
        work.add(deflection[..., order], force[..., order])
        top_forces.append(force[:, ends][..., order[:n_places]])
        quantities.append(np.hstack([values.metrics, values.angles]))
    gaps, springs = SeparateGaps.from_units(drives, units), Springs.from_compliance(drives, work.compliance)
    top = np.stack(top_forces, axis=1)  # (n, n_pitches, 2, n_places)
    forces = PinForces.from_pairs(springs, drives.laws[0].pressure[:n_places], gaps, pitches, top)
    jointly = drives.study.design.output.carries_disks
    names = [*library(), *([] if jointly else TURN_ANGLES)]  # many more pitches of carriers would be solved for angles
    of_quantities = dict(zip(names, np.moveaxis(np.stack(quantities, axis=1), -1, 0), strict=False))
    return Ranking.from_pairs(springs, forces, gaps, pitches, of_quantities, jointly)


def _top_states(drives: TurnDrives) -> list[int]:
    """States of the cycle under the highest torque that turns a disk one way, and the other."""
    torque = drives.cycle.state_torque
    ends = [int(np.argmax(torque)), int(np.argmin(torque))]
    return ends if assembly.reducer(drives.study.design, 0.0).flange_ratio > 0 else ends[::-1]


def search(drives: TurnDrives, ranking: Ranking, units: Units) -> Worst:
    """The worst of units as found at their most promising pitches."""
    return search_and_audit(drives, ranking, units, np.zeros(0, np.intp))[0]


def audit(drives: TurnDrives, units: Units) -> tuple[Worst, Worst]:
    """The worst of units solved at every pitch; and with the steps between them beside the worst of each metric."""
    return search_and_audit(drives, None, units, np.arange(len(units)))[1:]


def search_and_audit(
    drives: TurnDrives, ranking: Ranking | None, units: Units, audited: Index
) -> tuple[Worst, Worst, Worst]:
    """The worst of units as `search` finds them, and both of `audit` of some rows (n_audited,) of them.

    Pairs of both are solved together, since setting up a step takes as long as solving ten units at it. Without a
    ranking nothing is searched, and the first of the three has no values.
    """
    found, of_pitches, design = _Best(len(units)), _Best(len(units)), drives.study.design
    names = () if ranking is None else ranking.names
    effort = SPREAD if design.output.carries_disks else RANKED
    n_best = 1 if drives.phases == 1 or design.cycloid.pins > MANY_PINS else BEST_CLIMBED
    waiting = [_Batch(_pairs_of_all_pitches(drives, audited), of_pitches)]
    pools = list(_pools(drives, ranking, units, effort)) if ranking is not None and names else []
    for further in range(effort.rounds + 1):
        candidates = [pool.promising(n_best, further == 1) if further else pool.first_pairs() for pool in pools]
        if not any(map(len, candidates)):
            break
        pairs = np.concatenate([pairs * [drives.phases, 1] for pairs in candidates])
        values = _solve_batches(drives, units, [_Batch(pairs, found), *(waiting if further else ())])[0]
        waiting = [] if further else waiting
        ends = np.cumsum([len(pairs) for pairs in candidates])
        for pool, pairs, of_pool in zip(pools, candidates, np.split(values, ends)[:-1], strict=True):
            pool.take(pairs, of_pool)
    _solve_batches(drives, units, waiting)
    of_phases, of_angles, n_metrics = deepcopy(of_pitches), deepcopy(of_pitches), len(library())
    ranked_metrics = [name in names for name in library()]
    beside = _pairs_beside(drives, np.arange(len(units)), found.step[:, :n_metrics][:, ranked_metrics, :n_best])
    batches = [_Batch(beside, found)]
    for best_values, kinds in ((of_phases, slice(n_metrics)), (of_angles, slice(n_metrics, None))):
        pairs = _pairs_beside(drives, audited, best_values.step[audited][:, kinds])
        batches.append(_Batch(pairs, best_values))
    _solve_batches(drives, units, batches)
    found.move_finitely(drives, units)
    audits = of_pitches.some(audited), of_phases.some(audited)
    for best_values in audits:
        best_values.move_finitely(drives, units.some(audited))
    ends_of_angles = of_angles.some(audited).worst_values().ends_of_angles
    of_all = replace(audits[1].worst_values(), ends_of_angles=ends_of_angles)
    return found.worst_values(), audits[0].worst_values(), of_all


def worst_at(drives: TurnDrives, units: Units, steps: Index) -> Worst:
    """The worst of units at steps (n_units, n_steps) of each, as where drives that differ little have theirs."""
    best_values = _Best(len(units))
    pairs = np.stack([steps.ravel(), np.repeat(np.arange(len(units)), steps.shape[1])], axis=1)
    _solve_batches(drives, units, [_Batch(np.unique(pairs, axis=0), best_values)])
    best_values.move_finitely(drives, units)
    return best_values.worst_values()


def lies_elsewhere(found: Worst, searched: Worst, names: Iterable[str]) -> bool:
    """Whether units found at given steps fall short of what a search of the first ones finds, in some of ``names``."""
    for name in names:
        values = searched.of_turn[name]
        short = (_sign(name) if name in library() else 1.0) * (values - found.of_turn[name][: len(values)])
        finite = np.isfinite(short)
        if finite.any() and np.mean(short[finite]) > SHORT * np.std(values[finite]):
            return True
    return False


def _pools(drives: TurnDrives, ranking: Ranking, units: Units, effort: _Effort) -> "Iterator[_Pool]":
    """The best ranked pitches of all units, in blocks of them."""
    for first_row in range(0, len(units), GAPS_AT_ONCE):
        rows = np.arange(first_row, min(first_row + GAPS_AT_ONCE, len(units)))
        gaps = SeparateGaps.from_units(drives, units.some(rows))
        for first in range(0, len(rows), RANKED_AT_ONCE):
            block = slice(first, first + RANKED_AT_ONCE)
            yield _Pool.from_ranking(ranking, gaps.some(block), rows[block], effort)


@dataclass(frozen=True)
class _Pool:
    """The best ranked pitches of some units, and what is known of them.

    Attributes
    ----------
    rows : (n,) numbers of the units.
    pitches : (n, n_pitches) ascending, -1 where there are fewer.
    predicted_values, solved_values : (n_quantities, n, n_pitches) the ranking's quantities and true ones, larger ones
        being worse; missing where not solved.
    best_columns : (n_quantities, n, n_candidates) those of each quantity.
    is_open : (n,) whether some pitch may still be worse than the solved ones.
    numbers, correlations : of the quantities that are ranked; see `Ranking`.
    effort : how many are solved.
    """

    rows: Index
    pitches: NDArray[np.int32]
    predicted_values: Single
    best_columns: NDArray[np.int16]
    solved_values: Single
    is_open: Truth
    numbers: list[int]
    correlations: list[Correlation]
    effort: _Effort

    @classmethod
    def from_ranking(cls, ranking: Ranking, gaps: SeparateGaps, rows: Index, effort: _Effort) -> "_Pool":
        """The best ranked pitches of each quantity, of units by their gaps."""
        rankings, quantities = ranking.predict_values(gaps), _quantities()
        numbers = [number for number, quantity in enumerate(quantities) if quantity.name in rankings]
        count = min(effort.candidates, gaps.n_pitches)
        bad = np.stack([quantities[number].sign * rankings[quantities[number].name] for number in numbers])
        best_pitches = np.sort(np.concatenate(np.argpartition(-bad, count - 1, axis=2)[:, :, :count], axis=1), axis=1)
        is_repeated = np.zeros(best_pitches.shape, bool)
        is_repeated[:, 1:] = best_pitches[:, 1:] == best_pitches[:, :-1]
        columns = np.argsort(is_repeated, axis=1, kind="stable")[:, : int((~is_repeated).sum(axis=1).max())]
        best_pitches = np.take_along_axis(best_pitches, columns, axis=1)
        is_repeated = np.take_along_axis(is_repeated, columns, axis=1)
        predicted_values = np.take_along_axis(bad, best_pitches[None], axis=2).astype(np.float32)
        pitches = np.where(is_repeated, -1, best_pitches).astype(np.int32)
        best_columns = np.argpartition(np.where(is_repeated, np.inf, -predicted_values), count - 1, axis=2)[..., :count]
        solved_values, is_open = np.full(predicted_values.shape, np.nan, np.float32), np.ones(len(rows), bool)
        columns_of_best = best_columns.astype(np.int16)
        return cls(
            rows=rows,
            pitches=pitches,
            predicted_values=predicted_values,
            best_columns=columns_of_best,
            solved_values=solved_values,
            is_open=is_open,
            numbers=numbers,
            correlations=[ranking.correlations[quantities[number].name] for number in numbers],
            effort=effort,
        )

    def first_pairs(self) -> Index:
        """Pairs (n_pairs, 2) of a pitch and a unit: evenly over the turn, or of each quantity the best ranked."""
        scores = np.where(self.pitches < 0, -np.inf, self.predicted_values)
        if self.effort.shared:
            evenly = self.pitches.shape[1] * (GOLDEN * np.arange(self.effort.shared) % 1)
            scores[:, :, np.unique(evenly.astype(int))] = np.inf
            return self._pairs(np.where(np.isinf(scores), 0.0, -np.inf), self.effort.shared)
        return self._pairs(scores, self.effort.first)

    def promising(self, n_best: int, with_angles: bool) -> Index:
        """Likewise of those that may be among the worst, by the ranking and what it missed at the solved ones.

        Parameters
        ----------
        n_best : solved pitches of a unit, the least of which another one must be able to exceed.
        with_angles : whether ends of angles are among the quantities that are looked at.
        """
        is_known: Truth = np.asarray(np.isfinite(self.solved_values).any(axis=0))
        scores, rows = np.full(self.predicted_values.shape, -np.inf), np.flatnonzero(self.is_open)
        known = np.argsort(~is_known[rows], axis=1, kind="stable")[:, : max(1, int(is_known.sum(axis=1).max()))]
        rows = rows[:, None]
        pitches = np.where(is_known[rows, known], self.pitches[rows, known], -1)
        places = [k for k, number in enumerate(self.numbers) if with_angles or number < len(library())]
        for group in [places] if self.effort.shared else [[k] for k in places]:  # that share correlation and candidates
            others, number = self.best_columns[group[0]][rows[:, 0]], np.array(group)[:, None, None]
            correlations = [self.correlations[k] for k in group]
            solved_values = self.solved_values[number, rows, known]
            predicted_values = self.predicted_values[number, rows, others]
            residuals = solved_values - self.predicted_values[number, rows, known]
            other_pitches = self.pitches[rows, others]
            is_metric = self.numbers[group[0]] < len(library())
            spreads = self.effort.spreads if is_metric else 0.0  # of a range 1 % is left so, for half of the solutions
            bounds = upper_bounds(correlations, pitches, residuals, other_pitches, predicted_values, spreads)
            least_values = np.sort(np.where(pitches < 0, -np.inf, solved_values), axis=2)[..., -n_best:][..., :1]
            may_be_worse = (bounds > least_values) & ~is_known[rows, others]
            for k, values in zip(group, np.where(may_be_worse, bounds, -np.inf), strict=True):
                scores[k][rows, others] = values
        n_open = np.isfinite(scores).sum(axis=2, keepdims=True)
        self.is_open[:] = n_open.any(axis=(0, 2))
        return self._pairs(scores, np.minimum(np.ceil(self.effort.share * n_open), self.effort.count))

    def _pairs(self, scores: Real, count: Real | int) -> Index:
        """Pairs of the largest finite scores (n_quantities, n, n_pitches), so many of each and of each unit."""
        most = min(max(int(np.max(count)), 1), scores.shape[2])
        best_columns = np.argpartition(-scores, most - 1, axis=2)[..., :most]
        order = np.argsort(-np.take_along_axis(scores, best_columns, axis=2), axis=2, kind="stable")
        best_columns = np.take_along_axis(best_columns, order, axis=2)
        is_chosen = np.zeros(scores.shape, bool)
        np.put_along_axis(is_chosen, best_columns, np.arange(most) < count, axis=2)
        unit, column = np.nonzero(np.any(is_chosen & np.isfinite(scores), axis=0))
        return np.stack([self.pitches[unit, column], self.rows[unit]], axis=1).astype(np.intp)

    def take(self, pairs: Index, values: Real) -> None:
        """Note the quantities (n_pairs, n_quantities) of pairs."""
        unit = pairs[:, 1] - self.rows[0]
        column = np.argmax(self.pitches[unit] == pairs[:, :1], axis=1)
        for k, number in enumerate(self.numbers):
            self.solved_values[k, unit, column] = _quantities()[number].sign * values[:, number]


def _sign(name: str) -> float:
    """By which a metric is multiplied so that larger values are worse."""
    return -1.0 if library()[name].smaller_is_worse else 1.0


def _pairs_of_all_pitches(drives: TurnDrives, rows: Index) -> Index:
    """Pairs (n_pairs, 2) of the step of every pitch and units (n_units,)."""
    steps = drives.phases * np.arange(drives.pitches)
    return np.stack([np.repeat(steps, len(rows)), np.tile(rows, drives.pitches)], axis=1)


def _pairs_beside(drives: TurnDrives, rows: Index, steps: Index) -> Index:
    """Pairs (n_pairs, 2) of all phases nearer to steps (n_units, ...) of units (n_units,) than to the next ones."""
    reach = drives.phases // 2
    offsets = np.array([offset for offset in range(-reach, reach + 1) if offset], np.intp)
    neighbours = (steps[..., None] + offsets) % (drives.pitches * drives.phases)
    units = np.broadcast_to(rows.reshape(-1, *[1] * steps.ndim), neighbours.shape)
    return np.unique(np.stack([neighbours.ravel(), units.ravel()], axis=1), axis=0)


class _Batch(NamedTuple):
    """Pairs (n_pairs, 2) of a step and a unit that are to be solved, and where what is found is noted."""

    pairs: Index
    best_values: _Best


def _solve_batches(drives: TurnDrives, units: Units, batches: Sequence[_Batch]) -> list[Real]:
    """Quantities (n_pairs, n_quantities) of the pairs of each batch.

    A step without a result, which is one of 20,000 of `rv_80e`, is that of the next phase, which differs by a hundredth
    of what varies over the turn.
    """
    steps, rows = np.concatenate([np.zeros((0, 2), np.intp), *(batch.pairs for batch in batches)]).T.copy()
    values = drives.values_at(steps, rows, units)
    lost = np.flatnonzero(np.isnan(values.metrics).any(axis=1)) if drives.phases > 1 else steps[:0]
    if len(lost):
        steps[lost] = (steps[lost] + 1) % (drives.pitches * drives.phases)
        values.put(lost, drives.values_at(steps[lost], rows[lost], units))
    starts = np.cumsum([0, *(len(batch.pairs) for batch in batches)])[:-1]
    of_quantities = np.hstack([values.metrics, values.angles, values.angles])
    parts = [np.split(columns, starts)[1:] for columns in (steps, rows, of_quantities)]
    for batch, *columns in zip(batches, *parts, strict=True):
        batch.best_values.take(*columns)
    return parts[2]

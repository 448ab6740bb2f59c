"""Each unit's worst over a turn of the output, by a guided search; some units solved at every pitch tell how well.

A rough model ranks every pitch of a unit for each metric, the most promising are load-solved, and each solution serves
all metrics. What the search misses is seen on units that are solved at every pitch and beside the worst of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.model.metrics import library
from pipeline.populations.turn_drives import TurnDrives, Units
from pipeline.populations.turn_ranking import Ranking, SeparateGaps, Springs, fitted_slopes, place_compliance, waves

Real = NDArray[np.float64]
Index = NDArray[np.intp]

TRAINING_UNITS, TRAINING_PITCHES = 60, 150
"""Units that are solved at each of some pitches, drawn for each, for the slopes of the ranking."""
PROMISING = {
    "clearance_backlash_arcmin": 6,
    "lost_motion_arcmin": 16,
    "torsional_rigidity_Nm_per_arcmin": 24,
    "peak_pressure_MPa": 32,
}
"""Pitches of a unit that are solved for a metric: the largest misses are below 1.4 % so, 0 to 0.02 % in the median."""
PROMISING_OTHERWISE = 20
"""Likewise of a metric that is not named."""
RANKED_AT_ONCE = 50
"""Units whose features at all pitches are held together: 250 MB at 6,320 pitches."""
MANY_PINS = 60
"""Pins above which two steps beside the worst pitch are enough: of 80 pins a pitch alone misses 0.1 %, of 14 0.8 %."""
BEST_CLIMBED = 3
"""Pitches of a unit from which neighbouring steps are looked at, of each metric."""


@dataclass(frozen=True)
class Worst:
    """The worst of each metric of ``n`` units, by name.

    Attributes
    ----------
    value : metric -> (n,); missing of a unit without a result at some step.
    step : metric -> (n,) step of the turn where it was found.
    solved : (n,) solutions of each unit.
    """

    value: dict[str, Real]
    step: dict[str, Index]
    solved: Index


class _Best:
    """The worst that were found so far of ``n`` units: of every metric as many as are climbed from, the worst first."""

    def __init__(self, n: int) -> None:
        self.sign = np.array([-1.0 if metric.smaller_is_worse else 1.0 for metric in library().values()])
        self.value = np.full((n, len(self.sign), BEST_CLIMBED), -np.inf)
        self.step = np.zeros((n, len(self.sign), BEST_CLIMBED), np.intp)
        self.missing = np.zeros((n, len(self.sign)), bool)
        self.solved = np.zeros(n, np.intp)

    def take(self, steps: Index, rows: Index, values: Real) -> None:
        """Note metrics (n_pairs, n_metrics) of pairs (n_pairs,) of a step and a unit; of equal ones the first stays."""
        np.logical_or.at(self.missing, rows, np.isnan(values))
        self.solved += np.bincount(rows, minlength=len(self.solved))
        signed = np.where(np.isnan(values), -np.inf, self.sign * values)
        for metric in range(len(self.sign)):
            value, step = self.value[:, metric], self.step[:, metric]
            unit = np.concatenate([np.repeat(np.arange(len(value)), BEST_CLIMBED), rows])
            all_values = np.concatenate([value.ravel(), signed[:, metric]])
            all_steps = np.concatenate([step.ravel(), steps])
            order = np.lexsort((-all_values, unit))
            first = np.searchsorted(unit[order], np.arange(len(value)))
            best = order[first[:, None] + np.arange(BEST_CLIMBED)]
            self.value[:, metric], self.step[:, metric] = all_values[best], all_steps[best]

    def worst(self) -> Worst:
        value, step = self.value[..., 0], self.step[..., 0]
        values = np.where(self.missing | ~np.isfinite(value), np.nan, self.sign * value)
        names = list(library())
        return Worst(dict(zip(names, values.T, strict=True)), dict(zip(names, step.T, strict=True)), self.solved)


def trained(drives: TurnDrives, units: Units, seed: np.random.SeedSequence) -> Ranking:
    """The ranking of pitches, from some ``units`` at pitches drawn at random."""
    rng = np.random.default_rng(seed)
    pitches = rng.choice(drives.pitches, min(TRAINING_PITCHES, drives.pitches), replace=False)
    n_places = drives.study.design.cycloid.pins * drives.study.design.disk.count
    forces, deflections, metrics = [], [], []
    for pitch in pitches:
        drive, response, values = drives.solved(int(pitch) * drives.phases, units)
        states = response.equilibria
        deflection = drive.laws_of_states.deflection(states.force) + drive.elastic_deflection(states.force)
        order = np.argsort(drives.places(int(pitch))[:n_places])
        forces.append(states.force[..., order])
        deflections.append(deflection[..., order])
        metrics.append(values)
    force, gaps = np.stack(forces, axis=1), SeparateGaps.of(drives, units)  # (n, n_pitches, n_states, n_places)
    compliance = place_compliance(np.stack(deflections, axis=1).reshape(-1, n_places), force.reshape(-1, n_places))
    springs = Springs.of(drives, compliance).fitted(gaps, pitches, force[:, :, _top_states(drives)])
    turn = waves(pitches, drives.study.design.cycloid.lobes)
    features = np.concatenate(
        [springs.features(gaps)[:, pitches], np.broadcast_to(turn, (len(units), *turn.shape))], axis=2
    )
    pairs = np.stack(metrics, axis=1).reshape(-1, len(library()))
    slopes = fitted_slopes(features.reshape(len(pairs), -1), dict(zip(library(), pairs.T, strict=True)))
    return Ranking(springs, slopes)


def _top_states(drives: TurnDrives) -> list[int]:
    """States of the cycle under the highest torque that turns a disk one way, and the other."""
    torque = drives.cycle.state_torque
    ends = [int(np.argmax(torque)), int(np.argmin(torque))]
    return ends if assembly.reducer(drives.study.design, 0.0).flange_ratio > 0 else ends[::-1]


def search(drives: TurnDrives, ranking: Ranking, units: Units) -> Worst:
    """The worst of units as found at their most promising pitches."""
    best = _Best(len(units))
    pairs = [np.zeros((0, 2), np.intp)]
    for start in range(0, len(units), RANKED_AT_ONCE):
        rows = np.arange(start, min(start + RANKED_AT_ONCE, len(units)))
        predicted = ranking.predicted(SeparateGaps.of(drives, units.some(rows)))
        for name, values in predicted.items():
            count = min(PROMISING.get(name, PROMISING_OTHERWISE), drives.pitches)
            bad = values if library()[name].smaller_is_worse else -values
            pitches = np.argpartition(bad, count - 1, axis=1)[:, :count]
            pairs.append(np.stack([pitches.ravel(), np.repeat(rows, count)], axis=1))
    promising = np.unique(np.concatenate(pairs), axis=0)
    _solve_pairs(drives, units, np.column_stack([promising[:, 0] * drives.phases, promising[:, 1]]), best)
    if drives.phases > 1:
        ranked = [name in ranking.slopes for name in library()]
        offsets, climbed = _offsets(drives), BEST_CLIMBED
        if drives.study.design.cycloid.pins > MANY_PINS:
            offsets, climbed = [offsets[0], offsets[-1]], 1
        _solve_beside(drives, units, _steps(best.step[:, ranked, :climbed]), offsets, best)
    return best.worst()


def _steps(steps: Index) -> Index:
    """Steps (n_units, n_metrics, n_best) by unit (n_steps, n_units)."""
    return steps.reshape(len(steps), -1).T.copy()


def _offsets(drives: TurnDrives) -> list[int]:
    """Steps on both sides of a pitch that lie nearer to it than to the next one."""
    reach = drives.phases // 2
    return [offset for offset in range(-reach, reach + 1) if offset]


def _solve_beside(drives: TurnDrives, units: Units, steps: Index, offsets: Sequence[int], best: _Best) -> None:
    """Solve each unit at offsets from its steps (n_steps, n_units)."""
    beside = np.concatenate([steps + offset for offset in offsets]) % (drives.pitches * drives.phases)
    pairs = np.stack([beside, np.broadcast_to(np.arange(len(units)), beside.shape)], axis=-1)
    _solve_pairs(drives, units, np.unique(pairs.reshape(-1, 2), axis=0), best)


def _solve_pairs(drives: TurnDrives, units: Units, pairs: Index, best: _Best) -> None:
    """Solve pairs (n_pairs, 2) of a step and a unit."""
    steps, rows = pairs.T
    best.take(steps, rows, drives.metrics_at(steps, rows, units))


def audit(drives: TurnDrives, units: Units) -> Worst:
    """The worst of units that are solved at every pitch, and between them beside the worst of each metric."""
    best = _Best(len(units))
    pitches, rows = np.meshgrid(np.arange(drives.pitches), np.arange(len(units)), indexing="ij")
    _solve_pairs(drives, units, np.stack([drives.phases * pitches.ravel(), rows.ravel()], axis=1), best)
    if drives.phases > 1:
        _solve_beside(drives, units, _steps(best.step), _offsets(drives), best)
    return best.worst()

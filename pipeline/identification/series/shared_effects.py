"""Effects that the states of a drive share: tried on positions that no state was fitted to.

Each state has its own friction, play and compliance. What belongs to the parts (errors over the crank angle, the
material) has one size in all states. A fold leaves out one position in every state, so that an effect must predict
what it has not seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, SOFT, numbers_of
from pipeline.identification.generic.shared_fit import SharedFit, fitted_together
from pipeline.identification.generic.turning_crank import CrankLoops, LoopModel
from pipeline.identification.selection.criteria import FEWEST_BLOCKS
from pipeline.identification.series.states import Series
from pipeline.statistics.blocks import max_t

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

MOST_FOLDS = 6
"""Folds at most: of more positions several are left out together."""
FEWEST_POSITIONS = 3
"""Positions below which no shared effect is claimed: a fold then trains on one."""
LEVEL = 0.05
"""Chance of claiming any effect that is not there, over all that are tried."""
MOST_SHARED = 2
"""Effects that are added one after the other."""
RESAMPLES, SEED = 2000, 33
"""Of the bootstrap over positions and states."""
LEAST_LOSS = 1e-12
"""Mean square error [arcmin^2] below which errors are equal."""


@dataclass(frozen=True)
class Folds:
    """A model with given shared terms, fitted without each group of positions and to all.

    Attributes
    ----------
    terms : shared.
    fits : one without each group of positions; of a single position the fit to all.
    final : to all positions.
    loss : (n_states, n_positions) mean square error [arcmin^2] at positions that were left out; NaN where a state has
        no such position.
    """

    terms: tuple[str, ...]
    fits: tuple[SharedFit, ...]
    final: SharedFit
    loss: Real

    def rms(self) -> float:
        """Root mean square error [arcmin] over all states and positions that were left out."""
        return float(np.sqrt(np.nanmean(self.loss)))


@dataclass(frozen=True)
class TriedEffect:
    """An effect that was tried in all states.

    Attributes
    ----------
    name, title : of it.
    beside : effects that were shared already.
    folds : of the model with it.
    p : of no gain at positions that were left out, all effects of its round counted.
    p_positions : the same by the scatter over positions alone, without counting.
    claimed : whether both are significant, and no number of it ended at a bound.
    note : why it is not claimed, empty where it is.
    """

    name: str
    title: str
    beside: tuple[str, ...]
    folds: Folds
    p: float
    p_positions: float
    claimed: bool
    note: str


@dataclass(frozen=True)
class SharedEffects:
    """What was tried and claimed.

    Attributes
    ----------
    series : of the states.
    recalibrated : each state's own numbers alone.
    tried : all effects, round by round.
    classes : claimed effects, one class for each round: its members predict equally well, the best first.
    untestable : effects that these loops do not show, with the reason.
    """

    series: Series
    recalibrated: Folds
    tried: tuple[TriedEffect, ...]
    classes: tuple[tuple[TriedEffect, ...], ...]
    untestable: Mapping[str, str]

    @property
    def after(self) -> Folds:
        """The model with all that is claimed."""
        return self.classes[-1][0].folds if self.classes else self.recalibrated

    @cached_property
    def before(self) -> Real:
        """Mean square errors (n_states, n_positions) [arcmin^2] with the numbers of the first state in all states."""
        groups = fold_groups(self.series)
        loss = np.full((len(self.series.states), len(self.series.positions)), np.nan)
        for group, fit in zip(groups, self.recalibrated.fits, strict=True):
            predicted = [LoopModel(loops).predicted(fit.values[0]) for loops in _without(self.series, group)]
            _add_losses(loss, self.series, group, predicted)
        return loss


def share_effects(series: Series) -> SharedEffects:
    """The effects that the states share."""
    recalibrated = fold_fits(series, (), ())
    testable, untestable = candidates(series)
    tried: list[TriedEffect] = []
    classes: list[tuple[TriedEffect, ...]] = []
    base = recalibrated
    for _ in range(MOST_SHARED if len(series.positions) >= FEWEST_POSITIONS else 1):
        known = {name for members in classes for effect in members for name in (effect.name, *twins(effect.name))}
        round_effects = _tried_round(series, base, [name for name in testable if name not in known])
        tried += round_effects
        claimed = sorted((effect for effect in round_effects if effect.claimed), key=lambda effect: effect.folds.rms())
        if not claimed:
            break
        classes.append(tuple(effect for effect in claimed if _as_good(effect, claimed[0])))
        base = claimed[0].folds
    return SharedEffects(series, recalibrated, tuple(tried), tuple(classes), untestable)


def candidates(series: Series) -> tuple[list[str], dict[str, str]]:
    """Effects that these loops can show, and the reason for each of the others."""
    units = [state.measurement.unit.settings for state in series.states]
    angles_known = all(state.measurement.known_cranks for state in series.states)
    moves = angles_known and all(unit.crank.moves != "fixed" for unit in units)
    testable, untestable = list(SOFT), {}
    for name, effect in CRANK_EFFECTS.items():
        if not angles_known:
            untestable[name] = "the crank angles are unknown"
        elif not moves and effect.acts_on in ("angle", "reading"):
            untestable[name] = "the crank stands still in each loop, whose zero is free"
        else:
            testable.append(name)
    return testable, untestable


def twins(name: str) -> tuple[str, ...]:
    """Effects that are hardly told from one."""
    return CRANK_EFFECTS[name].twins if name in CRANK_EFFECTS else ()


def title(name: str) -> str:
    """An effect in words."""
    return CRANK_EFFECTS[name].title if name in CRANK_EFFECTS else SOFT[name].meaning


def fold_groups(series: Series) -> list[tuple[str, ...]]:
    """Positions that each fold leaves out; one empty group of a single position."""
    positions = series.positions
    if len(positions) < 2:
        return [()]
    count = min(len(positions), MOST_FOLDS)
    return [positions[k::count] for k in range(count)]


def fold_fits(series: Series, terms: tuple[str, ...], start: Sequence[Mapping[str, float]]) -> Folds:
    """Fits of a model with shared terms.

    Parameters
    ----------
    start : numbers of each state to start from; none: those of the library.
    """
    final = fitted_together(series.loops, terms, terms, start=start)
    groups = fold_groups(series)
    fits = [
        fitted_together(_without(series, group), terms, terms, start=final.values) if group else final
        for group in groups
    ]
    loss = np.full((len(series.states), len(series.positions)), np.nan)
    for group, fit in zip(groups, fits, strict=True):
        _add_losses(loss, series, group, fit.predicted)
    return Folds(terms, tuple(fits), final, loss)


def _without(series: Series, group: Sequence[str]) -> list[CrankLoops]:
    """Loops of each state that have no weight at a group of positions."""
    return [loops.some(~_cells(series, k, group)) for k, loops in enumerate(series.loops)]


def _cells(series: Series, state: int, group: Sequence[str]) -> Truth:
    """Cells (n_cells,) of a state at a group of positions."""
    return np.any([series.cells_of(name)[state] for name in group], axis=0)


def _add_losses(loss: Real, series: Series, group: Sequence[str], predicted: Sequence[Real]) -> None:
    """Write the mean square errors of a group's positions, or of all of a fit in sample, into ``loss``."""
    for name in group or series.positions:
        column = series.positions.index(name)
        for k, cells in enumerate(series.cells_of(name)):
            weight = series.loops[k].weight * cells
            trained = not group or np.any(series.loops[k].weight * ~_cells(series, k, group))
            if weight.sum() > 0 and trained:
                error = series.loops[k].angle - predicted[k]
                loss[k, column] = np.sum(weight * error**2) / weight.sum()


def _tried_round(series: Series, base: Folds, names: Sequence[str]) -> list[TriedEffect]:
    """All effects, each added to a base."""
    trials = [fold_fits(series, (*base.terms, name), base.final.values) for name in names]
    gains = [np.log(base.loss + LEAST_LOSS) - np.log(trial.loss + LEAST_LOSS) for trial in trials]
    known = np.isfinite(base.loss)
    held_out = len(series.positions) >= FEWEST_POSITIONS and known.sum() >= FEWEST_BLOCKS
    p_family = (
        max_t(np.column_stack([gain[known] for gain in gains]), RESAMPLES, SEED)[1]
        if held_out and names
        else np.full(len(names), np.nan)
    )
    effects = []
    for name, trial, gain, p in zip(names, trials, gains, p_family, strict=True):
        p_positions = _positions_p(gain) if held_out else float("nan")
        at_bound = sorted((set(numbers_of((name,))) - set(numbers_of(()))) & trial.final.at_bound)
        note = next(_reasons(series, held_out, at_bound, float(p), p_positions), "")
        effects.append(TriedEffect(name, title(name), base.terms, trial, float(p), p_positions, not note, note))
    return effects


def _reasons(series: Series, held_out: bool, at_bound: Sequence[str], p: float, p_positions: float) -> Iterator[str]:
    """Why an effect is not claimed."""
    if not held_out:
        yield f"{len(series.positions)} positions in {len(series.states)} states are too few to leave any out"
    elif at_bound:
        yield f"{', '.join(at_bound)} at a bound of the fit"
    elif not (p < LEVEL and p_positions < LEVEL):
        yield "no significant gain at positions that were left out"


def _positions_p(gain: Real) -> float:
    """One-sided p of no mean gain over positions, which all states share (n_states, n_positions)."""
    means = np.nanmean(gain, axis=0)
    spread = float(means.std(ddof=1)) / np.sqrt(len(means))
    return float(scipy.stats.t.sf(means.mean() / max(spread, LEAST_LOSS), len(means) - 1))


def _as_good(effect: TriedEffect, best: TriedEffect) -> bool:
    """Whether the losses at left-out positions are not significantly larger than those of the best effect."""
    if effect is best:
        return True
    gap = np.log(effect.folds.loss + LEAST_LOSS) - np.log(best.folds.loss + LEAST_LOSS)
    return _positions_p(gap) >= LEVEL

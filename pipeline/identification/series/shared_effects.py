"""Effects that the states of a drive share: tried on positions that no state was fitted to.

Each state has its own friction, play and compliance. What belongs to the parts (errors over the crank angle, the
material) has one size in all states. A fold leaves out one position in every state, so that an effect must predict
what it has not seen. Where fewer than ``FEWEST_OF_A_WAVE`` positions leave too few for an effect of the crank angle, a
fold leaves out a state: the effect comes from the other states, and must predict unused positions of that one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness, Rounding, Seed
from pipeline.engine.progress import say
from pipeline.identification.fitting.offered import rate_changes
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, SOFT, TERMS, title
from pipeline.identification.generic.generic_drive import LoopModel
from pipeline.identification.generic.shared_fit import fitted_together
from pipeline.identification.measurement.enough import FEWEST_COMPARED, FEWEST_OF_A_WAVE, SINGLE_GROUPS
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.selection.criteria import MOST_NAMED
from pipeline.identification.series.folds import Folds, StateFolds, held_numbers, reversed_numbers, state_folds
from pipeline.identification.series.states import Series
from pipeline.statistics.resampling import LEVEL, max_t

NO_GAIN = "no significant gain at positions that were left out"
"""Why an effect is not claimed; a twin of a claimed one that helps as much belongs to its class all the same."""
NOT_SHOWN = "no significant gain at unused positions of states that were left out"
"""Why the class that predicts best from the other states is not claimed."""
RESAMPLES: Fineness = 2000
"""Of the bootstrap over positions and states."""
SEED: Seed = 33
"""Of the resamples."""
LEAST_LOSS: Rounding = 1e-12
"""Mean square error [arcmin^2] below which errors are equal."""


@dataclass(frozen=True)
class TriedEffect:
    """An effect that was tried in all states.

    Attributes
    ----------
    name : of it.
    companions : effects that were shared already.
    folds : of the model with it.
    p : of no gain at what was left out, all effects of its round counted.
    p_left_out : the same by the scatter over positions, or states, alone, without counting.
    note : why it is not claimed, empty where it is: where both are significant, and no number of it ended at a bound;
        of folds over states, where it is one of a class of which that holds.
    control : root mean square error [arcmin] at what was left out with its sign turned round; NaN of a soft material,
        and over positions of what is not claimed.
    """

    name: str
    companions: tuple[str, ...]
    folds: Folds
    p: float
    p_left_out: float
    note: str
    control: float = float("nan")

    @property
    def title(self) -> str:
        """The effect in words."""
        return title(self.name)

    @property
    def is_claimed(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.note

    @property
    def left_out(self) -> str:
        """What its folds leave out."""
        return "states" if isinstance(self.folds, StateFolds) else "positions"


@dataclass(frozen=True)
class SharedEffects:
    """What was tried and claimed.

    Attributes
    ----------
    series : of the states.
    recalibrated_folds : each state's own numbers alone.
    tried_effects : all effects, round by round.
    classes : claimed effects, one class for each round: its members are twins of the best, which is the first, and
        predict equally well. The last may come from folds over states.
    folds_without : folds over states without an effect of the crank angle; none where they are over positions.
    untestable : effects that these loops do not show, with the reason.
    """

    series: Series
    recalibrated_folds: Folds
    tried_effects: tuple[TriedEffect, ...]
    classes: tuple[tuple[TriedEffect, ...], ...]
    folds_without: StateFolds | None
    untestable: Mapping[str, str]

    @property
    def final_folds(self) -> Folds:
        """The model with all that is claimed."""
        folds = [members[0].folds for members in self.classes if not isinstance(members[0].folds, StateFolds)]
        return folds[-1] if folds else self.recalibrated_folds

    @property
    def bases(self) -> tuple[Folds, ...]:
        """What the effects of each round were added to: the states' own numbers, then each class that was claimed."""
        return (self.recalibrated_folds, *(members[0].folds for members in self.classes))

    @property
    def leading(self) -> tuple[TriedEffect, ...]:
        """The class that predicts best from the other states where it is not claimed, the best first."""
        members = (effect for effect in self.tried_effects if effect.note == NOT_SHOWN)
        return tuple(sorted(members, key=lambda effect: effect.folds.rms()))

    @cached_property
    def loss_before(self) -> Real:
        """Mean square errors (n_states, n_positions) [arcmin^2] with the numbers of the first state in all states."""
        groups = fold_groups(self.series)
        loss = np.full((len(self.series.states), len(self.series.positions)), np.nan)
        for group, fit in zip(groups, self.recalibrated_folds.fits, strict=True):
            predicted_angles = [
                LoopModel(loops).predict_angle(fit.values[0]) for loops in _loops_without(self.series, group)
            ]
            _add_losses(loss, self.series, group, predicted_angles)
        return loss


def share_effects(series: Series) -> SharedEffects:
    """The effects that the states share."""
    recalibrated_folds = fold_fits(series, (), ())
    testable, untestable = candidates(series)
    by_states = len(series.positions) < FEWEST_OF_A_WAVE and states_with_unused(series) >= FEWEST_COMPARED
    waves = [name for name in testable if by_states and name in CRANK_EFFECTS]
    tried_effects: list[TriedEffect] = []
    classes: list[tuple[TriedEffect, ...]] = []
    base = recalibrated_folds
    for _ in range(MOST_NAMED if len(series.positions) >= FEWEST_COMPARED else 1):
        known_names = {name for members in classes for effect in members for name in (effect.name, *twins(effect.name))}
        round_effects = _tried_round(series, base, [name for name in testable if name not in {*known_names, *waves}])
        tried_effects += round_effects
        members = class_of(round_effects, base)
        if not members:
            break
        classes.append(members)
        base = members[0].folds
    folds_without, by_others = _tried_by_states(series, waves) if waves else (None, ())
    by_state = tuple(
        sorted((effect for effect in by_others if effect.is_claimed), key=lambda effect: effect.folds.rms())
    )
    all_classes = (*classes, by_state) if by_state else tuple(classes)
    return SharedEffects(
        series, recalibrated_folds, (*tried_effects, *by_others), all_classes, folds_without, untestable
    )


def states_with_unused(series: Series) -> int:
    """Number of states that have a position beside one to fit their own numbers to."""
    return sum(len(np.unique(loops.position)) > 1 for loops in series.loops)


def candidates(series: Series) -> tuple[list[str], dict[str, str]]:
    """Effects that these loops can show, and the reason for each of the others."""
    units = [state.measurement.unit.settings for state in series.states]
    angles_known = all(state.measurement.known_cranks for state in series.states)
    moves = angles_known and all(unit.crank.moves != "fixed" for unit in units)
    testable, untestable = list(SOFT), {}
    measurements = [state.measurement for state in series.states]
    if all(m.rows.time is not None and rate_changes(m, np.ones(len(m.cells), bool)) for m in measurements):
        testable.append("creep")
    else:
        untestable["creep"] = "neither a change of the torque's rate nor a dwell"
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


def fold_groups(series: Series) -> list[tuple[str, ...]]:
    """Positions that each fold leaves out; one empty group of a single position."""
    positions = series.positions
    if len(positions) < 2:
        return [()]
    count = min(len(positions), SINGLE_GROUPS)
    return [positions[k::count] for k in range(count)]


def fold_fits(series: Series, terms: tuple[str, ...], start: Sequence[Mapping[str, float]]) -> Folds:
    """Fits of a model with shared terms.

    Parameters
    ----------
    start : numbers of each state to start from; none: those of the library.
    """
    final = fitted_together(series.loops, terms, start=start)
    groups = fold_groups(series)
    fits = [
        fitted_together(_loops_without(series, group), terms, start=final.values) if group else final
        for group in groups
    ]
    loss = np.full((len(series.states), len(series.positions)), np.nan)
    for group, fit in zip(groups, fits, strict=True):
        _add_losses(loss, series, group, fit.predicted_angles)
    return Folds(terms, tuple(fits), final, loss)


def _loops_without(series: Series, group: Sequence[str]) -> list[CrankLoops]:
    """Loops of each state that have no weight at a group of positions."""
    return [loops.some(~_cells(series, k, group)) for k, loops in enumerate(series.loops)]


def _cells(series: Series, state: int, group: Sequence[str]) -> Truth:
    """Cells (n_cells,) of a state at a group of positions."""
    is_any: Truth = np.any([series.cells_of(name)[state] for name in group], axis=0)
    return is_any


def _add_losses(loss: Real, series: Series, group: Sequence[str], predicted_angles: Sequence[Real]) -> None:
    """Write the mean square errors of a group's positions, or of all of a fit in sample, into ``loss``."""
    for name in group or series.positions:
        column = series.positions.index(name)
        for k, cells in enumerate(series.cells_of(name)):
            weight = series.loops[k].weight * cells
            is_training = not group or np.any(series.loops[k].weight * ~_cells(series, k, group))
            if weight.sum() > 0 and is_training:
                error = series.loops[k].angle - predicted_angles[k]
                loss[k, column] = np.sum(weight * error**2) / weight.sum()


def _tried_round(series: Series, base: Folds, names: Sequence[str]) -> list[TriedEffect]:
    """All effects, each added to a base."""
    trials = []
    for name in names:
        trials.append(fold_fits(series, (*base.terms, name), base.final.values))
        say(
            "identify", f"{title(name)}: {trials[-1].rms():.3g} arcmin at unused positions, {base.rms():.3g} without it"
        )
    gains = [np.log(base.loss + LEAST_LOSS) - np.log(trial.loss + LEAST_LOSS) for trial in trials]
    is_known = np.isfinite(base.loss)
    held_out = len(series.positions) >= FEWEST_COMPARED and is_known.sum() >= FEWEST_BLOCKS
    p_family = (
        max_t(np.column_stack([gain[is_known] for gain in gains]), RESAMPLES, SEED)[1]
        if held_out and names
        else np.full(len(names), np.nan)
    )
    effects = []
    for name, trial, gain, p in zip(names, trials, gains, p_family, strict=True):
        p_left_out = _left_out_p(np.nanmean(gain, axis=0)) if held_out else float("nan")
        at_bound = sorted(set(TERMS[name]) & trial.final.at_bound)
        note = next(_reasons(series, held_out, at_bound, float(p), p_left_out), "")
        control = _reversed_rms(series, trial, name) if not note and name in CRANK_EFFECTS else float("nan")
        effects.append(TriedEffect(name, base.terms, trial, float(p), p_left_out, note, control))
    return effects


def _reversed_rms(series: Series, folds: Folds, effect: str) -> float:
    """Root mean square error [arcmin] at positions that were left out, the sign of an effect turned round.

    The other shared numbers are held and each state's own are fitted anew, as they are with the effect.
    """
    loss = np.full_like(folds.loss, np.nan)
    for group, fit in zip(fold_groups(series), folds.fits, strict=True):
        held = reversed_numbers(held_numbers(fit), effect)
        turned = fitted_together(_loops_without(series, group), folds.terms, held)
        _add_losses(loss, series, group, turned.predicted_angles)
    return float(np.sqrt(np.nanmean(loss)))


def _tried_by_states(series: Series, names: Sequence[str]) -> tuple[StateFolds, tuple[TriedEffect, ...]]:
    """Folds over states without and with each effect, beside all that the material may do.

    Members of the class are all that help, that hurt with their sign turned round, and that are not significantly
    worse than the best. It is claimed where one of them predicts unused positions better than without it (t test over
    the states, all effects counted by Bonferroni): the test rejects that none of the effects is there, and which of the
    members is there the data do not say.
    """
    companions = tuple(SOFT)
    folds_without = state_folds(series, companions)
    trials = {name: state_folds(series, (*companions, name), folds_without) for name in names}
    bounds = {name: set(TERMS[name]) & trial.final.at_bound for name, trial in trials.items()}
    gains = {name: _gains(folds_without.loss, trial.loss) for name, trial in trials.items()}
    helping = [
        name
        for name, trial in trials.items()
        if not bounds[name] and gains[name].mean() > 0 > _gains(folds_without.loss, trial.reversed_loss).mean()
    ]
    best_name = min(helping, key=lambda name: trials[name].rms(), default="")
    members = [name for name in helping if _left_out_p(_gains(trials[name].loss, trials[best_name].loss)) >= LEVEL]
    is_shown = any(len(names) * _left_out_p(gains[name]) < LEVEL for name in members)
    effects = []
    for name, trial in trials.items():
        p = _left_out_p(gains[name])
        note = ""
        if bounds[name]:
            note = f"{', '.join(sorted(bounds[name]))} at a bound of the fit"
        elif name not in helping:
            note = "unused positions are not predicted better by the other states, or not worse with its sign reversed"
        elif name not in members:
            note = f"significantly worse than: {title(best_name)}"
        elif not is_shown:
            note = NOT_SHOWN
        family_p, control = min(1.0, len(names) * p), trial.reversed_rms()
        effects.append(TriedEffect(name, companions, trial, family_p, p, note, control))
    return folds_without, tuple(effects)


def _gains(base: Real, loss: Real) -> Real:
    """Mean gain (n_states,) over unused positions: logarithm of mean square errors without over with an effect."""
    gains = np.log(base + LEAST_LOSS) - np.log(loss + LEAST_LOSS)
    gains_of_states: Real = np.nanmean(gains[np.any(np.isfinite(gains), axis=1)], axis=1)
    return gains_of_states


def _reasons(series: Series, held_out: bool, at_bound: Sequence[str], p: float, p_left_out: float) -> Iterator[str]:
    """Why an effect is not claimed."""
    if not held_out:
        yield (
            f"{len(series.positions)} positions in {len(series.states)} states are too few to leave any out: "
            f"a name takes {FEWEST_COMPARED} positions, and {FEWEST_BLOCKS} of all states together"
        )
    elif at_bound:
        yield f"{', '.join(at_bound)} at a bound of the fit"
    elif not (p < LEVEL and p_left_out < LEVEL):
        yield NO_GAIN


def _left_out_p(means: Real) -> float:
    """One-sided p of no mean gain, by mean gains (n,) of the positions or states that were left out."""
    spread = float(means.std(ddof=1)) / np.sqrt(len(means))
    return float(scipy.stats.t.sf(means.mean() / max(spread, LEAST_LOSS), len(means) - 1))


def class_of(round_effects: Sequence[TriedEffect], base: Folds) -> tuple[TriedEffect, ...]:
    """The best effect of a round that is claimed, and its twins that help as much; none where nothing is claimed.

    A twin helps where it predicts better than the ``base`` of the round, whether or not that is significant by itself.
    """
    ordered_effects = sorted(round_effects, key=lambda effect: effect.folds.rms())
    best = next((effect for effect in ordered_effects if effect.is_claimed), None)
    if best is None:
        return ()
    helping = [e for e in ordered_effects if e.note in ("", NO_GAIN) and e.folds.rms() < base.rms()]
    return (best, *(effect for effect in helping if effect is not best and _replaces(effect, best)))


def _replaces(effect: TriedEffect, best_effect: TriedEffect) -> bool:
    """Whether an effect is a twin of the best one, and its losses are not significantly larger.

    What is no twin acts on the loops in another way. It is tried beside the best one in the next round.
    """
    if effect.name not in twins(best_effect.name):
        return False
    gap = np.log(effect.folds.loss + LEAST_LOSS) - np.log(best_effect.folds.loss + LEAST_LOSS)
    return _left_out_p(np.nanmean(gap, axis=0)) >= LEVEL

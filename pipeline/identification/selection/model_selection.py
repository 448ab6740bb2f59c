"""Which effect the data ask for: screening, held-out losses of leave-one-group-out, one test over all effects tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import Model, candidates, limit_cases, twins
from pipeline.identification.selection.cross_validation import Trial, trial
from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE, unsupported
from pipeline.identification.selection.recalibration import STRETCH, released
from pipeline.identification.selection.screening import Promise, screened
from pipeline.statistics.blocks import confidence_set, max_t

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

SHORTLIST = 6
"""Effects that are fitted in full, the best after a few steps."""
NEAR = 1.5
"""Further ones are fitted where their misfit is within this ratio of the best."""
FAMILYWISE = 0.05
"""Chance of naming any effect where there is none, over all that are tried."""
SET_LEVEL = 0.9
"""Confidence of the set of models among which the best one is (Hansen, Lunde and Nason, 2011)."""
LEAST_GAIN = 0.3
"""Fall of the mean square of held-out residuals, in floors, below which a gain is of no use."""
LEAST_SHARE = 0.1
"""The same as a share of what a model leaves."""
ALIKE = 0.05
"""Difference of held-out losses, in squared floors and as a share of what is left, that decides nothing: the form of
the model may cause it."""
FEWEST_BLOCKS = 8
"""Branches below which no effect is accepted: a bootstrap of fewer knows no tail."""
RESAMPLES = 2000
"""Of the block bootstrap: p is known to 0.5 % at 5 %."""
FAR = 3.0
"""The first steps alone are taken of those whose misfit is beyond this ratio of the best."""
FIRST_ITERATIONS = 3
"""Steps of a fit that rank the effects before the best are fitted in full."""
HOPELESS = 0.98
"""Screened misfit in shares of the base's beyond which an effect is not fitted at all."""
ALWAYS, UNPROMISING = 4, 10.0
"""Effects that are fitted in any case, and ratio of a screened misfit to the least that was reached beyond which a
further one is not: three steps reached less than a tenth of what was promised in 2 of 1400 fits of blind units."""
MORE_LOOKED = 4
"""Effects that take those steps beyond the number wanted."""
FURTHER_STARTS = 2
"""Starts of the calibrated numbers within their ranges, beyond the declared one."""
FAR_FROM_DECLARED = 0.3
"""Change of the logarithm of a calibrated number beyond which effects are looked at from the declared one too."""
MOST_NAMED = 2
"""Effects that are named together; more only describe."""
MOST_EFFECTS = 4
"""Effects in one description at most."""
ADDITIONS = 4
"""Effects that are tried on top of the best, those that explain most of what it leaves."""
SEED = 20170
"""Of the bootstrap and of further starts: equal data give an equal verdict."""


@dataclass(frozen=True)
class Selection:
    """What was tried on a set of cells.

    Attributes
    ----------
    base : calibrated numbers and tolerances alone.
    trials : by name of the model.
    screened : (share of the base's misfit) by name of every effect that could be tested.
    t, p : of the gain over the base, p adjusted over all that were tried.
    survivors : models whose gain is significant and of use, best first.
    best : name, or "" without survivors.
    claimed : the best of so few effects that they may be named together, or "".
    members : names of the class of the best.
    unsupported : by name of a model that would be a survivor, why its parameters support no claim.
    stretched : calibrated numbers alone a little outside of their plausible ranges (``recalibration.STRETCH``), where
        they stand at the ends of these: an effect must beat that too. Else None.
    """

    base: Trial
    trials: Mapping[str, Trial]
    screened: Mapping[str, float]
    t: Mapping[str, float]
    p: Mapping[str, float]
    survivors: tuple[str, ...]
    best: str
    claimed: str
    members: tuple[str, ...]
    stretched: Trial | None = None
    unsupported: Mapping[str, str] = field(default_factory=dict)

    @property
    def chosen(self) -> Trial:
        """The best model's trial, or the base's."""
        return self.trials[self.best] if self.best else self.base

    @property
    def answer(self) -> Trial:
        """The trial of the model that may be named, else of the best that describes, else the base's."""
        if self.claimed or self.best or not self.trials or self.base.rms <= STRUCTURE:
            return self.trials[self.claimed] if self.claimed else self.chosen
        return min(self.trials.values(), key=lambda trial: trial.rms)

    @property
    def limit(self) -> float:
        """Held-out rms in floors up to which the best model leaves nothing structured."""
        return float(np.hypot(STRUCTURE, FORM * self.base.rms)) if self.best else STRUCTURE


class Selector:
    """Selections on subsets of one problem's cells."""

    def __init__(self, fitter: Fitter, seen: Truth, most_effects: int = MOST_EFFECTS):
        self.fitter = fitter
        self.problem = fitter.problem
        self.most_effects = most_effects
        self.testable = {
            name: effect for name, effect in candidates().items() if not self.problem.why_not(effect, seen)
        }

    def trained_on(self, training: Truth) -> Selector:
        """A selector that knows nothing of other cells than the training ones (n_cells,), not even their noise.

        It may refit what this one may test: with a position less an effect over the crank angle is still a model.
        """
        fold = Selector(Fitter(self.problem.trained_on(training)), training, self.most_effects)
        fold.testable = self.testable
        return fold

    def screen(self, cells: Truth, base: Fit) -> dict[str, Promise]:
        """What each further effect promises beside ``base``; also beside the declared scales where base is far off."""
        bases = [base]
        if np.max(np.abs(base.unknowns.scales), initial=0.0) > FAR_FROM_DECLARED:
            nothing = np.zeros_like(base.unknowns.scales), np.zeros_like(base.unknowns.modes)
            declared = replace(base.unknowns, scales=nothing[0], modes=nothing[1])
            bases.append(self.fitter.fit(base.model, cells, declared, 0))
        nested = limit_cases()
        held = {effect.name for effect in base.model.effects}
        held |= {name for name, simpler in nested.items() if simpler in held} | {
            nested.get(name, name) for name in held
        }
        return screened(self.fitter, cells, bases, [one for name, one in self.testable.items() if name not in held])

    def trial(self, fit: Fit, cells: Truth) -> Trial:
        """Held-out losses of a fitted model."""
        return trial(self.fitter, fit, cells)

    def select(self, cells: Truth, only: Sequence[str] = ()) -> Selection:
        """Try every effect that the data can test on ``cells`` (n_cells,), or ``only`` some models by their names."""
        base = self.recalibrated(cells)
        base_fit = base.fit
        if base.rms <= STRUCTURE:
            return Selection(base, {}, {}, {}, {}, (), "", "", ())
        stretched = released(self.fitter, base, cells, STRETCH)
        promises = self.screen(cells, base_fit)
        if only:
            known = [name for name in only if all(part in promises for part in name.split("+"))]
            fits = [self._joint_fit(name, cells, promises) for name in known]
        else:
            fits = self.fits(base_fit, cells, promises, SHORTLIST)
        trials = {fit.model.name: self.trial(fit, cells) for fit in fits}
        screened_misfit = {name: promise.misfit for name, promise in promises.items()}
        selection = self._judged(base, trials, screened_misfit, cells, stretched)
        return self.supported(selection, cells) if only else selection

    def recalibrated(self, cells: Truth) -> Trial:
        """Calibrated numbers and tolerances alone; from several starts where the declared one leaves structure."""
        start = self.fitter.start(Model())
        base = self.trial(self.fitter.fit(Model(), cells, start), cells)
        low, high = self.problem.scale_range
        for share in np.random.default_rng(SEED).uniform(size=(FURTHER_STARTS, len(low))):
            if base.rms <= STRUCTURE or not len(low):
                break
            again = self.fitter.fit(Model(), cells, replace(start, scales=low + share * (high - low)))
            if again.sound and again.cost < base.fit.cost:
                base = self.trial(again, cells)
        return base

    def fits(self, base: Fit, cells: Truth, promises: Mapping[str, Promise], count: int) -> list[Fit]:
        """Fits of the ``count`` best additions to a base, and of those that come near: a few steps of all rank them."""
        hopeful = [name for name in promises if promises[name].misfit < HOPELESS]
        hopeful = sorted(hopeful, key=lambda name: promises[name].misfit)[: count + MORE_LOOKED]
        first: list[Fit] = []
        for rank, name in enumerate(hopeful):
            reached = min((fit.cost for fit in first), default=np.inf)
            if rank >= ALWAYS and promises[name].misfit * base.cost > UNPROMISING * reached:
                break
            model = Model((*base.model.effects, self.testable[name]))
            starts = promises[name].starts
            tried = [self.fitter.fit(model, cells, start, FIRST_ITERATIONS, base) for start in starts]
            first += sorted((fit for fit in tried if np.isfinite(fit.cost) and fit.sound), key=lambda fit: fit.cost)[:1]
        first.sort(key=lambda fit: fit.cost)
        near = [fit for k, fit in enumerate(first[: 2 * count]) if k < count or fit.cost < NEAR * first[0].cost]
        return [
            self.fitter.fit(fit.model, cells, fit.unknowns, near=fit) if fit.cost < FAR * first[0].cost else fit
            for fit in near
        ]

    def refitted(self, model: Model, cells: Truth, base: Fit) -> Fit:
        """A model fitted to some cells from what they alone show, effect by effect on top of a base.

        An effect of which these cells show nothing stays out. Once more from numbers and tolerances as declared:
        without its effect a base may have gone far to stand in for it.
        """
        fit = base
        for effect in model.effects:
            promises = screened(self.fitter, cells, [fit], [effect])
            fit = next(iter(self.fits(fit, cells, promises, 1)), fit)
        declared = self.fitter.start(fit.model, fit.unknowns.shares)
        again = self.fitter.fit(fit.model, cells, declared) if fit.model.effects else fit
        return again if again.sound and again.cost < fit.cost else fit

    def _joint_fit(self, name: str, cells: Truth, promises: Mapping[str, Promise]) -> Fit:
        """Fit of a model by the names of its effects, from what the screening found of each."""
        parts = name.split("+")
        model = Model(tuple(self.testable[part] for part in parts))
        shares = np.concatenate([promises[part].starts[0].shares for part in parts])
        return self.fitter.fit(model, cells, replace(promises[parts[0]].starts[0], shares=shares))

    def extended(self, selection: Selection, cells: Truth) -> Selection:
        """The selection with effects added to its best, one at a time, until nothing structured is left.

        What is left by the best model is screened for every other effect; an addition stays if it gains significantly.
        """
        for _ in range(self.most_effects - 1):
            if not selection.best or selection.chosen.rms <= selection.limit:
                break
            now = selection.chosen.fit
            fits = self.fits(now, cells, self.screen(cells, now), ADDITIONS)
            trials = {**selection.trials, **{fit.model.name: self.trial(fit, cells) for fit in fits}}
            before = selection.best
            selection = self._judged(selection.base, trials, selection.screened, cells, selection.stretched)
            if selection.best == before:
                break
            trials = {**selection.trials, **self._without(selection, cells)}
            selection = self._judged(selection.base, trials, selection.screened, cells, selection.stretched)
        return self.supported(self._with_twins(selection, cells), cells)

    def _with_twins(self, selection: Selection, cells: Truth) -> Selection:
        """The selection once every twin of each effect of its best was fitted in the place of that effect."""
        if not selection.best or selection.chosen.fit.model.n_effects > MOST_NAMED:
            return selection
        effects = selection.chosen.fit.model.effects
        trials = dict(selection.trials)
        for effect in effects:
            others = Model(tuple(other for other in effects if other is not effect))
            alike = {name: self.testable[name] for name in twins(effect.name) if name in self.testable}
            missing = [twin for twin in alike.values() if Model((*others.effects, twin)).name not in trials]
            missing = [twin for twin in missing if twin not in others.effects]
            if not missing:
                continue
            beside = trials[others.name].fit if others.name in trials else selection.base.fit
            if beside.model.name != others.name:
                beside = self.fitter.fit(others, cells, self.fitter.start(others))
            promises = screened(self.fitter, cells, [beside], missing)
            trials |= {
                fit.model.name: self.trial(fit, cells) for fit in self.fits(beside, cells, promises, len(missing))
            }
        if len(trials) == len(selection.trials):
            return selection
        return self._judged(selection.base, trials, selection.screened, cells, selection.stretched)

    def supported(self, selection: Selection, cells: Truth) -> Selection:
        """The selection among models whose parameters support a claim.

        Asked for at last: beside an effect that is still missing, the interval of one that is there reaches zero. A
        model must be a part of the best of all or explain as much: else it would be named for want of numbers alone.
        """
        trials, useful = selection.trials, selection.survivors
        reasons = {name: self.why_no_claim(trials[name], cells, selection.base) for name in useful}
        goals = [name for name in (selection.best, selection.claimed) if name]
        supported = [name for name in useful if not reasons[name]]
        survivors = tuple(name for name in supported if any(_stands_for(name, goal, trials) for goal in goals))
        left_out = {name: reason for name, reason in reasons.items() if reason}
        return replace(self._with_best(selection, survivors, cells), unsupported=left_out)

    def _without(self, selection: Selection, cells: Truth) -> dict[str, Trial]:
        """Trials of the best model less one of its effects, or with a simpler one in its place, from where it stands.

        The first effect that was taken may have been wrong.
        """
        fit, found = selection.chosen.fit, {}
        parts = fit.model.split(fit.unknowns.shares.tolist())
        for number, (effect, shares) in enumerate(parts):
            simpler = effect.limit_case
            for own in [[], [(self.testable[simpler], shares[:1])]] if simpler else [[]]:
                kept = [*parts[:number], *own, *parts[number + 1 :]]
                model = Model(tuple(one for one, _ in kept))
                start = replace(fit.unknowns, shares=np.array([share for _, some in kept for share in some]))
                again = self.trial(self.fitter.fit(model, cells, start), cells)
                if model.name not in selection.trials or again.rms < selection.trials[model.name].rms:
                    found[model.name] = again
        return found

    def _judged(
        self,
        base: Trial,
        trials: Mapping[str, Trial],
        screened: Mapping[str, float],
        cells: Truth,
        stretched: Trial | None = None,
    ) -> Selection:
        names = list(trials)
        if not names or len(base.losses) < FEWEST_BLOCKS or base.rms <= STRUCTURE:
            return Selection(base, trials, screened, {}, {}, (), "", "", (), stretched)
        t, p = max_t(np.column_stack([base.scores - trials[name].scores for name in names]), RESAMPLES, SEED)
        before = min(base.rms, stretched.rms if stretched else np.inf)
        gain = np.array([before**2 - trials[name].rms ** 2 for name in names])
        useful = (p <= FAMILYWISE) & (gain >= LEAST_GAIN)
        for k, name in enumerate(names):
            fit = trials[name].fit
            useful[k] = useful[k] and not self.problem.within_tolerance(fit.model, fit.values.tolist())
        scores = np.array([trials[name].scores.mean() for name in names])
        survivors = [names[k] for k in np.argsort(scores) if useful[k]]
        t_of, p_of = (dict(zip(names, values.tolist(), strict=True)) for values in (t, p))
        judged = Selection(base, trials, screened, t_of, p_of, (), "", "", (), stretched)
        return self._with_best(judged, tuple(survivors), cells)

    def _with_best(self, selection: Selection, survivors: tuple[str, ...], cells: Truth) -> Selection:
        """The selection with its best, what of it may be claimed, and its class, among the survivors."""
        trials = selection.trials
        best = self._best(survivors, trials, self.most_effects)
        claimed = best if best and trials[best].fit.model.n_effects <= MOST_NAMED else ""
        claimed = claimed or self._best(survivors, trials, MOST_NAMED)
        members = self._members(best, survivors, trials, cells) if best else ()
        return replace(selection, survivors=survivors, best=best, claimed=claimed, members=members)

    def why_no_claim(self, tried: Trial, cells: Truth, base: Trial) -> str:
        """Why the parameters of a model that gains over ``base`` support no claim, or "".

        A single effect that leaves nothing structured was tested against its absence by that gain.
        """
        explains = tried.fit.model.n_effects == 1 and tried.rms <= float(np.hypot(STRUCTURE, FORM * base.rms))
        return unsupported(self.fitter, tried.fit, cells, base.rms, present=explains)

    def _best(self, survivors: Sequence[str], trials: Mapping[str, Trial], most_effects: int) -> str:
        """Least held-out loss; more effects only where they gain significantly over the best with fewer."""
        best = ""
        for count in range(1, most_effects + 1):
            alike = [name for name in survivors if trials[name].fit.model.n_effects == count]
            if not alike:
                continue
            if best:
                least = max(LEAST_GAIN, LEAST_SHARE * trials[best].rms ** 2)
                if not self._gains(trials[best], trials[alike[0]], least, claimed=count <= MOST_NAMED):
                    continue
            best = alike[0]
            simpler = _simplest(best)
            least = _alike(trials[best])
            if simpler != best and simpler in alike and not self._gains(trials[simpler], trials[best], least):
                best = simpler
        return best

    @staticmethod
    def _gains(before: Trial, after: Trial, least: float, claimed: bool = True) -> bool:
        """Whether a model is better than a simpler one by ``least`` in squared floors, if ``claimed`` not by chance."""
        _, p = max_t((before.scores - after.scores)[:, None], RESAMPLES, SEED)
        of_use = before.rms**2 - after.rms**2 >= least
        return bool(of_use and (p[0] <= FAMILYWISE or not claimed))

    def _members(
        self, best: str, survivors: Sequence[str], trials: Mapping[str, Trial], cells: Truth
    ) -> tuple[str, ...]:
        """The best and those of the confidence set whose predictions over the cells differ by less than the floor."""
        alike = [name for name in survivors if trials[name].fit.model.n_effects == trials[best].fit.model.n_effects]
        data = self.problem.data
        _, first = np.unique(data.block[cells], return_index=True)
        _, branch = np.unique(data.branch[cells][first], return_inverse=True)
        scores = [np.bincount(branch, trials[name].scores) / np.bincount(branch) for name in alike]
        kept = confidence_set(np.column_stack(scores), SET_LEVEL, RESAMPLES, SEED)
        sigma = data.sigma
        members = []
        for name, inside in zip(alike, kept, strict=True):
            apart = (trials[name].fit.predicted - trials[best].fit.predicted)[cells] / sigma[cells]
            behind = trials[name].rms ** 2 - trials[best].rms ** 2
            if name == best or ((inside or behind < _alike(trials[best])) and np.sqrt(np.mean(apart**2)) < 1):
                members.append(name)
        return tuple(name for name in members if _simplest(name) == name or _simplest(name) not in members)


def _stands_for(name: str, goal: str, trials: Mapping[str, Trial]) -> bool:
    """Whether a model has but effects of another one, or explains as much."""
    behind = trials[name].rms ** 2 - trials[goal].rms ** 2
    return set(name.split("+")) <= set(goal.split("+")) or behind < _alike(trials[goal])


def _alike(trial: Trial) -> float:
    """Difference of mean losses that decides nothing, in squared floors."""
    return float(ALIKE * max(1.0, trial.rms**2))


def _simplest(name: str) -> str:
    """Name of a model with the simpler of nested effects in their place: they are not needed where it does as well."""
    nested = limit_cases()
    return "+".join(sorted(nested.get(part, part) for part in name.split("+")))

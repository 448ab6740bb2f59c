"""Which effect the data ask for: screening, held-out losses of leave-one-group-out, one test over all effects tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, Vector
from pipeline.identification.fitting.problem import Model, candidates, limit_cases, twins
from pipeline.identification.selection.cross_validation import Trial, trial
from pipeline.identification.selection.judgement import MOST_NAMED, SEED, Judge, Selection, stands_for
from pipeline.identification.selection.model_parts import less, of_parts
from pipeline.identification.selection.pairs import promising_pairs
from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE, shortcomings, unsupported
from pipeline.identification.selection.recalibration import STRETCH, released
from pipeline.identification.selection.screening import Promise, screened

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

SHORTLIST = 6
"""Effects that are fitted in full, the best after a few steps."""
NEAR = 1.5
"""Further ones, and further starts, are fitted where their misfit is within this ratio of the best."""
FAR = 3.0
"""The first steps alone are taken of those whose misfit is beyond this ratio of the best."""
FIRST_ITERATIONS = 3
"""Steps of a fit that rank the effects before the best are fitted in full."""
FIRST_SHARE, EDGE = 0.1, 0.01
"""Share of its bounds by which a parameter starts off no effect in either sense, and least one from a bound."""
HOPELESS = 0.98
"""Screened misfit in shares of the base's beyond which an effect is not fitted at all."""
ALWAYS, UNPROMISING = 4, 10.0
"""Effects that are fitted in any case, and ratio of a screened misfit to the least that was reached beyond which a
further one is not: three steps reached less than a tenth of what was promised in 2 of 1400 fits of blind units."""
MORE_LOOKED = 4
"""Effects that take those steps beyond the number wanted."""
FURTHER_STARTS = 2
"""Starts of the calibrated numbers within their ranges, beyond the declared one."""
APART = 0.5
"""Standard deviations of the priors from which a fit from a further start is not on its way to where one ended already.
"""
FAR_FROM_DECLARED = 0.3
"""Change of the logarithm of a calibrated number beyond which effects are looked at from the declared one too."""
MOST_EFFECTS = 4
"""Effects in one description at most."""
PAIRS = 4
"""Pairs of effects that are fitted where no single one explains the unit."""
ADDITIONS = 4
"""Effects that are tried on top of the best, those that explain most of what it leaves."""


class Selector(Judge):
    """Selections on subsets of one problem's cells."""

    def __init__(self, fitter: Fitter, visible: Truth, most_effects: int = MOST_EFFECTS):
        self.fitter = fitter
        self.problem = fitter.problem
        self.most_effects = most_effects
        self.testable = {
            name: effect for name, effect in candidates().items() if not self.problem.why_not(effect, visible)
        }

    def trained_on(self, training: Truth) -> Selector:
        """A selector that knows nothing of other cells than the training ones (n_cells,), not even their noise.

        It may refit what this one may test: with a position less an effect over the crank angle is still a model.
        """
        fold = Selector(Fitter(self.problem.trained_on(training)), training, self.most_effects)
        fold.testable = self.testable
        return fold

    def screen(self, cells: Truth, base: Fit, offered_names: Sequence[str] = ()) -> dict[str, Promise]:
        """What each further effect promises beside ``base``; also beside the declared scales where base is far off.

        Of ``offered_names``, names of models, the effects alone are looked at, where any are given.
        """
        bases = [base]
        if np.max(np.abs(base.unknowns.scales), initial=0.0) > FAR_FROM_DECLARED:
            zero_steps = np.zeros_like(base.unknowns.scales), np.zeros_like(base.unknowns.modes)
            declared = replace(base.unknowns, scales=zero_steps[0], modes=zero_steps[1])
            bases.append(self.fitter.fit(base.model, cells, declared, 0))
        nested = limit_cases()
        included = {effect.name for effect in base.model.effects}
        included |= {name for name, simpler in nested.items() if simpler in included} | {
            nested.get(name, name) for name in included
        }
        wanted_parts = {part for name in offered_names for part in name.split("+")} or set(self.testable)
        effects = [effect for name, effect in self.testable.items() if name in wanted_parts - included]
        return screened(self.fitter, cells, bases, effects)

    def trial(self, fit: Fit, cells: Truth) -> Trial:
        """Held-out losses of a fitted model."""
        return trial(self.fitter, fit, cells)

    def select(self, cells: Truth, offered_names: Sequence[str] = ()) -> Selection:
        """Try every effect that the data can test on ``cells`` (n_cells,), or the models ``offered_names``."""
        base = self.recalibrated(cells)
        base_fit = base.fit
        if base.rms <= STRUCTURE:
            return Selection(base, {}, {}, {}, {}, (), "", "", ())
        stretched = released(self.fitter, base, cells, STRETCH)
        promises = self.screen(cells, base_fit, offered_names)
        if offered_names:
            known_names = [name for name in offered_names if all(part in promises for part in name.split("+"))]
            first_fits = [self._joint_fit(name, cells, promises, base_fit) for name in known_names]
            fits = _completed(self.fitter, first_fits, cells)
        else:
            fits = self.fits(base_fit, cells, promises, SHORTLIST)
        trials = {fit.model.name: self.trial(fit, cells) for fit in fits}
        screened_misfit = {name: promise.misfit for name, promise in promises.items()}
        selection = self.judged(base, trials, screened_misfit, cells, stretched)
        return self.supported(selection, cells) if offered_names else self._with_pairs(selection, cells, promises)

    def recalibrated(self, cells: Truth) -> Trial:
        """Calibrated numbers and tolerances alone; from several starts where the declared one leaves structure."""
        start = self.fitter.start(Model())
        base = self.trial(self.fitter.fit(Model(), cells, start), cells)
        low, high = self.problem.scale_range
        for share in np.random.default_rng(SEED).uniform(size=(FURTHER_STARTS, len(low))):
            if base.rms <= STRUCTURE or not len(low):
                break
            further_start = replace(start, scales=low + share * (high - low))
            refit = self.fitter.fit(Model(), cells, further_start, FIRST_ITERATIONS)
            distance = np.abs(refit.unknowns.scales - base.fit.unknowns.scales) / self.problem.scale_spread
            if np.all(distance < APART) or refit.cost > NEAR * base.fit.cost:
                continue
            refit = self.fitter.fit(Model(), cells, refit.unknowns, base_fit=refit)
            if refit.sound and refit.cost < base.fit.cost:
                base = self.trial(refit, cells)
        return base

    def fits(self, base: Fit, cells: Truth, promises: Mapping[str, Promise], count: int) -> list[Fit]:
        """Fits of the ``count`` best additions to a base, and of those that come near: a few steps of all rank them."""
        hopeful = [name for name in promises if promises[name].misfit < HOPELESS]
        hopeful = sorted(hopeful, key=lambda name: promises[name].misfit)[: count + MORE_LOOKED]
        first_fits: list[Fit] = []
        for rank, name in enumerate(hopeful):
            least_cost = min((fit.cost for fit in first_fits), default=np.inf)
            if rank >= ALWAYS and promises[name].misfit * base.cost > UNPROMISING * least_cost:
                break
            model = Model((*base.model.effects, self.testable[name]))
            first_fits.append(_first_steps(self.fitter, model, cells, promises[name].starts, base))
        first_fits = sorted((fit for fit in first_fits if np.isfinite(fit.cost)), key=lambda fit: fit.cost)
        promising = [
            fit for k, fit in enumerate(first_fits[: 2 * count]) if k < count or fit.cost < NEAR * first_fits[0].cost
        ]
        return _completed(self.fitter, promising, cells)

    def refitted(self, model: Model, cells: Truth, base: Fit) -> Fit:
        """A model fitted to some cells from what they alone show, effect by effect on top of a base.

        From every start, those beside the declared numbers too: of a base that lacks its effect they stand in for it,
        and a fit from there alone may end where they do. Once more from numbers and tolerances as declared for the same
        reason. An effect that lowers nothing stays out.
        """
        fit = base
        for effect in model.effects:
            promise = self.screen(cells, fit, (effect.name,)).get(effect.name)
            extended_model = Model((*fit.model.effects, effect))
            starts = [*(promise.starts if promise else ()), self._from_declared(extended_model, cells, fit.unknowns)]
            trial_fits = [self.fitter.fit(extended_model, cells, start) for start in starts]
            fit = min([fit, *(trial_fit for trial_fit in trial_fits if trial_fit.sound)], key=lambda fit: fit.cost)
        declared = self.fitter.start(fit.model, fit.unknowns.shares)
        refit = self.fitter.fit(fit.model, cells, declared) if fit.model.effects else fit
        return refit if refit.sound and refit.cost < fit.cost else fit

    def _joint_fit(self, name: str, cells: Truth, promises: Mapping[str, Promise], base: Fit) -> Fit:
        """First steps of a model by the names of its effects, from what the screening found of each beside a base."""
        parts = name.split("+")
        starts: Sequence[Vector] = promises[parts[0]].starts
        if len(parts) > 1:
            shares = np.concatenate([promises[part].starts[0].shares for part in parts])
            starts = (replace(starts[0], shares=shares),)
        return _first_steps(self.fitter, Model(tuple(self.testable[part] for part in parts)), cells, starts, base)

    def _from_declared(self, model: Model, cells: Truth, base: Vector) -> Vector:
        """Where a fit leads that holds calibrated numbers as declared: of all senses of the last effect the best.

        The numbers are near there by their plausible ranges, while those of a base may be at the ends of them.
        """
        bounds = self.problem.bounds(model.effects[-1])
        declared = self.fitter.start(model, np.concatenate([base.shares, np.full(len(bounds), 0.5)]))
        zero = self.fitter.centre(model, declared)[len(declared.scales) :][: model.n_parameters]
        held = replace(declared, reach=np.zeros_like(declared.reach))
        fits = []
        for senses in product((-1.0, 1.0), repeat=len(bounds)):
            shares = np.clip(zero[-len(bounds) :] + FIRST_SHARE * np.array(senses), EDGE, 1 - EDGE)
            start = replace(held, shares=np.concatenate([base.shares, shares]))
            fits.append(self.fitter.fit(model, cells, start, FIRST_ITERATIONS))
        return replace(min(fits, key=lambda fit: fit.cost).unknowns, reach=declared.reach)

    def extended(self, selection: Selection, cells: Truth) -> Selection:
        """The selection with effects added to its best, one at a time, until nothing structured is left.

        What is left by the best model is screened for every other effect; an addition stays if it gains significantly.
        """
        for _ in range(self.most_effects - 1):
            if not selection.best or selection.chosen.rms <= selection.limit:
                break
            current_fit = selection.chosen.fit
            fits = self.fits(current_fit, cells, self.screen(cells, current_fit), ADDITIONS)
            trials = {**selection.trials, **{fit.model.name: self.trial(fit, cells) for fit in fits}}
            best_before = selection.best
            selection = self.judged(selection.base, trials, selection.screened, cells, selection.stretched)
            if selection.best == best_before:
                break
            trials = {**selection.trials, **self._without(selection, cells)}
            selection = self.judged(selection.base, trials, selection.screened, cells, selection.stretched)
        selection = self._relieved(self._simplified(selection, cells), cells)
        return self.supported(self._with_twins(selection, cells), cells)

    def _simplified(self, selection: Selection, cells: Truth) -> Selection:
        """The selection once effects of its best were tried as their limit cases, from where the best stands.

        The fit of a limit case from the base, which went far to stand in for it, may have ended in a minimum far off.
        """
        if not selection.best:
            return selection
        fit, trials = selection.chosen.fit, dict(selection.trials)
        parts = fit.model.split(fit.unknowns.shares.tolist())
        for number, (effect, shares) in enumerate(parts):
            simpler = self.testable.get(effect.limit_case)
            if simpler is not None and simpler not in fit.model.effects:
                model, start = of_parts(fit, [*parts[:number], (simpler, shares[:1]), *parts[number + 1 :]])
                simpler_trial = self.trial(self.fitter.fit(model, cells, start), cells)
                if model.name not in trials or simpler_trial.rms < trials[model.name].rms:
                    trials[model.name] = simpler_trial
        if all(trials[name] is selection.trials.get(name) for name in trials):
            return selection
        return self.judged(selection.base, trials, selection.screened, cells, selection.stretched)

    def _relieved(self, selection: Selection, cells: Truth) -> Selection:
        """The selection once models that come near the best were fitted without an effect that supports no claim there.

        The first effect taken may stand for others: with them its interval reaches zero, and only they may be claimed.
        """
        while selection.survivors:
            trials = selection.trials
            reduced_trials: dict[str, Trial] = {}
            least_loss = min(trials[name].rms ** 2 for name in selection.survivors)
            for name in selection.survivors:
                fit = trials[name].fit
                if fit.model.n_effects == 1 or trials[name].rms ** 2 > NEAR * least_loss:
                    continue
                for effect_name in dict(shortcomings(self.fitter, fit, cells, selection.base.rms)):
                    reduced_model, start = less(fit, effect_name)
                    if reduced_model.name not in {*trials, *reduced_trials}:
                        reduced_fit = self.fitter.fit(reduced_model, cells, start)
                        reduced_trials[reduced_model.name] = self.trial(reduced_fit, cells)
            if not reduced_trials:
                break
            trials = {**trials, **reduced_trials}
            selection = self.judged(selection.base, trials, selection.screened, cells, selection.stretched)
        return selection

    def _with_pairs(self, selection: Selection, cells: Truth, promises: Mapping[str, Promise]) -> Selection:
        """The selection once the most promising pairs were fitted, where no single effect explains the unit."""
        if not selection.trials or selection.chosen.rms <= selection.limit:
            return selection
        pairs = promising_pairs(self.fitter, cells, selection.base.fit, promises, self.testable, PAIRS)
        fits = [self.fitter.fit(model, cells, start) for model, start in pairs]
        trials = {**selection.trials, **{fit.model.name: self.trial(fit, cells) for fit in fits}}
        return self.judged(selection.base, trials, selection.screened, cells, selection.stretched)

    def _with_twins(self, selection: Selection, cells: Truth) -> Selection:
        """The selection once every twin of each effect of its best was fitted in the place of that effect."""
        if not selection.best or selection.chosen.fit.model.n_effects > MOST_NAMED:
            return selection
        effects = selection.chosen.fit.model.effects
        trials = dict(selection.trials)
        for effect in effects:
            reduced_model = Model(tuple(member for member in effects if member is not effect))
            twin_effects = {name: self.testable[name] for name in twins(effect.name) if name in self.testable}
            missing = [twin for twin in twin_effects.values() if twin not in reduced_model.effects]
            missing = [twin for twin in missing if Model((*reduced_model.effects, twin)).name not in trials]
            if not missing:
                continue
            reduced_fit = trials[reduced_model.name].fit if reduced_model.name in trials else selection.base.fit
            if reduced_fit.model.name != reduced_model.name:
                reduced_fit = self.fitter.fit(reduced_model, cells, self.fitter.start(reduced_model))
            promises = screened(self.fitter, cells, [reduced_fit], missing)
            trials |= {
                fit.model.name: self.trial(fit, cells) for fit in self.fits(reduced_fit, cells, promises, len(missing))
            }
        if len(trials) == len(selection.trials):
            return selection
        return self.judged(selection.base, trials, selection.screened, cells, selection.stretched)

    def supported(self, selection: Selection, cells: Truth) -> Selection:
        """The selection among models whose parameters support a claim.

        Asked for at last: beside an effect that is still missing, the interval of one that is there reaches zero. A
        model must be a part of the best of all or explain as much: else it would be named for want of numbers alone.
        """
        trials, useful = selection.trials, selection.survivors
        reasons = {name: self.why_no_claim(trials[name], cells, selection.base) for name in useful}
        goals = [name for name in (selection.best, selection.claimed) if name]
        supported = [name for name in useful if not reasons[name]]
        survivors = tuple(name for name in supported if any(stands_for(name, goal, trials) for goal in goals))
        left_out = {name: reason for name, reason in reasons.items() if reason}
        return replace(self.with_best(selection, survivors, cells), unsupported=left_out)

    def _without(self, selection: Selection, cells: Truth) -> dict[str, Trial]:
        """Trials of the best model less one of its effects, or with a simpler one in its place, from where it stands.

        The first effect that was taken may have been wrong.
        """
        fit, reduced_trials = selection.chosen.fit, {}
        parts = fit.model.split(fit.unknowns.shares.tolist())
        for number, (effect, shares) in enumerate(parts):
            simpler = effect.limit_case
            for replacement in [[], [(self.testable[simpler], shares[:1])]] if simpler else [[]]:
                model, start = of_parts(fit, [*parts[:number], *replacement, *parts[number + 1 :]])
                reduced_trial = self.trial(self.fitter.fit(model, cells, start), cells)
                if model.name not in selection.trials or reduced_trial.rms < selection.trials[model.name].rms:
                    reduced_trials[model.name] = reduced_trial
        return reduced_trials

    def why_no_claim(self, candidate_trial: Trial, cells: Truth, base: Trial) -> str:
        """Why the parameters of a model that gains over ``base`` support no claim, or "".

        A single effect that leaves nothing structured was tested against its absence by that gain.
        """
        explains = candidate_trial.fit.model.n_effects == 1 and candidate_trial.rms <= float(
            np.hypot(STRUCTURE, FORM * base.rms)
        )
        return unsupported(self.fitter, candidate_trial.fit, cells, base.rms, present=explains)


def _first_steps(fitter: Fitter, model: Model, cells: Truth, starts: Sequence[Vector], base: Fit) -> Fit:
    """First steps of a model from where they lead farthest; of an infinite cost where no equilibrium was found."""
    first_fits = [fitter.fit(model, cells, start, FIRST_ITERATIONS, base) for start in starts]
    first_fits = [fit if fit.sound else replace(fit, cost=np.inf) for fit in first_fits]
    return min(first_fits, key=lambda fit: fit.cost)


def _completed(fitter: Fitter, first_fits: Sequence[Fit], cells: Truth) -> list[Fit]:
    """Fits after their first steps, fitted in full where these do not leave them far behind the best."""
    least_cost = min((fit.cost for fit in first_fits), default=np.inf)
    return [
        fitter.fit(fit.model, cells, fit.unknowns, base_fit=fit) if fit.cost < FAR * least_cost else fit
        for fit in first_fits
    ]

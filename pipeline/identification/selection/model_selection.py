"""What is tried on a unit: every effect that the data can test, and the most promising pairs."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Truth
from pipeline.constant_kinds import Shortcut, ShortcutCount
from pipeline.identification.fitting.fitter import FALL_OF_PASS, FIRST_ITERATIONS, ITERATIONS, WELL_FITTED, Fitter
from pipeline.identification.fitting.least_squares import TRIES
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import Candidate, Model, candidates, twins, with_limit_cases
from pipeline.identification.selection.covariance import Covariance, parts_of
from pipeline.identification.selection.criteria import (
    MOST_NAMED,
    NAMED_ODDS,
    ODDS,
    Judge,
    Selection,
    Trial,
    best_of,
    least_fall,
    most_probable,
    odds_over_fewer,
)
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.pairs import promising_pairs
from pipeline.identification.selection.ripples import refined_ripple
from pipeline.identification.selection.screening import (
    RIVAL,
    Promise,
    promising_effects,
    screen_effects,
    start_from_declared,
)

FAR_FROM_DECLARED: Shortcut = 0.3
"""Change of the logarithm of a calibrated number beyond which effects are looked at from the declared one too."""
PAIRS: ShortcutCount = 10
"""Pairs of effects that are fitted, those that promise most beside the model without effects."""
ADDITIONS: ShortcutCount = 4
"""Effects that are tried on top of the best, those that explain most of what it leaves."""
MOST_REFINED: ShortcutCount = 3
"""Models of as many effects whose fits are refined, the most probable ones."""
RESTARTS: ShortcutCount = 6
"""Fits of the model without effects from unknowns drawn from its posterior, where a name is close."""
CLOSE_ODDS: Shortcut = 25.0
"""Odds up to which a name is close, and gain that a rival's steps may bring: fits of one model differ by as much."""
LARGEST_GAIN: Shortcut = 200.0
"""Gain of the logarithm of the evidence that other starts or steps may bring; models that lack more are left."""
LEAST_GAIN: Shortcut = 1.0
"""Gain of the logarithm of the evidence from which another step is taken, or everything is tried beside a new base."""


class Tries(NamedTuple):
    """Cells (n_cells,) to which models are fitted, their covariance, and the rule on what is tried."""

    cells: Truth
    covariance: Covariance
    judge: Judge


class Selector:
    """Selections on subsets of one problem's cells."""

    def __init__(self, fitter: Fitter, visible: Truth):
        self.fitter, self.problem = fitter, fitter.problem
        self.testable = self.problem.candidates_for(candidates(), visible)

    def trained_on(self, training: Truth) -> "Selector":
        """A selector that knows nothing of other cells than the training ones (n_cells,), not even their noise.

        It may refit what this one may test: with a position less an effect over the crank angle is still a model.
        """
        fold = Selector(Fitter(self.problem.trained_on(training)), training)
        fold.testable = self.testable
        return fold

    def screen(self, cells: Truth, base: Fit, offered_names: Collection[str] = ()) -> dict[str, Promise]:
        """What effects (all, or those offered) promise beside ``base``, and beside the declared scales if far off."""
        bases = [base]
        if np.max(np.abs(base.unknowns.scales), initial=0.0) > FAR_FROM_DECLARED:
            as_declared = replace(base.unknowns, scales=0 * base.unknowns.scales, modes=0 * base.unknowns.modes)
            bases.append(self.fitter.fit(base.model, cells, as_declared, 0))
        effects = self._further_effects(base)
        offered = [effect for name, effect in effects.items() if not offered_names or name in offered_names]
        return screen_effects(self.fitter, cells, bases, offered)

    def _further_effects(self, fit: Fit) -> dict[str, Candidate]:
        """Effects that may be added to a fit: neither those of its model nor what these become at a limit."""
        names = with_limit_cases(effect.name for effect in fit.model.effects)
        return {name: effect for name, effect in self.testable.items() if name not in names}

    def tries(self, cells: Truth) -> Tries:
        """What models are fitted to and judged by."""
        covariance = Covariance(self.problem.data, cells, parts_of(self.problem.data, cells))
        return Tries(cells, covariance, Judge(self.fitter, cells, len(self.testable)))

    def trial(self, fit: Fit, covariance: Covariance, base: Trial | None = None) -> Trial:
        """A fitted model with its evidence."""
        evidence = Evidence(covariance, self.fitter, fit, base.evidence.structure if base else None)
        return Trial(fit, evidence, covariance.rms(fit.predicted_angle))

    def select(self, cells: Truth) -> Selection:
        """Try every effect that the data can test on ``cells`` (n_cells,), and the pairs that promise most.

        A fit with an effect may lead to numbers that are more probable without it. If a name does not hold beside them,
        everything is tried anew: its start must not decide. Where nothing was named, only the effects are that lack
        less than the gain of these numbers to a name.
        """
        base_fit, former, selection = self.recalibrate(cells), -np.inf, None
        close_names: set[str] = set()
        while True:
            selection = self._beside(base_fit, cells, selection if close_names else None, close_names)
            base, value = self._without_effects(selection, cells), selection.base.evidence.value
            if base is selection.base or value <= former:
                return selection
            challenged = self.tries(cells).judge.select(base, selection.trials, selection.promised_misfits)
            gained_odds = max(selection.odds.values(), default=-np.inf) + base.evidence.value - value
            if challenged.members == selection.members and (selection.members or gained_odds < NAMED_ODDS):
                return challenged
            base_fit, former, gain = base.fit, value, base.evidence.value - value
            close_names = set() if selection.members else _close_effects(selection, gain)

    def _without_effects(self, selection: Selection, cells: Truth) -> Trial:
        """The most probable model without effects: the base, or a fit that starts where models with effects ended.

        Fits start at the numbers and tolerances of the most probable model. Where something is named, they start at
        those of all models about as probable, of the model whose end a few steps lead farthest, and of draws if the
        name is close; these are refined, since a plain fit ends at kinks.
        """
        odds, base_evidence = selection.odds, selection.base.evidence
        least_odds = odds.get(selection.claimed_model, -np.inf) + base_evidence.value - base_evidence.promised_value
        if least_odds > LARGEST_GAIN:
            return selection.base
        leaders = sorted(odds, key=lambda name: -odds[name])[: MOST_REFINED if selection.members else 1]
        leaders = [name for name in leaders if odds[name] >= odds[leaders[0]] - ODDS]
        fits = [self._fit_without_effects(selection.trials[name].fit, cells) for name in leaders]
        if selection.members:
            ends = [trial.fit for name, trial in selection.trials.items() if name not in leaders]
            first_steps = [self._fit_without_effects(end, cells, FIRST_ITERATIONS) for end in ends]
            fits += sorted(first_steps, key=lambda fit: fit.cost)[:1]
            if odds[selection.claimed_model] < CLOSE_ODDS:
                drawn = map(selection.base.fit.unknowns.like, base_evidence.drawn(RESTARTS))
                fits += [self.fitter.fit_by_load(Model(), cells, start) for start in drawn]
            fits = [self.fitter.refine(fit, cells, fit.unknowns) for fit in fits]
        trials = (self.trial(fit, base_evidence.covariance, selection.base) for fit in fits if fit.sound)
        best = most_probable([selection.base, *map(self.at_most_probable, trials)])
        value, of_base = (trial.evidence.without_promise().value for trial in (best, selection.base))
        return best if value - of_base > LEAST_GAIN else selection.base

    def _fit_without_effects(self, fit: Fit, cells: Truth, iterations: int = ITERATIONS) -> Fit:
        """The model without effects, fitted from the numbers and tolerances of another model's fit."""
        start = replace(self.fitter.start(Model()), scales=fit.unknowns.scales, modes=fit.unknowns.modes)
        return self.fitter.fit(Model(), cells, start, iterations)

    def _beside(
        self, base_fit: Fit, cells: Truth, former: Selection | None = None, names: Collection[str] = ()
    ) -> Selection:
        """The selection beside a fit without effects: of all effects, or of those named beside what was tried before.

        The more probable fit of a model counts, from this base or from the ``former`` one.
        """
        tries = self.tries(cells)
        base = self.trial(base_fit, tries.covariance)
        promises = self.screen(cells, base.fit, names)
        fits = self.fits(base.fit, cells, promises)
        fall = least_fall(MOST_NAMED, len(self.testable))
        for model, start in promising_pairs(self.fitter, cells, base.fit, promises, self.testable, PAIRS, fall):
            fits.append(self.fitter.fit_from_best(model, cells, [start], None, _rival_cost(fits, base.fit.cost - fall)))
        trials = {f.model.name: self.trial(f, tries.covariance, base) for f in fits if np.isfinite(f.cost)}
        promised_misfits = {name: promise.misfit for name, promise in promises.items()}
        if former is not None:
            trials = _joined_trials(former.trials, trials)
            promised_misfits = {**former.promised_misfits, **promised_misfits}
        selection = tries.judge.select(base, trials, promised_misfits)
        selection = self._with_all_solutions(selection, promises, tries)
        selection = self._with_refined_fits(selection, tries)
        selection = self._with_additions(selection, tries)
        selection = self._with_reductions(selection, tries)
        selection = self._with_twins(selection, tries)
        selection = self._with_refined_fits(selection, tries)
        return self._at_their_most_probable(selection, tries)

    def _at_their_most_probable(self, selection: Selection, tries: Tries) -> Selection:
        """The selection in which the base, and the models that may be named, have the evidence of predicted places.

        A fit minimises the misfit in the noise alone, while the evidence also has the structure beside the model. The
        most probable unknowns are therefore sought, also of rivals whose promised gain is as large as what they lack.
        Those of the base are sought from each leading model, too: an effect must not win by a start that it alone had.
        """
        trials, done = dict(selection.trials), set[str]()
        base, promised = self.at_most_probable(selection.base), selection.promised_misfits
        selection = tries.judge.select(base, trials, promised)
        while new := {*selection.reasons, *_promising(selection)} - done:
            name = max(new, key=lambda name: selection.odds[name])  # the others may then be far behind
            trials[name], done = self.at_most_probable(trials[name]), done | {name}
            there = self._fit_without_effects(trials[name].evidence.fit, tries.cells, 0)
            if there.sound and name == selection.best_model:
                rival = self.at_most_probable(self.trial(there, tries.covariance, base)).evidence
                base = replace(base, evidence=max(base.evidence, rival, key=lambda evidence: evidence.value))
            selection = tries.judge.select(base, trials, promised)
        return selection

    def at_most_probable(self, trial: Trial) -> Trial:
        """A trial with the evidence of its most probable unknowns, or as near to them as steps lead, or of its fit."""
        evidence, steps, covariance = trial.evidence, 0, trial.evidence.covariance
        while steps < ITERATIONS and evidence.promise > LEAST_GAIN and (there := self._more_probable(evidence)):
            held = Evidence(covariance, self.fitter, there, evidence.structure, held=True)
            is_there, steps = held.promise <= LEAST_GAIN, steps + 1
            evidence = Evidence(covariance, self.fitter, there, evidence.structure) if is_there else held
        ends = [evidence] if evidence.promise <= LEAST_GAIN else [evidence, trial.evidence]
        evidence = max((end.without_promise() for end in ends), key=lambda end: end.value)
        fit = min(trial.fit, evidence.fit, key=lambda fit: fit.cost)
        return replace(trial, fit=fit, evidence=evidence, rms=covariance.rms(fit.predicted_angle))

    def _more_probable(self, evidence: Evidence) -> Fit | None:
        """A step further towards the most probable unknowns; None where no step makes them more probable.

        A step leads to where the problem, linear about the unknowns reached, is most probable, or a half, a quarter and
        so on of the way: where contacts open and close the whole way may lead too far.
        """
        fit, cells, density = evidence.fit, evidence.covariance.cells, evidence.log_density(evidence.fit)
        for share in 0.5 ** np.arange(TRIES):
            flat = fit.unknowns.flat + share * (evidence.most_probable - fit.unknowns.flat)
            there, _ = self.fitter.predicted_fit(fit, flat, cells)
            if there.sound and evidence.log_density(there) - density > share * LEAST_GAIN:
                return self.fitter.fit_at(fit, flat, cells)
        return None

    def _known_odds(self, selection: Selection, tries: Tries) -> dict[str, float]:
        """Odds of models whose discrepancy is no larger than the form of the model leaves.

        A larger discrepancy can hide that the fit of the right effect has ended early, so that another effect leads.
        """
        judge, misfit = tries.judge, tries.judge.misfit(selection.base)
        values = {name: judge.value(selection.trials[name], misfit) for name in selection.odds}
        return judge.odds(judge.value(selection.base), values)

    def _with_all_solutions(self, selection: Selection, promises: Mapping[str, Promise], tries: Tries) -> Selection:
        """The selection with single effects, as probable as what may be named, fitted from all of their starts.

        Where contacts open and close, and where calibrated numbers may stand in for an effect, a fit has several
        solutions. The most probable one counts; the others widen the intervals of its parameters.
        """
        trials, leaders = dict(selection.trials), set[str]()
        for odds in (selection.odds, self._known_odds(selection, tries)):
            best_model = best_of(odds)
            leaders |= {name for name in odds if best_model and odds[name] >= odds[best_model] - NAMED_ODDS}
        for name in [name for name in selection.odds if name in leaders and name in promises]:
            model, base = trials[name].fit.model, selection.base
            fits = [self.fitter.fit(model, tries.cells, start, base_fit=base.fit) for start in promises[name].starts]
            fits = [refined_ripple(self.fitter, fit, tries.cells) for fit in fits]
            start = start_from_declared(self.fitter, model, tries.cells, base.fit.unknowns)
            fits.append(self.fitter.fit(model, tries.cells, start))
            solutions = [self.trial(fit, tries.covariance, base) for fit in fits if fit.sound]
            trials[name] = most_probable([trials[name], *solutions])
        return tries.judge.select(selection.base, trials, selection.promised_misfits)

    def _with_refined_fits(self, selection: Selection, tries: Tries) -> Selection:
        """The selection with the fits of models that may be named refined, as that of the model without effects is.

        Of as many effects the most probable that are within the odds of a name, or would be if they missed only noise.
        """
        trials, odds, base = dict(selection.trials), selection.odds, selection.base
        known_leader = best_of(self._known_odds(selection, tries))
        for n_effects in range(1, MOST_NAMED + 1):
            names = [name for name in odds if trials[name].fit.model.n_effects == n_effects]
            leading_names = sorted(names, key=lambda name: -odds[name])[:MOST_REFINED]
            rival_cost = _rival_cost([trials[name].fit for name in names], np.inf)
            for name in dict.fromkeys([*leading_names, *(name for name in names if name == known_leader)]):
                known, best = trials[name], max(odds[other] for other in names)
                least = max(NAMED_ODDS, odds_over_fewer(name, odds))
                largest_gain = max(ODDS, 0.5 * (known.fit.cost - np.count_nonzero(tries.cells)))
                asked = best - NAMED_ODDS if best >= least else least
                leads = name == known_leader or (odds[name] + largest_gain >= asked and known.fit.cost <= rival_cost)
                if leads and not known.is_refined:
                    fit = self.fitter.refine(known.fit, tries.cells, known.fit.unknowns)
                    solutions = [self.trial(fit, tries.covariance, base), known, *known.other_solutions]
                    trials[name] = replace(most_probable(solutions), is_refined=True)
            odds = tries.judge.select(base, trials, selection.promised_misfits).odds
        return tries.judge.select(base, trials, selection.promised_misfits)

    def _with_twins(self, selection: Selection, tries: Tries) -> Selection:
        """The selection with models in which another effect takes the place of a member of the best one.

        They are fitted from the numbers and tolerances of the best one: an effect must not be named because similar
        effects lacked its start. In a pair, the effects that explain most beside the other member are tried, too, once
        for each such member. This is repeated while the best model changes.
        """
        former, name, extended = "", selection.best_model, list[set[str]]()
        while name not in ("", former):
            best = selection.trials[name].fit
            for effect in best.model.effects:
                others = {other.name for other in best.model.effects} - {effect.name}
                names = [name for name in twins(effect.name) if name in self.testable and name not in others]
                if others or names:
                    left = self.trial(self._without(best, effect.name, tries.cells), tries.covariance)
                    count = ADDITIONS if others and others not in extended else 0
                    selection = self._extended(selection, left, tries, names, count)
                    extended.append(others)
            former, name = name, selection.best_model
        return selection

    def _without(self, fit: Fit, effect: str, cells: Truth) -> Fit:
        """The model without an effect, at the numbers and tolerances of a fit with it."""
        is_kept = np.array([part.name != effect for part in fit.model.effects for _ in part.parameters])
        model = Model(tuple(part for part in fit.model.effects if part.name != effect))
        return self.fitter.fit(model, cells, replace(fit.unknowns, shares=fit.unknowns.shares[is_kept]), 0)

    def _with_reductions(self, selection: Selection, tries: Tries) -> Selection:
        """The selection with single effects fitted from where the best pairs led to, past kinks of their own fits."""
        trials, base, misfit = dict(selection.trials), selection.base, tries.judge.misfit(selection.base)
        pairs = [name for name in selection.odds if trials[name].fit.model.n_effects == MOST_NAMED]
        for name in sorted(pairs, key=lambda name: -tries.judge.value(trials[name], misfit))[:MOST_REFINED]:
            pair = trials[name].fit
            for effect, place in pair.model.places:
                known = [trials[effect.name], *trials[effect.name].other_solutions] if effect.name in trials else []
                if not known or known[0].fit.cost > pair.cost + FALL_OF_PASS:
                    start = replace(pair.unknowns, shares=pair.unknowns.shares[place])
                    fit = self.fitter.fit(Model((effect,)), tries.cells, start)
                    solutions = [self.trial(fit, tries.covariance, base)] if fit.sound else []
                    trials |= {effect.name: most_probable([*known, *solutions])} if solutions else {}
        return tries.judge.select(base, trials, selection.promised_misfits)

    def _with_additions(self, selection: Selection, tries: Tries) -> Selection:
        """The selection with a second effect beside its most probable single one, of those that could give the odds."""
        single, least = selection.best_single, least_fall(MOST_NAMED, len(self.testable), MOST_NAMED - 1)
        return selection if single is None else self._extended(selection, single, tries, (), ADDITIONS, least)

    def _extended(
        self, selection: Selection, current: Trial, tries: Tries, names: Sequence[str], count: int, least: float = 0.0
    ) -> Selection:
        """The selection with effects added to one of its trials: ``names``, and the ``count`` that explain most.

        Of those whose secants promise the ``least`` fall of the sum of squares, in the noise.
        """
        looked_at, effects = list(names), self._further_effects(current.fit)
        looked_at += promising_effects(self.fitter, tries.cells, current.fit, effects, least) if count else []
        promises = self.screen(tries.cells, current.fit, looked_at) if looked_at else {}
        best_names = sorted(promises, key=lambda name: promises[name].misfit)[:count]
        promises = {name: promise for name, promise in promises.items() if name in {*names, *best_names}}
        fits = [fit for fit in self.fits(current.fit, tries.cells, promises) if np.isfinite(fit.cost)]
        added_trials = {fit.model.name: self.trial(fit, tries.covariance, current) for fit in fits}
        trials = _joined_trials(selection.trials, added_trials)
        return tries.judge.select(selection.base, trials, selection.promised_misfits)

    def recalibrate(self, cells: Truth) -> Fit:
        """Calibrated numbers and tolerances alone: a fit to the large torques first, refined from as declared.

        Where it then misses more than noise, also from where the first fit ends; the more probable of both counts.
        """
        start, covariance = self.fitter.start(Model()), self.tries(cells).covariance
        first_fit = self.fitter.fit_by_load(Model(), cells, start)
        fit = self.fitter.refine(first_fit, cells, start)
        if fit.cost < WELL_FITTED * np.count_nonzero(cells):
            return fit
        fits = fit, self.fitter.refine(first_fit, cells, first_fit.unknowns)
        ends = [self.at_most_probable(self.trial(one, covariance)) for one in fits if np.isfinite(one.cost)]
        return max(ends, key=lambda trial: trial.evidence.value).fit if ends else first_fit

    def fits(self, base: Fit, cells: Truth, promises: Mapping[str, Promise]) -> list[Fit]:
        """Fits of all promised additions to a base, the best promised first, each from its best start.

        A fit ends where it will not come down as far from the base as any name takes.
        """
        fits: list[Fit] = []
        least_cost = base.cost - least_fall(1, len(self.testable))
        for name, promise in sorted(promises.items(), key=lambda item: item[1].misfit):
            model = Model((*base.model.effects, self.testable[name]))
            fits.append(self.fitter.fit_from_best(model, cells, promise.starts, base, _rival_cost(fits, least_cost)))
        return fits

    def refit(self, model: Model, cells: Truth, base: Fit, rival_cost: float = np.inf) -> Fit:
        """A model fitted to some cells from what they alone show, effect by effect on top of a base.

        From every start, those beside the declared numbers too: of a base that lacks its effect they stand in for it,
        and a fit from there alone may end where they do. Once more from numbers and tolerances as declared for the same
        reason. An effect that lowers nothing stays out. Fits that will not come down to ``rival_cost`` end early.
        """
        fit = base
        for effect in model.effects:
            promise = self.screen(cells, fit, (effect.name,)).get(effect.name)
            extended_model = Model((*fit.model.effects, effect))
            declared = start_from_declared(self.fitter, extended_model, cells, fit.unknowns)
            starts = [*(promise.starts if promise else ()), declared]
            cost_to_reach = rival_cost if extended_model.n_effects == model.n_effects else np.inf
            extended_fit = self.fitter.fit_from_best(extended_model, cells, starts, rival_cost=cost_to_reach)
            fit = extended_fit if extended_fit.sound and extended_fit.cost < fit.cost else fit
        if not fit.model.effects:
            return fit
        declared_unknowns = self.fitter.start(fit.model, fit.unknowns.shares)
        refit = self.fitter.fit_from_best(fit.model, cells, [declared_unknowns], rival_cost=rival_cost)
        return refit if refit.sound and refit.cost < fit.cost else fit


def _promising(selection: Selection) -> list[str]:
    """Models of as many effects as the best one that would be in its class with the gain that steps may bring."""
    odds, trials, leader = selection.odds, selection.trials, selection.best_model
    n_effects = trials[leader].fit.model.n_effects if leader else 0
    rivals = [name for name in odds if trials[name].fit.model.n_effects == n_effects]
    gains = {name: np.clip(trials[name].evidence.promise, CLOSE_ODDS, LARGEST_GAIN) for name in rivals}
    return [name for name in rivals if odds[name] + gains[name] >= odds[leader] - NAMED_ODDS]


def _joined_trials(known: Mapping[str, Trial], further: Mapping[str, Trial]) -> dict[str, Trial]:
    """All trials by name; of a model that was tried twice the most probable solution."""
    of_both = {name: most_probable([known[name], trial]) for name, trial in further.items() if name in known}
    return {**known, **further, **of_both}


def _close_effects(selection: Selection, gain: float) -> set[str]:
    """Effects of the models that could be named if the logarithm of their evidence grew by ``gain``."""
    return {effect for name, odds in selection.odds.items() if odds + gain >= NAMED_ODDS for effect in name.split("+")}


def _rival_cost(fits: Sequence[Fit], least_cost: float) -> float:
    """Sum of squares beyond which a fit is no rival of the best so far, or beyond any name."""
    return min(RIVAL * min((fit.cost for fit in fits), default=np.inf), least_cost)

"""The rule by which effects are named, the same for every effect, every unit and every size of the misfit.

Every effect that the data can test is fitted, and the ten pairs that promise most. Before the data, "no effect", "one
effect" and "two effects" are equally probable, and so are all effects and all pairs among themselves. An effect is
named if and only if

(a) the posterior probability of "no effect", over everything that was tried, is at most 0.1 %;
(b) cells that were left out are predicted better with it than without: log predictive density, the same covariance;
(c) the 95 % region of its size excludes zero;
(d) it is plausible: its fit is sound, its size not at a bound of the library, its time constant not longer than the
    record, a ripple not the slowest that is looked for, and the tolerances beside it occur among the study's units;
(e) it does better than a discrepancy of no known form: it explains the unit down to what the form of the model leaves,
    and is then more probable than "none of these" by the odds of (a); and the data do not call, by odds of 19 to 1, for
    a larger discrepancy beside it, or for one that differs between cycles: the form of the model is alike in all;
(f) with it, unused data are predicted as a right model would (``held_out.failed_test``).

A further effect is named where the model with it is more probable than the best with fewer by the odds of (a): of
loops two at most, the second explaining more than the form of the model may leave of the misfit; of records any number.
Named together, as a class, are models less probable than the best by less than the odds of (a). One member meets all
clauses by itself. The others need not meet the odds of (a) and (e), and a larger discrepancy may lie beside them.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb
from typing import Generic, TypeVar

import numpy as np
from scipy.special import logsumexp  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.fitting.problem import REMAINING_SHARE
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.selection.covariance import SIZES
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.screening import PERIODIC
from pipeline.statistics.resampling import LEVEL

T = TypeVar("T")

ODDS = float(np.log((1 - LEVEL) / LEVEL))
"""Logarithm of the odds of 19 to 1, from which data call for more than a model."""
NAMED_ODDS = float(np.log(999))
"""The same of 999 to 1: of a name over "no effect", of a second effect over the first alone, of an effect over others,
which are named together within them. Calibrated: of 120 spent units from outside no name of smaller odds was right."""
MOST_NAMED = 2
"""Effects that are named together; more only describe."""
LARGEST_CLASS = 3
"""Effects in a class beyond which it counts as unresolved."""
FORM = 0.05
"""Share of the misfit that the form of the model (contact law, mesh, cells) may leave. Calibrated: the parameters of
drawn units came out 1 to 6 % off."""
NO_EFFECT_LEFT = SIZES[3]
"""Structure, in the noise of a cell, up to which one beside a name is the form of the model: of the sizes tried the
nearest to the most, 0.38, that 23 refitted units without an effect left of their true curves."""
AT_BOUND = 0.01
"""Share of its bounds from an end at which a size is at the bound."""
UNLIKELY = 1e-3
"""Share of units whose tolerances are as far from nominal as those fitted, below which they explain nothing."""


@dataclass(frozen=True)
class Trial:
    """A model fitted to some cells, and how probable they are under it.

    Attributes
    ----------
    rms : misfit of these cells, in their noise.
    other_solutions : further fits of the model from other starts that are at least a twentieth as probable.
    is_refined : whether the fit was refined by further passes.
    """

    fit: Fit
    evidence: Evidence
    rms: float
    other_solutions: tuple["Trial", ...] = ()
    is_refined: bool = False


def most_probable(solutions: Sequence[Trial]) -> Trial:
    """The most probable of several solutions of one model, with those that are nearly as probable, each at its fit."""
    values = [trial.evidence.without_promise().value for trial in solutions]
    best = values.index(max(values))
    near = (k for k, value in enumerate(values) if k != best and value >= values[best] - ODDS)
    return replace(solutions[best], other_solutions=tuple(solutions[k] for k in near))


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What the clauses choose of some models.

    Attributes
    ----------
    odds : by name, logarithm of the posterior odds against "no effect".
    reasons : by name of a model that is as probable as what may be named, why it is not; empty reasons: it may be.
    best_model : the most probable model, or "" where "no effect" is not rejected.
    members : names of the class that is named, the most probable first; empty where nothing is.
    """

    odds: Mapping[str, float] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    best_model: str = ""
    members: tuple[str, ...] = ()

    @property
    def claimed_model(self) -> str:
        """The most probable of the models that are named, or ""."""
        return self.members[0] if self.members else ""


@dataclass(frozen=True)
class Selection(Choice):
    """What was tried on a set of cells, and what is chosen of it.

    Attributes
    ----------
    base : calibrated numbers and tolerances alone.
    trials : by name of the model.
    promised_misfits : (share of the base's misfit) by name of every effect that could be tested.
    """

    base: Trial
    trials: Mapping[str, Trial] = field(default_factory=dict)
    promised_misfits: Mapping[str, float] = field(default_factory=dict)

    @property
    def chosen_trial(self) -> Trial:
        """The trial of what is named, or the base's."""
        return self.trials[self.claimed_model] if self.claimed_model else self.base

    @property
    def answer(self) -> Trial:
        """The trial of what is named, else of the most probable model, else the base's."""
        name = self.claimed_model or self.best_model
        return self.trials[name] if name else self.base

    @property
    def best_single(self) -> Trial | None:
        """The trial of the most probable single effect; None where "no effect" is not rejected."""
        names = [name for name in self.odds if self.trials[name].fit.model.n_effects == 1] if self.best_model else []
        return self.trials[max(names, key=lambda name: self.odds[name])] if names else None

    @property
    def limit(self) -> float:
        """Structure, in the noise of a cell, that the form of the model may leave."""
        return form_limit(self.base.rms)

    @property
    def nearest_model(self) -> str:
        """The most probable model that is not named, or ""."""
        other_models = [
            name for name in self.odds if name not in self.members and self.trials[name].fit.model.n_effects == 1
        ]
        return max(other_models, key=lambda name: self.odds[name], default="")


def without_names(selection: Selection, reason: str) -> Selection:
    """The selection without names, since clause (f) refuses them for a reason."""
    return replace(selection, members=(), reasons={**selection.reasons, selection.claimed_model: reason})


def form_limit(rms: float) -> float:
    """Structure, in the noise of a cell, that the form of the model may leave of a misfit of ``rms`` noises."""
    return float(np.hypot(REMAINING_SHARE, FORM * rms))


def limits_beside_name(rms: float) -> tuple[float, float]:
    """Structure, in the noise of a cell, that may be left beside a name of a misfit of ``rms`` noises.

    The part that is alike in all cycles, and the part that differs between them, at least the smallest size tried.
    """
    return float(np.hypot(NO_EFFECT_LEFT, FORM * rms)), float(np.hypot(SIZES[1], FORM * rms))


def prior_log_odds(n_effects: int, n_tried: int) -> float:
    """Logarithm of the prior odds of one model of so many effects against "no effect", of ``n_tried`` effects."""
    return -float(np.log(max(comb(n_tried, n_effects), 1)))


def least_fall(n_effects: int, n_tried: int, n_before: int = 0) -> float:
    """Fall of the sum of squares, in the noise, from which so many effects can have the odds over ``n_before``.

    Of ``n_tried`` effects.
    """
    return 2 * (NAMED_ODDS + prior_log_odds(n_before, n_tried) - prior_log_odds(n_effects, n_tried))


class Rule(ABC, Generic[T]):
    """The clauses on trials of models of any kind of data; models are named by their effects, joined by +.

    Parameters
    ----------
    n_tried : number of effects that the data can test.
    n_repeats, repeats : number of what is measured again and again, and the word for it: branches or passes.
    most_named : effects that may be named together.
    """

    def __init__(self, n_tried: int, n_repeats: int, repeats: str, most_named: int = MOST_NAMED):
        self.n_tried, self.n_repeats, self.repeats, self.most_named = n_tried, n_repeats, repeats, most_named

    @abstractmethod
    def value(self, trial: T, misfit: float = np.inf) -> float:
        """Logarithm of the evidence; its structure is no larger than the form of the model leaves of a misfit."""

    @abstractmethod
    def predictive(self, trial: T) -> Real:
        """Log density (n_parts,) of each part, predicted from all others."""

    @abstractmethod
    def misfit(self, trial: T) -> float:
        """Root mean square of what a trial leaves, in the noise."""

    @abstractmethod
    def effects(self, trial: T) -> Sequence[str]:
        """Names of the effects of a trial."""

    @abstractmethod
    def distance(self, trial: T, effect: str, without: T | None) -> float:
        """Distance of the size of an effect from zero, in that of the edge of its 95 % region.

        ``without`` is the trial of the model without the effect; None where that was not tried.
        """

    @abstractmethod
    def implausible(self, trial: T) -> Iterator[str]:
        """Reasons why the sizes of a trial are not plausible."""

    def choice(self, base: T, trials: Mapping[str, T]) -> Choice:
        """What may be named of some trials."""
        odds = self.odds(self.value(base), {name: self.value(trial) for name, trial in trials.items()})
        best_model = best_of(odds)
        reasons: dict[str, str] = {}
        members: tuple[str, ...] = ()
        smaller_models = [best_of(_up_to(size, odds)) for size in range(_size(best_model) - 1, 0, -1)]
        for leader in dict.fromkeys([best_model, *smaller_models]):
            class_reasons, members = self._class_of(leader, odds, base, trials) if leader else ({}, ())
            reasons |= class_reasons
            if members:
                break
        return Choice(odds=odds, reasons=reasons, best_model=best_model, members=members)

    def _class_of(
        self, leader: str, odds: Mapping[str, float], base: T, trials: Mapping[str, T]
    ) -> tuple[dict[str, str], tuple[str, ...]]:
        """Reasons why models near a leading one are not named, empty for those that may be; and the named class.

        One member has the odds by itself, over no effect and over fewer. The others need only be about as probable.
        """
        tried, by_odds = {"": base, **trials}, sorted(odds, key=lambda name: -odds[name])
        close_models = [n for n in by_odds if _size(n) == _size(leader) and odds[n] >= odds[leader] - NAMED_ODDS]
        candidates = [name for name in close_models if odds[name] >= odds_over_fewer(leader, odds)]
        reasons = {name: next(self.objections(trials[name], tried), "") for name in candidates}
        best = next((name for name in candidates if not reasons[name]), None)
        if best is None:
            return reasons, ()
        for name in close_models:
            reasons[name] = next(self.objections(trials[name], tried, max(odds[best] - odds[name], 0.0)), "")
        return reasons, tuple(name for name in close_models if not reasons[name])

    def odds(self, base_value: float, values: Mapping[str, float]) -> dict[str, float]:
        """Logarithms of posterior odds of models that may be named against "no effect"."""
        return {
            name: value - base_value + prior_log_odds(_size(name), self.n_tried)
            for name, value in values.items()
            if _size(name) <= self.most_named
        }

    def objections(self, trial: T, tried: Mapping[str, T], behind: float | None = None) -> Iterator[str]:
        """The clauses (b) to (e) that a model does not meet.

        ``tried`` are all trials by name, that without effects as "". ``behind`` is the logarithm of the odds of the
        best member of a class over another one: that one has the odds of (e), and no larger discrepancy beside it.
        """
        base, names = tried[""], self.effects(trial)
        if self.n_repeats < FEWEST_BLOCKS:
            yield f"with fewer than {FEWEST_BLOCKS} {self.repeats} no effect is named"
        gain = self.predictive(trial) - self.predictive(base)
        if len(gain) < 2 or np.sum(gain) <= 0:
            yield "data that were left out are not predicted better with it"
        elif np.min(gain) < -NAMED_ODDS:  # of a right model as rare as these odds say (Markov's inequality)
            yield "a part of the data that was left out is predicted worse with it by odds of 999 to 1"
        for effect in names:
            without = tried.get("+".join(name for name in names if name != effect))
            if not self.distance(trial, effect, without) > 1:
                yield f"the interval of the size of {effect} reaches zero"
        yield from self.implausible(trial)
        log_evidence_up_to = self.value(trial, self.misfit(base))
        prior = prior_log_odds(len(names), self.n_tried)
        if not log_evidence_up_to - self.value(base) + prior + (behind or 0.0) >= NAMED_ODDS:
            yield "a discrepancy of no known form describes the unit as well"
        if behind is None and self.value(trial) - log_evidence_up_to >= ODDS:
            yield "beside it the data call for a discrepancy that is larger than the form of the model leaves"


class Judge(Rule[Trial]):
    """The rule on the trials of one problem's cells.

    Parameters
    ----------
    cells : (n_cells,) that were fitted.
    n_tried : number of effects that the data can test.
    """

    def __init__(self, fitter: Fitter, cells: Truth, n_tried: int):
        super().__init__(n_tried, len(np.unique(fitter.problem.data.block[cells])), "branches")
        self.fitter, self.cells = fitter, cells

    def select(self, base: Trial, trials: Mapping[str, Trial], promised_misfits: Mapping[str, float]) -> Selection:
        """What may be named of some trials."""
        choice = self.choice(base, {name: t for name, t in trials.items() if self._is_beyond_form(t, base, trials)})
        return Selection(base, trials, promised_misfits, **vars(choice))

    @staticmethod
    def _is_beyond_form(trial: Trial, base: Trial, trials: Mapping[str, Trial]) -> bool:
        """Whether all effects of a trial explain more than the form of the model may leave beside one of them alone."""
        singles = [trials[effect.name].rms for effect in trial.fit.model.effects if effect.name in trials]
        is_single = trial.fit.model.n_effects == 1
        return is_single or min(singles, default=np.inf) ** 2 - trial.rms**2 > (FORM * base.rms) ** 2

    def chosen_without(self, selection: Selection, part: int) -> str:
        """Name of the model that the same odds choose from all cells but those of a part; "" for none."""
        values = {name: selection.trials[name].evidence.training[part] for name in selection.odds}
        return best_of(self.odds(selection.base.evidence.training[part], values))

    def value(self, trial: Trial, misfit: float = np.inf) -> float:
        """Logarithm of the evidence; its structure is no larger than the form of the model leaves of a misfit."""
        return trial.evidence.log_evidence_up_to(*limits_beside_name(misfit))

    def predictive(self, trial: Trial) -> Real:
        """Log density (n_parts,) of each part, predicted from all others."""
        return trial.evidence.predictive

    def misfit(self, trial: Trial) -> float:
        """Root mean square of what a trial leaves, in the noise."""
        return trial.rms

    def effects(self, trial: Trial) -> Sequence[str]:
        """Names of the effects of a trial."""
        return [effect.name for effect in trial.fit.model.effects]

    def distance(self, trial: Trial, effect: str, without: Trial | None) -> float:
        """Distance of the size of an effect from zero, in that of the edge of its 95 % region."""
        return trial.evidence.distance(effect, without.evidence if without else None)

    def implausible(self, trial: Trial) -> Iterator[str]:
        """Fits that are not sound, and sizes or tolerances that are not plausible."""
        fit = trial.fit
        if not fit.sound:
            yield "it needs equilibria that are not found, or a crank beyond the angles that were measured"
        bounds = self.fitter.bounds(fit.model)
        for effect, place in fit.model.places:
            for k, parameter in enumerate(effect.parameters, place.start):
                (low, high), share, value = bounds[k], fit.unknowns.shares[k], fit.values[k]
                if low <= 0 <= high and (share > 1 - AT_BOUND or (low < 0 and share < AT_BOUND)):
                    yield f"{parameter.name} = {value:.3g} of {effect.name} is at a bound of what the library allows"
                if effect.starts == PERIODIC and low > 0 and share < AT_BOUND:
                    yield f"{parameter.name} = {value:.3g} of {effect.name} is the slowest ripple that is searched for"
                if parameter.record and value > self.fitter.problem.record[parameter.record]:
                    yield f"{parameter.name} = {value:.3g} of {effect.name} is longer than the record"
        if (share := trial.evidence.tolerance_share) < UNLIKELY:
            yield f"it needs tolerances that {share:.1g} of the study's units have"


def best_of(odds: Mapping[str, float]) -> str:
    """The leading model, or "" where "no effect" is not rejected."""
    return _leader(odds) if odds and logsumexp(list(odds.values())) >= NAMED_ODDS else ""


def _leader(odds: Mapping[str, float]) -> str:
    """The most probable model, of more effects only where it beats the best of fewer by the odds; "" of none."""
    best_model = ""
    for size in sorted({_size(name) for name in odds}):
        leader = max((name for name in odds if _size(name) == size), key=lambda name: odds[name])
        if not best_model or odds[leader] - odds[best_model] >= NAMED_ODDS:
            best_model = leader
    return best_model


def odds_over_fewer(name: str, odds: Mapping[str, float]) -> float:
    """Odds from which a model beats the best of fewer effects; of a single effect any."""
    best_of_fewer = _leader(_up_to(_size(name) - 1, odds))
    return odds[best_of_fewer] + NAMED_ODDS if best_of_fewer else -np.inf


def _up_to(size: int, odds: Mapping[str, float]) -> dict[str, float]:
    """The odds of models of at most so many effects."""
    return {name: value for name, value in odds.items() if _size(name) <= size}


def _size(name: str) -> int:
    """Number of effects of a model."""
    return name.count("+") + 1

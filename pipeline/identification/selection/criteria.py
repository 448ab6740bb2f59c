"""The rule by which effects are named, the same for every effect, every unit and every size of the misfit.

Every effect that the data can test is fitted, and the ten pairs that promise most. Before the data, "no effect", "one
effect" and "two effects" are equally probable, and so are all effects and all pairs among themselves. An effect is
named if and only if

(a) the posterior probability of "no effect", over everything that was tried, is at most 5 %;
(b) cells that were left out are predicted better with it than without: log predictive density, the same covariance;
(c) the 95 % region of its size excludes zero;
(d) it is plausible: its size is not at a bound of the library, its time constant not longer than the record, and the
    tolerances that are fitted beside it occur among the study's units;
(e) it does better than a discrepancy of no known form: it explains the unit down to what the form of the model leaves,
    and is then more probable than "none of these" by the odds of (a);
(f) with it, unused data are predicted as a right model would (``adequacy``).

A second effect is named where the pair is more probable than the best single effect by the same odds. Named together,
as a class, are the models that are at least a twentieth as probable as the best one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.recalibration import UNLIKELY, tolerance_share

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

FAMILYWISE = 0.05
"""Posterior probability of "no effect", over all that were tried, up to which an effect is named."""
ODDS = float(np.log((1 - FAMILYWISE) / FAMILYWISE))
"""Logarithm of the odds that this asks for, and of those within which models are named together."""
MOST_NAMED = 2
"""Effects that are named together; more only describe."""
LARGEST_CLASS = 3
"""Effects in a class beyond which it counts as unresolved."""
LEFT = 0.75
"""Structure, in the noise of a cell, that the form of the model may leave: with the noise, 1.25 of it."""
FORM = 0.05
"""Share of the misfit that the form of the model (contact law, mesh, cells) may leave. Calibrated: the parameters of
drawn units came out 1 to 6 % off."""
AT_BOUND = 0.01
"""Share of its bounds from an end at which a size is at the bound."""


@dataclass(frozen=True)
class Trial:
    """A model fitted to some cells, and how probable they are under it.

    Attributes
    ----------
    rms : misfit of these cells, in their noise.
    """

    fit: Fit
    evidence: Evidence
    rms: float


@dataclass(frozen=True)
class Selection:
    """What was tried on a set of cells.

    Attributes
    ----------
    base : calibrated numbers and tolerances alone.
    trials : by name of the model.
    screened : (share of the base's misfit) by name of every effect that could be tested.
    odds : by name, logarithm of the posterior odds against "no effect".
    reasons : by name of a model that is as probable as what may be named, why it is not; empty reasons: it may be.
    best : the most probable model of at most two effects, or "" where "no effect" is not rejected.
    members : names of the class that is named, the most probable first; empty where nothing is.
    """

    base: Trial
    trials: Mapping[str, Trial] = field(default_factory=dict)
    screened: Mapping[str, float] = field(default_factory=dict)
    odds: Mapping[str, float] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    best: str = ""
    members: tuple[str, ...] = ()

    @property
    def claimed(self) -> str:
        """The most probable of the models that are named, or ""."""
        return self.members[0] if self.members else ""

    @property
    def chosen(self) -> Trial:
        """The trial of what is named, or the base's."""
        return self.trials[self.claimed] if self.claimed else self.base

    @property
    def answer(self) -> Trial:
        """The trial of what is named, else of the most probable model, else the base's."""
        name = self.claimed or self.best
        return self.trials[name] if name else self.base

    @property
    def description(self) -> Trial:
        """The trial of the most probable model of any number of effects; the answer where it is named."""
        if self.members or not self.best:
            return self.answer
        return max([self.answer, *self.trials.values()], key=lambda trial: trial.evidence.value)

    @property
    def limit(self) -> float:
        """Structure, in the noise of a cell, that the form of the model may leave."""
        return form_limit(self.base)

    @property
    def nearest(self) -> str:
        """The most probable model that is not named, or ""."""
        others = [name for name in self.odds if name not in self.members and self.trials[name].fit.model.n_effects == 1]
        return max(others, key=lambda name: self.odds[name], default="")


def unnamed(selection: Selection, reason: str) -> Selection:
    """The selection without names, since clause (f) refuses them for a reason."""
    return replace(selection, members=(), reasons={**selection.reasons, selection.claimed: reason})


def form_limit(base: Trial) -> float:
    """Structure, in the noise of a cell, that the form of the model may leave of a misfit."""
    return float(np.hypot(LEFT, FORM * base.rms))


def prior_log_odds(n_effects: int, tried: int) -> float:
    """Logarithm of the prior odds of one model of one or two effects against "no effect", of ``tried`` effects."""
    return -float(np.log(tried if n_effects == 1 else max(tried * (tried - 1) / 2, 1.0)))


class Judge:
    """The rule on the trials of one problem's cells.

    Parameters
    ----------
    cells : (n_cells,) that were fitted.
    tried : number of effects that the data can test.
    """

    def __init__(self, fitter: Fitter, cells: Truth, tried: int):
        self.fitter, self.cells, self.tried = fitter, cells, tried

    def judged(self, base: Trial, trials: Mapping[str, Trial], screened: Mapping[str, float]) -> Selection:
        """What may be named of some trials."""
        values = {name: trial.evidence.value for name, trial in trials.items()}
        odds = self._odds(base.evidence.value, values, trials)
        best = best_of(odds, trials)
        reasons: dict[str, str] = {}
        for leader in dict.fromkeys([best, best_of(_singles(odds), trials)]):
            if leader:
                reasons |= {name: self.why_not(trials[name], base) for name in alike(leader, odds, trials)}
                members = tuple(name for name in alike(leader, odds, trials) if not reasons[name])
                if members:
                    return Selection(base, trials, screened, odds, reasons, best, members)
        return Selection(base, trials, screened, odds, reasons, best)

    def chosen_without(self, selection: Selection, part: int) -> str:
        """Name of the model that the same odds choose from all cells but those of a part; "" for none."""
        values = {name: trial.evidence.training[part] for name, trial in selection.trials.items()}
        odds = self._odds(selection.base.evidence.training[part], values, selection.trials)
        return best_of(odds, selection.trials)

    def _odds(self, base_value: float, values: Mapping[str, float], trials: Mapping[str, Trial]) -> dict[str, float]:
        """Logarithms of posterior odds of models that may be named against "no effect"."""
        counts = {name: trials[name].fit.model.n_effects for name in values}
        return {
            name: values[name] - base_value + prior_log_odds(counts[name], self.tried)
            for name in values
            if counts[name] <= MOST_NAMED
        }

    def why_not(self, trial: Trial, base: Trial) -> str:
        """Why a model that the data prefer to "no effect" is not named, or ""."""
        return next(self._objections(trial, base), "")

    def _objections(self, trial: Trial, base: Trial) -> Iterator[str]:
        blocks = len(np.unique(self.fitter.problem.data.block[self.cells]))
        if blocks < FEWEST_BLOCKS:
            yield f"with fewer than {FEWEST_BLOCKS} branches no effect is named"
        gain = trial.evidence.predictive - base.evidence.predictive
        if len(gain) < 2 or np.sum(gain) <= 0:
            yield "data that were left out are not predicted better with it"
        for effect in trial.fit.model.effects:
            if not trial.evidence.distance(effect.name) > 1:
                yield f"the interval of the size of {effect.name} reaches zero"
        yield from self._implausible(trial.fit)
        share = tolerance_share(trial.fit, trial.evidence)
        if share < UNLIKELY:
            yield f"it needs tolerances that {share:.1g} of the study's units have"
        if not self._explains(trial, base):
            yield "a discrepancy of no known form describes the unit as well"

    def _implausible(self, fit: Fit) -> Iterator[str]:
        """Sizes at a bound of the library, and time constants that are longer than the record."""
        bounds, start = self.fitter.bounds(fit.model), 0
        for effect in fit.model.effects:
            for k, parameter in enumerate(effect.parameters, start):
                low, high = bounds[k]
                share, value = fit.unknowns.shares[k], fit.values[k]
                if low <= 0 <= high and (share > 1 - AT_BOUND or (low < 0 and share < AT_BOUND)):
                    yield f"{parameter.name} = {value:.3g} of {effect.name} is at a bound of what the library allows"
                if parameter.record and value > self.fitter.problem.record[parameter.record]:
                    yield f"{parameter.name} = {value:.3g} of {effect.name} is longer than the record"
            start += len(effect.parameters)

    def _explains(self, trial: Trial, base: Trial) -> bool:
        """Whether a model that leaves no more than its form does is more probable than a discrepancy of any size."""
        prior = prior_log_odds(trial.fit.model.n_effects, self.tried)
        return trial.evidence.limited(form_limit(base)) - base.evidence.value + prior >= ODDS


def best_of(odds: Mapping[str, float], trials: Mapping[str, Trial]) -> str:
    """The most probable model, of two effects only where it beats the best of one by the odds.

    "" where "no effect" is not rejected.
    """
    if not odds or logsumexp(list(odds.values())) < ODDS:
        return ""
    best = max(_singles(odds), key=lambda name: odds[name], default="")
    pair = max((name for name in odds if name not in _singles(odds)), key=lambda name: odds[name], default="")
    return pair if pair and (not best or odds[pair] - odds[best] >= ODDS) else best


def alike(leader: str, odds: Mapping[str, float], trials: Mapping[str, Trial]) -> Sequence[str]:
    """Models of as many effects that are within the odds of a leading one, the most probable first."""
    count = trials[leader].fit.model.n_effects
    near = [name for name in odds if odds[name] >= odds[leader] - ODDS and trials[name].fit.model.n_effects == count]
    return sorted(near, key=lambda name: -odds[name])


def _singles(odds: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in odds.items() if "+" not in name}

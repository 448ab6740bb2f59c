"""What of the models that were tried may be named: one test over all, the best, and its class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Problem, limit_cases
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE, determined
from pipeline.statistics.blocks import confidence_set, max_t

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

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
MOST_NAMED = 2
"""Effects that are named together; more only describe."""
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
    def description(self) -> Trial:
        """The trial of the model that describes best, claimed or not: the answer where it leaves nothing structured."""
        if self.answer.rms <= self.limit:
            return self.answer
        return min([self.answer, *self.trials.values()], key=lambda trial: trial.rms)

    @property
    def limit(self) -> float:
        """Held-out rms in floors up to which the best model leaves nothing structured."""
        return float(np.hypot(STRUCTURE, FORM * self.base.rms)) if self.best else STRUCTURE


class Judge:
    """Judges trials of models on one problem's cells.

    Attributes
    ----------
    fitter : that fitted them.
    problem : whose cells and tolerances they are of.
    most_effects : that a description may have.
    """

    fitter: Fitter
    problem: Problem
    most_effects: int

    def judged(
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
        base_rms = min(base.rms, stretched.rms if stretched else np.inf)
        gain = np.array([base_rms**2 - trials[name].rms ** 2 for name in names])
        useful = (p <= FAMILYWISE) & (gain >= LEAST_GAIN)
        for k, name in enumerate(names):
            fit = trials[name].fit
            useful[k] = useful[k] and not self.problem.within_tolerance(fit.model, fit.values.tolist())
        scores = np.array([trials[name].scores.mean() for name in names])
        survivors = [names[k] for k in np.argsort(scores) if useful[k]]
        t_of, p_of = (dict(zip(names, values.tolist(), strict=True)) for values in (t, p))
        selection = Selection(base, trials, screened, t_of, p_of, (), "", "", (), stretched)
        return self.with_best(selection, tuple(survivors), cells)

    def with_best(self, selection: Selection, survivors: tuple[str, ...], cells: Truth) -> Selection:
        """The selection with its best, what of it may be claimed, and its class, among the survivors."""
        trials = selection.trials
        best = self._best(survivors, trials, self.most_effects)
        claimed = best if best and trials[best].fit.model.n_effects <= MOST_NAMED else ""
        claimed = claimed or self._best(survivors, trials, MOST_NAMED)
        members = self._members(best, survivors, trials, cells, selection.base.rms) if best else ()
        return replace(selection, survivors=survivors, best=best, claimed=claimed, members=members)

    def _best(self, survivors: Sequence[str], trials: Mapping[str, Trial], most_effects: int) -> str:
        """Least held-out loss; more effects only where they gain significantly over the best with fewer."""
        best = ""
        for count in range(1, most_effects + 1):
            rivals = [name for name in survivors if trials[name].fit.model.n_effects == count]
            if not rivals:
                continue
            if best:
                gain = max(LEAST_GAIN, LEAST_SHARE * trials[best].rms ** 2)
                if not self._gains(trials[best], trials[rivals[0]], gain, claimed=count <= MOST_NAMED):
                    continue
            best = rivals[0]
            simpler = _simplest(best)
            gain = _alike(trials[best])
            if simpler != best and simpler in rivals and not self._gains(trials[simpler], trials[best], gain):
                best = simpler
        return best

    @staticmethod
    def _gains(trial_before: Trial, trial_after: Trial, gain: float, claimed: bool = True) -> bool:
        """Whether a model is better than a simpler one by ``gain`` in squared floors, if ``claimed`` not by chance."""
        _, p = max_t((trial_before.scores - trial_after.scores)[:, None], RESAMPLES, SEED)
        of_use = trial_before.rms**2 - trial_after.rms**2 >= gain
        return bool(of_use and (p[0] <= FAMILYWISE or not claimed))

    def _members(
        self, best: str, survivors: Sequence[str], trials: Mapping[str, Trial], cells: Truth, base_rms: float
    ) -> tuple[str, ...]:
        """The best and those of the confidence set whose predictions over the cells differ by less than the floor.

        A model beside its limit case is one of them where the data leave open how far from the limit it is.
        """
        rivals = [name for name in survivors if trials[name].fit.model.n_effects == trials[best].fit.model.n_effects]
        data = self.problem.data
        _, block_start = np.unique(data.block[cells], return_index=True)
        _, branch = np.unique(data.branch[cells][block_start], return_inverse=True)
        scores = [np.bincount(branch, trials[name].scores) / np.bincount(branch) for name in rivals]
        confidence_members = confidence_set(np.column_stack(scores), SET_LEVEL, RESAMPLES, SEED)
        sigma = data.sigma
        members = []
        for name, is_member in zip(rivals, confidence_members, strict=True):
            standardised_difference = (trials[name].fit.predicted - trials[best].fit.predicted)[cells] / sigma[cells]
            misfit_excess = trials[name].rms ** 2 - trials[best].rms ** 2
            if name == best or (
                (is_member or misfit_excess < _alike(trials[best])) and np.sqrt(np.mean(standardised_difference**2)) < 1
            ):
                members.append(name)
        return tuple(
            name
            for name in members
            if _simplest(name) not in members
            or _simplest(name) == name
            or not determined(self.fitter, trials[name].fit, cells, base_rms)
        )


def stands_for(name: str, goal: str, trials: Mapping[str, Trial]) -> bool:
    """Whether a model has but effects of another one, or explains as much."""
    misfit_excess = trials[name].rms ** 2 - trials[goal].rms ** 2
    return set(name.split("+")) <= set(goal.split("+")) or misfit_excess < _alike(trials[goal])


def _alike(trial: Trial) -> float:
    """Difference of mean losses that decides nothing, in squared floors."""
    return float(ALIKE * max(1.0, trial.rms**2))


def _simplest(name: str) -> str:
    """Name of a model with the simpler of nested effects in their place: they are not needed where it does as well."""
    nested = limit_cases()
    return "+".join(sorted(nested.get(part, part) for part in name.split("+")))

"""The verdict on a record, by the rule of ``selection.criteria``."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.special import fdtri  # scipy.stats is slow to import

from pipeline.arrays import Real, Whole
from pipeline.identification.record.evidence import Points, Posterior, RecordEvidence, Structure
from pipeline.identification.record.terms import LEAST_WAVES, TOLERATED_SHARE, Term
from pipeline.identification.selection.criteria import ODDS, Choice, Rule, best_of, form_limit, prior_log_odds
from pipeline.identification.selection.statements.verdict import (
    ADEQUATE,
    EQUIVALENT,
    IDENTIFIED,
    NOT_TESTABLE,
    UNEXPLAINED,
    WITHIN_TOLERANCE,
)
from pipeline.statistics.resampling import CONFIDENCE

ADDED_PARTS = 3
"""Further effects that are tried beside the best model, each time: those that promise most."""
TOLERABLE = "errors of parts within their tolerances"


@dataclass(frozen=True)
class Trial:
    """A model with the structure of its largest evidence.

    Attributes
    ----------
    effects : their names.
    predictive : (n_parts,) log density of each part, predicted from all others.
    rms : misfit of all points, in their noise.
    limited_evidence : logarithm of the evidence where the structure is no larger than the form of the model may leave.
    """

    effects: tuple[str, ...]
    structure: Structure
    posterior: Posterior
    predictive: Real
    rms: float
    limited_evidence: float

    @property
    def value(self) -> float:
        """Logarithm of the evidence."""
        return self.posterior.value


@dataclass(frozen=True)
class Judgement(Choice):
    """What was tried on a record, and what may be named.

    Attributes
    ----------
    verdict : one of the terms of ``selection.statements.verdict``.
    trials : by the name of the model, effects joined by +; "" of none.
    finding : why a record without a named effect is not adequate, or "".
    tolerated_waves : effects of the named models that are no larger than errors of parts cause.
    named_effects : what is named of each model: effects that tolerances of the parts cannot cause, joined by +.
    """

    verdict: str
    trials: Mapping[str, Trial]
    finding: str = ""
    tolerated_waves: tuple[str, ...] = ()
    named_effects: tuple[str, ...] = ()

    @property
    def answer(self) -> Trial:
        """The trial of what is named, else of no effect."""
        return self.trials[self.claimed_model]

    @property
    def description(self) -> Trial:
        """The trial of the most probable model."""
        return self.trials[self.claimed_model or self.best_model]


def parts_of(points: Points, held_out_by: str | None) -> tuple[str, Whole]:
    """What is left out at once, "torque", "temperature", "sense" or "" where nothing can be, and its numbers (n,)."""
    groups = {"torque": points.level, "temperature": points.warmth, "sense": (points.sense < 0).astype(np.int64)}
    if held_out_by in groups and len(np.unique(groups[held_out_by])) > 1:
        return held_out_by, groups[held_out_by]
    for name, fewest in (("torque", 3), ("temperature", 2), ("sense", 2), ("torque", 2)):
        if len(np.unique(groups[name])) >= fewest:
            return name, groups[name]
    return "", np.zeros(len(points), np.int64)


class RecordJudge(Rule[Trial]):
    """The rule on one record.

    Parameters
    ----------
    parts : (n_points,) number of what each point is held out with.
    n_passes : of the record.
    """

    def __init__(self, evidence: RecordEvidence, effects: list[Term], parts: Whole, n_passes: int):
        super().__init__(len(effects), n_passes, "passes", most_named=len(effects))
        self.evidence, self.parts = evidence, parts
        self.names = [effect.name for effect in effects]

    def judgement(self) -> Judgement:
        """Every effect, the one model that is left of all, and changes of the best by one effect, tried and judged."""
        base = self._trial((), np.inf)
        limit = form_limit(base.rms)
        trials = {name: self._trial((name,), limit) for name in self.names}
        if len(remaining := self._remaining_effects()) > 1:
            trials["+".join(remaining)] = self._trial(remaining, limit)
        while more_trials := self._changed_by_one(base, trials, limit):
            trials |= more_trials
        choice = self.choice(base, trials)
        trials = {"": base} | trials
        if choice.members:
            tolerated = {member: self.tolerated_waves(trials[member]) for member in choice.members}
            named_effects = dict.fromkeys(
                "+".join(name for name in trials[member].effects if name not in waves)
                for member, waves in tolerated.items()
            )
            return Judgement(
                verdict=IDENTIFIED if len(named_effects) == 1 else EQUIVALENT,
                trials=trials,
                **vars(choice),
                tolerated_waves=tuple(sorted({name for waves in tolerated.values() for name in waves})),
                named_effects=tuple(named_effects),
            )
        return self._judgement_without_names(trials, choice, limit)

    def _remaining_effects(self) -> tuple[str, ...]:
        """Effects that are left of all, in the order of the library, where each in turn is left out that is not missed.

        Effects of torque, temperature and speed together may leave no structure where none does so by itself.
        """
        names = tuple(self.names)
        structure = self.evidence.most_likely(names)
        while names:
            values = {
                name: self.evidence.posterior([other for other in names if other != name], structure).value
                for name in names
            }
            least_missed = max(values, key=lambda name: values[name])
            cost = prior_log_odds(len(names) - 1, self.n_tried) - prior_log_odds(len(names), self.n_tried)
            if self.evidence.posterior(names, structure).value - values[least_missed] - cost >= ODDS:
                break
            names = tuple(name for name in names if name != least_missed)
        return names

    def _changed_by_one(self, base: Trial, trials: Mapping[str, Trial], limit: float) -> dict[str, Trial]:
        """Trials of the best model with one more or another effect, of those that promise most and were not tried."""
        best_model = best_of(self.odds(base.value, {name: trial.value for name, trial in trials.items()}))
        if not best_model:
            return {}
        effects, structure = trials[best_model].effects, trials[best_model].structure
        others = [name for name in self.names if name not in effects]
        value = {names: self.evidence.posterior(names, structure).value for names in [(*effects, n) for n in others]}
        chosen_sets = sorted(value, key=lambda names: -value[names])[:ADDED_PARTS]
        least_value = self.evidence.posterior(effects, structure).value - ODDS
        for place, name in product(range(len(effects)), others):
            names = (*effects[:place], name, *effects[place + 1 :])
            if len(names) > 1 and self.evidence.posterior(names, structure).value >= least_value:
                chosen_sets.append(names)
        tried_sets = {frozenset(trial.effects) for trial in trials.values()}
        return {
            "+".join(names): self._trial(names, limit) for names in chosen_sets if frozenset(names) not in tried_sets
        }

    def _judgement_without_names(self, trials: Mapping[str, Trial], choice: Choice, limit: float) -> Judgement:
        """The judgement where nothing is named."""
        verdict, finding, best_model = UNEXPLAINED, "", choice.best_model
        reason = choice.reasons.get(best_model, "")
        tolerable = next(self._tolerable(trials[best_model]), "") if best_model else ""
        if tolerable:  # whatever else speaks against it
            verdict, finding = WITHIN_TOLERANCE, f"{best_model.replace('_', ' ')}: {tolerable}"
        elif best_model:
            finding = f"the most probable, {best_model.replace('_', ' ')}, is not named: {reason}"
        elif trials[""].value - self.evidence.posterior((), self.evidence.most_likely((), limit)).value >= ODDS:
            finding = f"structure of {trials[''].structure.size:.2g} times the noise is left, {limit:.2g} may be"
        elif len(np.unique(self.parts)) < 2:
            verdict, finding = NOT_TESTABLE, "nothing can be held out"
        else:
            finding = self._misfit_reason(trials[""], trials[""])
            verdict = UNEXPLAINED if finding else ADEQUATE
        return Judgement(verdict, trials, finding, **vars(choice))

    def _trial(self, names: tuple[str, ...], limit: float) -> Trial:
        evidence = self.evidence
        structure = evidence.most_likely(names)
        posterior = evidence.posterior(names, structure)
        numbers = np.unique(self.parts)
        evidence_without = [evidence.posterior(names, structure, int(number), self.parts).value for number in numbers]
        predictive = posterior.value - np.array(evidence_without) if len(numbers) > 1 else np.zeros(0)
        residual = evidence.points.error - evidence.predict_error(names, posterior)
        residual = (residual - evidence.zeros(residual, np.ones(len(residual), bool))) / evidence.points.noise
        freedom = len(residual) - len(np.unique(evidence.points.zero))
        rms = float(np.sqrt(np.sum(residual**2) / max(freedom, 1)))
        limited_evidence = posterior.value
        if evidence.counted_size(names, structure) > limit:
            limited_evidence = evidence.posterior(names, evidence.most_likely(names, limit)).value
        return Trial(names, structure, posterior, predictive, rms, limited_evidence)

    def value(self, trial: Trial, misfit: float = np.inf) -> float:
        """Logarithm of the evidence; of a misfit, with the structure that the form of the model may leave of it."""
        return trial.value if np.isinf(misfit) else trial.limited_evidence

    def predictive(self, trial: Trial) -> Real:
        """Log density (n_parts,) of each part, predicted from all others."""
        return trial.predictive

    def misfit(self, trial: Trial) -> float:
        """Root mean square of what a trial leaves, in the noise."""
        return trial.rms

    def effects(self, trial: Trial) -> Sequence[str]:
        """Names of the effects of a trial."""
        return trial.effects

    def distance(self, trial: Trial, effect: str, without: Trial | None) -> float:
        """Distance of the size of an effect from zero, in that of the edge of its 95 % region.

        A record is linear in the sizes: the model ``without`` the effect says nothing besides.
        """
        return trial.posterior.distance(self.evidence.columns_of(trial.effects, effect))

    def implausible(self, trial: Trial) -> Iterator[str]:
        """Sizes beyond the twist of the drive, and nothing but waves that errors of parts within tolerances cause."""
        for name in trial.effects:
            if self._size(trial, name) > self.evidence.span:
                yield f"the size of {name} is larger than the twist of the drive"
        yield from self._tolerable(trial)

    def _tolerable(self, trial: Trial) -> Iterator[str]:
        """Why a model is no cause: errors of parts make waves as large as all of its effects."""
        if len(tolerated := self.tolerated_waves(trial)) == len(trial.effects):
            yield f"{TOLERABLE} cause waves as large as {tolerated[0]}"

    def tolerated_waves(self, trial: Trial) -> list[str]:
        """Effects of a trial that are waves of the compliance no larger than errors of parts cause.

        Waves that the record does not tell apart count as their sum: each may be large where they cancel each other.
        """
        names = [n for n in trial.effects if n.startswith("compliance_") and self.evidence.are_waves([n])]
        limit = TOLERATED_SHARE * self.evidence.span
        return [name for name in names if self._amplitude_of_alike(trial, name, names) < limit]

    def _amplitude_of_alike(self, trial: Trial, name: str, others: Sequence[str]) -> float:
        """Amplitude [arcmin] at the largest torque of the sum of a wave and those that beat with it less than once."""
        evidence, waves = self.evidence, self.evidence.waves
        alike = [other for other in others if abs(waves[other] - waves[name]) < LEAST_WAVES]
        sums = [
            evidence.columns[:, evidence.place[other]] @ trial.posterior.mean[evidence.columns_of(trial.effects, other)]
            for other in alike
        ]
        cosine, sine = evidence.columns[:, evidence.place[name]].T
        return float(np.sqrt(2 * np.sum(np.sum(sums, axis=0) ** 2) / np.sum(cosine**2 + sine**2)))

    def _size(self, trial: Trial, name: str) -> float:
        """Size of an effect of a trial [arcmin]."""
        return float(np.linalg.norm(trial.posterior.mean[self.evidence.columns_of(trial.effects, name)]))

    def objections(self, trial: Trial, tried: Mapping[str, Trial], behind: float | None = None) -> Iterator[str]:
        """The clauses (b) to (f) that a model does not meet."""
        yield from super().objections(trial, tried, behind)
        if misfit := self._misfit_reason(trial, tried[""]):
            yield misfit

    def _misfit_reason(self, trial: Trial, base: Trial) -> str:
        """Why unused data are not predicted as a right model would, or "".

        Notes
        -----
        A right model leaves noise, what contacts that close make at a held torque, and a structure of the size of its
        form; and what the zeros and the sizes by the other parts are uncertain by.
        """
        evidence, points = self.evidence, self.evidence.points
        if len(np.unique(self.parts)) < 2:
            return "nothing is held out, so the fit cannot be tested"
        square, plain_gain, freedom = 0.0, 0.0, len(np.unique(points.kind))  # within a pass places are alike
        beside_noise = trial.structure.closing**2 + trial.structure.drift**2 + form_limit(base.rms) ** 2
        variance = points.noise**2 + points.shift**2 + beside_noise * evidence.unit**2
        for number in np.unique(self.parts):
            is_held_out = self.parts == number
            posterior = evidence.posterior(trial.effects, trial.structure, int(number), self.parts)
            residual = points.error - evidence.predict_error(trial.effects, posterior)
            of_zero = evidence.zero_variance(variance, ~is_held_out)
            is_known = np.isfinite(of_zero[is_held_out])
            misfit = evidence.unused_misfit(residual, is_held_out, trial.effects)[is_known]
            without = evidence.unused_misfit(points.error, is_held_out, trial.effects)[is_known]
            left_open = evidence.size_variance(trial.effects, posterior, is_held_out)[is_known]
            square += float(np.sum(misfit**2 / ((variance + of_zero)[is_held_out][is_known] + left_open)))
            plain_gain += float(np.sum(without**2) - np.sum(misfit**2))
        n = max(int(np.sum(np.isfinite(evidence.zeros(points.error, np.ones(len(points), bool))))), 1)
        share = float(np.mean(points.shift**2 / variance))  # of the variance, known by the repeats alone
        known_freedom = points.repeats / max(share, 1e-6) ** 2 if points.repeats else np.inf
        if square > n * fdtri(max(freedom, 1), known_freedom, CONFIDENCE):
            return f"unused data are missed by {np.sqrt(square / n):.2g} times what a right model would leave"
        return "the mean of the other passes predicts unused data better" if plain_gain < 0 else ""

"""What could hide: for each effect the size that would be noticed, and the size that would be named."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, ndtri  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness, Rounding, Shown
from pipeline.identification.fitting.fitter import OPEN_SHARE, Fitter
from pipeline.identification.fitting.parameters import Vector, shares_of_values
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.covariance import Structure
from pipeline.identification.selection.criteria import LARGEST_CLASS, NAMED_ODDS, Trial, prior_log_odds
from pipeline.identification.selection.evidence import PRIOR_WIDTHS
from pipeline.statistics.resampling import CONFIDENCE

START: Shown = 0.01
"""First size that is looked at, in parts of an effect's bounds."""
STEPS: Fineness = 6
"""Predictions at most."""
SMALLEST: Rounding = 1e-6
"""Size, in parts of an effect's bounds, below which none is looked at."""
AGREEMENT: Shown = 0.05
"""Relative error of the size that is good enough."""


@dataclass(frozen=True)
class DetectionLimit:
    """Sizes of an effect, in addition to what the refitted model misses, noticed and named with 95 % probability.

    Attributes
    ----------
    effect, parameter, unit : whose size it is; of two amplitudes the first, at the phase of the second one's zero.
    noticed : from which "no effect" is rejected; NaN where not even the library's bound would be.
    named : from which it is named, alone or in a class of three; NaN where none is: beyond the library's bound, or
        where structure is left that no effect explains, which refuses every name.
    """

    effect: str
    parameter: str
    unit: str
    noticed: float
    named: float


def detection_limits(fitter: Fitter, base: Trial, testable: Mapping[str, Candidate]) -> tuple[DetectionLimit, ...]:
    """Detection limits of effects beside a model without any.

    Notes
    -----
    The change of the curves by an effect is put into what the model misses, less all that calibrated numbers,
    tolerances and the structure beside the model take up of it within their priors. What the branches miss already is
    resampled: its sandwich variance, at least that of noise, says how far the size scatters from one such record to
    the next. Named is what leaves at most two other effects as probable.
    """
    searches = [_Sought(fitter, base, effect, len(testable)) for effect in testable.values()]
    products = base.evidence.information(np.column_stack([item.pattern for item in searches]))
    limits = []
    for number, item in enumerate(searches):
        own_product = products[number, number]
        apart = [
            (max(own_product - products[number, k] ** 2 / (products[k, k] + 1 / rival.prior**2), 1e-12), rival)
            for k, rival in enumerate(searches)
            if k != number and products[k, k] > 0
        ]
        limits.append(item.limit([(item.cost - rival.cost, product) for product, rival in apart]))
    return tuple(limits)


class _Sought:
    """The size of one effect that is noticed, by a few predictions.

    Attributes
    ----------
    pattern : (n_cells,) [arcmin] change of the angle at that size, or at the bound.
    amplitude : that size as a share of the bound.
    prior : prior standard deviation of the size, in that size.
    least_share : of that size that is noticed at least: all of it where the pattern does not grow with the size.
    scatter : standard deviation of the size from one record to the next, over that of noise; at least 1.
    cost : logarithm of what the evidence asks for the parameters of the effect.
    structure : beside a model without effects that takes up most of the pattern for what it costs.
    """

    def __init__(self, fitter: Fitter, base: Trial, effect: Candidate, n_tried: int):
        self.fitter, self.base, self.effect, self.n_tried = fitter, base, effect, n_tried
        self.bounds = fitter.problem.bounds(effect)
        self.grows = next((k for k, (low, high) in enumerate(self.bounds) if low <= 0 <= high), 0)
        self.base_angle = fitter.predict(Model(), base.fit.unknowns).angle
        self.scatter, self.cost, self.is_noticed, self.amplitude, self.least_share = 1.0, 0.0, False, START, 0.0
        self.structure = base.evidence.structure
        self.pattern = np.zeros_like(self.base_angle)
        self._follow()
        if len(self.bounds) > 1 and self.is_noticed:
            self.cost = self._cost_of_all()

    @property
    def prior(self) -> float:
        low, high = self.bounds[self.grows]
        return OPEN_SHARE * (high - low) / abs(self._values(self.amplitude)[self.grows])

    def _values(self, amplitude: float) -> Sequence[float]:
        middle = [
            0.0 if low <= 0 <= high else float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
            for low, high in self.bounds
        ]
        middle[self.grows] = amplitude * max(self.bounds[self.grows], key=abs)
        return middle

    def _unknowns(self, amplitude: float) -> Vector:
        return replace(self.base.fit.unknowns, shares=shares_of_values(self.bounds, self._values(amplitude)))

    def _change(self, amplitude: float) -> Real | None:
        prediction = self.fitter.predict(Model((self.effect,)), self._unknowns(amplitude))
        return prediction.angle - self.base_angle if prediction.sound else None

    def _follow(self) -> None:
        """Follow the size to where it is noticed, its other parameters as they are.

        Where a row jumps through the play, the pattern does not grow with the size, and the search might oscillate. It
        therefore stays between the largest size that is hidden and the smallest that is noticed; if it does not settle,
        the latter is the answer.
        """
        hidden_size, noticed_size = 0.0, np.inf
        for _ in range(STEPS):
            ratio = self._needed_share_at(self.amplitude)
            self.is_noticed = ratio < 1 + AGREEMENT
            if abs(ratio - 1) < AGREEMENT or not np.isfinite(ratio) or (ratio > 1 and self.amplitude >= 1.0):
                return
            hidden_size = max(hidden_size, self.amplitude) if ratio > 1 else hidden_size
            noticed_size = min(noticed_size, self.amplitude) if ratio < 1 else noticed_size
            next_size = float(np.clip(ratio * self.amplitude, SMALLEST, 1.0))
            is_between = hidden_size < next_size < noticed_size
            middle = float(np.sqrt(max(hidden_size, SMALLEST) * min(noticed_size, 1.0)))
            self.amplitude = next_size if is_between else middle
        self.is_noticed = bool(np.isfinite(noticed_size))
        if self.is_noticed:
            self.amplitude, self.least_share = noticed_size, 1.0
            self._needed_share_at(noticed_size)

    def _needed_share_at(self, amplitude: float) -> float:
        """Share of the pattern at a size that rejects "no effect"; infinite where the drive has no equilibrium."""
        change, evidence = self._change(amplitude), self.base.evidence
        if change is None or not np.all(np.isfinite(change)):
            return np.inf
        self.pattern = change
        information = float(evidence.information(change[:, None])[0, 0])
        scores = evidence.scores(change[:, None])[:, 0]
        self.cost = self._cost_of_parameters(change[:, None] * self.prior, np.array([True]))
        self.scatter = float(np.sqrt(max(1.0, np.sum(scores**2) / max(information, 1e-300))))
        self.structure = evidence.best_structure(self._needed_share, self.structure)
        return self._needed_share(self.structure)

    def _needed_share(self, structure: Structure) -> float:
        """Share of the pattern that rejects "no effect" with a structure, with 95 % probability.

        A larger structure beside the model without effects takes up more of the pattern, but is less probable where the
        pattern is not there.
        """
        evidence = self.base.evidence
        odds = NAMED_ODDS + self.cost - prior_log_odds(1, self.n_tried) - evidence.fall(structure)
        return self._share_for(odds, float(evidence.information(self.pattern[:, None], structure)[0, 0]))

    def _share_for(self, odds: float, information: float) -> float:
        """Share of the pattern that has some odds with 95 % probability, by its information; 0 where none is needed."""
        if odds <= 0:
            return 0.0
        return float((np.sqrt(2 * odds) + ndtri(CONFIDENCE) * self.scatter) / np.sqrt(max(information, 1e-12)))

    def _cost_of_parameters(self, changes: Real, is_size: Truth) -> float:
        """Fall of the evidence by the prior of parameters, averaged over all widths of the prior of the sizes.

        ``changes`` (n_cells, n_parameters) [arcmin] are those by one standard deviation of each widest prior.
        """
        information = self.base.evidence.information(changes)
        costs = []
        for width in PRIOR_WIDTHS:
            widths = np.where(is_size, width, 1.0)
            precision = np.eye(len(widths)) + widths[:, None] * information * widths
            costs.append(0.5 * np.linalg.slogdet(precision)[1] + 0.5 / (width * self.prior) ** 2)
        halves = sum(low == 0 for low, _ in self.bounds)
        return float(np.log(len(PRIOR_WIDTHS)) - logsumexp(-np.array(costs)) - halves * np.log(2))

    def _cost_of_all(self) -> float:
        """As ``_cost_of_parameters``, of all parameters at the size that was found: phases and times are fitted too."""
        fitter, model, base = self.fitter, Model((self.effect,)), self.base.fit
        unknowns = self._unknowns(self.amplitude)
        prediction = fitter.predict(model, unknowns)
        known_derivatives = base.unknowns.scales, base.jacobian
        weight = 1 / fitter.problem.data.sigma**2
        first = len(unknowns.scales)
        jacobian, _ = fitter.jacobian(model, unknowns, prediction, fitter.positions, weight, known_derivatives)
        is_size = np.array([low <= 0 <= high for low, high in self.bounds])
        return self._cost_of_parameters(OPEN_SHARE * jacobian[:, first : first + len(self.bounds)], is_size)

    def limit(self, rivals: Sequence[tuple[float, float]]) -> DetectionLimit:
        """Both sizes.

        Parameters
        ----------
        rivals : of each other effect, how much less its parameters cost, and the information of the pattern that it
            does not take up.
        """
        parameter = self.effect.parameters[self.grows]
        size = abs(self._values(self.amplitude)[self.grows])
        bound = max(abs(low_or_high) for low_or_high in self.bounds[self.grows])
        noticed_size = size * max(self._needed_share(self.structure), self.least_share)
        as_probable = [self._share_for(cost - NAMED_ODDS, information) for cost, information in rivals]
        told_apart = [self._share_for(cost + NAMED_ODDS, information) for cost, information in rivals]
        needed = as_probable + sorted(told_apart, reverse=True)[LARGEST_CLASS - 1 :]
        named_size = max([noticed_size, *(size * share for share in needed)])
        noticed_size = float(min(noticed_size, bound)) if self.is_noticed else float("nan")
        named_size = float(named_size) if self.is_noticed and named_size <= bound else float("nan")
        return DetectionLimit(self.effect.name, parameter.name, parameter.unit, noticed_size, named_size)

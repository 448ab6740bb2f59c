"""What could hide: for each effect the size that would be noticed, and the size that would be named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri  # scipy.stats is slow to import

from pipeline.identification.fitting.fitter import OPEN_SHARE, Fitter
from pipeline.identification.fitting.parameters import shares_of_values
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.criteria import LARGEST_CLASS, ODDS, Trial, prior_log_odds
from pipeline.identification.selection.evidence import CONFIDENCE

Real = NDArray[np.float64]

START = 0.01
"""First size that is looked at, in parts of an effect's bounds."""
STEPS, AGREEMENT = 6, 0.05
"""Predictions at most, and relative error of the size that is good enough."""


@dataclass(frozen=True)
class DetectionLimit:
    """Sizes of an effect that would be noticed, and named, with 95 % probability.

    Attributes
    ----------
    effect, parameter, unit : whose size it is; of two amplitudes the first, at the phase of the second one's zero.
    noticed : from which "no effect" is rejected; NaN where not even the library's bound would be.
    named : from which it is named, alone or in a class of three.
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
    sought = {name: _Sought(fitter, base, effect, len(testable)) for name, effect in testable.items()}
    patterns = np.column_stack([item.pattern for item in sought.values()])
    products = base.evidence.information(patterns)
    priors = np.array([item.prior for item in sought.values()])
    limits = []
    for number, item in enumerate(sought.values()):
        own = products[number, number]
        rivals = [k for k in range(len(patterns.T)) if k != number and products[k, k] > 0]
        left = sorted(own - products[number, k] ** 2 / (products[k, k] + 1 / priors[k] ** 2) for k in rivals)
        apart = left[LARGEST_CLASS - 1] if len(left) >= LARGEST_CLASS else own
        limits.append(item.limit(own, max(apart, 1e-12 * own)))
    return tuple(limits)


class _Sought:
    """The size of one effect that is noticed, by a few predictions.

    Attributes
    ----------
    pattern : (n_cells,) [arcmin] change of the angle at that size, or at the bound.
    amplitude : that size as a share of the bound.
    prior : prior standard deviation of the size, in that size.
    """

    def __init__(self, fitter: Fitter, base: Trial, effect: Candidate, tried: int):
        self.fitter, self.base, self.effect, self.tried = fitter, base, effect, tried
        self.bounds = fitter.problem.bounds(effect)
        self.grows = next((k for k, (low, high) in enumerate(self.bounds) if low <= 0 <= high), 0)
        self.plain = fitter.predict(Model(), base.fit.unknowns).angle
        self.scatter, self.noticed, self.amplitude = 1.0, False, START
        self.pattern = np.zeros_like(self.plain)
        self._search()

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

    def _change(self, amplitude: float) -> Real | None:
        unknowns = replace(self.base.fit.unknowns, shares=shares_of_values(self.bounds, self._values(amplitude)))
        prediction = self.fitter.predict(Model((self.effect,)), unknowns)
        return prediction.angle - self.plain if prediction.sound else None

    def _search(self) -> None:
        for _ in range(STEPS):
            change = self._change(self.amplitude)
            if change is None or not np.all(np.isfinite(change)):
                self.noticed = False
                return
            self.pattern = change
            seen = float(self.base.evidence.information(change[:, None])[0, 0])
            scores = self.base.evidence.scores(change[:, None])[:, 0]
            self.scatter = float(np.sqrt(max(1.0, np.sum(scores**2) / max(seen, 1e-300))))
            ratio = self._needed(seen) / np.sqrt(max(seen, 1e-12))
            self.noticed = ratio <= 1 + AGREEMENT
            if abs(ratio - 1) < AGREEMENT or (ratio > 1 and self.amplitude >= 1.0):
                return
            self.amplitude = float(np.clip(ratio * self.amplitude, 1e-6, 1.0))

    def _needed(self, seen: float) -> float:
        """Root of the information that rejects "no effect" with 95 % probability."""
        cost = 0.5 * np.log1p(seen * self.prior**2) - prior_log_odds(1, self.tried)
        return float(np.sqrt(2 * (ODDS + cost)) + ndtri(CONFIDENCE) * self.scatter)

    def limit(self, own: float, apart: float) -> DetectionLimit:
        """Both sizes; ``own`` and ``apart``: information of the pattern, and less what the third rival takes up."""
        parameter = self.effect.parameters[self.grows]
        size = abs(self._values(self.amplitude)[self.grows])
        bound = max(abs(low_or_high) for low_or_high in self.bounds[self.grows])
        told_apart = np.sqrt(2 * ODDS) + ndtri(CONFIDENCE) * self.scatter
        named = size * max(told_apart / np.sqrt(apart), self._needed(own) / np.sqrt(max(own, 1e-12)))
        noticed = size if self.noticed else float("nan")
        named = float(named) if self.noticed and named <= bound else float("nan")
        return DetectionLimit(self.effect.name, parameter.name, parameter.unit, noticed, named)

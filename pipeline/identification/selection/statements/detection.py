"""What could hide: for each effect the size that would be noticed, and the size that would be named."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri  # scipy.stats is slow to import

from pipeline.arrays import Real
from pipeline.identification.fitting.fitter import OPEN_SHARE, Fitter
from pipeline.identification.fitting.parameters import shares_of_values
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.criteria import LARGEST_CLASS, ODDS, Trial, prior_log_odds
from pipeline.statistics.resampling import CONFIDENCE

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
    is_noticed : from which "no effect" is rejected; NaN where not even the library's bound would be.
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
    searches = {name: _Sought(fitter, base, effect, len(testable)) for name, effect in testable.items()}
    patterns = np.column_stack([item.pattern for item in searches.values()])
    products = base.evidence.information(patterns)
    priors = np.array([item.prior for item in searches.values()])
    limits = []
    for number, item in enumerate(searches.values()):
        own_product = products[number, number]
        rivals = [k for k in range(len(patterns.T)) if k != number and products[k, k] > 0]
        products_left = sorted(
            own_product - products[number, k] ** 2 / (products[k, k] + 1 / priors[k] ** 2) for k in rivals
        )
        product_apart = products_left[LARGEST_CLASS - 1] if len(products_left) >= LARGEST_CLASS else own_product
        limits.append(item.limit(own_product, max(product_apart, 1e-12 * own_product)))
    return tuple(limits)


class _Sought:
    """The size of one effect that is noticed, by a few predictions.

    Attributes
    ----------
    pattern : (n_cells,) [arcmin] change of the angle at that size, or at the bound.
    amplitude : that size as a share of the bound.
    prior : prior standard deviation of the size, in that size.
    """

    def __init__(self, fitter: Fitter, base: Trial, effect: Candidate, n_tried: int):
        self.fitter, self.base, self.effect, self.n_tried = fitter, base, effect, n_tried
        self.bounds = fitter.problem.bounds(effect)
        self.grows = next((k for k, (low, high) in enumerate(self.bounds) if low <= 0 <= high), 0)
        self.base_angle = fitter.predict(Model(), base.fit.unknowns).angle
        self.scatter, self.is_noticed, self.amplitude = 1.0, False, START
        self.pattern = np.zeros_like(self.base_angle)
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
        return prediction.angle - self.base_angle if prediction.sound else None

    def _search(self) -> None:
        for _ in range(STEPS):
            change = self._change(self.amplitude)
            if change is None or not np.all(np.isfinite(change)):
                self.is_noticed = False
                return
            self.pattern = change
            information = float(self.base.evidence.information(change[:, None])[0, 0])
            scores = self.base.evidence.scores(change[:, None])[:, 0]
            self.scatter = float(np.sqrt(max(1.0, np.sum(scores**2) / max(information, 1e-300))))
            ratio = self._root_of_needed_information(information) / np.sqrt(max(information, 1e-12))
            self.is_noticed = ratio <= 1 + AGREEMENT
            if abs(ratio - 1) < AGREEMENT or (ratio > 1 and self.amplitude >= 1.0):
                return
            self.amplitude = float(np.clip(ratio * self.amplitude, 1e-6, 1.0))

    def _root_of_needed_information(self, information: float) -> float:
        """Root of the information that rejects "no effect" with 95 % probability."""
        cost = 0.5 * np.log1p(information * self.prior**2) - prior_log_odds(1, self.n_tried)
        return float(np.sqrt(2 * (ODDS + cost)) + ndtri(CONFIDENCE) * self.scatter)

    def limit(self, own_product: float, product_apart: float) -> DetectionLimit:
        """Both sizes, from the information of the pattern and of what the third rival leaves of it."""
        parameter = self.effect.parameters[self.grows]
        size = abs(self._values(self.amplitude)[self.grows])
        bound = max(abs(low_or_high) for low_or_high in self.bounds[self.grows])
        told_apart = np.sqrt(2 * ODDS) + ndtri(CONFIDENCE) * self.scatter
        noticed_size = size * self._root_of_needed_information(own_product) / np.sqrt(max(own_product, 1e-12))
        named_size = max(noticed_size, size * told_apart / np.sqrt(product_apart))
        noticed_size = float(min(noticed_size, bound)) if self.is_noticed else float("nan")
        named_size = float(named_size) if self.is_noticed and named_size <= bound else float("nan")
        return DetectionLimit(self.effect.name, parameter.name, parameter.unit, noticed_size, named_size)

"""What could hide: for each effect the size that these data would have shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri  # scipy.stats is slow to import

from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.parameters import Fit, unmapped
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.selection.cross_validation import Trial
from pipeline.identification.selection.parameter_intervals import STRUCTURE

Real = NDArray[np.float64]
Truth = NDArray[np.bool_]

CONFIDENCE = 0.95
"""Probability with which an effect of the stated size would have shown."""
START = 0.01
"""First size that is looked at, in parts of an effect's bounds."""
STEPS, AGREEMENT = 8, 0.05
"""Secant steps, and relative error of the change that is good enough."""
LEAST = 1e-6
"""Share of an effect's range below which no size is sought."""


@dataclass(frozen=True)
class DetectionLimit:
    """Size of an effect from which it would have shown with 95 % probability.

    Attributes
    ----------
    effect, parameter, unit : whose size it is; of two amplitudes the first, at the phase of the second one's zero.
    value : in that unit; NaN where not even the library's bound would have shown.
    """

    effect: str
    parameter: str
    unit: str
    value: float


def detection_limits(
    fitter: Fitter, base: Trial, cells: Truth, testable: Mapping[str, Candidate]
) -> tuple[DetectionLimit, ...]:
    """Detection limits of effects beside a model without any.

    Notes
    -----
    An effect shows where the mean loss of the base exceeds ``STRUCTURE`` squared. Its change of the cells, in noise,
    less what calibrated numbers and tolerances take up of it within their priors, adds its mean square to it. Its
    standard error comes from the spread of the losses between branches. The bounds of the numbers are not counted,
    so that the limit is rather too large.
    """
    needed_gain = needed_square(base.losses)
    basis = _Nuisance.of(fitter, base.fit, cells)
    return tuple(_limit(fitter, base.fit, effect, basis, needed_gain) for effect in testable.values())


def needed_square(losses: Real) -> float:
    """Mean square in noise that an effect must add to noise alone to show: losses above it may hold the effect."""
    error = float(np.std(losses, ddof=1) / np.sqrt(len(losses))) if len(losses) > 1 else 0.0
    return STRUCTURE**2 - min(float(np.mean(losses)), 1.0) + float(ndtri(CONFIDENCE)) * error


@dataclass(frozen=True)
class _Nuisance:
    """What a model without effects can take up of a change, and the cells that count."""

    basis: Real
    noise: Real
    cells: Truth

    @classmethod
    def of(cls, fitter: Fitter, fit: Fit, cells: Truth) -> _Nuisance:
        noise = fitter.problem.data.sigma[cells]
        rows = np.vstack([fit.jacobian[cells] / noise[:, None], np.diag(fitter.penalty(fit.unknowns))])
        return cls(np.linalg.qr(rows)[0] if rows.shape[1] else rows, noise, cells)

    def left(self, fitter: Fitter, change: Real) -> float:
        """Mean square [noise] of what is left of a change (n_cells,) [arcmin]."""
        centred_change = fitter.centred(change, np.where(self.cells, 1 / fitter.problem.data.sigma**2, 0.0))[self.cells]
        goal = np.concatenate([centred_change / self.noise, np.zeros(self.basis.shape[1])])
        goal = goal - self.basis @ (self.basis.T @ goal)
        return float(np.mean(goal[: len(centred_change)] ** 2))


def _limit(fitter: Fitter, base: Fit, effect: Candidate, nuisance: _Nuisance, needed_gain: float) -> DetectionLimit:
    bounds = fitter.problem.bounds(effect)
    grows = next((k for k, (low, high) in enumerate(bounds) if low <= 0 <= high), 0)
    parameter = effect.parameters[grows]
    base_angle = fitter.predict(Model(), base.unknowns).angle

    def values(amplitude: float) -> list[float]:
        middle = [
            0.0 if low <= 0 <= high else float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
            for low, high in bounds
        ]
        middle[grows] = amplitude * max(bounds[grows], key=abs)
        return middle

    def shown(amplitude: float) -> float:
        unknowns = replace(base.unknowns, shares=unmapped(bounds, values(amplitude)))
        prediction = fitter.predict(Model((effect,)), unknowns)
        return nuisance.left(fitter, prediction.angle - base_angle) if prediction.sound else np.nan

    low, high, amplitude = LEAST, 1.0, START
    for _ in range(STEPS):
        square = shown(amplitude)
        if not np.isfinite(square) or (square < needed_gain and amplitude >= 1.0):
            return DetectionLimit(effect.name, parameter.name, parameter.unit, np.nan)
        if abs(square / needed_gain - 1) < AGREEMENT:
            break
        low, high = (amplitude, high) if square < needed_gain else (low, amplitude)
        guess = amplitude * np.sqrt(needed_gain / max(square, 1e-6 * needed_gain))
        amplitude = float(min(guess, high) if low < guess else np.sqrt(low * high))
    return DetectionLimit(effect.name, parameter.name, parameter.unit, abs(values(amplitude)[grows]))

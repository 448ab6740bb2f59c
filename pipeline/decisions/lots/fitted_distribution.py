"""The distribution of measured deviations: each kind fitted by maximum likelihood, the kind chosen by BIC.

Source
------
Schwarz, Estimating the dimension of a model, Ann. Stat. 6 (1978) 461: BIC = k ln n - 2 ln L. The ends of a uniform
distribution are those of David, Nagaraja, Order Statistics (2003), unbiased rather than of maximum likelihood.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Real
from pipeline.config.dimensions import Dimension
from pipeline.config.distributions import Distribution, library
from pipeline.config.files.section import LARGEST_UM

LIMITS_IN_SIGMA = 4.0
"""Limits of a fitted normal distribution that the drawing does not truncate: 6e-5 of the parts lie beyond."""
DIGITS = 5
"""Significant digits of a fitted number in a study file."""


@dataclass(frozen=True)
class FittedKind:
    """One kind of distribution at its best fit.

    Attributes
    ----------
    distribution : with the fitted numbers, about the allowance of the drawing.
    bic : Bayesian information criterion; the smallest is chosen.
    """

    distribution: Distribution
    bic: float


def fitted_kinds(values: Real, dimension: Dimension, drawing: Distribution) -> list[FittedKind]:
    """Every kind that describes the deviations, the best first.

    Parameters
    ----------
    values : (n,) total deviations [um]; of a circular zone distances from its centre.
    drawing : tolerance of the study, whose allowance is kept and at whose limits parts may have been sorted.
    """
    deviation = values - drawing.allowance_um
    fits = _ZONE_FITS if dimension.zone else _FITS
    kinds = []
    for fit in fits:
        fitted_kind = fit(deviation, dimension, drawing)
        if fitted_kind is not None:
            settings, log_likelihood, n_parameters = fitted_kind
            settings = {key: _setting(value) if isinstance(value, float) else value for key, value in settings.items()}
            distribution = library()[settings["distribution"]](allowance_um=drawing.allowance_um, **settings)
            kinds.append(FittedKind(distribution, n_parameters * np.log(len(values)) - 2 * log_likelihood))
    return sorted(kinds, key=lambda kind: kind.bic)


def _setting(value: float) -> float:
    """A fitted number [um] as a study file can have it: rounded, and a limit beyond the largest deviation drawn in."""
    return float(f"{np.clip(value, -LARGEST_UM, LARGEST_UM):.{DIGITS}g}")


Fit = tuple[dict[str, Any], float, int] | None
"""Settings of the distribution, logarithm of the likelihood, and number of fitted numbers."""


def _normal(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    mean, scale = float(np.mean(deviation)), float(np.std(deviation))
    if scale == 0:
        return None
    lower, upper = mean - LIMITS_IN_SIGMA * scale, mean + LIMITS_IN_SIGMA * scale
    if dimension.one_sided and lower + drawing.allowance_um < 0:
        return None
    log_likelihood = -len(deviation) * (np.log(scale * np.sqrt(2 * np.pi)) + 0.5)
    return _normal_settings(mean, scale, lower, upper), log_likelihood, 2


def _truncated_normal(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    """Normal before parts beyond the drawing's limits were sorted out."""
    from scipy.optimize import minimize
    from scipy.stats import truncnorm

    lower, upper = drawing.limits_um
    if not drawing.varies or np.min(deviation) < lower or np.max(deviation) > upper or np.std(deviation) == 0:
        return None
    n, width = len(deviation), upper - lower

    def cost(point: Real) -> float:
        mean, scale = point[0], np.exp(point[1])
        ends = (lower - mean) / scale, (upper - mean) / scale
        return -float(np.mean(truncnorm.logpdf(deviation, *ends, loc=mean, scale=scale)))

    start = np.array([np.mean(deviation), np.log(np.std(deviation))])
    box = ((lower, upper), (np.log(1e-3 * width), np.log(2 * width)))
    optimum = minimize(cost, np.clip(start, *np.transpose(box)), method="L-BFGS-B", bounds=box)
    return _normal_settings(float(optimum.x[0]), float(np.exp(optimum.x[1])), lower, upper), -n * float(optimum.fun), 2


def _normal_settings(mean: float, scale: float, lower: float, upper: float) -> dict[str, Any]:
    return {"distribution": "normal", "lower_um": lower, "upper_um": upper, "mean_um": mean, "sigma_um": scale}


def _uniform(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    n, low, high = len(deviation), float(np.min(deviation)), float(np.max(deviation))
    if high == low:
        return None
    margin = (high - low) / (n - 1)
    floor = -drawing.allowance_um if dimension.one_sided else -np.inf
    settings = {"distribution": "uniform", "lower_um": max(low - margin, floor), "upper_um": high + margin}
    return settings, -n * np.log(high - low), 2


def _triangular(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    from scipy.optimize import minimize
    from scipy.special import expit

    low, high = float(np.min(deviation)), float(np.max(deviation))
    spread = high - low
    if spread == 0:
        return None
    floor = -drawing.allowance_um if dimension.one_sided else -np.inf

    def settings(point: Real) -> tuple[float, float, float]:
        lower, upper = max(low - spread * np.exp(point[0]), floor), high + spread * np.exp(point[1])
        return lower, upper, lower + (upper - lower) * expit(point[2])

    def cost(point: Real) -> float:
        lower, upper, mode = settings(point)
        rising, falling = (deviation - lower) / max(mode - lower, 1e-12), (upper - deviation) / max(upper - mode, 1e-12)
        density = 2 / (upper - lower) * np.clip(np.minimum(rising, falling), 1e-12, 1)
        return -float(np.mean(np.log(density)))

    tries = [minimize(cost, [-3.0, -3.0, peak], method="Nelder-Mead") for peak in (-4.0, -1.0, 0.0, 1.0, 4.0)]
    optimum = min(tries, key=lambda attempt: attempt.fun)
    lower, upper, mode = settings(optimum.x)
    values = {"distribution": "triangular", "lower_um": lower, "upper_um": upper, "mode_um": mode}
    return values, -len(deviation) * float(optimum.fun), 3


def _uniform_in_disc(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    n, largest_distance = len(deviation), float(np.max(deviation))
    if largest_distance <= 0:
        return None
    settings = {"distribution": "uniform_in_disc", "radius_um": largest_distance * (2 * n + 1) / (2 * n)}
    return settings, float(np.sum(np.log(2 * np.maximum(deviation, 1e-12) / largest_distance**2))), 1


def _normal_in_disc(deviation: Real, dimension: Dimension, drawing: Distribution) -> Fit:
    """The zone's radius is three standard deviations of a coordinate, as the kind defines it."""
    largest_distance = float(np.max(deviation))
    if largest_distance <= 0:
        return None
    scale = max(float(np.sqrt(np.mean(deviation**2) / 2)) * _TRUNCATION, largest_distance / 3)
    density = np.maximum(deviation, 1e-12) / scale**2 * np.exp(-0.5 * (deviation / scale) ** 2) / -np.expm1(-4.5)
    return {"distribution": "normal_in_disc", "radius_um": 3 * scale}, float(np.sum(np.log(density))), 1


_TRUNCATION = float(1 / np.sqrt(1 - 4.5 * np.exp(-4.5) / -np.expm1(-4.5)))
"""Scale of a Rayleigh distribution cut at three scales, over that which its mean square would give without the cut."""
_FITS: tuple[Callable[[Real, Dimension, Distribution], Fit], ...] = (_normal, _truncated_normal, _uniform, _triangular)
_ZONE_FITS: tuple[Callable[[Real, Dimension, Distribution], Fit], ...] = (_uniform_in_disc, _normal_in_disc)


def relative_bic(kinds: Sequence[FittedKind]) -> Mapping[str, float]:
    """BIC less that of the chosen kind, by kind."""
    names: dict[str, float] = {}
    for kind in kinds:
        names.setdefault(kind.distribution.name, kind.bic - kinds[0].bic)
    return names

"""The yield of a study made from measured lots, and which dimension costs most of it.

The interval of the yield holds two parts: the number of solved units, and the number of measured parts. The second is
that of lots drawn with replacement from the parts, which are fitted and solved again on the same random numbers.
Source: Davison, Hinkley, Bootstrap Methods and their Application (1997), section 2.2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from scipy.special import expit, logit

from pipeline.arrays import Real, Truth
from pipeline.config.distributions.distribution import Distribution
from pipeline.config.distributions.shipped import Fixed
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.fresh_units import Solve, fresh_values, yields
from pipeline.decisions.lots.dimension_fit import DimensionFit
from pipeline.decisions.lots.fitted_distribution import fitted_kinds
from pipeline.errors import InputError
from pipeline.statistics.differences import share_difference
from pipeline.statistics.intervals import Estimate

RESAMPLED_LOTS = 20
"""Lots drawn from the measured parts: their standard deviation is known to 16 %, which Student's t accounts for."""
SHARE_OF_UNITS = 4
"""The units of a resampled lot are this fraction of those of the lot."""


@dataclass(frozen=True)
class DimensionCost:
    """What the spread and the offset of one dimension cost.

    Attributes
    ----------
    yield_at_target : yield of the lot if every part had the drawing's mean in this dimension.
    gain : difference to the yield of the lot, on the same units.
    """

    name: str
    yield_at_target: float
    gain: Estimate


@dataclass(frozen=True)
class LotYield:
    """Yields of fresh load-solved units.

    Attributes
    ----------
    as_drawn, as_made : by metric and against all limits, with the tolerances of the study and with those of the lot;
        the intervals of the second count the number of measured parts too.
    costs : of the measured dimensions, the largest gain first.
    values : of each metric of the units as made (n,), as the limits count them.
    """

    as_drawn: Mapping[str, Estimate]
    as_made: Mapping[str, Estimate]
    costs: tuple[DimensionCost, ...]
    values: Mapping[str, Real]


def study_of_lot(study: Study, fits: Sequence[DimensionFit]) -> Study:
    """The study with the fitted distributions in place of its tolerances."""
    return study.with_section("tolerances", **{fit.dimension.name: fit.tolerance for fit in fits})


def lot_yield(study: Study, fits: Sequence[DimensionFit], solve: Solve, units: int, jobs: int) -> LotYield:
    """Yields of ``units`` fresh units of the study and of the lot; all of them share their random numbers.

    Raises
    ------
    InputError
        If the study sets no limits, or lists cases.
    """
    if not study.limits.of_metrics:
        raise InputError(f"study {study.name}: [limits] is empty; a yield needs a limit")
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases are not drawn; give a study with tolerances")
    lot_study = study_of_lot(study, fits)
    start = study.samples.count

    def values(variant: Study, number: int = units) -> Mapping[str, Real]:
        return fresh_values(variant, start, number, solve, jobs)

    drawn_values, made_values = values(study), values(lot_study)
    confidence, passes = study.metrics.confidence, limit_passes(study, made_values)
    costs = []
    for fit in fits:
        drawing = getattr(study.tolerances, fit.dimension.name)
        perfect = lot_study.with_section("tolerances", **{fit.dimension.name: _target(drawing)})
        perfect_passes = limit_passes(study, values(perfect))
        low, high = share_difference(passes, perfect_passes, confidence, True)
        gain = Estimate(float(perfect_passes.mean() - passes.mean()), low, high, units)
        costs.append(DimensionCost(fit.dimension.name, float(perfect_passes.mean()), gain))
    costs.sort(key=lambda cost: -cost.gain.value)
    as_made = _with_part_uncertainty(study, fits, made_values, yields(study, made_values), values)
    return LotYield(yields(study, drawn_values), as_made, tuple(costs), made_values)


def _with_part_uncertainty(
    study: Study,
    fits: Sequence[DimensionFit],
    made_values: Mapping[str, Real],
    shares: Mapping[str, Estimate],
    values: Callable[..., Mapping[str, Real]],
) -> dict[str, Estimate]:
    """Yields of the lot with intervals that count the number of measured parts.

    The change of the log odds from lot to lot is added, as a variance, to that of the number of solved units.
    """
    units = max(len(next(iter(made_values.values()))) // SHARE_OF_UNITS, 1)
    base = _log_odds(yields(study, {name: column[:units] for name, column in made_values.items()}))
    rng = np.random.default_rng(study.samples.seed)
    moves = []
    for _ in range(RESAMPLED_LOTS):
        lot_study = study.with_section("tolerances", **{fit.dimension.name: _refit(fit, study, rng) for fit in fits})
        odds = _log_odds(yields(study, values(lot_study, units)))
        moves.append({name: odds[name] - base[name] for name in base})
    quantile = float(scipy.stats.t.ppf((1 + study.metrics.confidence) / 2, RESAMPLED_LOTS))
    wide_yields = {}
    for name, share in shares.items():
        parts = quantile * float(np.sqrt(np.mean([move[name] ** 2 for move in moves])))
        centre, low, high = (_odds(value, share.n) for value in (share.value, share.ci_low, share.ci_high))
        low, high = centre - np.hypot(centre - low, parts), centre + np.hypot(high - centre, parts)
        wide_yields[name] = Estimate(
            share.value, min(float(expit(low)), share.ci_low), max(float(expit(high)), share.ci_high), share.n
        )
    return wide_yields


def _log_odds(shares: Mapping[str, Estimate]) -> dict[str, float]:
    return {name: _odds(share.value, share.n) for name, share in shares.items()}


def _odds(share: float, n: int) -> float:
    """Logarithm of the odds, half a unit from either end at the least."""
    return float(logit(np.clip(share, 0.5 / n, 1 - 0.5 / n)))


def _refit(fit: DimensionFit, study: Study, rng: np.random.Generator) -> Distribution:
    """The fit of as many parts drawn from the measured ones with replacement."""
    resampled_values = fit.values[rng.integers(len(fit.values), size=len(fit.values))]
    drawing = getattr(study.tolerances, fit.dimension.name)
    kinds = fitted_kinds(resampled_values.ravel(), fit.dimension, drawing)
    if not kinds:
        return fit.tolerance
    length = getattr(fit.tolerance, "correlation_length_mm", None)
    return kinds[0].distribution.model_copy(update={} if length is None else {"correlation_length_mm": length})


def _target(drawing: Distribution) -> Fixed:
    """The mean of a tolerance in every part."""
    return Fixed(distribution="fixed", allowance_um=drawing.allowance_um, value_um=drawing.average_um)


def limit_passes(study: Study, values: Mapping[str, Real]) -> Truth:
    """Whether each unit (n,) keeps all limits; one without a value keeps none."""
    has_values: Truth = np.all(
        [np.isfinite(values[name]) for name in study.limits.limited_metrics(ALL_LIMITS, values)], axis=0
    )
    return study.limits.pass_flags(values)[ALL_LIMITS] & has_values

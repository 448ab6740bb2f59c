"""The yield of a study made from measured lots, and which dimension costs most of it.

The interval of the yield holds two parts: the number of solved units, and the number of measured parts. The second is
that of other lots that as many parts leave possible, which are solved on the same random numbers.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its optimisers are slow to import: they are when they are called
from scipy.special import log_ndtr, ndtr, ndtri

from pipeline.arrays import Real, Truth
from pipeline.config.distributions.distribution import Distribution
from pipeline.config.distributions.shipped import Fixed
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.decisions.fresh_units import Solve, fresh_values, has_values, preloaded_share, yields
from pipeline.decisions.lots.dimension_fit import SMALLEST, DimensionFit, independent_parts, moments_without_each
from pipeline.errors import InputError
from pipeline.statistics.differences import share_difference
from pipeline.statistics.intervals import Estimate

POSSIBLE_LOTS = 4000
"""Lots that the measured parts leave possible: the ends of a 95 % interval are known to 0.2 % of them."""
SOLVED_LOTS = 50
"""Of these, which are solved."""
SHARE_OF_UNITS = 10
"""The units of a solved lot are this fraction of those of the lot."""
SLOPE = 2.0
"""Change of the probit of the yield by one standard deviation of what is uncertain, as is plausible."""
VERY_STRONG = 10.0
"""Difference of BIC that is very strong evidence (Raftery, Bayesian model selection in social research, Sociol.
Methodol. 25 (1995) 111)."""


@dataclass(frozen=True)
class DimensionCost:
    """What the spread and the offset of one dimension cost.

    Attributes
    ----------
    yield_at_target : yield of the lot if every part had the drawing's mean in this dimension.
    gain : difference to the yield of the lot, on the same units, those that have a value in both.
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
    drawn_preload, made_preload : shares of these units that are preloaded at some crank angle.
    costs : of the measured dimensions, the largest gain first.
    values : of each metric of the units as made (n,), as the limits count them.
    """

    as_drawn: Mapping[str, Estimate]
    as_made: Mapping[str, Estimate]
    drawn_preload: float
    made_preload: float
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
        If the study sets no limits, or lists cases, or no unit of the lot has a result.
    """
    if not study.limits.of_metrics:
        raise InputError(f"study {study.name}: [limits] is empty; a yield needs a limit")
    if study.samples.experiment == "cases":
        raise InputError(f"study {study.name}: listed cases are not drawn; give a study with tolerances")
    lot_study = study_of_lot(study, fits)
    start = study.samples.count

    def values(variant: Study, number: int = units, first: int = start) -> Mapping[str, Real]:
        return fresh_values(variant, first, number, solve, jobs)

    drawn_values, made_values = values(study), values(lot_study)
    confidence, passes = study.metrics.confidence, limit_passes(study, made_values)
    are_known = has_values(study, made_values, ALL_LIMITS)
    if not are_known.any():
        names = ", ".join(fit.dimension.name for fit in fits)
        raise InputError(
            f"study {study.name}: none of {units} units with the measured {names} has a result; give deviations from "
            "the nominal sizes in um, with the signs of the study"
        )
    costs = []
    for fit in fits:
        drawing = getattr(study.tolerances, fit.dimension.name)
        perfect = lot_study.with_section("tolerances", **{fit.dimension.name: _target(drawing)})
        perfect_values = values(perfect)
        has_both = are_known & has_values(study, perfect_values, ALL_LIMITS)
        if not has_both.any():
            continue
        pair = passes[has_both], limit_passes(study, perfect_values)[has_both]
        low, high = share_difference(*pair, confidence, True)
        gain = Estimate(float(pair[1].mean() - pair[0].mean()), low, high, len(pair[0]))
        costs.append(DimensionCost(fit.dimension.name, yields(study, perfect_values)[ALL_LIMITS].value, gain))
    costs.sort(key=lambda cost: -cost.gain.value)
    as_made = _with_part_uncertainty(study, fits, units, yields(study, made_values), values)
    preload = preloaded_share(drawn_values), preloaded_share(made_values)
    return LotYield(yields(study, drawn_values), as_made, *preload, tuple(costs), made_values)


def _with_part_uncertainty(
    study: Study,
    fits: Sequence[DimensionFit],
    units: int,
    shares: Mapping[str, Estimate],
    values: Callable[..., Mapping[str, Real]],
) -> dict[str, Estimate]:
    """Yields of the lot with intervals that count the number of measured parts.

    The probit of the yield is fitted as linear in the means and in the logarithms of the spreads of other lots, over
    all units of these, which are units of their own: exact of one normal metric in its mean, nearly so in its spread.
    The interval has the quantiles of the yield over the lots that the measured parts leave possible, each with
    coefficients that the solved units leave possible. It is not symmetrical: at a high yield a wider or displaced lot
    loses more than a narrower one gains.
    """
    number, first = max(units // SHARE_OF_UNITS, 1), study.samples.count + units
    rng = np.random.default_rng(study.samples.seed)
    changes = np.stack([[changes_of_lot(fit, rng) for fit in fits] for _ in range(POSSIBLE_LOTS)])
    solved_yields = []
    for lot, change in enumerate(changes[:SOLVED_LOTS]):
        tolerances = {fit.dimension.name: other_lot(fit, *of_fit) for fit, of_fit in zip(fits, change, strict=True)}
        lot_study = study.with_section("tolerances", **tolerances)
        solved_yields.append(yields(study, values(lot_study, number, first + lot * number)))
    regressors = changes.reshape(len(changes), -1)
    regressors = regressors / np.maximum(np.std(regressors, axis=0), SMALLEST)
    tails = (1 - study.metrics.confidence) / 2, (1 + study.metrics.confidence) / 2
    wide_yields = {}
    for name, share in shares.items():
        solved_units = np.array([solved[name].n for solved in solved_yields])
        passes = np.nan_to_num([solved[name].value for solved in solved_yields]) * solved_units
        value, factor = probit_line(regressors[:SOLVED_LOTS], passes, solved_units)
        coefficients = value + rng.standard_normal((len(regressors), len(value))) @ factor.T
        probits = coefficients[:, 0] + np.sum(regressors * coefficients[:, 1:], axis=1)
        low, high = np.quantile(ndtr(probits), tails)
        ends = min(float(low), share.ci_low), max(float(high), share.ci_high)
        wide_yields[name] = replace(share, ci_low=ends[0], ci_high=ends[1])
    return wide_yields


def probit_line(regressors: Real, passes: Real, number: Real) -> tuple[Real, Real]:
    """Coefficients (1 + n_regressors,) of the probit of passing, a constant first, and a factor of their covariance.

    Parameters
    ----------
    regressors : (n_lots, n_regressors).
    passes, number : (n_lots,) units that pass, and all units of each lot.

    Notes
    -----
    The maximum of the posterior, and its curvature there. The prior of the slopes is normal about zero with a standard
    deviation of `SLOPE`; half a unit that passes and half a unit that fails are spread over the lots.
    """
    design = np.column_stack([np.ones(len(passes)), regressors])
    passed, failed = passes + 0.5 / len(passes), number - passes + 0.5 / len(passes)
    weight = np.append(0.0, np.full(regressors.shape[1], SLOPE**-2))

    def hazards(probit: Real) -> tuple[Real, Real]:
        log_density = -0.5 * probit**2 - 0.5 * np.log(2 * np.pi)
        return np.exp(log_density - log_ndtr(probit)), np.exp(log_density - log_ndtr(-probit))

    def cost(coefficients: Real) -> tuple[float, Real]:
        probit = design @ coefficients
        of_pass, of_fail = hazards(probit)
        value = -passed @ log_ndtr(probit) - failed @ log_ndtr(-probit) + 0.5 * weight @ coefficients**2
        return float(value), design.T @ (failed * of_fail - passed * of_pass) + weight * coefficients

    start = np.append(ndtri(passed.sum() / (passed + failed).sum()), np.zeros(regressors.shape[1]))
    best = np.asarray(scipy.optimize.minimize(cost, start, jac=True, method="L-BFGS-B").x, float)
    probit = design @ best
    of_pass, of_fail = hazards(probit)
    curvature = passed * of_pass * (of_pass + probit) + failed * of_fail * (of_fail - probit)
    information = design.T @ (curvature[:, None] * design) + np.diag(weight)
    return best, np.asarray(np.linalg.inv(np.linalg.cholesky(information)).T, float)


def changes_of_lot(fit: DimensionFit, rng: np.random.Generator) -> tuple[float, float]:
    """Shift of the mean [um] and logarithm of the stretch of a distribution that the lot may have.

    Parts of a normal distribution have the mean x + s z / sqrt(n c) and the standard deviation s / sqrt(c), with z
    normal and c chi-square over its n - 1 degrees of freedom. Where parts have many elements, the standard deviation of
    all of them has f degrees of freedom, where its logarithm scatters by 1 / sqrt(2 f), by the jackknife.

    Source
    ------
    Weerahandi, Generalized confidence intervals, J. Am. Stat. Assoc. 88 (1993) 899.
    """
    parts = independent_parts(fit.values)
    n = len(parts)
    stretch = np.sqrt((n - 1) / rng.chisquare(n - 1))
    shift = stretch * np.std(parts.mean(axis=1), ddof=1) / np.sqrt(n) * rng.standard_normal()
    if parts.shape[1] > 1:
        _, spreads = moments_without_each(fit.values)
        scatter_square = (n - 1) * np.var(np.log(np.maximum(spreads, SMALLEST)))
        freedom = float(np.clip(0.5 / scatter_square, 1, fit.values.size - 1))
        stretch = np.sqrt(freedom / rng.chisquare(freedom))
    return float(shift), float(np.log(stretch))


def other_lot(fit: DimensionFit, shift: float, log_stretch: float) -> Distribution:
    """The distribution of a lot, moved by a shift [um] and stretched about its mean.

    A normal distribution, the one that no limits cut, unless another kind fits by `VERY_STRONG` better: few parts show
    no tails, and a kind without any promises too much.
    """
    normal = [kind for kind in fit.kinds if kind.distribution.name == "normal"]
    widest = max(normal, key=lambda kind: float(np.ptp(kind.distribution.limits_um)), default=fit.kinds[0])
    is_plausible = widest.bic - fit.kinds[0].bic < VERY_STRONG
    distribution = (widest if is_plausible else fit.kinds[0]).distribution
    stretch, mean = np.exp(log_stretch), fit.mean.value - distribution.allowance_um
    length = getattr(fit.tolerance, "correlation_length_mm", None)
    changes = {} if length is None else {"correlation_length_mm": length}
    floor = -distribution.allowance_um if fit.dimension.one_sided else -np.inf
    for key, number in distribution.model_dump().items():
        if key in ("sigma_um", "radius_um") and number is not None:
            changes[key] = float(stretch * number)
        if key in ("lower_um", "upper_um", "mean_um", "mode_um") and number is not None:
            changes[key] = float(max(mean + shift + stretch * (number - mean), floor))
    return distribution.model_copy(update=changes)


def _target(drawing: Distribution) -> Fixed:
    """The mean of a tolerance in every part."""
    return Fixed(distribution="fixed", allowance_um=drawing.allowance_um, value_um=drawing.average_um)


def limit_passes(study: Study, values: Mapping[str, Real]) -> Truth:
    """Whether each unit (n,) keeps all limits; one without a value keeps none."""
    return study.limits.pass_flags(values)[ALL_LIMITS] & has_values(study, values, ALL_LIMITS)

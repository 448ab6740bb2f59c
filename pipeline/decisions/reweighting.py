"""Yields at tighter tolerances from one run at wider ones: each unit counts by its likelihood ratio.

Where few scalar dimensions move (a disk's size, an eccentricity, the amplitude of an ovality) the units of a wide run
are also units of the narrow study, each as often as its errors are likelier there. Nothing is solved. Every dimension
that moves costs effective units, and a ring of many elements costs nearly all of them: it is refused.

Source
------
Owen, Monte Carlo theory, methods and examples (2013), chapter 9: self-normalised importance sampling, its delta-method
variance, and the effective sample size.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray

from pipeline.arrays import Real, Truth
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions.distribution import Distribution
from pipeline.config.studies.study import Study
from pipeline.decisions.run_comparison import ComparedRun, differing_inputs
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.sampling.designs import uniforms
from pipeline.sampling.errors import deviations_at, dimensions
from pipeline.statistics.intervals import Estimate

FEWEST_EFFECTIVE = 100.0
"""Effective units below which nothing is told: the weights are then those of a few units."""
MIDPOINTS = 20_000
"""Of the integral over one element's distribution: to 1e-4."""
FREE_KEYS = ("limits.", "samples.", "drivers.", "tails")
"""Settings that may differ beside the tolerances: they change no unit."""


@dataclass(frozen=True)
class Reweighted:
    """Yields of the narrow study from the units of the wide one.

    Attributes
    ----------
    keeps : of each tolerance that moves the share of the units that its weights alone are worth.
    units, effective : units of the wide run, and how many of the narrow study they are worth.
    yields : by metric, and against all limits; `n` of each are the effective units, rounded down.
    """

    keeps: Mapping[str, float]
    units: int
    effective: float
    yields: Mapping[str, Estimate]


def reweighted_yields(wide: ComparedRun, narrow: Study) -> Reweighted:
    """Yields of a study with other scalar tolerances, from a finished run.

    Parameters
    ----------
    wide : of independent samples; its tolerances hold those of ``narrow``.

    Raises
    ------
    InputError
        If anything else differs, a ring moves, narrow zones leave the wide ones, or too few effective units are left.
    """
    units = wide.units
    ratios = _ratios(wide.study, units.index.to_numpy(), narrow, moved_tolerances(wide.study, narrow))
    weight = np.prod(list(ratios.values()), axis=0) if ratios else np.ones(len(units))
    effective = effective_units(weight)
    keeps = {name: effective_units(ratio) / len(ratio) for name, ratio in ratios.items()}
    if effective < FEWEST_EFFECTIVE:
        shares = ", ".join(f"{name} keeps {100 * share:.2g} %" for name, share in keeps.items())
        raise InputError(
            f"{len(weight):,} units of {wide.label} are worth {effective:.0f} of {narrow.name}, fewer than "
            f"{FEWEST_EFFECTIVE:.0f} ({shares}); take more units, or solve the study itself: make compare"
        )
    yields = {}
    confidence = narrow.metrics.confidence
    for name, within_limits in narrow.limits.pass_flags(units).items():
        has_metrics = units[narrow.limits.limited_metrics(name, units)].notna().all(axis=1).to_numpy()
        yields[name] = weighted_share(within_limits[has_metrics], weight[has_metrics], confidence)
    return Reweighted(keeps, len(weight), effective, yields)


def moved_tolerances(wide: Study, narrow: Study) -> tuple[str, ...]:
    """Scalar tolerances in which two studies differ.

    Raises
    ------
    InputError
        If another setting differs, a ring's tolerance does, samples are not independent, or limits are of the turn.
    """
    problems = [
        f"study {study.name}: experiment {study.samples.experiment!r}; reweighting needs independent units, monte_carlo"
        for study in (wide, narrow)
        if study.samples.experiment != "monte_carlo"
    ]
    problems += [
        f"study {narrow.name}: limits.{name}: fresh units, the check, have no metric of the turn; leave it out"
        for name in narrow.limits.of_metrics
        if name not in library()
    ]
    names = []
    for key, _, _ in differing_inputs(wide, narrow):
        section, _, key_tail = key.partition(".")
        if section == "tolerances":
            names.append(key_tail.partition(".")[0])
        elif not key.startswith(FREE_KEYS):
            problems.append(f"{key} differs between {wide.name} and {narrow.name}; reweighting moves tolerances alone")
    moved_names = tuple(dict.fromkeys(names))
    problems += [problem for name in moved_names if (problem := _unmovable(wide, narrow, name))]
    if problems:
        raise InputError(problems)
    return moved_names


def effective_units(weight: Real) -> float:
    """Kish's effective number of units of weights (n,): (sum w)^2 / sum w^2."""
    total = float(np.sum(weight))
    return total**2 / float(np.sum(weight**2)) if total > 0 else 0.0


def weighted_share(passes: Truth, weight: Real, confidence: float) -> Estimate:
    """Share of weighted units (n,) with its interval.

    Notes
    -----
    Jeffreys' interval at the number of units whose binomial variance is the delta method's, sum w^2 (x - p)^2 over
    (sum w)^2; where all pass or all fail at the effective number of units.
    """
    total = float(np.sum(weight))
    share = float(np.sum(weight[passes])) / total
    variance = float(np.sum(weight**2 * (passes - share) ** 2)) / total**2
    units = min(share * (1 - share) / variance, float(len(weight))) if variance > 0 else effective_units(weight)
    tail = (1 - confidence) / 2
    low, high = scipy.stats.beta.ppf([tail, 1 - tail], units * share + 0.5, units * (1 - share) + 0.5)
    return Estimate(share, float(low), float(high), int(units))


def _ratios(wide: Study, sample: NDArray[np.integer], narrow: Study, moved_names: tuple[str, ...]) -> dict[str, Real]:
    """Likelihood ratios (n,) of samples (n,) of a study, by tolerance."""
    drawn_number = sample - int(wide.samples.nominal_first)
    numbers = uniforms(wide.samples, sum(dimensions(wide).values()), 0, int(drawn_number.max(initial=0)) + 1)[
        drawn_number
    ]
    total, wide_tolerance, narrow_tolerance = deviations_at(wide, numbers), wide.tolerances, narrow.tolerances
    return {
        name: np.prod(_ratio(getattr(wide_tolerance, name), getattr(narrow_tolerance, name), total[name]), axis=1)
        for name in moved_names
    }


def _ratio(wide: Distribution, narrow: Distribution, total_um: Real) -> Real:
    """Density of total deviations (any shape) [um] in the narrow distribution over that in the wide one."""
    return narrow.density(total_um - narrow.allowance_um) / wide.density(total_um - wide.allowance_um)


def _unmovable(wide: Study, narrow: Study, name: str) -> str:
    """Why a tolerance cannot be reweighted; empty if it can."""
    wide_tolerance, narrow_tolerance = getattr(wide.tolerances, name), getattr(narrow.tolerances, name)
    if not (wide_tolerance.varies and narrow_tolerance.varies):
        return f"tolerances.{name} does not vary in both studies; a fixed number has no likelihood"
    (low, high), (bottom, top) = (
        np.array(tolerance.limits_um) + tolerance.allowance_um for tolerance in (wide_tolerance, narrow_tolerance)
    )
    if bottom < low or top > high:
        return (
            f"tolerances.{name}: {narrow.name} reaches from {bottom:g} to {top:g} um, {wide.name} from {low:g} to "
            f"{high:g}; no unit is there to be counted: run a wider study"
        )
    elements = dimension_library()[name].elements
    if elements is None:
        return ""
    count = elements.count(wide.design)
    keeps = kept_of_one(wide_tolerance, narrow_tolerance) ** count
    return (
        f"tolerances.{name} moves {count} elements at once, of which independent ones keep {100 * keeps:.2g} % of the "
        "effective units; use the same draws rescaled: make compare"
    )


def kept_of_one(wide: Distribution, narrow: Distribution) -> float:
    """Share of the effective units that one element keeps: 1/E(w^2), by the midpoint rule over the wide draws."""
    probability = (np.arange(MIDPOINTS) + 0.5) / MIDPOINTS
    ratio = _ratio(wide, narrow, wide.deviation(probability) + wide.allowance_um)
    return effective_units(ratio) / MIDPOINTS

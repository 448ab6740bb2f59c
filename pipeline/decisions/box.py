"""The tolerance box of a study: every error anywhere within its limits, independent of all others.

A point of the box is a row of the unit cube of the design of experiment: 0 and 1 are the limits, straight between them.
A dimension with a direction is an amplitude with a phase; its units of full amplitude are looked at in ``PHASES``.

A metric as a linear stack of the errors, and its process capability: whether a normal yield agrees with it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from pipeline.arrays import Index, Real
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions import Distribution
from pipeline.config.distributions.shipped import Uniform
from pipeline.config.studies.study import Study
from pipeline.errors import InputError
from pipeline.model.metrics import library
from pipeline.sampling.errors import Errors, deviations_at, dimensions, errors_with_parts
from pipeline.statistics.intervals import Estimate, pass_share

Evaluate = Callable[[Real], Real]
"""Points of the box (n, n_columns) to a number each (n,)."""

PHASES = 72
"""Directions of an amplitude: a disc is met from within to 0.1 % of its radius."""
FLIPS = 40
"""Rounds of a climb at most."""


@dataclass(frozen=True)
class Box:
    """The box of a study whose tolerances are all uniform and uncorrelated.

    Attributes
    ----------
    free_columns : columns of the errors that vary, by tolerance.
    waves : columns of amplitude and phase of the tolerances with a direction, (n_elements, 2) each.
    n_columns : of a point.
    measured_values : total deviations (1, n_elements) [um] of dimensions that do not vary, since they were measured.
    """

    study: Study
    free_columns: dict[str, Index]
    waves: dict[str, Index]
    n_columns: int
    measured_values: Mapping[str, Real] = field(default_factory=dict)

    @classmethod
    def from_study(cls, study: Study, measured_values: Mapping[str, Real] | None = None) -> "Box":
        """The box of a study, of which some dimensions were ``measured_values``.

        Raises
        ------
        InputError
            If its samples are listed cases, or no tolerance varies.
        """
        if study.samples.experiment == "cases":
            raise InputError(f"study {study.name}: listed cases have no tolerance box")
        known_values = dict(measured_values or {})
        varying = {
            name: tolerance
            for name, tolerance in study.tolerances
            if tolerance.varies and not {name, dimension_library()[name].acts_on} & set(known_values)
        }
        if not varying:
            raise InputError(f"study {study.name}: no tolerance varies; give one two limits, as tolerances.pin_radial")
        sides = {name: _uniform(entry) for name, entry in varying.items()}
        sizes = dimensions(study)
        ends = dict(zip(sizes, np.cumsum(list(sizes.values())), strict=True))
        columns = {name: np.arange(ends[name] - size, ends[name]) for name, size in sizes.items()}
        names_with_direction = [name for name in varying if dimension_library()[name].direction]
        return cls(
            study.with_section("tolerances", **sides),
            {name: columns[name] for name in varying if name not in names_with_direction},
            {
                name: np.stack([columns[name], columns[dimension_library()[name].phase]], axis=1)
                for name in names_with_direction
            },
            sum(sizes.values()),
            known_values,
        )

    @property
    def centre(self) -> Real:
        """(n_columns,) all errors in the middle of their zones, amplitudes at their lower limits."""
        point = np.full(self.n_columns, 0.5)
        point[self.all_waves[:, 0]] = 0.0
        return point

    @property
    def all_waves(self) -> Index:
        """Columns of amplitude and phase (n_waves, 2) of all tolerances with a direction, one after the other."""
        return np.concatenate([np.empty((0, 2), np.intp), *self.waves.values()])

    @property
    def columns(self) -> Index:
        """Columns of all errors that vary, without the waves'."""
        return np.concatenate([np.empty(0, np.intp), *self.free_columns.values()])

    def drawn_vertices(self, count: int) -> Real:
        """(count, n_columns) vertices drawn at random, the same at every call; waves of full amplitude."""
        generator = np.random.default_rng(0)
        points = np.repeat(self.centre[None], count, axis=0)
        points[:, self.columns] = generator.integers(0, 2, (count, len(self.columns)))
        amplitudes, phases = self.all_waves.T
        points[:, amplitudes], points[:, phases] = 1.0, generator.random((count, len(phases)))
        return points

    def errors(self, points: Real) -> Errors:
        """Errors of points (n, n_columns)."""
        return errors_with_parts(self.study, self.measured_values, points)

    def flipped_points(self, point: Real, edge_share: float) -> Real:
        """(n_free, n_columns) the point with one error after the other at ``edge_share``."""
        points = np.repeat(point[None], len(self.columns), axis=0)
        points[np.arange(len(self.columns)), self.columns] = edge_share
        return points

    def rotated_points(self, point: Real, wave: Index) -> Real:
        """(PHASES, n_columns) the point with the full amplitude of a wave, by its columns, in every direction."""
        points = np.repeat(point[None], PHASES, axis=0)
        amplitude, phase = wave
        points[:, amplitude], points[:, phase] = 1.0, np.arange(PHASES) / PHASES
        return points


def _uniform(tolerance: Distribution) -> Uniform:
    low, high = tolerance.limits_um
    return Uniform(distribution="uniform", allowance_um=tolerance.allowance_um, lower_um=low, upper_um=high)


class Climb(NamedTuple):
    """Where a search ended: the point (n_columns,), its value, and whether every point looked at had a value."""

    point: Real
    value: float
    is_complete: bool


def coordinate_search(box: Box, evaluate: Evaluate, start: Real) -> Climb:
    """A vertex of the box at which no single error makes a number larger, and the number.

    Parameters
    ----------
    start : (n_columns,) where the climb begins.

    Notes
    -----
    All errors are tried alone; those that help are moved together if that is better than the best of them alone. A
    lower bound of the largest value: there may be higher vertices that no single error leads to.
    """
    largest_value = float(np.nan_to_num(evaluate(start[None])[0], nan=-np.inf))
    point, is_complete = start, np.isfinite(largest_value)
    for _ in range(FLIPS):
        moves = [box.flipped_points(point, edge_share) for edge_share in (0.0, 1.0)] + [
            box.rotated_points(point, wave) for wave in box.all_waves
        ]
        of_moves = np.nan_to_num(evaluate(np.concatenate(moves)), nan=-np.inf)
        is_complete = is_complete and bool(np.all(np.isfinite(of_moves)))
        values = np.split(of_moves, np.cumsum([len(m) for m in moves])[:-1])
        joint_point = point.copy()
        for edge_share, gains in zip((0.0, 1.0), values[:2], strict=True):
            joint_point[box.columns[gains > largest_value]] = edge_share
        for wave, rows, gains in zip(box.all_waves, moves[2:], values[2:], strict=True):
            if gains.max() > largest_value:
                joint_point[wave] = rows[np.argmax(gains)][wave]
        moves_of_all, flat = np.concatenate(moves), np.concatenate(values)
        candidates = [(float(np.nan_to_num(evaluate(joint_point[None])[0], nan=-np.inf)), joint_point)]
        candidates.append((float(flat.max()), moves_of_all[np.argmax(flat)]))
        value, candidate = max(candidates, key=lambda pair: pair[0])
        if not value > largest_value:
            break
        point, largest_value = candidate, value
    return Climb(point, largest_value, bool(is_complete))


QUANTILE_LEVEL = 0.9973
"""Level of the far quantile: three standard deviations of a normal distribution on both sides."""


@dataclass(frozen=True)
class Stack:
    """A metric linear in the errors about the middle of the box.

    Attributes
    ----------
    middle : its value there.
    parts : tolerance -> (n,) what its errors add in each of ``n`` drawn units.
    """

    middle: float
    parts: dict[str, Real]

    @property
    def values(self) -> Real:
        """(n,) of the drawn units."""
        values: Real = self.middle + np.sum(list(self.parts.values()), axis=0)
        return values

    @property
    def rss(self) -> float:
        """Standard deviation: root of the sum of the squares of what the independent tolerances cause."""
        return float(np.sqrt(sum(np.var(part, ddof=1) for part in self.parts.values())))

    @property
    def shares(self) -> dict[str, float]:
        """Share of the variance of each tolerance; missing where nothing varies."""
        total = self.rss**2
        return {name: float(np.var(part, ddof=1)) / total if total else np.nan for name, part in self.parts.items()}


def stack(study: Study, box: Box, evaluate: Evaluate, numbers: Real) -> Stack:
    """The linear stack of a metric, by secants over half of each zone, at drawn units.

    Parameters
    ----------
    evaluate : points of the box to the metric.
    numbers : (n, n_columns) of the unit cube, from which the study draws its errors, correlated as it says.
    """
    centre, columns = box.centre, box.columns
    points = [centre[None], box.flipped_points(centre, 0.25), box.flipped_points(centre, 0.75)]
    points += [box.rotated_points(centre, wave) for wave in box.all_waves]
    values = np.split(evaluate(np.concatenate(points)), np.cumsum([len(entry) for entry in points])[:-1])
    middle = float(values[0][0])
    slope = dict(zip(columns.tolist(), 2 * (values[2] - values[1]), strict=True))
    deviations, parts = deviations_at(study, numbers), {}
    for name, of_name in box.free_columns.items():
        steps = _share(study, name, deviations[name]) - 0.5
        parts[name] = steps @ np.array([slope[column] for column in of_name.tolist()])
    responses = iter(values[3:])
    for name, waves in box.waves.items():
        shares = _share(study, name, deviations[name]).T
        parts[name] = np.zeros(len(numbers))
        for (_, phase), share, response in zip(waves, shares, responses, strict=False):
            closed_response = np.append(response, response[0]) - middle
            parts[name] += share * np.interp(numbers[:, phase], np.arange(PHASES + 1) / PHASES, closed_response)
    return Stack(middle, parts)


def _share(study: Study, name: str, deviation: Real) -> Real:
    """Where deviations lie in their zone: 0 at the lower limit, 1 at the upper."""
    tolerance = getattr(study.tolerances, name)
    low, high = tolerance.limits_um
    return np.asarray((deviation - tolerance.allowance_um - low) / (high - low))


def statistics_of(metric: str, values: Real) -> dict[str, float]:
    """Mean, std, and the 99.73 % quantile on the bad side of values (n,)."""
    level = 1 - QUANTILE_LEVEL if library()[metric].smaller_is_worse else QUANTILE_LEVEL
    return {
        "mean": float(values.mean()),
        "std": float(values.std(ddof=1)),
        "far": float(np.quantile(values, level, method="median_unbiased")),
    }


@dataclass(frozen=True)
class Capability:
    """C_pk of a metric with one limit; C_p needs two, and no metric here has them.

    Attributes
    ----------
    cpk : distance of the mean from the limit over three standard deviations.
    yield_if_normal : share within the limit that it implies where the metric is normal.
    pass_estimate : the share of the samples.
    """

    metric: str
    mean: float
    std: float
    cpk: float
    yield_if_normal: float
    pass_estimate: Estimate

    @property
    def is_normal_plausible(self) -> bool:
        """Whether the yield of a normal distribution with this C_pk lies within the interval of the yield found."""
        return self.pass_estimate.ci_low <= self.yield_if_normal <= self.pass_estimate.ci_high


def capability(metric: str, values: Real, limit: float, confidence: float) -> Capability:
    """C_pk of values (n,) against an upper limit, or a lower one where smaller is worse.

    Source
    ------
    ISO 22514-2:2017, Statistical methods in process management, clause 7: normally distributed characteristics.
    """
    sign = -1.0 if library()[metric].smaller_is_worse else 1.0
    mean, std = float(values.mean()), float(values.std(ddof=1))
    cpk = sign * (limit - mean) / (3 * std) if std > 0 else np.nan
    pass_estimate = pass_share(library()[metric].keeps(values, limit), confidence)
    return Capability(metric, mean, std, cpk, float(norm.cdf(3 * cpk)), pass_estimate)

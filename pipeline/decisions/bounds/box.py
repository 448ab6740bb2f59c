"""The tolerance box of a study: every error anywhere within its limits, independent of all others.

A point of the box is a row of the unit cube of the design of experiment: 0 and 1 are the limits, straight between them.
A dimension with a direction is an amplitude with a phase; its units of full amplitude are looked at in ``PHASES``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions import Distribution
from pipeline.config.distributions.along_line import Uniform
from pipeline.config.studies.study import Study
from pipeline.errors import InputError
from pipeline.sampling.errors import Errors, dimensions, errors_with_parts

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
    free_columns: dict[str, NDArray[np.intp]]
    waves: dict[str, NDArray[np.intp]]
    n_columns: int
    measured_values: Mapping[str, Real] = field(default_factory=dict)

    @classmethod
    def from_study(cls, study: Study, measured_values: Mapping[str, Real] | None = None) -> Box:
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
            study.model_copy(update={"tolerances": study.tolerances.model_copy(update=sides)}),
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
    def all_waves(self) -> NDArray[np.intp]:
        """Columns of amplitude and phase (n_waves, 2) of all tolerances with a direction, one after the other."""
        return np.concatenate([np.empty((0, 2), np.intp), *self.waves.values()])

    @property
    def columns(self) -> NDArray[np.intp]:
        """Columns of all errors that vary, without the waves'."""
        return np.concatenate([np.empty(0, np.intp), *self.free_columns.values()])

    def errors(self, points: Real) -> Errors:
        """Errors of points (n, n_columns)."""
        return errors_with_parts(self.study, self.measured_values, points)

    def flipped_points(self, point: Real, edge_share: float) -> Real:
        """(n_free, n_columns) the point with one error after the other at ``edge_share``."""
        points = np.repeat(point[None], len(self.columns), axis=0)
        points[np.arange(len(self.columns)), self.columns] = edge_share
        return points

    def rotated_points(self, point: Real, wave: NDArray[np.intp]) -> Real:
        """(PHASES, n_columns) the point with the full amplitude of a wave, by its columns, in every direction."""
        points = np.repeat(point[None], PHASES, axis=0)
        amplitude, phase = wave
        points[:, amplitude], points[:, phase] = 1.0, np.arange(PHASES) / PHASES
        return points


def _uniform(tolerance: Distribution) -> Uniform:
    low, high = tolerance.limits_um
    return Uniform(distribution="uniform", allowance_um=tolerance.allowance_um, lower_um=low, upper_um=high)


def coordinate_search(box: Box, evaluate: Evaluate, start: Real) -> tuple[Real, float]:
    """A vertex of the box at which no single error makes a number larger, and the number.

    Parameters
    ----------
    start : (n_columns,) where the climb begins.

    Notes
    -----
    All errors are tried alone; those that help are moved together if that is better than the best of them alone. A
    lower bound of the largest value: there may be higher vertices that no single error leads to.
    """
    point, largest_value = start, float(evaluate(start[None])[0])
    for _ in range(FLIPS):
        moves = [box.flipped_points(point, edge_share) for edge_share in (0.0, 1.0)] + [
            box.rotated_points(point, wave) for wave in box.all_waves
        ]
        values = np.split(
            np.nan_to_num(evaluate(np.concatenate(moves)), nan=-np.inf), np.cumsum([len(m) for m in moves])[:-1]
        )
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
    return point, largest_value

"""How large an effect is over these data: what offset, recalibration and tolerances leave of it, in noise floors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear

from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, Problem
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import UnitFile, load_measured_unit

Compliances = Callable[[Study, Sequence[float]], Sequence[Real]]

SMALLEST_AMPLITUDE = 1e-6
"""Share of an effect's range below which no size is sought."""
SEARCHES = 10
"""Steps of the search for the amplitude of a wanted misfit: 10 bisect six decades to 1 %."""
AGREEMENT = 0.1
"""Relative error of a size that is good enough."""
START = 0.01
"""Share of an effect's range at which the search starts."""
SLACK = 1e-9
"""Added to the reach of unknowns that stand at their bound."""


def problem_of(unit: UnitFile, condensed: Compliances) -> tuple[Problem, Callable[[Real], Real]]:
    """The problem of a unit, and what averages values of its rows (n_rows,) over its cells."""
    measurement = Measurement.read(unit)
    compliances = condensed(unit.study, measurement.rows.cranks.tolist())
    return build_problem(measurement, compliances), measurement.over_cells


@dataclass(frozen=True)
class Yardstick:
    """What a change of the curves is measured with.

    Attributes
    ----------
    problem : of the unit without effect.
    over_cells : averages values of rows over its cells.
    jacobian : (n_cells, n_unknowns) [arcmin] of what is fitted without effect.
    penalty : (n_unknowns,) priors.
    reach : how far they may move down and up, each (n_unknowns,).
    """

    problem: Problem
    over_cells: Callable[[Real], Real]
    jacobian: Real
    penalty: Real
    reach: tuple[Real, Real]

    @classmethod
    def of(cls, folder: Path, root: Path, condensed: Compliances) -> "Yardstick":
        """The yardstick of a unit's folder."""
        problem, over_cells = problem_of(load_measured_unit(folder, root), condensed)
        fitter = Fitter(problem)
        all_cells = np.ones(len(problem.data), bool)
        fit = fitter.fit(Model(), all_cells, fitter.start(Model()), 3)
        unknowns = fit.unknowns.flat
        reach = tuple(fit.unknowns.like(unknowns + sense * 1e9).flat - unknowns for sense in (-1, 1))
        return cls(
            problem, over_cells, fit.jacobian, fitter.penalty(fit.unknowns), (reach[0] - SLACK, reach[1] + SLACK)
        )

    def size(self, change: Sequence[Real]) -> float:
        """Size of a change [arcmin] of the angle at the rows of every position, in noise floors."""
        data = self.problem.data
        centred_change = Fitter(self.problem).centred_values(self.over_cells(np.concatenate(change)), 1 / data.sigma**2)
        rows = np.vstack([self.jacobian / data.sigma[:, None], np.diag(self.penalty)])
        goal = np.concatenate([centred_change / data.sigma, np.zeros(len(self.penalty))])
        if rows.shape[1]:
            goal = goal - rows @ lsq_linear(rows, goal, self.reach).x
        return float(np.sqrt(np.mean(goal[: len(data)] ** 2)))


def amplitude_of(size: Callable[[float], float], target: float) -> tuple[float, float] | None:
    """Amplitude in (0, 1] at which an effect has the size, and the size there; None if it never gets there.

    Sizes grow about in proportion: secant steps in the logarithm, held within what is known of too small and too large.
    """
    low, high, amplitude = SMALLEST_AMPLITUDE, 1.0, START
    for _ in range(SEARCHES):
        trial_size = size(amplitude)
        if abs(trial_size / target - 1) <= AGREEMENT:
            return amplitude, trial_size
        if trial_size < target:
            if amplitude >= 1.0:
                return None
            low = amplitude
        else:
            high = amplitude
        guess = amplitude * target / max(trial_size, 1e-3 * target)
        amplitude = (
            guess if low < guess < high else (1.0 if high == 1.0 and guess >= 1.0 else float(np.sqrt(low * high)))
        )
    return None


def at_amplitude(
    bounds: Sequence[tuple[float, float]], amplitude: float, direction: Real, shape: Real
) -> tuple[float, ...]:
    """Parameters of an effect: those whose bounds hold 0 grow with the amplitude, the others stand at a shape.

    Parameters
    ----------
    amplitude : in (0, 1], of the bound.
    direction : (n_parameters,) of unit length among those that grow.
    shape : (n_parameters,) shares of the bounds of the others.
    """
    shares = []
    for (low, high), component, share in zip(bounds, direction, shape, strict=True):
        if low <= 0 <= high:
            reach = high if component > 0 else -low
            shares.append(amplitude * component * reach)
        elif low > 0 and high / low > 30:
            shares.append(low * (high / low) ** share)
        else:
            shares.append(low + share * (high - low))
    return tuple(float(value) for value in shares)


def draw_shape(rng: np.random.Generator, bounds: Sequence[tuple[float, float]]) -> tuple[Real, Real]:
    """Direction and shape of ``at_amplitude``."""
    direction = rng.standard_normal(len(bounds))
    grows = np.array([low <= 0 <= high for low, high in bounds])
    direction[~grows] = 0.0
    direction[[low == 0 for low, _ in bounds]] = np.abs(direction[[low == 0 for low, _ in bounds]])
    direction /= np.linalg.norm(direction)
    return direction, rng.uniform(0.15, 0.7, size=len(bounds))

"""Least squares over several states of one drive: numbers that all share, and numbers that each has of its own."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pipeline.arrays import Real
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.drive_terms import BASIC, TERMS
from pipeline.identification.generic.generic_drive import LoopModel

STEP: Rounding = 1e-4
"""Step of the derivatives, in scales of a number."""
PRECISION: Rounding = 1e-5
"""Relative change of sum of squares and numbers at which a fit ends."""
MOST_STEPS: Fineness = 60
"""Evaluations of its derivatives at most."""


@dataclass(frozen=True)
class SharedFit:
    """Numbers of several states of one drive.

    Attributes
    ----------
    values : of each state, by name; those of the terms, which all states share, are equal.
    shared_names : names of these.
    predicted_angles : of each state (n_cells,) [arcmin].
    rms : weighted root mean square over all cells [arcmin].
    at_bound : names of the numbers that ended at a bound in some state.
    """

    values: tuple[Mapping[str, float], ...]
    shared_names: frozenset[str]
    predicted_angles: tuple[Real, ...]
    rms: float
    at_bound: frozenset[str]


class SharedProblem:
    """States of one drive with the terms that they share."""

    def __init__(self, states: Sequence[CrankLoops], terms: Collection[str], held: Mapping[str, float]):
        """Problem of some states, each with its own basic numbers.

        Parameters
        ----------
        terms : of ``drive_terms.TERMS``, whose numbers all states share.
        held : numbers that are not fitted.
        """
        self.models = [LoopModel(state) for state in states]
        self.held = held
        shared = {name: number for term in terms for name, number in TERMS[term].items()}
        self.numbers = {**BASIC, **shared}
        self.shared_names = frozenset(shared)
        top, span = max(state.top for state in states), max(state.span for state in states)
        self.scale = {name: number.scale(top, span) for name, number in self.numbers.items()}
        free_names = [name for name in self.numbers if name not in held]
        self.columns: list[tuple[str, int | None]] = [
            (name, state)
            for name in free_names
            for state in ([None] if name in self.shared_names else range(len(states)))
        ]

    def values(self, unknowns: Real) -> list[dict[str, float]]:
        """Numbers of each state at unknowns (n,) in scales."""
        by_state = [dict(self.held) for _ in self.models]
        for (name, state), value in zip(self.columns, unknowns.tolist(), strict=True):
            for k in range(len(by_state)) if state is None else (state,):
                by_state[k][name] = value * self.scale[name]
        return by_state

    def residuals(self, values: Sequence[Mapping[str, float]]) -> list[Real]:
        """Weighted errors (n_cells,) of each state."""
        return [_residual(model, numbers) for model, numbers in zip(self.models, values, strict=True)]

    def jacobian(self, unknowns: Real, high: Real) -> Real:
        """Derivatives (n_cells, n) of all residuals, forward, or backward at an upper bound."""
        residuals_before = self.residuals(self.values(unknowns))
        ends = np.cumsum([0, *map(len, residuals_before)])
        matrix = np.zeros((ends[-1], len(unknowns)))
        for column, (_, state) in enumerate(self.columns):
            step = STEP if unknowns[column] + STEP < high[column] else -STEP
            moved_unknowns = unknowns.copy()
            moved_unknowns[column] += step
            values = self.values(moved_unknowns)
            for k in range(len(self.models)) if state is None else (state,):
                change = _residual(self.models[k], values[k]) - residuals_before[k]
                matrix[ends[k] : ends[k + 1], column] = change / step
        return matrix

    def fit(self, start: Sequence[Mapping[str, float]] = ()) -> SharedFit:
        """Numbers of least squares; ``start`` per state, those of the table by default."""
        numbers = [self.numbers[name] for name, _ in self.columns]
        low, high = np.array([n.low for n in numbers]), np.array([n.high for n in numbers])
        starts = [
            start[state or 0][name] / self.scale[name] if start and name in start[state or 0] else number.start
            for (name, state), number in zip(self.columns, numbers, strict=True)
        ]
        solution = least_squares(
            lambda unknowns: np.concatenate(self.residuals(self.values(unknowns))),
            np.clip(starts, low + 1e-6, high - 1e-6),
            lambda unknowns: self.jacobian(unknowns, high),
            bounds=(low, high),
            xtol=PRECISION,
            ftol=PRECISION,
            max_nfev=MOST_STEPS,
        )
        values = self.values(solution.x)
        weight = sum(float(model.loops.weight.sum()) for model in self.models)
        return SharedFit(
            tuple(values),
            self.shared_names,
            tuple(model.predict_angle(numbers) for model, numbers in zip(self.models, values, strict=True)),
            float(np.sqrt(2 * solution.cost / weight)),
            frozenset(name for (name, _), mask in zip(self.columns, solution.active_mask, strict=True) if mask),
        )


def fitted_together(
    states: Sequence[CrankLoops],
    terms: Collection[str] = (),
    held: Mapping[str, float] | None = None,
    start: Sequence[Mapping[str, float]] = (),
) -> SharedFit:
    """Several states of one drive (or one) fitted together; see ``SharedProblem``.

    Cells of no weight (``CrankLoops.some``) are predicted and not fitted: of their positions the zero alone is used.
    """
    return SharedProblem(states, terms, held or {}).fit(start)


def _residual(model: LoopModel, numbers: Mapping[str, float]) -> Real:
    """Weighted error (n_cells,) of the model of one state."""
    return np.asarray(np.sqrt(model.loops.weight) * (model.predict_angle(numbers) - model.loops.angle), float)

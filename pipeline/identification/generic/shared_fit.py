"""Least squares over several states of one drive: numbers that all share, and numbers that each has of its own."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.identification.generic.drive_terms import Number, numbers_of
from pipeline.identification.generic.turning_crank import CrankLoops, LoopModel

Real = NDArray[np.float64]

STEP = 1e-4
"""Step of the derivatives, in scales of a number."""
PRECISION, MOST_STEPS = 1e-5, 60
"""Relative change of sum of squares and numbers at which a fit ends, and the most evaluations of its derivatives."""


@dataclass(frozen=True)
class SharedFit:
    """Numbers of several states of one drive.

    Attributes
    ----------
    values : of each state, by name; shared ones are equal.
    shared_names : names of the numbers that all states share.
    predicted_angles : of each state (n_cells,) [arcmin].
    rms : weighted root mean square over all cells [arcmin].
    at_bound : names of the numbers that ended at a bound in some state.
    columns : (name, number of the state or None where it is shared) of each unknown.
    covariance : (n, n) of the unknowns in their units, by Gauss and Newton, for cells that scatter by ``rms`` each on
        its own; neighbours do not, so intervals come from positions or states that are left out.
    """

    values: tuple[Mapping[str, float], ...]
    shared_names: frozenset[str]
    predicted_angles: tuple[Real, ...]
    rms: float
    at_bound: frozenset[str]
    columns: tuple[tuple[str, int | None], ...]
    covariance: Real


class SharedProblem:
    """States of one drive with the terms that they may have."""

    def __init__(
        self,
        states: Sequence[CrankLoops],
        terms: Collection[str] = (),
        shared_names: Collection[str] = (),
        held: Sequence[Mapping[str, float]] = (),
    ):
        """Of ``shared_names`` terms and numbers all states have one value.

        Parameters
        ----------
        terms : of ``drive_terms.SOFT`` and ``drive_terms.CRANK_EFFECTS``, beside spring and friction.
        shared_names : names of terms or of single numbers.
        held : per state, numbers that are not fitted; of none by default.
        """
        self.models = [LoopModel(state) for state in states]
        self.held = list(held) or [{} for _ in states]
        self.numbers = numbers_of(frozenset(terms))
        wide = {name for term in shared_names for name in (numbers_of(frozenset([term])) if _is_term(term) else [term])}
        basic = set(numbers_of(frozenset()))
        self.shared_names = frozenset((wide - basic) | (wide & set(shared_names))) & frozenset(self.numbers)
        top = max(state.top for state in states)
        span = max(state.span for state in states)
        self.scale = {name: number.scale(top, span) for name, number in self.numbers.items()}
        everywhere = set.intersection(*(set(values) for values in self.held))
        self.columns: list[tuple[str, int | None]] = []
        for name in self.numbers:
            if name in everywhere:
                continue
            if name in self.shared_names:
                self.columns.append((name, None))
            else:
                self.columns += [(name, k) for k in range(len(states)) if name not in self.held[k]]

    def values(self, unknowns: Real) -> list[dict[str, float]]:
        """Numbers of each state at unknowns (n,) in scales."""
        by_state = [dict(values) for values in self.held]
        for (name, state), value in zip(self.columns, unknowns.tolist(), strict=True):
            for k in range(len(by_state)) if state is None else (state,):
                if name not in self.held[k]:
                    by_state[k][name] = value * self.scale[name]
        return by_state

    def residuals(self, values: Sequence[Mapping[str, float]]) -> list[Real]:
        """Weighted errors (n_cells,) of each state."""
        return [
            np.sqrt(model.loops.weight) * (model.predict_angle(numbers) - model.loops.angle)
            for model, numbers in zip(self.models, values, strict=True)
        ]

    def jacobian(self, unknowns: Real, high: Real) -> Real:
        """Derivatives (n_cells, n) of all residuals, forward, or backward at an upper bound."""
        values_here = self.values(unknowns)
        residuals_before = self.residuals(values_here)
        ends = np.cumsum([0, *map(len, residuals_before)])
        matrix = np.zeros((ends[-1], len(unknowns)))
        for column, (_, state) in enumerate(self.columns):
            step = STEP if unknowns[column] + STEP < high[column] else -STEP
            moved_unknowns = unknowns.copy()
            moved_unknowns[column] += step
            values = self.values(moved_unknowns)
            for k in range(len(self.models)) if state is None else (state,):
                model = self.models[k]
                residuals_after = np.sqrt(model.loops.weight) * (model.predict_angle(values[k]) - model.loops.angle)
                matrix[ends[k] : ends[k + 1], column] = (residuals_after - residuals_before[k]) / step
        return matrix

    def fit(self, start: Sequence[Mapping[str, float]] = ()) -> SharedFit:
        """Numbers of least squares; ``start`` per state, those of the table by default."""
        numbers = [self.numbers[name] for name, _ in self.columns]
        low, high = np.array([n.low for n in numbers]), np.array([n.high for n in numbers])
        start_values = [
            self._start(*column, start, number) for column, number in zip(self.columns, numbers, strict=True)
        ]
        inside = np.clip(start_values, low + 1e-6, high - 1e-6)
        solution = least_squares(
            lambda unknowns: np.concatenate(self.residuals(self.values(unknowns))),
            inside,
            lambda unknowns: self.jacobian(unknowns, high),
            bounds=(low, high),
            xtol=PRECISION,
            ftol=PRECISION,
            max_nfev=MOST_STEPS,
        )
        values = self.values(solution.x)
        weight = sum(float(model.loops.weight.sum()) for model in self.models)
        scales = np.array([self.scale[name] for name, _ in self.columns])
        rms = float(np.sqrt(2 * solution.cost / weight))
        covariance = rms**2 * np.linalg.pinv(solution.jac.T @ solution.jac) * np.outer(scales, scales)
        return SharedFit(
            tuple(values),
            self.shared_names,
            tuple(model.predict_angle(numbers) for model, numbers in zip(self.models, values, strict=True)),
            rms,
            frozenset(name for (name, _), mask in zip(self.columns, solution.active_mask, strict=True) if mask),
            tuple(self.columns),
            covariance,
        )

    def _start(self, name: str, state: int | None, start: Sequence[Mapping[str, float]], number: Number) -> float:
        known_value = start[state or 0].get(name) if start else None
        return number.start if known_value is None else known_value / self.scale[name]


def fitted_together(
    states: Sequence[CrankLoops],
    terms: Collection[str] = (),
    shared_names: Collection[str] = (),
    held: Sequence[Mapping[str, float]] = (),
    start: Sequence[Mapping[str, float]] = (),
) -> SharedFit:
    """Several states of one drive (or one) fitted together; see ``SharedProblem``.

    Cells of no weight (``CrankLoops.some``) are predicted and not fitted: of their positions the zero alone is used.
    """
    return SharedProblem(states, terms, shared_names, held).fit(start)


def _is_term(name: str) -> bool:
    try:
        numbers_of(frozenset([name]))
    except KeyError:
        return False
    return True

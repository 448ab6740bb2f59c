"""Numbers of the loops of several states at all positions, as a layout of states and positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.errors import InputError
from pipeline.identification.change.kinds import KINDS, Kind
from pipeline.identification.change.loops import Curves, Loop, LoopSize, State, curves_at, loop_of, loop_sizes
from pipeline.identification.change.scatter import Layout
from pipeline.identification.measurement.enough import LEAST_PART


@dataclass(frozen=True)
class LoopNumber:
    """A number of loops of one size."""

    kind: Kind
    size: LoopSize

    @property
    def title(self) -> str:
        """The number and its loops in words."""
        return f"{self.kind.title}, loops to {self.size.label}"


@dataclass(frozen=True)
class LoopTable:
    """Numbers of the loops of states.

    Attributes
    ----------
    states : in order.
    numbers : that all loops of the compared states show.
    unmeasured_numbers : numbers that some of these loops do not show.
    state, position : (n_rows,) number of each row; positions are numbered within an assembly.
    label : (n_rows,) name of the position of each row; equal names within an assembly are one position.
    values : (n_rows, n_numbers) in the unit of each.
    halves : the same of every second point of the loops, from the first and from the second on; NaN where those do not
        show a number.
    loops : by row and size, up to the torque that all loops of the size reach.
    curves : the same as measured.
    """

    states: tuple[State, ...]
    numbers: tuple[LoopNumber, ...]
    unmeasured_numbers: tuple[LoopNumber, ...]
    state: Whole
    position: Whole
    label: tuple[str, ...]
    values: Real
    halves: tuple[Real, Real]
    loops: tuple[dict[LoopSize, Loop], ...]
    curves: tuple[dict[LoopSize, Curves], ...]

    @cached_property
    def positive(self) -> Truth:
        """Numbers (n_numbers,) that are compared on a log scale."""
        return np.array([number.kind.positive for number in self.numbers], bool)

    @cached_property
    def layout(self) -> Layout:
        """The layout of logarithms of positive numbers, and of the others as they are."""
        return Layout(self.state, self.position, self._on_scale(self.values))

    def torque_error(self, weights: Sequence[float]) -> Real:
        """Error (n_numbers,) of a contrast of the states by the distance of the torques that were measured.

        Half of what the contrasts of the two halves of the points differ by, or the distance of their mean from the
        contrast of all, in the mean over the positions, which all share the torques, less its standard error. States
        measured at the same torques err alike: what they have in common drops out. Of other torques the signs are
        unknown and sizes add; between them, by how far the torques lie apart. Infinite where a half lacks a number.
        """
        first_half, second_half = (self._on_scale(half) for half in self.halves)
        errors = 0.5 * (first_half - second_half), 0.5 * (first_half + second_half) - self.layout.values
        factors = np.asarray(weights, float)
        chosen_states = np.flatnonzero(factors)  # a level without weight counts nothing, whatever its error
        sizes = np.array([[_shared_error(error[self.state == state]) for error in errors] for state in chosen_states])
        total: Real = np.abs(factors[chosen_states]) @ sizes.max(axis=1)
        at_place = [self.position == place for place in set(self.position)]
        rows = [[np.flatnonzero((self.state == s) & place) for s in chosen_states] for place in at_place]
        shared_rows = np.array([np.concatenate(at) for at in rows if all(len(row) == 1 for row in at)], int)
        if shared_rows.size:
            common = [
                _shared_error(np.einsum("s,psk->pk", factors[chosen_states], error[shared_rows])) for error in errors
            ]
            distance = max(_distance(self.curves[at[0]], self.curves[row]) for at in shared_rows for row in at[1:])
            total = np.minimum(total, np.max(common, axis=0) + distance * total)
        return np.nan_to_num(total, nan=np.inf)

    def _on_scale(self, values: Real) -> Real:
        """Logarithms of positive numbers (n_rows, n_numbers), the others as they are."""
        return np.where(self.positive, np.log(np.where(self.positive, values, 1.0)), values)

    def level(self, state: int, labels: Sequence[str]) -> Real:
        """Mean (n_numbers,) of a state over some positions, geometric of positive numbers."""
        rows = (self.state == state) & np.isin(self.label, labels)
        return self.in_units(self.layout.values[rows].mean(axis=0))

    def in_units(self, values: Real) -> Real:
        """Values (..., n_numbers) of the layout in the units of the numbers."""
        return np.where(self.positive, np.exp(np.where(self.positive, values, 0.0)), values)


def loop_table(states: Sequence[State], n_compared: int) -> LoopTable:
    """The numbers of all states.

    Parameters
    ----------
    n_compared : number of states, the first ones, that are compared: what their loops do not all show is left out.
        Further states give the scatter of mounting; positions of theirs that lack a number are left out.

    Raises
    ------
    InputError : the compared states have no loops of one size, or a further state has no loop like theirs.
    """
    sizes = [size for size in loop_sizes(states) if all(_has(state, size) for state in states[:n_compared])]
    if not sizes:
        found_text = "; ".join(f"{state.name} to {_labels(state)}" for state in states[:n_compared])
        raise InputError(f"no loops of one size in all states: {found_text}; measure the same loops")
    rows = [(number, place) for number, state in enumerate(states) for place in range(len(state.labels))]
    loops = [{size: curves_at(states[number], place, size) for size in sizes} for number, place in rows]
    of_sizes = {size: replace(size, compared=_common_reach([curves[size] for curves in loops])) for size in sizes}
    loops = [{of_sizes[size]: curve for size, curve in curves.items()} for curves in loops]
    read = [_loops_read(curves) for curves in loops]
    every = tuple(LoopNumber(kind, size) for size in of_sizes.values() for kind in KINDS)
    values, first_point, second = (
        np.array([[_value(number, curves) for number in every] for curves in part]).reshape(len(rows), len(every))
        for part in (read, *([_loops_read(curves, first_point) for curves in loops] for first_point in (0, 1)))
    )
    state = np.array([number for number, _ in rows])
    complete = np.isfinite(values[state < n_compared]).all(axis=0)
    is_complete = np.isfinite(values[:, complete]).all(axis=1) & bool(complete.any())
    for number, entry in enumerate(states):
        if not is_complete[state == number].any():
            raise InputError(f"{entry.name}: no position has loops like those of the states that are compared")
    label = [states[number].labels[place] for number, place in compress(rows, is_complete)]
    return LoopTable(
        states=tuple(states),
        numbers=tuple(compress(every, complete)),
        unmeasured_numbers=tuple(compress(every, ~complete)),
        state=state[is_complete],
        position=_positions(states, state[is_complete], label, n_compared),
        label=tuple(label),
        values=values[np.ix_(is_complete, complete)],
        halves=(first_point[np.ix_(is_complete, complete)], second[np.ix_(is_complete, complete)]),
        loops=tuple(compress(read, is_complete)),
        curves=tuple(compress(loops, is_complete)),
    )


def _loops_read(curves: dict[LoopSize, Curves], first_point: int | None = None) -> dict[LoopSize, Loop]:
    """Loops up to the torque of comparison: of all points, or of every second one from ``first_point`` on."""
    return {
        size: loop_of(curve if first_point is None else curve.half(first_point), size.compared)
        for size, curve in curves.items()
        if curve.reach >= size.compared > 0
    }


def _shared_error(errors: Real) -> Real:
    """Size (n_numbers,) of the mean error over positions (n_positions, n_numbers) beyond its standard error."""
    count = len(errors)
    scatter = errors.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else 0.0
    return np.asarray(np.maximum(np.abs(errors.mean(axis=0)) - scatter, 0.0), float)


def _distance(first: dict[LoopSize, Curves], second_half: dict[LoopSize, Curves]) -> float:
    """Largest distance of the torques of two rows, over that of neighbouring torques; 1 where they do not pair."""
    largest = 0.0
    for size, curves in first.items():
        for sense, torque in curves.torque.items():
            other = second_half[size].torque[sense]
            if len(other) != len(torque) or len(torque) < 2:
                return 1.0
            largest = max(largest, float(np.max(np.abs(other - torque)[1:] / np.diff(torque))))
    return min(largest, 1.0)


def _positions(states: Sequence[State], state: Whole, label: Sequence[str], n_compared: int) -> Whole:
    """Number (n_rows,) of each position: a label within an assembly; the compared states are of one."""
    assemblies = [entry.measurement.unit.settings.state.assembly for entry in states]
    own_assemblies = set(assemblies[:n_compared])
    groups = ["" if assembly in own_assemblies else f"other {assembly}" for assembly in assemblies]
    keys = [(groups[number], name) for number, name in zip(state, label, strict=True)]
    numbers_of_keys = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers_of_keys[key] for key in keys])


def _has(state: State, size: LoopSize) -> bool:
    return any(curves_at(state, place, size).reach > 0 for place in range(len(state.labels)))


def _labels(state: State) -> str:
    return " and ".join(size.label for size in loop_sizes([state]))


def _common_reach(curves: Sequence[Curves]) -> float:
    """Torque [N m] that all loops reach but those that saturate early."""
    reaches = np.array([curve.reach for curve in curves])
    return float(reaches[reaches >= LEAST_PART * reaches.max()].min())


def _value(number: LoopNumber, loops: dict[LoopSize, Loop]) -> float:
    loop = loops.get(number.size)
    value = np.nan if loop is None else number.kind.value(loop)
    return value if value > 0 or not number.kind.positive else np.nan

"""The states of a series: their measurements, loops, and the variable that orders them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.errors import InputError
from pipeline.identification.change.loops import State
from pipeline.identification.change.results import comparable_states
from pipeline.identification.fitting.measured_loops import crank_loops
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.measurement.measurement import Measurement

TEMPERATURE = "temperature_C"
"""Variable of the environment that may order states."""


@dataclass(frozen=True)
class Series:
    """States of one drive.

    Attributes
    ----------
    states : ordered by the variable, else by name.
    loops : of each, with the crank angle at each cell.
    variable : name; empty without one.
    values : (n_states,) of the variable.
    """

    states: tuple[State, ...]
    loops: tuple[CrankLoops, ...]
    variable: str
    values: Real

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(state.name for state in self.states)

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of all positions, in the order of the first state that has them."""
        return tuple(dict.fromkeys(label for state in self.states for label in state.labels))

    def cells_of(self, position: str) -> tuple[Truth, ...]:
        """Cells (n_cells,) of each state at a position."""
        return tuple(np.array(state.labels)[state.data.position] == position for state in self.states)


def series_of(measurements: Sequence[Measurement], over: str = "") -> Series:
    """The series of some measurements, or of one.

    Parameters
    ----------
    over : variable of ``[state.values]`` that orders them, or "temperature_C"; by default the first that all states
        have and that differs.

    Raises
    ------
    InputError : states that cannot be compared, or a variable that some state lacks.
    """
    states = comparable_states(measurements)
    variable = over or _common_variable(states)
    values = [_value(state, variable) for state in states] if variable else list(range(len(states)))
    lacking = [state.name for state, value in zip(states, values, strict=True) if value is None]
    if lacking:
        names = ", ".join(lacking)
        raise InputError(f"{names}: no {variable!r}; add values = {{{variable} = ...}} to [state] in its unit.toml")
    order = np.argsort(np.array(values, float), kind="stable")
    ordered_states = tuple(states[k] for k in order)
    return Series(
        ordered_states,
        tuple(crank_loops(state.measurement) for state in ordered_states),
        variable,
        np.array(values, float)[order],
    )


def _common_variable(states: Sequence[State]) -> str:
    """The first variable that all states have and that is not the same in all; empty without one."""
    names = [*states[0].measurement.unit.settings.state.values, TEMPERATURE]
    for name in names:
        values = {_value(state, name) for state in states}
        if None not in values and len(values) > 1:
            return name
    return ""


def _value(state: State, variable: str) -> float | None:
    settings = state.measurement.unit.settings
    if variable == TEMPERATURE:
        return settings.state.values.get(variable, settings.environment.temperature_C)
    return settings.state.values.get(variable)

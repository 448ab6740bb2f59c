"""States of one drive, and the trends of their numbers over a variable."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr  # scipy.stats is slow to import

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Rounding
from pipeline.errors import InputError
from pipeline.identification.change.comparison import FAMILYWISE
from pipeline.identification.change.loops import State
from pipeline.identification.change.results import comparable_states
from pipeline.identification.change.table import LoopNumber, LoopTable, loop_table
from pipeline.identification.fitting.measured_loops import crank_loops
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.measurement.measurement import Measurement
from pipeline.statistics.resampling import CONFIDENCE, LEVEL

SMALLEST_ERROR: Rounding = 1e-300
"""Of a slope: equal levels have none."""
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


@dataclass(frozen=True)
class Trend:
    """A number of the loops over the states.

    Attributes
    ----------
    number : of the loops.
    levels : (n_states,) mean over the positions, geometric of a positive number.
    low, high : (n_states,) 95 % interval of each level by the scatter of mounting; NaN where that is unknown.
    slope, slope_low, slope_high : change with one of the variable, a share of a positive number; NaN without variable.
    p, p_family : of no trend by the scatter over the positions, by itself, and all numbers counted.
    p_states : of no trend by the scatter of the states about their line; NaN with fewer than three states.
    p_differ : of no difference between the states.
    p_bent : of no departure of the states from a straight line; NaN with fewer than three values.
    """

    number: LoopNumber
    levels: Real
    low: Real
    high: Real
    slope: float
    slope_low: float
    slope_high: float
    p: float
    p_family: float
    p_states: float
    p_differ: float
    p_bent: float

    @property
    def is_shown(self) -> bool:
        """Whether the scatter of mounting does not explain the trend, all numbers counted."""
        return self.p_family < FAMILYWISE

    @property
    def straight(self) -> bool:
        """Whether the states do not depart from a straight line."""
        return not self.p_bent < LEVEL


def trends_of(series: Series) -> tuple[tuple[Trend, ...], LoopTable]:
    """Every number of the loops over the states, and the table that they are from.

    Raises
    ------
    InputError : as ``loop_table``.
    """
    table = loop_table(series.states, len(series.states))
    layout, count = table.layout, len(series.states)
    centred_values = series.values - series.values.mean()
    weights = centred_values / np.sum(centred_values**2) if series.variable else None
    contrast = None if weights is None else layout.contrast(weights.tolist(), table.torque_error(weights))
    levels, unknown = _levels(table), np.full(len(table.numbers), np.nan)
    slopes = np.array([unknown] * 3)
    if contrast is not None:
        slopes = contrast.mean + np.array([[0.0], [-1.0], [1.0]]) * contrast.reach(CONFIDENCE)
    p, p_family = (unknown, unknown) if contrast is None else (contrast.p, contrast.family.p)
    p_states = _p_of_states(centred_values, levels) if series.variable else unknown
    p_differ = layout.departure_p(np.zeros((len(table.state), 0)))
    bent_known = series.variable and len(np.unique(series.values)) > 2
    line = series.values[table.state][:, None]
    p_bent = layout.departure_p(line) if bent_known else unknown
    rows = np.bincount(table.state, minlength=count)[:, None]
    reach = layout.half_interval(CONFIDENCE) / np.sqrt(rows)
    physical_values = [table.in_units(values) for values in (levels, levels - reach, levels + reach)]
    shares = np.where(table.positive, np.expm1(np.where(table.positive, slopes, 0.0)), slopes)
    trends = []
    for k, number in enumerate(table.numbers):
        slope, slope_low, slope_high = shares[:, k].tolist()
        level, low, high = (values[:, k] for values in physical_values)
        chances = (float(values[k]) for values in (p, p_family, p_states, p_differ, p_bent))
        trends.append(Trend(number, level, low, high, slope, slope_low, slope_high, *chances))
    return tuple(trends), table


def _levels(table: LoopTable) -> Real:
    """Means (n_states, n_numbers) over the positions of each state."""
    return np.array([table.layout.values[table.state == k].mean(axis=0) for k in np.unique(table.state)])


def _p_of_states(centred_values: Real, levels: Real) -> Real:
    """p (n_numbers,) of no slope of the levels (n_states, n_numbers) over values (n_states,) of mean zero.

    States are the whole plots of the layout: what a remounting or another day changes at all positions alike is in
    their scatter about a line, not in that over the positions.

    Source
    ------
    Scheffe, The Analysis of Variance (1959), chapter 8: the mixed model.
    """
    freedom = len(levels) - 2
    if freedom < 1:
        return np.full(levels.shape[1], np.nan)
    square = np.sum(centred_values**2)
    slope = centred_values @ levels / square
    residuals = levels - levels.mean(axis=0) - np.outer(centred_values, slope)
    error = np.sqrt(np.sum(residuals**2, axis=0) / freedom / square)
    return np.asarray(2 * stdtr(freedom, -np.abs(slope) / np.maximum(error, SMALLEST_ERROR)), float)

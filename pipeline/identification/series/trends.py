"""Numbers of the loops over the states of a series: whether they differ, and whether they follow the variable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.change.comparison import CONFIDENCE, FAMILYWISE
from pipeline.identification.change.table import LoopNumber, LoopTable, loop_table
from pipeline.identification.series.states import Series

BENT = 0.05
"""p of the states' departures from a straight line below which the trend is called no straight line."""


@dataclass(frozen=True)
class Trend:
    """A number of the loops over the states.

    Attributes
    ----------
    number : of the loops.
    levels : (n_states,) mean over the positions, geometric of a positive number.
    low, high : (n_states,) 95 % interval of each level by the scatter of mounting; NaN where that is unknown.
    slope, slope_low, slope_high : change with one of the variable, a share of a positive number; NaN without variable.
    p, p_family : of no trend, by itself, and all numbers counted.
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
    p_differ: float
    p_bent: float

    @property
    def is_shown(self) -> bool:
        """Whether the scatter of mounting does not explain the trend, all numbers counted."""
        return self.p_family < FAMILYWISE

    @property
    def straight(self) -> bool:
        """Whether the states do not depart from a straight line."""
        return not self.p_bent < BENT


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
    slopes = (
        np.full((3, len(table.numbers)), np.nan)
        if contrast is None
        else contrast.mean + np.array([[0.0], [-1.0], [1.0]]) * contrast.reach(CONFIDENCE)
    )
    p, p_family = (np.full(len(table.numbers), np.nan),) * 2 if contrast is None else (contrast.p, contrast.family.p)
    p_differ = layout.departure_p(np.zeros((len(table.state), 0)))
    bent_known = series.variable and len(np.unique(series.values)) > 2
    line = series.values[table.state][:, None]
    p_bent = layout.departure_p(line) if bent_known else np.full(len(table.numbers), np.nan)
    levels = np.array([layout.values[table.state == k].mean(axis=0) for k in range(count)])
    rows = np.bincount(table.state, minlength=count)[:, None]
    reach = layout.half_interval(CONFIDENCE) / np.sqrt(rows)
    physical_values = [_physical_values(table, values) for values in (levels, levels - reach, levels + reach)]
    shares = np.where(table.positive, np.expm1(np.where(table.positive, slopes, 0.0)), slopes)
    trends = []
    for k, number in enumerate(table.numbers):
        slope, slope_low, slope_high = shares[:, k].tolist()
        level, low, high = (values[:, k] for values in physical_values)
        chances = (float(values[k]) for values in (p, p_family, p_differ, p_bent))
        trends.append(Trend(number, level, low, high, slope, slope_low, slope_high, *chances))
    return tuple(trends), table


def _physical_values(table: LoopTable, values: Real) -> Real:
    """Values (n_states, n_numbers) of the layout in the units of the numbers."""
    return np.where(table.positive, np.exp(np.where(table.positive, values, 0.0)), values)

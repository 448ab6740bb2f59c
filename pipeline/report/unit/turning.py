"""What the page on a unit whose crank turned shows instead of loops."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.measured_turn import orders_figure, turn_residual_figure, turns_figure
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.identify import Identification
from pipeline.identification.results.turn_signatures import mean_turns
from pipeline.model.turn import orders

TURNING_CAPTIONS = {
    "loops": (
        "Turns",
        "Dots: cells, averages over an interval of the crank that spans whole pitches of the pins, and over the turns "
        "of one sense at one held torque. Lines: the models, each by a fit that has not seen the held-out turns.",
    ),
    "torque": (
        "Residual over the crank angle",
        "A distance between the senses shows friction, waves eccentricity, ovality or an encoder.",
    ),
    "time": (
        "Orders of the crank",
        "Harmonics over a turn of the crank, means over the held-out turns: measured, and of the models before and "
        "after. Orders above half of the intervals, and what repeats with the pins' pitch, are averaged out.",
    ),
}
SHOWN_ORDERS = 8
"""Orders that are drawn."""


def turning_figures(
    identification: Identification, cells: pd.DataFrame, models: Mapping[str, tuple[str, str, str]]
) -> dict[str, Figure]:
    """Figures by the place that those of loops have on the page; ``cells`` is the table ``residual``."""
    data = identification.problem.data
    assert isinstance(data, TurningData)
    cells = cells.assign(level=data.level)
    curves = {"measured": data.angle} | identification.curves
    turns = mean_turns(data, curves, identification.folds.cells)
    amplitudes = {
        name: np.mean([orders(turn[name][None]).amplitude[0][:SHOWN_ORDERS] for turn in turns], axis=0)
        for name in curves
        if turns
    }
    in_turn = len(turns[0]["measured"]) if turns else 1
    floor = data.noise * float(np.sqrt(2 / in_turn))
    return {
        "loops": turns_figure(cells, models),
        "torque": turn_residual_figure(cells),
        "time": orders_figure(amplitudes, floor),
    }

"""Measured units that others published, on the histograms of the predicted ones."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.labels import LIMITED_METRICS
from pipeline.figures.samples.distributions import BARS, BINS
from pipeline.figures.style import ACCENT, ACCENT_LIGHT, ALARM, INK, legend_below, new_figure, with_style

LINES = ("-", "--", ":", "-.")


@with_style
def published_figure(
    values: Mapping[str, np.ndarray],
    measured_values: Mapping[str, Mapping[str, float]],
    waves: pd.DataFrame | None,
    named_orders: Sequence[int],
) -> Figure:
    """Histogram of each metric with a line for each measured unit, and the predicted orders.

    Parameters
    ----------
    values : metric -> (n,) of the predicted units.
    measured_values : metric -> label of a unit -> its value.
    waves : ``middle``, ``high`` [arcsec] by order of the output turn; None for no panel.
    named_orders : orders that the sources name.
    """
    panels = len(values) + (waves is not None)
    figure = new_figure(3.2 * -(-panels // 2))
    grid = figure.subplots(-(-panels // 2), min(panels, 2), squeeze=False).ravel()
    for axes, (name, predicted_values) in zip(grid, values.items(), strict=False):
        _histogram(axes, predicted_values, name, measured_values[name])
    if waves is not None:
        _orders(grid[len(values)], waves, named_orders)
    for axes in grid[panels:]:
        axes.set_visible(False)
    return figure


def _histogram(axes: Axes, predicted_values: np.ndarray, name: str, measured_values: Mapping[str, float]) -> None:
    bars = int(np.clip(np.sqrt(len(predicted_values)), *BINS))
    axes.hist(predicted_values, bars, color=BARS, edgecolor="white", linewidth=0.6, label="predicted units")
    for number, (label, value) in enumerate(measured_values.items()):
        axes.axvline(value, color=ALARM, linewidth=1.4, linestyle=LINES[number % len(LINES)], label=label)
    quantity = LIMITED_METRICS[name]
    axes.set(xlabel=f"{quantity.title} ({quantity.unit})", ylabel="units")
    axes.grid(False, axis="x")
    legend_below(axes.figure, axes)


def _orders(axes: Axes, waves: pd.DataFrame, named_orders: Sequence[int]) -> None:
    axes.vlines(waves.index, 0, waves["high"], color=ACCENT_LIGHT, linewidth=1.6)
    axes.vlines(waves.index, 0, waves["middle"], color=ACCENT, linewidth=1.6)
    heights = waves.loc[list(named_orders), "high"]
    axes.plot(named_orders, heights, "v", color=INK, markersize=5, markerfacecolor="white")
    for order, height in heights.items():
        axes.annotate(str(order), (order, height), (0, 5), textcoords="offset points", ha="center", fontsize=8)
    axes.set(xlabel="waves per turn of the output", ylabel="amplitude (arcsec)", xlim=(0, None), ylim=(0, None))

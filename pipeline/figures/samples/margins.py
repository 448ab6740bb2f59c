"""Predicted margins of pairs of parts."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.style import COLOURS, INK, legend_below, new_figure, with_style


@with_style
def margins_figure(margins: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Share of units below each margin (n,), as a share of the limit, for each way of assembly."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    for (label, values), colour in zip(margins.items(), COLOURS, strict=False):
        ordered_values = np.sort(values[np.isfinite(values)])
        axes.step(
            100 * ordered_values,
            (np.arange(len(ordered_values)) + 0.5) / len(ordered_values),
            color=colour,
            label=label,
        )
    axes.axvline(0, color=INK, linewidth=1, linestyle=":")
    axes.set(xlabel="margin / % of the limit", ylabel="share of units below")
    legend_below(figure, axes)
    return figure

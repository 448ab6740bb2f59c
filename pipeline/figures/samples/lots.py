"""Measured dimensions of lots: histograms with the fitted distributions and the limits of the drawing."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.config.distributions import Distribution
from pipeline.figures.labels import PARAMETERS
from pipeline.figures.style import COLOURS, INK, legend_below, new_figure, with_style

POINTS = 400
"""Of a distribution function."""
LotValues = tuple[str, NDArray[np.float64], Distribution]
"""Name of a lot, its values (n,) [um], and the fitted distribution."""


@with_style
def lots_figure(dimensions: Sequence[tuple[str, Sequence[LotValues], Distribution]]) -> Figure:
    """The share of parts below each deviation, measured and fitted, for each dimension.

    Parameters
    ----------
    dimensions : name, lots that measured it, and the tolerance of the drawing.
    """
    lines = -(-len(dimensions) // 2)
    figure = new_figure(2.6 * lines)
    panels = list(figure.subplots(lines, 2, squeeze=False).flat)
    for axes in panels[len(dimensions) :]:
        axes.set_visible(False)
    for axes, (name, lots, drawing) in zip(panels, dimensions, strict=False):
        _dimension(axes, lots, drawing)
        axes.set(title=PARAMETERS[name], xlabel="deviation / µm", ylabel="share of parts below")
    legend_below(figure, panels[0])
    return figure


def _dimension(axes: Axes, lots: Sequence[LotValues], drawing: Distribution) -> None:
    """Steps of the measured values and lines of the fits of one dimension."""
    probability = (np.arange(POINTS) + 0.5) / POINTS
    for (lot, values, distribution), colour in zip(lots, COLOURS, strict=False):
        ordered_values = np.sort(values)
        axes.step(
            ordered_values,
            (np.arange(len(ordered_values)) + 0.5) / len(ordered_values),
            color=colour,
            alpha=0.6,
            label=f"{lot}: parts",
        )
        axes.plot(
            distribution.allowance_um + distribution.deviation(probability),
            probability,
            "--",
            color=colour,
            label=f"{lot}: fit",
        )
    for k, limit in enumerate(drawing.limits_um if drawing.varies else ()):
        label = "limits of the drawing" if k == 0 else None
        axes.axvline(drawing.allowance_um + limit, color=INK, linewidth=1, linestyle=":", label=label)

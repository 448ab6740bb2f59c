"""Single units: two metrics against each other, and the loops behind them."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.labels import METRICS
from pipeline.figures.style import ACCENT, ALARM, new_figure, with_style

Real = NDArray[np.float64]


@with_style
def units_figure(
    metrics: Sequence[str], values: Real, limits: Mapping[str, float], torque: Real, angles: Real
) -> Figure:
    """Two metrics of every unit against each other with their limits, and the units' loops.

    Parameters
    ----------
    metrics : names of the two.
    values : (n_units, 2), in their units.
    limits : by metric, where there are any.
    torque : (n_steps,) [N m].
    angles : (n_units, n_steps) [arcmin].
    """
    figure = new_figure(3.4)
    scatter, loops = figure.subplots(1, 2)
    scatter.plot(*values.T, "o", color=ACCENT, alpha=0.6)
    for name, line in zip(metrics, (scatter.axvline, scatter.axhline), strict=True):
        if name in limits:
            line(limits[name], color=ALARM, linestyle="--", linewidth=1.0)
    scatter.set_xlabel(METRICS[metrics[0]].axis)
    scatter.set_ylabel(METRICS[metrics[1]].axis)
    scatter.set_title("Units; dashed: limits")
    loops.plot(torque, angles.T, color=ACCENT, alpha=0.25, linewidth=0.7)
    loops.set_xlabel("torque (N m)")
    loops.set_ylabel("angle of the output (arcmin)")
    loops.set_title("Their loops")
    return figure

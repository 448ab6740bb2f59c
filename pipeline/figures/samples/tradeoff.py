"""Cost against yield of tolerances."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, COLOURS, MARKERS, MUTED_INK, new_figure, with_style


@with_style
def tradeoff_figure(
    curve: np.ndarray, choices: Mapping[str, tuple[float, float, float, float]], target: float
) -> Figure:
    """Least cost against the share of units beyond the limits.

    Parameters
    ----------
    curve : (n, 2) yields and costs of the linear model.
    choices : label -> cost, yield and the ends of its interval, of load-solved units.
    target : yield that was wanted.
    """
    figure = new_figure(3.4, 6.5)
    axes = figure.subplots()
    finite_curve = curve[np.isfinite(curve[:, 1])]
    axes.plot(100 * (1 - finite_curve[:, 0]), finite_curve[:, 1], "-", color=ACCENT, label="least cost, linear model")
    for (label, (cost, value, low, high)), colour, marker in zip(
        choices.items(), COLOURS[1:], MARKERS[1:], strict=False
    ):
        ends = [[100 * (high - value)], [100 * (value - low)]]
        axes.errorbar(
            [100 * (1 - value)], [cost], xerr=ends, fmt=marker, color=colour, markersize=6, capsize=3, label=label
        )
    axes.axvline(100 * (1 - target), color=MUTED_INK, linestyle=":", label="wanted")
    axes.set(xlabel="units beyond a limit (%)", ylabel="cost, as stated", xscale="log")
    axes.invert_xaxis()
    axes.legend()
    return figure

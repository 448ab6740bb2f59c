"""The predicted loops of one unit with their band."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.style import COLOURS, INK, legend_below, new_figure, with_style


@with_style
def certificate_figure(
    torque: NDArray[np.float64], angle: NDArray[np.float64], band: tuple[float, float], crank_deg: float
) -> Figure:
    """Median loop and band of the output's angle over the torque at one crank angle.

    Parameters
    ----------
    torque : (n_torques,) [N m] ascending.
    angle : (n, 2, n_torques) [arcmin] with rising and with falling torque.
    band : quantiles of the band.
    """
    figure = new_figure(3.4)
    axes: Axes = figure.subplots()
    for sense, (label, colour) in enumerate((("rising torque", COLOURS[0]), ("falling torque", COLOURS[1]))):
        low, high = np.quantile(angle[:, sense], band, axis=0)
        axes.fill_between(torque, low, high, color=colour, alpha=0.25, linewidth=0)
        axes.plot(torque, np.median(angle[:, sense], axis=0), color=colour, label=label)
    axes.axhline(0, color=INK, linewidth=0.8, linestyle=":")
    axes.set(xlabel="torque / N m", ylabel="angle of the output / arcmin", title=f"crank at {crank_deg:g}°")
    legend_below(figure, axes)
    return figure

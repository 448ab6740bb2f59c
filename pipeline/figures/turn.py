"""A turn of the crank: transmission error and its orders, force on the input bearing and on a pin."""

from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.figures.style import ACCENT, ACCENT_LIGHT, ALARM, INK, legend_below, new_figure, styled

SENSES = {"+": (ACCENT, "-o"), "-": (ALARM, "--s")}
"""Colour and line of each sense of the torque."""
BAND = "5 % to 95 % of samples, sense +"


@styled
def transmission_figure(panels: Mapping[str, pd.DataFrame], spreads: Mapping[str, pd.DataFrame]) -> Figure:
    """Transmission error against the crank angle, about its mean, a panel without and one under load.

    Parameters
    ----------
    panels : title -> ``sense``, ``crank_deg``, ``error_arcsec`` of one unit.
    spreads : title -> ``crank_deg``, ``low``, ``middle``, ``high`` [arcsec] over the samples; fewer titles where none.
    """
    figure = new_figure(3.2)
    for axes, (title, rows) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        _band(axes, spreads.get(title))
        _senses(axes, rows, "error_arcsec")
        axes.set(title=title, xlabel="crank angle (degrees)", ylabel="error about its mean (arcsec)")
    legend_below(figure, axes)
    return figure


@styled
def orders_figure(panels: Mapping[str, pd.DataFrame]) -> Figure:
    """Amplitude of each order over the samples: median and 95 % quantile.

    Parameters
    ----------
    panels : title -> ``order``, ``middle``, ``high`` [arcsec].
    """
    figure = new_figure(2.8)
    for axes, (title, rows) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        axes.bar(rows["order"], rows["high"], color=ACCENT_LIGHT, width=0.8, label="95 % quantile of samples")
        axes.bar(rows["order"], rows["middle"], color=ACCENT, width=0.8, label="median of samples")
        axes.set(title=title, xlabel="waves per turn of the crank", ylabel="amplitude (arcsec)")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure, axes)
    return figure


@styled
def turn_forces_figure(bearing: pd.DataFrame, spread: pd.DataFrame | None, pins: Sequence[pd.DataFrame]) -> Figure:
    """Force on the input bearing and contact force of one pin against the crank angle.

    Parameters
    ----------
    bearing : ``sense``, ``crank_deg``, ``bearing_force_N`` of one unit.
    spread : ``crank_deg``, ``low``, ``middle``, ``high`` [N] over the samples, or None.
    pins : of one pin, none or one frame: ``sense``, ``crank_deg``, ``force_N``, ``contact``.
    """
    figure = new_figure(3.2)
    panels = figure.subplots(1, 1 + len(pins), squeeze=False)[0]
    _band(panels[0], spread)
    _senses(panels[0], bearing, "bearing_force_N")
    panels[0].set(title="Input bearing", xlabel="crank angle (degrees)", ylabel="radial force (N)", ylim=(0, None))
    for axes, rows in zip(panels[1:], pins, strict=True):
        _senses(axes, rows, "force_N")
        title = f"Pin {int(rows['contact'].iloc[0])}"
        axes.set(title=title, xlabel="crank angle (degrees)", ylabel="contact force (N)", ylim=(0, None))
    legend_below(figure, panels[0])
    return figure


def _band(axes: Axes, spread: pd.DataFrame | None) -> None:
    if spread is None:
        return
    crank = spread["crank_deg"]
    axes.fill_between(crank, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=0, label=BAND)
    axes.plot(crank, spread["middle"], color=INK, linewidth=1.0, linestyle=":", label="median, sense +")


def _senses(axes: Axes, rows: pd.DataFrame, column: str) -> None:
    for sense, (colour, line) in SENSES.items():
        part = rows[rows["sense"] == sense]
        name = sense.replace("-", "−")
        axes.plot(part["crank_deg"], part[column], line, color=colour, markersize=2.5, label=f"sense {name}")

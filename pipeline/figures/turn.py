"""A turn of the crank: transmission error and its orders, force on the input bearing and on a pin."""

from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.figures.labels import FULL_TURN
from pipeline.figures.style import ACCENT, ACCENT_LIGHT, ALARM, INK, legend_below, new_figure, with_style

SENSES = {"+": (ACCENT, "-o"), "-": (ALARM, "--s")}
"""Colour and line of each sense of the torque."""
BAND = "5 % to 95 % of samples, sense +"


@with_style
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


@with_style
def orders_figure(panels: Mapping[str, pd.DataFrame]) -> Figure:
    """Amplitude of each order over the samples: median and 95 % quantile.

    Parameters
    ----------
    panels : title -> ``order``, ``middle``, ``high`` [arcsec].
    """
    figure = new_figure(2.8)
    for axes, (title, rows) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        width = 0.8 * float(rows["order"].sort_values().diff().min()) if len(rows) > 1 else 0.8
        axes.bar(rows["order"], rows["high"], color=ACCENT_LIGHT, width=width, label="95 % quantile of samples")
        axes.bar(rows["order"], rows["middle"], color=ACCENT, width=width, label="median of samples")
        axes.set(title=title, xlabel="waves per turn of the crank", ylabel="amplitude (arcsec)")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure, axes)
    return figure


@with_style
def turn_forces_figure(
    bearing: pd.DataFrame, spread: pd.DataFrame | None, pins: Sequence[pd.DataFrame], name: str
) -> Figure:
    """Force on a disk's bearing and contact force of one pin against the crank angle.

    Parameters
    ----------
    bearing : ``sense``, ``crank_deg``, ``bearing_force_N`` of one unit.
    spread : ``crank_deg``, ``low``, ``middle``, ``high`` [N] over the samples, or None.
    pins : of one pin, none or one frame: ``sense``, ``crank_deg``, ``force_N``, ``contact``.
    name : of the bearing.
    """
    figure = new_figure(3.2)
    panels = figure.subplots(1, 1 + len(pins), squeeze=False)[0]
    _band(panels[0], spread)
    _senses(panels[0], bearing, "bearing_force_N")
    panels[0].set(title=name.capitalize(), xlabel="crank angle (degrees)", ylabel="radial force (N)", ylim=(0, None))
    for axes, rows in zip(panels[1:], pins, strict=True):
        _senses(axes, rows, "force_N")
        title = f"Pin {int(rows['contact'].iloc[0])}"
        axes.set(title=title, xlabel="crank angle (degrees)", ylabel="contact force (N)", ylim=(0, None))
    legend_below(figure, panels[0])
    return figure


@with_style
def output_turn_figure(
    errors: Mapping[str, pd.DataFrame],
    waves: Mapping[str, pd.DataFrame],
    lobes: int,
    bearing: str,
) -> Figure:
    """One unit over a turn of the output: its error, the orders of that, and forces where a torque is held.

    Parameters
    ----------
    errors : title -> ``sense``, ``crank_deg``, ``error_arcsec``, ``bearing_force_N``, ``pin_force_N``, a column each.
    waves : title -> ``sense``, ``order_of_crank``, ``amplitude_arcsec``, by the same titles.
    lobes : turns of the crank.
    bearing : its name.
    """
    loaded_errors = [rows for rows in errors.values() if rows["bearing_force_N"].notna().any()]
    figure = new_figure(5.2 + 2.6 * bool(loaded_errors))
    panels = figure.subplots(2 + bool(loaded_errors), max(len(errors), 1 + bool(loaded_errors)), squeeze=False)
    for column, (title, rows) in enumerate(errors.items()):
        about_mean = rows["error_arcsec"] - rows.groupby("sense", observed=True)["error_arcsec"].transform("mean")
        _over_output(panels[0, column], rows.assign(error_arcsec=about_mean), "error_arcsec", lobes)
        panels[0, column].set(title=title[:1].upper() + title[1:], ylabel="error about its mean (arcsec)")
        _waves(panels[1, column], waves[title])
    forces = {"bearing_force_N": bearing.capitalize(), "pin_force_N": "Pin 0"}
    for rows in loaded_errors:
        for axes, (name, body) in zip(panels[2], forces.items(), strict=False):
            _over_output(axes, rows, name, lobes)
            axes.set(title=body, ylabel="force (N)", ylim=(0, None))
    legend_below(figure, panels[0, 0])
    return figure


def _over_output(axes: Axes, rows: pd.DataFrame, column: str, lobes: int) -> None:
    for sense, (colour, _) in SENSES.items():
        part = rows[rows["sense"] == sense]
        name = sense.replace("-", "−")
        axes.plot(part["crank_deg"] / 360, part[column], color=colour, linewidth=0.4, label=f"sense {name}")
    axes.set(xlabel="turns of the crank", xlim=(0, lobes))


def _waves(axes: Axes, rows: pd.DataFrame) -> None:
    for sense, (colour, _) in SENSES.items():
        part = rows[rows["sense"] == sense]
        axes.plot(part["order_of_crank"], part["amplitude_arcsec"], color=colour, linewidth=0.5)
    axes.set(xlabel="waves per turn of the crank", ylabel="amplitude (arcsec)", xlim=(0, None), ylim=(0, None))


def _band(axes: Axes, spread: pd.DataFrame | None) -> None:
    if spread is None:
        return
    crank = spread["crank_deg"]
    if _is_dense(spread):
        axes.fill_between(crank, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=0, label=BAND)
    else:
        axes.vlines(crank, spread["low"], spread["high"], color=ACCENT_LIGHT, linewidth=4, label=BAND)
    style = ":" if _is_dense(spread) else "_"
    axes.plot(crank, spread["middle"], style, color=INK, linewidth=1.0, label="median, sense +")


def _is_dense(rows: pd.DataFrame) -> bool:
    """Whether the crank angles stand so near to each other that a line through them says something."""
    return bool(rows["crank_deg"].max() < FULL_TURN)


def _senses(axes: Axes, rows: pd.DataFrame, column: str) -> None:
    for sense, (colour, line) in SENSES.items():
        part = rows[rows["sense"] == sense]
        name = sense.replace("-", "−")
        drawn_line = line if _is_dense(rows) else line[-1]
        axes.plot(part["crank_deg"], part[column], drawn_line, color=colour, markersize=2.5, label=f"sense {name}")

"""Figures of decisions: worst cases, certificates, lots of measured parts, pairs of parts, costs against yields."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from pipeline.arrays import Real
from pipeline.config.distributions import Distribution
from pipeline.figures.labels import METRICS, PARAMETERS
from pipeline.figures.style import (
    ACCENT,
    ALARM,
    COLOURS,
    INK,
    MARKERS,
    MUTED_INK,
    legend_below,
    new_figure,
    paired_panels,
    with_style,
)

ROWS = {"full": ("Monte Carlo", ACCENT), "linear": ("linear stack (RSS)", COLOURS[2])}
"""Columns of the stacks, with their labels and colours."""
DEVIATIONS = 3.0
"""Standard deviations on either side of the mean."""


@with_style
def bounds_figure(bounds: pd.DataFrame, stacks: pd.DataFrame) -> Figure:
    """For each metric and crank angle the worst cases, and the mean with three standard deviations of both models.

    Parameters
    ----------
    bounds : ``metric``, ``crank_deg``, ``value``; one or more bounds each.
    stacks : ``metric``, ``crank_deg``, ``statistic`` (mean, std, or far: 99.73 %, worse side), ``linear``, ``full``.
    """
    metrics = list(dict.fromkeys(stacks["metric"]))
    cranks = sorted(set(stacks["crank_deg"]))
    figure, panels = paired_panels(len(metrics), 1.3 + 0.42 * len(cranks))
    for axes, metric in zip(panels, metrics, strict=True):
        for column_index, crank in enumerate(cranks):
            selections = (
                table[(table["metric"] == metric) & (table["crank_deg"] == crank)] for table in (bounds, stacks)
            )
            _crank(axes, column_index, *selections)
        axes.set_yticks(range(len(cranks)), [f"{crank:g}°" for crank in cranks])
        axes.set(title=METRICS[metric].title, xlabel=METRICS[metric].unit, ylabel="crank angle")
        axes.set_ylim(len(cranks) - 0.4, -0.6)
        axes.grid(False, axis="y")
    legend_below(figure, figure.axes[0])
    return figure


def _crank(axes: Axes, crank_index: int, bounds: pd.DataFrame, stacks: pd.DataFrame) -> None:
    """The three of one metric at one crank angle; labelled at the first."""
    values, is_first = stacks.set_index("statistic"), crank_index == 0
    for lane, (column, (label, colour)) in enumerate(ROWS.items()):
        y = crank_index - 0.12 + 0.24 * lane
        mean, spread = (float(values.loc[name, column]) for name in ("mean", "std"))
        axes.plot(mean + DEVIATIONS * spread * np.array([-1, 1]), [y, y], color=colour, linewidth=4.0, alpha=0.4)
        axes.plot([mean], [y], "o", color=colour, markersize=4.5, label=f"{label}: mean ± 3 σ" if is_first else None)
        tail_label = "99.73 % quantile (worse side)" if is_first and column == "full" else None
        axes.plot(
            [float(values.loc["far", column])], [y], "|", color=INK, markersize=9, markeredgewidth=1.4, label=tail_label
        )
    worst_label = "worst cases" if is_first else None
    axes.plot(bounds["value"], np.full(len(bounds), crank_index), "D", color=ALARM, markersize=4.5, label=worst_label)


@with_style
def certificate_figure(torque: Real, angle: Real, band: tuple[float, float], crank_deg: float) -> Figure:
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
    axes.set(xlabel="torque (N m)", ylabel="angle of the output (arcmin)", title=f"crank at {crank_deg:g}°")
    legend_below(figure, axes)
    return figure


POINTS = 400
"""Of a distribution function."""
LotValues = tuple[str, Real, Distribution]
"""Name of a lot, its values (n,) [um], and the fitted distribution."""


@with_style
def lots_figure(dimensions: Sequence[tuple[str, Sequence[LotValues], Distribution]]) -> Figure:
    """The share of parts below each deviation, measured and fitted, for each dimension.

    Parameters
    ----------
    dimensions : name, lots that measured it, and the tolerance of the drawing.
    """
    figure, panels = paired_panels(len(dimensions), 2.6)
    for axes, (name, lots, drawing) in zip(panels, dimensions, strict=True):
        _dimension(axes, lots, drawing)
        axes.set(title=PARAMETERS[name], xlabel="deviation (µm)", ylabel="share of parts below")
    legend_below(figure, panels[0])
    return figure


def _dimension(axes: Axes, lots: Sequence[LotValues], drawing: Distribution) -> None:
    """Steps of the measured values and lines of the fits of one dimension."""
    probability = (np.arange(POINTS) + 0.5) / POINTS
    for (lot, values, distribution), colour in zip(lots, COLOURS, strict=False):
        _draw_shares(axes, values, color=colour, alpha=0.6, label=f"{lot}: parts")
        fitted_values = distribution.allowance_um + distribution.deviation(probability)
        axes.plot(fitted_values, probability, "--", color=colour, label=f"{lot}: fit")
    for k, limit in enumerate(drawing.limits_um if drawing.varies else ()):
        label = "limits of the drawing" if k == 0 else None
        axes.axvline(drawing.allowance_um + limit, color=INK, linewidth=1, linestyle=":", label=label)


def _draw_shares(axes: Axes, values: Real, **style: Any) -> None:
    """Steps of the share of values (n,) below each of them."""
    axes.step(np.sort(values), (np.arange(len(values)) + 0.5) / len(values), **style)


@with_style
def margins_figure(margins: Mapping[str, Real]) -> Figure:
    """Share of units below each margin (n,), as a share of the limit, for each way of assembly."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    for (label, values), colour in zip(margins.items(), COLOURS, strict=False):
        _draw_shares(axes, 100 * values[np.isfinite(values)], color=colour, label=label)
    axes.axvline(0, color=INK, linewidth=1, linestyle=":")
    axes.set(xlabel="margin (% of the limit)", ylabel="share of units below")
    legend_below(figure, axes)
    return figure


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
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))  # the page has no mathtext
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.invert_xaxis()
    axes.legend()
    return figure

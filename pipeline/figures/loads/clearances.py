"""Clearance of every pin (the paper's Fig. 4)."""

from collections.abc import Mapping

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import (
    ACCENT_LIGHT,
    INK,
    MUTED_INK,
    legend_below,
    line_styles,
    new_figure,
    pin_axis,
    with_style,
)


@with_style
def pin_clearances_figure(traces: Mapping[str, pd.DataFrame], spread: pd.DataFrame | None = None) -> Figure:
    """Clearance against pin number for each trace, over the spread of the samples.

    Parameters
    ----------
    traces : label -> rows of ``clearance/gaps`` of the pins of one sample at one crank angle: contact, clearance_um.
    spread : per pin ``contact``, ``low``, ``middle``, ``high`` [um]: 5th, 50th and 95th percentile.
    """
    figure = new_figure(3.3)
    axes = figure.subplots()
    axes.axhline(0, color=MUTED_INK, linewidth=0.8)
    if spread is not None:
        axes.fill_between(
            spread["contact"],
            spread["low"],
            spread["high"],
            color=ACCENT_LIGHT,
            linewidth=0,
            label="5 % to 95 % of samples",
        )
        axes.plot(spread["contact"], spread["middle"], "--", color=INK, linewidth=1.0, label="median of samples")
    for style, rows in zip(line_styles(traces), traces.values(), strict=True):
        axes.plot(rows["contact"], rows["clearance_um"], **style)
    axes.set_ylabel("clearance (µm)")
    pin_axis(axes)
    axes.margins(x=0.01)
    legend_below(figure, axes)
    return figure

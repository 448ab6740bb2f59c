"""Gap that the drawn flank leaves to nominal pins, over the phase of a lobe."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import ACCENT, ALARM, INK, MUTED_INK, legend_below, new_figure, with_style

PHASE_TICKS = np.arange(-180, 181, 45)


@with_style
def nominal_gap_figure(curve: pd.DataFrame, pins: pd.DataFrame, lobes_differ: bool) -> Figure:
    """Gap against the phase of a pin: exact, to first order, and at the pins of one crank angle.

    Parameters
    ----------
    curve : phase_deg ascending, exact_um, first_order_um.
    pins : phase_deg, exact_um of the pins.
    lobes_differ : whether each lobe was measured: then no line joins the points, each of which is of its own lobe.
    """
    figure = new_figure(3.3)
    axes = figure.subplots()
    axes.axhline(0, color=MUTED_INK, linewidth=0.8)
    exact, first_order = (".", ".") if lobes_differ else ("-", "--")
    axes.plot(curve["phase_deg"], curve["exact_um"], exact, color=ACCENT, markersize=2, label="exact distance")
    axes.plot(curve["phase_deg"], curve["first_order_um"], first_order, color=ALARM, markersize=1, label="first order")
    axes.plot(pins["phase_deg"], pins["exact_um"], "o", color=INK, label="pins at this crank angle")
    axes.set_xlabel("phase of the pin from the eccentric (degrees): 0 in a root, 180 on a tip")
    axes.set_xticks(PHASE_TICKS)
    axes.set_ylabel("gap (µm)")
    axes.margins(x=0.01)
    legend_below(figure, axes)
    return figure

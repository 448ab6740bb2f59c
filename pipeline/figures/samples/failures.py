"""Which limits the failing units break."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.figures.labels import LIMITED
from pipeline.figures.style import ALARM, COLOURS, new_figure, styled


@styled
def failures_figure(breaks: Mapping[str, NDArray[np.bool_]]) -> Figure:
    """Share of all units that break each limit, most first, and the part that breaks no other one.

    Parameters
    ----------
    breaks : metric -> whether each unit (n,) breaks its limit.
    """
    names = sorted(breaks, key=lambda name: float(np.mean(breaks[name])))
    broken = np.stack([breaks[name] for name in names])
    alone = broken & (broken.sum(axis=0) == 1)
    figure = new_figure(0.9 + 0.3 * len(names))
    axes = figure.subplots()
    for row, (all_units, only) in enumerate(zip(broken.mean(axis=1), alone.mean(axis=1), strict=True)):
        axes.barh(row, 100 * all_units, color=COLOURS[4], label="breaks this limit" if row == 0 else None)
        axes.barh(row, 100 * only, color=ALARM, label="breaks no other limit" if row == 0 else None)
        axes.annotate(
            f"{100 * all_units:.3g} %", (100 * all_units, row), (4, 0), textcoords="offset points", va="center"
        )
    axes.set_yticks(range(len(names)), [LIMITED[name].title for name in names])
    axes.set(xlabel="units (%)")
    axes.set_xlim(0, 1.15 * max(100 * float(broken.mean(axis=1).max()), 1e-9))
    axes.grid(visible=False, axis="y")
    axes.legend(loc="lower right")
    return figure

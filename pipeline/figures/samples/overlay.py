"""Distributions of the metrics of two runs over each other."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.labels import METRICS
from pipeline.figures.style import COLOURS, new_figure, with_style

BARS = 40
"""Bars of the common histogram."""
LINES = ("-", "--")


@with_style
def overlay_figure(
    runs: Mapping[str, pd.DataFrame], limits: Sequence[Mapping[str, float]], metrics: Sequence[str]
) -> Figure:
    """Share of the samples per bar of each metric, one outline a run.

    Parameters
    ----------
    runs : label -> one row a sample, one column a metric; two of them.
    limits : metric -> limit, of each run.
    metrics : names of `METRICS`.
    """
    lines = -(-len(metrics) // 2)
    figure = new_figure(2.8 * lines)
    panels = figure.subplots(lines, 2, squeeze=False).flat
    for axes in list(panels)[len(metrics) :]:
        axes.set_visible(False)
    for axes, metric in zip(figure.axes, metrics, strict=False):
        values = [frame[metric].dropna().to_numpy(float) for frame in runs.values()]
        edges = np.histogram_bin_edges(np.concatenate(values), BARS).tolist()
        for label, entry, colour, line, limit in zip(runs, values, COLOURS, LINES, limits, strict=False):
            weight = np.full(entry.size, 1 / max(entry.size, 1))
            axes.hist(entry, edges, weights=weight, histtype="stepfilled", color=colour, alpha=0.18)
            axes.hist(entry, edges, weights=weight, histtype="step", color=colour, linestyle=line, label=label)
            if metric in limit:
                axes.axvline(limit[metric], color=colour, linestyle=line, linewidth=1.1)
        axes.set(xlabel=METRICS[metric].axis, ylabel="share of the samples")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return figure

"""Results of a run on axes of the caller, who chooses the figure, its size and its file."""

import numpy as np
from matplotlib.axes import Axes

from pipeline.figures.distributions import draw_histogram
from pipeline.figures.hysteresis import draw_loops
from pipeline.figures.yields import draw_shares
from pipeline.library.studies import Run
from pipeline.statistics.sensitivity import RANK_CORRELATION


def draw_loop(run: Run, axes: Axes, sample: int = 0, crank_deg: float | None = None) -> Axes:
    """The loop of a sample at a crank angle, the study's first if none is given; returns the axes.

    Raises
    ------
    KeyError
        If the run has no curve of that sample and angle.
    """
    curves = run.table("hysteresis/curves")
    crank = run.study.cycle.crank_deg[0] if crank_deg is None else crank_deg
    rows = curves[(curves["sample"] == sample) & np.isclose(curves["crank_deg"], crank)]
    if rows.empty:
        raise KeyError(f"no curve of sample {sample} at {crank:g} deg")
    return draw_loops(axes, {f"sample {sample}, crank at {crank:g} deg": rows})


def draw_distribution(run: Run, metric: str, axes: Axes) -> Axes:
    """Histogram of a metric of the units, as the limits count it over the turn; returns the axes.

    Parameters
    ----------
    metric : its column, as ``"lost_motion_arcmin"``.
    """
    limits = run.study.limits
    values = run.units[f"{metric}_{limits.over}"].dropna().to_numpy()
    return draw_histogram(axes, values, metric, limits.of_metrics.get(metric))


def draw_drivers(run: Run, metric: str, axes: Axes) -> Axes:
    """Rank correlation of a metric with each tolerance, largest first; returns the axes."""
    rows = run.table("aggregate/sensitivity")
    rows = rows[(rows["metric"] == metric) & (rows["over"] == run.study.limits.over)]
    rows = rows[(rows["kind"] == RANK_CORRELATION) & np.isfinite(rows["index"])]
    return draw_shares(axes, rows[rows["ci_low"] != rows["ci_high"]], (RANK_CORRELATION,))

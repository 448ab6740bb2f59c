"""Units that a reader may question in the page: their metrics, loops and pin forces as data of its script."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.figures.labels import METRICS
from pipeline.report.frames import Frames, case_label

UNITS_SHOWN = 150
"""Points that can be distinguished, and whose loops stay below 100 kB of the page."""
WORST_SHOWN = 50
"""Of them, the units nearest to a limit or beyond one."""
KEPT_UNITS = 24
"""Units at most whose contact forces are read for the page."""


def explorer_data(frames: Frames) -> Mapping[str, object]:
    """What the page's script draws; empty where no unit has a result.

    Returns
    -------
    ``metrics``: name, title, unit, decimals, limit and its side; ``units``: label and the values in the metrics' order
    over the turn; ``torque`` [N m] of every step and ``angle`` [arcmin] of every unit's loop, ``force`` [N] on every
    pin at the largest torque of the units whose contacts were kept, all at one ``crank`` angle [deg].
    """
    shown_units = explored_units(frames)
    if not len(shown_units):
        return {}
    curves = frames.at_crank(frames.curves)
    angles = {
        int(sample): rows["angle_arcmin"].to_numpy()
        for sample, rows in curves.groupby("sample")
        if sample in shown_units.index
    }
    torque = curves["torque_Nm"].to_numpy()[: len(next(iter(angles.values())))]
    forces = _pin_forces(frames, shown_units.index)
    return {
        "crank": frames.crank_deg,
        "metrics": [_metric(frames, name) for name in shown_units.columns],
        "units": [
            {
                "label": case_label(frames.study, sample),
                "values": _rounded_values(values, 4),
                "angle": _rounded_values(angles[sample], 4),
                "force": _rounded_values(forces[sample], 1) if sample in forces else None,
            }
            for sample, values in zip(map(int, shown_units.index), shown_units.to_numpy(float), strict=True)
        ],
        "torque": _rounded_values(torque, 4),
    }


def kept_samples(study: Study) -> list[int]:
    """The first samples whose contacts the study keeps."""
    keep = study.cycle.keep_contacts
    kept_samples = range(study.samples.rows) if keep == "all" else sorted(keep)
    return [sample for sample in kept_samples if sample < study.samples.rows][:KEPT_UNITS]


def explored_units(frames: Frames) -> pd.DataFrame:
    """Metrics over the turn (n_units, n_metrics) of units that have all of them, and their loop.

    The first ones, which are random, and those at hand that come nearest to a limit or lie farthest beyond one.
    """
    metrics = [name for name in frames.shown_metrics if frames.over_turn[name].notna().any()]
    solved_units = frames.over_turn[metrics].dropna()
    if not metrics:
        return solved_units[:0]
    at_hand = solved_units[solved_units.index.isin(np.unique(frames.curves["sample"]))]
    worst_units = _excess(frames, at_hand).nlargest(WORST_SHOWN).index
    first_units = at_hand.index[~at_hand.index.isin(worst_units)][: UNITS_SHOWN - len(worst_units)]
    return at_hand[at_hand.index.isin([*first_units, *worst_units])]


def _excess(frames: Frames, units: pd.DataFrame) -> pd.Series:
    """How far each unit lies beyond its nearest limit, in standard deviations of the metric; no rows without limits."""
    limits = {name: limit for name, limit in frames.limits.items() if name in units and units[name].std() > 0}
    signs = {name: -1.0 if METRICS[name].smaller_is_worse else 1.0 for name in limits}
    excess = pd.DataFrame({n: signs[n] * (units[n] - limit) / units[n].std() for n, limit in limits.items()})
    return excess.max(axis=1)


def _pin_forces(frames: Frames, samples: pd.Index) -> dict[int, np.ndarray]:
    """Force (n_pins,) [N] on every pin at the first step of the largest torque, by sample."""
    pins = frames.study.design.cycloid.pins
    rows = frames.at_crank(frames.loads)
    rows = rows[(rows["contact"] < pins) & rows["sample"].isin(samples)]
    if not len(rows):
        return {}
    largest_rows = rows[rows["torque_Nm"] == rows["torque_Nm"].max()]
    first_loaded = largest_rows[largest_rows["step"] == largest_rows["step"].min()]
    return {int(sample): part["force_N"].to_numpy() for sample, part in first_loaded.groupby("sample")}


def _metric(frames: Frames, name: str) -> Mapping[str, object]:
    metric = METRICS[name]
    return {
        "name": name,
        "title": metric.title,
        "inline": metric.inline,
        "unit": "" if metric.unit == "1" else metric.unit,
        "decimals": metric.decimals,
        "limit": frames.limits.get(name),
        "smallerIsWorse": metric.smaller_is_worse,
    }


def _rounded_values(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]

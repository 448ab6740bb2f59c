"""Tables of measured units against a study: the comparison of each metric, and which tolerance would close it."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.dimensions import dimension_library
from pipeline.engine.store import write_csv
from pipeline.model.metrics import library
from pipeline.populations.comparison import TESTS, MetricComparison
from pipeline.populations.single_units import SingleUnits
from pipeline.populations.tolerance_shift import Candidate, Closing

OTHER_UNIT = 5.0
"""Ratio of the means of units and study, or its inverse, from which a metric may be in another unit: one arcmin is 60
arcsec, and one kgf m 9.8 N m. No tolerance makes a fifth of a rigidity."""


def comparison_frame(comparisons: Sequence[MetricComparison]) -> pd.DataFrame:
    """One row a metric and crank angle (empty: `turn_statistic` the crank angles of the study)."""
    rows = []
    for comparison in comparisons:
        tests = {test.name: test for test in comparison.tests}
        rows.append(
            {
                "metric": comparison.metric,
                "crank_deg": np.nan if comparison.crank_deg is None else comparison.crank_deg,
                "over": comparison.turn_statistic,
                "units": comparison.units.size,
                "samples": comparison.samples.size,
                "units_mean": comparison.units.mean(),
                "samples_mean": comparison.samples.mean(),
                "bias": comparison.bias.value,
                "bias_ci_low": comparison.bias.ci_low,
                "bias_ci_high": comparison.bias.ci_high,
                "spread_ratio": comparison.spread_ratio.value,
                "spread_ratio_ci_low": comparison.spread_ratio.ci_low,
                "spread_ratio_ci_high": comparison.spread_ratio.ci_high,
                **{f"{name}_p": tests[name].p_value if name in tests else np.nan for name in TESTS},
            }
        )
    return pd.DataFrame(rows)


def candidate_frame(closings: Mapping[float | None, Closing]) -> pd.DataFrame:
    """One row a crank angle and tolerance: the shift of its mean that comes closest, and whether it closes."""
    columns = ["crank_deg", *(field.name for field in fields(Candidate)), "closes"]
    rows = [
        {"crank_deg": np.nan if crank is None else crank, **vars(candidate), "closes": candidate.closes}
        for crank, closing in closings.items()
        for candidate in closing.candidates
    ]
    return pd.DataFrame(rows, columns=columns)


def quantile_frame(comparisons: Sequence[MetricComparison]) -> pd.DataFrame:
    """One row a metric, crank angle and probability: quantile of the study and of the units."""
    parts = [
        pd.DataFrame(
            {
                "metric": comparison.metric,
                "crank_deg": np.nan if comparison.crank_deg is None else comparison.crank_deg,
                "probability": comparison.quantiles[:, 0],
                "study": comparison.quantiles[:, 1],
                "measured": comparison.quantiles[:, 2],
            }
        )
        for comparison in comparisons
    ]
    return pd.concat(parts, ignore_index=True)


def sentence(closing: Closing, comparisons: Sequence[MetricComparison]) -> str:
    """What the comparison of a crank angle says, and which metrics may be in another unit."""
    far_off = [
        f"{library()[one.metric].inline} ({ratio:.3g} times the study's)"
        for one in comparisons
        if (usual := float(np.mean(one.samples))) > 0  # play is zero where all units are preloaded
        and not 1 / OTHER_UNIT < (ratio := float(np.mean(one.units)) / usual) < OTHER_UNIT
    ]
    check = f" Check the unit of {' and '.join(far_off)}." if far_off else ""
    return f"{_means_sentence(closing, comparisons)}{check}"


def _means_sentence(closing: Closing, comparisons: Sequence[MetricComparison]) -> str:
    """Of all metrics together, and where these say nothing of each alone."""
    if closing.why_not:
        return f"Whether the units' means differ from the study's is not tested: {closing.why_not}."
    if not closing.has_bias:
        is_alone = [one.bias.ci_low > 0 or one.bias.ci_high < 0 for one in comparisons]
        titles = [library()[one.metric].inline for one, alone in zip(comparisons, is_alone, strict=True) if alone]
        probability = f"(p = {closing.p_value:.2g})"
        text = f"All metrics together show no difference of the units' means from the study's {probability}."
        if not titles:
            return text
        return (
            f"{text} The 95 % interval of a single metric excludes zero: {' and '.join(titles)}. With few units the "
            "test of all metrics has little power. Measure more units before you call them alike."
        )
    closers = [candidate for candidate in closing.candidates if candidate.closes]
    if not closers:
        return (
            f"The units differ from the study (p = {closing.p_value:.2g}). No shift of a single dimension within its "
            "limits explains the difference: the cause is an effect, or several dimensions. Measure one unit's loops."
        )
    shifts = "; or ".join(map(_shift_text, closers))
    return (
        f"The units differ from the study (p = {closing.p_value:.2g}). One shifted mean would explain the difference: "
        f"{shifts}."
    )


def _shift_text(candidate: Candidate) -> str:
    """A shift with its interval, and how much of it the limits allow where that is less."""
    shift, low, high = (
        f"{value:{sign}.3g}".replace("-", "\u2212")
        for value, sign in ((candidate.shift_um, "+"), (candidate.shift_low_um, ""), (candidate.shift_high_um, ""))
    )
    allowed = f"; the limits allow {candidate.room_um:.3g} \u00b5m" if candidate.is_beyond_room else ""
    title = dimension_library()[candidate.tolerance].title
    return f"{title} by {shift} \u00b5m (95 % interval {low} to {high}{allowed})"


def single_frame(single: Sequence[SingleUnits]) -> pd.DataFrame:
    """One row a crank angle and unit: how likely a unit of the study lies as far from the others."""
    rows = [
        {
            "crank_deg": np.nan if group.crank_deg is None else group.crank_deg,
            "unit": unit,
            "p_value": p_value,
            "differs_by_itself": unit in group.outlying,
        }
        for group in single
        for unit, p_value in zip(group.units, group.p_value, strict=True)
    ]
    return pd.DataFrame(rows, columns=["crank_deg", "unit", "p_value", "differs_by_itself"])


def write(
    comparisons: Sequence[MetricComparison],
    closings: Mapping[float | None, Closing],
    single: Sequence[SingleUnits],
    folder: Path,
) -> dict[str, pd.DataFrame]:
    """Write comparison.csv, candidates.csv, quantiles.csv and units.csv into ``folder``; their frames by name."""
    frames = {
        "comparison": comparison_frame(comparisons),
        "candidates": candidate_frame(closings),
        "quantiles": quantile_frame(comparisons),
        "units": single_frame(single),
    }
    for name, frame in frames.items():
        write_csv(frame, folder / f"{name}.csv")
    return frames

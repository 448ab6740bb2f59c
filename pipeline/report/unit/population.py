"""The page on many measured units against a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.engine.store import write_atomic
from pipeline.figures.labels import METRICS
from pipeline.figures.measured_unit import quantiles_figure
from pipeline.populations.comparison import MetricComparison
from pipeline.populations.results import (
    candidate_frame,
    comparison_frame,
    quantile_frame,
    sentence,
)
from pipeline.populations.single_units import SingleUnits
from pipeline.populations.tolerance_shift import Closing
from pipeline.report.layout.rendering import drawn_picture, render
from pipeline.report.layout.wording import DASH
from pipeline.report.unit.numbers import digits

TEMPLATE = "unit/population.html"


def write_population_page(
    study: Study,
    units: str,
    turn_statistic: str,
    comparisons: Sequence[MetricComparison],
    closings: Mapping[float | None, Closing],
    single: Sequence[SingleUnits],
    folder: Path,
) -> None:
    """Write population.html and its figure into ``folder``.

    Parameters
    ----------
    units : name of the file of the units.
    turn_statistic : "mean" or "worst" over the crank angles, of the samples that units without a crank angle are
        compared with.
    """
    quantiles = quantile_frame(comparisons)
    quantiles["label"] = [
        _where(METRICS[metric].title, crank, turn_statistic)
        for metric, crank in zip(quantiles["metric"], quantiles["crank_deg"], strict=True)
    ]
    quantiles["unit"] = [METRICS[metric].unit for metric in quantiles["metric"]]
    caption = (
        "Each dot is one probability, 5 % to 95 %. On the dashed line units and study are alike; beside it the units "
    )
    picture = drawn_picture(
        quantiles_figure(quantiles),
        "Quantiles of the units against the study",
        f"{caption}are larger or smaller, and steeper or flatter means more or less spread.",
        folder / "figures" / "quantiles",
    )
    page = render(
        TEMPLATE,
        study=study,
        units=units,
        angles=_angles(study, turn_statistic, closings),
        sentences=[(_where("", crank, turn_statistic), sentence(closing)) for crank, closing in closings.items()],
        comparisons=[_comparison(row, turn_statistic) for row in comparison_frame(comparisons).to_dict("records")],
        single=[(_where("", group.crank_deg, turn_statistic), group.sentence) for group in single],
        candidates=[
            _candidate(row, turn_statistic)
            for row in candidate_frame({k: found for k, found in closings.items() if found.has_bias}).to_dict("records")
        ],
        pictures={"quantiles": picture},
    )
    write_atomic(folder / "population.html", page.encode())


def _angles(study: Study, turn_statistic: str, cranks: Iterable[float | None]) -> str:
    """One sentence on the crank angles that the samples are taken at."""
    if None not in cranks:
        return "Each sample is taken at the crank angle that the unit was measured at (column crank_deg)."
    other_statistic = "worst" if turn_statistic == "mean" else "mean"
    return (
        f"The units name no crank angle, so each sample is taken as its {turn_statistic} over the "
        f"{len(study.cycle.crank_deg)} "
        f"crank angles of the study. A bench that measures at known angles gives them in a column crank_deg; --over "
        f"{other_statistic} takes the {other_statistic} value instead."
    )


def _where(title: str, crank: float | None, turn_statistic: str) -> str:
    crank_text = (
        f"{turn_statistic} over the crank angles" if crank is None or np.isnan(crank) else f"crank at {crank:g}°"
    )
    return f"{title}, {crank_text}" if title else crank_text


def _range(low: float, high: float) -> str:
    ends = digits(low), digits(high)
    return "" if ends == (DASH, DASH) else f"{ends[0]} to {ends[1]}"


def _comparison(row: Mapping[str, object], turn_statistic: str) -> dict[str, object]:
    numbers = pd.Series(row)
    return {
        "title": _where(METRICS[str(row["metric"])].title, numbers["crank_deg"], turn_statistic),
        "unit": METRICS[str(row["metric"])].unit,
        "units": numbers["units"],
        "means": (digits(numbers["units_mean"]), digits(numbers["samples_mean"])),
        "bias": digits(numbers["bias"]),
        "bias_range": _range(numbers["bias_ci_low"], numbers["bias_ci_high"]),
        "spread": digits(numbers["spread_ratio"]),
        "spread_range": _range(numbers["spread_ratio_ci_low"], numbers["spread_ratio_ci_high"]),
        "p": digits(numbers["anderson_darling_p"]),
    }


def _candidate(row: Mapping[str, object], turn_statistic: str) -> dict[str, object]:
    numbers = pd.Series(row)
    return {
        "title": _where(str(row["tolerance"]).replace("_", " "), numbers["crank_deg"], turn_statistic),
        "shift": digits(numbers["shift_um"]),
        "shift_range": _range(numbers["shift_low_um"], numbers["shift_high_um"]),
        "room": digits(numbers["room_um"]),
        "explained": f"{100 * numbers['explained']:.0f} %",
        "p": digits(numbers["p_value"]),
        "closes": bool(row["closes"]),
    }

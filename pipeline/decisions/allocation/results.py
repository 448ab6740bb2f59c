"""What an allocation leaves behind: its tables, and a study file that runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config import parse_study
from pipeline.config.changing import toml_of
from pipeline.config.studies.study import Study
from pipeline.decisions.allocation.allocate import Allocation
from pipeline.engine.store import write_tables
from pipeline.engine.table import Column, Columns, Table

ALLOCATION = Table(
    "allocation",
    "tolerance that has a cost",
    (
        Column("dimension", "label", "", "tolerance"),
        Column("lower_um", "float64", "um", "new lower limit"),
        Column("upper_um", "float64", "um", "new upper limit"),
        Column("was", "float64", "um", "width of the zone before"),
        Column("width_um", "float64", "um", "new width of the zone"),
        Column("was_cost", "float64", "as stated", "cost before, all elements"),
        Column("cost", "float64", "as stated", "new cost, all elements"),
        Column("price_per_um", "float64", "as stated", "what one um of the zone more would save"),
    ),
)
CHECK = Table(
    "check",
    "tolerances, limit",
    (
        Column("tolerances", "label", "", "before; equal: all scaled alike to the yield; found: the cheapest"),
        Column("metric", "label", "", "column of metrics; all_limits: all together"),
        Column("yield", "float64", "1", "share of fresh load-solved units within the limit"),
        Column("ci_low", "float64", "1", "lower end of the confidence interval"),
        Column("ci_high", "float64", "1", "upper end"),
        Column("n", "int32", "1", "units"),
        Column("cost", "float64", "as stated", "of all priced tolerances"),
    ),
)
TRADEOFF = Table(
    "tradeoff",
    "yield",
    (
        Column("yield", "float64", "1", "asked of the last linear model; not checked"),
        Column("cost", "float64", "as stated", "least cost; null beyond the reach of the model"),
    ),
)


def allocation_rows(allocation: Allocation) -> Columns:
    """Rows of `ALLOCATION`."""
    limits = np.array(
        [getattr(allocation.study.tolerances, tolerance.name).limits_um for tolerance in allocation.priced_dimensions]
    )
    return {
        "dimension": np.array([tolerance.name for tolerance in allocation.priced_dimensions], object),
        "lower_um": limits[:, 0],
        "upper_um": limits[:, 1],
        "was": np.array([tolerance.width_um for tolerance in allocation.priced_dimensions]),
        "width_um": limits[:, 1] - limits[:, 0],
        "was_cost": np.array([float(tolerance.cost_at(np.array(1.0))) for tolerance in allocation.priced_dimensions]),
        "cost": np.array(
            [
                float(tolerance.cost_at(f))
                for tolerance, f in zip(allocation.priced_dimensions, allocation.cheapest.scale, strict=True)
            ]
        ),
        "price_per_um": np.array(
            [
                price.price_per_um(f)
                for price, f in zip(allocation.priced_dimensions, allocation.cheapest.scale, strict=True)
            ],
            float,
        ),
    }


def check_rows(allocation: Allocation) -> Columns:
    """Rows of `CHECK`."""
    choices = {"before": allocation.stated_choice, "equal": allocation.equal, "found": allocation.cheapest}
    rows = [
        (label, metric, estimate.value, estimate.ci_low, estimate.ci_high, estimate.n, choice.cost)
        for label, choice in choices.items()
        if choice is not None
        for metric, estimate in choice.check.items()
    ]
    frame = pd.DataFrame(rows, columns=[column.name for column in CHECK.columns])
    return {name: frame[name].to_numpy() for name in frame}


def study_name(study: Study) -> str:
    """Of the study with the new tolerances."""
    return f"allocated-{study.name}"


def study_text(allocation: Allocation, design: str) -> str:
    """The study with the new tolerances as a TOML file; ``design`` names its design."""
    study = allocation.study
    content: dict[str, Any] = study.model_dump(exclude_defaults=True, exclude={"name", "design"})
    content["title"] = f"{study.title or study.name}: cheapest tolerances at {100 * allocation.target:g} %"
    content["tolerances"] = {name: _rounded_lengths(section) for name, section in content["tolerances"].items()}
    if study.cycle.loaded_angles:
        content["cycle"].pop("crank_deg")
    content = {"design": design, **{key: value for key, value in content.items() if value != {}}}
    name = study_name(study)
    parse_study(content, name, f"{name}.toml", lambda _: study.design)
    passing = allocation.cheapest.yield_estimate
    comment = (
        f"# The cheapest tolerances of {study.name} found for a yield of {100 * allocation.target:g} %.\n"
        f"# {passing.n} fresh units: {passing.value:.4f} ({passing.ci_low:.4f} to {passing.ci_high:.4f}).\n"
    )
    return comment + toml_of(content)


def _rounded_lengths(section: dict[str, Any]) -> dict[str, Any]:
    """Lengths without the last bits of a product."""
    return {key: float(f"{value:.9g}") if isinstance(value, float) else value for key, value in section.items()}


def write(allocation: Allocation, folder: Path) -> dict[str, pd.DataFrame]:
    """Write the three tables as CSV and Parquet into ``folder``; their frames by name."""
    tradeoff = {"yield": allocation.tradeoff[:, 0], "cost": allocation.tradeoff[:, 1]}
    tables = {ALLOCATION: allocation_rows(allocation), CHECK: check_rows(allocation), TRADEOFF: tradeoff}
    return write_tables(tables, folder, as_csv=True)

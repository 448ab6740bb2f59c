"""The page of the comparison: one HTML file that needs nothing beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.checks.calibrate import Calibration
from pipeline.checks.paper.statements import Statement
from pipeline.checks.paper.table2 import LARGEST_ERROR, RMS_ERROR, Misfit, fit_rows
from pipeline.config import Study
from pipeline.figures.labels import METRICS, signed
from pipeline.report import inputs
from pipeline.report.rendering import Picture
from pipeline.report.wording import NOTHING, plain

HERE = Path(__file__).parent
REPORT = HERE.parents[1] / "report"


@dataclass(frozen=True)
class FigureOfPaper:
    """A drawn figure, and what the text states of it."""

    numbers: str
    picture: Picture
    statements: Sequence[Statement]


@dataclass(frozen=True)
class Comparison:
    """Everything that the page shows.

    Attributes
    ----------
    table2 : Table 2 and the prediction of its last column.
    contacts, readings, assumptions, procedures : the tables of these names.
    calibration : the fit that the design came from, made again, with intervals.
    figures : in the order of the paper.
    """

    study: Study
    table2: pd.DataFrame
    contacts: pd.DataFrame
    readings: pd.DataFrame
    assumptions: pd.DataFrame
    procedures: pd.DataFrame
    calibration: Calibration
    figures: Sequence[FigureOfPaper]


def paper_page(comparison: Comparison) -> str:
    """The comparison as one self-contained HTML document."""
    environment = Environment(
        loader=FileSystemLoader([HERE, REPORT]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"plain": plain, "percent": _percent, "significant": _significant}
    fit = comparison.table2[~comparison.table2["predicted"].to_numpy(bool)]
    predicted = comparison.table2[comparison.table2["predicted"].to_numpy(bool)]
    study = comparison.study
    return environment.get_template("paper.html").render(
        study=study,
        fit_rows=_table_rows(fit),
        predicted_rows=_table_rows(predicted),
        fit_misfit=Misfit.of(fit["relative_error"].to_numpy(float)),
        predicted_misfit=Misfit.of(predicted["relative_error"].to_numpy(float)),
        limits=Misfit(LARGEST_ERROR, RMS_ERROR),
        fitted=fit_rows(comparison.calibration),
        freedom=comparison.calibration.fit.freedom,
        warnings=comparison.calibration.warnings,
        contacts=comparison.contacts.to_dict("records"),
        readings=comparison.readings.to_dict("records"),
        assumptions=comparison.assumptions.to_dict("records"),
        procedures=comparison.procedures.to_dict("records"),
        figures=comparison.figures,
        numbers=inputs.design_numbers(study.design),
    )


def _table_rows(table: pd.DataFrame) -> list[Mapping[str, object]]:
    rows: list[Mapping[str, object]] = []
    for row in table.to_dict("records"):
        quantity = METRICS[row["metric"]]
        rows.append(
            {
                "case": f"D {row['tolerance_disk_um']:g}, R {row['tolerance_roller_um']:g}",
                "metric": quantity.axis,
                "published": quantity.text(row["published"]),
                "computed": quantity.text(row["computed"]),
                "error": _percent(row["relative_error"]),
                "large": bool(abs(row["relative_error"]) > LARGEST_ERROR),
            }
        )
    return rows


def _percent(share: float) -> str:
    return f"{signed(100 * share, 2)} %" if np.isfinite(share) else NOTHING


def _significant(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}".replace("-", "\u2212") if np.isfinite(value) else NOTHING

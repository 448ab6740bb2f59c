"""Runs the study of cases through the stages, holds it against the paper, and writes tables, figures and page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.checks.calibrate import Calibration, calibrate, read_parameters, read_targets
from pipeline.checks.paper import assumptions, procedures, table2
from pipeline.checks.paper.drawings import drawings
from pipeline.checks.paper.refits import (
    BACKLASH,
    ELASTIC_ERROR,
    ELASTIC_PART,
    FITTED_PART,
    GEOMETRY,
    LOST_MOTION,
    MODEL,
    RIGIDITY,
    TABLE,
    TABLE_AND_ELASTIC,
    Shortfalls,
    refit_table,
    shortfalls,
)
from pipeline.checks.paper.statements import FigureStatement, statements
from pipeline.checks.paper.table2 import LARGEST_ERROR, RMS_ERROR, Misfit, Tables, fit_rows
from pipeline.checks.response import Condensed, solve_cases
from pipeline.config import Study
from pipeline.engine.store import Output, write_atomic
from pipeline.figures.labels import METRICS
from pipeline.model.metrics import signed_number
from pipeline.report import inputs
from pipeline.report.layout import DASH, Picture, drawn_picture, render
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

METRICS_OF_TABLE = (BACKLASH, LOST_MOTION, RIGIDITY)
HERE = Path(__file__).parent


@dataclass(frozen=True)
class FigureOfPaper:
    """A drawn figure, and what the text states of it."""

    numbers: str
    picture: Picture
    statements: Sequence[FigureStatement]


@dataclass(frozen=True)
class PaperComparison:
    """Everything that the page shows.

    Attributes
    ----------
    table2 : Table 2 and the prediction of its last column.
    shortfalls : what its agreement does not show.
    contacts, readings, assumptions, procedures : the tables of these names.
    calibration : the fit that the design came from, made again, with intervals.
    figures : in the order of the paper.
    """

    study: Study
    table2: pd.DataFrame
    shortfalls: Shortfalls
    contacts: pd.DataFrame
    readings: pd.DataFrame
    assumptions: pd.DataFrame
    procedures: pd.DataFrame
    calibration: Calibration
    figures: Sequence[FigureOfPaper]


def paper_page(comparison: PaperComparison) -> str:
    """The comparison as one self-contained HTML document."""
    fit = comparison.table2[~comparison.table2["predicted"].to_numpy(bool)]
    prediction_rows = comparison.table2[comparison.table2["predicted"].to_numpy(bool)]
    study = comparison.study
    return render(
        HERE / "paper.html",
        {"percent": _percent, "significant": _significant, "digits": _digits},
        study=study,
        fit_rows=_table_rows(fit),
        predicted_rows=_table_rows(prediction_rows),
        fit_misfit=Misfit.from_errors(fit["relative_error"].to_numpy(float)),
        predicted_misfit=Misfit.from_errors(prediction_rows["relative_error"].to_numpy(float)),
        limits=Misfit(LARGEST_ERROR, RMS_ERROR),
        fitted=fit_rows(comparison.calibration),
        freedom=comparison.calibration.fit.freedom,
        warnings=comparison.calibration.warnings,
        contacts=comparison.contacts.to_dict("records"),
        **_shortfall_rows(comparison.shortfalls),
        elastic_error=ELASTIC_ERROR,
        readings=_variations(comparison.readings),
        assumptions=_variations(comparison.assumptions),
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


def _shortfall_rows(shortfalls: Shortfalls) -> Mapping[str, object]:
    """What the section on the shortfalls shows."""
    largest_errors, is_fitted = shortfalls.largest_errors, shortfalls.choices["part"] == FITTED_PART
    rises = shortfalls.bearing.iloc[:, -1] > shortfalls.bearing.iloc[:, 1]
    errors = shortfalls.predictions.pivot(index="predictor", columns="metric", values="relative_error")
    return {
        "elastic": shortfalls.elastic_part.to_dict("records"),
        "predictors": [
            {"name": name, "largest": error, "errors": errors.loc[name, list(METRICS_OF_TABLE)].tolist()}
            for name, error in largest_errors.items()
        ],
        "metric_names": [METRICS[metric].axis for metric in METRICS_OF_TABLE],
        "model_error": largest_errors[MODEL],
        "line_error": largest_errors[GEOMETRY],
        "fitted_count": int(is_fitted.sum()),
        "choices_count": int((~is_fitted).sum()),
        "choices": shortfalls.choices["key"].tolist(),
        "targets_count": shortfalls.targets,
        "bearing": [list(row) for row in shortfalls.bearing.itertuples(index=False)],
        "bearing_trend": "more" if rises.all() else "less" if not rises.any() else "partly more",
    }


def _variations(table: pd.DataFrame) -> list[Mapping[str, object]]:
    """One row per assumption: the fit to Table 2 alone, and ``reached``, the one that has the elastic part in sight."""
    variations = {row["assumption"]: row for row in _of_fit(table, TABLE_AND_ELASTIC)}
    return [{**row, "reached": variations[row["assumption"]]} for row in _of_fit(table, TABLE)]


def _of_fit(table: pd.DataFrame, fitted_to: str) -> list[dict[str, object]]:
    rows = table[table["fitted_to"] == fitted_to].to_dict("records")
    parts = [column for column in table.columns if str(column).startswith(ELASTIC_PART)]
    return [{**row, "parts": [row[part] for part in parts]} for row in rows]


def _percent(share: float) -> str:
    return f"{signed_number(100 * share, 2)} %" if np.isfinite(share) else DASH


def _significant(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}".replace("-", "\u2212") if np.isfinite(value) else DASH


def _digits(value: float, count: int) -> str:
    return f"{value:.{count}f}"


STUDY = "paper_tables"
TARGETS, PARAMETERS, CONTACTS = "pham2017_table2.csv", "pham2017_fitted.csv", "pham2017_contacts.csv"
VARIATIONS = "elastic_part_variations.csv"
CONFIDENCE = 0.95
"""Of the intervals of the fitted numbers."""


def paper_comparison(
    study: Study, outputs: Mapping[str, Output], published_folder: Path, folder: Path
) -> PaperComparison:
    """The finished run against the paper; figures are written to ``folder``/figures."""
    targets = read_targets(published_folder / TARGETS, study)
    parameters = read_parameters(published_folder / PARAMETERS, study.design)
    tables = Tables.read(study, outputs)
    disk = _condensed_disk(study, outputs)
    computed_table = table2.table2(study, outputs["aggregate"].read("metrics"), targets)
    predicted_table = table2.prediction(study, disk, targets, parameters)
    return PaperComparison(
        study=study,
        table2=pd.concat([computed_table, predicted_table], ignore_index=True),
        shortfalls=shortfalls(study, targets, parameters, computed_table, predicted_table, tables),
        contacts=table2.contacts(study, outputs["hysteresis"].read("curves"), published_folder / CONTACTS),
        readings=refit_table(assumptions.readings(study), disk, targets, parameters),
        assumptions=refit_table(assumptions.assumptions(study), disk, targets, parameters),
        procedures=procedures.procedures(study, disk, solve_cases(study, disk)),
        calibration=calibrate(study, targets, parameters, CONFIDENCE, disk),
        figures=_figures(tables, published_folder, folder / "figures"),
    )


def _condensed_disk(study: Study, outputs: Mapping[str, Output]) -> Condensed:
    """The compliance that the stage reduce wrote."""
    crank = study.cycle.crank_deg[0]
    path = outputs["reduce"].path(COMPLIANCE_FILE)
    return Condensed.from_compliance(full_compliance(path, assembly.reducer(study.design, crank), crank), study.design)


def _figures(tables: Tables, published_folder: Path, folder: Path) -> list[FigureOfPaper]:
    folder.mkdir(parents=True, exist_ok=True)
    statement_table = statements(tables, published_folder / CONTACTS)
    figures = []
    for drawing in drawings(tables):
        picture = drawn_picture(drawing.figure, drawing.title, drawing.caption, folder / drawing.stem)
        of_drawing = [statement for statement in statement_table if statement.figure in drawing.numbers]
        figures.append(FigureOfPaper(" and ".join(drawing.numbers), picture, of_drawing))
    return figures


def write(comparison: PaperComparison, folder: Path, variations: Path) -> None:
    """The tables as CSV and the page, into ``folder``; the elastic part under each assumption, to ``variations``."""
    write_atomic(variations, variations_csv(comparison.assumptions))
    statement_table = pd.DataFrame(
        [vars(statement) for figure in comparison.figures for statement in figure.statements]
    )
    frames = {
        "table2": comparison.table2,
        "elastic_part": comparison.shortfalls.elastic_part,
        "predictions": comparison.shortfalls.predictions,
        "choices": comparison.shortfalls.choices,
        "contacts": comparison.contacts,
        "readings": comparison.readings,
        "assumptions": comparison.assumptions,
        "procedures": comparison.procedures,
        "statements": statement_table,
    }
    for name, frame in frames.items():
        write_atomic(folder / f"{name}.csv", frame.to_csv(index=False).encode())
    write_atomic(folder / "paper.html", paper_page(comparison).encode())


def variations_csv(assumptions: pd.DataFrame) -> bytes:
    """The columns of ``refits.refit_table`` that tell of the elastic part, as CSV."""
    parts = [column for column in assumptions.columns if str(column).startswith(ELASTIC_PART)]
    columns = ["assumption", "fitted_to", *parts, "elastic_error", "largest_error", "rms_error", "closes"]
    content: bytes = assumptions[[*columns, "pins_in_contact"]].to_csv(index=False, float_format="%.4f").encode()
    return content

"""Runs the study of cases through the stages, holds it against the paper, and writes tables, figures and page."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pipeline import assembly
from pipeline.checks.calibrate import calibrate, read_parameters, read_targets
from pipeline.checks.paper import assumptions, procedures, table2
from pipeline.checks.paper.drawings import drawings
from pipeline.checks.paper.page import FigureOfPaper, PaperComparison, paper_page
from pipeline.checks.paper.refits import ELASTIC_PART, refit_table
from pipeline.checks.paper.shortfalls import shortfalls
from pipeline.checks.paper.statements import statements
from pipeline.checks.paper.table2 import Tables
from pipeline.checks.response import Condensed, solve_cases
from pipeline.config import Study
from pipeline.engine.store import Output, write_atomic
from pipeline.report.layout import drawn_picture
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

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
    return assumptions[[*columns, "pins_in_contact"]].to_csv(index=False, float_format="%.4f").encode()

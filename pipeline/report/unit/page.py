"""The page on a measured unit: the verdict first, then what it rests on."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.engine.fingerprint import package_versions
from pipeline.engine.store import write_atomic
from pipeline.figures.measured_unit import (
    MODELS,
    WRITTEN_STYLE,
    candidates_figure,
    loops_figure,
    time_figure,
    torque_figure,
)
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.identify import FaultyUnit, Identification
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.identification.results import tables
from pipeline.identification.results.write import Findings
from pipeline.identification.selection.held_out import STAGES
from pipeline.identification.selection.statements.statement import title_of
from pipeline.report.layout import Picture, drawn_pictures, render
from pipeline.report.unit import facts
from pipeline.report.unit.record import TURNING_CAPTIONS, turning_figures
from pipeline.report.unit.rows import (
    baseline_row,
    calibrated_rows,
    candidate_row,
    digits,
    error_row,
    headline,
    limit_row,
    loop_row,
    parameter_row,
    remainder_cards,
    signature_row,
    with_capital,
    written_facts,
)

STAGE_TITLES = {"declared": "As declared", "recalibrated": "Refitted"}
CAPTIONS = {
    "loops": (
        "Loops",
        "Dots: cells, averages of neighbouring rows of a branch. Lines: the models, each by a fit without "
        "the held-out cells. The offset of the angle is removed. Small panels: the loop about zero torque.",
    ),
    "torque": (
        "Residual over torque",
        "A distance between the branches shows friction, a step at zero torque play, a slope compliance. A few cells "
        "in which the angle jumps through the play lie beyond the axes.",
    ),
    "time": ("Residual over time and crank angle", "Drift, run-in and whatever differs from position to position."),
    "candidates": (
        "Held-out error of each effect",
        "Blue: named by the verdict. Light blue: a significant gain that something else explains better. Grey: no "
        "significant gain.",
    ),
}


def write_page(
    findings_of_unit: Findings | FaultyUnit,
    verdict: Mapping[str, Any],
    frames: Mapping[str, pd.DataFrame],
    folder: Path,
    shown_folder: Path,
) -> None:
    """Write report.html and its figures into ``folder``.

    Parameters
    ----------
    verdict, frames : content of verdict.json and tables that were written there; none of a faulty unit.
    shown_folder : the folder as a user would type it.
    """
    if isinstance(findings_of_unit, FaultyUnit):
        values = _common(findings_of_unit, verdict, shown_folder) | {
            "data_facts": facts.rows_facts(findings_of_unit),
            "tested": False,
            "between_cranks": "",
            "held_crank": "",
            "pictures": {},
        }
    else:
        values = (
            _common(findings_of_unit.identification, verdict, shown_folder)
            | _fit_values(findings_of_unit, verdict, frames)
            | {"pictures": _pictures(findings_of_unit, frames, folder)}
        )
    page = render("unit/unit.html", **values)
    write_atomic(folder / "report.html", page.encode())


def _pictures(findings_of_unit: Findings, frames: Mapping[str, pd.DataFrame], folder: Path) -> dict[str, Picture]:
    cells, candidates = frames["residual"], frames["candidates"]
    models = MODELS | WRITTEN_STYLE if cells["written_arcmin"].notna().any() else MODELS
    identification = findings_of_unit.identification
    pictures = {"candidates": candidates_figure(candidates, identification.selection.base.rms)}
    if isinstance(identification.problem.data, TurningData):
        figures = turning_figures(identification, cells, models) | pictures
        return drawn_pictures(figures, CAPTIONS | TURNING_CAPTIONS, folder)
    figures = {
        "loops": loops_figure(cells, models),
        "torque": torque_figure(cells),
        "time": time_figure(cells),
        **pictures,
    }
    return drawn_pictures(figures, CAPTIONS, folder)


def _common(identification: Identification | FaultyUnit, verdict: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page says of any unit."""
    unit = identification.measurement.unit
    return {
        "verdict": verdict,
        "design": unit.settings.design,
        "design_title": unit.study.design.title,
        "parameters": [parameter_row(parameter) for parameter in verdict["parameters"]],
        "faults": identification.measurement.faults,
        "not_testable": [(with_capital(title_of(name)), reason) for name, reason in verdict["not_testable"].items()],
        "corrected": verdict["corrected"],
        "not_corrected": verdict["not_corrected"],
        "best": verdict["best"],
        "folder": folder,
        "versions": package_versions(),
        "turns": isinstance(identification.measurement, TurningMeasurement),
    }


def _fit_values(
    findings_of_unit: Findings, verdict: Mapping[str, Any], frames: Mapping[str, pd.DataFrame]
) -> dict[str, Any]:
    """What the page says of a unit that was fitted."""
    identification = findings_of_unit.identification
    turns = isinstance(identification.problem.data, TurningData)
    titles = STAGE_TITLES | {"after": _after_title(identification)}
    rows, trials = frames["candidates"], identification.selection.trials
    fitted_rows = rows[rows["misfit_after"].notna()].to_dict("records")
    pairs = list(zip(*findings_of_unit.signatures.values(), strict=True))
    return {
        "tested": True,
        "judged_on": facts.data_sentence(identification),
        "between_cranks": facts.interpolation_sentence(identification),
        "held_crank": facts.held_crank_sentence(identification),
        "limits_note": facts.limits_note(identification),
        "errors_title": "Errors in sample" if identification.folds.in_sample else "Errors on held-out data",
        "data_facts": facts.data_facts(identification),
        "headlines": [headline(titles[stage], identification.errors[stage]) for stage in STAGES],
        "explained": remainder_cards(identification),
        "written": written_facts(verdict),
        "fitted": [candidate_row(row, tables.parameters_of(trials[row["effect"]].fit)) for row in fitted_rows],
        "signatures": [
            signature_row(pair) for pair in pairs if any(math.isfinite(estimate.value) for estimate in pair)
        ],
        "untested_signatures": [
            (with_capital(pair[0].title), pair[0].why_not)
            for pair in pairs
            if not any(math.isfinite(estimate.value) for estimate in pair)
        ],
        "cells": identification.errors["after"].cells,
        "floor": digits(identification.problem.data.noise),
        "angle_errors": [
            error_row(titles[stage], error, by_crank=not turns) for stage, error in identification.errors.items()
        ],
        "baselines": [baseline_row(title, error) for title, error in identification.baselines.items()],
        "left": facts.structure_facts(identification),
        "could_hide": [limit_row(limit) for limit in identification.could_hide],
        "compared": facts.comparison_sentence(identification),
        "held_out_cranks": [] if turns else [digits(k) for k in identification.errors["after"].by_crank_deg],
        "loop_errors": [loop_row(name, error) for name, error in findings_of_unit.loops.items()],
        "calibrated": calibrated_rows(identification),
        "tolerances": facts.tolerances_sentence(identification),
    }


def _after_title(identification: Identification) -> str:
    """What the third of the models is."""
    return "With what is named" if identification.verdict.named_effects else "After: no effect named, as refitted"

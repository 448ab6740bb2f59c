"""The page on a measured unit: the verdict first, then what it rests on."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.engine.fingerprint import package_versions
from pipeline.engine.store import read_json, write_atomic
from pipeline.figures.style import save
from pipeline.figures.unit import MODELS, WRITTEN, candidates_figure, loops_figure, time_figure, torque_figure
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.identify import FaultyUnit, Identification
from pipeline.identification.results import tables
from pipeline.identification.results.prediction_errors import LoopError
from pipeline.identification.results.write import VERDICT_FILE, Findings
from pipeline.identification.selection.detection import DetectionLimit
from pipeline.identification.selection.discrepancy import Discrepancy
from pipeline.identification.selection.held_out import STAGES, AngleError
from pipeline.identification.selection.statement import title_of
from pipeline.report.rendering import Picture, rendered
from pipeline.report.unit.numbers import capitalised, digits, interval, p_value, shown_unit
from pipeline.report.unit.remainder_cards import remainder_cards, written_facts
from pipeline.report.wording import NOTHING, counted, listed, plain

TEMPLATE = "unit/unit.html"
STAGE_TITLES = {"declared": "As declared", "recalibrated": "Refitted"}
LOOP_TITLES = {
    "zero_torque_width_arcmin": ("Zero-torque width", "arcmin"),
    "lost_motion_arcmin": ("Lost motion", "arcmin"),
    "torsional_rigidity_Nm_per_arcmin": ("Torsional rigidity", "N m/arcmin"),
    "branch_separation_arcmin": ("Separation of the branches under load", "arcmin"),
    "hysteresis_loss_arcmin": ("Hysteresis loss", "arcmin"),
}
CAPTIONS = {
    "loops": (
        "Loops",
        "Dots: cells, averages of neighbouring rows of a branch. Lines: the models, each by a fit that has not seen "
        "the held-out cells. The offset of the angle is removed.",
    ),
    "torque": (
        "Residual over torque",
        "Branches that part from each other show friction, a step at zero torque play, a slope compliance. A few cells "
        "in which the angle jumps through the play lie beyond the axes.",
    ),
    "time": ("Residual over time and crank angle", "Drift, run-in and whatever differs from position to position."),
    "candidates": (
        "Held-out error of each effect",
        "Blue: named by the verdict. Light blue: a significant gain that something else explains better. Grey: no "
        "significant gain.",
    ),
}


def write_page(findings_of_unit: Findings | FaultyUnit, folder: Path, shown_folder: Path) -> None:
    """Write report.html and its figures into ``folder``, whose verdict and tables are there already.

    Parameters
    ----------
    shown_folder : the folder as a user would type it.
    """
    verdict = read_json(folder / VERDICT_FILE)
    if isinstance(findings_of_unit, FaultyUnit):
        values = _common(findings_of_unit, verdict, shown_folder) | {
            "data_facts": _rows_facts(findings_of_unit),
            "tested": False,
            "pictures": {},
        }
    else:
        values = (
            _common(findings_of_unit.found, verdict, shown_folder)
            | _tested(findings_of_unit, verdict)
            | {"pictures": _pictures(findings_of_unit, folder)}
        )
    page = rendered(TEMPLATE, **values)
    write_atomic(folder / "report.html", page.encode())


def _pictures(findings_of_unit: Findings, folder: Path) -> dict[str, Picture]:
    cells = pd.read_parquet(folder / "residual.parquet")
    candidates = pd.read_parquet(folder / "candidates.parquet")
    figures = {
        "loops": loops_figure(cells, MODELS | WRITTEN if cells["written_arcmin"].notna().any() else MODELS),
        "torque": torque_figure(cells),
        "time": time_figure(cells),
        "candidates": candidates_figure(candidates, findings_of_unit.found.selection.base.rms),
    }
    (folder / "figures").mkdir(exist_ok=True)
    pictures = {}
    for name, figure in figures.items():
        stem = folder / "figures" / name
        save(figure, stem)
        pictures[name] = Picture(*CAPTIONS[name], stem.with_suffix(".svg").read_bytes())
    return pictures


def _common(identification: Identification | FaultyUnit, verdict: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page says of any unit."""
    unit = identification.measurement.unit
    return {
        "verdict": verdict,
        "design": unit.settings.design,
        "design_title": unit.study.design.title,
        "traced": [title_of(name) for name in verdict["traced"] if name not in verdict["named"]],
        "parameters": [_parameter(parameter) for parameter in verdict["parameters"]],
        "faults": identification.measurement.faults,
        "not_testable": [(capitalised(title_of(name)), reason) for name, reason in verdict["not_testable"].items()],
        "corrected": verdict["corrected"],
        "not_corrected": verdict["not_corrected"],
        "best": verdict["best"],
        "folder": folder,
        "versions": package_versions(),
    }


def _tested(findings_of_unit: Findings, verdict: Mapping[str, Any]) -> dict[str, Any]:
    """What the page says of a unit that was fitted."""
    identification = findings_of_unit.found
    titles = STAGE_TITLES | {"after": _after(identification)}
    rows = pd.DataFrame(tables.candidate_rows(identification))
    fitted = rows[rows["score_after"].notna()]
    screened = rows[rows["why_not"] == tables.NOT_SHORTLISTED]
    pairs = list(zip(*findings_of_unit.signatures.values(), strict=True))
    return {
        "tested": True,
        "judged_on": _judged_on(identification),
        "errors_title": "Errors in sample" if identification.folds.in_sample else "Errors on held-out data",
        "data_facts": _data_facts(identification),
        "headlines": [
            (
                titles[stage],
                digits(identification.errors[stage].rms_arcmin),
                "arcmin",
                f"{digits(identification.errors[stage].to_noise)} noise floors",
            )
            for stage in STAGES
        ],
        "explained": remainder_cards(identification),
        "written": written_facts(verdict),
        "fitted": [_fitted(row) for row in fitted.to_dict("records")],
        "screened": list(screened["title"]),
        "signatures": [
            {
                "title": capitalised(pair[0].title),
                "unit": pair[0].unit,
                "cells": [_signature(estimate) for estimate in pair],
            }
            for pair in pairs
            if any(math.isfinite(estimate.value) for estimate in pair)
        ],
        "untested_signatures": [
            (capitalised(pair[0].title), pair[0].why_not)
            for pair in pairs
            if not any(math.isfinite(estimate.value) for estimate in pair)
        ],
        "cells": identification.errors["after"].cells,
        "floor": digits(identification.problem.data.noise),
        "angle_errors": [
            {
                "title": titles[stage],
                "rms": digits(error.rms_arcmin),
                "by_crank": [digits(rms) for rms in error.by_crank_deg.values()],
                "largest": digits(error.max_arcmin),
                "to_noise": digits(error.to_noise),
                "expected": digits(error.expected_to_noise),
            }
            for stage, error in identification.errors.items()
        ],
        "baselines": [_baseline(title, error) for title, error in _beside(identification).items()],
        "left": _left(identification),
        "could_hide": [_limit(limit) for limit in identification.could_hide],
        "compared": _compared(identification),
        "held_out_cranks": [digits(crank) for crank in identification.errors["after"].by_crank_deg],
        "loop_errors": [_loop(name, error) for name, error in findings_of_unit.loops.items()],
        "calibrated": _calibrated(findings_of_unit, verdict["calibrated"]),
        "tolerances": "All tolerances are as measured."
        if identification.measurement.unit.dimensions is not None
        else f"The tolerances were not measured: {counted(identification.problem.n_modes, 'mode')} of them "
        "stand for what units of the study's distributions differ by.",
    }


def _after(identification: Identification) -> str:
    """What the third of the models is."""
    return "With what is named" if identification.verdict.named else "After: nothing is claimed, as refitted"


def discrepancy_facts(
    structure: Discrepancy, moved_facts: Sequence[tuple[str, float, float, str]]
) -> list[tuple[str, str]]:
    """What is left as a Gaussian process, in words; ``moved_facts``: name, change, standard error, unit."""
    sense = "rising" if structure.worst_sense > 0 else "falling"
    facts = [
        ("Structured", f"{digits(100 * structure.structured, 2)} % of the mean square of what is left"),
        ("Shared by all positions", f"{digits(structure.common_arcmin)} arcmin"),
        ("Of each position by itself", f"{digits(structure.own_arcmin)} arcmin"),
        ("Alike over", f"{digits(structure.reach_Nm)} N m"),
        (
            "Largest",
            f"{digits(structure.worst_arcmin)} arcmin at {digits(structure.worst_torque_Nm)} N m, torque {sense}",
        ),
    ]
    for name, change, error, unit in moved_facts:
        significance = "by more than its uncertainty" if abs(change) > 2 * error else "within its uncertainty"
        text = f"moves by {digits(change)} {unit}".rstrip()
        facts.append((capitalised(name), f"{text} when the term is allowed, {significance} ({digits(2 * error)})"))
    return facts


def _left(identification: Identification) -> list[tuple[str, str]]:
    """What the model leaves, in words; nothing where nothing is left."""
    residual = identification.discrepancy
    if residual is None:
        return []
    effects = identification.selection.answer.fit.model.effects
    parameters = [(f"{effect.title}, {p.meaning}", shown_unit(p.unit)) for effect in effects for p in effect.parameters]
    rows = zip(parameters, residual.moved.tolist(), residual.error.tolist(), strict=True)
    return discrepancy_facts(residual, [(name, change, error, unit) for (name, unit), change, error in rows])


def _baseline(title: str, error: AngleError) -> dict[str, str]:
    return {"title": capitalised(title), "rms": digits(error.rms_arcmin), "to_noise": digits(error.to_noise)}


def _beside(identification: Identification) -> dict[str, AngleError]:
    """Errors that stand beside the model's: of the best description, where it is not claimed, and of the baselines."""
    name = identification.selection.description.fit.model.name
    described = (
        {f"best description, not claimed: {title_of(name)}": identification.described}
        if identification.described
        else {}
    )
    return {**described, **identification.baselines}


def _limit(limit: DetectionLimit) -> tuple[str, str, str]:
    effect = candidates()[limit.effect]
    (parameter,) = (p for p in effect.parameters if p.name == limit.parameter)
    size = f"{digits(limit.value)} {shown_unit(limit.unit)}".rstrip()
    size_text = size if math.isfinite(limit.value) else "would not show at any size"
    return capitalised(effect.title), parameter.meaning, size_text


def _compared(identification: Identification) -> str:
    """Whether the model beats the best of the baselines."""
    title, best = min(identification.baselines.items(), key=lambda item: item[1].to_noise)
    ratio = identification.errors["after"].to_noise / best.to_noise
    if ratio > 1:
        return f"The model is behind the best of them, {title}, by a factor of {digits(ratio)} in noise floors."
    return f"The model is ahead of the best of them, {title}, by a factor of {digits(1 / ratio)} in noise floors."


def _judged_on(identification: Identification) -> str:
    """Which cells the errors are of, and which model each fold chose."""
    if identification.folds.in_sample:
        return "In sample: the fit has seen these data, nothing is held out."
    names = [title_of(name) if name else "nothing added" for name in identification.folds.models]
    chosen = f" With effects, each fold took: {'; '.join(names)}." if any(identification.folds.models) else ""
    return f"On data that the fit had not seen.{chosen}"


def _parameter(record: Mapping[str, Any]) -> dict[str, str]:
    effect = candidates()[record["effect"]]
    (parameter,) = [p for p in effect.parameters if p.name == record["name"]]
    return {
        "effect": capitalised(effect.title),
        "meaning": parameter.meaning,
        "value": digits(record["value"]),
        "interval": interval(record["ci_low"], record["ci_high"]) or "none",
        "unit": shown_unit(record["unit"]),
        "note": record["note"],
    }


def _fitted(row: Mapping[str, Any]) -> dict[str, str]:
    if row["member_of_class"]:
        judgement = "named"
    elif row["significant"]:
        judgement = "significant gain, not named"
    else:
        judgement = row["why_not"] or "no significant gain"
    return {
        "title": capitalised(row["title"]),
        "parameters": _numbers(row["effect"], row["parameters"]),
        "before": digits(row["score_before"]),
        "after": digits(row["score_after"]),
        "t": f"{row['t']:.1f}".replace("-", "\u2212") if math.isfinite(row["t"]) else NOTHING,
        "p": p_value(row["p"]),
        "judgement": judgement,
    }


def _numbers(name: str, parameters: str) -> str:
    values = json.loads(parameters)
    texts = []
    for effect in name.split("+"):
        for parameter in candidates()[effect].parameters:
            number = digits(values[effect][parameter.name])
            texts.append(f"{parameter.meaning}: {number} {shown_unit(parameter.unit)}".rstrip())
    return "; ".join(texts)


def _signature(signature: Any) -> dict[str, Any]:
    return {
        "value": digits(signature.value),
        "interval": signature.why_not or interval(signature.ci_low, signature.ci_high),
        "strong": signature.significant,
    }


def _loop(name: str, error: LoopError) -> dict[str, Any]:
    title, unit = LOOP_TITLES[name]
    if error.measured is None:
        return {"title": title, "unit": unit, "why_not": error.why_not}
    return {
        "title": title,
        "unit": unit,
        "why_not": "",
        "measured": digits(error.measured),
        "cells": [
            (digits(error.predicted[stage]), f"error {digits(error.predicted[stage] - error.measured)}")
            for stage in STAGES
        ],
    }


def _calibrated(findings_of_unit: Findings, factors: Mapping[str, float]) -> list[tuple[str, str, str, str]]:
    rows = []
    for key, factor in factors.items():
        value: Any = findings_of_unit.found.measurement.unit.study.design.model_dump()
        for name in key.split("."):
            value = value[name]
        rows.append((key, plain(value), digits(value * factor), digits(factor)))
    return rows


def _rows_facts(identification: Identification | FaultyUnit) -> list[tuple[str, str]]:
    rows = identification.measurement.rows
    return [
        ("Rows", f"{counted(len(rows), 'row')} in {counted(len(rows.files), 'file')}"),
        ("Crank angles", listed([f"{plain(crank)}°" for crank in rows.cranks.tolist()])),
    ]


def _data_facts(identification: Identification) -> list[tuple[str, str]]:
    measurement = identification.measurement
    noise = measurement.noise_of(identification.problem.training)
    scatters: Sequence[tuple[str, Any]] = (
        ("Scatter of repeats, drift and running in included", noise.repeats),
        ("Scatter within a branch", noise.within_branch),
        ("Between positions", noise.between_positions),
    )
    held_out_by = "crank positions" if len(measurement.rows.cranks) > 1 else "cycles"
    chosen = measurement.unit.settings.held_out.train
    counts = counted(len(measurement.branches), "branch", "branches"), counted(len(measurement.cells), "cell")
    return [
        *_rows_facts(identification),
        ("Branches and cells", ", ".join(counts)),
        (
            "Held out",
            "what unit.toml names" if chosen else f"whole {held_out_by}, each predicted by a fit to the others",
        ),
        ("Noise floor of a cell", f"{digits(identification.problem.data.noise)} arcmin: {noise.floor.words}"),
        *(
            (title, f"{digits(rms.value)} arcmin, interval {interval(rms.ci_low, rms.ci_high) or 'not determined'}")
            for title, rms in scatters
        ),
        ("Noise of the torque", f"{digits(noise.torque_noise_Nm)} N m a row"),
    ]

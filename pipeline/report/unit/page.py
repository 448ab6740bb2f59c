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


def write_page(of: Findings | FaultyUnit, folder: Path, shown_folder: Path) -> None:
    """Write report.html and its figures into ``folder``, whose verdict and tables are there already.

    Parameters
    ----------
    shown_folder : the folder as a user would type it.
    """
    verdict = read_json(folder / VERDICT_FILE)
    if isinstance(of, FaultyUnit):
        values = _common(of, verdict, shown_folder) | {"data_facts": _rows_facts(of), "tested": False, "pictures": {}}
    else:
        values = _common(of.found, verdict, shown_folder) | _tested(of, verdict) | {"pictures": _pictures(of, folder)}
    page = rendered(TEMPLATE, **values)
    write_atomic(folder / "report.html", page.encode())


def _pictures(of: Findings, folder: Path) -> dict[str, Picture]:
    cells = pd.read_parquet(folder / "residual.parquet")
    tried = pd.read_parquet(folder / "candidates.parquet")
    figures = {
        "loops": loops_figure(cells, MODELS | WRITTEN if cells["written_arcmin"].notna().any() else MODELS),
        "torque": torque_figure(cells),
        "time": time_figure(cells),
        "candidates": candidates_figure(tried, of.found.selection.base.rms),
    }
    (folder / "figures").mkdir(exist_ok=True)
    pictures = {}
    for name, figure in figures.items():
        stem = folder / "figures" / name
        save(figure, stem)
        pictures[name] = Picture(*CAPTIONS[name], stem.with_suffix(".svg").read_bytes())
    return pictures


def _common(found: Identification | FaultyUnit, verdict: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page says of any unit."""
    unit = found.measurement.unit
    return {
        "verdict": verdict,
        "design": unit.settings.design,
        "design_title": unit.study.design.title,
        "traced": [title_of(name) for name in verdict["traced"] if name not in verdict["named"]],
        "parameters": [_parameter(parameter) for parameter in verdict["parameters"]],
        "faults": found.measurement.faults,
        "not_testable": [(capitalised(title_of(name)), reason) for name, reason in verdict["not_testable"].items()],
        "corrected": verdict["corrected"],
        "not_corrected": verdict["not_corrected"],
        "best": verdict["best"],
        "folder": folder,
        "versions": package_versions(),
    }


def _tested(of: Findings, verdict: Mapping[str, Any]) -> dict[str, Any]:
    """What the page says of a unit that was fitted."""
    identification = of.found
    titles = STAGE_TITLES | {"after": _after(identification)}
    rows = pd.DataFrame(tables.candidate_rows(identification))
    fitted = rows[rows["score_after"].notna()]
    screened = rows[rows["why_not"] == tables.NOT_SHORTLISTED]
    pairs = list(zip(*of.signatures.values(), strict=True))
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
        "loop_errors": [_loop(name, error) for name, error in of.loops.items()],
        "calibrated": _calibrated(of, verdict["calibrated"]),
        "tolerances": "All tolerances are as measured."
        if identification.measurement.unit.dimensions is not None
        else f"The tolerances were not measured: {counted(identification.problem.n_modes, 'mode')} of them "
        "stand for what units of the study's distributions differ by.",
    }


def _after(found: Identification) -> str:
    """What the third of the models is."""
    return "With what is named" if found.verdict.named else "After: nothing is claimed, as refitted"


def discrepancy_facts(left: Discrepancy, moved: Sequence[tuple[str, float, float, str]]) -> list[tuple[str, str]]:
    """What is left as a Gaussian process, in words; ``moved``: name, change, standard error and unit of parameters."""
    sense = "rising" if left.worst_sense > 0 else "falling"
    facts = [
        ("Structured", f"{digits(100 * left.structured, 2)} % of the mean square of what is left"),
        ("Shared by all positions", f"{digits(left.common_arcmin)} arcmin"),
        ("Of each position by itself", f"{digits(left.own_arcmin)} arcmin"),
        ("Alike over", f"{digits(left.reach_Nm)} N m"),
        ("Largest", f"{digits(left.worst_arcmin)} arcmin at {digits(left.worst_torque_Nm)} N m, torque {sense}"),
    ]
    for name, change, error, unit in moved:
        significance = "by more than its uncertainty" if abs(change) > 2 * error else "within its uncertainty"
        text = f"moves by {digits(change)} {unit}".rstrip()
        facts.append((capitalised(name), f"{text} when the term is allowed, {significance} ({digits(2 * error)})"))
    return facts


def _left(found: Identification) -> list[tuple[str, str]]:
    """What the model leaves, in words; nothing where nothing is left."""
    residual = found.discrepancy
    if residual is None:
        return []
    effects = found.selection.answer.fit.model.effects
    parameters = [(f"{effect.title}, {p.meaning}", shown_unit(p.unit)) for effect in effects for p in effect.parameters]
    rows = zip(parameters, residual.moved.tolist(), residual.error.tolist(), strict=True)
    return discrepancy_facts(residual, [(name, change, error, unit) for (name, unit), change, error in rows])


def _baseline(title: str, error: AngleError) -> dict[str, str]:
    return {"title": capitalised(title), "rms": digits(error.rms_arcmin), "to_noise": digits(error.to_noise)}


def _beside(found: Identification) -> dict[str, AngleError]:
    """Errors that stand beside the model's: of the best description, where it is not claimed, and of the baselines."""
    name = found.selection.description.fit.model.name
    described = {f"best description, not claimed: {title_of(name)}": found.described} if found.described else {}
    return {**described, **found.baselines}


def _limit(limit: DetectionLimit) -> tuple[str, str, str]:
    effect = candidates()[limit.effect]
    (parameter,) = (p for p in effect.parameters if p.name == limit.parameter)
    size = f"{digits(limit.value)} {shown_unit(limit.unit)}".rstrip()
    shown = size if math.isfinite(limit.value) else "would not show at any size"
    return capitalised(effect.title), parameter.meaning, shown


def _compared(found: Identification) -> str:
    """Whether the model beats the best of the baselines."""
    title, best = min(found.baselines.items(), key=lambda item: item[1].to_noise)
    ratio = found.errors["after"].to_noise / best.to_noise
    if ratio > 1:
        return f"The model is behind the best of them, {title}, by a factor of {digits(ratio)} in noise floors."
    return f"The model is ahead of the best of them, {title}, by a factor of {digits(1 / ratio)} in noise floors."


def _judged_on(found: Identification) -> str:
    """Which cells the errors are of, and which model each fold chose."""
    if found.folds.in_sample:
        return "In sample: the fit has seen these data, nothing is held out."
    names = [title_of(name) if name else "nothing added" for name in found.folds.models]
    chosen = f" With effects, each fold took: {'; '.join(names)}." if any(found.folds.models) else ""
    return f"On data that the fit had not seen.{chosen}"


def _parameter(one: Mapping[str, Any]) -> dict[str, str]:
    effect = candidates()[one["effect"]]
    (parameter,) = [p for p in effect.parameters if p.name == one["name"]]
    return {
        "effect": capitalised(effect.title),
        "meaning": parameter.meaning,
        "value": digits(one["value"]),
        "interval": interval(one["ci_low"], one["ci_high"]) or "none",
        "unit": shown_unit(one["unit"]),
        "note": one["note"],
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


def _calibrated(of: Findings, factors: Mapping[str, float]) -> list[tuple[str, str, str, str]]:
    rows = []
    for key, factor in factors.items():
        value: Any = of.found.measurement.unit.study.design.model_dump()
        for name in key.split("."):
            value = value[name]
        rows.append((key, plain(value), digits(value * factor), digits(factor)))
    return rows


def _rows_facts(found: Identification | FaultyUnit) -> list[tuple[str, str]]:
    rows = found.measurement.rows
    return [
        ("Rows", f"{counted(len(rows), 'row')} in {counted(len(rows.files), 'file')}"),
        ("Crank angles", listed([f"{plain(crank)}°" for crank in rows.cranks.tolist()])),
    ]


def _data_facts(found: Identification) -> list[tuple[str, str]]:
    measurement = found.measurement
    noise = measurement.noise_of(found.problem.training)
    scatters: Sequence[tuple[str, Any]] = (
        ("Scatter of repeats, drift and running in included", noise.repeats),
        ("Scatter within a branch", noise.within_branch),
        ("Between positions", noise.between_positions),
    )
    held_out_by = "crank positions" if len(measurement.rows.cranks) > 1 else "cycles"
    chosen = measurement.unit.settings.held_out.train
    counts = counted(len(measurement.branches), "branch", "branches"), counted(len(measurement.cells), "cell")
    return [
        *_rows_facts(found),
        ("Branches and cells", ", ".join(counts)),
        (
            "Held out",
            "what unit.toml names" if chosen else f"whole {held_out_by}, each predicted by a fit to the others",
        ),
        ("Noise floor of a cell", f"{digits(found.problem.data.noise)} arcmin: {noise.floor.words}"),
        *(
            (title, f"{digits(rms.value)} arcmin, interval {interval(rms.ci_low, rms.ci_high) or 'not determined'}")
            for title, rms in scatters
        ),
        ("Noise of the torque", f"{digits(noise.torque_noise_Nm)} N m a row"),
    ]

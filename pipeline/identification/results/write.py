"""What an identification leaves behind: its tables, the verdict, the page, and the corrected design and study."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.constant_kinds import Shown
from pipeline.engine.store import write_json, write_tables
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.fitting.offered import turn_of_held_crank
from pipeline.identification.identify import FaultyUnit, Identification, one_thread
from pipeline.identification.measurement.faults.fault import Fault
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.results import tables
from pipeline.identification.results.corrected_design import (
    DESIGN_FILES,
    Corrected,
    WrittenStudy,
    best_trial,
    corrected_trial,
    study_file,
    write_best,
    write_corrected,
    written_study,
)
from pipeline.identification.results.prediction_errors import LoopError, loop_errors
from pipeline.identification.results.residual_signatures import Signature, signatures
from pipeline.identification.results.turn_signatures import turn_errors, turn_signatures
from pipeline.identification.selection.held_out import STAGES
from pipeline.identification.selection.statements.statement import fault_statement
from pipeline.identification.selection.statements.verdict import FAULT, UNEXPLAINED, VERDICT_FILE

NO_VERDICT = "the data do not support a verdict"
STALE = (
    *(f"{table.name}.parquet" for table in (tables.RESIDUAL, tables.SIGNATURES, tables.CANDIDATES)),
    *DESIGN_FILES.values(),
)
"""What an earlier run of the unit may have left that this one does not write."""


OTHER_WIDTH: Shown = 1.5
"""Ratio of widths of loops from which the advice of an unexplained unit begins with the play."""


@dataclass(frozen=True)
class Findings:
    """An identification with all that is computed from it for tables and page.

    Attributes
    ----------
    signatures : of the residual by what it is of: recalibrated, after.
    loops : errors of what is read off the loops.
    """

    identification: Identification
    signatures: Mapping[str, Sequence[Signature]]
    loops: Mapping[str, LoopError]


def findings(identification: Identification) -> Findings:
    """Signatures and errors of an identification."""
    measurement, data, curves = identification.measurement, identification.problem.data, identification.curves
    if isinstance(data, TurningData):
        of_turns = {stage: turn_signatures(measurement, data, curves[stage]) for stage in STAGES[1:]}
        return Findings(identification, of_turns, turn_errors(identification))
    of_loops = {stage: signatures(measurement, data, curves[stage]) for stage in STAGES[1:]}
    of_readings = loop_errors(identification)
    advice = play_advice(of_readings) if identification.verdict.verdict == UNEXPLAINED else ""
    advice = f"{crank_advice(measurement)}{advice}{identification.statement.advice}"
    statement = replace(identification.statement, advice=advice)
    return Findings(replace(identification, statement=statement), of_loops, of_readings)


def crank_advice(measurement: Measurement) -> str:
    """To state the crank first, where the model holds one that the data let turn by more than half a pitch; or empty.

    Then whatever the crank angle changes is taken for an effect of the torque.
    """
    turn = turn_of_held_crank(measurement)
    if not turn.leaves_pitch:
        return ""
    return (
        "State [crank] in unit.toml first, with known crank angles: if the angle was read at the motor, the crank "
        f"turned by up to {turn.deg:.3g}\u00b0 within a position, and this model holds it still. "
    )


def play_advice(loops: Mapping[str, LoopError]) -> str:
    """To measure the play first, where loops are much wider or narrower at no torque than refitted; else empty.

    Effects beside a wrong play take its place: a spring that is soft near no load for a wider one.
    """
    width = loops.get("zero_torque_width_arcmin", LoopError())
    refitted = width.predicted_values.get("recalibrated")
    if not width.measured_value or not refitted or 1 / OTHER_WIDTH < width.measured_value / refitted < OTHER_WIDTH:
        return ""
    return (
        f"Measure the play first: loops are {width.measured_value:.3g} arcmin wide at no torque, those of the refitted "
        f"model {refitted:.3g}. Turn the output by small torques of both senses at several crank positions, gauge "
        "pins, holes and flanks, and state the dimensions in the file of as_measured. "
    )


@one_thread
def write(findings_of_unit: Findings | FaultyUnit, folder: Path) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    """Write tables, verdict, and the corrected design and study into ``folder``, the verdict last.

    Of a faulty unit the verdict alone is written. Returns the content of the verdict and the frames by name.
    """
    frames: dict[str, pd.DataFrame] = {}
    identification = findings_of_unit if isinstance(findings_of_unit, FaultyUnit) else findings_of_unit.identification
    for name in (*STALE, *(study_file(identification.measurement.unit.name, kind) for kind in DESIGN_FILES)):
        (folder / name).unlink(missing_ok=True)
    if isinstance(findings_of_unit, FaultyUnit):
        content = (
            _common(findings_of_unit) | _keys_without_fit() | {"corrected": [], "best": [], "not_corrected": NO_VERDICT}
        )
    else:
        identification = findings_of_unit.identification
        corrected_design, best_design = write_corrected(identification, folder), write_best(identification, folder)
        paths = best_design.paths or corrected_design.paths
        fit = ((best_trial(identification) if best_design.paths else None) or corrected_trial(identification)).fit
        trial_written = written_study(identification, paths[-1], fit) if paths else None
        if trial_written and corrected_design.paths and not best_design.paths and trial_written.is_behind:
            for path in corrected_design.paths:
                path.unlink()
            reason = "the study that was written leaves {:.3g} arcmin, the design as declared {:.3g}"
            corrected_design = Corrected((), reason.format(trial_written.rms_arcmin, trial_written.declared_rms_arcmin))
            trial_written = None
        frames = _write_tables(findings_of_unit, trial_written, folder)
        numbers_written = vars(trial_written).items() if trial_written else ()
        content = {
            **_common(identification),
            **_keys_of_fit(findings_of_unit),
            "corrected": [path.name for path in corrected_design.paths],
            "not_corrected": corrected_design.why_not,
            "best": [path.name for path in best_design.paths],
            "written": {name: value for name, value in numbers_written if name != "angle"} or None,
        }
    content = finite(content)
    write_json(folder / VERDICT_FILE, content)
    return content, frames


def write_fault(unit: str, faults: Sequence[Fault], folder: Path) -> str:
    """Write the verdict on a record or a drive without a design whose data have a fatal fault; returns its sentence."""
    sentence = fault_statement([fault for fault in faults if fault.severity == "fatal"]).sentence
    data_faults = [asdict(fault) for fault in faults]
    verdict = {"unit": unit, "verdict": FAULT, "sentence": sentence, "data_faults": data_faults}
    write_json(folder / VERDICT_FILE, verdict)
    return sentence


def _write_tables(
    findings_of_unit: Findings, written_trial: WrittenStudy | None, folder: Path
) -> dict[str, pd.DataFrame]:
    identification, angle = findings_of_unit.identification, None if written_trial is None else written_trial.angle
    return write_tables(
        {
            tables.RESIDUAL: tables.residual_rows(identification, angle),
            tables.SIGNATURES: tables.signature_rows(findings_of_unit.signatures),
            tables.CANDIDATES: tables.candidate_rows(identification),
        },
        folder,
    )


def _common(identification: Identification | FaultyUnit) -> dict[str, Any]:
    """What verdict.json says of any unit."""
    verdict, unit = identification.verdict, identification.measurement.unit
    return {
        "unit": unit.name,
        "title": unit.settings.title,
        "verdict": verdict.verdict,
        "named": list(verdict.named_effects),
        "sentence": identification.statement.sentence,
        "advice": identification.statement.advice,
        "glance": dict(identification.statement.glance),
        "structure_floors": verdict.structure,
        "calibrated_numbers": [asdict(number) for number in verdict.calibrated_numbers],
        "findings": list(verdict.findings),
        "parameters": [asdict(parameter) for parameter in verdict.parameters],
        "data_faults": [asdict(fault) for fault in identification.measurement.faults],
    }


def _keys_without_fit() -> dict[str, Any]:
    """The keys of ``_keys_of_fit`` where nothing was computed."""
    empty: dict[str, Any] = dict.fromkeys(
        ("calibrated", "held_out_errors", "baselines", "loop_errors", "not_testable"), {}
    )
    return empty | {
        "noise": None,
        "remainder": None,
        "discrepancy": None,
        "written": None,
        "could_hide": [],
        "in_sample": False,
        "models_of_folds": [],
    }


def _keys_of_fit(findings_of_unit: Findings) -> dict[str, Any]:
    """What verdict.json says of a unit that was fitted; numbers that are not known are None."""
    identification = findings_of_unit.identification
    noise = identification.measurement.noise_of(identification.problem.training)
    return {
        "calibrated": _calibrated_factors(identification),
        "remainder": asdict(identification.remainder),
        "discrepancy": identification.discrepancy.as_json if identification.discrepancy else None,
        "noise": {
            "floor_arcmin": identification.problem.data.noise,
            "floor_is": noise.floor.words,
            "repeats_arcmin": asdict(noise.repeats),
            "random_arcmin": asdict(noise.random),
            "within_branch_arcmin": asdict(noise.within_branch),
            "between_positions_arcmin": asdict(noise.between_positions),
            "torque_noise_Nm": noise.torque_noise_Nm,
        },
        "held_out_errors": {stage: asdict(error) for stage, error in identification.errors.items()},
        "could_hide": [asdict(limit) for limit in identification.could_hide],
        "baselines": {title: asdict(error) for title, error in identification.baselines.items()},
        "in_sample": identification.folds.in_sample,
        "models_of_folds": list(identification.folds.models),
        "loop_errors": {
            name: {
                "measured": error.measured_value,
                **{
                    stage: {"value": value, "error": value - error.measured_value}
                    for stage, value in error.predicted_values.items()
                    if error.measured_value is not None
                },
                "loops": error.loops,
                "why_not": error.why_not,
            }
            for name, error in findings_of_unit.loops.items()
        },
        "not_testable": dict(identification.why_not),
    }


def _calibrated_factors(identification: Identification) -> dict[str, float]:
    """Factor of every refitted number of the design."""
    scales = corrected_trial(identification).fit.unknowns.scales.tolist()
    return {key: math.exp(scale) for key, scale in zip(identification.problem.calibrated_keys, scales, strict=False)}


def finite(value: Any) -> Any:
    """The value with None in place of numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""What an identification leaves behind: its tables, the verdict, the page, and the corrected design and study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.engine.store import write_atomic, write_json
from pipeline.identification.identify import Identification
from pipeline.identification.results import tables
from pipeline.identification.results.corrected_design import DESIGN_FILE, corrected_trial, study_file, write_corrected
from pipeline.identification.results.prediction_errors import STAGES, AngleError, LoopError, angle_errors, loop_errors
from pipeline.identification.results.residual_signatures import Signature, signatures

VERDICT_FILE = "verdict.json"
STALE = (*(f"{table.name}.parquet" for table in (tables.RESIDUAL, tables.SIGNATURES, tables.CANDIDATES)), DESIGN_FILE)
"""What an earlier run of the unit may have left that this one does not write."""


@dataclass(frozen=True)
class Findings:
    """An identification with all that is computed from it for tables and page.

    Attributes
    ----------
    signatures : of the residual by what it is of: recalibrated, after.
    angle : errors of the angle by curve.
    loops : errors of what is read off the loops.
    """

    found: Identification
    signatures: Mapping[str, Sequence[Signature]]
    angle: Mapping[str, AngleError]
    loops: Mapping[str, LoopError]


def findings(found: Identification) -> Findings:
    """Signatures and errors of an identification; none where the data bear no verdict."""
    if found.curves is None:
        return Findings(found, {}, {}, {})
    return Findings(
        found,
        {stage: signatures(found, getattr(found.curves, stage)) for stage in STAGES[1:]},
        angle_errors(found),
        loop_errors(found),
    )


def write(of: Findings, folder: Path) -> None:
    """Write tables, verdict, and the corrected design and study into ``folder``, the verdict last."""
    found = of.found
    for name in (*STALE, study_file(found.unit.name)):
        (folder / name).unlink(missing_ok=True)
    if found.curves is not None:
        for table, columns in (
            (tables.RESIDUAL, tables.residual_rows(found)),
            (tables.SIGNATURES, tables.signature_rows(of.signatures)),
            (tables.CANDIDATES, tables.candidate_rows(found)),
        ):
            write_atomic(folder / f"{table.name}.parquet", table.part(columns).data)
    written = write_corrected(found, folder)
    corrected = {"corrected": [path.name for path in written.paths], "not_corrected": written.why_not}
    write_json(folder / VERDICT_FILE, _finite(verdict_of(of) | corrected))


def verdict_of(of: Findings) -> dict[str, Any]:
    """The content of verdict.json; numbers that are not known are None."""
    found = of.found
    verdict = found.verdict
    trial = corrected_trial(found)
    return {
        "unit": found.unit.name,
        "title": found.unit.settings.title,
        "verdict": verdict.verdict,
        "named": list(verdict.named),
        "traced": list(verdict.traced),
        "sentence": verdict.sentence,
        "advice": verdict.advice,
        "structure_floors": verdict.structure,
        "parameters": [asdict(parameter) for parameter in verdict.parameters],
        "calibrated": _calibrated(found) if trial else {},
        "noise": {
            "floor_arcmin": asdict(found.noise.floor),
            "random_arcmin": asdict(found.noise.random),
            "within_branch_arcmin": asdict(found.noise.within_branch),
            "between_positions_arcmin": asdict(found.noise.between_positions),
            "torque_noise_Nm": found.noise.torque_noise_Nm,
            "used_arcmin": found.problem.data.noise if found.problem else None,
        }
        if found.noise
        else None,
        "held_out_errors": {stage: asdict(error) for stage, error in of.angle.items()},
        "loop_errors": {
            name: {
                "measured": error.measured,
                **{
                    stage: {"value": value, "error": value - error.measured}
                    for stage, value in error.predicted.items()
                    if error.measured is not None
                },
                "loops": error.loops,
                "why_not": error.why_not,
            }
            for name, error in of.loops.items()
        },
        "not_testable": dict(found.why_not or {}),
        "data_faults": [asdict(fault) for fault in found.faults],
    }


def _calibrated(found: Identification) -> dict[str, float]:
    """Factor of every refitted number of the design."""
    trial = corrected_trial(found)
    assert trial is not None
    assert found.problem is not None
    scales = trial.fit.unknowns.scales.tolist()
    return {key: math.exp(scale) for key, scale in zip(found.problem.calibrated, scales, strict=False)}


def _finite(value: Any) -> Any:
    """The value with None in place of numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

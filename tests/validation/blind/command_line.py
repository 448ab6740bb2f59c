"""Units of the third simulator through the command line: the truth is computed again once the verdict is stored.

Before the identification runs, a unit's folder holds its files and the hash of its truth, and nothing else.
"""

import hashlib
import json
import os
import resource
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from joblib import parallel_config

from pipeline.engine.fingerprint import source_hashes
from pipeline.settings import VARIABLE
from tests.validation.blind.compliant_drive.unit import Unit, drawn_unit
from tests.validation.blind.generate import COMPLIANT, ONE, TWO
from tests.validation.blind.run import FAILED, Row, has_both, is_correct, solved_cases

SEPARABLE = 25.0
"""Chi-square of what was put in, beside a stretch of the curve, beyond which a unit counts as separable."""
DESIGN, STUDY = "pin_in_hole_39", "pin_in_hole"
"""Files of the project whose mechanism, tolerances and mesh the units have."""
SEAL, TRUTH = "truth.sha256", "truth.json"


def through_command_line(cases: Sequence[int], seed: int, jobs: int, root: Path, runs: Path) -> list[Row]:
    """Rows of some cases; compliant.csv keeps all that it has of the same seed and sources."""
    folder = runs / "blind"
    code = _source_hash()
    solve = partial(one_unit, seed, code=code, root=root, folder=folder)
    with parallel_config("loky", n_jobs=jobs):
        return solved_cases(folder / "compliant.csv", cases, seed, code, solve, f"{COMPLIANT}: ")


def one_unit(seed: int, case: int, code: str, root: Path, folder: Path) -> Row:
    """Draw, seal, identify by the command line, and only then hold the stored verdict against the truth.

    Raises
    ------
    RuntimeError : the truth is not the one that was sealed.
    """
    home = folder / COMPLIANT
    path = home / "units" / f"s{seed}-{case:04d}"
    unit = drawn_unit(seed, case, designs(root))
    unit.write(path)
    (path / SEAL).write_text(_hash(unit.truth) + "\n", encoding="utf-8")
    del unit
    verdict, seconds, reason = _identified(path, home, root)
    unit = drawn_unit(seed, case, designs(root))
    if (path / SEAL).read_text(encoding="utf-8").strip() != _hash(unit.truth):
        raise RuntimeError(f"case {case}: the truth is not the one that was sealed")
    (path / TRUTH).write_text(json.dumps(unit.truth, indent=1), encoding="utf-8")
    return _row(unit, verdict, seconds=seconds, reason=reason, case=case, seed=seed, code=code)


def designs(root: Path) -> dict[str, Any]:
    """Design and study as the files of the project state them."""
    home = root / "data"
    names = {"design": home / "designs" / f"{DESIGN}.toml", "study": home / "studies" / f"{STUDY}.toml"}
    return {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in names.items()}


def _identified(path: Path, home: Path, root: Path) -> tuple[Mapping[str, Any], float, str]:
    """Content of verdict.json, processor time [s], and why there is none."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, VARIABLE: str(home), "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pipeline", "identify", "--unit", str(path.resolve()), "--jobs", "1"]
    ended = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    answer = home / "data" / "runs" / "identify" / path.name
    if ended.returncode or not (answer / "verdict.json").is_file() or not (answer / "report.html").is_file():
        return {}, seconds, " ".join(ended.stderr.split())[-300:] or f"status {ended.returncode}, or no page"
    return json.loads((answer / "verdict.json").read_text(encoding="utf-8")), seconds, ""


def _row(unit: Unit, verdict: Mapping[str, Any], **facts: Any) -> Row:
    truth, unknown = unit.truth, float("nan")
    true, named = frozenset(truth["truth"].split(";")), verdict.get("named", [])
    parts = [frozenset(name.split("+")) for name in named]
    word = verdict.get("verdict", FAILED)
    errors = verdict.get("held_out_errors") or {}
    noise = (verdict.get("noise") or {}).get("floor_arcmin", unknown)
    cells = len(unit.cells(unit.plain))
    after = errors.get("after", {})
    return Row(
        **facts,
        truth=truth["truth"],
        size_over_noise=truth["size"],
        verdict=word,
        named=";".join(named),
        class_size=len(named),
        correct=word != FAILED and is_correct(unit.kind, truth["size"], true, parts, word),
        oracle_separates=truth["size"] ** 2 * cells > SEPARABLE if unit.kind == ONE else None,
        rms_declared_arcmin=errors.get("declared", {}).get("rms_arcmin", unknown),
        rms_recalibrated_arcmin=errors.get("recalibrated", {}).get("rms_arcmin", unknown),
        rms_after_arcmin=noise * after.get("to_noise", unknown),
        noise_floor_arcmin=noise,
        parameter_covered=_covered(truth, verdict) if unit.kind == ONE else None,
        both=has_both(true, parts) if unit.kind == TWO else None,
        nearest="",
        nearest_floors=truth.get("apart", unknown),
        structure=verdict.get("structure_floors") or unknown,
        parameters=_parameters(truth, verdict),
        rms_oracle_arcmin=unknown,
        rms_expected_arcmin=noise * after.get("expected_to_noise", unknown),
        kind=unit.kind,
        reducer=f"{'elastic' if unit.parts.elastic else 'rigid'} {unit.parts.design['cycloid']['pins'] - 1}",
        simulator=COMPLIANT,
        dimensions_known=unit.parts.known,
    )


def _covered(truth: Mapping[str, Any], verdict: Mapping[str, Any]) -> bool | None:
    """Whether all parameters of the true effect lie in their intervals; None if it has none."""
    cause = truth["causes"][0]
    fitted = [p for p in verdict.get("parameters", []) if p["effect"] == cause["name"]]
    if len(fitted) != len(cause["values"]) or any(p["ci_low"] is None for p in fitted):
        return None
    return all(p["ci_low"] <= value <= p["ci_high"] for p, value in zip(fitted, cause["values"], strict=True))


def _parameters(truth: Mapping[str, Any], verdict: Mapping[str, Any]) -> str:
    fitted = [
        f"{p['effect']}.{p['name']} = {p['value']} ({p['ci_low']} to {p['ci_high']})"
        for p in verdict.get("parameters", [])
    ]
    true = [f"truly {cause['name']} {cause['values']}" for cause in truth["causes"]]
    return "; ".join(fitted + true)


def _hash(truth: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(truth, sort_keys=True).encode()).hexdigest()


def _source_hash() -> str:
    """Hash of the sources that the simulator and the command depend on."""
    content = [source_hashes(__name__), source_hashes("pipeline.library.measured")]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]

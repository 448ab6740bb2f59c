"""Blind units through the identification, one row a case: what was there, what was said, and how well it fits."""

from __future__ import annotations  # the types of a row are read as text

import csv
import hashlib
import io
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed, parallel_config

from pipeline.arrays import Real
from pipeline.engine import progress
from pipeline.engine.fingerprint import package_versions, source_hashes
from pipeline.engine.store import write_atomic
from pipeline.identification.identify import FaultyUnit, Identification, identify
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.criteria import LARGEST_CLASS
from pipeline.identification.selection.held_out import STAGES
from pipeline.identification.selection.statements.verdict import ADEQUATE, NOT_TESTABLE, UNEXPLAINED
from tests.validation.blind import oracle
from tests.validation.blind.catalogue import CatalogueReducer, catalogue, condense
from tests.validation.blind.generate import FULL, NONE, ONE, OUTSIDE_KIND, TWO, Made, Maker, generate

FULL_RUN = sum(FULL.values())
VISIBLE = 3.0
"""Size in noise floors from which an effect must be seen."""
SEED = 20240229
"""Of the published run; every case draws from it and its own number."""
FAILED = "failed"
"""Verdict of a unit whose identification ended in an error."""


@dataclass(frozen=True)
class Row:
    """One case; the table cases.csv has these columns.

    Attributes
    ----------
    correct : none: no effect named; one: it is in a class of at most three; two: both named together, or a class or
        single name that holds one of them; outside: unexplained, or adequate where it is smaller than ``VISIBLE``.
    both : of two effects, whether both are named together, alone or in a class of at most three.
    nearest, nearest_floors : other effect that comes nearest to the true one in the oracle's eyes, and how near.
    parameter_covered : whether the true parameters of the effect lie in their intervals.
    parameters : of the named effects, each with its interval and, where it was there, its true value.
    rms_oracle_arcmin : error that the true curves leave of the same cells, their zeros fitted: no model leaves less.
    rms_expected_arcmin : what a right model would leave by its covariance: noise, and what the data leave open.
    reason : why there is no verdict, where the identification failed.
    """

    case: int
    truth: str
    size_over_noise: float
    verdict: str
    named: str
    class_size: int
    correct: bool
    oracle_separates: bool | None
    rms_declared_arcmin: float
    rms_recalibrated_arcmin: float
    rms_after_arcmin: float
    noise_floor_arcmin: float
    seconds: float
    parameter_covered: bool | None
    both: bool | None
    nearest: str
    nearest_floors: float
    structure: float
    parameters: str
    rms_oracle_arcmin: float
    rms_expected_arcmin: float
    reason: str
    kind: str
    reducer: str
    simulator: str
    dimensions_known: bool
    seed: int
    code: str


def blind(cases: Sequence[int], seed: int, jobs: int, root: Path, runs: Path) -> list[Row]:
    """Rows of some cases, by their numbers; cases.csv keeps all that it has of the same seed and sources."""
    folder = runs / "blind"
    reducers = catalogue(root)
    maker = Maker(reducers, condense(reducers, folder / "condensed", jobs), folder, root, seed)
    code = source_hash(reducers)
    with parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        return solved_cases(folder / "cases.csv", cases, seed, code, partial(one_case, maker, code=code))


def solved_cases(
    table: Path, cases: Sequence[int], seed: int, code: str, solve: Callable[[int], Row], simulator: str = ""
) -> list[Row]:
    """Rows of some cases: those that a table has of the same seed and sources, and the others, which it keeps."""
    rows = {row.case: row for row in read_rows(table) if row.seed == seed and row.code == code}
    remaining = [case for case in cases if case not in rows]
    rows_solved = Parallel(return_as="generator_unordered")(delayed(solve)(case) for case in remaining)
    for count, row in enumerate(rows_solved, len(cases) - len(remaining) + 1):
        rows[row.case] = row
        write_rows(table, [rows[case] for case in sorted(rows)])
        progress.say("blind", f"{count} of {len(cases)}", f"{simulator}{row.truth}: {row.verdict} {row.named}")
    return [rows[case] for case in cases]


def one_case(maker: Maker, case: int, code: str) -> Row:
    """Generate, identify, and hold the verdict against the truth; a unit that fails keeps its row with the reason."""
    unit = generate(maker, case)
    folder = maker.unit_folder(case)
    started = time.perf_counter()
    case_facts = {"case": case, "seed": maker.seed, "code": code}
    try:
        identification = identify(load_measured_unit(folder, maker.root), unit.believed)
        seconds = time.perf_counter() - started
        distances = {}
        if unit.truth["kind"] in (ONE, OUTSIDE_KIND):
            distances = oracle.distances(unit, folder, maker.root)
    except Exception as error:  # the other units are worth their verdicts
        return _failed(unit, error, seconds=time.perf_counter() - started, **case_facts)
    return _row(unit, identification, distances, seconds=seconds, **case_facts)


def _failed(unit: Made, error: Exception, **case_facts: Any) -> Row:
    """Row of a unit without a verdict: nothing known, nothing right."""
    truth = unit.truth
    unknown: dict[str, Any] = {"str": "", "int": 0, "float": float("nan"), "bool": False}
    values = {field.name: unknown.get(str(field.type)) for field in fields(Row)}
    values |= {
        name: truth[name] for name in ("truth", "size_over_noise", "kind", "reducer", "simulator", "dimensions_known")
    }
    return Row(**{**values, **case_facts, "verdict": FAILED, "reason": f"{type(error).__name__}: {error}"})


def _row(
    unit: Made, identification: Identification | FaultyUnit, distances: Mapping[str, float], **case_facts: Any
) -> Row:
    truth, verdict = unit.truth, identification.verdict
    kind, size = truth["kind"], truth["size_over_noise"]
    parts = [frozenset(name.split("+")) for name in verdict.named_effects]
    true = frozenset(truth["truth"].split(";"))
    nearest = min(distances, key=lambda name: distances[name], default="")
    declared, recalibrated, best = errors_of(identification)
    least, expected = least_errors(identification, unit.angles)
    return Row(
        **case_facts,
        truth=truth["truth"],
        size_over_noise=size,
        verdict=verdict.verdict,
        named=";".join(verdict.named_effects),
        class_size=len(verdict.named_effects),
        correct=is_correct(kind, size, true, parts, verdict.verdict),
        oracle_separates=distances[nearest] >= 1 if distances else None,
        rms_declared_arcmin=declared,
        rms_recalibrated_arcmin=recalibrated,
        rms_after_arcmin=best,
        noise_floor_arcmin=identification.problem.data.noise
        if isinstance(identification, Identification)
        else float("nan"),
        parameter_covered=_covered(identification, truth) if kind == ONE else None,
        both=has_both(true, parts) if kind == TWO else None,
        nearest=nearest,
        nearest_floors=distances.get(nearest, float("nan")),
        structure=verdict.structure,
        parameters=_parameters(identification, truth),
        rms_oracle_arcmin=least,
        rms_expected_arcmin=expected,
        reason="",
        kind=kind,
        reducer=truth["reducer"],
        simulator=truth["simulator"],
        dimensions_known=truth["dimensions_known"],
    )


def is_correct(
    kind: str, size: float, true: frozenset[str], named_sets: Sequence[frozenset[str]], verdict: str
) -> bool:
    """Whether a verdict is right; see ``Row``."""
    if kind == NONE:
        return not named_sets
    if kind == OUTSIDE_KIND:
        return verdict == UNEXPLAINED or (verdict in (ADEQUATE, NOT_TESTABLE) and size < VISIBLE)
    if not 0 < len(named_sets) <= LARGEST_CLASS:
        return False
    return any(effect_set <= true for effect_set in named_sets)


def has_both(true: frozenset[str], named_sets: Sequence[frozenset[str]]) -> bool:
    """Whether two effects are named together in a class that is no larger than one may be."""
    return true in named_sets and len(named_sets) <= LARGEST_CLASS


def _covered(identification: Identification | FaultyUnit, truth: Mapping[str, Any]) -> bool | None:
    """Whether all parameters of the true effect lie in their intervals; None if it has none."""
    effect = truth["effects"][0]
    of_effect = [p for p in identification.verdict.parameters if p.effect == effect["name"]]
    if not of_effect or any(np.isnan(p.ci_low) for p in of_effect):
        return None
    return all(p.ci_low <= value <= p.ci_high for p, value in zip(of_effect, effect["values"], strict=True))


def _parameters(identification: Identification | FaultyUnit, truth: Mapping[str, Any]) -> str:
    values = {effect["name"]: effect.get("values", ()) for effect in truth["effects"]}
    phrases = []
    for name in dict.fromkeys(p.effect for p in identification.verdict.parameters):
        of_effect = [p for p in identification.verdict.parameters if p.effect == name]
        phrases += [f"{name}.{p.name} = {p.value:.4g} ({p.ci_low:.4g} to {p.ci_high:.4g})" for p in of_effect]
        if name in values:
            phrases.append(f"truly {' '.join(f'{value:.4g}' for value in values[name])}")
    return "; ".join(phrases)


def errors_of(identification: Identification | FaultyUnit) -> tuple[float, float, float]:
    """Held-out errors [arcmin] as declared, recalibrated and with the chosen model: rms in sigmas times the floor."""
    if isinstance(identification, FaultyUnit):
        return (float("nan"),) * 3
    floor = identification.problem.data.noise
    declared, recalibrated, best = (floor * identification.errors[stage].to_noise for stage in STAGES)
    return declared, recalibrated, best


def least_errors(identification: Identification | FaultyUnit, angles: Sequence[Real]) -> tuple[float, float]:
    """Errors [arcmin] of held-out cells that the true curves leave, and that a right model would.

    Parameters
    ----------
    angles : per position (n_rows,) [arcmin] without noise and offset.
    """
    if isinstance(identification, FaultyUnit):
        return (float("nan"),) * 2
    data, cells = identification.problem.data, identification.folds.cells
    true = identification.measurement.over_cells(np.concatenate(angles))
    misfit = (data.angle - true - data.offsets(true, cells, data.sigma)) / data.sigma
    least = float(np.sqrt(np.mean(misfit[cells] ** 2)))
    return data.noise * least, data.noise * identification.errors["after"].expected_to_noise


def source_hash(reducers: Sequence[CatalogueReducer]) -> str:
    """Hash of all that a row depends on: sources that this module imports, packages, and the catalogue's studies."""
    studies = [study.model_dump(mode="json") for reducer in reducers for study in (reducer.model, reducer.truth)]
    content = json.dumps([source_hashes(__name__), package_versions(), studies], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """The table cases.csv; truths as true and false, what is not known empty."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow([field.name for field in fields(Row)])
    table.writerows([[_written(value) for value in asdict(row).values()] for row in rows])
    write_atomic(path, text.getvalue().encode())


def _written(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if value is None or value != value:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def read_rows(path: Path) -> Iterator[Row]:
    """Rows of a table that ``write_rows`` wrote; none of a table with other columns."""
    if not path.is_file():
        return
    with path.open(newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            if set(line) == {field.name for field in fields(Row)}:
                yield Row(**{field.name: _read(str(field.type), line[field.name]) for field in fields(Row)})


def _read(kind: str, text: str) -> Any:
    if "bool" in kind:
        return None if text == "" else text == "true"
    if kind == "float":
        return float(text) if text else float("nan")
    return int(text) if kind == "int" else text

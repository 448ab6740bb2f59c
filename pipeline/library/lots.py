"""Questions about measured parts: the yield of lots, which parts go together, and the certificate of one unit."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import settings
from pipeline.config import Study
from pipeline.config.changing import toml_of
from pipeline.config.files.section import NAME, NAME_RULE
from pipeline.config.files.table_file import read_table
from pipeline.config.reading import load_case
from pipeline.decisions.certificate import (
    Certificate,
    Compensated,
    Loops,
    compensation,
    limit_sentence,
    write_certificate,
)
from pipeline.decisions.certificate import certificate as certificate_of
from pipeline.decisions.fresh_units import refuse_limits_of_turn
from pipeline.decisions.lots import results
from pipeline.decisions.lots.measured_lot import PART, MeasuredLot, measured_lot, with_separate_ovalities
from pipeline.decisions.selective_assembly import Assembly, best_assembly, write_pairs
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.library.decisions import DESIGN_FILE, loaded_units
from pipeline.library.running import Answer, Workers, prepared_loops, study_of, up_to_date
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.units import ARCMIN, NM_PER_NMM
from pipeline.report.decisions.certificate import (
    assembly_sentences,
    assembly_warnings,
    certificate_warnings,
    compensation_sentence,
    write_assembly_page,
    write_certificate_page,
)
from pipeline.report.decisions.lots import lot_warnings, sentences, unused_columns, write_lots_page
from pipeline.sampling.errors import Errors
from stages import hysteresis

CERTIFIED_CRANKS = tuple(15.0 * k for k in range(24))
"""Crank angles [deg] of a certificate without a measured loop."""
MOST_LOTS = 2
"""Lots that a question takes: one, or two side by side."""


def lots(
    files: Sequence[str | Path], study: Study | str | Path, units: int = 2_000, jobs: int | Workers | None = None
) -> Answer[list[results.LotFindings]]:
    """The distributions of measured lots, and the yield of a study made from them.

    Parameters
    ----------
    files : CSV files of measured parts, one or two, a row for each part.
    study : or the name or file of one.
    units : load-solved for each yield.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If a file or a number is wrong.
    """
    if units < 1:
        raise InputError(f"--units = {units}; must be at least 1")
    if len(files) > MOST_LOTS:
        raise InputError(f"--csv given {len(files)} times; at most {MOST_LOTS} lots are compared")
    study = study_of(study)
    refuse_limits_of_turn(study, "a lot")
    measured_lots = [_read_lot(Path(path), study) for path in files]
    names = [lot.name for lot in measured_lots]
    if repeated := {name for name in names if names.count(name) > 1}:
        raise InputError(f"--csv: {', '.join(sorted(repeated))} names two lots; give each file a name of its own")
    for lot in measured_lots:
        results.lot_fits(study, lot)  # says what is missing before anything is condensed
    upstream_run = up_to_date(study, ["springs", "reduce"], jobs)
    solve = partial(loaded_units, prepared_loops(study, upstream_run.outputs))
    findings = [results.lot_findings(study, lot, solve, units, upstream_run.jobs) for lot in measured_lots]
    folder = settings.RUNS / "lots" / "-".join([study.name, *(lot.name for lot in measured_lots)])
    frames = results.write(study, findings, folder)
    names = [f"{study.name}-{lot_findings.lot.name}" for lot_findings in findings]
    for name, lot_findings in zip(names, findings, strict=True):
        text = results.study_text(study, lot_findings.fits, lot_findings.lot.name, name, DESIGN_FILE)
        write_atomic(folder / f"{name}.toml", text.encode())
    write_atomic(folder / DESIGN_FILE, toml_of(study.design.model_dump()).encode())
    write_lots_page(study, findings, [f"{name}.toml" for name in names], folder)
    lines = [
        line
        for found in findings
        for line in (*lot_warnings(study, found), *sentences(found), *unused_columns(found.lot))
    ]
    return Answer(findings, tuple(lines), folder, frames)


def assemble(
    first: str | Path,
    second: str | Path,
    study: Study | str | Path,
    mounting_force: float | None = None,
    jobs: int | Workers | None = None,
) -> Answer[Assembly]:
    """Which measured parts of two lots to put together, so that most units meet every limit.

    Parameters
    ----------
    first, second : CSV files of measured parts with dimensions of their own.
    study : or the name or file of one.
    mounting_force : allowed contact force without torque [N].
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If a file or a number is wrong.
    """
    study = study_of(study)
    refuse_limits_of_turn(study, "an assembly")
    if mounting_force is not None and not mounting_force > 0:
        raise InputError(f"--mounting-force = {mounting_force:g}; must be above 0 N")
    first_lot, second_lot = (_read_lot(Path(path), study) for path in (first, second))
    upstream_run = up_to_date(study, ["springs", "reduce"], jobs)
    loop_inputs = prepared_loops(study, upstream_run.outputs)
    mounting = None if mounting_force is None else partial(hysteresis.mounting_forces, loop_inputs)
    assembly = best_assembly(
        study, first_lot, second_lot, partial(loaded_units, loop_inputs), upstream_run.jobs, mounting
    )
    folder = settings.RUNS / "assemble" / f"{study.name}-{first_lot.name}-{second_lot.name}"
    frames = write_pairs(assembly, folder)
    write_assembly_page(study, assembly, mounting_force, folder)
    unused = [text for lot in (first_lot, second_lot) for text in unused_columns(lot)]
    lines = (*assembly_warnings(study, assembly), *assembly_sentences(assembly, mounting_force), *unused)
    return Answer(assembly, lines, folder, frames)


def certificate(
    dimensions: str | Path,
    study: Study | str | Path,
    unit: str | Path | None = None,
    draws: int = 200,
    jobs: int | Workers | None = None,
) -> Answer[Certificate]:
    """What one unit will do, from its measured dimensions, with a compensation table.

    Parameters
    ----------
    dimensions : TOML file of measured errors [um].
    study : or the name or file of one.
    unit : folder with a unit.toml of a measured loop, with which the compensation is compared.
    draws : of the dimensions that were not measured.
    jobs : processes; the study's own number if not given.

    Raises
    ------
    InputError
        If a file or a number is wrong.
    """
    study = study_of(study)
    refuse_limits_of_turn(study, "a certificate")
    if draws < 1:
        raise InputError(f"--draws = {draws}; must be at least 1")
    case = load_case(Path(dimensions), study)
    measurement = None if unit is None else Measurement.read(load_measured_unit(unit, settings.ROOT))
    if measurement is not None and measurement.fatal:
        raise InputError([fault.line for fault in measurement.fatal])
    cranks = CERTIFIED_CRANKS if measurement is None else measurement.drive_cranks
    crank_deg = tuple(sorted({float(crank) for crank in cranks}))
    study = study.with_section("cycle", crank_deg=crank_deg, loaded_angles=None, curve_angles=3600)
    study = study.model_copy(update={"name": f"certificate-{case.label}"})
    upstream_run = up_to_date(study, ["springs", "reduce"], jobs)
    loop_inputs = prepared_loops(study, upstream_run.outputs)
    solve = partial(loaded_units, loop_inputs, with_finite_motion=True)
    unit_certificate = certificate_of(study, case, solve, partial(whole_loops, loop_inputs), draws)
    loop = None
    if measurement is not None and unit_certificate.is_predicted:
        loop = _measured_loop(unit_certificate, measurement)
    folder = settings.RUNS / "certificate" / case.label
    frames = write_certificate(unit_certificate, folder)
    write_certificate_page(unit_certificate, loop, folder)
    lines = (limit_sentence(unit_certificate), compensation_sentence(unit_certificate, loop))
    return Answer(unit_certificate, (*certificate_warnings(unit_certificate), *lines), folder, frames)


def whole_loops(loop_inputs: hysteresis.Shared, sampled_errors: Errors) -> Loops:
    """Whole loops of units as functions of the torque, both senses; each sense has both ends of the loop."""
    senses = []
    torque = np.empty(0)
    for solution in hysteresis.solve_samples(loop_inputs, sampled_errors):
        response = solution.response
        number = {name: k for k, name in enumerate(BRANCHES)}
        sense_angles = []
        for branch_away, branch_back, turn in (
            ("unloading-", "reloading+", "loading-"),
            ("unloading+", "loading-", "loading+"),
        ):
            is_in_branch = np.isin(response.branch, [number[branch_away], number[branch_back]]) & (response.torque != 0)
            is_in_branch[np.flatnonzero(response.branch == number[turn])[-1]] = True
            steps = np.flatnonzero(is_in_branch)
            steps = steps[np.argsort(response.torque[steps])]
            torque = NM_PER_NMM * response.torque[steps]
            sense_angles.append(ARCMIN * response.angle[:, steps])
        senses.append(np.stack(sense_angles, axis=1))
    return Loops(np.array(loop_inputs.study.cycle.crank_deg), torque, np.stack(senses, axis=1))


def _measured_loop(unit: Certificate, measurement: Measurement) -> Compensated:
    cells = measurement.cells
    cranks = measurement.drive_cranks[cells.position]
    return compensation(unit, cranks, cells.direction > 0, cells.torque_mean, cells.angle_mean, cells.position)


def _read_lot(path: Path, study: Study) -> MeasuredLot:
    """The parts of a CSV file."""
    if not path.is_file():
        raise InputError(f"--csv = {path}; no such file; give a CSV file with one row per part")
    if not NAME.fullmatch(path.stem):
        raise InputError(f"--csv = {path.name!r}; its name without the ending names results and {NAME_RULE}")
    table = read_table(path, path.name, names_in=(PART,))
    return with_separate_ovalities(measured_lot(path.stem, table, study.design), study)

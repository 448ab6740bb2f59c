"""Commands on measured parts: the yield of lots, which parts go together, and the certificate of one unit."""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from pipeline import settings
from pipeline.cli.arguments import workers
from pipeline.config import load_study
from pipeline.config.files.table_file import read_table
from pipeline.config.files.writing import toml_of
from pipeline.config.reading import load_case
from pipeline.config.studies.study import Study
from pipeline.decisions.certificate import (
    Certificate,
    Compensated,
    Loops,
    certificate,
    compensated,
    limit_sentence,
    write_certificate,
)
from pipeline.decisions.lots import results
from pipeline.decisions.lots.measured_lot import MeasuredLot, measured_lot
from pipeline.decisions.lots.ovalities import with_separate_ovalities
from pipeline.decisions.selective_assembly import assembled, write_pairs
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.library.decisions import DESIGN_FILE, loaded_units
from pipeline.library.running import prepared_loops, up_to_date
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.units import ARCMIN, NM_PER_NMM
from pipeline.report.decisions.assembly import assembly_sentences, write_assembly_page
from pipeline.report.decisions.certificate import compensation_sentence, write_certificate_page
from pipeline.report.decisions.lots import sentences, write_lots_page
from pipeline.sampling import Errors
from stages import hysteresis

CERTIFIED_CRANKS = tuple(15.0 * k for k in range(24))
"""Crank angles [deg] of a certificate without a measured loop."""
MOST_LOTS = 2
"""Lots that a command takes: one, or two side by side."""


def judge_lots(options: argparse.Namespace) -> None:
    """Fit the distributions of measured lots and solve the yield of a study made from them."""
    if options.units < 1:
        raise InputError(f"--units = {options.units}; must be at least 1")
    if len(options.csv) > MOST_LOTS:
        raise InputError(f"--csv given {len(options.csv)} times; at most {MOST_LOTS} lots are compared")
    study = load_study(options.study, settings.ROOT)
    lots = [read_lot(path, study) for path in options.csv]
    for lot in lots:
        results.lot_fits(study, lot)  # says what is missing before anything is condensed
    condensed = up_to_date(study, ["springs", "reduce"], workers(options))
    shared = prepared_loops(study, condensed.outputs)
    solve = partial(loaded_units, shared)
    findings = [results.lot_findings(study, lot, solve, options.units, condensed.jobs) for lot in lots]
    folder = settings.RUNS / "lots" / "-".join([study.name, *(lot.name for lot in lots)])
    results.write_tables(study, findings, folder)
    files = []
    for found in findings:
        name = f"{study.name}-{found.lot.name}"
        text = results.study_text(study, found.fits, found.lot.name, name, DESIGN_FILE)
        write_atomic(folder / f"{name}.toml", text.encode())
        files.append(f"{name}.toml")
    write_atomic(folder / DESIGN_FILE, toml_of(study.design.model_dump()).encode())
    write_lots_page(study, findings, files, folder)
    for found in findings:
        print("\n".join(sentences(found, study)))
    print(f"report: {settings.shown(folder / 'report.html')}")


def assemble_parts(options: argparse.Namespace) -> None:
    """Assign the measured parts of one lot to those of another so that most units meet every limit."""
    study = load_study(options.study, settings.ROOT)
    if len(options.csv) != MOST_LOTS:
        raise InputError(f"--csv given {len(options.csv)} times; give it twice: the lots whose parts go together")
    if options.mounting_force is not None and not options.mounting_force > 0:
        raise InputError(f"--mounting-force = {options.mounting_force:g}; must be above 0 N")
    first, second = (read_lot(path, study) for path in options.csv)
    condensed = up_to_date(study, ["springs", "reduce"], workers(options))
    shared = prepared_loops(study, condensed.outputs)
    mounting = None if options.mounting_force is None else partial(hysteresis.mounting_forces, shared)
    assembly = assembled(study, first, second, partial(loaded_units, shared), condensed.jobs, mounting)
    folder = settings.RUNS / "assemble" / f"{study.name}-{first.name}-{second.name}"
    write_pairs(assembly, folder)
    write_assembly_page(study, assembly, options.mounting_force, folder)
    print("\n".join(assembly_sentences(assembly, options.mounting_force)))
    print(f"report: {settings.shown(folder / 'report.html')}")


def certify_unit(options: argparse.Namespace) -> None:
    """Predict what one unit will do from its measured dimensions, with a compensation table."""
    study = load_study(options.study, settings.ROOT)
    case = load_case(options.dimensions, study)
    measurement = None if options.unit is None else Measurement.read(load_measured_unit(options.unit, settings.ROOT))
    if measurement is not None and measurement.fatal:
        raise InputError([fault.line for fault in measurement.fatal])
    cranks = CERTIFIED_CRANKS if measurement is None else measurement.drive_cranks
    cycle = study.cycle.model_copy(
        update={"crank_deg": tuple(sorted({float(c) for c in cranks})), "loaded_angles": None, "curve_angles": 3600}
    )
    study = study.model_copy(update={"cycle": cycle, "name": f"certificate-{case.label}"})
    condensed = up_to_date(study, ["springs", "reduce"], workers(options))
    shared = prepared_loops(study, condensed.outputs)
    unit = certificate(study, case, partial(loaded_units, shared), partial(_loops, shared), options.draws)
    loop = None if measurement is None else _measured_loop(unit, measurement)
    folder = settings.RUNS / "certificate" / case.label
    write_certificate(unit, folder)
    write_certificate_page(unit, loop, folder)
    print(f"{limit_sentence(unit)}\n{compensation_sentence(unit, loop)}")
    print(f"report: {settings.shown(folder / 'report.html')}")


def _loops(shared: hysteresis.Shared, sampled: Errors) -> Loops:
    """Whole loops of units as functions of the torque, both senses; each sense has both ends of the loop."""
    senses = []
    torque = np.empty(0)
    for solution in hysteresis.solve_samples(shared, sampled):
        response = solution.response
        number = {name: k for k, name in enumerate(BRANCHES)}
        sense_angles = []
        for away, back, turn in (("unloading-", "reloading+", "loading-"), ("unloading+", "loading-", "loading+")):
            chosen = np.isin(response.branch, [number[away], number[back]]) & (response.torque != 0)
            chosen[np.flatnonzero(response.branch == number[turn])[-1]] = True
            steps = np.flatnonzero(chosen)
            steps = steps[np.argsort(response.torque[steps])]
            torque = NM_PER_NMM * response.torque[steps]
            sense_angles.append(ARCMIN * response.angle[:, steps])
        senses.append(np.stack(sense_angles, axis=1))
    return Loops(np.array(shared.study.cycle.crank_deg), torque, np.stack(senses, axis=1))


def _measured_loop(unit: Certificate, measurement: Measurement) -> Compensated:
    cells = measurement.cells
    cranks = measurement.drive_cranks[cells.position]
    return compensated(unit, cranks, cells.direction > 0, cells.torque_mean, cells.angle_mean, cells.position)


def read_lot(path: Path, study: Study) -> MeasuredLot:
    """The parts of a CSV file."""
    if not path.is_file():
        raise InputError(f"--csv = {path}; no such file; give a CSV file with one row per part")
    lot = measured_lot(path.stem, read_table(path, path.name), study.design)
    return with_separate_ovalities(lot, study)

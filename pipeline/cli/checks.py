"""Commands that hold the model against something: speed, the paper, exact answers, generated units, other solvers."""

import argparse
import sys

from pipeline import settings
from pipeline.checks import bench, calibrate, coverage, verify
from pipeline.checks.blind.report import write_reports
from pipeline.checks.blind.run import FULL_RUN, SEED, blind
from pipeline.checks.calculix import export
from pipeline.checks.licences import UNKNOWN, licences
from pipeline.checks.paper import comparison
from pipeline.checks.rig import (
    TRAINED,
    predicted_states,
    relocked_position,
    series_name,
    states_of,
    write_unit,
)
from pipeline.cli.arguments import check_sample, workers
from pipeline.config import load_study
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.library.running import known_size, up_to_date

COARSE = "quick"
"""Study whose mesh CalculiX takes minutes for, not hours."""


def measure_speed(options: argparse.Namespace) -> None:
    """Measure the speed of a study's hot parts."""
    study = load_study(options.study, settings.ROOT)
    settings.RUNS.mkdir(parents=True, exist_ok=True)
    results = []
    for result in bench.bench(study, load_study(COARSE, settings.ROOT), settings.RUNS):
        results.append(result)
        print(
            f"{result.name:34}{result.value:12.4g} {result.unit:4}{result.samples:7} samples  {result.note}", flush=True
        )
    bench.write(results, settings.RUNS / "bench")
    print(f"table: {settings.RUNS / 'bench' / 'bench.csv'}")


def compare_paper(options: argparse.Namespace) -> None:
    """Hold the paper's numbers and figures against the model."""
    study = load_study(comparison.STUDY, settings.ROOT)
    outputs = up_to_date(study, ["aggregate"], workers(options)).outputs
    folder = settings.RUNS / study.name
    variations = settings.PUBLISHED.parent / comparison.VARIATIONS
    comparison.write(comparison.compared(study, outputs, settings.PUBLISHED, folder), folder, variations)
    print((folder / "table2.csv").read_text(), end="")
    print(f"page: {folder / 'paper.html'}")


def fit_design(options: argparse.Namespace) -> None:
    """Fit numbers of a design to published metrics."""
    study = load_study(options.study or comparison.STUDY, settings.ROOT)
    source = options.targets or settings.PUBLISHED / comparison.TARGETS
    targets = calibrate.read_targets(source, study)
    fitted = options.parameters or settings.PUBLISHED / comparison.FITTED
    parameters = calibrate.read_parameters(fitted, study.design)
    fit = calibrate.calibrated(study, targets, parameters, study.metrics.confidence)
    folder = settings.RUNS / "calibrate" / study.name
    calibrate.write(fit, targets, source.name, folder)
    for name in ("fit.csv", "targets.csv"):
        print((folder / name).read_text(), end="")
    print(f"singular values: {', '.join(f'{value:.3g}' for value in fit.fit.singular_values)}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    print(f"design: {folder / 'design.toml'}")


def verify_mechanics(options: argparse.Namespace) -> None:
    """Hold the mechanics against exact answers and independent solvers."""
    failed = verify.verify(options.mesh, settings.ROOT, settings.RUNS / "verify" / "results.csv")
    if failed:
        print(f"{failed} rows failed", file=sys.stderr)
        raise SystemExit(1)


def count_coverage(options: argparse.Namespace) -> None:
    """Count how often intervals of a study's statistics hold the truth."""
    for name in ("repeats", "jobs"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} = {getattr(options, name)}; must be at least 1")
    study = load_study(options.study, settings.ROOT)
    truth = coverage.truths(coverage.reference(study, jobs=options.jobs))
    rows = []
    for experiment in coverage.EXPERIMENTS:
        for count in coverage.COUNTS:
            rows += coverage.coverages(study, experiment, count, options.repeats, truth, options.jobs)
    table = settings.RUNS / "coverage" / "coverage.csv"
    write_atomic(table, coverage.text(rows).encode())
    print(table.read_text(), end="")
    print(f"table: {settings.shown(table)}")


def export_deck(options: argparse.Namespace) -> None:
    """Write a sample as an input deck of CalculiX."""
    study = known_size(load_study(options.study, settings.ROOT))
    check_sample(study, options.sample)
    crank = study.cycle.crank_deg[0] if options.crank is None else options.crank
    print(export(study, options.sample, crank, settings.RUNS / study.name / "calculix"))


def list_licences(_: argparse.Namespace) -> None:
    """List the licence of every pinned package; ends with status 1 where an installed one states none."""
    packages = licences(settings.ROOT / "constraints.txt")
    for package in packages:
        print(f"{package.package:24}{package.version:12}{package.licence}")
    unknown = [package.package for package in packages if package.licence == UNKNOWN and package.version != UNKNOWN]
    if unknown:
        print(f"without a licence: {', '.join(unknown)}", file=sys.stderr)
        raise SystemExit(1)


def identify_rig(options: argparse.Namespace) -> None:
    """Predict every state of the printed drive's rig where nothing was fitted, beside the baselines."""
    home = settings.RUNS / "rig"
    measurements, again = {}, {}
    for state in states_of([options.data]):
        folder = write_unit(state, home / series_name(state.name) / state.name)
        measurements[state.name] = Measurement.read(load_measured_unit(folder, settings.ROOT))
        print("\n".join(measurements[state.name].summary), flush=True)
        relocked = relocked_position(state)
        if relocked:
            folder = write_unit(state, home / "again" / state.name, [TRAINED, relocked])
            again[state.name] = Measurement.read(load_measured_unit(folder, settings.ROOT))
    held_out = predicted_states(measurements, again).round(1)
    held_out.to_csv(home / "held_out.csv", index=False)
    print(held_out.to_string(index=False))
    print(f"table: {settings.shown(home / 'held_out.csv')}")


def run_blind(options: argparse.Namespace) -> None:
    """Test the identification on generated units."""
    cases = FULL_RUN if options.cases is None else options.cases
    seed = SEED if options.seed is None else options.seed
    limits = ("cases", cases, 1), ("first", options.first, 0), ("jobs", options.jobs, 1), ("seed", seed, 0)
    for name, value, lowest in limits:
        if value < lowest:
            raise InputError(f"--{name} = {value}; must be at least {lowest}")
    rows = blind(range(options.first, options.first + cases), seed, options.jobs, settings.ROOT, settings.RUNS)
    folder = settings.RUNS / "blind"
    write_reports(rows, folder)
    print((folder / "rates.csv").read_text(encoding="utf-8"), end="")
    print(f"table: {settings.shown(folder / 'cases.csv')}")

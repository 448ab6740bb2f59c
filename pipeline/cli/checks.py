"""Commands that hold the model against something: speed, the paper, exact answers, independent solvers."""

import argparse
import sys
from pathlib import Path

from pipeline.checks import calibrate, coverage
from pipeline.checks.paper import comparison
from pipeline.cli import settings
from pipeline.config import load_study
from pipeline.engine.runner import run
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError
from stages.chain import STAGES

COARSE = "quick"
"""Study whose mesh CalculiX takes minutes for, not hours."""


def add(command: settings.Commands) -> None:
    """Add the commands."""
    measuring = command("bench", _bench, "measure the speed of a study's hot parts")
    settings.study_option(measuring)

    settings.jobs_option(command("paper", _paper, "hold the paper's Table 2, contacts and figures against the model"))

    fitting = command("calibrate", _calibrate, "fit numbers of a study's design to published metrics of its cases")
    fitting.add_argument("--study", default=comparison.STUDY, help="study of cases, or its stem in data/studies")
    for name, stem, what in (
        ("--targets", comparison.TARGETS, "CSV of published metrics"),
        ("--parameters", comparison.FITTED, "CSV of fitted numbers: key, lower, upper"),
    ):
        fitting.add_argument(name, type=Path, default=settings.PUBLISHED / stem, help=what)

    verifying = command("verify", _verify, "hold the mechanics against exact answers and independent solvers")
    verifying.add_argument("--mesh", choices=("coarse", "paper"), default="paper", help="default: paper")

    counting = command("coverage", _coverage, "count how often intervals of a study's statistics hold the truth")
    settings.study_option(counting)
    counting.add_argument("--repeats", type=int, default=2000, help="experiments per design; default: 2000")
    counting.add_argument("--jobs", type=int, default=2, help="processes; default: 2")

    exporting = command("export-ccx", _export_ccx, "write a sample of a study as an input deck of CalculiX")
    exporting.add_argument("study", help="study file, or the stem of one in data/studies")
    exporting.add_argument("--sample", required=True, type=int)
    exporting.add_argument("--crank", type=float, metavar="DEG", help="crank angle; default: the study's first")


def _bench(options: argparse.Namespace) -> None:
    from pipeline.checks import bench  # slow to import

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


def _paper(options: argparse.Namespace) -> None:
    study = load_study(comparison.STUDY, settings.ROOT)
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["aggregate"], settings.RUNS, resources)
    folder = settings.RUNS / study.name
    variations = settings.PUBLISHED.parent / comparison.VARIATIONS
    comparison.write(comparison.compared(study, outputs, settings.PUBLISHED, folder), folder, variations)
    print((folder / "table2.csv").read_text(), end="")
    print(f"page: {folder / 'paper.html'}")


def _calibrate(options: argparse.Namespace) -> None:
    study = load_study(options.study, settings.ROOT)
    targets = calibrate.read_targets(options.targets, study)
    parameters = calibrate.read_parameters(options.parameters, study.design)
    fit = calibrate.calibrated(study, targets, parameters, study.metrics.confidence)
    folder = settings.RUNS / "calibrate" / study.name
    calibrate.write(fit, targets, options.targets.name, folder)
    for name in ("fit.csv", "targets.csv"):
        print((folder / name).read_text(), end="")
    print(f"singular values: {', '.join(f'{value:.3g}' for value in fit.fit.singular_values)}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    print(f"design: {folder / 'design.toml'}")


def _verify(options: argparse.Namespace) -> None:
    from pipeline.checks import verify  # slow to import

    failed = verify.verify(options.mesh, settings.ROOT, settings.RUNS / "verify" / "results.csv")
    if failed:
        print(f"{failed} rows failed", file=sys.stderr)
        raise SystemExit(1)


def _coverage(options: argparse.Namespace) -> None:
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


def _export_ccx(options: argparse.Namespace) -> None:
    from pipeline.checks.calculix import export  # slow to import

    study = load_study(options.study, settings.ROOT)
    settings.check_sample(study, options.sample)
    crank = study.cycle.crank_deg[0] if options.crank is None else options.crank
    print(export(study, options.sample, crank, settings.RUNS / study.name / "calculix"))

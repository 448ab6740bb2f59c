"""Commands that hold the model against something: the paper, exact answers, other solvers."""

import argparse
import sys

from pipeline import settings
from pipeline.checks import calibrate, verify
from pipeline.checks.calculix.program import export
from pipeline.checks.paper import comparison
from pipeline.cli.arguments import check_sample, workers
from pipeline.config import load_study
from pipeline.library.running import known_size, up_to_date


def compare_paper(options: argparse.Namespace) -> None:
    """Hold the paper's numbers and figures against the model."""
    study = load_study(comparison.STUDY, settings.ROOT)
    outputs = up_to_date(study, ["aggregate"], workers(options)).outputs
    folder = settings.RUNS / study.name
    variations = settings.PUBLISHED.parent / comparison.VARIATIONS
    comparison.write(comparison.paper_comparison(study, outputs, settings.PUBLISHED, folder), folder, variations)
    print((folder / "table2.csv").read_text(), end="")
    print(f"page: {folder / 'paper.html'}")


def fit_design(options: argparse.Namespace) -> None:
    """Fit numbers of a design to published metrics."""
    study = load_study(options.study or comparison.STUDY, settings.ROOT)
    source = options.targets or settings.PUBLISHED / comparison.TARGETS
    targets = calibrate.read_targets(source, study)
    parameter_file = options.parameters or settings.PUBLISHED / comparison.PARAMETERS
    parameters = calibrate.read_parameters(parameter_file, study.design)
    fit = calibrate.calibrate(study, targets, parameters, study.metrics.confidence)
    folder = settings.RUNS / "calibrate" / study.name
    calibrate.write(fit, targets, source.name, folder)
    for name in ("fit.csv", "targets.csv"):
        print((folder / name).read_text(), end="")
    print(f"singular values: {', '.join(f'{value:.3g}' for value in fit.fit.singular_values)}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    if not fit.misses_targets:
        print(f"design: {folder / 'design.toml'}")


def verify_mechanics(options: argparse.Namespace) -> None:
    """Hold the mechanics against exact answers and independent solvers."""
    folder = settings.RUNS / "verify"
    if options.study:
        study = load_study(options.study, settings.ROOT)
        failures = verify.verify_study(study, folder / f"{study.name}.csv")
    else:
        failures = verify.verify(options.mesh, settings.ROOT, folder / "results.csv")
    if failures:
        print(f"{failures} rows failed", file=sys.stderr)
        raise SystemExit(1)


def export_deck(options: argparse.Namespace) -> None:
    """Write a sample as an input deck of CalculiX."""
    study = known_size(load_study(options.study, settings.ROOT))
    check_sample(study, options.sample)
    crank = study.cycle.crank_deg[0] if options.crank is None else options.crank
    print(export(study, options.sample, crank, settings.RUNS / study.name / "calculix"))

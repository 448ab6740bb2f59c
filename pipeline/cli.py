"""The command line: runs stages of a study, says why one is stale, solves one unit, and cleans up."""

import argparse
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.checks import calibrate
from pipeline.checks.paper import comparison
from pipeline.config import Study, load_study, load_unit
from pipeline.engine.parallel import ChunkError, dask_cluster
from pipeline.engine.runner import Resources, run, why
from pipeline.engine.stage import Job
from pipeline.engine.store import Cache, Output, write_atomic
from pipeline.errors import InputError
from stages import hysteresis
from stages.aggregate import METRIC_COLUMNS
from stages.chain import STAGES

ROOT = Path(__file__).parent.parent
RUNS = ROOT / "data" / "runs"
PUBLISHED = ROOT / "data" / "published"
COARSE = "quick"
"""Study whose coarse mesh CalculiX solves in seconds."""
ALL_WORKERS = -1
"""Joblib's number of processes for as many as the cluster has."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 for a mistake of the user's, 1 for a failure of ours."""
    options = _parser().parse_args(arguments)
    try:
        options.command(options)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except ChunkError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from the finished chunks", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m pipeline", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, action, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(command=action)
        return sub

    def study_option(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("--study", default="paper", help="study file, or the stem of one in data/studies")

    def jobs_option(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("--jobs", type=int, help="processes; default: the study's")
        sub.add_argument("--backend", choices=("loky", "dask"), default="loky", help="this machine, or a Dask cluster")
        sub.add_argument("--scheduler", help="address of the cluster's scheduler, as in tcp://192.0.2.1:8786")

    running = command("run", _run, "run stages, and whatever they depend on that is missing or stale")
    running.add_argument("stage", nargs="*", default=[STAGES[-1].name], help=", ".join(s.name for s in STAGES))
    study_option(running)
    jobs_option(running)

    asking = command("why", _why, "say which input, setting or source makes a stage stale")
    asking.add_argument("stage")
    study_option(asking)

    single = command("unit", _unit, "solve one reducer with as-measured dimensions")
    single.add_argument("design", help="design file, or the stem of one in data/designs")
    single.add_argument("--dimensions", required=True, type=Path, help="TOML file of measured errors in micrometres")
    study_option(single)
    jobs_option(single)

    resolving = command("resolve", _resolve, "write the contact forces of any sample of a run")
    resolving.add_argument("study", help="study file, or the stem of one in data/studies")
    resolving.add_argument("--sample", required=True, type=int)
    jobs_option(resolving)

    measuring = command("bench", _bench, "measure the speed of a study's hot parts")
    study_option(measuring)

    papering = command("paper", _paper, "hold the paper's Table 2, contacts and figures against the model")
    jobs_option(papering)

    fitting = command("calibrate", _calibrate, "fit numbers of a study's design to published metrics of its cases")
    fitting.add_argument("--study", default=comparison.STUDY, help="study of cases, or its stem in data/studies")
    for name, stem, what in (
        ("--targets", comparison.TARGETS, "CSV of published metrics"),
        ("--parameters", comparison.FITTED, "CSV of fitted numbers: key, lower, upper"),
    ):
        fitting.add_argument(name, type=Path, default=PUBLISHED / stem, help=what)

    verifying = command("verify", _verify, "hold the mechanics against exact answers and independent solvers")
    verifying.add_argument("--mesh", choices=("coarse", "paper"), default="paper", help="default: paper")

    exporting = command("export-ccx", _export_ccx, "write a sample of a study as an input deck of CalculiX")
    exporting.add_argument("study", help="study file, or the stem of one in data/studies")
    exporting.add_argument("--sample", required=True, type=int)
    exporting.add_argument("--crank", type=float, metavar="DEG", help="crank angle; default: the study's first")

    command("clean-runs", _clean_runs, "forget all runs, never inputs")
    return parser


@contextmanager
def _resources(study: Study, options: argparse.Namespace) -> Iterator[Resources]:
    """Where and with how many processes chunks are solved; a cluster is connected while the context lasts."""
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs}; must be at least 1")
    if (options.backend == "dask") != (options.scheduler is not None):
        raise InputError("--backend dask and --scheduler ADDRESS go together; give both or neither")
    if options.backend == "dask":
        with dask_cluster(options.scheduler) as cluster:
            yield Resources(options.jobs or ALL_WORKERS, study.run.chunk, cluster)
    else:
        yield Resources(options.jobs or study.run.jobs, study.run.chunk)


def _run(options: argparse.Namespace) -> None:
    study = load_study(options.study, ROOT)
    with _resources(study, options) as resources:
        run(STAGES, study, options.stage, RUNS, resources)
    report = RUNS / study.name / "report" / "report.html"
    if STAGES[-1].name in options.stage:
        print(f"report: {report.relative_to(Path.cwd()) if report.is_relative_to(Path.cwd()) else report}")


def _why(options: argparse.Namespace) -> None:
    for reason in why(STAGES, load_study(options.study, ROOT), options.stage, RUNS):
        print(reason)


def _unit(options: argparse.Namespace) -> None:
    study = load_unit(options.dimensions, options.design, options.study, ROOT)
    with _resources(study, options) as resources:
        outputs = run(STAGES, study, ["report"], RUNS, resources)
    metrics = pd.DataFrame(outputs["aggregate"].read("metrics"))
    shown = metrics.loc[metrics["sample"] == 1, ["crank_deg", *METRIC_COLUMNS, "status"]]
    print(shown.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
    print(f"tables and report: {RUNS / study.name}")


def _check_sample(study: Study, sample: int) -> None:
    if not 0 <= sample < study.samples.rows:
        raise InputError(f"--sample = {sample}; study {study.name} has samples 0 to {study.samples.rows - 1}")


def _resolve(options: argparse.Namespace) -> None:
    study = load_study(options.study, ROOT)
    sample = options.sample
    if not 0 <= sample < study.samples.rows:
        raise InputError(f"--sample = {sample}; study {study.name} has samples 0 to {study.samples.rows - 1}")
    with _resources(study, options) as resources:
        outputs = run(STAGES, study, ["hysteresis"], RUNS, resources)
    path = RUNS / study.name / "resolved" / f"contacts-{sample}.parquet"
    path.parent.mkdir(exist_ok=True)
    write_atomic(path, hysteresis.CONTACTS.part(_resolved(study, sample, outputs)).data)
    print(f"contacts of sample {sample}: {path}")


def _resolved(study: Study, sample: int, outputs: dict[str, Output]) -> dict[str, np.ndarray]:
    """Rows of the contacts of one sample of a finished run."""
    shared = hysteresis.prepare(Job(study, 1, RUNS, outputs, Cache(RUNS / ".cache", "")))
    rows = outputs["clearance"].read_items("gaps", sample, sample + 1)
    gap_um = rows["clearance_um"].reshape(1, len(study.cycle.crank_deg), -1)
    loose = outputs["sample"].read_items("reducer", sample, sample + 1)["bearing_clearance_um"]
    solved = hysteresis.solve_samples(shared, gap_um, loose)
    return hysteresis.contact_rows(shared, np.array([sample]), gap_um, solved)


def _bench(options: argparse.Namespace) -> None:
    from pipeline.checks import bench  # slow to import

    study = load_study(options.study, ROOT)
    RUNS.mkdir(parents=True, exist_ok=True)
    results = []
    for result in bench.bench(study, load_study(COARSE, ROOT), RUNS):
        results.append(result)
        print(
            f"{result.name:34}{result.value:12.4g} {result.unit:4}{result.samples:7} samples  {result.note}", flush=True
        )
    bench.write(results, RUNS / "bench")
    print(f"table: {RUNS / 'bench' / 'bench.csv'}")


def _paper(options: argparse.Namespace) -> None:
    study = load_study(comparison.STUDY, ROOT)
    with _resources(study, options) as resources:
        outputs = run(STAGES, study, ["aggregate"], RUNS, resources)
    folder = RUNS / study.name
    comparison.write(comparison.compared(study, outputs, PUBLISHED, folder), folder)
    print((folder / "table2.csv").read_text(), end="")
    print(f"page: {folder / 'paper.html'}")


def _calibrate(options: argparse.Namespace) -> None:
    study = load_study(options.study, ROOT)
    targets = calibrate.read_targets(options.targets, study)
    parameters = calibrate.read_parameters(options.parameters, study.design)
    fit = calibrate.calibrated(study, targets, parameters, study.metrics.confidence)
    folder = RUNS / "calibrate" / study.name
    calibrate.write(fit, targets, options.targets.name, folder)
    for name in ("fit.csv", "targets.csv"):
        print((folder / name).read_text(), end="")
    print(f"singular values: {', '.join(f'{value:.3g}' for value in fit.fit.singular_values)}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    print(f"design: {folder / 'design.toml'}")


def _verify(options: argparse.Namespace) -> None:
    from pipeline.checks import verify  # slow to import

    failed = verify.verify(options.mesh, ROOT, RUNS / "verify" / "results.csv")
    if failed:
        print(f"{failed} rows failed", file=sys.stderr)
        raise SystemExit(1)


def _export_ccx(options: argparse.Namespace) -> None:
    from pipeline.checks.calculix import export  # slow to import

    study = load_study(options.study, ROOT)
    _check_sample(study, options.sample)
    crank = study.cycle.crank_deg[0] if options.crank is None else options.crank
    print(export(study, options.sample, crank, RUNS / study.name / "calculix"))


def _clean_runs(_: argparse.Namespace) -> None:
    shutil.rmtree(RUNS, ignore_errors=True)
    print(f"removed {RUNS}")

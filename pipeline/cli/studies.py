"""Commands on studies: run stages, say why one is stale, solve one unit, write contact forces, clean up."""

import argparse
import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.cli import settings
from pipeline.config import Study, load_study, load_unit
from pipeline.engine.cache import Cache
from pipeline.engine.runner import damages, run, why
from pipeline.engine.stage import Job
from pipeline.engine.store import Output, write_atomic
from stages import hysteresis
from stages.aggregate import METRIC_COLUMNS
from stages.chain import STAGES


def add(command: settings.Commands) -> None:
    """Add the commands."""
    running = command("run", _run, "run stages, and whatever they depend on that is missing or stale")
    running.add_argument("stage", nargs="*", default=[STAGES[-1].name], help=", ".join(s.name for s in STAGES))
    settings.study_option(running)
    settings.jobs_option(running)

    asking = command("why", _why, "say which input, setting or source makes a stage stale")
    asking.add_argument("stage")
    settings.study_option(asking)

    single = command("unit", _unit, "solve one reducer with as-measured dimensions")
    single.add_argument("design", help="design file, or the stem of one in data/designs")
    single.add_argument("--dimensions", required=True, type=Path, help="TOML file of measured errors in micrometres")
    settings.study_option(single)
    settings.jobs_option(single)

    resolving = command("resolve", _resolve, "write the contact forces of any sample of a run")
    resolving.add_argument("study", help="study file, or the stem of one in data/studies")
    resolving.add_argument("--sample", required=True, type=int)
    settings.jobs_option(resolving)

    checking = command("check", _check, "compare every byte of a run with its records, and say what to run again")
    checking.add_argument("run", help="folder of a run, or the name of one in data/runs")

    command("clean-runs", _clean_runs, "forget all runs, never inputs")


def _run(options: argparse.Namespace) -> None:
    study = load_study(options.study, settings.ROOT)
    with settings.resources(study, options) as resources:
        run(STAGES, study, options.stage, settings.RUNS, resources)
    report = settings.RUNS / study.name / "report" / "report.html"
    if STAGES[-1].name in options.stage:
        print(f"report: {settings.shown(report)}")


def _why(options: argparse.Namespace) -> None:
    for reason in why(STAGES, load_study(options.study, settings.ROOT), options.stage, settings.RUNS):
        print(reason)


def _unit(options: argparse.Namespace) -> None:
    study = load_unit(options.dimensions, options.design, options.study, settings.ROOT)
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["report"], settings.RUNS, resources)
    metrics = pd.DataFrame(outputs["aggregate"].read("metrics"))
    shown = metrics.loc[metrics["sample"] == 1, ["crank_deg", *METRIC_COLUMNS, "status"]]
    print(shown.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
    print(f"tables and report: {settings.RUNS / study.name}")


def _resolve(options: argparse.Namespace) -> None:
    study = load_study(options.study, settings.ROOT)
    sample = options.sample
    settings.check_sample(study, sample)
    with settings.resources(study, options) as resources:
        outputs = run(STAGES, study, ["hysteresis"], settings.RUNS, resources)
    path = settings.RUNS / study.name / "resolved" / f"contacts-{sample}.parquet"
    path.parent.mkdir(exist_ok=True)
    write_atomic(path, hysteresis.CONTACTS.part(_resolved(study, sample, outputs)).data)
    print(f"contacts of sample {sample}: {path}")


def _resolved(study: Study, sample: int, outputs: dict[str, Output]) -> dict[str, np.ndarray]:
    """Rows of the contacts of one sample of a finished run."""
    shared = hysteresis.prepare(Job(study, 1, settings.RUNS, outputs, Cache(settings.RUNS / ".cache", "")))
    rows = outputs["clearance"].read_items("gaps", sample, sample + 1)
    gap_um = rows["clearance_um"].reshape(1, len(study.cycle.crank_deg), -1)
    loose = outputs["sample"].read_items("reducer", sample, sample + 1)["bearing_clearance_um"]
    solved = hysteresis.solve_samples(shared, gap_um, loose)
    return hysteresis.contact_rows(shared, np.array([sample]), gap_um, solved)


def _check(options: argparse.Namespace) -> None:
    folder = Path(options.run) if Path(options.run).is_dir() else settings.RUNS / options.run
    found = damages(folder)
    for damage in found:
        print(f"{folder / damage.stage / damage.name}: damaged or missing; removed")
    if found:
        stages = " ".join(dict.fromkeys(damage.stage for damage in found))
        print(f"run again: python -m pipeline run {stages} --study {folder.name}")
        raise SystemExit(1)
    print(f"{settings.shown(folder)}: every file is what was written")


def _clean_runs(_: argparse.Namespace) -> None:
    shutil.rmtree(settings.RUNS, ignore_errors=True)
    print(f"removed {settings.RUNS}")

"""Commands on studies: run stages, say why one is stale, solve one unit, write contact forces, clean up."""

import argparse
import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import settings
from pipeline.cli.arguments import check_sample, print_answer, workers
from pipeline.cli.kept_answers import keep_answer
from pipeline.cli.parser import parser
from pipeline.config import Study, load_study, load_unit
from pipeline.config.files.table_file import READ
from pipeline.engine.cache import lock_run
from pipeline.engine.finished_run import damages, mixed_stages, set_aside
from pipeline.engine.runner import plan, why
from pipeline.engine.store import DAMAGED_SUFFIX, RECORD, Output, remove, write_atomic
from pipeline.errors import InputError
from pipeline.library.running import known_size, prepared_loops, up_to_date
from pipeline.library.studies import tails
from pipeline.model.metrics import WHOLE_TURN, library
from pipeline.registry import registered_places
from pipeline.report.results import needed_sentences, preload_warning, yield_estimate
from stages import hysteresis
from stages.chain import STAGES
from stages.sample import SAMPLED_TABLES, errors_of_columns
from stages.tables.curves import CONTACTS, contact_rows

REASONS_SHOWN = 3
"""Of a stage in the answer of a dry run."""


def run_stages(options: argparse.Namespace) -> None:
    """Run the stages wanted and say where the report is."""
    study = load_study(options.study, settings.ROOT)
    stages = options.stage or [STAGES[-1].name]
    if options.dry_run:
        print("\n".join(_plan_lines(study, stages)))
        return
    outputs = up_to_date(study, stages, workers(options)).outputs
    lines = []
    if "aggregate" in outputs:
        distributions = pd.DataFrame(outputs["aggregate"].read("distributions"))
        if warning := preload_warning(distributions):
            lines.append(f"Warning: {warning}")
    report = settings.RUNS / study.name / "report" / "report.html"
    if STAGES[-1].name in stages:
        lines.append(f"report: {settings.shown(report)}")
    print("".join(f"{line}\n" for line in lines), end="")
    if study.samples.until is None and options.backend == "loky":
        _keep(options, study.name, lines, [f"{name}  up to date" for name in outputs])
        for name in outputs:
            _keep(parser().parse_args(["why", name, "--study", options.study]), study.name, ["up to date"])
        if "aggregate" in outputs:
            _keep(parser().parse_args(["show", study.name]), study.name, _summary_lines(settings.RUNS / study.name))


def _keep(options: argparse.Namespace, run: str, output: Sequence[str], errors: Sequence[str] = ()) -> None:
    keep_answer(options, output, errors, settings.RUNS / run, READ, registered_places())


def _plan_lines(study: Study, targets: Sequence[str]) -> Iterator[str]:
    """A line for each stage: whether it would run, why, and for about how long."""
    stage_plan = plan(STAGES, known_size(study), targets, settings.RUNS)
    for stage in stage_plan:
        if not stage.reasons:
            yield f"{stage.stage}  up to date"
            continue
        seconds = "no former timing" if stage.seconds is None else f"about {stage.seconds:.3g} s"
        remainder_text = len(stage.reasons) - REASONS_SHOWN
        remainder_line = [f"and {remainder_text} more, see: why {stage.stage}"] if remainder_text > 0 else []
        yield f"{stage.stage}  would run, {seconds}: {'; '.join([*stage.reasons[:REASONS_SHOWN], *remainder_line])}"
    total = sum(stage.seconds or 0.0 for stage in stage_plan)
    untimed = sum(1 for stage in stage_plan if stage.reasons and stage.seconds is None)
    about = f"at least {total:.3g} s, and {untimed} without a former timing" if untimed else f"about {total:.3g} s"
    yield f"in all {about}, by former timings; nothing was run" if total else "nothing was run"


def show_run(options: argparse.Namespace) -> None:
    """Print the summary of a run."""
    folder = Path(options.run) if Path(options.run).is_dir() else settings.RUNS / options.run
    lines = _summary_lines(folder)
    print("\n".join(lines))
    keep_answer(options, lines, (), folder, (), registered_places())


def _summary_lines(folder: Path) -> list[str]:
    """Lines of the summary of a run."""
    outputs = {stage.name: output for stage in STAGES if (output := Output.open(folder / stage.name))}
    if "aggregate" not in outputs:
        raise InputError(f"{settings.shown(folder)}: no results; run: python -m pipeline run --study {folder.name}")
    distributions = pd.DataFrame(outputs["aggregate"].read("distributions"))
    known_statistics = outputs["aggregate"].record["settings"]
    lines = [f"Warning: {warning}" for warning in mixed_stages(folder)]
    if warning := preload_warning(distributions):
        lines.append(f"Warning: {warning}")
    lines += summary(distributions, folder.name)
    if share := yield_estimate(distributions, known_statistics["limits.over"]):
        lines += needed_sentences(share, known_statistics["metrics.confidence"])
    status = outputs["aggregate"].read("units", ["status"])["status"]
    lines.append(f"{len(status)} units, {np.count_nonzero(np.asarray(status) != 'ok')} with a remark in status")
    lines += [
        f"{name}  {output.record['started']}  {output.record['seconds']:.1f} s" for name, output in outputs.items()
    ]
    return lines


def summary(distributions: pd.DataFrame, name: str) -> Iterator[str]:
    """Lines with mean, quantiles and yield of every metric at its worst over the turn, with confidence intervals."""
    table = distributions[distributions["over"].isin(("worst", WHOLE_TURN))]
    table = table.sort_values("over", key=lambda over: over == WHOLE_TURN, kind="stable")  # the last of a cell counts
    cells = {
        (row.metric, row.statistic): (row.value, f"{row.value:.4g} ({row.ci_low:.4g} to {row.ci_high:.4g})")
        for row in table.itertuples()
    }
    angles = dict(zip(table["metric"].astype(str), table["n_angles"], strict=True))
    loss = cells.get(("hysteresis_loss_arcmin", "p99"))
    redundant = [name for name, item in library().items() if item.needs_friction and loss and loss[0] == 0]
    yield f"{name}: worst over the turn, with confidence intervals"
    for metric in dict.fromkeys(metric for metric, _ in cells if metric not in redundant):
        shown_statistics = [
            f"{statistic} {cells[metric, statistic][1]}"
            for statistic in ("mean", "p05", "p95", "yield")
            if (metric, statistic) in cells
        ]
        yield f"{metric}  {'  '.join(shown_statistics)}  ({angles[metric]} crank angles)"
    if redundant:
        yield "without friction the zero-torque width at a loaded angle is the clearance backlash; hysteresis loss 0"


def reasons(options: argparse.Namespace) -> None:
    """Print why a stage would run."""
    study = load_study(options.study, settings.ROOT)
    sentences = why(STAGES, known_size(study), options.stage, settings.RUNS)
    print("\n".join(sentences))
    if study.samples.until is None:
        _keep(options, study.name, sentences)


def solve_unit(options: argparse.Namespace) -> None:
    """Solve a unit with as-measured dimensions and print its metrics."""
    study = load_unit(options.dimensions, options.design, options.study, settings.ROOT)
    outputs = up_to_date(study, ["report"], workers(options)).outputs
    metrics = pd.DataFrame(outputs["aggregate"].read("metrics"))
    metric_rows = metrics.loc[metrics["sample"] == 1, ["crank_deg", *library(), "status"]]
    print(metric_rows.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
    print(f"tables and report: {settings.RUNS / study.name}")


def resolve_contacts(options: argparse.Namespace) -> None:
    """Write the contact forces of one sample."""
    study = known_size(load_study(options.study, settings.ROOT))
    sample = options.sample
    check_sample(study, sample)
    outputs = up_to_date(study, ["hysteresis"], workers(options)).outputs
    path = settings.RUNS / study.name / "resolved" / f"contacts-{sample}.parquet"
    path.parent.mkdir(exist_ok=True)
    write_atomic(path, CONTACTS.part(_contact_rows(study, sample, outputs)).data)
    print(f"contacts of sample {sample}: {path}")


def _contact_rows(study: Study, sample: int, outputs: dict[str, Output]) -> dict[str, np.ndarray]:
    """Rows of the contacts of one sample of a finished run."""
    loop_inputs = prepared_loops(study, outputs)
    tables = {name: outputs["sample"].read_items(name, sample, sample + 1) for name in SAMPLED_TABLES}
    solution = hysteresis.solve_samples(loop_inputs, errors_of_columns(tables))
    curves = [loop for loop in solution if loop.crank_deg in study.cycle.curve_crank_deg]
    return contact_rows(np.array([sample]), curves)


def check_run(options: argparse.Namespace) -> None:
    """Compare every byte of a run, and the set of its files, with its records."""
    folder = Path(options.run) if Path(options.run).is_dir() else settings.RUNS / options.run
    file_damages = damages(folder)
    for damage in file_damages:
        print(f"{folder / damage.stage / damage.name}: {damage.fault}")
    if file_damages:
        foreign = {damage.stage for damage in file_damages if (damage.name, damage.fault) == (RECORD, "extra")}
        for stage in sorted(foreign):
            print(f"{folder / stage}: no stage of this run; move the folder away")
        if set_aside(folder, file_damages):
            print(f"set aside in {settings.shown(folder / DAMAGED_SUFFIX)} what is altered or extra")
        if stages := dict.fromkeys(damage.stage or "report" for damage in file_damages if damage.stage not in foreign):
            print(f"run again: python -m pipeline run {' '.join(stages)} --study {folder.name}")
        raise SystemExit(1)
    print(f"{settings.shown(folder)}: every file is what was written")


def clean_runs(_: argparse.Namespace) -> None:
    """Remove all runs, and say what could not be removed.

    Raises
    ------
    InputError
        If another process writes one of them: nothing is removed then.
    """
    folders = [path for path in sorted(settings.RUNS.glob("*")) if path.is_dir() and not path.is_symlink()]
    with contextlib.ExitStack() as locks:
        for folder in folders:
            if not folder.name.startswith("."):
                locks.enter_context(lock_run(folder))
        problems = [problem for path in sorted(settings.RUNS.glob("*")) for problem in _remove_run(path)]
    if problems:
        raise InputError(problems)
    print(f"removed all runs in {settings.RUNS}")


def _remove_run(path: Path) -> list[str]:
    """Remove a run; what of it is still there, and why."""
    try:
        remove(path)
    except OSError as error:
        culprit = Path(error.filename or path)  # whole from Python 3.13 on, before it by its own name
        name = "" if culprit == path else f"{culprit.relative_to(path) if culprit.is_relative_to(path) else culprit}: "
        return [f"{path}: not removed: {name}{error.strerror}; remove it yourself, then run this again"]
    return []


def find_tails(options: argparse.Namespace) -> None:
    """Write shares beyond the limits and far quantiles of a study."""
    print_answer(tails(options.study, options.units, options.solve, workers(options)))

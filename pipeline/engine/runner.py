"""Running stages: what a target depends on, if it is missing or stale, and nothing else; and why a stage is stale."""

import difflib
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from pipeline.engine import progress
from pipeline.engine.cache import Cache, lock_run
from pipeline.engine.cluster import solved_on_cluster
from pipeline.engine.fingerprint import (
    Fingerprint,
    fingerprint,
    refuse_changed_sources,
    remembered_sources,
    source_hashes,
)
from pipeline.engine.parallel import Backend, parts_of, solved_chunks
from pipeline.engine.record import Manifest, valid, with_seal
from pipeline.engine.stage import Chunk, Job, Sections, Stage
from pipeline.engine.store import (
    DAMAGED_SUFFIX,
    MANIFEST,
    Output,
    content_hashes,
    make_way,
    name_path_in_errors,
    read_json,
    write_json,
)
from pipeline.engine.work import Work, expected_seconds
from pipeline.errors import InputError

SOURCES = "sources.json"
"""In the cache: what the sources do, as far as a run has read them."""


@dataclass(frozen=True)
class Resources:
    """What a run may use; none of it changes a value: processes, items a chunk, and where chunks are solved."""

    jobs: int
    chunk: int
    backend: Backend = Backend()


def run(
    stages: Sequence[Stage], study: Any, targets: Sequence[str], runs: Path, resources: Resources
) -> dict[str, Output]:
    """Bring the targets up to date.

    Parameters
    ----------
    stages : sequence of Stage
        All stages, upstream ones first.
    study : object
        The validated study; its `name` names the run.
    targets : sequence of str
        Stages wanted.
    runs : Path
        Folder of all runs.
    resources : Resources
        Processes, chunk size, backend.

    Returns
    -------
    dict of str to Output
        The targets and all that they depend on.

    Raises
    ------
    InputError
        If a target is unknown, another process writes the run, a file is damaged, or a source changes meanwhile.
    ChunkError
        If a body fails on a chunk.
    """
    outputs: dict[str, Output] = {}
    stages_to_run = needed_stages(stages, targets)
    with lock_run(runs / study.name), remembered_sources(runs / ".cache" / SOURCES):
        sources = {stage.name: source_hashes(stage.module) for stage in stages_to_run}
        for stage in stages_to_run:
            inputs = {name: outputs[name] for name in stage.reads}
            refuse_changed_sources(stage, sources[stage.name])
            current = fingerprint(stage, study, content_hashes(inputs))
            output = Output.open(runs / study.name / stage.name)
            if output is not None:
                _set_aside_extra(output)
            if output is not None and not _reasons(output, current):
                progress.say(stage.name, "up to date")
            else:
                output = _execute(stage, study, current, inputs, runs, resources)
            outputs[stage.name] = output
            _note_seal(runs / study.name / MANIFEST, stage.name, output)
    progress.resume_command()
    return outputs


def _set_aside_extra(output: Output) -> None:
    for name in output.extra():
        output.set_aside(name)
        progress.say(output.folder.name, f"{name} was not written by this run; set aside in {DAMAGED_SUFFIX}")


def _note_seal(path: Path, stage: str, output: Output) -> None:
    """Write the seal of a stage's record into the manifest of its run."""
    content = valid(read_json(path), Manifest)
    stages = content["stages"] if content else {}
    if stages.get(stage) != output.record["seal"]:
        make_way(path)
        write_json(path, with_seal({"stages": {**stages, stage: output.record["seal"]}}))


def why(stages: Sequence[Stage], study: Any, target: str, runs: Path) -> list[str]:
    """Reasons for which a target would run, as plain sentences; "up to date" if it would not.

    Reasons of a stage upstream come first and name it. It runs first, and if its tables come out equal, the target does
    not run.

    Raises
    ------
    InputError
        If the target is unknown.
    """
    sentences: list[str] = []
    for stage, reasons in _staleness(stages, study, [target], runs):
        sentences += reasons if stage.name == target else [f"{stage.name} runs first: {text}" for text in reasons]
    return sentences or ["up to date"]


@dataclass(frozen=True)
class Planned:
    """What a stage would do.

    Attributes
    ----------
    reasons : for which it would run; none if it would not.
    seconds : expected time by the latest run whose record is at hand, else by the calibrated time of a unit; None
        without both.
    """

    stage: str
    reasons: tuple[str, ...]
    seconds: float | None


def plan(stages: Sequence[Stage], study: Any, targets: Sequence[str], runs: Path) -> list[Planned]:
    """What bringing the targets up to date would run, why, and how long it took before; nothing is run or written.

    A stage behind one that runs is planned too; it is passed over if the tables that it reads come out equal.

    Raises
    ------
    InputError
        If a target is unknown.
    """
    results: list[Planned] = []
    running: set[str] = set()
    for stage, reasons in _staleness(stages, study, targets, runs):
        upstream = [name for name in stage.reads if name in running]
        if not reasons and upstream:
            reasons = [f"{', '.join(upstream)} may come out different"]
        if reasons:
            running.add(stage.name)
        results.append(Planned(stage.name, tuple(reasons), expected_seconds(stage, study, runs) if reasons else None))
    return results


def _staleness(
    stages: Sequence[Stage], study: Any, targets: Sequence[str], runs: Path
) -> Iterator[tuple[Stage, list[str]]]:
    """Every stage that the targets depend on, upstream first, and why it would run by itself."""
    outputs: dict[str, Output] = {}
    for stage in needed_stages(stages, targets):
        output = Output.open(runs / study.name / stage.name)
        if output is None:
            yield stage, ["never run"]
            continue
        available = {name: outputs[name] for name in stage.reads if name in outputs}
        missing_inputs = {
            name: digest for name, digest in output.record["inputs"].items() if name.split("/")[0] not in available
        }
        outputs[stage.name] = output
        yield stage, _reasons(output, fingerprint(stage, study, content_hashes(available) | missing_inputs))


def needed_stages(stages: Sequence[Stage], targets: Sequence[str]) -> list[Stage]:
    """The targets and what they depend on, upstream first.

    Raises
    ------
    InputError
        If a target is unknown.
    """
    names = [stage.name for stage in stages]
    unknown_names = [target for target in targets if target not in names]
    if unknown_names:
        raise InputError(
            f"stage {name} is unknown; stages are {', '.join(names)}{_hint(name, names)}" for name in unknown_names
        )
    needed_names = set(targets)
    for stage in reversed(stages):
        if stage.name in needed_names:
            needed_names |= set(stage.reads)
    return [stage for stage in stages if stage.name in needed_names]


def _hint(name: str, names: Sequence[str]) -> str:
    matches = difflib.get_close_matches(name, names, 1)
    return f"; did you mean {matches[0]}?" if matches else ""


def _reasons(output: Output, current: Fingerprint) -> list[str]:
    changes = [] if output.record["key"] == current.key else current.changes_since(output.record)
    return changes + output.faults()


def _execute(
    stage: Stage, study: Any, current: Fingerprint, inputs: Mapping[str, Output], runs: Path, resources: Resources
) -> Output:
    """Run a stage and publish its output."""
    progress.announce(stage.name, expected_seconds(stage, study, runs))
    start_time = datetime.now(UTC).isoformat(timespec="seconds")
    # one BLAS thread: more would spin beside the other processes, and move last digits
    with progress.Meter() as meter, name_path_in_errors(runs / study.name / stage.name), threadpool_limits(1):
        state = {"key": current.key, "chunk": resources.chunk} if stage.solve else None
        work = Work(runs / study.name, stage.name, state)
        sections = Sections(study, (*stage.sections, "name"))
        confirm = partial(refuse_changed_sources, stage, current.sources)
        job = Job(sections, resources.jobs, work.output, inputs, Cache(runs / ".cache", current.code, confirm))
        counts = (
            _solve_chunks(stage, job, work, resources, current.code) if stage.solve else _run_whole(stage, job, work)
        )
        confirm()
        contents = work.contents(stage.tables)
    if not stage.solve:
        rows, files = sum(table["rows"] for table in contents["tables"].values()), len(contents["files"])
        progress.say(stage.name, f"{rows} rows" if stage.tables else f"{files} files", f"{meter.seconds:.1f} s")
    record = {
        "stage": stage.name,
        "status": "complete",
        "key": current.key,
        "settings": current.settings,
        "inputs": current.inputs,
        "packages": current.packages,
        "sources": current.sources,
        **counts,
        **contents,
        "started": start_time,
        "seconds": round(meter.seconds, 3),
        "peak_memory_bytes": meter.peak_bytes,
        "host": {"cores": os.cpu_count(), "machine": platform.machine(), "system": platform.platform()},
        "jobs": resources.jobs,
        "backend": resources.backend.name,
    }
    return work.publish(record)


def _run_whole(stage: Stage, job: Job, work: Work) -> dict[str, int]:
    assert stage.run is not None
    contracts, tables = {table.name: table for table in stage.tables}, stage.run(job)
    blocks = {name: columns for name, columns in tables.items() if isinstance(columns, Iterator)}
    whole_tables = {name: columns for name, columns in tables.items() if not isinstance(columns, Iterator)}
    total = parts_of(stage, whole_tables | {name: contracts[name].empty() for name in blocks if name in contracts})
    work.write_whole({name: part for name, part in total.items() if name in whole_tables})
    for name, columns in blocks.items():
        for block in columns:
            work.write_block(name, contracts[name].part(block))
    return {}


def _equal_chunks(total: int, size: int) -> list[tuple[int, int]]:
    """Bounds of as few chunks as have at most ``size`` items, alike but for one item: all processes end together."""
    count = -(-total // size)
    return [(total * k // count, total * (k + 1) // count) for k in range(count)]


def _solve_chunks(stage: Stage, job: Job, work: Work, resources: Resources, code: str) -> dict[str, int]:
    assert stage.items is not None
    assert stage.prepare is not None
    total = stage.items(job)
    bounds = _equal_chunks(total, resources.chunk * stage.chunk_factor)
    work.keep(bounds)
    waiting_chunks = [bound for bound in bounds if bound[0] not in work.finished_chunks]
    reads = {name: name.partition("/") for name in stage.chunk_reads}

    def read(start: int, stop: int) -> Chunk:
        tables = {name: job.inputs[source].read_items(table, start, stop) for name, (source, _, table) in reads.items()}
        return Chunk(start, stop, tables)

    with progress.Line(stage.name, stage.unit, total) as line:
        for start, stop in set(bounds) - set(waiting_chunks):
            line.advance(stop - start, work.finished_chunks[start]["failed"])
        shared_value = stage.prepare(job)  # even where no chunk is left: it writes files too
        if waiting_chunks and resources.backend.name == "dask":
            solved_parts = solved_on_cluster(stage, shared_value, waiting_chunks, read, code)
        else:
            solved_parts = solved_chunks(
                stage, shared_value, waiting_chunks, read, work.folder, resources.jobs, resources.backend
            )
        with closing(solved_parts) as results:
            for part in results:
                work.write_chunk(part.start, part.stop, part.parts, part.failed_items)
                line.advance(part.stop - part.start, part.failed_items)
    return {"items": total, "failed": line.failed_items, "chunk": resources.chunk}

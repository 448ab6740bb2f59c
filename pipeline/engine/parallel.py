"""Chunks on any joblib backend: what crosses to a worker and back, how much is in flight, what an error says.

A worker gets the stage, its chunk's input rows and a handle of what all chunks share, and returns Parquet bytes: no
shared file system is needed, and compression runs in parallel. On one machine every chunk runs the same function with
one BLAS thread, for any number of processes; workers elsewhere are started by their owner, who sets the same. A worker
ends with the process that started it, however that ended.
"""

import os
import platform
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import joblib
from joblib.externals.loky import reusable_executor
from threadpoolctl import threadpool_limits

from pipeline.engine.fingerprint import code_of, package_versions, source_hashes
from pipeline.engine.stage import Chunk, Stage, Tables
from pipeline.engine.store import sha256_of
from pipeline.engine.table import ITEM, Part
from pipeline.errors import ChunkError, InputError

Answer = TypeVar("Answer")

WATCH = 0.2
"""Seconds between two looks at the parent: what is solved after that is gone is lost."""


def end_with_parent(parent: int) -> None:
    """End this process when its parent is no longer the process of that number.

    A worker calls it before anything else. Its number is given: a parent that is gone already would not be missed.
    """
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)


WAVE = 32
"""Chunks a process between two moments at which every result is written. Workers outrun a slow disk by no more than
that, which bounds memory; waiting for the last of a wave costs about half a chunk in 32."""


ENDED_FROM_OUTSIDE = (
    "a worker process was ended from outside, by the system perhaps for want of memory. "
    "Finished chunks are kept: the same command resumes; with smaller chunks or one job it needs less memory"
)

# joblib measures the memory of a worker after its first chunk, of whichever stage, and replaces it when it has grown by
# 300 MB. Workers serve all stages: what a later one maps, keeps and compiles is no leak, and the search of the worst
# over the turn grows to 540 MB and stays there.
warnings.filterwarnings("ignore", "A worker stopped while some jobs were given to the executor", UserWarning)


@dataclass(frozen=True)
class Backend:
    """Where chunks are solved: a joblib backend by name, or "dask", the cluster that is connected."""

    name: str = "loky"


@dataclass(frozen=True)
class SolvedChunk:
    """What a worker returns: a part of each table that has rows, and how many items failed."""

    start: int
    stop: int
    parts: Mapping[str, Part]
    failed_items: int


@dataclass(frozen=True)
class Value:
    """Handle of the shared value, itself."""

    value: Any

    def load(self) -> Any:
        """The value."""
        return self.value


@dataclass(frozen=True)
class Dumped:
    """Handle of the shared value in a file, by its hash: mapped once a process however many chunks it solves.

    A file that is not what was written is never unpickled.
    """

    path: Path
    key: str

    def load(self) -> Any:
        """The value; its arrays are writable (private) maps, so that compiled code sees the same types in a worker.

        Raises
        ------
        InputError
            If the file is not what was written.
        """
        if self.key not in _LOADED_VALUES:
            if sha256_of(self.path) != self.key:
                raise InputError(f"{self.path}: not what was written; run the same command again")
            _LOADED_VALUES.clear()  # a worker serves one stage after the other
            _LOADED_VALUES[self.key] = joblib.load(self.path, mmap_mode="c")
        return _LOADED_VALUES[self.key]


_LOADED_VALUES: dict[str, Any] = {}


def solve_chunk(stage: Stage, shared_value: Value | Dumped, chunk: Chunk) -> SolvedChunk:
    """Solve one chunk; runs in a worker.

    Raises
    ------
    ChunkError
        If the body fails or returns other tables than its contract; the cause is chained.
    InputError
        As raised by the body.
    """
    try:
        assert stage.solve is not None
        tables = stage.solve(shared_value.load(), chunk)
        parts = {name: part for name, part in parts_of(stage, tables).items() if part.rows}
        _check_items(stage, parts, chunk)
        return SolvedChunk(chunk.start, chunk.stop, parts, stage.failures(tables) if stage.failures else 0)
    except InputError:
        raise
    except Exception as error:
        raise ChunkError(
            f"{stage.name}: {stage.unit} {chunk.start} to {chunk.stop - 1} failed: {type(error).__name__}: {error}. "
            "Finished chunks are kept: the same command with one job goes on with the unfinished ones, in this process"
        ) from error


def try_chunk(stage: Stage, shared_value: Value | Dumped, chunk: Chunk, code: str = "") -> SolvedChunk | Exception:
    """As `solve_chunk`, with an error as a value: raised, it would end the other workers and lose their results.

    `code` is that of the process which asks: a worker elsewhere that has another refuses.
    """
    try:
        if code and code != code_of(source_hashes(stage.module), package_versions()):
            raise InputError(
                f"worker {os.getpid()} on {platform.node()}: has another version of the program, of a library or of "
                "Python; install this checkout with its constraints.txt there, and start the worker again"
            )
        return solve_chunk(stage, shared_value, chunk)
    except (ChunkError, InputError) as error:
        if error.__cause__:  # which does not cross between processes
            error.add_note("".join(traceback.format_exception(error.__cause__)))
        return error


def parts_of(stage: Stage, tables: Tables) -> dict[str, Part]:
    """What a body returned as Parquet files; raises TypeError unless it is exactly what its stage declares."""
    table_names = {table.name for table in stage.tables}
    if set(tables) != table_names:
        raise TypeError(f"stage {stage.name} returned tables {sorted(tables)}, its contract is {sorted(table_names)}")
    return {table.name: table.part(tables[table.name]) for table in stage.tables}


def _check_items(stage: Stage, parts: Mapping[str, Part], chunk: Chunk) -> None:
    for name in (table.name for table in stage.tables if ITEM in table.schema.names and table.name in parts):
        first_item, last_item = parts[name].first_item, parts[name].last_item
        if first_item is None or last_item is None or first_item < chunk.start or last_item >= chunk.stop:
            raise TypeError(f"table {name}: column {ITEM} must be sorted and inside the chunk")


def solved_chunks(
    stage: Stage,
    shared_value: Any,
    chunks: Sequence[tuple[int, int]],
    read: Callable[[int, int], Chunk],
    scratch: Path,
    jobs: int,
    backend: Backend,
) -> Generator[SolvedChunk]:
    """Solve chunks and yield each as it finishes, in no order.

    Parameters
    ----------
    stage, shared
        The stage, and what its `prepare` returned.
    chunks : sequence of (start, stop)
        What is to be solved.
    read : callable
        `read(start, stop)`: a chunk with its input rows; called when a worker is nearly free, not before.
    scratch : Path
        Folder for the file in which `shared_value` goes to processes of this machine.
    jobs : int
        Processes; with one (or one chunk) everything happens in this process.
    backend : Backend
        Any but "dask", whose workers ``cluster.solved_on_cluster`` asks.

    Raises
    ------
    ChunkError, InputError
        As `solve_chunk`, after the chunks that were begun have been yielded.
    """
    if not chunks:
        return
    if backend.name == "loky" and min(jobs, len(chunks)) == 1:
        with threadpool_limits(1):
            for start, stop in chunks:
                yield solve_chunk(stage, Value(shared_value), read(start, stop))
        return
    handle = _handle(shared_value, scratch, backend)
    waiting = iter(chunks)
    with _workers(jobs, backend):
        wave = WAVE * joblib.effective_n_jobs()
        while batch := list(islice(waiting, wave)):
            yield from _wave(stage, handle, batch, read)


def batches(start: int, stop: int, size: int) -> list[tuple[int, int]]:
    """Ends of the ranges of ``size`` numbers, the last one shorter, from ``start`` up to ``stop``."""
    return [(first, min(first + size, stop)) for first in range(start, stop, size)]


def worker_results(jobs: int, task: Callable[..., Answer], inputs: Iterable[tuple[Any, ...]]) -> list[Answer]:
    """What a task returns of each of its inputs, in their order, by the same workers that solve chunks.

    Raises
    ------
    ChunkError
        If a worker was ended from outside.
    """
    try:
        with _workers(jobs, Backend()):
            return list(joblib.Parallel()(joblib.delayed(task)(*values) for values in inputs))
    except BrokenExecutor as error:
        raise ChunkError(ENDED_FROM_OUTSIDE) from error


def end_idle_workers() -> None:
    """End joblib's workers of this machine, each of which keeps the memory of the largest chunk that it has solved."""
    if (executor := reusable_executor._executor) is not None:  # joblib has no other way to ask whether there are any
        executor.shutdown(wait=True)


def _workers(jobs: int, backend: Backend) -> Any:
    """Within it joblib's workers of this machine end with this process, and have one BLAS thread each."""
    options: dict[str, Any] = {}
    if backend.name == "loky":
        options = {"inner_max_num_threads": 1, "initializer": end_with_parent, "initargs": (os.getpid(),)}
    return joblib.parallel_config(backend=backend.name, n_jobs=jobs, **options)


def _wave(
    stage: Stage, handle: Value | Dumped, chunks: Iterable[tuple[int, int]], read: Callable[[int, int], Chunk]
) -> Generator[SolvedChunk]:
    errors: list[Exception] = []

    def tasks() -> Iterator[Any]:
        try:
            for start, stop in chunks:
                if errors:
                    return
                yield joblib.delayed(try_chunk)(stage, handle, read(start, stop))
        except Exception as error:  # joblib asks for tasks in a thread of its own, where an error would be lost
            errors.append(error)

    # chunks are large tasks: one a batch; their inputs are small: no detour over files
    try:
        for result in joblib.Parallel(return_as="generator_unordered", batch_size=1, max_nbytes=None)(tasks()):
            if isinstance(result, Exception):
                errors.append(result)
            else:
                yield result
    except BrokenExecutor as error:
        raise ChunkError(f"{stage.name}: {ENDED_FROM_OUTSIDE}") from error
    if errors:
        raise errors[0]


def _handle(shared_value: Any, scratch: Path, backend: Backend) -> Value | Dumped:
    """What stands for the shared value in a task."""
    if backend.name != "loky":
        return Value(shared_value)
    path = scratch / "shared.joblib"
    joblib.dump(shared_value, path)
    return Dumped(path, sha256_of(path))

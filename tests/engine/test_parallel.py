"""What is in flight, and what a worker is given."""

import os
import time
from pathlib import Path

import joblib
import numpy as np
import psutil
import pytest
from threadpoolctl import threadpool_info, threadpool_limits
from toy_study import ADD, Toy, Trouble

from pipeline.engine import parallel
from pipeline.engine.parallel import Backend, Dumped, Value, solve_chunk, solved_chunks
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Chunk, Job, Stage
from pipeline.engine.store import sha256_of
from pipeline.errors import InputError

SHARED = {"powers": np.array([1.0]), "slope": 1.0, "trouble": Trouble()}


def chunk(start: int, stop: int) -> Chunk:
    return Chunk(start, stop, {"draw/points": {"x_mm": np.arange(3.0 * (stop - start)), "side": ["plus"]}})


@pytest.mark.long
def test_inputs_are_read_when_needed_and_results_wait_for_the_reader(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(parallel, "WAVE", 3)
    read = []

    def reader(start: int, stop: int) -> Chunk:
        read.append(start)
        return chunk(start, stop)

    bounds = [(k, k + 1) for k in range(20)]
    chunks = solved_chunks(ADD, SHARED, bounds, reader, tmp_path, 2, Backend())
    starts = {next(chunks).start}
    time.sleep(0.5)
    assert len(read) <= 6  # the wave of two jobs; without it every chunk would be solved by now
    starts |= {part.start for part in chunks}
    assert starts == {start for start, _ in bounds}


def test_after_an_error_what_was_begun_is_finished_and_nothing_else_is_begun(tmp_path: Path) -> None:
    read, yielded = [], []

    def reader(start: int, stop: int) -> Chunk:
        read.append(start)
        return chunk(start, stop)

    def collect() -> None:
        trouble = SHARED | {"trouble": Trouble(seconds=0.02, fail_at=3)}
        for part in solved_chunks(ADD, trouble, [(k, k + 1) for k in range(40)], reader, tmp_path, 2, Backend()):
            yielded.append(part.start)

    with pytest.raises(parallel.ChunkError, match="samples 3 to 3 failed"):
        collect()
    assert sorted(yielded) == sorted(set(read) - {3})
    assert len(read) < 20


def test_nothing_to_do_starts_nothing(tmp_path: Path) -> None:
    assert list(solved_chunks(ADD, SHARED, [], chunk, tmp_path, 2, Backend())) == []
    assert list(tmp_path.iterdir()) == []


def test_one_job_is_solved_here_with_one_blas_thread_and_two_in_other_processes(tmp_path: Path, monkeypatch) -> None:
    threads: list[set[int]] = []

    def solved_here(*arguments):
        threads.append({pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"})
        return solve_chunk(*arguments)

    monkeypatch.setattr(parallel, "solve_chunk", solved_here)
    for jobs, expected in ((2, []), (1, [{1}, {1}])):
        with threadpool_limits(2, user_api="blas"):
            assert len(list(solved_chunks(ADD, SHARED, [(0, 2), (2, 4)], chunk, tmp_path, jobs, Backend()))) == 2
        assert threads == expected


@pytest.mark.parametrize("name", ["threading", "sequential"])
def test_any_backend_gives_the_same_parts(tmp_path: Path, name: str) -> None:
    bounds = [(0, 2), (2, 4), (4, 5)]
    by_backend = [
        {p.start: p.parts for p in solved_chunks(ADD, SHARED, bounds, chunk, tmp_path, 2, backend)}
        for backend in (Backend(), Backend(name))
    ]
    assert by_backend[0] == by_backend[1]


def test_shared_value_is_loaded_once_a_process_and_arrays_are_private(tmp_path: Path) -> None:
    path = tmp_path / "shared"
    joblib.dump({"a": np.arange(1000.0)}, path)
    key = sha256_of(path)
    first_result = Dumped(path, key).load()
    first_result["a"][0] = 5.0
    assert Dumped(path, key).load() is first_result
    assert joblib.load(path)["a"][0] == 0.0
    joblib.dump({"a": np.arange(2000.0)}, path)
    with pytest.raises(InputError, match="not what was written"):
        Dumped(path, "f" * 64).load()  # nothing is unpickled that is not verified
    assert Dumped(path, sha256_of(path)).load()["a"][0] == 0.0
    assert list(parallel._LOADED_VALUES) == [sha256_of(path)]  # a worker does not keep what earlier stages shared


def test_a_chunk_without_upstream_rows_is_an_error_that_keeps_its_cause() -> None:
    with pytest.raises(parallel.ChunkError, match="samples 0 to 0 failed: KeyError") as error:
        solve_chunk(ADD, Value(SHARED), Chunk(0, 1))
    assert isinstance(error.value.__cause__, KeyError)


def test_a_whole_stage_runs_with_one_blas_thread(tmp_path: Path) -> None:
    """Otherwise its linear algebra spins on all cores beside the other processes."""
    threads: list[int] = []

    def body(job: Job) -> dict:
        threads.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return {}

    whole = Stage("whole", (), (), (), "toy_study", run=body)
    with threadpool_limits(2, user_api="blas"):
        run([whole], Toy(), ["whole"], tmp_path, Resources(1, 10))
    assert threads
    assert set(threads) == {1}


@pytest.mark.long
def test_idle_workers_end_and_others_take_their_place() -> None:
    parallel.end_idle_workers()  # without any nothing happens

    def identities() -> set[int]:
        return set(parallel.worker_results(2, os.getpid, [()] * 8))

    first = identities()
    assert os.getpid() not in first
    parallel.end_idle_workers()
    assert not any(psutil.pid_exists(process) for process in first)
    assert identities().isdisjoint(first)
    parallel.end_idle_workers()

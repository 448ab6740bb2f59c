"""Killed again and again, out of memory, a worker lost: the tables are equal, and what was finished stays finished."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

import psutil
import pytest
from forked import forked
from toy_runs import hashes
from toy_study import STAGES, Toy, entry

from pipeline.engine.parallel import ChunkError, worker_results
from pipeline.engine.runner import Resources, run

SCRIPT = Path(__file__).with_name("toy_study.py")
CHUNKS = 20


def started(runs: Path, log: Path, chunk: int = 2, **trouble: object) -> BaseProcess:
    """The toy study with two workers, 20 chunks of a quarter of a second; what it says is in ``log.err``."""
    order = json.dumps({"seconds": 0.25, "log": str(log)} | trouble)
    resources = Resources(2, chunk)
    return forked(run, STAGES, Toy(), ["finish"], runs, resources, said=Path(f"{log}.err"), TOY_TROUBLE=order)


def finished(runs: Path) -> set[int]:
    return {int(path.stem) for path in (runs / "toy/.work/add/chunks").glob("0*.json")}


def until(runs: Path, chunks: int, process: BaseProcess) -> None:
    while len(finished(runs)) < chunks and process.is_alive():
        time.sleep(0.01)


def begun(log: Path) -> list[int]:
    return [int(line) for line in log.read_text().split()]


def ended(process: BaseProcess) -> int | None:
    """Exit status."""
    process.join()
    return process.exitcode


def of_session(leader: int) -> list[int]:
    """Processes that are left of a session."""
    left = []
    for process in psutil.pids():
        try:
            if os.getsid(process) == leader and psutil.Process(process).status() != psutil.STATUS_ZOMBIE:
                left.append(process)
        except (ProcessLookupError, psutil.NoSuchProcess):
            pass
    return left


def left_of_session(process: BaseProcess | subprocess.Popen) -> list[int]:
    """Processes of its session that are left 20 s after it was killed."""
    started_waiting = time.monotonic()
    assert process.pid is not None
    while (left := of_session(process.pid)) and time.monotonic() < started_waiting + 20:
        time.sleep(0.05)
    return left


@pytest.mark.long
def test_killed_again_and_again_it_ends_equal_and_repeats_only_what_was_in_flight(tmp_path: Path) -> None:
    log = tmp_path / "log"
    kills = 0
    for chunks in (2, 8):
        process = started(tmp_path / "runs", log)
        until(tmp_path / "runs", chunks, process)
        kills += process.is_alive()
        process.kill()
        assert left_of_session(process) == []
    assert kills == 2
    chunks_before = finished(tmp_path / "runs")
    n_begun = len(begun(log))
    assert ended(started(tmp_path / "runs", log)) == 0
    begun_after = begun(log)[n_begun:]
    assert sorted(begun_after) == sorted(set(range(0, 40, 2)) - chunks_before)
    repeated = len(begun(log)) - CHUNKS
    assert repeated <= 5 * kills  # what two workers had begun, and begin before they see that they are alone
    print(f"{kills} kills: {repeated} of {CHUNKS} chunks computed again")
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path / "runs", Resources(1, 2))) == hashes(
        run(STAGES, Toy(), ["finish"], tmp_path / "anew", Resources(1, 2))
    )


@pytest.mark.long
def test_a_worker_that_the_system_kills_loses_no_finished_chunk(tmp_path: Path) -> None:
    """As the kernel does where memory is short: SIGKILL to one worker, in the middle."""
    log = tmp_path / "log"
    process = started(tmp_path / "runs", log)
    until(tmp_path / "runs", 4, process)
    workers = [p for p in psutil.Process(process.pid).children(recursive=True) if "loky" in " ".join(p.cmdline())]
    solving = [p for p in workers if "resource_tracker" not in " ".join(p.cmdline())]
    solving[0].send_signal(signal.SIGKILL)
    assert ended(process) == 1
    assert "a worker process was ended from outside" in Path(f"{log}.err").read_text()
    chunks_before, n_begun = finished(tmp_path / "runs"), len(begun(log))
    assert len(chunks_before) >= 4
    assert ended(started(tmp_path / "runs", log)) == 0
    assert sorted(begun(log)[n_begun:]) == sorted(set(range(0, 40, 2)) - chunks_before)
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path / "runs", Resources(1, 2))) == hashes(
        run(STAGES, Toy(), ["finish"], tmp_path / "anew", Resources(1, 2))
    )


@pytest.mark.long
def test_a_worker_that_joblib_starts_anew_because_it_has_grown_is_no_news(tmp_path: Path) -> None:
    """After two chunks of six, at half of what they keep: joblib's own limit is 300 MB, looked at once a second."""
    assert ended(started(tmp_path / "runs", tmp_path / "log", 7, keeps_MB=32)) == 0
    assert "worker stopped" not in (tmp_path / "log.err").read_text()
    assert len(set(begun(tmp_path / "log.workers"))) > 2
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path / "runs", Resources(1, 2))) == hashes(
        run(STAGES, Toy(), ["finish"], tmp_path / "anew", Resources(1, 2))
    )


@pytest.mark.parametrize("moment", [0.02, pytest.param(0.3, marks=pytest.mark.attack)])
def test_a_kill_while_workers_start_leaves_no_process(tmp_path: Path, moment: float) -> None:
    """Seconds after the first chunk may be solved: processes of 200 MB that nobody ends stayed for good."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TOY_TROUBLE": '{"seconds": 0.25}'}
    command = [sys.executable, str(SCRIPT), str(tmp_path / "runs"), "3", "2"]
    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, start_new_session=True) as process:
        while len(of_session(process.pid)) < 2 and process.poll() is None:  # the first worker
            time.sleep(0.005)
        time.sleep(moment)
        process.kill()
    assert left_of_session(process) == []


def tasks() -> None:
    """Two that end and two that do not."""
    worker_results(2, time.sleep, [(0.01,), (0.01,), (600,), (600,)])


@pytest.mark.long
def test_workers_of_tasks_end_with_a_killed_process(tmp_path: Path) -> None:
    """Those of tails, forms, scales, allocations and lots did not watch it: 270 MB each stayed for good."""
    process, busy = forked(tasks), []
    while len(busy) < 2 and process.is_alive():
        time.sleep(0.05)
        children = psutil.Process(process.pid).children(recursive=True)
        busy = [child for child in children if "loky" in " ".join(child.cmdline()) and child.num_threads() > 1]
    assert len(busy) == 2
    process.kill()
    assert left_of_session(process) == []


def test_every_worker_is_one_that_ends_with_its_parent() -> None:
    """joblib's own calls start workers that nobody ends."""
    root = Path(__file__).parents[2]
    files = [path for folder in ("pipeline", "stages") for path in (root / folder).rglob("*.py")]
    assert [path.name for path in files if re.search(r"\bParallel\(", path.read_text())] == ["parallel.py"]


SPAWNED = """
import multiprocessing, sys
from functools import partial
from pathlib import Path
from toy_study import entry
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(partial(entry, Path(sys.argv[1])), [1])[0])
"""


def pooled(runs: Path, kind: str) -> None:
    """Several at once, after this process has taken locks and started workers, and once more after them."""
    answer = partial(entry, runs)
    answer(9)
    with ThreadPoolExecutor(2) if kind == "threads" else get_context(kind).Pool(2) as pool:
        (runs / "answers").write_text(" ".join([*pool.map(answer, range(3)), answer(10)]))


@pytest.mark.parametrize("kind", ["fork", "threads"])
@pytest.mark.long
def test_pools_around_the_entry_from_python_work(tmp_path: Path, kind: str) -> None:
    process = forked(pooled, tmp_path, kind)
    process.join(timeout=120)
    assert process.exitcode == 0
    answers = (tmp_path / "answers").read_text().split()
    assert (len(answers), len(set(answers))) == (4, 1)


@pytest.mark.long
def test_a_spawned_process_has_workers_of_its_own(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SCRIPT.parent), *sys.path])}
    (tmp_path / "script.py").write_text(SPAWNED)
    command = [sys.executable, str(tmp_path / "script.py"), str(tmp_path)]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert (process.returncode, process.stdout.strip()) == (0, entry(tmp_path / "here", 1)), process.stderr


@pytest.mark.parametrize("jobs", [1, 2])
def test_out_of_memory_in_a_chunk_is_named_and_the_others_stay(tmp_path: Path, monkeypatch, jobs: int) -> None:
    log = tmp_path / "log"
    monkeypatch.setenv("TOY_TROUBLE", json.dumps({"exhaust_at": 30, "log": str(log)}))
    with pytest.raises(ChunkError, match="samples 30 to 31 failed: .*MemoryError"):
        run(STAGES, Toy(), ["finish"], tmp_path / "runs", Resources(jobs, 2))
    memory_before = finished(tmp_path / "runs")
    assert memory_before >= set(range(0, 30, 2)) if jobs == 1 else len(memory_before) >= 10
    n_begun = len(begun(log))
    monkeypatch.setenv("TOY_TROUBLE", json.dumps({"log": str(log)}))
    outputs = run(STAGES, Toy(), ["finish"], tmp_path / "runs", Resources(jobs, 2))
    assert sorted(begun(log)[n_begun:]) == sorted(set(range(0, 40, 2)) - memory_before)
    assert hashes(outputs) == hashes(run(STAGES, Toy(), ["finish"], tmp_path / "anew", Resources(1, 2)))

"""A real scheduler and two worker processes on this machine, one of them killed in the middle."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from toy_study import STAGES, Toy

from pipeline.engine.parallel import dask_cluster
from pipeline.engine.runner import Resources, run
from pipeline.errors import InputError

pytest.importorskip("distributed")
ALL_WORKERS = -1


def started(module: str, *options: str) -> subprocess.Popen:
    """A process of the cluster; it finds the toy stages and the library as workers on other machines would."""
    here = Path(__file__).parent
    paths = os.pathsep.join([str(here), str(here.parent.parent)])
    command = [sys.executable, "-m", f"distributed.cli.{module}", *options]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.DEVNULL)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Address of a scheduler, and its two workers."""
    about = tmp_path / "scheduler.json"
    processes = [
        started(
            "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(about)
        )
    ]
    options = ("--scheduler-file", str(about), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    options += ("--local-directory", str(tmp_path))
    processes += [started("dask_worker", *options) for _ in range(2)]
    try:
        yield address_in(about), processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def address_in(about: Path) -> str:
    """The scheduler's address, once it has written it."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if about.exists() and about.read_text().strip():
            return json.loads(about.read_text())["address"]
        time.sleep(0.1)
    raise AssertionError("the scheduler did not start")


def test_cluster_that_loses_a_worker_gives_the_same_tables(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen]], monkeypatch: pytest.MonkeyPatch
) -> None:
    address, workers = cluster
    here = run(STAGES, Toy(), ["finish"], tmp_path / "here", Resources(jobs=1, chunk=2))
    monkeypatch.setenv("TOY_TROUBLE", '{"seconds": 0.2}')  # a chunk: two workers need two seconds
    with dask_cluster(address) as backend:
        from distributed import get_client

        get_client().wait_for_workers(2, timeout=60)
        killer = threading.Timer(1.0, workers[0].send_signal, [signal.SIGKILL])
        killer.start()
        there = run(STAGES, Toy(), ["finish"], tmp_path / "there", Resources(ALL_WORKERS, 2, backend))
        killer.join()
    assert workers[0].wait() == -signal.SIGKILL
    assert there["add"].record["seconds"] > 1.0  # so that the worker was killed in the middle
    assert {name: output.hashes for name, output in there.items()} == {
        name: output.hashes for name, output in here.items()
    }


def test_scheduler_that_does_not_answer_is_an_input_error() -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers"), dask_cluster("tcp://127.0.0.1:9"):
        pass

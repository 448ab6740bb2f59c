"""A real scheduler and two worker processes on this machine, one of them killed in the middle."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from toy_study import STAGES, Toy

from pipeline.engine import cluster as cluster_module
from pipeline.engine.cluster import _is_authenticated, dask_cluster
from pipeline.engine.runner import Resources, run
from pipeline.errors import InputError

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="no distributed")  # half a second to import
ALL_WORKERS = -1
ROOT = Path(__file__).parent.parent.parent


def started(module: str, *options: str, path: Path = Path(__file__).parent) -> subprocess.Popen:
    """A process of the cluster; it finds the toy stages (in `path`) and the library as on other machines."""
    paths = os.pathsep.join([str(path), str(ROOT)])
    command = [sys.executable, "-m", f"distributed.cli.{module}", *options]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.DEVNULL)


def worker(address_file: Path, scratch: Path, **paths: Path) -> subprocess.Popen:
    options = ("--scheduler-file", str(address_file), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    return started("dask_worker", *options, "--local-directory", str(scratch), **paths)


@pytest.fixture(scope="module")
def address_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cluster") / "scheduler.json"


@pytest.fixture(scope="module")
def cluster(address_file: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Address of a scheduler, and its two workers, of which the tests here kill one after the other."""
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(address_file))
    processes = [started("dask_scheduler", *options)]
    processes += [worker(address_file, address_file.parent) for _ in range(2)]
    try:
        yield address_in(address_file), processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def address_in(address_file: Path) -> str:
    """The scheduler's address, once it has written it."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if address_file.exists() and address_file.read_text().strip():
            return json.loads(address_file.read_text())["address"]
        time.sleep(0.1)
    raise AssertionError("the scheduler did not start")


@pytest.mark.long
def test_cluster_that_loses_a_worker_gives_the_same_tables(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen]], monkeypatch: pytest.MonkeyPatch
) -> None:
    address, workers = cluster
    local = run(STAGES, Toy(), ["finish"], tmp_path / "here", Resources(jobs=1, chunk=2))
    monkeypatch.setenv("TOY_TROUBLE", '{"seconds": 0.2}')  # a chunk: two workers need two seconds
    with dask_cluster(address) as backend:
        from distributed import get_client

        get_client().wait_for_workers(2, timeout=60)
        killer = threading.Timer(1.0, workers[0].send_signal, [signal.SIGKILL])
        killer.start()
        remote = run(STAGES, Toy(), ["finish"], tmp_path / "there", Resources(ALL_WORKERS, 2, backend))
        killer.join()
    assert workers[0].wait() == -signal.SIGKILL
    assert remote["add"].record["seconds"] > 1.0  # so that the worker was killed in the middle
    assert {name: output.hashes for name, output in remote.items()} == {
        name: output.hashes for name, output in local.items()
    }


@pytest.mark.long
def test_worker_of_another_version_of_the_code_is_refused(
    tmp_path: Path, address_file: Path, cluster: tuple[str, list[subprocess.Popen]]
) -> None:
    """A worker whose checkout has another formula joins; what it would have solved is not in any table."""
    variant = tmp_path / "other"
    variant.mkdir()
    source = (Path(__file__).parent / "toy_study.py").read_text()
    assert "slope" in source
    (variant / "toy_study.py").write_text(source.replace('shared["slope"] * total', 'shared["slope"] * total * 1.001'))
    address, workers = cluster
    third = worker(address_file, tmp_path, path=variant)
    sound = [process for process in workers if process.poll() is None]
    try:
        with dask_cluster(address) as backend:
            from distributed import get_client

            get_client().wait_for_workers(len(sound) + 1, timeout=60)
            with pytest.raises(InputError, match=f"worker {third.pid} on .*: has another version of the program"):
                run(STAGES, Toy(), ["finish"], tmp_path / "there", Resources(ALL_WORKERS, 1, backend))
            third.kill()
            third.wait()
            remote = run(STAGES, Toy(), ["finish"], tmp_path / "there", Resources(ALL_WORKERS, 1, backend))
    finally:
        third.kill()
        third.wait()
    local = run(STAGES, Toy(), ["finish"], tmp_path / "here", Resources(jobs=1, chunk=1))
    assert remote["add"].hashes == local["add"].hashes


@pytest.mark.long
def test_scheduler_without_a_worker_is_an_input_error(cluster, monkeypatch) -> None:
    address, workers = cluster
    monkeypatch.setattr("pipeline.engine.cluster.PATIENCE", 2)
    for process in workers:
        process.kill()
        process.wait()
    time.sleep(0.5)
    with pytest.raises(InputError, match="has no worker; start one"), dask_cluster(address):
        pass


@pytest.mark.parametrize(
    ("scheduler", "closed_case"),
    [
        ("tcp://127.0.0.1:8786", True),
        ("127.1.2.3:8786", True),
        ("tcp://[::1]:8786", True),
        ("localhost:8786", True),
        ("tls://192.0.2.1:8786", True),
        ("wss://example.org:8786", True),
        ("tcp://192.0.2.1:8786", False),
        ("192.0.2.1:8786", False),
        ("ws://192.0.2.1:8786", False),
        ("tcp://localhost.example.org:8786", False),
        ("tcp://0.0.0.0:8786", False),
        ("nonsense", False),
    ],
)
def test_open_scheduler_beyond_the_loopback_is_refused_unless_the_user_says_so(
    scheduler: str, closed_case: bool
) -> None:
    assert _is_authenticated(scheduler) == closed_case
    if not closed_case:
        with pytest.raises(InputError, match="authenticates nobody.* --open-scheduler"), dask_cluster(scheduler):
            pass


def test_open_scheduler_that_is_trusted_is_asked(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.engine.cluster.PATIENCE", 1)
    with (
        pytest.raises(InputError, match="no Dask scheduler answers"),
        dask_cluster("tcp://192.0.2.1:9", is_trusted=True),
    ):
        pass


def test_scheduler_that_does_not_answer_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "PATIENCE", 1)
    with pytest.raises(InputError, match="no Dask scheduler answers"), dask_cluster("tcp://127.0.0.1:9"):
        pass

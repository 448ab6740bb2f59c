"""Calls made in forks: what they write is there, and no failure is lost."""

import multiprocessing
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from pipeline.engine.processes.forked import shared_calls

FORKS = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks safely")
HERE = os.getpid()


def write_process(path: Path) -> None:
    path.write_text(str(os.getpid()))


def test_one_job_makes_every_call_in_this_process(tmp_path: Path) -> None:
    with shared_calls([partial(write_process, tmp_path / str(number)) for number in range(3)], 1):
        assert not list(tmp_path.iterdir())
    assert [(tmp_path / str(number)).read_text() for number in range(3)] == [str(HERE)] * 3


def test_nothing_to_call_is_no_mistake() -> None:
    workers_before = multiprocessing.active_children()  # of other tests
    with shared_calls([], 2):
        assert multiprocessing.active_children() == workers_before


@FORKS
def test_a_fork_writes_while_this_process_goes_on_and_all_is_written_after(tmp_path: Path) -> None:
    (told, tell), (waiting, start) = os.pipe(), os.pipe()

    def write_and_tell() -> None:
        write_process(tmp_path / "first")
        os.write(tell, b"1")

    def wait_and_write() -> None:
        os.read(waiting, 1)
        write_process(tmp_path / "second")

    with shared_calls([write_and_tell, wait_and_write, partial(write_process, tmp_path / "third")], 2):
        os.read(told, 1)
        assert (tmp_path / "first").read_text() != str(HERE)
        assert not (tmp_path / "second").exists()
        os.write(start, b"1")
    assert {path.name for path in tmp_path.iterdir()} == {"first", "second", "third"}


@FORKS
@pytest.mark.parametrize("jobs", [2, 3])
def test_each_call_is_made_once(tmp_path: Path, jobs: int) -> None:
    def append(number: int) -> None:
        time.sleep(1e-3)
        with (tmp_path / "calls").open("a") as file:
            file.write(f"{number} {os.getpid()}\n")

    with shared_calls([partial(append, number) for number in range(300)], jobs):
        pass
    lines = [line.split() for line in (tmp_path / "calls").read_text().splitlines()]
    assert sorted(int(number) for number, _ in lines) == list(range(300))
    assert len({process for _, process in lines}) == jobs


@FORKS
def test_what_fails_in_a_fork_tells_its_own_error_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    def fail_in_a_fork() -> None:
        if os.getpid() == HERE:
            (tmp_path / "missing" / "file").write_text("text")
        raise ValueError("in a fork")

    calls = [fail_in_a_fork, partial(write_process, tmp_path / "after")]
    with pytest.raises(FileNotFoundError, match="missing"), shared_calls(calls, 2):  # noqa: PT012
        while not (tmp_path / "after").exists():  # the fork goes on with the others
            time.sleep(0.01)
    assert (tmp_path / "after").read_text() != str(HERE)
    assert capfd.readouterr().err == ""


@FORKS
def test_what_a_killed_fork_owed_is_done_here(tmp_path: Path) -> None:
    def die_in_a_fork(path: Path) -> None:
        if os.getpid() != HERE:
            os.kill(os.getpid(), signal.SIGKILL)
        write_process(path)

    with shared_calls([partial(die_in_a_fork, tmp_path / str(number)) for number in range(3)], 3):
        time.sleep(0.3)
    assert [(tmp_path / str(number)).read_text() for number in range(3)] == [str(HERE)] * 3


@FORKS
def test_what_a_fork_that_never_ends_owed_is_done_here(tmp_path: Path) -> None:
    def hang_in_a_fork() -> None:
        if os.getpid() != HERE:
            time.sleep(600)
        write_process(tmp_path / "file")

    with shared_calls([hang_in_a_fork, partial(write_process, tmp_path / "other")], 2, patience=0.1):
        time.sleep(0.3)
    assert (tmp_path / "file").read_text() == str(HERE)

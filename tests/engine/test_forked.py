"""Calls made in forks: what they write is there, and no failure is lost."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from pipeline.engine.processes.forked import forked_calls

FORKS = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks safely")
HERE = os.getpid()


def write_process(path: Path) -> None:
    path.write_text(str(os.getpid()))


def test_one_job_makes_every_call_in_this_process(tmp_path: Path) -> None:
    with forked_calls(1) as call:
        for number in range(3):
            call(write_process, tmp_path / str(number))
            assert (tmp_path / str(number)).read_text() == str(HERE)


@FORKS
def test_a_fork_writes_while_this_process_goes_on_and_all_is_written_after(tmp_path: Path) -> None:
    reading, writing = os.pipe()

    def wait_and_write(path: Path) -> None:
        os.read(reading, 1)
        write_process(path)

    with forked_calls(2) as call:
        call(wait_and_write, tmp_path / "first")
        call(write_process, tmp_path / "second")
        assert not (tmp_path / "first").exists()
        assert (tmp_path / "second").read_text() == str(HERE)
        os.write(writing, b"1")
    assert (tmp_path / "first").read_text() != str(HERE)


@FORKS
def test_what_fails_in_a_fork_tells_its_own_error_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(FileNotFoundError, match="missing"), forked_calls(2) as call:  # noqa: PT012
        call((tmp_path / "missing" / "file").write_text, "text")
        call(write_process, tmp_path / "other")
    assert capfd.readouterr().err == ""


@FORKS
def test_what_a_killed_fork_owed_is_done_here(tmp_path: Path) -> None:
    def die_in_a_fork(path: Path) -> None:
        if os.getpid() != HERE:
            os.kill(os.getpid(), signal.SIGKILL)
        write_process(path)

    with forked_calls(3) as call:
        for number in range(2):
            call(die_in_a_fork, tmp_path / str(number))
    assert [(tmp_path / str(number)).read_text() for number in range(2)] == [str(HERE)] * 2


@FORKS
def test_what_a_fork_that_never_ends_owed_is_done_here(tmp_path: Path) -> None:
    def hang_in_a_fork(path: Path) -> None:
        if os.getpid() != HERE:
            time.sleep(600)
        write_process(path)

    with forked_calls(2, patience=0.1) as call:
        call(hang_in_a_fork, tmp_path / "file")
    assert (tmp_path / "file").read_text() == str(HERE)

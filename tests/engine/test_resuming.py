"""What is kept of a run that fails, is interrupted or killed, whose files are damaged or that another holds."""

import json
import os
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from toy_runs import ONE, hashes, ran
from toy_study import DRAW, STAGES, Numbers, Toy

from pipeline.engine.cache import lock_run
from pipeline.engine.parallel import ChunkError
from pipeline.engine.runner import Resources, run, why
from pipeline.engine.stage import Job
from pipeline.errors import InputError


@pytest.fixture
def trouble(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Order trouble in the solves; returns a function that says which chunks were begun since the last order."""

    def order(**keywords: object):
        log = tmp_path / f"log-{time.monotonic_ns()}"
        log.touch()
        monkeypatch.setenv("TOY_TROUBLE", json.dumps(keywords | {"log": str(log)}))
        return lambda: sorted(int(line) for line in log.read_text().split())

    return order


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.long
def test_a_failing_chunk_is_named_and_the_others_are_kept(tmp_path: Path, trouble, jobs: int) -> None:
    trouble(fail_at=23)
    with pytest.raises(
        ChunkError, match="add: samples 20 to 29 failed: ValueError: cannot add sample 23.*one job"
    ) as error:
        run(STAGES, Toy(), ["finish"], tmp_path, Resources(jobs, 10))
    assert 'raise ValueError(f"cannot add' in "".join(traceback.format_exception(error.value))
    chunks_finished = {int(p.stem) for p in (tmp_path / "toy/.work/add/chunks").iterdir()}
    assert chunks_finished == {0, 10} if jobs == 1 else {0, 10} <= chunks_finished <= {0, 10, 30}
    trouble_seen = trouble()
    outputs = run(STAGES, Toy(), ["finish"], tmp_path, Resources(jobs, 10))
    assert trouble_seen() == sorted({0, 10, 20, 30} - chunks_finished)
    assert hashes(outputs) == hashes(run(STAGES, Toy(), ["finish"], tmp_path / "anew", ONE))


def test_finished_chunks_of_other_settings_or_another_chunk_size_are_not_used(tmp_path: Path, trouble) -> None:
    for study, resources in [(Toy(numbers=Numbers(slope=3.0)), ONE), (Toy(), Resources(1, 20))]:
        trouble(fail_at=39)
        with pytest.raises(ChunkError):
            run(STAGES, Toy(), ["add"], tmp_path, ONE)
        trouble_seen = trouble()
        outputs = run(STAGES, study, ["add"], tmp_path, resources)
        assert trouble_seen() == list(range(0, 40, resources.chunk))
        assert hashes(outputs) == hashes(run(STAGES, study, ["add"], tmp_path / f"{resources.chunk}", ONE))


def test_a_damaged_finished_chunk_is_solved_again(tmp_path: Path, trouble) -> None:
    trouble(fail_at=39)
    with pytest.raises(ChunkError):
        run(STAGES, Toy(), ["add"], tmp_path, ONE)
    damage(tmp_path / "toy/.work/add/output/sums.parquet/part-000000010.parquet")
    (tmp_path / "toy/.work/add/chunks/000000000.json").write_text('{"failed": 3, ')
    (tmp_path / "toy/.work/add/output/sums.parquet/.part-000000030.parquet.1.tmp").write_text("half")
    trouble_seen = trouble()
    run(STAGES, Toy(), ["add"], tmp_path, ONE)
    assert trouble_seen() == [0, 10, 30]
    assert not list((tmp_path / "toy").rglob("*.tmp"))


def test_nothing_is_kept_of_an_interrupted_whole_stage(tmp_path: Path) -> None:
    def stopped(job: Job):
        job.path("half.txt").touch()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run((replace(DRAW, run=stopped),), Toy(), ["draw"], tmp_path, ONE)
    assert run(STAGES, Toy(), ["draw"], tmp_path, ONE)["draw"].record["files"] == {}


@pytest.mark.attack  # as test_kills.py does with a process that is forked
def test_a_killed_run_resumes_and_its_workers_end(tmp_path: Path, trouble) -> None:
    trouble(seconds=0.2)
    chunks = tmp_path / "toy/.work/add/chunks"
    script = Path(__file__).with_name("toy_study.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, script, tmp_path, "2", "2"], env=environment, stderr=subprocess.DEVNULL
    ) as process:
        while len(list(chunks.glob("0*.json"))) < 3:
            assert process.poll() is None
            time.sleep(0.01)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
    chunks_finished = {int(path.stem) for path in chunks.glob("0*.json")}
    trouble_seen = trouble()
    outputs = run(STAGES, Toy(), ["finish"], tmp_path, Resources(1, 2))
    assert trouble_seen() == sorted(set(range(0, 40, 2)) - chunks_finished)
    assert hashes(outputs) == hashes(run(STAGES, Toy(), ["finish"], tmp_path / "anew", ONE))
    assert psutil.wait_procs(workers, timeout=60)[1] == []


@pytest.mark.long
def test_a_worker_that_is_killed_is_an_error_that_says_so(tmp_path: Path, trouble) -> None:
    trouble(die_at=35)
    with pytest.raises(ChunkError, match="add: a worker process was ended from outside"):
        run(STAGES, Toy(), ["add"], tmp_path, Resources(2, 10))
    trouble()
    run(STAGES, Toy(), ["add"], tmp_path, Resources(2, 10))


def damage(path: Path) -> None:
    """Turn over the bits of a byte in the data, which changes neither the size nor the footer."""
    data, state = bytearray(path.read_bytes()), path.stat()
    data[len(data) // 8] ^= 0xFF
    path.write_bytes(data)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))  # as a disk that forgets


def test_a_damaged_input_is_named_and_made_again(tmp_path: Path) -> None:
    sound = hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE))
    for name in ("sums.parquet/part-000000010.parquet", "powers.txt"):
        damage(tmp_path / "toy/add" / name)
        (tmp_path / "toy/finish/record.json").unlink()
        with pytest.raises(InputError, match=f"add/{name}: damaged .* run stage add again"):
            run(STAGES, Toy(), ["finish"], tmp_path, ONE)
        assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == sound


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_damaged_input_of_a_chunk_is_named(tmp_path: Path, jobs: int) -> None:
    run(STAGES, Toy(), ["draw"], tmp_path, ONE)
    damage(tmp_path / "toy/draw/points.parquet")
    with pytest.raises(InputError, match="draw/points.parquet: damaged"):
        run(STAGES, Toy(), ["add"], tmp_path, Resources(jobs, 10))


def test_a_lost_output_file_is_made_again(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    (tmp_path / "toy/add/sums.parquet/part-000000010.parquet").unlink()
    capsys.readouterr()
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    assert ran(capsys.readouterr().err) == ["add"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"status": "complete"}'])
def test_an_unreadable_record_is_a_stage_that_never_ran(tmp_path: Path, text: str) -> None:
    run(STAGES, Toy(), ["draw"], tmp_path, ONE)
    (tmp_path / "toy/draw/record.json").write_text(text)
    assert why(STAGES, Toy(), "draw", tmp_path) == ["never run"]
    run(STAGES, Toy(), ["draw"], tmp_path, ONE)
    assert why(STAGES, Toy(), "draw", tmp_path) == ["up to date"]


def test_one_process_writes_a_run(tmp_path: Path) -> None:
    with lock_run(tmp_path / "toy"):
        with pytest.raises(InputError, match=f"toy: process {os.getpid()} is writing this run"):
            run(STAGES, Toy(), ["draw"], tmp_path, ONE)
        run(STAGES, Toy(name="other"), ["draw"], tmp_path, ONE)
    run(STAGES, Toy(), ["draw"], tmp_path, ONE)


def test_an_interrupted_replacement_leaves_no_half_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed between taking the old output away and putting the new one in: the finished chunks are still there."""
    run(STAGES, Toy(), ["add"], tmp_path, ONE)
    rename = Path.rename

    def killed(self: Path, target: Path):
        if target == tmp_path / "toy/add":
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", killed)
    study = Toy(numbers=Numbers(slope=3.0))
    with pytest.raises(KeyboardInterrupt):
        run(STAGES, study, ["add"], tmp_path, ONE)
    monkeypatch.undo()
    assert why(STAGES, study, "add", tmp_path) == ["never run"]
    outputs = run(STAGES, study, ["add"], tmp_path, ONE)
    assert hashes(outputs) == hashes(run(STAGES, study, ["add"], tmp_path / "anew", ONE))

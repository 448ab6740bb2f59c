"""Freshness: what runs, what does not, what is said; resuming; and what other processes and damage do."""

import json
import os
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from toy_study import ADD, DRAW, FINISH, STAGES, Numbers, Toy

from pipeline.engine import runner
from pipeline.engine.fingerprint import package_versions
from pipeline.engine.lock import locked
from pipeline.engine.parallel import ChunkError
from pipeline.engine.runner import Resources, run, why
from pipeline.engine.stage import Chunk, Job
from pipeline.engine.store import Output
from pipeline.errors import InputError

ONE = Resources(jobs=1, chunk=10)


@pytest.fixture
def trouble(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Order trouble in the solves; returns a function that says which chunks were begun since the last order."""

    def order(**keywords: object):
        log = tmp_path / f"log-{time.monotonic_ns()}"
        log.touch()
        monkeypatch.setenv("TOY_TROUBLE", json.dumps(keywords | {"log": str(log)}))
        return lambda: sorted(int(line) for line in log.read_text().split())

    return order


def hashes(outputs: dict[str, Output]) -> dict[str, dict[str, str]]:
    return {name: output.hashes for name, output in outputs.items()}


def ran(captured: str) -> list[str]:
    """Names of the stages that ran, from the progress lines."""
    return [line.split()[0] for line in captured.splitlines() if "up to date" not in line]


def test_output_is_what_pandas_users_are_promised(tmp_path: Path) -> None:
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    points = pd.read_parquet(tmp_path / "toy/draw/points.parquet")
    sums = pd.read_parquet(tmp_path / "toy/add/sums.parquet")
    expected = 2 * (points["x_mm"] + points["x_mm"] ** 2).groupby(points["sample"]).sum()
    np.testing.assert_allclose(sums["sum_mm"], expected, rtol=1e-12)
    assert sums["sample"].tolist() == list(range(40))
    assert sorted(p.name for p in (tmp_path / "toy/add").iterdir()) == [
        "kept.parquet",
        "powers.txt",
        "record.json",
        "sums.parquet",
    ]
    assert len(list((tmp_path / "toy/add/sums.parquet").iterdir())) == 4
    assert len(list((tmp_path / "toy/add/kept.parquet").iterdir())) == 1  # chunks without rows leave no file
    assert pd.read_parquet(tmp_path / "toy/finish/total.parquet")["value"][0] == sums["sum_mm"].mean()


def test_record_says_where_a_result_comes_from(tmp_path: Path) -> None:
    outputs = run(STAGES, Toy(), ["add"], tmp_path, ONE)
    record = json.loads((tmp_path / "toy/add/record.json").read_text())
    assert record == outputs["add"].record
    assert record["settings"] == {"numbers.count": 40, "numbers.slope": 2.0, "plan.powers": [1, 2]}
    assert record["inputs"] == {"draw/points": outputs["draw"].hashes["points"]}
    assert record["packages"] == package_versions()
    assert (record["status"], record["items"], record["chunk"], record["jobs"]) == ("complete", 40, 10, 1)
    large = pd.read_parquet(tmp_path / "toy/add/sums.parquet")["large"]
    assert record["failed"] == large.sum() > 0
    assert record["tables"]["sums"]["rows"] == 40
    assert [f["first"] for f in record["tables"]["sums"]["files"]] == [0, 10, 20, 30]
    assert record["seconds"] > 0
    assert record["peak_memory_bytes"] > 2**20


def test_a_target_runs_what_it_depends_on_and_nothing_else(tmp_path: Path) -> None:
    assert set(run(STAGES, Toy(), ["add"], tmp_path, ONE)) == {"draw", "add"}
    assert not (tmp_path / "toy/finish").exists()


def test_fresh_stages_are_skipped_whatever_jobs_and_chunk(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    capsys.readouterr()
    run(STAGES, Toy(), ["finish"], tmp_path, Resources(jobs=2, chunk=3))
    assert capsys.readouterr().err == "draw  up to date\nadd  up to date\nfinish  up to date\n"


def test_an_equal_result_upstream_leaves_the_rest_fresh(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    capsys.readouterr()
    run(STAGES, Toy(numbers=Numbers(note="no effect")), ["finish"], tmp_path, ONE)
    assert ran(capsys.readouterr().err) == ["draw"]


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(chunk=st.integers(1, 50))
def test_values_do_not_depend_on_the_chunk(tmp_path_factory: pytest.TempPathFactory, chunk: int) -> None:
    runs_of_chunk_sizes = [
        run(STAGES, Toy(), ["finish"], tmp_path_factory.mktemp("runs"), Resources(1, size)) for size in (chunk, 40)
    ]
    assert hashes(runs_of_chunk_sizes[0]) == hashes(runs_of_chunk_sizes[1])


def test_values_do_not_depend_on_the_number_of_jobs(tmp_path: Path) -> None:
    single_job = run(STAGES, Toy(), ["finish"], tmp_path / "1", ONE)
    second_run = run(STAGES, Toy(), ["finish"], tmp_path / "2", Resources(jobs=2, chunk=10))
    assert hashes(single_job) == hashes(second_run)
    for table in ("sums", "kept"):
        frames = [pd.read_parquet(tmp_path / jobs / "toy/add" / f"{table}.parquet") for jobs in "12"]
        pd.testing.assert_frame_equal(*frames, check_exact=True)
    part = "toy/add/sums.parquet/part-000000010.parquet"
    assert (tmp_path / "1" / part).read_bytes() == (tmp_path / "2" / part).read_bytes()


def test_why_tells_every_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert why(STAGES, Toy(), "add", tmp_path) == ["draw runs first: never run", "never run"]
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    assert why(STAGES, Toy(), "finish", tmp_path) == ["up to date"]
    steeper = Toy(numbers=Numbers(slope=3.0))
    assert why(STAGES, steeper, "add", tmp_path) == ["setting numbers.slope changed: 2.0 -> 3.0"]
    assert why(STAGES, steeper, "finish", tmp_path) == ["add runs first: setting numbers.slope changed: 2.0 -> 3.0"]
    (tmp_path / "toy/draw").rename(tmp_path / "kept")
    assert why(STAGES, Toy(), "add", tmp_path) == ["draw runs first: never run"]
    (tmp_path / "kept").rename(tmp_path / "toy/draw")
    reseeded = Toy(numbers=Numbers(seed=2))
    run(STAGES, reseeded, ["draw"], tmp_path, ONE)
    assert why(STAGES, reseeded, "add", tmp_path) == ["input draw/points changed"]
    run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    monkeypatch.setattr("pipeline.engine.fingerprint.package_versions", lambda: package_versions() | {"numpy": "0"})
    assert why(STAGES, Toy(), "draw", tmp_path) == [f"package numpy {package_versions()['numpy']} -> 0"]
    monkeypatch.undo()
    (tmp_path / "toy/add/sums.parquet/part-000000010.parquet").unlink()
    (tmp_path / "toy/add/powers.txt").write_text("cut")
    assert why(STAGES, Toy(), "add", tmp_path) == [
        "output file add/sums.parquet/part-000000010.parquet missing",
        "output file add/powers.txt has 3 bytes, not 7",
    ]


def test_why_names_a_changed_source_and_a_stage_reruns_for_it(tmp_path: Path, monkeypatch, capsys) -> None:
    (tmp_path / "formula.py").write_text("K = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    stages = (replace(DRAW, module="formula"), ADD, FINISH)
    run(stages, Toy(), ["finish"], tmp_path, ONE)
    (tmp_path / "formula.py").write_text("K = 2\n")
    assert why(stages, Toy(), "draw", tmp_path) == ["source formula.py changed"]
    capsys.readouterr()
    run(stages, Toy(), ["finish"], tmp_path, ONE)
    assert ran(capsys.readouterr().err) == ["draw"]
    assert why(stages, Toy(), "finish", tmp_path) == ["up to date"]


def test_unknown_stage_is_an_input_error_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="stage finsh is unknown; stages are draw, add, finish; did you mean finish"):
        run(STAGES, Toy(), ["finsh"], tmp_path, ONE)


def test_a_body_reaches_only_what_its_stage_names(tmp_path: Path) -> None:
    def greedy(job: Job):
        return job.study.numbers.slope

    def nosy(job: Job):
        return job.read("draw", "points")

    with pytest.raises(AttributeError, match="slope is not among the sections that the stage names: count, seed, note"):
        run((replace(DRAW, run=greedy),), Toy(), ["draw"], tmp_path, ONE)
    with pytest.raises(TypeError, match="stage draw is read but not named"):
        run((DRAW, ADD, replace(FINISH, run=nosy)), Toy(), ["finish"], tmp_path, ONE)


@pytest.mark.parametrize("jobs", [1, 2])
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


def test_a_worker_that_is_killed_is_an_error_that_says_so(tmp_path: Path, trouble) -> None:
    trouble(die_at=35)
    with pytest.raises(ChunkError, match="add: a worker process was ended from outside"):
        run(STAGES, Toy(), ["add"], tmp_path, Resources(2, 10))
    trouble()
    run(STAGES, Toy(), ["add"], tmp_path, Resources(2, 10))


def damage(path: Path) -> None:
    """Turn over the bits of a byte in the data, which changes neither the size nor the footer."""
    data = bytearray(path.read_bytes())
    data[len(data) // 8] ^= 0xFF
    path.write_bytes(data)


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
    with locked(tmp_path / "toy"):
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


@pytest.mark.parametrize(
    ("sums", "message"),
    [
        (None, r"returned tables \['kept'\], its contract is \['kept', 'sums'\]"),
        ({"sample": [0]}, "no column sum_mm; no column large"),
        ({"sample": [1, 0], "sum_mm": [0, 0], "large": [True, True]}, "sample must be sorted and inside the chunk"),
        ({"sample": [40], "sum_mm": [0], "large": [True]}, "sample must be sorted and inside the chunk"),
    ],
)
def test_a_body_that_breaks_its_contract_is_named(tmp_path: Path, sums, message: str) -> None:
    def wrong(shared: object, chunk: Chunk):
        empty_rows = ADD.tables[1].empty()
        return {"kept": empty_rows} if sums is None else {"sums": sums, "kept": empty_rows}

    with pytest.raises(ChunkError, match=message):
        run((DRAW, replace(ADD, solve=wrong)), Toy(), ["add"], tmp_path, Resources(1, 40))


def test_stage_definitions_are_checked() -> None:
    for change in ({"run": runner.run}, {"prepare": None}, {"chunk_reads": ("other/points",)}, {"tables": (1, 1)}):
        with pytest.raises((TypeError, AttributeError)):
            replace(ADD, **change)

"""What runs and what does not, what is said of it, and what a record and a contract of a stage hold."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_runs import ONE, hashes, ran
from toy_study import ADD, DRAW, FINISH, STAGES, Numbers, Toy

from pipeline.engine import runner
from pipeline.engine.fingerprint import package_versions
from pipeline.engine.parallel import ChunkError
from pipeline.engine.runner import Resources, run, why
from pipeline.engine.stage import Chunk, Job
from pipeline.errors import InputError


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


@pytest.fixture(scope="module")
def in_one_chunk(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return hashes(run(STAGES, Toy(), ["finish"], tmp_path_factory.mktemp("runs"), Resources(1, 40)))


@settings(max_examples=8)
@given(chunk=st.integers(1, 50))
@pytest.mark.long
def test_values_do_not_depend_on_the_chunk(
    tmp_path_factory: pytest.TempPathFactory, in_one_chunk: dict, chunk: int
) -> None:
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path_factory.mktemp("runs"), Resources(1, chunk))) == in_one_chunk


@pytest.mark.long
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

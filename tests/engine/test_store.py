"""Reading ranges of items, files written whole or not at all, and the cache."""

import errno
import os
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.engine import table as table_module
from pipeline.engine.cache import ABANDONED_AFTER_S, BEING_MADE, Cache
from pipeline.engine.store import Output, write_atomic
from pipeline.engine.table import Column, Table
from pipeline.engine.work import Work
from pipeline.errors import InputError

ROWS = Table("rows", "sample, row", (Column("sample", "int32", "1", ""), Column("x_mm", "float64", "mm", "")))
SAMPLES = np.repeat(np.arange(20), np.arange(20) % 4)  # samples of 0 to 3 rows


def output(folder: Path, ends: list[int]):
    """The rows in parts that end at the given samples; in one file if there are none."""
    work = Work(folder, "stage", None)
    columns = {"sample": SAMPLES, "x_mm": np.arange(SAMPLES.size, dtype=float)}
    if not ends:
        work.write_whole({"rows": ROWS.part(columns)})
    for start, stop in zip([0, *ends], [*ends, 20], strict=True) if ends else ():
        is_inside = (start <= SAMPLES) & (stop > SAMPLES)
        if is_inside.any():
            work.write_chunk(start, stop, {"rows": ROWS.part({k: v[is_inside] for k, v in columns.items()})}, 0)
    return work.publish(work.contents([ROWS]))


@pytest.fixture(scope="module", params=[[], [5, 10, 15], [1, 2, 3, 4, 5, 17]])
def output_written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_module, "ROWS_PER_GROUP", 7)
        return output(tmp_path_factory.mktemp("run"), request.param)


@given(bounds=st.tuples(st.integers(0, 20), st.integers(0, 20)))
def test_a_range_of_items_is_cut_out_of_any_parts(output_written, bounds: tuple[int, int]) -> None:
    start, stop = min(bounds), max(bounds)
    rows_inside = np.flatnonzero((start <= SAMPLES) & (stop > SAMPLES))
    result = output_written.read_items("rows", start, stop)
    np.testing.assert_array_equal(result["x_mm"], rows_inside)
    np.testing.assert_array_equal(result["sample"], SAMPLES[rows_inside])
    assert result["sample"].dtype == np.int32


@pytest.mark.parametrize("start", [7, 40])
def test_an_item_is_read_from_its_file_alone_and_one_that_is_not_there_from_any(tmp_path, monkeypatch, start) -> None:
    written_file, read = output(tmp_path, [5, 10, 15]), []
    decode = Output._decode
    monkeypatch.setattr(Output, "_decode", lambda self, file, *more: read.append(file) or decode(self, file, *more))
    assert len(written_file.read_items("rows", start, start + 1)["sample"]) == np.sum(start == SAMPLES)
    assert len(read) == 1


def test_columns_by_name_are_read_without_the_others(output_written) -> None:
    columns = output_written.read("rows", ["x_mm"])
    assert list(columns) == ["x_mm"]
    np.testing.assert_array_equal(columns["x_mm"], np.arange(SAMPLES.size))


def test_unsorted_rows_are_not_read_by_item(tmp_path: Path) -> None:
    work = Work(tmp_path, "stage", None)
    work.write_whole({"rows": ROWS.part({"sample": [1, 0], "x_mm": [0, 1]})})
    written_file = work.publish(work.contents([ROWS]))
    assert written_file.read("rows")["sample"].tolist() == [1, 0]
    with pytest.raises(TypeError, match="stage/rows has no rows sorted by sample"):
        written_file.read_items("rows", 0, 1)


def test_a_flipped_bit_that_decodes_is_noticed(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(size=1000)  # does not compress: the bytes of the values stand in the file
    work = Work(tmp_path, "stage", None)
    work.write_whole({"rows": ROWS.part({"sample": np.zeros(1000, int), "x_mm": noise})})
    written_file = work.publish(work.contents([ROWS]))
    path = tmp_path / "stage/rows.parquet"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert np.count_nonzero(pq.read_table(path)["x_mm"].to_numpy() != noise) == 1
    with pytest.raises(InputError, match="rows.parquet: damaged"):
        written_file.read("rows")


def test_a_name_that_the_stage_does_not_write_is_a_mistake(output_written) -> None:
    with pytest.raises(TypeError, match=r"has no table row; it has \['rows'\]"):
        output_written.read("row")
    with pytest.raises(TypeError, match="has no file x.npz"):
        output_written.path("x.npz")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_atomic(tmp_path / "a", b"old")

    def broken(self: Path, data: bytes) -> None:
        with self.open("wb") as file:
            file.write(data[:1])
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(Path, "write_bytes", broken)
    with pytest.raises(OSError, match="no space"):
        write_atomic(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"old"


def test_cache_makes_once_a_key_and_code(tmp_path: Path) -> None:
    calls = []

    def make(folder: Path) -> None:
        calls.append(folder)
        (folder / "x").write_text("1")

    first_result = Cache(tmp_path, "code").folder("key", make)
    assert (first_result / "x").read_text() == "1"
    assert Cache(tmp_path, "code").folder("key", make) == first_result
    assert len(calls) == 1
    assert (
        len({Cache(tmp_path, "code").folder("k", make), Cache(tmp_path, "new code").folder("key", make), first_result})
        == 3
    )
    assert len(calls) == 3


def test_a_failed_computation_leaves_nothing_in_the_cache(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "half").touch()
        raise ValueError("no mesh")

    with pytest.raises(ValueError, match="no mesh"):
        Cache(tmp_path, "code").folder("key", fails)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_was_making_is_removed_once_it_is_old(tmp_path: Path) -> None:
    """That of a process that still computes stays."""
    for name, age_s in (("killed", ABANDONED_AFTER_S + 60), ("at work", ABANDONED_AFTER_S - 60)):
        folder = tmp_path / f"{BEING_MADE}{name}"
        folder.mkdir()
        (folder / "half").touch()
        os.utime(folder, (time.time() - age_s,) * 2)
    entry = Cache(tmp_path, "code").folder("key", lambda folder: (folder / "x").write_text("1"))
    assert {path.name for path in tmp_path.iterdir()} == {entry.name, f"{BEING_MADE}at work"}


def test_two_processes_that_compute_the_same_agree_on_the_first(tmp_path: Path) -> None:
    cache = Cache(tmp_path, "code")

    def make(folder: Path) -> None:
        cache.folder("key", lambda variant: (variant / "x").write_text("first"))
        (folder / "x").write_text("second")

    assert (cache.folder("key", make) / "x").read_text() == "first"

"""What lies on the disk is believed only if it is what was written: cache, records, parts, leftovers, links."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from forked import forked
from toy_runs import ONE, hashes
from toy_study import ADD, DRAW, STAGES, Numbers, Toy

from pipeline.engine import finished_run, record, work
from pipeline.engine.cache import ENTRY, Cache, lock_run
from pipeline.engine.finished_run import damages, mixed_stages
from pipeline.engine.parallel import ChunkError
from pipeline.engine.runner import run, why
from pipeline.engine.store import Output, remove
from pipeline.errors import InputError


def flip(path: Path, position: int | None = None, bit: int = 0) -> None:
    """Turn over one bit, in the middle of the file unless said."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2 if position is None else position] ^= 1 << bit
    path.write_bytes(data)


@pytest.fixture
def outputs(tmp_path: Path) -> dict[str, dict[str, str]]:
    """A finished toy study in tmp_path, and its hashes."""
    return hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE))


# --- cache ------------------------------------------------------------------------------------------------------------


def _truncated(entry: Path) -> None:
    path = entry / "m.npy"
    path.write_bytes(path.read_bytes()[:-8])


def _of_another_shape(entry: Path) -> None:
    np.save(entry / "m.npy", np.zeros((3, 2)))


def _foreign(entry: Path) -> None:
    (entry / "more.npy").touch()


def _of_another_key(entry: Path) -> None:
    written_file = json.loads((entry / ENTRY).read_text())
    (entry / ENTRY).write_text(json.dumps(written_file | {"key": "another"}))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda entry: flip(entry / "m.npy", -3), "m.npy: not what was written"),
        (_truncated, "m.npy: not what was written"),
        (_of_another_shape, r'm.npy: not what was written .*"shape": \[2, 3\]'),
        (lambda entry: (entry / "m.npy").unlink(), "m.npy: missing"),
        (_foreign, "more.npy: not of this entry"),
        (lambda entry: (entry / ENTRY).unlink(), f"{ENTRY}: missing or damaged"),
        (lambda entry: (entry / ENTRY).write_text("[" * 100_000), f"{ENTRY}: missing or damaged"),
        (lambda entry: (entry / ENTRY).write_text('{"files": []}'), f"{ENTRY}: missing or damaged"),
        (_of_another_key, f"{ENTRY}: of another key"),
    ],
)
def test_a_damaged_cache_entry_is_named_discarded_and_made_anew(tmp_path, capsys, damage, message) -> None:
    calls = []

    def make(folder: Path) -> None:
        calls.append(folder)
        np.save(folder / "m.npy", np.arange(6.0).reshape(2, 3))

    cache = Cache(tmp_path, "code")
    damage(cache.folder("key", make))
    result = cache.folder("key", make)
    assert len(calls) == 2
    np.testing.assert_array_equal(np.load(result / "m.npy"), np.arange(6.0).reshape(2, 3))
    told_text = capsys.readouterr().err
    assert "discarded, made anew" in told_text
    assert re.search(message, told_text)
    assert cache.folder("key", make) == result
    assert len(calls) == 2


def test_a_flipped_bit_in_the_cache_changes_no_result(tmp_path: Path, outputs, capsys) -> None:
    (cached,) = (tmp_path / ".cache").glob("*/powers.npy")
    flip(cached, -1, 6)
    shutil.rmtree(tmp_path / "toy")
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
    assert "powers.npy: not what was written" in capsys.readouterr().err


# --- records ----------------------------------------------------------------------------------------------------------


def _edited(**changes: object):
    return lambda record: record | changes


def _sealed(change):
    """A change by one who knows how a record is sealed: the schema alone must refuse it."""

    def edit(content: dict) -> dict:
        variant = json.loads(json.dumps(content))
        change(variant)
        return variant | {"seal": record.seal(variant)}

    return edit


def _part(record: dict) -> dict:
    return record["tables"]["sums"]["files"][0]


INVALID = {
    "a list": lambda _: [],
    "a string": lambda _: "record",
    "a number": lambda _: 1,
    "layout alone": lambda _: {"layout": record.LAYOUT},
    "another layout": _edited(layout=record.LAYOUT - 1),
    "no tables": lambda record: {name: value for name, value in record.items() if name != "tables"},
    "no sources": _sealed(lambda record: record.update(sources=None)),
    "no files of a table": _sealed(lambda record: record["tables"]["sums"].update(files=[])),
    "rows as text": _sealed(lambda record: _part(record).update(rows="10")),
    "a missing part": lambda record: _edited(tables={"sums": record["tables"]["sums"]})(record),
    "an extra key": _sealed(lambda record: record.update(more={"a": 1})),
    "no times": _sealed(lambda record: [record.pop(name) for name in ("started", "seconds", "peak_memory_bytes")]),
    "a time as a list": _sealed(lambda record: record.update(started=[])),
    "seconds as text": _sealed(lambda record: record.update(seconds="long")),
    "swapped files": lambda record: (
        record | {"tables": {"sums": record["tables"]["kept"], "kept": record["tables"]["sums"]}}
    ),
    "swapped and sealed": _sealed(
        lambda record: record["tables"].update(sums=record["tables"]["kept"], kept=record["tables"]["sums"])
    ),
    "parts in another order": lambda record: (
        record
        | {
            "tables": record["tables"]
            | {"sums": record["tables"]["sums"] | {"files": record["tables"]["sums"]["files"][::-1]}}
        }
    ),
    "of another stage": _sealed(lambda record: record.update(stage="draw")),
    "an absolute path": _sealed(lambda record: _part(record).update(name="/etc/hostname")),
    "a path upwards": _sealed(lambda record: _part(record).update(name="../draw/points.parquet")),
    "a hidden file": _sealed(lambda record: record["files"].update({".lock": record["files"]["powers.txt"]})),
    "a drive": _sealed(lambda record: record["files"].update({"C:x.txt": record["files"]["powers.txt"]})),
    "a backslash": _sealed(lambda record: record["files"].update({"a\\b.txt": record["files"]["powers.txt"]})),
    "a path upwards in the files": _sealed(
        lambda record: record["files"].update({"a/../../x": record["files"]["powers.txt"]})
    ),
}


@pytest.mark.parametrize("edit", INVALID.values(), ids=INVALID)
def test_an_invalid_record_is_a_stage_that_never_ran(tmp_path: Path, outputs, edit) -> None:
    path = tmp_path / "toy/add/record.json"
    path.write_text(json.dumps(edit(json.loads(path.read_text()))))
    assert why(STAGES, Toy(), "add", tmp_path) == ["never run"]
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs


def test_a_record_removes_no_file_outside_its_stage(tmp_path: Path, outputs) -> None:
    outside_path = tmp_path / "mine.txt"
    for name in (str(outside_path), "../../mine.txt", "link/mine.txt"):
        outside_path.write_text("precious")
        folder = tmp_path / "toy/add"
        (folder / "link").unlink(missing_ok=True)
        (folder / "link").symlink_to(tmp_path)
        content = json.loads((folder / "record.json").read_text())
        content["files"][name] = content["files"]["powers.txt"]
        content["seal"] = record.seal(content)
        (folder / "record.json").write_text(json.dumps(content))
        opening = Output.open(folder)
        if opening is not None:  # a link below the folder is no escape by its name
            with pytest.raises(InputError, match="damaged"):
                opening.path(name)
        assert outside_path.read_text() == "precious"
        assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs


@pytest.mark.parametrize("options", [".work", ".work/add", ".work/add/output", ".work/add/chunks"])
def test_links_inside_the_work_folder_are_not_followed(tmp_path: Path, monkeypatch, options: str) -> None:
    """An interrupted run whose folders were moved elsewhere and linked: nothing is written or removed there."""
    monkeypatch.setenv("TOY_TROUBLE", '{"fail_at": 39}')
    with pytest.raises(ChunkError):
        run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    monkeypatch.delenv("TOY_TROUBLE")
    outside_path, link = tmp_path / "outside", tmp_path / "toy" / options
    link.rename(outside_path)
    (outside_path / ".mine.tmp").write_text("precious")
    link.symlink_to(outside_path)
    files_before = {path: path.read_bytes() for path in outside_path.rglob("*") if path.is_file()}
    repeat = run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    assert {path: path.read_bytes() for path in outside_path.rglob("*") if path.is_file()} == files_before
    assert hashes(repeat) == hashes(run(STAGES, Toy(), ["finish"], tmp_path / "anew", ONE))


# --- parts ------------------------------------------------------------------------------------------------------------


def test_every_flipped_bit_of_a_part_is_found_when_it_is_read(tmp_path: Path, outputs) -> None:
    """Equal size, any place: footer and statistics, of which a Parquet reader checks nothing, too."""
    output = Output.open(tmp_path / "toy/add")
    assert output is not None
    part = tmp_path / "toy/add/sums.parquet/part-000000010.parquet"
    data = part.read_bytes()
    places = np.unique(np.linspace(0, len(data) - 1, 300).astype(int))
    for position in places:
        flip(part, int(position), int(position) % 8)
        with pytest.raises(InputError, match="part-000000010.parquet: damaged"):
            replace(output, _verified_files=set()).read("sums")
        part.write_bytes(data)
    assert len(places) > 200
    assert output.read("sums")["sample"].size == 40


def test_check_names_what_is_damaged_and_the_stage_that_makes_it_anew(tmp_path: Path, outputs) -> None:
    assert finished_run.damages(tmp_path / "toy") == []
    flip(tmp_path / "toy/add/sums.parquet/part-000000010.parquet", -20)
    flip(tmp_path / "toy/add/powers.txt")
    (tmp_path / "toy/finish/record.json").write_text("{}")
    (tmp_path / "toy/draw/points.parquet").unlink()
    (tmp_path / "toy/add/sums.parquet/part-000000099.parquet").write_bytes(b"of somebody")
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    damages = finished_run.damages(tmp_path / "toy")
    assert [(damaged.stage, damaged.name, damaged.fault) for damaged in damages] == [
        ("add", "sums.parquet/part-000000010.parquet", "altered"),
        ("add", "powers.txt", "altered"),
        ("add", "sums.parquet/part-000000099.parquet", "extra"),
        ("draw", "points.parquet", "missing"),
        ("finish", "record.json", "altered"),
    ]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == files  # it writes nothing
    assert finished_run.set_aside(tmp_path / "toy", damages)
    assert (tmp_path / "toy/.damaged/add/sums.parquet/part-000000099.parquet").read_bytes() == b"of somebody"
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
    assert finished_run.damages(tmp_path / "toy") == []


@pytest.mark.parametrize(
    ("remove", "found"),
    [
        ("finish", [("finish", "record.json", "missing")]),
        ("draw", [("draw", "record.json", "missing")]),
        ("add/record.json", [("add", "record.json", "missing")]),
        (".manifest.json", [("", ".manifest.json", "missing")]),
    ],
)
def test_check_misses_a_stage_that_is_gone(tmp_path: Path, outputs, remove: str, found: list) -> None:
    path = tmp_path / "toy" / remove
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    damages = [(damaged.stage, damaged.name, damaged.fault) for damaged in finished_run.damages(tmp_path / "toy")]
    assert damages == found
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
    assert finished_run.damages(tmp_path / "toy") == []


def test_check_names_a_folder_that_is_no_stage_of_the_run(tmp_path: Path, outputs) -> None:
    shutil.copytree(tmp_path / "toy/add", tmp_path / "toy/add2")
    damages = finished_run.damages(tmp_path / "toy")
    assert [(damaged.stage, damaged.name, damaged.fault) for damaged in damages] == [("add2", "record.json", "extra")]
    assert not finished_run.set_aside(tmp_path / "toy", damages)
    assert (tmp_path / "toy/add2/record.json").is_file()


def test_stages_of_two_states_of_a_study_are_told_apart(tmp_path: Path, outputs) -> None:
    """One stage alone was run after a change: its tables and the later ones are of other samples."""
    changed = Toy(numbers=Numbers(seed=2))
    assert mixed_stages(tmp_path / "toy") == []
    run(STAGES, changed, ["draw"], tmp_path, ONE)
    assert [(found.stage, found.name, found.fault) for found in damages(tmp_path / "toy")] == [
        ("add", "record.json", "made from another draw")
    ]
    assert mixed_stages(tmp_path / "toy")[0].startswith("draw of toy has changed since it was used by add: do not")
    run(STAGES, changed, ["finish"], tmp_path, ONE)
    assert damages(tmp_path / "toy") == []


def test_check_takes_no_lock(tmp_path: Path, outputs) -> None:
    """An archive that nobody may write, or that another process reads, is verified all the same."""
    with lock_run(tmp_path / "toy"):
        assert finished_run.damages(tmp_path / "toy") == []


def test_an_extra_part_is_set_aside_before_anything_reads_the_folder(tmp_path: Path, outputs, capsys) -> None:
    """Readers of a whole folder would count its rows: 97,920 for 48,960."""
    folder = tmp_path / "toy/add/sums.parquet"
    shutil.copy(folder / "part-000000010.parquet", folder / "part-000000011.parquet")
    assert len(pd.read_parquet(folder)) == 50
    assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
    assert len(pd.read_parquet(folder)) == 40
    assert "part-000000011.parquet was not written by this run; set aside" in capsys.readouterr().err


def test_a_run_that_is_copied_without_its_times_is_up_to_date(tmp_path: Path, outputs, capsys) -> None:
    shutil.copytree(tmp_path / "toy", tmp_path / "copy/toy", copy_function=shutil.copyfile)
    assert why(STAGES, Toy(), "finish", tmp_path / "copy") == ["up to date"]
    powers = tmp_path / "copy/toy/add/powers.txt"
    powers.write_text(powers.read_text().replace("1", "3"))
    assert why(STAGES, Toy(), "add", tmp_path / "copy") == ["output file add/powers.txt was altered"]


# --- chunk notes ---


@pytest.mark.parametrize("kind", ["of another state", "beyond the samples", "without a seal", "misplaced"])
def test_a_stray_chunk_note_adds_no_row(tmp_path: Path, monkeypatch, kind: str) -> None:
    monkeypatch.setenv("TOY_TROUBLE", '{"fail_at": 39}')
    with pytest.raises(ChunkError):
        run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    monkeypatch.delenv("TOY_TROUBLE")
    work = tmp_path / "toy/.work/add"
    note = json.loads((work / "chunks/000000010.json").read_text())
    start = {"beyond the samples": 40, "misplaced": 5}.get(kind, 30)
    text = json.dumps(note["parts"]).replace("part-000000010", f"part-{start:09d}")
    moved = note | {"parts": json.loads(text), "stop": start + 10}
    for name, part in moved["parts"].items():
        part |= {"first": start, "last": start + 9} if kind != "misplaced" else {}
        shutil.copy(work / f"output/{name}.parquet/part-000000010.parquet", work / "output" / part["name"])
    if kind == "of another state":
        moved["state"] = "f" * 64
    is_refused = record.valid_note(record.with_seal(moved), start, note["state"]) is None
    assert is_refused == (kind in ("of another state", "misplaced"))
    (work / f"chunks/{start:09d}.json").write_text(
        json.dumps(moved if kind == "without a seal" else record.with_seal(moved))
    )
    repeat = run(STAGES, Toy(), ["finish"], tmp_path, ONE)
    assert hashes(repeat) == hashes(run(STAGES, Toy(), ["finish"], tmp_path / "anew", ONE))
    assert len(pd.read_parquet(tmp_path / "toy/add/sums.parquet")) == 40


# --- what is no plain file ---


class StillWaitingError(Exception):
    """A pipe has no other end: whoever opens it waits for ever."""


def _waiting(*_: object) -> None:
    raise StillWaitingError


ODD_FILES = {
    "a folder": lambda path: (path.mkdir(), (path / "mine.txt").write_text("precious")),
    "a pipe": os.mkfifo,
    "a link to itself": lambda path: path.symlink_to(path),
    "a link to nothing": lambda path: path.symlink_to("nowhere/at_all"),
    "a device without an end": lambda path: path.symlink_to("/dev/zero"),
}
STILL_A_LOCK = (".lock",)
"""Whoever has taken its place is told to move it out of the way: a lock that the engine moves is none."""
OF_ALL_RUNS = ("toy", ".cache", "toy/.work")


@pytest.mark.skipif(os.name != "posix", reason="pipes and signals")
@pytest.mark.parametrize("kind", ODD_FILES)
@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.attack), 5])
def test_what_is_no_plain_file_is_made_anew(
    tmp_path: Path, monkeypatch, kind: str, interrupted: bool, every: int
) -> None:
    """At every path of a run, finished or half done, and of its cache; the commands that only look end as well.

    In part each kind is at every fifth path, and one kind at each path.
    """
    outputs = hashes(run(STAGES, Toy(), ["finish"], tmp_path / "reference", ONE))
    monkeypatch.setenv("TOY_TROUBLE", '{"fail_at": 39}' if interrupted else "{}")
    with contextlib.suppress(ChunkError):
        run(STAGES, Toy(), ["finish"], tmp_path / "runs", ONE)
    monkeypatch.delenv("TOY_TROUBLE")
    names = [path.relative_to(tmp_path / "runs").as_posix() for path in (tmp_path / "runs").rglob("*")]
    signal.signal(signal.SIGALRM, _waiting)
    begin = list(ODD_FILES).index(kind) % every
    for number, name in list(enumerate(sorted(names)))[begin::every]:
        runs = tmp_path / f"w{number}"
        shutil.copytree(tmp_path / "runs", runs)
        remove(runs / name)
        ODD_FILES[kind](runs / name)
        signal.setitimer(signal.ITIMER_REAL, 20)
        why(STAGES, Toy(), "finish", runs)
        with contextlib.suppress(InputError):
            finished_run.damages(runs / "toy")
        if name.endswith(STILL_A_LOCK) or (name in OF_ALL_RUNS and kind != "a folder"):
            with contextlib.suppress(OSError):
                run(STAGES, Toy(), ["finish"], runs, ONE)
        else:
            assert hashes(run(STAGES, Toy(), ["finish"], runs, ONE)) == outputs, name
            assert finished_run.damages(runs / "toy") == [], name
        signal.setitimer(signal.ITIMER_REAL, 0)


# --- leftovers --------------------------------------------------------------------------------------------------------


def killed_at(steps: int, runs: Path) -> None:
    """The toy study, whose process ends itself after so many changes of the file system by the publishing of add."""
    done, publish = -1, work.Work.publish

    def publishing(self: work.Work, record: dict) -> object:
        nonlocal done
        done = 0 if self.target.name == "add" else -1
        return publish(self, record)

    def counted(function: Callable) -> Callable:
        def step(*arguments: object, **options: object) -> object:
            nonlocal done
            if done >= 0:
                done += 1
                if done > steps:
                    os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **options)

        return step

    work.Work.publish = publishing
    for name in ("rename", "replace", "unlink", "rmdir", "mkdir"):
        setattr(os, name, counted(getattr(os, name)))
    run(STAGES, Toy(), ["finish"], runs, ONE)


@pytest.mark.long
def test_killed_at_any_step_of_a_publish_the_next_run_ends_equal(tmp_path: Path, outputs) -> None:
    """With an old output to replace; then the new one is damaged too, so that the stage is built once more."""
    killed = 0
    for step in range(0, 60, 3):
        (tmp_path / "toy/add/powers.txt").write_text("cut")
        process = forked(killed_at, step, tmp_path)
        process.join()
        assert process.exitcode in (0, -signal.SIGKILL)
        killed += process.exitcode == -signal.SIGKILL
        for _ in range(2):
            assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
            (tmp_path / "toy/add/powers.txt").write_text("cut")
        assert hashes(run(STAGES, Toy(), ["finish"], tmp_path, ONE)) == outputs
        assert list((tmp_path / "toy/.work").iterdir()) == []
        if process.exitcode == 0:
            break
    assert killed >= 4
    assert process.exitcode == 0


def killed_in_a_lock(folder: Path) -> None:
    with lock_run(folder):
        os.kill(os.getpid(), signal.SIGKILL)


def test_the_lock_of_a_killed_process_holds_nobody_up(tmp_path: Path) -> None:
    forked(killed_in_a_lock, tmp_path / "toy").join()
    with lock_run(tmp_path / "toy"):
        assert (tmp_path / "toy/.holder").read_text() == str(os.getpid())


def test_a_stage_whose_bodies_change_nothing_is_not_touched(tmp_path: Path, outputs, capsys) -> None:
    capsys.readouterr()
    run((DRAW, ADD), Toy(), ["add"], tmp_path, ONE)
    assert capsys.readouterr().err == "draw  up to date\nadd  up to date\n"


@pytest.mark.long
def test_the_engine_is_imported_where_files_are_locked_otherwise() -> None:
    """As on Windows, which has no fcntl."""
    script = "import sys; sys.modules['fcntl'] = None; import pipeline.engine.runner, pipeline.engine.cluster; "
    script += "from filelock import FileLock, SoftFileLock; print(FileLock is SoftFileLock)"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert (process.returncode, process.stdout) == (0, "True\n"), process.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_that_a_body_meets_is_told_with_the_stage(tmp_path: Path) -> None:
    """A body's own writing knows no name: a full disk is noticed by the write, not by the opening."""

    def fills(job: object) -> None:
        with open("/dev/full", "wb", buffering=0) as file:
            file.write(b"1")

    with pytest.raises(OSError, match="No space left") as error:
        run((replace(DRAW, run=fills),), Toy(), ["draw"], tmp_path, ONE)
    assert error.value.filename == str(tmp_path / "toy/draw")

"""Answers of commands that compute nothing: given again at once, and never where anything that they rest on changed."""

import argparse
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline import settings
from pipeline.cli import kept_answers
from pipeline.cli.kept_answers import keep_answer, kept_answer

PROJECT = Path(__file__).parents[2]
LINES = ["up to date"]
OPTIONS = argparse.Namespace(command="studies.reasons", stage="report", study="quick", opening="")


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package, a run, an input and an installed library, all written before the command began."""
    for name in ("package/source.py", "package/page.html", "runs/quick/report/record.json", "inputs/study.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("before")
    (tmp_path / "installed").mkdir()
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(kept_answers, "OWN_SOURCES", (tmp_path / "package",))
    monkeypatch.setattr(kept_answers, "START_NS", kept_answers.time.time_ns() + 10**9)
    monkeypatch.setattr(sys, "path", [str(tmp_path / "installed")])
    return tmp_path


def keep(world: Path) -> None:
    keep_answer(OPTIONS, LINES, ["report  up to date"], world / "runs/quick", [world / "inputs/study.toml"], [])


def test_an_answer_is_given_again_as_it_was(world: Path) -> None:
    assert kept_answer(OPTIONS) is None
    keep(world)
    assert kept_answer(OPTIONS) == (LINES, ["report  up to date"])
    assert kept_answer(argparse.Namespace(**{**vars(OPTIONS), "stage": "worst"})) is None


def _restored(path: Path) -> None:
    """Other content of the same size, with its old time stamp."""
    state = path.stat()
    path.write_text("behind")
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


CHANGES: dict[str, Callable[[Path], object]] = {
    "a source": lambda world: (world / "package/source.py").write_text("changed"),
    "a template": lambda world: (world / "package/page.html").write_text("changed"),
    "a new source": lambda world: (world / "package/another.py").write_text(""),
    "the study": lambda world: (world / "inputs/study.toml").write_text("changed"),
    "the study gone": lambda world: (world / "inputs/study.toml").unlink(),
    "a result": lambda world: (world / "runs/quick/report/record.json").write_text("changed"),
    "a result with its stamp restored": lambda world: _restored(world / "runs/quick/report/record.json"),
    "a result gone": lambda world: (world / "runs/quick/report/record.json").unlink(),
    "an extra file": lambda world: (world / "runs/quick/report/extra.csv").write_text(""),
    "a library": lambda world: (world / "installed/numpy-3.dist-info").mkdir(),
    "the note": lambda world: _damage_the_note(world),
}


def _damage_the_note(world: Path) -> None:
    (note,) = (world / "runs/.cache/answers").iterdir()
    note.write_text(note.read_text().replace("up to date", "up to data"))


@pytest.mark.parametrize("change", CHANGES)
def test_it_is_not_given_where_something_changed(world: Path, change: str) -> None:
    keep(world)
    CHANGES[change](world)
    assert kept_answer(OPTIONS) is None


def test_it_is_not_kept_where_an_input_changed_meanwhile(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_answers, "START_NS", 0)
    keep(world)
    assert kept_answer(OPTIONS) is None


@pytest.mark.long
def test_the_second_answer_of_a_command_takes_a_fraction_of_a_second(tmp_path: Path) -> None:
    for name in ("designs", "studies"):
        shutil.copytree(PROJECT / "data" / name, tmp_path / "data" / name)

    def asked() -> tuple[str, float]:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "pipeline", "why", "sample", "--study", "quick"]
        environment = {**os.environ, "CYCLOID_ROOT": str(tmp_path)}
        done = subprocess.run(command, env=environment, cwd=PROJECT, capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    (first, _), (second, seconds) = asked(), asked()
    assert first == second != ""
    assert seconds < 0.8
    study = tmp_path / "data/studies/quick.toml"
    study.write_text(study.read_text().replace("count = 50", "count = fifty"))
    with pytest.raises(subprocess.CalledProcessError):
        asked()

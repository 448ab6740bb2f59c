"""No traceback reaches a user: what the system, a file or a command line can do wrong is one line and exit 2."""

import errno
import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import cli, settings
from pipeline.cli import studies
from pipeline.engine.cache import lock_run
from pipeline.errors import ChunkError, InputError

ROOT = Path(__file__).parent.parent.parent
HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "joblib", "matplotlib", "numba", "pydantic", "skfem", "tqdm")
COMMANDS = """
import sys
from pathlib import Path
from pipeline import cli, settings
for runs, command in zip(sys.argv[1::2], sys.argv[2::2]):
    settings.RUNS = Path(runs)
    print("ended", cli.main(command.split()), file=sys.stderr)
"""
SAMPLE_STAGE = ("run", "sample", "--study", "quick")


def told(capsys: pytest.CaptureFixture, *arguments: object) -> str:
    """What a command that must fail with status 2 says: short lines, no traceback."""
    try:
        status = cli.main([str(argument) for argument in arguments])
    except SystemExit as error:  # of the parser
        status = error.code
    text = capsys.readouterr().err
    assert status == 2, text
    assert "Traceback" not in text
    assert all(len(line) < 1300 for line in text.splitlines())
    return text


# --- what is imported -------------------------------------------------------------------------------------------------


def test_help_imports_no_library() -> None:
    """Importing them took 4 s of a help's 4 s."""
    script = "import sys\nfrom pipeline import cli\ntry:\n    cli.main(['--help'])\nexcept SystemExit:\n    pass\n"
    script += "print('imported', *sys.modules)"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    help_text, modules = process.stdout.rsplit("imported", 1)
    assert "clean-runs" in help_text
    assert not set(HEAVY) & set(modules.split())


@pytest.mark.long
def test_a_command_of_stages_draws_with_a_library_that_it_imports_when_it_draws() -> None:
    """It took as long to import as all stages but the mechanics."""
    script = "import sys, pipeline.cli.studies\nprint(*sys.modules)"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert not {"matplotlib", "meshio"} & set(process.stdout.split())


def test_every_command_has_its_action() -> None:
    import importlib

    from pipeline.cli.parser import parser

    (commands,) = [action for action in parser()._actions if action.choices and action.metavar == "COMMAND"]
    assert len(commands.choices) > 10
    for sub in commands.choices.values():
        module, _, action = sub.get_default("command").partition(".")
        assert callable(getattr(importlib.import_module(f"pipeline.cli.{module}"), action))


# --- what the system refuses ------------------------------------------------------------------------------------------


def test_a_file_larger_than_the_limit(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    soft_limit, limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limit))
    try:
        line = told(capsys, *SAMPLE_STAGE).splitlines()[-1]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft_limit, limit))
    assert str(tmp_path) in line
    assert "File too large; raise the limit" in line


@pytest.fixture(scope="module")
def on_odd_disks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs on a full disk and on a read-only one, and the removal of runs in which a disk is mounted.

    One process ran them; what it said of each is in a file of its name.
    """
    if (
        not shutil.which("unshare")
        or subprocess.run(["unshare", "-rm", "mount", "-t", "tmpfs", "x", "/mnt"]).returncode
    ):
        pytest.skip("mounts in a namespace of one's own are not permitted here")
    folder = tmp_path_factory.mktemp("disks")
    for name in ("full", "locked", "busy/quick/sample", "busy/other"):
        (folder / name).mkdir(parents=True)
    disks = (("-o size=32k", "full"), ("-o ro", "locked"), ("", "busy/quick/sample"))
    mounts = "".join(f"mount -t tmpfs {options} x {folder / name}; " for options, name in disks)
    runs = (("full", *SAMPLE_STAGE), ("locked/runs", *SAMPLE_STAGE), ("busy", "clean-runs"))
    arguments = [text for name, *command in runs for text in (str(folder / name), " ".join(command))]
    process = subprocess.run(
        ["unshare", "-rm", "sh", "-c", f'{mounts} exec "$@"', "sh", sys.executable, "-c", COMMANDS, *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    *texts, _ = process.stderr.split("ended 2\n")
    assert len(texts) == len(runs), process.stderr
    assert "Traceback" not in process.stderr
    for (name, *_), text in zip(runs, texts, strict=True):
        (folder / f"{name.partition('/')[0]}.txt").write_text(text)
    return folder


def test_a_full_disk_is_told_with_what_to_do(on_odd_disks: Path) -> None:
    line = (on_odd_disks / "full.txt").read_text().strip().splitlines()[-1]
    assert str(on_odd_disks / "full") in line
    assert "No space left on device; free some space" in line


def test_a_read_only_disk_is_told_with_what_to_do(on_odd_disks: Path) -> None:
    line = (on_odd_disks / "locked.txt").read_text().strip().splitlines()[-1]
    assert str(on_odd_disks / "locked") in line
    assert "Read-only file system; work in a folder that can be written" in line


@pytest.mark.skipif(not Path("/sys/kernel").is_dir(), reason="no folder that even the superuser may not write")
def test_a_folder_without_permission(monkeypatch, capsys) -> None:
    monkeypatch.setattr(settings, "RUNS", Path("/sys/kernel/runs"))
    assert re.search("/sys/kernel/runs.*take a folder", told(capsys, "run", "sample", "--study", "quick"))


def test_a_file_where_a_folder_is_meant(tmp_path: Path, monkeypatch, capsys) -> None:
    (tmp_path / "runs").touch()
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    message = told(capsys, "run", "sample", "--study", "quick")
    assert re.search("runs.*Not a directory; a folder is asked for", message)


# --- files and values -------------------------------------------------------------------------------------------------

QUICK = (ROOT / "data/studies/quick.toml").read_text()
STUDIES = {
    "deep list": "a = " + "[" * 5000 + "]" * 5000,
    "deep table": "[" + ".".join("a" * 3000) + "]\nx = 1",
    "deep key": ".".join("a" * 3000) + " = 1",
    "long integer": QUICK.replace("count = 50", "count = " + "9" * 5000),
    "long hexadecimal": QUICK.replace("count = 50", "count = 0x" + "f" * 5000),
    "long text": QUICK.replace('experiment = "monte_carlo"', 'experiment = "' + "x" * 100_000 + '"'),
    "long key": QUICK.replace("[samples]", "[samples]\n" + "k" * 100_000 + " = 1"),
    "cycle is a number": "cycle = 5\n" + re.sub(r"\[cycle\].*?(?=\n\[)", "", QUICK, flags=re.S),
    "samples is a list": "samples = [1, 2]\n" + re.sub(r"\[samples\].*?(?=\n\[)", "", QUICK, flags=re.S),
    "too large": "# " + "x" * (1 << 24),
    "a picture": (ROOT / "data/pictures/hysteresis.png").read_bytes(),
    "zeros": b"\0" * 1000,
}


@pytest.mark.parametrize("content", STUDIES.values(), ids=STUDIES)
def test_a_file_that_is_no_study(tmp_path: Path, capsys, content: str | bytes) -> None:
    path = tmp_path / "s.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert told(capsys, "why", "sample", "--study", path).count("s.toml") >= 1


def test_a_unit_on_a_study_that_is_none(tmp_path: Path, capsys) -> None:
    (tmp_path / "d.toml").write_text("disk_profile = 1.0\n")
    for name in ("cycle is a number", "deep table", "a picture"):
        content = STUDIES[name]
        (tmp_path / "s.toml").write_bytes(content if isinstance(content, bytes) else content.encode())
        assert "toml: " in told(
            capsys, "unit", "pham2017", "--dimensions", tmp_path / "d.toml", "--study", tmp_path / "s.toml"
        )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("why", "sample", "--study", "x" * 300), "at most 60; rename"),
        (("why", "sample", "--study", "x" * 300 + ".toml"), "at most 60; rename"),
        (("why", "sample", "--study", "x/" * 3000 + "y.toml"), "shorter|no such file"),
        (("why", "sample", "--study", "a\0b"), "rename"),
        (("why", "sample", "--study", ".."), "rename"),
        (("identify", "--unit", "y" * 5000), "shorter|no such folder"),
        (("unit", "pham2017", "--dimensions", "z" * 300), "shorter|no such file"),
        (("population", "--units", "z" * 300, "--study", "quick"), "no table|shorter"),
        (("population", "--units", ROOT / "data/pictures/hysteresis.png", "--study", "quick"), "zero bytes"),
        (("calibrate", "--targets", ROOT / "data/pictures/hysteresis.png"), "zero bytes; save it as CSV"),
        (("export-ccx", "quick", "--sample", "3", "--crank", "inf"), "no finite number"),
        (("export-ccx", "quick", "--sample", "3", "--crank", "nan"), "no finite number"),
        (("export-ccx", "quick", "--sample", "9" * 5000), "invalid int value"),
        (("run", "--study", "quick", "--jobs", "0"), "at least 1"),
        (("run", "--study", "quick", "--backend", "dask", "--scheduler", "ucx://127.0.0.1:1"), "--scheduler"),
        (("run", "--study", "quick", "--backend", "dask", "--scheduler", "nonsense"), "--scheduler"),
        (("why", "s" * 5000, "--study", "quick"), "unknown"),
    ],
)
def test_a_command_line_that_cannot_be_done(tmp_path, monkeypatch, capsys, arguments, message) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    assert re.search(message, told(capsys, *arguments))


def test_a_study_whose_name_would_leave_the_runs(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    for name in ("..toml", ".hidden.toml", "a b.toml", "-x.toml", "é" * 61 + ".toml"):
        (tmp_path / name).write_text(QUICK)
        assert "rename it" in told(capsys, "run", "sample", "--study", tmp_path / name)
    assert not (tmp_path / "runs").exists()


# --- other errors -----------------------------------------------------------------------------------------------------


def test_what_else_can_happen_has_its_line_and_status() -> None:
    assert cli.answer(InputError(["a", "b"])) == cli.ErrorAnswer(("a", "b"), 2)
    assert cli.answer(ChunkError("add: failed")).status == 1
    assert cli.answer(KeyboardInterrupt()).status == 130
    assert cli.answer(BrokenPipeError()) == cli.ErrorAnswer((), 141)
    assert "--jobs 1" in cli.answer(MemoryError()).lines[0]
    for number in cli.REMEDIES:
        message = cli.answer(OSError(number, os.strerror(number), "a/b.parquet"))
        if not isinstance(OSError(number, ""), BrokenPipeError):
            assert (message.lines[0].startswith("a/b.parquet: "), message.status) == (True, 2)
    line = "p: loop; a link is in its place; move it out of the way"
    assert cli.answer(OSError(errno.ELOOP, "loop", "p")).lines == (line,)


def test_a_fault_of_the_program_leaves_its_traceback_in_a_file(monkeypatch, capsys) -> None:
    def broken(options: object) -> None:
        raise ZeroDivisionError("one by\nnothing")

    monkeypatch.setattr(studies, "reasons", broken)
    assert cli.main(["why", "sample"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    path = Path(line.rsplit(" ", 1)[1])
    assert line.startswith("unexpected ZeroDivisionError: one by nothing; ")
    assert "in broken" in path.read_text()
    path.unlink()


# --- cleaning up ------------------------------------------------------------------------------------------------------


def test_clean_runs_removes_all_but_what_is_linked(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    for name in ("quick/sample/a", ".cache/x/y", "verify/results.csv"):
        (tmp_path / "runs" / name).parent.mkdir(parents=True)
        (tmp_path / "runs" / name).touch()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/precious").touch()
    (tmp_path / "runs/link").symlink_to(tmp_path / "outside")
    assert cli.main(["clean-runs"]) == 0
    assert list((tmp_path / "runs").iterdir()) == []
    assert (tmp_path / "outside/precious").exists()
    assert cli.main(["clean-runs"]) == 0


@pytest.mark.long
def test_clean_runs_during_a_run_removes_nothing(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    (tmp_path / "another").mkdir()
    (tmp_path / "another/a").touch()
    script = "import sys; from pathlib import Path; from pipeline.engine.cache import lock_run\n"
    script += "with lock_run(Path(sys.argv[1])): print('locked', flush=True); input()"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "quick")],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "locked\n"
        assert f"process {process.pid} is writing this run" in told(capsys, "clean-runs")
        assert (tmp_path / "another/a").exists()
        process.communicate("\n")
    with lock_run(tmp_path / "quick"):
        pass
    assert cli.main(["clean-runs"]) == 0


def test_clean_runs_says_what_it_could_not_remove(on_odd_disks: Path) -> None:
    assert "busy/quick: not removed: sample: Device or resource busy" in (on_odd_disks / "busy.txt").read_text()
    assert not (on_odd_disks / "busy/other").exists()

"""SIGKILL at random times of every command that takes long: no process is left, and the next run ends equal."""

from __future__ import annotations

import hashlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest

ROOT = Path(__file__).parents[2]
KILLS = 50
"""Over all commands and numbers of workers."""
GONE_WITHIN = 10.0
"""Seconds after the kill in which the last process ends."""
ADDED = """
[drivers]
base_samples = 32
[tails]
units = 1000
solve = 100
[costs.pin_tangential]
law = "reciprocal"
cost = 4.0
tolerance_um = 6.0
[costs.eccentricity]
law = "power"
exponent = 0.5
cost = 1.0
tolerance_um = 4.0
"""
COMMANDS = {
    "run": ("run", "report", "--study", "killed"),
    "drivers": ("run", "drivers", "--study", "killed"),
    "tails": ("run", "tails", "--study", "killed"),
    "allocate": ("allocate", "--study", "killed", "--yield", "0.5", "--units", "100"),
    "series": ("identify", "--series", "data/measured/series"),
    "identify": ("identify", "--unit", "friction_example"),
}
JOBS = (1, 2, 4)
CASES = [(command, jobs) for command in COMMANDS for jobs in JOBS]
PICTURES_AND_PAGES = (".png", ".svg", ".html")
"""Files that say when they were made."""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small study that has all that takes long, a unit and a series of two states."""
    data = tmp_path_factory.mktemp("home") / "data"
    shutil.copytree(ROOT / "data/designs", data / "designs")
    text = (ROOT / "data/studies/quick.toml").read_text().partition("[model_forms]")[0]
    text = text.replace("count = 50", "count = 12").replace("[0.0, 90.0]", "[0.0]\nrigid_angles = 3")
    text = text.replace("[reduce]", '[reduce]\ndisk = "rigid"') + "[run]\nchunk = 4\n" + ADDED
    (data / "studies").mkdir()
    (data / "studies/killed.toml").write_text(text)
    (data / "studies/quick.toml").write_text(text)
    unit = data / "measured/friction_example"
    shutil.copytree(ROOT / "data/measured/friction_example", unit)
    rows = pd.read_csv(unit / "rows.csv")
    rows[rows["crank_deg"].isin(rows["crank_deg"].unique()[:2])].to_csv(unit / "rows.csv", index=False)
    for number in range(2):
        state = data / f"measured/series/state{number}"
        state.mkdir(parents=True)
        _loops(0.4 + 0.2 * number).to_csv(state / "rows.csv", index=False)
        (state / "unit.toml").write_text(
            f'title = "t"\nlocked = "input"\noffset = "per_position"\n[generic]\nratio = 30.0\n'
            f"rated_torque_Nm = 12.0\n[state]\nvalues = {{hours = {number}.0}}\n"
        )
    return data.parent


def _loops(friction: float) -> pd.DataFrame:
    leg = np.concatenate([np.linspace(a, b, 21)[1:] for a, b in ((0, 12), (12, -12), (-12, 12), (12, 0))])
    torque = np.tile(leg, 4)
    net = torque - friction * np.sign(np.gradient(torque))
    angle = net / 5 + 0.5 * np.tanh(2 * net) + 0.02 * np.random.default_rng(1).standard_normal(len(torque))
    number = np.arange(len(torque)) // len(leg)
    return pd.DataFrame(
        {"cycle": number % 2, "crank_deg": 90.0 * (number // 2), "torque_Nm": torque, "angle_arcmin": angle}
    )


def started(home: Path, runs: Path, command: str, jobs: int, **variables: str) -> subprocess.Popen:
    """A command on its runs below a copy of home; ``variables`` of its environment."""
    root = runs.parent
    (root / "data").mkdir(parents=True, exist_ok=True)
    for name in ("designs", "studies", "measured"):
        if not (root / "data" / name).exists():
            shutil.copytree(home / "data" / name, root / "data" / name)
    if not (root / "data/runs").is_symlink():
        (root / "data/runs").symlink_to(runs, target_is_directory=True)
    runs.mkdir(exist_ok=True)
    words = [sys.executable, "-m", "pipeline", *COMMANDS[command], "--jobs", str(jobs)]
    words = [str(root / word) if word.startswith("data/") else word for word in words]
    environment = os.environ | {"CYCLOID_ROOT": str(root), "PYTHONPATH": str(ROOT), **variables}
    with (root / "log").open("w") as log:
        return subprocess.Popen(words, env=environment, cwd=ROOT, stdout=log, stderr=log, start_new_session=True)


def finished(home: Path, runs: Path, command: str, jobs: int, **variables: str) -> tuple[dict[str, str], float]:
    """Content of an uninterrupted command by file, and its seconds."""
    start = time.monotonic()
    process = started(home, runs, command, jobs, **variables)
    assert process.wait() in (0, 1), (runs.parent / "log").read_text()
    return content_of(runs), time.monotonic() - start


def content_of(runs: Path) -> dict[str, str]:
    """Hash of each result, by its path; of a stage those of its record."""
    content: dict[str, str] = {}
    for path in sorted(runs.rglob("*")):
        name = path.relative_to(runs).as_posix()
        if not path.is_file() or path.suffix in PICTURES_AND_PAGES or re.search(r"(^|/)\.", name):
            continue
        if path.name == "record.json":
            record = json.loads(path.read_text())
            entries = {**record["tables"], **record["files"]}
            kept = {name: entry["hash"] for name, entry in entries.items() if not name.endswith(PICTURES_AND_PAGES)}
            content[name] = json.dumps(kept, sort_keys=True)
        elif not (path.parent / "record.json").exists() and not (path.parent.parent / "record.json").exists():
            content[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return content


def _left(leader: int) -> list[int]:
    """Processes of a session."""
    left = []
    for number in psutil.pids():
        try:
            if os.getsid(number) == leader and psutil.Process(number).status() != psutil.STATUS_ZOMBIE:
                left.append(number)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return left


@cache
def _reference(home: Path, command: str) -> tuple[dict[str, str], float]:
    """Content and seconds of a command that nobody interrupts, all that it needs having been compiled before."""
    finished(home, home / "compiled/runs", "run", 1)
    return finished(home, home / f"reference-{command}/runs", command, 1)


@pytest.mark.attack
@pytest.mark.parametrize(("command", "jobs"), CASES)
def test_killed_at_random_times_nothing_is_left_and_the_results_are_equal(home: Path, command: str, jobs: int) -> None:
    expected, seconds = _reference(home, command)
    rng = random.Random(f"{command} {jobs}")
    number = CASES.index((command, jobs))
    kills = KILLS * (number + 1) // len(CASES) - KILLS * number // len(CASES)
    runs, killed = home / f"{command}-{jobs}/runs", 0
    for _ in range(3 * kills):
        if killed == kills:
            break
        process, start = started(home, runs, command, jobs), time.monotonic()
        ended = start + rng.uniform(0.0, 0.9 * seconds)
        while time.monotonic() < ended and process.poll() is None:
            time.sleep(0.01)
        if process.poll() is None:
            killed += 1
        else:  # it was through, on a machine that is less busy than before: the next one begins anew
            seconds = min(seconds, time.monotonic() - start)
            shutil.rmtree(runs)
        process.kill()
        process.wait()
        waited = time.monotonic()
        while (left := _left(process.pid)) and time.monotonic() < waited + GONE_WITHIN:
            time.sleep(0.05)
        assert left == []
    content, _ = finished(home, runs, command, jobs)
    assert killed == kills
    print(f"{command}, {jobs} workers: killed {killed} times; {len(content)} results")
    assert content == expected

"""Fuzzed tables, settings and command lines: one clear answer each, no traceback, none that lasts."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fuzzed_inputs import SETTINGS_MUTATIONS, TABLE_MUTATIONS

from pipeline import cli, settings
from pipeline.cli.boundary import answer
from pipeline.config import load_design, load_study
from pipeline.errors import InputError
from pipeline.identification.described.description import described
from pipeline.identification.measurement.turning.reading import read_measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.populations.comparison import compared, load_population

ROOT = Path(__file__).parent.parent.parent
POPULATION_METRICS = ("zero_torque_width_arcmin", "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin")
LONGEST = 60.0
"""Seconds of an answer."""
MOST_LINES = 20
SHARES = {
    "measured": 0.25,
    "generic": 0.1,
    "turning": 0.15,
    "population": 0.2,
    "flank": 0.1,
    "study": 0.1,
    "command": 0.1,
}
"""Of the inputs that are fuzzed."""
WORDS = (
    *("run", "why", "show", "check", "compare", "identify", "population", "quick", "report", "sample", "--study"),
    *("--jobs", "-1", "0", "--unit", "--dry-run", "nowhere", "", "\x1b[31m", "../..", "--yield", "2", "é 中", "--help"),
    *("%s{0}", "--over", "worst", "--units"),
)


def _loops() -> pd.DataFrame:
    """Loops of a play, a spring and friction at two positions."""
    torque = np.tile(np.concatenate([np.linspace(a, b, 41)[1:] for a, b in ((0, 12), (12, -12), (-12, 0))]), 4)
    net = torque - 0.5 * np.sign(np.gradient(torque))
    angle = net / 5 + 0.5 * np.tanh(2 * net) + 0.02 * np.random.default_rng(1).standard_normal(len(torque))
    cycle = np.arange(len(torque)) // 120 % 2
    crank = np.where(np.arange(len(torque)) < 240, 0.0, 90.0)
    return pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}).round(5)


def _turn() -> pd.DataFrame:
    """Two turns of the crank in both senses at two torques."""
    parts = []
    for cycle, (torque, sense) in enumerate([(6.0, 1), (6.0, -1), (-6.0, 1), (-6.0, -1)]):
        crank = np.arange(0, 720, 3.0)[::sense]
        angle = torque / 5 + 0.3 * np.sin(np.radians(crank)) + 0.1 * sense
        parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    return pd.concat(parts).round(5)


@cache
def _sound() -> dict[str, str]:
    """The sound input of each kind, as text."""
    rng = np.random.default_rng(2)
    units = pd.DataFrame({"unit": [f"u{k}" for k in range(12)], "crank_deg": 0.0})
    for name, mean in zip(POPULATION_METRICS, (1.0, 1.4, 5.0), strict=True):
        units[name] = rng.normal(mean, 0.05, 12).round(4)
    phases = np.arange(0, 360, 10.0)
    flank = pd.DataFrame({"phase_deg": phases, "deviation_um": np.round(3 * np.sin(np.radians(phases)), 3)})
    tables = {"measured": _loops(), "generic": _loops(), "turning": _turn(), "population": units, "flank": flank}
    study = (ROOT / "data/studies/quick.toml").read_text()
    return {name: table.to_csv(index=False) for name, table in tables.items()} | {"study": study, "command": ""}


UNIT = 'title = "t"\nlocked = "{}"\noffset = "{}"\n{}\n'
DESIGNED = 'design = "pham2017"\nstudy = "quick"\nas_measured = "unknown"'
GENERIC = "[generic]\nratio = 30.0\nrated_torque_Nm = 12.0"


def _read_unit(folder: Path, text: bytes, kind: str) -> object:
    unit = {
        "measured": UNIT.format("input", "per_position", DESIGNED),
        "generic": UNIT.format("input", "per_position", GENERIC),
        "turning": UNIT.format("neither", "common", DESIGNED),
    }[kind]
    (folder / "unit.toml").write_text(unit)
    (folder / "rows.csv").write_bytes(text)
    measurement = read_measurement(load_measured_unit(folder, ROOT))
    assert len(measurement.summary) <= MOST_LINES + 1
    if measurement.fatal:
        raise InputError(measurement.summary[1:])
    if kind == "generic":
        described(measurement)
    _ = measurement.cells, measurement.repeatability, measurement.training_cells, measurement.history
    return measurement.rows.torque, measurement.rows.angle


@cache
def _samples() -> pd.DataFrame:
    rng = np.random.default_rng(3)
    samples = pd.DataFrame({"sample": np.arange(60), "crank_deg": 0.0, "status": "ok"})
    for name, mean in zip(POPULATION_METRICS, (1.0, 1.4, 5.0), strict=True):
        samples[name] = rng.normal(mean, 0.05, len(samples))
    return samples


def _read_population(folder: Path, text: bytes) -> object:
    (folder / "units.csv").write_bytes(text)
    units = load_population(folder / "units.csv")
    compared(units, _samples())
    return tuple(units[name].to_numpy() for name in POPULATION_METRICS if name in units)


def _read_flank(folder: Path, text: bytes) -> object:
    design = (ROOT / "data/designs/pin_in_hole_39.toml").read_text()
    (folder / "design.toml").write_text(f'{design}\n[flank]\nmeasured = "flank.csv"\n')
    (folder / "flank.csv").write_bytes(text)
    return np.array(load_design(folder / "design.toml", ROOT).flank.measured.deviation_um)


def _read_study(folder: Path, text: bytes) -> object:
    (folder / "study.toml").write_bytes(text)
    load_study(folder / "study.toml", ROOT)
    return None


def _run_command(folder: Path, rng: random.Random) -> object:
    words = [rng.choice(WORDS) for _ in range(rng.randrange(5))]
    if {"run", "identify", "compare", "population"} & set(words):
        words.append("--dry-run")
    try:
        status = cli.main(words)
    except SystemExit as error:
        status = error.code
    assert status in (0, 1, 2)
    return None


def answered(kind: str, folder: Path, rng: random.Random) -> str:
    """What becomes of one fuzzed input: "refused" with a clear answer, or "read"."""
    if kind == "command":
        _run_command(folder, rng)
        return "read"
    folder = folder / kind
    folder.mkdir(exist_ok=True)
    sound = _sound()[kind]
    mutation = rng.choice(SETTINGS_MUTATIONS if kind == "study" else TABLE_MUTATIONS)
    text = mutation(rng, sound).encode(rng.choice(["utf-8", "utf-8-sig"] if kind != "study" else ["utf-8"]))
    read: Callable[[Path, bytes], object] = {
        "population": _read_population, "flank": _read_flank, "study": _read_study,
    }.get(kind, lambda folder, text: _read_unit(folder, text, kind))  # fmt: skip
    try:
        read(folder, text)
    except InputError as error:
        lines = answer(error).lines
        return "refused" if 0 < len(lines) <= MOST_LINES and all(line.strip() for line in lines) else "unclear"
    return "read"


@pytest.mark.parametrize(("count", "seed"), [(120, 7), pytest.param(10_000, 1, marks=pytest.mark.attack)])
def test_fuzzed_inputs_get_one_clear_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, count: int, seed: int
) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    rng, outcomes, slowest = random.Random(seed), {}, 0.0
    failed: list[str] = []
    for number in range(count):
        kind = rng.choices(list(SHARES), list(SHARES.values()))[0]
        state = rng.getstate()
        start = time.process_time()
        try:
            outcome = answered(kind, tmp_path, rng)
        except Exception as error:  # a traceback, whatever it says
            failed.append(f"{number} {kind}: {type(error).__name__}: {str(error)[:150]} {state[1][-1]}")
            outcome = "failed"
        slowest = max(slowest, time.process_time() - start)
        outcomes[kind, outcome] = outcomes.get((kind, outcome), 0) + 1
    capsys.readouterr()
    print(f"{count} inputs: {outcomes}; slowest {slowest:.2f} s")
    assert failed == []
    assert not [kind for kind, outcome in outcomes if outcome == "unclear"]
    assert slowest < LONGEST


def test_a_record_out_of_order_is_a_fault(tmp_path: Path) -> None:
    """Of a turning drive no interval is known then, and naming the crank angle ended in an IndexError."""
    head, *rows = _sound()["turning"].splitlines(keepends=True)
    random.Random(0).shuffle(rows)
    with pytest.raises(InputError, match="disordered rows|makes no half turn"):
        _read_unit(tmp_path, (head + "".join(rows)).encode(), "turning")

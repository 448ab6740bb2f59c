"""Fuzzed tables, settings and command lines: one clear answer each, no traceback, nothing unsound without a word."""

from __future__ import annotations

import random
import time
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from fuzz_oracle import Reading, ignored_settings, leaves, naively_read, silence
from fuzzed_inputs import SETTINGS_MUTATIONS, TABLE_MUTATIONS, exchanged_columns, other_dialect, scaled_column

from pipeline import cli, settings
from pipeline.cli import answer
from pipeline.config import load_design, load_study
from pipeline.errors import InputError
from pipeline.identification.described.description import describe
from pipeline.identification.measurement.turning.turning_measurement import read_measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.populations.comparison import load_population, metric_comparisons

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


def _unit_text(kind: str) -> str:
    return {
        "measured": UNIT.format("input", "per_position", DESIGNED),
        "generic": UNIT.format("input", "per_position", GENERIC),
        "turning": UNIT.format("neither", "common", DESIGNED),
    }[kind]


def _read_unit(folder: Path, text: bytes, kind: str) -> Reading:
    (folder / "unit.toml").write_text(_unit_text(kind))
    (folder / "rows.csv").write_bytes(text)
    measurement = read_measurement(load_measured_unit(folder, ROOT))
    assert len(measurement.summary) <= MOST_LINES + 1
    if measurement.fatal:
        raise InputError(measurement.summary[1:])
    if kind == "generic":
        describe(measurement)
    _ = measurement.cells, measurement.repeatability, measurement.training_cells, measurement.history
    values = np.column_stack([measurement.rows.torque, measurement.rows.angle])
    return Reading(values, tuple(measurement.summary[1:]) != _said_of_sound(kind))


@cache
def _said_of_sound(kind: str) -> tuple[str, ...]:
    """Faults of the sound table of a kind: notes on what it has too few of."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "unit.toml").write_text(_unit_text(kind))
        (Path(folder) / "rows.csv").write_text(_sound()[kind])
        return tuple(read_measurement(load_measured_unit(Path(folder), ROOT)).summary[1:])


@cache
def _samples() -> pd.DataFrame:
    rng = np.random.default_rng(3)
    samples = pd.DataFrame({"sample": np.arange(60), "crank_deg": 0.0, "status": "ok"})
    for name, mean in zip(POPULATION_METRICS, (1.0, 1.4, 5.0), strict=True):
        samples[name] = rng.normal(mean, 0.05, len(samples))
    return samples


def _read_population(folder: Path, text: bytes) -> Reading:
    (folder / "units.csv").write_bytes(text)
    units = load_population(folder / "units.csv")
    comparisons = metric_comparisons(units, _samples())
    values = [units[name].to_numpy() if name in units else np.full(len(units), np.nan) for name in POPULATION_METRICS]
    differs = any(comparison.bias.ci_low > 0 or comparison.bias.ci_high < 0 for comparison in comparisons)
    return Reading(np.column_stack(values), differs)


def _read_flank(folder: Path, text: bytes) -> Reading:
    design = (ROOT / "data/designs/pin_in_hole_39.toml").read_text()
    (folder / "design.toml").write_text(f'{design}\n[flank]\nmeasured = "flank.csv"\n')
    (folder / "flank.csv").write_bytes(text)
    deviation = np.array(load_design(folder / "design.toml", ROOT).flank.measured.deviation_um)
    return Reading(deviation.reshape(-1, 1), False)


def _read_study(folder: Path, text: bytes) -> dict:
    (folder / "study.toml").write_bytes(text)
    return load_study(folder / "study.toml", ROOT).model_dump()


@cache
def _read_as_written() -> frozenset[str]:
    """Keys of the sound study that its parsed form has under the same name and with the same value."""
    loaded = dict(leaves(load_study("quick", ROOT).model_dump()))
    return frozenset(key for key, value in leaves(tomllib.loads(_sound()["study"])) if loaded.get(key) == value)


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


MEASURED = ("torque_Nm", "angle_arcmin")
COLUMNS = {
    **dict.fromkeys(("measured", "generic", "turning"), MEASURED),
    "population": POPULATION_METRICS,
    "flank": ("deviation_um",),
}
"""Of numbers, that a reader must have as they are in the file."""


def answered(kind: str, folder: Path, rng: random.Random) -> str:
    """What becomes of one fuzzed input: "refused" with a clear answer, "read", "named", or what is wrong with that."""
    if kind == "command":
        _run_command(folder, rng)
        return "read"
    folder = folder / kind
    folder.mkdir(exist_ok=True)
    sound = _sound()[kind]
    mutation = rng.choice(SETTINGS_MUTATIONS if kind == "study" else TABLE_MUTATIONS)
    text = mutation(rng, sound)
    data = text.encode(rng.choice(["utf-8", "utf-8-sig"] if kind != "study" else ["utf-8"]))
    read: Callable[[Path, bytes], object] = {
        "population": _read_population, "flank": _read_flank, "study": _read_study,
    }.get(kind, lambda folder, data: _read_unit(folder, data, kind))  # fmt: skip
    try:
        reading = read(folder, data)
    except InputError as error:
        lines = answer(error).lines
        if not (0 < len(lines) <= MOST_LINES and all(line.strip() for line in lines)):
            return "unclear"
        return f"refuses what is sound: {lines[0]}" if mutation is other_dialect else "refused"
    if isinstance(reading, dict):
        return "; ".join(ignored_settings(text, reading, _read_as_written())) or "read"
    sound_text = sound if mutation is other_dialect else text
    wrong = silence(reading, naively_read(sound_text, COLUMNS[kind], kind == "population"))
    if not wrong and not reading.named and _is_another_quantity(kind, mutation, sound, text):
        wrong = "silent on columns that are exchanged or in another unit"
    return wrong or ("named" if reading.named else "read")


def _is_another_quantity(kind: str, mutation: Callable, sound: str, text: str) -> bool:
    """Whether the numbers of a column are not of its quantity: exchanged with another column's, or another scale.

    Of a drive without a design nobody knows the scale of the angle, and of a flank nobody the sign of a deviation.
    """
    if mutation not in (exchanged_columns, scaled_column):
        return False
    columns = COLUMNS[kind]
    before, after = (naively_read(source, columns, True).values for source in (sound, text))
    if before.shape != after.shape or np.array_equal(before, after, equal_nan=True):
        return False
    if mutation is exchanged_columns:
        return True
    return kind in ("measured", "population")


@pytest.mark.parametrize(("count", "seed"), [(120, 7), pytest.param(10_000, 1, marks=pytest.mark.attack)])
def test_fuzzed_inputs_get_one_clear_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, count: int, seed: int
) -> None:
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    outcomes, slowest = {}, 0.0
    failed: list[str] = []
    for number in range(count):
        rng = random.Random(f"{seed}:{number}")  # each input by itself: one that fails is made again alone
        kind = rng.choices(list(SHARES), list(SHARES.values()))[0]
        start = time.process_time()
        try:
            outcome = answered(kind, tmp_path, rng)
            if outcome not in ("read", "named", "refused"):
                failed.append(f"{number} {kind}: {outcome}")
                outcome = "wrong"
        except Exception as error:  # a traceback, whatever it says
            failed.append(f"{number} {kind}: {type(error).__name__}: {str(error)[:150]}")
            outcome = "failed"
        slowest = max(slowest, time.process_time() - start)
        outcomes[kind, outcome] = outcomes.get((kind, outcome), 0) + 1
    capsys.readouterr()
    print(f"{count} inputs: {outcomes}; slowest {slowest:.2f} s")
    assert failed == []
    assert slowest < LONGEST


def test_a_record_out_of_order_is_a_fault(tmp_path: Path) -> None:
    """Of a turning drive no interval is known then, and naming the crank angle ended in an IndexError."""
    head, *rows = _sound()["turning"].splitlines(keepends=True)
    random.Random(0).shuffle(rows)
    with pytest.raises(InputError, match="disordered rows|makes no half turn"):
        _read_unit(tmp_path, (head + "".join(rows)).encode(), "turning")

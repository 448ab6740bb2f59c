"""What changed between two measurements of one drive: on generated pairs, and on a rig whose changes are known."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, path_of, write_unit

from pipeline import cli
from pipeline.cli import settings
from pipeline.errors import InputError
from pipeline.identification.change.comparison import CHANGED, NOTHING
from pipeline.identification.change.results import Answer, answer, write
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit

INTERVENTIONS = ROOT.parent / "shared" / "data" / "anti_backlash_interventions"
TEXT = """
title = "A drive on a bench"
locked = "output"
offset = "per_position"
[generic]
ratio = 13.0
rated_torque_Nm = 12.0
"""
CRANKS = (0.0, 70.0, 140.0, 210.0, 280.0)
DRIVE = {"play": 20.0, "friction": 0.6, "load": 0.08, "compliance": 4.0, "zero": 0.0, "ripple": 1.5}


def followed(torque: np.ndarray, drive: dict[str, float], phase: float) -> np.ndarray:
    """Angle [arcmin] row by row; the ripple and the soft start are in no description of the comparison."""
    net, angle = 0.0, []
    for load in torque - drive["zero"]:
        half = drive["friction"] + drive["load"] * abs(load)
        net = min(max(net, load - half), load + half)
        crossed = 0.5 * drive["play"] * np.tanh(8 * net)
        angle.append(
            crossed + drive["compliance"] * net + 3.0 * np.tanh(net / 3) + drive["ripple"] * np.sin(net + phase)
        )
    return np.array(angle)


def drive_measured(folder: Path, by: dict[str, float], mounting: float, seed: int, cranks=CRANKS) -> Measurement:
    """A drive with shares of its numbers added, each also scattered by the ``mounting`` at every position."""
    rng = np.random.default_rng(seed)
    parts = []
    for number, crank in enumerate(cranks):
        scatter = dict(zip(DRIVE, 1 + mounting * rng.standard_normal(len(DRIVE)), strict=True))
        drive = {name: scatter[name] * value * (1 + by.get(name, 0.0)) for name, value in DRIVE.items()}
        drive["zero"] = by.get("zero", 0.0) + 0.3 * mounting * rng.standard_normal()
        torque = np.tile(path_of([0.0, 12.0, -12.0, 0.0], 60)[1:], 2)
        angle = followed(torque, drive, 2.0 * number) + 50.0 * rng.random() + 0.05 * rng.standard_normal(torque.size)
        cycle = np.repeat([0, 1], torque.size // 2)
        parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    write_unit(folder, {"rows.csv": pd.concat(parts, ignore_index=True)}, TEXT)
    return Measurement.read(load_measured_unit(folder, ROOT))


def pair(folder: Path, by: dict[str, float], mounting: float = 0.04, seed: int = 1, cranks=CRANKS) -> Answer:
    before = drive_measured(folder / "before", {}, mounting, seed, cranks)
    return answer(before, drive_measured(folder / "after", by, mounting, seed + 1000, cranks))


@pytest.mark.parametrize(
    ("by", "words", "kind", "true"),
    [
        ({"friction": 0.5}, "friction grows", "friction", 0.3),
        ({"friction": -0.5}, "friction falls", "friction", -0.3),
        ({"play": -0.3}, "play closes", "play", -6.0),
        ({"compliance": 0.2}, "stiffness falls", "compliance", 0.2 * 48 / 51),
    ],
)
def test_what_changed_is_named_with_its_sign_and_size(tmp_path, by, words, kind, true):
    found = pair(tmp_path, by, mounting=0.02).found
    assert found.verdict == CHANGED
    assert found.named[0].words == words
    (low,), (high,) = found.named[0].low, found.named[0].high
    assert low < found.named[0].mean[0] < high
    assert found.named[0].mean[0] == pytest.approx(true, rel=0.25)
    assert found.named[0].gain < 0.75
    assert [one.kinds[0].name for one in found.named] == [kind]


def test_where_nothing_changed_nothing_is_named(tmp_path):
    verdicts = [pair(tmp_path / str(seed), {}, seed=seed).found.verdict for seed in range(4)]
    assert verdicts.count(NOTHING) >= 3


def test_two_changes_are_named_together(tmp_path):
    found = pair(tmp_path, {"friction": 0.6, "compliance": 0.25}, mounting=0.02).found
    assert found.named[0].words == "friction grows and stiffness falls"
    assert found.verdict == CHANGED


def test_a_torque_that_reads_another_zero_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(DRIVE, "ripple", 0.2)  # a ripple shifts with the torque and drops out of no difference
    found = pair(tmp_path, {"zero": 0.8}, mounting=0.0).found
    assert found.named[0].words == "zero of the torque rises, or a preload"
    assert found.named[0].mean[0] == pytest.approx(0.8, rel=0.35)


def test_one_position_claims_nothing_and_says_why(tmp_path):
    found = pair(tmp_path, {"friction": 0.5}, cranks=(0.0,))
    assert found.found.verdict == NOTHING
    assert "at 1 position" in found.sentence
    assert "3 or more crank positions" in found.advice


def test_positions_that_were_shuffled_are_seen(tmp_path):
    before = drive_measured(tmp_path / "before", {}, 0.1, 1)
    same = answer(before, drive_measured(tmp_path / "same", {}, 0.1, 1)).positions
    other = answer(before, drive_measured(tmp_path / "other", {}, 0.1, 2, CRANKS[::-1])).positions
    assert same.kept
    assert not other.kept
    assert same.pairings == 120


def test_the_files_hold_what_the_sentence_says(tmp_path):
    found = pair(tmp_path, {"friction": 0.5}, mounting=0.02)
    write(found, tmp_path / "out")
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    changes = pd.read_parquet(tmp_path / "out" / "changes.parquet")
    changes = changes[changes["others"] == found.found.best.others].set_index("kind")
    cells = pd.read_parquet(tmp_path / "out" / "difference.parquet")
    assert verdict["sentence"] == found.sentence
    assert changes.loc["friction", "named"]
    assert f"{changes.loc['friction', 'change']:+.3g} N m" in verdict["sentence"]
    left = [
        np.sum(((cells["difference_arcmin"] - cells[f"{name}_arcmin"]) / cells["sigma_arcmin"]) ** 2)
        for name in ("held_out", "without")
    ]
    assert np.sqrt(left[0] / left[1]) == pytest.approx(found.found.named[0].gain, rel=0.02)


def test_the_command_writes_a_page_that_says_what_it_prints(tmp_path, monkeypatch, capsys):
    for name, by, seed in (("before", {}, 1), ("after", {"play": -0.3}, 2)):
        drive_measured(tmp_path / name, by, 0.02, seed, CRANKS[:3])
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    assert cli.main(["changed", "--before", str(tmp_path / "before"), "--after", str(tmp_path / "after")]) == 0
    printed = capsys.readouterr().out
    page = (tmp_path / "runs" / "changed" / "before-after" / "report.html").read_text().replace("\u00a0", " ")
    assert "play closes" in printed
    assert next(line for line in printed.splitlines() if "play closes" in line).split(": ", 1)[1] in page


def test_measurements_with_nothing_in_common_are_refused(tmp_path):
    before = drive_measured(tmp_path / "before", {}, 0.0, 1, (0.0, 90.0))
    with pytest.raises(InputError, match="no crank angle was measured in both: before 0, 90 and after 45 deg"):
        answer(before, drive_measured(tmp_path / "after", {}, 0.0, 1, (45.0,)))
    after = drive_measured(tmp_path / "after", {}, 0.0, 1, (0.0, 90.0))
    text = TEXT.replace('"output"', '"input"')
    (tmp_path / "after" / "unit.toml").write_text(text)
    with pytest.raises(InputError, match="one end locked"):
        answer(before, Measurement.read(load_measured_unit(tmp_path / "after", ROOT)))
    assert after.unit.rated_torque_Nm == 12.0


RIG = """
title = "{name}"
locked = "output"
offset = "per_position"
[generic]
ratio = 13.0
rated_torque_Nm = 40.0
[instrument]
angle_resolution_arcmin = 0.33
[columns]
cycle = {{name = "test_nr"}}
angle_arcmin = {{name = "POSITION", unit = "rev"}}
torque_Nm = {{name = "TORQUE"}}
command_torque_Nm = {{name = "CONTROL_TORQUE"}}
time_s = {{name = "TIME"}}
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Measurements of the rig by state; its loops to +-4 N m."""

    @cache
    def state(name: str, again: bool = False) -> Measurement:
        folder = tmp_path_factory.mktemp(name)
        text = RIG.format(name=name)
        for path in sorted((INTERVENTIONS / name).glob("*_again.csv.gz" if again else "position?.csv.gz")):
            rows = pd.read_csv(path)
            rows[rows["test_nr"] < 5].to_csv(folder / path.name, index=False)
            text += f'[[files]]\npath = "{path.name}"\ncrank_deg = {path.name[8]}.0\n'
        (folder / "unit.toml").write_text(text)
        return Measurement.read(load_measured_unit(folder, ROOT))

    return state


@pytest.mark.skipif(not INTERVENTIONS.is_dir(), reason="the measured interventions are not here")
def test_a_drive_that_was_preloaded_is_told_and_one_measured_twice_is_not(rig):
    found = answer(rig("conic_onyx_runin"), rig("conic_onyx_2pre")).found
    assert not found.named  # three positions, and a scatter between them that leaves two degrees of freedom
    assert {"stiffness grows"} <= {change.words for change in found.near} <= {"stiffness grows", "play closes"}
    assert answer(rig("conic_onyx_runin"), rig("conic_onyx_runin", again=True)).found.verdict == NOTHING


@pytest.mark.attack
@pytest.mark.skipif(not INTERVENTIONS.is_dir(), reason="the measured interventions are not here")
def test_the_known_interventions_have_their_class_and_sign(rig):
    def words(before: str, after: str) -> list[str]:
        return [change.words for change in answer(rig(before), rig(after)).found.near]

    assert words("split_pccf_runin", "split_pccf_1pre") == ["play closes"]
    assert words("split_pccf_1pre", "split_pccf_reassembled") == ["play opens"]
    assert words("split_pccf_runin", "split_pccf_reassembled") == []
    assert words("conic_onyx_2pre", "conic_onyx_3pre") == []
    assert words("conic_onyx_3pre", "conic_onyx_4pre") == []
    assert answer(rig("conic_onyx_1pre"), rig("conic_onyx_1pre", again=True)).found.verdict == NOTHING

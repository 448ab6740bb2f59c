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
from pipeline.identification.change.results import ChangeAnswer, answer, write
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


def drive_measured(folder: Path, changes: dict[str, float], mounting: float, seed: int, cranks=CRANKS) -> Measurement:
    """A drive with shares of its numbers added, each also scattered by the ``mounting`` at every position."""
    rng = np.random.default_rng(seed)
    parts = []
    for number, crank in enumerate(cranks):
        scatter = dict(zip(DRIVE, 1 + mounting * rng.standard_normal(len(DRIVE)), strict=True))
        drive = {name: scatter[name] * value * (1 + changes.get(name, 0.0)) for name, value in DRIVE.items()}
        drive["zero"] = changes.get("zero", 0.0) + 0.3 * mounting * rng.standard_normal()
        torque = np.tile(path_of([0.0, 12.0, -12.0, 0.0], 60)[1:], 2)
        angle = followed(torque, drive, 2.0 * number) + 50.0 * rng.random() + 0.05 * rng.standard_normal(torque.size)
        cycle = np.repeat([0, 1], torque.size // 2)
        parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    write_unit(folder, {"rows.csv": pd.concat(parts, ignore_index=True)}, TEXT)
    return Measurement.read(load_measured_unit(folder, ROOT))


def pair(folder: Path, changes: dict[str, float], mounting: float = 0.04, seed: int = 1, cranks=CRANKS) -> ChangeAnswer:
    state_before = drive_measured(folder / "before", {}, mounting, seed, cranks)
    return answer(state_before, drive_measured(folder / "after", changes, mounting, seed + 1000, cranks))


@pytest.mark.parametrize(
    ("changes", "words", "kind", "true"),
    [
        ({"friction": 0.5}, "friction grows", "friction", 0.3),
        ({"friction": -0.5}, "friction falls", "friction", -0.3),
        ({"play": -0.3}, "play closes", "play", -6.0),
        ({"compliance": 0.2}, "stiffness falls", "compliance", 0.2 * 48 / 51),
    ],
)
def test_what_changed_is_named_with_its_sign_and_size(tmp_path, changes, words, kind, true):
    result = pair(tmp_path, changes, mounting=0.02).comparison
    assert result.verdict == CHANGED
    assert result.named[0].words == words
    (low,), (high,) = result.named[0].low, result.named[0].high
    assert low < result.named[0].mean[0] < high
    assert result.named[0].mean[0] == pytest.approx(true, rel=0.25)
    assert result.named[0].gain < 0.75
    assert [change.kinds[0].name for change in result.named] == [kind]


def test_the_interval_of_a_change_that_all_positions_agree_upon_holds_what_the_model_misses(tmp_path, monkeypatch):
    monkeypatch.setitem(DRIVE, "ripple", 0.0)
    change = pair(tmp_path, {"friction": 0.5}, mounting=0.0).comparison.named[0]
    error = change.by_position.std(ddof=1) / np.sqrt(len(change.by_position))
    assert abs(change.mean[0] - 0.3) > 4 * error  # positions alike do not say what play with soft ends adds
    assert change.low[0] < 0.3 < change.high[0] < 0.36


def test_where_nothing_changed_nothing_is_named(tmp_path):
    verdicts = [pair(tmp_path / str(seed), {}, seed=seed).comparison.verdict for seed in range(4)]
    assert verdicts.count(NOTHING) >= 3


def test_two_changes_are_named_together(tmp_path):
    result = pair(tmp_path, {"friction": 0.6, "compliance": 0.25}, mounting=0.02).comparison
    assert result.named[0].words == "friction grows and stiffness falls"
    assert result.verdict == CHANGED


def test_further_states_show_what_three_positions_alone_do_not(tmp_path):
    cranks = CRANKS[:3]
    state_before = drive_measured(tmp_path / "before", {}, 0.04, 1, cranks)
    state_after = drive_measured(tmp_path / "after", {"friction": 0.5}, 0.04, 1001, cranks)
    further = [drive_measured(tmp_path / str(seed), {}, 0.04, seed, cranks) for seed in (2001, 3001, 4001)]
    alone, result = answer(state_before, state_after), answer(state_before, state_after, further)
    assert not alone.comparison.named
    assert [change.words for change in result.comparison.named] == ["friction grows"]
    assert result.comparison.named[0].freedom == 8
    assert "could hide" in alone.limits_sentence
    assert "scatter over the positions of 2 states (2 degrees of freedom)" in alone.limits_sentence
    limits = [change.detectable[0] for change in alone.comparison.beside]
    assert all(limit > abs(change.mean[0]) for limit, change in zip(limits, alone.comparison.beside, strict=True))
    lacking = drive_measured(tmp_path / "lacking", {}, 0.04, 5001, CRANKS[:2])
    with pytest.raises(InputError, match="lacking: nothing to compare at 140 deg"):
        answer(state_before, state_after, [lacking])


def test_a_state_that_is_named_twice_is_refused(tmp_path):
    """The scatter would seem to be known better by it: four copies of two states name a change that is not there."""
    state_before, state_after = (drive_measured(tmp_path / name, {}, 0.04, 1, CRANKS[:3]) for name in "ab")
    repeat = Measurement.read(load_measured_unit(tmp_path / "b" / ".." / "b", ROOT))
    for second, others in ((state_after, [repeat]), (state_after, [state_before]), (state_before, [])):
        with pytest.raises(InputError, match="[ab]: named 2 times; each state counts once"):
            answer(state_before, second, others)


def test_a_torque_that_reads_another_zero_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(DRIVE, "ripple", 0.2)  # a ripple shifts with the torque and drops out of no difference
    result = pair(tmp_path, {"zero": 0.8}, mounting=0.0).comparison
    assert result.named[0].words == "zero of the torque rises, or a preload"
    assert result.named[0].mean[0] == pytest.approx(0.8, rel=0.35)


def test_one_position_claims_nothing_and_says_why(tmp_path):
    result = pair(tmp_path, {"friction": 0.5}, cranks=(0.0,))
    assert result.comparison.verdict == NOTHING
    assert "at 1 position" in result.sentence
    assert "3 or more crank positions" in result.advice


def test_positions_that_were_shuffled_are_seen(tmp_path):
    state_before = drive_measured(tmp_path / "before", {}, 0.1, 1)
    positions_of_shuffled = answer(state_before, drive_measured(tmp_path / "same", {}, 0.1, 1)).positions
    variant = answer(state_before, drive_measured(tmp_path / "other", {}, 0.1, 2, CRANKS[::-1])).positions
    assert positions_of_shuffled.persists
    assert not variant.persists
    assert positions_of_shuffled.pairings == 120


def test_the_files_hold_what_the_sentence_says(tmp_path):
    result = pair(tmp_path, {"friction": 0.5}, mounting=0.02)
    write(result, tmp_path / "out")
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    changes = pd.read_parquet(tmp_path / "out" / "changes.parquet")
    changes = changes[changes["others"] == result.comparison.best.other_kinds].set_index("kind")
    cells = pd.read_parquet(tmp_path / "out" / "difference.parquet")
    assert verdict["sentence"] == result.sentence
    assert changes.loc["friction", "named"]
    assert f"{changes.loc['friction', 'change']:+.3g} N m" in verdict["sentence"]
    residuals = [
        np.sum(((cells["difference_arcmin"] - cells[f"{name}_arcmin"]) / cells["sigma_arcmin"]) ** 2)
        for name in ("held_out", "without")
    ]
    assert np.sqrt(residuals[0] / residuals[1]) == pytest.approx(result.comparison.named[0].gain, rel=0.02)


def test_the_command_writes_a_page_that_says_what_it_prints(tmp_path, monkeypatch, capsys):
    for name, changes, seed in (("before", {}, 1), ("after", {"play": -0.3}, 2)):
        drive_measured(tmp_path / name, changes, 0.02, seed, CRANKS[:3])
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    assert cli.main(["changed", "--before", str(tmp_path / "before"), "--after", str(tmp_path / "after")]) == 0
    printed = capsys.readouterr().out
    page = (tmp_path / "runs" / "changed" / "before-after" / "report.html").read_text().replace("\u00a0", " ")
    assert "play closes" in printed
    assert next(line for line in printed.splitlines() if "play closes" in line).split(": ", 1)[1] in page


def test_measurements_with_nothing_in_common_are_refused(tmp_path):
    state_before = drive_measured(tmp_path / "before", {}, 0.0, 1, (0.0, 90.0))
    with pytest.raises(InputError, match="no crank angle was measured in both: before 0, 90 and after 45 deg"):
        answer(state_before, drive_measured(tmp_path / "after", {}, 0.0, 1, (45.0,)))
    state_after = drive_measured(tmp_path / "after", {}, 0.0, 1, (0.0, 90.0))
    text = TEXT.replace('"output"', '"input"')
    (tmp_path / "after" / "unit.toml").write_text(text)
    with pytest.raises(InputError, match="one end locked"):
        answer(state_before, Measurement.read(load_measured_unit(tmp_path / "after", ROOT)))
    assert state_after.unit.rated_torque_Nm == 12.0


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
    def state(name: str, repeat: bool = False) -> Measurement:
        folder = tmp_path_factory.mktemp(name)
        text = RIG.format(name=name)
        for path in sorted((INTERVENTIONS / name).glob("*_again.csv.gz" if repeat else "position?.csv.gz")):
            rows = pd.read_csv(path)
            rows[rows["test_nr"] < 5].to_csv(folder / path.name, index=False)
            text += f'[[files]]\npath = "{path.name}"\ncrank_deg = {path.name[8]}.0\n'
        (folder / "unit.toml").write_text(text)
        return Measurement.read(load_measured_unit(folder, ROOT))

    return state


@pytest.mark.skipif(not INTERVENTIONS.is_dir(), reason="the measured interventions are not here")
def test_a_drive_that_was_preloaded_is_told_and_one_measured_twice_is_not(rig):
    result = answer(rig("conic_onyx_runin"), rig("conic_onyx_2pre")).comparison
    assert not result.named  # three positions, and a scatter between them that leaves two degrees of freedom
    assert {"stiffness grows"} <= {change.words for change in result.near} <= {"stiffness grows", "play closes"}
    assert answer(rig("conic_onyx_runin"), rig("conic_onyx_runin", repeat=True)).comparison.verdict == NOTHING


@pytest.mark.attack
@pytest.mark.skipif(not INTERVENTIONS.is_dir(), reason="the measured interventions are not here")
def test_the_known_interventions_have_their_class_and_sign(rig):
    def words(state_before: str, state_after: str) -> list[str]:
        return [change.words for change in answer(rig(state_before), rig(state_after)).comparison.near]

    assert words("split_pccf_runin", "split_pccf_1pre") == ["play closes"]
    assert words("split_pccf_1pre", "split_pccf_reassembled") == ["play opens"]
    assert words("split_pccf_runin", "split_pccf_reassembled") == []
    assert words("conic_onyx_2pre", "conic_onyx_3pre") == []
    assert words("conic_onyx_3pre", "conic_onyx_4pre") == []
    assert answer(rig("conic_onyx_1pre"), rig("conic_onyx_1pre", repeat=True)).comparison.verdict == NOTHING

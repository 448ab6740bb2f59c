"""Drives of which no design is known: what is claimed of them, how they may be driven, and what is refused."""

import json

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, path_of, write_unit

from pipeline import cli, settings
from pipeline.errors import InputError
from pipeline.identification.described.description import FULLY_DESCRIBED, describe
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.library.measured import identify

TEXT = """
title = "A drive on a bench"
locked = "{locked}"
offset = "per_position"
[generic]
ratio = 30.0
rated_torque_Nm = 12.0
"""
CRANKS = (0.0, 90.0, 180.0)
DRIVE = {"play": 6.0, "friction": 0.7, "load_friction": 0.1, "compliance": 0.8}


def followed(torque: np.ndarray, drive: dict[str, float]) -> np.ndarray:
    """Angle [arcmin] along torques, element by element: a slider that holds the spring back."""
    angle, spring, share = [], 0.0, drive["load_friction"]
    for load in torque:
        rising, falling = load - drive["friction"], load + drive["friction"]
        rising /= 1 + share * np.sign(rising)
        falling /= 1 - share * np.sign(falling)
        spring = rising if spring < rising else falling if spring > falling else spring
        gap = 0.5 * drive["play"] * np.sign(spring) * (1 - np.exp(-abs(spring) / 0.24))
        angle.append(gap + drive["compliance"] * spring)
    return np.array(angle)


def driven_by_angle(torque: np.ndarray, angle: np.ndarray, rows: int) -> np.ndarray:
    """Rows at equal steps of the angle that a motor runs through, as a servo that is told an angle takes them."""
    arc = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)) + 1e-6)])
    return np.searchsorted(arc, np.linspace(0.0, arc[-1], rows))


def drive_measured(folder, changes=None, by_angle=False, locked="input", noise=0.1) -> Measurement:
    drive, rng, parts = {**DRIVE, **(changes or {})}, np.random.default_rng(5), []
    for number, crank in enumerate(CRANKS):
        torque = np.tile(path_of([0.0, 12.0, -12.0, 0.0], 4000 if by_angle else 80)[1:], 3)
        angle = followed(torque, drive)
        rows_kept = driven_by_angle(torque, angle, 1500) if by_angle else np.arange(len(torque))
        cycle = np.minimum(rows_kept // (len(torque) // 3), 2)
        noisy = angle[rows_kept] + 7.0 * number + noise * rng.standard_normal(len(rows_kept))
        measured = torque[rows_kept] + (0.01 * rng.standard_normal(len(rows_kept)) if by_angle else 0.0)
        parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": measured, "angle_arcmin": noisy}))
    write_unit(folder, {"rows.csv": pd.concat(parts, ignore_index=True)}, TEXT.format(locked=locked))
    return Measurement.read(load_measured_unit(folder, ROOT))


@pytest.mark.parametrize(
    ("by_angle", "locked"),
    [pytest.param(False, "input", marks=pytest.mark.attack), (False, "output"), (True, "input")],
)
@pytest.mark.long
def test_play_and_friction_are_claimed_with_their_size(tmp_path, by_angle, locked):
    description = describe(drive_measured(tmp_path / "u", by_angle=by_angle, locked=locked))
    numbers = {number.term: number for number in description.numbers}
    assert numbers["torque_zero"].named is False
    for term in ("play", "friction", "load_friction"):
        assert numbers[term].named
        assert numbers[term].value == pytest.approx(DRIVE[term], rel=0.1)
    compliance = next(number for number in description.numbers if number.name.startswith("compliance"))
    assert compliance.value == pytest.approx(DRIVE["compliance"], rel=0.05)
    if not by_angle:
        assert description.verdict == FULLY_DESCRIBED
        assert description.errors["described"].rms_arcmin < 0.05 * description.errors["spring"].rms_arcmin


@pytest.mark.long
def test_a_spring_alone_has_nothing_claimed(tmp_path):
    bare_spring = dict.fromkeys(("play", "friction", "load_friction"), 0.0)
    description = describe(drive_measured(tmp_path / "u", bare_spring))
    assert not any(number.named for number in description.numbers)
    assert description.errors["described"].to_noise < 1.25


@pytest.mark.long
def test_held_out_rows_move_no_prediction_by_more_than_their_offset(tmp_path):
    measurement_before = drive_measured(tmp_path / "a")
    rows = pd.read_csv(tmp_path / "a" / "rows.csv")
    is_last = rows["crank_deg"] == CRANKS[-1]
    rows.loc[is_last, "angle_arcmin"] *= 1.4
    text = TEXT.format(locked="input") + '[held_out]\nby = "position"\ntrain = [0.0, 90.0]\n'
    (tmp_path / "a" / "unit.toml").write_text(text)
    write_unit(tmp_path / "b", {"rows.csv": rows}, text)
    description_before, description_after = (
        describe(Measurement.read(load_measured_unit(tmp_path / name, ROOT))) for name in "ab"
    )
    difference = (description_before.curves["described"] - description_after.curves["described"])[
        description_before.cells
    ]
    assert np.ptp(difference) < 1e-9
    assert [n.value for n in description_before.numbers] == [n.value for n in description_after.numbers]
    assert measurement_before.unit.design_study is None


@pytest.mark.long
def test_the_command_judges_first_and_writes_a_page(tmp_path, monkeypatch, capsys):
    drive_measured(tmp_path / "u", locked="output")
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    assert cli.main(["identify", "--unit", str(tmp_path / "u")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("reading")
    assert "3 crank angles" in lines[1]
    assert lines[2].startswith("plan: play, friction and a spring")
    folder = tmp_path / "runs" / "identify" / "u"
    verdict = json.loads((folder / "verdict.json").read_text())
    page = (folder / "report.html").read_text().replace("\u00a0", " ")
    assert verdict["sentence"] in page
    assert f"{verdict['held_out_errors']['described']['rms_arcmin']:.3g} arcmin" in verdict["sentence"]
    assert "The input turns by" in page
    assert len(pd.read_parquet(folder / "description.parquet")) > 100


def test_a_crank_that_turns_within_a_loop_is_refused(tmp_path, capsys, monkeypatch):
    drive_measured(tmp_path / "u")
    rows = pd.read_csv(tmp_path / "u" / "rows.csv")
    rows["crank_deg"] += np.linspace(0.0, 80.0, len(rows))
    rows.to_csv(tmp_path / "u" / "rows.csv", index=False)
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    assert cli.main(["identify", "--unit", str(tmp_path / "u")]) == 0
    assert "the crank turns within a cycle" in capsys.readouterr().out


def test_a_drive_is_generic_or_has_a_design(tmp_path):
    text = TEXT.format(locked="input")
    folder = write_unit(tmp_path / "u", text=f'design = "pham2017"\n{text}')
    with pytest.raises(InputError, match=r'design = "pham2017"; a drive with \[generic\] has none'):
        load_measured_unit(folder, ROOT)
    (folder / "unit.toml").write_text(text.split("[generic]")[0])
    with pytest.raises(InputError, match=r"design is missing; add it, or \[generic\]"):
        load_measured_unit(folder, ROOT)


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"torque_Nm": "angle_arcmin", "angle_arcmin": "torque_Nm"}, "swapped columns"),
        ({"angle_arcmin": -1.0}, "sign"),
        ({"angle_arcmin": 1 / 3437.75}, "unit"),
        ({"torque_Nm": 1e3}, "unit"),
        ({"torque_Nm": 1e-3}, "unit"),
    ],
)
def test_columns_that_are_exchanged_or_scaled_are_faults_before_any_fit(tmp_path, change, kind):
    drive_measured(tmp_path / "right")
    table = pd.read_csv(tmp_path / "right/rows.csv")
    wrong = table.assign(
        **{name: table[of] if isinstance(of, str) else of * table[name] for name, of in change.items()}
    )
    measurement = Measurement.read(
        load_measured_unit(write_unit(tmp_path / "wrong", {"rows.csv": wrong}, TEXT.format(locked="input")), ROOT)
    )
    assert kind in [fault.kind for fault in measurement.fatal]


def test_rows_in_reversed_time_are_a_fault(tmp_path):
    drive_measured(tmp_path / "right")
    table = pd.read_csv(tmp_path / "right/rows.csv")[::-1].assign(cycle=lambda rows: 2 - rows["cycle"])
    folder = write_unit(tmp_path / "wrong", {"rows.csv": table}, TEXT.format(locked="input"))
    assert [fault.kind for fault in Measurement.read(load_measured_unit(folder, ROOT)).fatal] == ["swapped columns"]


def test_results_of_another_folder_of_the_same_name_are_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    folders = [tmp_path / place / "unit" for place in ("first", "second")]
    for folder in folders:
        drive_measured(folder)
        table = pd.read_csv(folder / "rows.csv")
        write_unit(folder, {"rows.csv": table.assign(torque_Nm=1e3 * table["torque_Nm"])}, TEXT.format(locked="input"))
    verdict = identify(folders[0]).folder / "verdict.json"
    content = verdict.read_bytes()
    with pytest.raises(InputError, match=r"has the results of .*first/unit, .* overwritten by those of .*second/unit"):
        identify(folders[1])
    assert verdict.read_bytes() == content
    identify(folders[0])
    folders[0].rename(tmp_path / "moved")
    identify(folders[1])

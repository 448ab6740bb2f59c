"""One unit over a turn of the output: condensation by symmetry against fresh ones, and against the stages."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import assembly, cli, settings
from pipeline.config import Study, load_design, load_study, parse_study
from pipeline.elastic import disk_patches, elastic_disk
from pipeline.model.load_history.response import respond
from pipeline.mounting import drive_of
from pipeline.populations import output_turn
from pipeline.populations.output_turn import PHASES, free_error, loaded_error, loaded_steps, rigid_cranks
from pipeline.populations.turn_drives import TurnDrives, Units, full_blocks
from pipeline.sampling.errors import draw

ROOT = Path(__file__).parents[2]


def coarse(**cycle: object) -> Study:
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 2
    data["cycle"] |= {"keep_contacts": [], **cycle}
    data["reduce"] |= {"flank_edges_per_lobe": 12, "patch_half_width_mm": 0.3, "growth": 1.0, "largest_edge_mm": 3.0}
    return parse_study(data, "turn", "turn.toml", lambda design: load_design(design, ROOT))


@pytest.mark.long
def test_two_disks_with_holes_under_load_are_those_of_fresh_condensations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the first repetition of the eccentric in the disk, each disk meshed and condensed at the angle itself."""
    data = tomllib.loads((ROOT / "data/studies/two_disks.toml").read_text(encoding="utf-8"))
    data["reduce"] |= {"flank_edges_per_lobe": 8, "patch_half_width_mm": 1.2, "growth": 1.0, "largest_edge_mm": 8.0}
    data["reduce"]["roller_patch_half_width_mm"] = 2.0
    study = parse_study(data, "turn", "turn.toml", lambda design: load_design(design, ROOT))
    clockings = assembly.clockings(study.design)
    bodies = [elastic_disk(study, clocking.hole_rotation) for clocking in clockings]

    def condense(crank: float) -> list[np.ndarray]:
        reducer = assembly.reducer(study.design, crank)
        return [bodies[k].compliance(disk_patches(study, bodies[k], reducer, k)).matrix for k in range(2)]

    steps = np.array([3, 700, 1500])
    monkeypatch.setattr(output_turn, "loaded_steps", lambda study, phases: steps)
    drives, unit = TurnDrives.from_blocks(study, 1, [full_blocks(study, 0.0, condense)]), draw(study, 1, 2)
    turn, units = loaded_error(drives, unit), Units.from_errors(study, unit)
    held = 1000.0 * assembly.definitions(study).rigidity_high
    for k, crank in enumerate(np.degrees(turn.crank)):
        reducer = assembly.reducer(study.design, crank)
        full = np.zeros((len(reducer.contacts), len(reducer.contacts)))
        for disk, matrix in enumerate(condense(crank)):
            rows = assembly.disk_contacts(reducer, disk)
            full[np.ix_(rows, rows)] = matrix
        response = respond(drive_of(study, crank, full, units.errors, units.clearance), drives.cycle)
        ends = [np.flatnonzero(np.isclose(response.torque, sense * held))[-1] for sense in (1, -1)]
        expected = np.degrees(response.angle[0, ends]) * 3600
        np.testing.assert_allclose(turn.error[:, k], expected, rtol=1e-5)
    assert np.ptp(turn.error[0]) > 0.1  # [arcsec]


def test_angles_of_the_output_turn_are_even_and_see_every_phase_alike() -> None:
    study = coarse()
    steps = loaded_steps(study)
    assert len(np.unique(np.diff(steps))) == 1
    assert len(steps) * np.diff(steps)[0] == 80 * 79 * PHASES
    assert len(set(np.bincount(steps % PHASES))) == 1
    cranks = rigid_cranks(study)
    np.testing.assert_allclose(np.diff(cranks), 2 * np.pi / 161)
    assert len(cranks) == 161 * 79


def test_a_unit_after_turns_of_the_crank_is_one_with_other_lobes_at_the_pins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the reducer at the crank angle itself, turn for turn, with every error that turns with the disk."""
    study, rng = coarse(), np.random.default_rng(3)
    unit = draw(study, 1, 2)
    amounts = {"lobe_pitch": rng.normal(size=(1, 79)), "bore_runout_amplitude": np.array([2.0])}
    amounts |= {"bore_runout_phase": np.array([0.7]), "pin_radius": unit.pin_radius - 5.0}
    unit = type(unit)(**(vars(unit) | amounts))
    monkeypatch.setattr(output_turn, "rigid_cranks", lambda study: 2 * np.pi * np.arange(2 * 79) / 2)
    rotation = free_error(study, unit)
    monkeypatch.setattr(output_turn, "_turns_alike", lambda study: False)
    angle_by_angle = free_error(study, unit)
    np.testing.assert_allclose(rotation.error, angle_by_angle.error, atol=1e-9 * np.abs(rotation.error).max())
    assert np.ptp(rotation.error[:, ::2], axis=1).min() > 0.1  # of the turns at one crank angle [arcsec]


def test_a_carrier_with_tight_bearings_is_another_unit_after_each_turn_of_the_crank(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sun's run-out has turned by (R - 1)/Z turns against the carrier; taken for alike, turns had one play."""
    study = load_study("rv", ROOT)
    bearing = study.design.bearing.model_copy(update={"clearance_um": 0.0})
    study = study.model_copy(update={"design": study.design.model_copy(update={"bearing": bearing})})
    unit = draw(study, 0, 1)
    unit = type(unit)(**(vars(unit) | {"sun_runout_amplitude": np.array([9.0])}))
    monkeypatch.setattr(output_turn, "rigid_cranks", lambda study: 2 * np.pi * np.arange(39))
    error = free_error(study, unit).error
    nominal = free_error(study, draw(study, 0, 1)).error
    assert np.ptp(error - nominal, axis=1).min() > 0.05  # [arcsec]


@pytest.mark.attack
def test_the_turn_of_a_unit_goes_through_the_angles_of_a_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of few angles: what the command writes is what the stages have at the same crank angles."""
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    monkeypatch.setattr(output_turn, "rigid_cranks", lambda study: 2 * np.pi * np.arange(10) / 10)
    monkeypatch.setattr(output_turn, "loaded_steps", lambda study, phases: np.arange(0, 240, 60))
    file = tmp_path / "turn.toml"
    text = (ROOT / "data/studies/quick.toml").read_text(encoding="utf-8")
    text = text.replace("crank_deg = [0.0, 90.0]", "crank_deg = [0.0, 90.0]\nrigid_angles = 1")
    for name, value in (("flank_edges_per_lobe", "12"), ("patch_half_width_mm", "0.3"), ("growth", "1.0")):
        start = text.index(f"\n{name} = ") + 1
        text = text[:start] + f"{name} = {value}\n" + text[text.index("\n", start) + 1 :]
    file.write_text(text)
    assert cli.main(["turn", str(file), "--sample", "3"]) == 0
    assert "12 N m held" in capsys.readouterr().out
    written_file = pd.read_parquet(tmp_path / "turn/output_turn/error-3.parquet")
    orders = pd.read_parquet(tmp_path / "turn/output_turn/orders-3.parquet")
    assert (tmp_path / "turn/output_turn/turn-3.png").stat().st_size > 20_000
    assert set(orders.columns) >= {"order_of_output", "order_of_crank", "amplitude_arcsec"}
    assert cli.main(["run", "aggregate", "--study", str(file), "--jobs", "1"]) == 0
    table = pd.read_parquet(tmp_path / "turn/aggregate/transmission.parquet").query("sample == 3")
    table["crank_deg"], written_file["crank_deg"] = table["crank_deg"].round(6), written_file["crank_deg"].round(6)
    pair = table.merge(written_file, on=["sense", "torque_Nm", "crank_deg"], suffixes=("", "_of_turn"))
    assert len(pair) == 2 * 1 + 2 * 2  # the play at 0, under load at 0 and 90 degrees, both senses
    np.testing.assert_allclose(pair["error_arcsec_of_turn"], pair["error_arcsec"], rtol=1e-7)
    np.testing.assert_allclose(pair["bearing_force_N_of_turn"], pair["bearing_force_N"], rtol=1e-7)


def test_a_unit_that_interferes_has_no_play_to_look_at() -> None:
    study = coarse()
    unit = draw(study, 1, 2)
    tight = type(unit)(**{**vars(unit), "pin_radius": unit.pin_radius + 50.0})
    with pytest.raises(ArithmeticError, match="interfere"):
        free_error(study, tight)

"""The rig's files as units, and the table of held-out errors."""

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, path_of

from pipeline.errors import InputError
from pipeline.identification.generic.crank_loops import CrankLoops
from pipeline.identification.generic.generic_drive import LoopModel
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from tests.validation.rig import (
    EVERY,
    HOLES,
    RATIO,
    crank_angle,
    predicted_states,
    preload_turns,
    states_of,
    write_unit,
)

DRIVE = {
    "play_arcmin": 60.0,
    "knee_Nm": 1.0,
    "compliance_arcmin_per_Nm": 5.0,
    "friction_Nm": 1.0,
    "load_friction": 0.2,
    "pin_circle_runout_cos_arcmin": 20.0,
    "pin_circle_runout_sin_arcmin": -15.0,
}


def measured(folder) -> Measurement:
    return Measurement.read(load_measured_unit(folder, ROOT))


def rig_file(folder, number: int, torque: np.ndarray, angle: np.ndarray, command: np.ndarray | None = None) -> None:
    """A file of the rig: small ramps, and two of the ramps that are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = pd.DataFrame({"TIME": np.arange(len(torque)) / 100, "POSITION": angle / 21600, "TORQUE": torque})
    rows["CONTROL_TORQUE"] = torque if command is None else command
    ramps = [rows.assign(test_nr=ramp) for ramp in (0, 100, 101)]
    pd.concat(ramps).to_csv(folder / f"position{number}.csv.gz", index=False)


def test_a_state_becomes_a_unit_that_is_trained_on_its_first_position(tmp_path):
    state, torque = tmp_path / "data" / "loose_split_1", path_of([0.0, 20.0, -20.0, 0.0], 50 * EVERY)
    for number, turns in ((1, 0.01), (2, 0.01 + 2 / RATIO - 1 / HOLES), (9, 0.0101)):
        rig_file(state, number, torque, 21600 * turns + 2 * torque)
    (result,) = states_of([tmp_path / "data"])
    measurement = measured(write_unit(result, tmp_path / "unit"))
    assert set(measurement.rows.cycle.tolist()) == {0, 1}
    turns = np.sort(measurement.rows.cranks / 360)
    np.testing.assert_allclose(turns, np.array([0.01, 0.0101, 1 - 1 / HOLES + 0.01]) * RATIO, atol=1e-3)
    assert measurement.unit.settings.held_out.train == pytest.approx((360 * 0.13,), abs=0.1)
    assert measurement.unit.settings.state.assembly == "loose_split"
    assert [file.position for file in measurement.unit.files] == ["1", "2", "9"]
    assert [preload_turns(name) for name in ("a_runin", "a_b_3pre", "a_preload5", "a_new")] == [0, 3, 5, None]
    assert len(measurement.rows) == pytest.approx(3 * 2 * len(torque) / EVERY, abs=6)
    assert not measurement.is_saturated.any()
    with pytest.raises(InputError, match="position1"):
        states_of([tmp_path / "unit"])


def test_the_crank_angle_of_a_position_is_what_its_encoder_keeps_of_a_turn_of_the_crank():
    """Eight holes of the output are 1/8 turn apart; the encoder forgets whole turns of the crank."""
    for number in range(1, HOLES + 2):
        true_crank = -RATIO * (number - 1) / HOLES + 0.1
        position = (true_crank - round(true_crank)) / RATIO
        assert crank_angle(number, position) == pytest.approx(360 * true_crank % (360 * RATIO), abs=1e-3)


@pytest.mark.parametrize("limit", [25.0, 40.0])
def test_saturation_is_what_the_files_of_a_state_show(tmp_path, limit):
    """The command goes to 40 N m in every state; the torque stops short of it in some."""
    command = path_of([0.0, 40.0, -40.0, 0.0], 50 * EVERY)
    torque = np.clip(command, -limit, limit)
    rig_file(tmp_path / "a_b", 1, torque, 2 * torque, command)
    measurement = measured(write_unit(tmp_path / "a_b", tmp_path / "unit"))
    is_cut = np.abs(measurement.rows.command) >= limit if limit < 40.0 else np.zeros(len(measurement.rows), bool)
    np.testing.assert_array_equal(measurement.is_saturated, is_cut)


def turned_loop(torque: np.ndarray, number: int, values: dict) -> np.ndarray:
    """Angle [arcmin] of a drive whose crank turns, locked at a position."""
    crank = -RATIO * (number - 1) / HOLES
    start = (crank - round(crank)) / RATIO * 21600
    angle, n = np.full(len(torque), start), len(torque)
    for _ in range(30):
        known = np.full(n, 2 * np.pi * crank), np.full(n, start)
        case = CrankLoops(
            np.zeros(n, int), torque[:, None], angle, np.ones(n), *known, 2 * np.pi * 13 / 21600, True, -13.0
        )
        twist = LoopModel(case).predict_angle(values)
        angle = twist - twist[0] + start
    return angle


@pytest.mark.long
def test_the_effect_comes_from_other_states_and_its_control_is_worse(tmp_path):
    rng, torque = np.random.default_rng(6), path_of([0.0, 30.0, -30.0, 0.0], 5 * EVERY)
    measurements = {}
    for state, play in (("loose_split_1", 40.0), ("loose_split_2", 80.0)):
        for number in (1, 5, 6):
            angle = turned_loop(torque, number, DRIVE | {"play_arcmin": play})
            rig_file(tmp_path / state, number, torque, angle + 0.3 * rng.standard_normal(len(torque)))
        measurements[state] = measured(write_unit(tmp_path / state, tmp_path / "units" / state))
    result = predicted_states(measurements, {}).set_index("state")
    assert result.loc["median", "effect"] < 2.0
    assert result.loc["median", "effect"] < 0.3 * result.loc["median", "refitted"]
    assert result.loc["median", "reversed"] > 1.5 * result.loc["median", "refitted"]

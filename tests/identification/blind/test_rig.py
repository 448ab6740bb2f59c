"""The rig's files as units, and the table of held-out errors."""

import json

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, path_of

from pipeline.checks.rig import EVERY, states_of, table, write_unit
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit


def test_a_state_becomes_a_unit_that_is_trained_on_its_first_position(tmp_path):
    state = tmp_path / "data" / "loose"
    state.mkdir(parents=True)
    torque = path_of([0.0, 20.0, -20.0, 0.0], 50 * EVERY)
    for number, turns in ((1, 0.01), (5, 0.01), (6, 0.02)):
        rows = pd.DataFrame({"TIME": np.arange(len(torque)) / 100, "POSITION": turns + 1e-4 * torque})
        rows = rows.assign(TORQUE=torque, CONTROL_TORQUE=torque)
        ramps = [rows.assign(test_nr=ramp) for ramp in (0, 100, 101)]
        pd.concat(ramps).to_csv(state / f"position{number}.csv.gz", index=False)
    (result,) = states_of([tmp_path / "data"])
    measurement = Measurement.read(load_measured_unit(write_unit(result, tmp_path / "unit"), ROOT))
    assert measurement.rows.cranks.tolist() == [47.0, 48.0, 94.0]  # 0.01 turns of 13 crank turns; one taken
    assert set(measurement.rows.cycle.tolist()) == {0, 1}
    assert measurement.unit.settings.held_out.train == (47.0,)
    assert len(measurement.rows) == pytest.approx(3 * 2 * len(torque) / EVERY, abs=6)
    assert not measurement.saturated.any()
    with pytest.raises(InputError, match="position1"):
        states_of([tmp_path / "unit"])


@pytest.mark.parametrize("limit", [25.0, 40.0])
def test_saturation_is_what_the_files_of_a_state_show(tmp_path, limit):
    """The command goes to 40 N m in every state; the torque stops short of it in some."""
    command = path_of([0.0, 40.0, -40.0, 0.0], 50 * EVERY)
    torque = np.clip(command, -limit, limit)
    rows = pd.DataFrame({"TIME": np.arange(len(torque)) / 100, "POSITION": 1e-4 * torque, "test_nr": 100})
    rows = rows.assign(TORQUE=torque, CONTROL_TORQUE=command)
    rows.to_csv(tmp_path / "position1.csv.gz", index=False)
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path, tmp_path / "unit"), ROOT))
    is_cut = np.abs(measurement.rows.command) >= limit if limit < 40.0 else np.zeros(len(measurement.rows), bool)
    np.testing.assert_array_equal(measurement.saturated, is_cut)


def test_the_table_has_the_best_description_and_medians(tmp_path):
    for name, described, carried, rms_after in (
        ("a", {"rms_arcmin": 3.0}, {"rms_arcmin": 2.0}, 9.0),
        ("b", None, None, 5.0),
    ):
        folder = tmp_path / name
        folder.mkdir()
        baselines = {"replay": {"rms_arcmin": 4.0}}
        content = {"verdict": "not explained by the library", "named": [], "described": described, "carried": carried}
        content |= {"baselines": baselines, "held_out_errors": {"after": {"rms_arcmin": rms_after}}}
        (folder / "verdict.json").write_text(json.dumps(content))
    result = table([tmp_path / "a", tmp_path / "b"]).set_index("unit")
    assert result["described"].tolist() == [3.0, 5.0, 4.0]
    assert result["carried"].tolist() == [2.0, 5.0, 3.5]
    assert result.loc["median", "replay"] == 4.0

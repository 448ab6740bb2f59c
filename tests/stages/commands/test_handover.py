"""Joints for simulators, parsed back, and the crate of a run, its hashes taken anew."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.cli.handover import missing_units
from pipeline.decisions.joint import FORMATS, joints
from pipeline.errors import InputError
from pipeline.statistics.intervals import quantile

DEG = np.pi / 180
JOINT_COLUMNS = [
    f"{name}_mean"
    for name in (
        *("clearance_backlash_arcmin", "zero_torque_width_arcmin", "lost_motion_arcmin", "hysteresis_loss_arcmin"),
        "torsional_rigidity_Nm_per_arcmin",
    )
]


@pytest.fixture(scope="module")
def own_runs(quick_runs: Callable[[], Path]) -> Path:
    return quick_runs()


def test_joints_hold_the_quantiles_of_the_population(
    own_runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(settings, "RUNS", own_runs)
    assert cli.main(["joints", "--study", "quick", "--jobs", "1"]) == 0
    units = pd.read_parquet(own_runs / "quick/aggregate/units.parquet").iloc[1:]
    for name, level in (("p05", 0.05), ("p95", 0.95)):
        half = quantile(units["clearance_backlash_arcmin_mean"].to_numpy(), level) / 60 * DEG / 2
        stiffness = quantile(units["torsional_rigidity_Nm_per_arcmin_mean"].to_numpy(), level) * 60 / DEG
        roots = {ending: ElementTree.parse(own_runs / f"joints/quick/{name}.{ending}").getroot() for ending in FORMATS}
        mjcf, robot, model = roots["mjcf.xml"], roots["urdf"], roots["sdf"].find("model")
        assert mjcf.find("compiler").get("angle") == "radian"
        ranges = [float(end) for end in mjcf.find(".//joint[@name='backlash']").get("range").split()]
        limit = robot.find("joint[@name='backlash']/limit")
        ends = [float(model.find(f"joint[@name='backlash']/axis/limit/{end}").text) for end in ("lower", "upper")]
        for pair in (ranges, [float(limit.get("lower")), float(limit.get("upper"))], ends):
            np.testing.assert_allclose(pair, (-half, half), rtol=1e-7)
        result = [
            mjcf.find(".//joint[@name='spring']").get("stiffness"),
            robot.find("gazebo[@reference='spring']/springStiffness").text,
            model.find("joint[@name='spring']/axis/dynamics/spring_stiffness").text,
        ]
        np.testing.assert_allclose([float(text) for text in result], stiffness, rtol=1e-7)
        assert float(robot.find("joint[@name='spring']/dynamics").get("friction")) == 0  # the study has none


def test_friction_is_that_of_a_spring_which_it_holds_back() -> None:
    """0.3 N m on 5 N m/arcmin: the spring stands 0.06 arcmin short from either side, the loop is 0.12 wide.

    Under load it is three times as stiff, and the backlash is that of more crank angles than the loops are.
    """
    units = pd.DataFrame(
        {
            "clearance_backlash_arcmin_mean": [0.9],
            "torsional_rigidity_Nm_per_arcmin_mean": [15.0],
            "hysteresis_loss_arcmin_mean": [0.12],
            "zero_torque_width_arcmin_mean": [1.12],
            "lost_motion_arcmin_mean": [1.0 + 2 * 0.4 / 5.0],
        }
    )
    assert all(joint.friction_Nm == pytest.approx(0.3) for joint in joints(units, 0.4))
    (joint, *_) = joints(units, 0.4)
    mjcf, robot, model = (ElementTree.fromstring(text(joint)) for text in FORMATS.values())
    texts = [
        mjcf.find(".//joint[@name='spring']").get("frictionloss"),
        robot.find("joint[@name='spring']/dynamics").get("friction"),
        model.find("model/joint[@name='spring']/axis/dynamics/friction").text,
    ]
    np.testing.assert_allclose([float(item) for item in texts], 0.3)
    with pytest.raises(InputError, match="needs all of them"):
        joints(units.assign(hysteresis_loss_arcmin_mean=np.nan), 0.4)


def test_units_without_a_result_are_counted() -> None:
    units = pd.DataFrame({"status": ["ok", "gap beyond a tenth of the eccentricity", "ok"]})
    assert missing_units(units).startswith("1 of 3 units have a remark in place of a result")
    assert missing_units(units[units["status"] == "ok"]) == ""


def test_the_time_step_of_mujoco_follows_the_fastest_swing_of_the_placeholders() -> None:
    """Both links swing against each other on the spring at sqrt(2 K/I); explicit steps are stable below 2 over that."""
    (joint, *_) = joints(pd.DataFrame(dict.fromkeys(JOINT_COLUMNS, [1.0])), 0.4)
    model = ElementTree.fromstring(FORMATS["mjcf.xml"](joint))
    swing = np.sqrt(2 * joint.stiffness_Nm_per_rad / float(model.find(".//inertial").get("diaginertia").split()[2]))
    assert 0.1 < float(model.find("option").get("timestep")) * swing < 0.5
    play = model.find(".//joint[@name='backlash']")
    assert float(play.get("solimplimit").split()[0]) > 0.999
    assert float(play.get("solreflimit").split()[0]) < float(model.find("option").get("timestep"))


def test_a_crate_names_every_file_with_its_hash(
    own_runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(settings, "RUNS", own_runs)
    assert cli.main(["run", "aggregate", "--study", "quick", "--jobs", "1"]) == 0
    assert cli.main(["provenance", "quick"]) == 0
    run = own_runs / "quick"
    graph = json.loads((run / "ro-crate-metadata.json").read_text())["@graph"]
    entities = {entity["@id"]: entity for entity in graph}
    assert entities["ro-crate-metadata.json"]["about"] == {"@id": "./"}
    files = {name: entity for name, entity in entities.items() if entity["@type"] == "File"}
    assert {part["@id"] for part in entities["./"]["hasPart"]} == set(files)
    written_file = {
        path.relative_to(run).as_posix() for stage in run.iterdir() if stage.is_dir() for path in stage.rglob("*")
    }
    assert set(files) == {name for name in written_file if (run / name).is_file() and not name.startswith(".")}
    for name, entity in files.items():
        assert hashlib.sha256((run / name).read_bytes()).hexdigest() == entity["sha256"]
    action = entities["#aggregate"]
    assert {"@id": "#hysteresis"} in action["object"]
    assert any(entities[program["@id"]]["name"] == "numpy" for program in action["instrument"])
    references = [link["@id"] for link in action["object"] + action["instrument"] + action["result"]]
    assert set(references) <= set(entities)
    part = run / "sample" / "reducer.parquet"
    part = part if part.is_file() else next(part.iterdir())
    part.write_bytes(b"changed")
    assert cli.main(["provenance", "quick"]) == 2
    assert "altered" in capsys.readouterr().err

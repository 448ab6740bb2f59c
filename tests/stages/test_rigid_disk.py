"""A rigid disk on linear springs that is its own output, from its files to its report: the textbooks' closed form."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.config import load_study, parse_design
from pipeline.config.changing import toml_of
from pipeline.errors import InputError

ROOT = Path(__file__).parents[2]
STIFFNESS = 10.0
"""[N/mm] of a contact: the bearing's 1e12 N/mm are stiff to 1e-10 beside 80 of them."""
TORQUE = 0.01


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Design and study of the paper's reducer with a stiff bearing, no output mechanism, and no tolerance."""
    folder = tmp_path_factory.mktemp("classic")
    design = tomllib.loads((ROOT / "data/designs/pham2017.toml").read_text())
    study = tomllib.loads((ROOT / "data/studies/quick.toml").read_text())
    design["bearing"] = {"stiffness_N_per_mm_power": 1e12, "exponent": 1.0, "clearance_um": 0.0}
    design["output"] = {"mechanism": "direct"}
    design["cycloid"]["rated_torque_Nm"] = TORQUE
    design["provenance"] = {}
    (folder / "stiff.toml").write_text(toml_of(design))
    for name in ("tolerances", "limits"):
        del study[name]
    study |= {"design": "stiff.toml", "springs": {"law": "linear", "stiffness_N_per_mm": STIFFNESS}}
    study["samples"] = {"experiment": "cases", "nominal_first": False}
    study["cases"] = [{"label": "nominal"}]
    study["reduce"]["disk"] = "rigid"
    study["cycle"] |= {"crank_deg": [0.0, 91.7], "rigid_angles": 7, "keep_contacts": "all"}
    (folder / "classic.toml").write_text(toml_of(study))
    return folder


@pytest.mark.long
def test_forces_are_those_of_equal_linear_springs(folder, monkeypatch, tmp_path):
    """F = F_max sin(phi)/S on the loaded half, F_max = T/(e Z sum sin^2/S^2), to 1e-9 of the largest."""
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    assert cli.main(["run", "report", "--study", str(folder / "classic.toml"), "--jobs", "1"]) == 0
    contacts = pd.read_parquet(tmp_path / "classic/hysteresis/contacts.parquet")
    k = 0.35 * 80 / 32.5
    for crank, rows in contacts[(contacts["contact"] < 80) & (contacts["torque_Nm"] == TORQUE)].groupby("crank_deg"):
        force = rows[rows["step"] == rows["step"].min()].sort_values("contact")["force_N"].to_numpy()
        phi = -2 * np.pi * np.arange(80) / 80 - np.radians(crank)
        share = np.sin(phi) / np.sqrt(1 + k * k - 2 * k * np.cos(phi))
        share = np.maximum(share if share @ force > 0 else -share, 0)
        expected = 1e3 * TORQUE / (0.35 * 79 * np.sum(share**2)) * share
        np.testing.assert_allclose(force, expected, atol=1e-9 * expected.max(), rtol=0)
        assert expected.max() == pytest.approx(4 * 1e3 * TORQUE / (0.35 * 79 * 80), rel=0.03)  # the sum tends to N/4
    assert not np.any(contacts["elastic_um"])
    assert contacts["contact"].max() == 79  # the output has no contacts
    loops = pd.read_parquet(tmp_path / "classic/hysteresis/loops.parquet")
    assert loops["solved"].all()
    page = (tmp_path / "classic/report/report.html").read_text()
    assert "linear springs of 10 N/mm" in page
    assert "rigid but for its contacts" in page
    assert "turns with the disk, without play and compliance" in page


@pytest.mark.parametrize(
    ("springs", "message"),
    [
        ({"law": "linear"}, 'springs.stiffness_N_per_mm is missing; law = "linear" needs the stiffness of a contact'),
        ({"law": "hertz", "stiffness_N_per_mm": 5.0}, 'springs.stiffness_N_per_mm = 5.0; law = "hertz" derives it'),
        ({"law": "linear", "stiffness_N_per_mm": 0.0}, "springs.stiffness_N_per_mm = 0.0; must be >= 1"),
    ],
)
def test_a_stiffness_that_is_missing_or_useless_is_refused(folder, springs, message):
    study = tomllib.loads((folder / "classic.toml").read_text()) | {"springs": springs}
    (folder / "refused.toml").write_text(toml_of(study))
    with pytest.raises(InputError) as raised:
        load_study(folder / "refused.toml", ROOT)
    assert message in " | ".join(raised.value.problems)


def test_several_disks_cannot_all_be_the_output(folder):
    design = tomllib.loads((folder / "stiff.toml").read_text())
    design["disk"]["count"] = 2
    with pytest.raises(InputError, match='disk.count = 2; must be 1 with mechanism = "direct"'):
        parse_design(design, "stiff.toml")


@pytest.mark.long
def test_six_uneven_crank_angles_run(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    study = tomllib.loads((folder / "classic.toml").read_text())
    study["cycle"]["crank_deg"] = [0.0, 20.0, 90.0, 131.0, 200.0, 301.0]
    (folder / "uneven.toml").write_text(toml_of(study))
    assert cli.main(["run", "aggregate", "--study", str(folder / "uneven.toml"), "--jobs", "1"]) == 0
    convergence = pd.read_parquet(tmp_path / "uneven/aggregate/convergence.parquet")
    assert set(convergence.loc[convergence["metric"] == "lost_motion_arcmin", "n_angles"]) == {6}

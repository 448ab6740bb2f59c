"""``python -m pipeline flank`` from the outside: points, normals and layers against the textbooks."""

import sys
import tomllib
from pathlib import Path

import ezdxf
import numpy as np
import pandas as pd
import pytest

from pipeline import cli
from pipeline.config.changing import toml_of

ROOT = Path(__file__).parents[2]
EQUIDISTANT, EXCESS = 9.0, 4.0


@pytest.fixture
def flank_folder(tmp_path):
    raw = tomllib.loads((ROOT / "data/designs/pin_in_hole_39.toml").read_text())
    phases = np.arange(0.0, 360.0, 10.0)
    table = pd.DataFrame({"phase_deg": phases, "deviation_um": EXCESS})
    table.to_csv(tmp_path / "flank.csv", index=False)
    flank = {"equidistant_um": EQUIDISTANT, "measured": "flank.csv"}
    (tmp_path / "design.toml").write_text(toml_of({**raw, "flank": flank}))
    folder_out = tmp_path / "out"
    assert (
        cli.main(["flank", "--design", str(tmp_path / "design.toml"), "--out", str(folder_out), "--points", "60"]) == 0
    )
    return folder_out


def test_points_are_the_envelope_of_the_generating_roller(flank_folder):
    """Each point is one roller radius off the centre of a roller that the textbooks place, along its outward normal."""
    drawn_points = pd.read_csv(flank_folder / "drawn.csv")
    assert len(drawn_points) == 39 * 60
    psi = -(drawn_points["lobe"] + drawn_points["phase_deg"] / 360) * 2 * np.pi / 39
    roller = 70.0 * np.exp(1j * psi) - 1.2 * np.exp(40j * psi)
    point = drawn_points["x_mm"] + 1j * drawn_points["y_mm"]
    outward = drawn_points["normal_x"] + 1j * drawn_points["normal_y"]
    np.testing.assert_allclose(np.abs(roller - point), 3.0 + 1e-3 * EQUIDISTANT, atol=2e-9)
    np.testing.assert_allclose((roller - point) / (3.0 + 1e-3 * EQUIDISTANT), outward, atol=2e-9)


def test_the_measured_flank_stands_its_deviation_outside_of_the_drawn_one(flank_folder):
    drawn_points, measured = pd.read_csv(flank_folder / "drawn.csv"), pd.read_csv(flank_folder / "measured.csv")
    offset = [(measured[f"{axis}_mm"] - drawn_points[f"{axis}_mm"]) / 1e-3 for axis in "xy"]
    normal_part = offset[0] * drawn_points["normal_x"] + offset[1] * drawn_points["normal_y"]
    np.testing.assert_allclose(normal_part, EXCESS, atol=1e-5)


def test_the_drawing_has_both_on_layers_in_millimetres(flank_folder):
    document = ezdxf.readfile(flank_folder / "flank.dxf")
    assert document.units == ezdxf.units.MM
    lines = {line.dxf.layer: line for line in document.modelspace().query("LWPOLYLINE")}
    assert set(lines) == {"drawn", "measured"}
    for name, line in lines.items():
        table = pd.read_csv(flank_folder / f"{name}.csv")
        assert line.closed
        np.testing.assert_allclose(np.array(line.get_points("xy")), table[["x_mm", "y_mm"]], atol=1e-8)
    assert not document.audit().errors


@pytest.mark.parametrize("points", ["3", "1000000"])
def test_too_few_or_too_many_points_are_refused(tmp_path, capsys, points):
    arguments = ["flank", "--design", "pham2017", "--out", str(tmp_path), "--points", points]
    assert cli.main(arguments) == 2
    assert f"--points = {points}; must be 8 to 100000" in capsys.readouterr().err


def test_without_ezdxf_the_command_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    assert cli.main(["flank", "--design", "pham2017", "--points", "8", "--out", str(tmp_path)]) == 2
    assert "ezdxf is not installed" in (message := capsys.readouterr().err)
    assert "'cycloid-tolerance-study[cad]'" in message


def test_the_normals_of_a_turned_flank_are_its_own(tmp_path):
    """Those of the curve that generates it are off by up to 4 degrees near the kinks of a flank turned by 3'."""
    raw = tomllib.loads((ROOT / "data/designs/pham2017.toml").read_text())
    design = tmp_path / "design.toml"
    design.write_text(toml_of({**raw, "flank": {"rotation_arcmin": 3.0}}))
    assert cli.main(["flank", "--design", str(design), "--out", str(tmp_path), "--points", "720"]) == 0
    points = pd.read_csv(tmp_path / "drawn.csv").iloc[:720]
    place = (points["x_mm"] + 1j * points["y_mm"]).to_numpy()
    normal = (points["normal_x"] + 1j * points["normal_y"]).to_numpy()
    chord = place[2:] - place[:-2]
    away_from_kinks = np.abs((points["phase_deg"].to_numpy()[1:-1] + 90) % 180 - 90) > 2
    along = np.abs(np.real(chord * np.conj(normal[1:-1])) / np.abs(chord))
    assert np.max(along[away_from_kinks]) < 3e-3

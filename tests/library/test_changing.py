"""Studies and designs with other numbers: checked as those of a file, and otherwise the same."""

from pathlib import Path

import pytest

from pipeline import load_design, load_study
from pipeline.config.changing import changed_study
from pipeline.config.files.section import number_at, with_value
from pipeline.errors import InputError

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "data/studies").glob("*.toml")))
def test_a_study_without_changes_is_itself(name: str) -> None:
    study = load_study(name)
    assert study.with_({}) == study


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "data/designs").glob("*.toml")))
def test_a_design_without_changes_is_itself(name: str) -> None:
    design = load_design(name)
    assert design.with_({}) == design


def test_numbers_of_a_study_and_its_design_change_by_dotted_names() -> None:
    changes = {"tolerances.pin_radial.upper_um": 2.0, "cycle.crank_deg": (0.0,), "design.disk.thickness_mm": 1.5}
    study = load_study("quick").with_({**changes, "name": "thicker"})
    assert (study.name, study.tolerances.pin_radial.limits_um) == ("thicker", (-3.0, 2.0))
    assert (study.cycle.crank_deg, study.design.disk.thickness_mm) == ((0.0,), 1.5)
    assert load_study("quick").with_({"limits.lost_motion_arcmin": 3.0}).limits.lost_motion_arcmin == 3.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tolerances.pin_radial.lower_um": 6.0, "tolerances.pin_radial.upper_um": -9.0}, "-9.0; must be > lower_um"),
        ({"cycle.levls": 3}, "cycle.levls = 3; unknown key"),
        ({"design.cycloid.pins": 3}, "cycloid.pins = 3; must be >= 4"),
        ({"design.cycloid.eccentricity_mm": 30.0}, "eccentricity_mm"),
        ({"cycle.loaded_angles": 80}, "must share no factor with"),
    ],
)
def test_a_change_that_a_file_may_not_contain_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        changed_study(load_study("quick"), changes)


def test_names_with_dots_are_found_whole() -> None:
    tables = {"materials": {"1.3505": {"youngs_modulus_MPa": 2.1e5}, "1": {"3505": 3}}}
    key = "materials.1.3505.youngs_modulus_MPa"
    assert number_at(with_value(tables, key, 2.0), key) == 2.0
    assert number_at(tables, key) == 2.1e5
    assert with_value(tables, "limits.lost_motion", 1)["limits"] == {"lost_motion": 1}


def test_a_number_of_a_material_named_by_its_number_changes(tmp_path: Path) -> None:
    text = (ROOT / "data/designs/pham2017.toml").read_text()
    text = text.replace("[materials.steel]", '[materials."1.3505"]').replace('= "steel"', '= "1.3505"')
    (tmp_path / "numbered.toml").write_text(text.replace('"materials.steel.', '"materials.1.3505.'))
    design = load_design(tmp_path / "numbered.toml")
    assert design.with_({}) == design
    softer = design.with_({"materials.1.3505.youngs_modulus_MPa": 1e5})
    assert softer.materials["1.3505"].youngs_modulus_MPa == 1e5

"""unit.toml: what is accepted, and how every mistake is reported."""

import shutil

import pytest
from measured_bench import ROOT, UNIT, write_unit

from pipeline.config import load_study
from pipeline.errors import InputError
from pipeline.identification.measurement.unit_file import load_measured_unit


def problems(folder):
    with pytest.raises(InputError) as error:
        load_measured_unit(folder, ROOT)
    return list(error.value.problems)


def test_a_unit_has_the_tolerances_of_its_study_and_its_own_design(tmp_path):
    text = UNIT.replace('"pham2017"', '"pham2017_table2"')
    unit = load_measured_unit(write_unit(tmp_path / "u", text=text), ROOT)
    prior = load_study("quick", ROOT)
    assert unit.study.tolerances == prior.tolerances
    assert unit.study.reduce == prior.reduce
    assert unit.study.design != prior.design
    assert unit.study.name == "unit-u"
    assert unit.dimensions is None
    assert [file.path for file in unit.files] == ["rows.csv"]


def test_all_problems_of_all_files_are_reported_at_once(tmp_path):
    shutil.copy(ROOT / "data/designs/pham2017.toml", tmp_path / "d.toml")
    text = (
        'title = "x"\ndesign = "nowhere"\nstudy = "quick"\nlocked = "middle"\nas_measured = "dims.toml"\n'
        "[instrument]\nangle_noise_arcmin = 0\n[held_out]\ntrain = [0.0]\n"
        '[columns.torque_Nm]\nname = "M"\nunit = "Nm"\n[columns.torqe]\nname = "x"\n'
        '[[files]]\npath = "none.csv"\nseparator = ","\ndecimal = ","\n'
    )
    lines = "\n".join(problems(write_unit(tmp_path / "u", {}, text)))
    for part in (
        "u/unit.toml: locked = \"middle\"; must be 'input', 'output' or 'neither'",
        "offset is missing; add it",
        "design",
        "instrument.angle_noise_arcmin = 0; must be > 0",
        "held_out.by",
        "columns.torque_Nm.unit",
        "columns.torqe",
        "did you mean 'torque_Nm'?",
        'files[0].path = "none.csv"',
        "files[0].decimal",
        "dims.toml",
    ):
        assert part in lines


def test_a_design_whose_housing_is_the_output_is_refused(tmp_path):
    text = (ROOT / "data/designs/pham2017.toml").read_text().replace("[cycloid]", '[cycloid]\nfixed = "flange"')
    folder = write_unit(tmp_path / "u", text=UNIT.replace('"pham2017"', '"d.toml"'))
    (folder / "d.toml").write_text(text)
    (line,) = problems(folder)
    assert line.startswith('u/unit.toml: design; its cycloid.fixed must be "housing"')


def test_as_measured_dimensions_are_a_case_of_the_unit(tmp_path):
    text = UNIT.replace('as_measured = "unknown"', 'as_measured = "dims.toml"')
    folder = write_unit(tmp_path / "u", text=text)
    (folder / "dims.toml").write_text("disk_profile = 12.0\npin_radial = 1.5\n")
    dimensions = load_measured_unit(folder, ROOT).dimensions
    assert (dimensions.label, dimensions.disk_profile, dimensions.pin_radial) == ("dims", 12.0, 1.5)
    (folder / "dims.toml").write_text("pin_radial = [1.0, 2.0]\nbearing_clearance = -1.0\n")
    lines = problems(folder)
    assert any(line.startswith("dims.toml: pin_radial") and "must have 80" in line for line in lines)
    assert any(line.startswith("dims.toml: bearing_clearance = -1.0") for line in lines)
    (folder / "dims.toml").write_text("disk_profil = 12.0\n")
    assert any("did you mean 'disk_profile'" in line for line in problems(folder))


def test_the_uncertainty_of_dimensions_requires_dimensions_and_is_not_negative(tmp_path):
    text = 'measured_to_um = 0.5\n' + UNIT
    (line,) = problems(write_unit(tmp_path / "u", text=text))
    assert line.startswith("u/unit.toml: measured_to_um = 0.5; requires as_measured")
    text = text.replace('as_measured = "unknown"', 'as_measured = "dims.toml"')
    folder = write_unit(tmp_path / "v", text=text)
    (folder / "dims.toml").write_text("disk_profile = 12.0\n")
    assert load_measured_unit(folder, ROOT).settings.measured_to_um == 0.5
    (folder / "unit.toml").write_text(text.replace("0.5", "-0.5"))
    (line,) = problems(folder)
    assert line.startswith("v/unit.toml: measured_to_um = -0.5; must be >= 0")


def test_a_name_that_is_no_unit_gets_the_nearest(tmp_path):
    shutil.copytree(ROOT / "data/designs", tmp_path / "data/designs")
    write_unit(tmp_path / "data/measured/left_arm")
    with pytest.raises(InputError, match="did you mean 'left_arm'"):
        load_measured_unit("left_arn", tmp_path)


def test_rows_are_those_of_the_folder_named_where_its_unit_file_is_a_link(tmp_path):
    """A copy for a trial often links the settings and has other rows."""
    original, other = write_unit(tmp_path / "original"), tmp_path / "other"
    shutil.copytree(original, other)
    (other / "unit.toml").unlink()
    (other / "unit.toml").symlink_to(original / "unit.toml")
    unit = load_measured_unit(other, ROOT)
    assert (unit.name, unit.folder) == ("other", other)


def test_a_unit_without_data(tmp_path):
    assert any("no data" in line for line in problems(write_unit(tmp_path / "u", {})))

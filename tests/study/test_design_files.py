"""Design files: what is accepted, and how every mistake is reported."""

import tomllib
from types import SimpleNamespace

import pytest
from changed_files import ROOT, changed, read_design

from pipeline import load_study
from pipeline.config import load_design, parse_design
from pipeline.config.designs.design import Design
from pipeline.config.designs.problems import geometry_problems
from pipeline.config.studies.consistency import number_keys
from pipeline.errors import InputError
from pipeline.report.sections.summary import Verdict

DESIGNS = sorted((ROOT / "data/designs").glob("*.toml"))


def design_problems(data):
    with pytest.raises(InputError) as error:
        parse_design(data, "d.toml")
    return list(error.value.problems)


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_every_number_of_a_committed_design_has_a_provenance(path):
    design = load_design(path.stem, ROOT)
    assert set(design.provenance) == set(number_keys(tomllib.loads(path.read_text())))


def test_table_1_of_the_paper():
    design = read_design("pham2017")
    assert design.cycloid.model_dump() == {
        "pins": 80,
        "pin_radius_mm": 0.8,
        "pin_circle_radius_mm": 32.5,
        "eccentricity_mm": 0.35,
        "fixed": "housing",
        "rated_torque_Nm": 12.0,
    }
    assert design.cycloid.lobes == 79  # the published reduction ratio
    assert (design.output.rollers, design.output.roller_radius_mm, design.output.stations) == (40, 1.5, 5)
    assert design.housing.outer_diameter_mm == 69.0


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("cycloid.pins", 3, "cycloid.pins = 3; must be >= 4"),
        ("cycloid.pins", None, "cycloid.pins is missing; add it"),
        ("cycloid.eccentricity_mm", 0.41, "cycloid.eccentricity_mm = 0.41; eccentricity x pins / pin circle radius"),
        ("cycloid.pin_radius_mm", 1.1, "cycloid.pin_radius_mm = 1.1; must be < 1.045 mm, the smallest convex radius"),
        ("housing.outer_diameter_mm", 34.5, "housing.outer_diameter_mm = 34.5; must be > 66.6 mm"),
        ("disk.thickness_mm", -1.0, "disk.thickness_mm = -1.0; must be >= 0.001"),
        ("disk.bore_radius_mm", 32.0, "disk.bore_radius_mm = 32.0; must be < 31.35 mm"),
        ("disk.stress", "plane_stres", "disk.stress = \"plane_stres\"; must be 'plane_stress' or 'plane_strain'"),
        ("disk.material", "stel", "disk.material = \"stel\"; no such section [materials.stel]; did you mean 'steel'?"),
        ("materials.steel.youngs_modulus_MPa", 2.06e11, "materials.steel.youngs_modulus_MPa = 206000000000.0; must be"),
        ("bearing.exponent", 0.5, "bearing.exponent = 0.5; must be >= 1"),
        ("output.rollers", 36, "output.rollers = 36; must be a multiple of 8"),
        ("output.outer_station_mm", 16.5, "output.outer_station_mm = 16.5; must be >= 16.6 mm"),
        ("output.outer_station_mm", 30.0, "output.outer_station_mm = 30.0; the outermost rollers reach"),
        ("output.inner_station_mm", 1.0, "output.inner_station_mm = 1.0; must be >= 1.5 mm"),
        ("output.face_offset_mm", 2.0, "output.face_offset_mm = 2.0; must be > 3 mm, the bore's radius"),
        ("output.roller_radius_um", 1500.0, "output.roller_radius_um = 1500.0; unknown key; did you mean"),
        ("output.mechanism", "gears", "output.mechanism = \"gears\"; must be one of 'carrier', 'direct', 'pin_in"),
        ("output.mechanism", None, "output.mechanism is missing; add it"),
        ("output.mechanism", "pin_in_hole", "output.pin_radius_mm is missing; add it"),
        ("output", None, "output is missing; add it"),
        ("cycloid.pins", "80", 'cycloid.pins = "80"; must be an integer'),
        ("cycloid.pin_radius_mm", float("nan"), "cycloid.pin_radius_mm = NaN; must be a finite number"),
        ("title", 5, "title = 5; must be a text in quotes"),
    ],
)
def test_a_wrong_design_names_file_key_value_and_remedy(design_data, key, value, line):
    problems = design_problems(changed(design_data, key, value))
    assert any(problem.startswith(f"d.toml: {line}") for problem in problems), problems


BUSH = {"outer_radius_mm": 5.0, "clearance_um": 10.0, "material": "steel"}
BEAM = {"support": "cantilever", "plane_mm": 16.0}


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        (
            "output.pin_radius_mm",
            9.0,
            "output.pin_radius_mm = 9.0; a hole's radius is 10.55 mm: pin, eccentricity and cl",
        ),
        (
            "output.pins",
            11,
            "output.pin_radius_mm = 4.5; a hole's radius is 6.05 mm: pin, eccentricity and clearance; mu",
        ),
        ("output.pin_circle_radius_mm", 23.0, "output.pin_circle_radius_mm = 23.0; a hole's radius is 6.05 mm"),
        ("disk.bore_radius_mm", 14.0, "output.pin_circle_radius_mm = 20.0; a hole's radius is 6.05 mm"),
        ("output.hole_clearance_um", -1.0, "output.hole_clearance_um = -1.0; must be >= 0"),
        ("output.pin_material", "stel", 'output.pin_material = "stel"; no such section [materials.stel]; did you mean'),
        ("output.rollers", 40, "output.rollers = 40; unknown key; "),
        ("output.bush", BUSH | {"outer_radius_mm": 4.5}, "output.bush.outer_radius_mm = 4.5; must be > 4.51 mm"),
        ("output.bush", BUSH | {"outer_radius_mm": 7.0}, "output.pin_radius_mm = 4.5; a hole's radius is 8.55 mm"),
        ("output.bush", BUSH | {"clearance_um": 0.0}, "output.bush.clearance_um = 0.0; must be >= 1"),
        ("output.bush", BUSH | {"material": "stel"}, 'output.bush.material = "stel"; no such section [materials.stel]'),
        ("output.bending", BEAM | {"plane_mm": 4.0}, "output.bending.plane_mm = 4.0; must be 9 to 90 mm, 1 to 10 diam"),
        ("output.bending", BEAM | {"span_mm": 30.0}, "output.bending.span_mm = 30.0; must be there with support"),
        ("output.bending", BEAM | {"support": "both_ends"}, "output.bending.span_mm; must be there with support"),
        (
            "output.bending",
            BEAM | {"support": "both_ends", "span_mm": 15.0},
            "output.bending.span_mm = 15.0; must be > 16 mm, the plane of the last disk",
        ),
    ],
)
def test_a_wrong_hole_names_file_key_value_and_remedy(key, value, line):
    data = tomllib.loads((ROOT / "data/designs/printed_drive.toml").read_text())
    assert not geometry_problems_of(data)
    problems = design_problems(changed(data, key, value))
    assert any(problem.startswith(f"d.toml: {line}") for problem in problems), problems
    assert all("; take" in p or "; move" in p or "unknown" in p or "must" in p or "no such" in p for p in problems)


def geometry_problems_of(data):
    return geometry_problems({name: getattr(parse_design(data, "d.toml"), name) for name in Design.model_fields})


@pytest.mark.parametrize(
    ("design", "key", "value", "line"),
    [
        ("two_disks_39", "disk.count", 4, "disk.count = 4; must be <= 3"),
        ("two_disks_39", "disk.count", 3, 'disk.clocking = "same_part"; 10 holes and 39 lobes: no turn by whole holes'),
        ("two_disks_39", "output.pins", 9, 'disk.clocking = "same_part"; 9 holes and 39 lobes: no turn by whole holes'),
        ("pham2017", "disk.count", 2, "disk.count = 2; must be 1 with the output roller_plate: a plate lies against"),
    ],
)
def test_disks_that_collide_or_are_not_solved_are_refused(design, key, value, line):
    data = tomllib.loads((ROOT / f"data/designs/{design}.toml").read_text())
    problems = design_problems(changed(data, key, value))
    assert any(problem.startswith(f"d.toml: {line}") for problem in problems), problems


def test_planets_that_run_into_each_other_are_refused():
    data = tomllib.loads((ROOT / "data/designs/rv_40e.toml").read_text())
    assert data["output"]["first_stage"] == {**data["output"]["first_stage"], "sun_teeth": 12, "planet_teeth": 36}
    problems = design_problems(changed(data, "output.first_stage.planet_teeth", 80))
    requirement = "planet_teeth = 80; must be < 77.57, or the pitch circles of the 3 planets overlap"
    assert any(requirement in problem for problem in problems)


def test_pins_that_overlap_on_the_circle(design_data):
    data = changed(changed(design_data, "cycloid.eccentricity_mm", 0.05), "cycloid.pin_radius_mm", 1.28)
    assert design_problems(data) == [
        "d.toml: cycloid.pin_radius_mm = 1.28; must be < 1.276 mm, half the pitch of 80 pins on the circle of 32.5 mm: "
        "neighbouring pins overlap; take smaller or fewer pins"
    ]


def test_provenance_of_a_number_that_is_not_there(design_data):
    design_data["provenance"]["cycloid.pin_number"] = {"status": "published", "reason": "Table 1"}
    (problem,) = design_problems(design_data)
    assert problem.startswith('d.toml: provenance."cycloid.pin_number"; no such number in this file; did you mean')


@pytest.mark.parametrize("study", ["rv_80e", "rv", "quick"])
def test_the_first_screen_of_an_rv_reducer_says_that_its_rigidity_is_put_in(study):
    note = Verdict(SimpleNamespace(study=load_study(study)), None).rigidity_note
    assert ("an input of this design, not a prediction" in note) == (study != "quick")
    assert ("calibrated" in note) == (study == "rv_80e")
    assert ("chosen" in note) == (study == "rv")

"""Study files: what is accepted, and how every mistake of a study and of its design is reported."""

import tomllib

import numpy as np
import pytest
from changed_files import ROOT, changed, read_design

from pipeline.config import load_design, load_study, parse_design, parse_study
from pipeline.config.designs.sections import Operation
from pipeline.config.dimensions import dimension_library
from pipeline.errors import InputError

STUDIES = sorted((ROOT / "data/studies").glob("*.toml"))


@pytest.fixture
def study_data():
    return tomllib.loads((ROOT / "data/studies/quick.toml").read_text())


def study_problems(data, name="s", read=read_design):
    with pytest.raises(InputError) as error:
        parse_study(data, name, "s.toml", read)
    return list(error.value.problems)


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_committed_studies_are_valid(path):
    study = load_study(path.stem, ROOT)
    assert study.name == path.stem
    assert study == load_study(path, ROOT)


def test_nominal_sample_counts_as_a_row(study_data):
    assert parse_study(study_data, "s", "s.toml", read_design).samples.rows == 51
    without_effect = changed(study_data, "samples.nominal_first", False)
    assert parse_study(without_effect, "s", "s.toml", read_design).samples.rows == 50


@pytest.mark.parametrize(
    ("design", "name", "line"),
    [
        ("pin_in_hole_39", "eccentric_phase", "tolerances.eccentric_phase; acts on nothing with [disk] count = 1"),
        ("pham2017", "hole_diameter", "tolerances.hole_diameter; acts on nothing: it needs pins in holes"),
    ],
)
def test_tolerances_of_reducers_that_cannot_have_them_are_refused(study_data, design, name, line):
    data = changed(changed(study_data, "design", design), "clearance.roller_reading", "half_diameter")
    wide = {"distribution": "uniform", "lower_um": 0.0, "upper_um": 3.0}
    problems = study_problems(changed(data, f"tolerances.{name}", wide))
    assert any(problem.startswith(f"s.toml: {line}") for problem in problems), problems


def test_pins_that_roll_have_no_roundness(study_data):
    wide = {"distribution": "uniform", "lower_um": 0.0, "upper_um": 1.0}
    data = changed(study_data, "tolerances.pin_roundness_3", wide)
    design = parse_study(data, "s", "s.toml", read_design).design
    rolling = design.model_copy(update={"operation": Operation(input_speed_rpm=1000.0, pins="rolling")})
    dimension = dimension_library()["pin_roundness_3"]
    assert dimension.count(design) == design.cycloid.pins
    assert dimension.count(rolling) == 0
    assert dimension.refusal(rolling).startswith('acts on nothing: it needs pins held, [operation] pins = "fixed"')


def test_pins_in_holes_leave_no_choice_of_the_reading_of_their_diameter(study_data):
    data = changed(changed(study_data, "design", "pin_in_hole_39"), "clearance.roller_reading", "diameter")
    (problem,) = study_problems(data)
    assert problem.startswith('s.toml: clearance.roller_reading = "diameter"; must be "half_diameter"')


def test_a_limit_on_a_metric_that_the_design_leaves_without_a_value_is_refused(study_data):
    limits = {"limits.efficiency_percent": 90.0, "limits.pressure_speed_MPa_m_per_s": 5.0}
    data = study_data
    for key, limit in limits.items():
        data = changed(data, key, limit)
    problems = sorted(study_problems(data))
    assert len(problems) == 2
    assert problems[0].startswith("s.toml: limits.efficiency_percent = 90.0; has no value without the speed of the")
    assert "[operation.friction] of the design" in problems[0]
    of_stated = parse_study(changed(data, "design", "two_disks_39"), "s", "s.toml", read_design)  # speed and friction
    assert of_stated.limits.efficiency_percent == 90.0


def test_a_case_lists_one_diameter_for_each_output_pin():
    data = {
        "design": "printed_drive",
        "samples": {"experiment": "cases"},
        "cases": [{"label": "a", "roller_diameter": [0.0] * 7}],
        "reduce": tomllib.loads((ROOT / "data/studies/printed_drive.toml").read_text())["reduce"],
        "cycle": {"crank_deg": [0.0], "levels_per_branch": 4},
    }
    assert study_problems(data) == ['s.toml: cases[0].roller_diameter = "list of 7"; must have 8, or be a number']


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("tolerances.pin_radial.sigma_um", -1, "tolerances.pin_radial.sigma_um = -1; must be >= 0"),
        ("tolerances.pin_radial.sigma", 1, "tolerances.pin_radial.sigma = 1; unknown key; did you mean 'sigma_um'?"),
        ("tolerances.pin_radil", {}, "tolerances.pin_radil = {}; unknown key; did you mean 'pin_radial'?"),
        ("tolerances.pin_radial.lower_um", 4.0, "tolerances.pin_radial.upper_um = 3.0; must be > lower_um = 4"),
        ("tolerances.pin_radial.mean_um", 4.0, "tolerances.pin_radial.mean_um = 4.0; must lie within the limits -3 to"),
        (
            "tolerances.disk_profile.mode_um",
            9.0,
            "tolerances.disk_profile.mode_um = 9.0; must lie within the limits 0 to",
        ),
        ("tolerances.pin_radial.lower_um", -3e3, "tolerances.pin_radial.lower_um = -3000.0; must be >= -1000"),
        ("tolerances.pin_radius.lower_um", -900.0, "tolerances.pin_radius.lower_um = -900.0; leaves nothing of the"),
        ("tolerances.ovality_2.lower_um", -1.0, "tolerances.ovality_2.lower_um = -1.0; must be >= 0"),
        ("tolerances.eccentricity.correlation_length_mm", 1.0, "tolerances.eccentricity.correlation_length_mm = 1.0; "),
        ("tolerances.eccentricity.common_share", 0.5, "tolerances.eccentricity.common_share = 0.5; is of several"),
        ("tolerances.pin_radial.common_share", 1.5, "tolerances.pin_radial.common_share = 1.5; must be <= 1"),
        ("tolerances.eccentricity.distribution", "gauss", 'tolerances.eccentricity.distribution = "gauss"; must be'),
        ("tolerances.eccentricity.distribution", None, "tolerances.eccentricity.distribution is missing; add it"),
        ("samples.count", "50", 'samples.count = "50"; must be an integer'),
        ("samples.experiment", "sobol", "samples.count = 50; must be a multiple of randomisations = 8; take 56"),
        ("samples.randomisations", 4, "samples.randomisations = 4; must be >= 8"),
        ("samples.experiment", "cases", "cases is missing; experiment"),
        ("cases", [{"label": "a"}], 'samples.experiment = "monte_carlo"; must be "cases" where'),
        ("cycle.crank_deg", [0.0, 28440.0], "cycle.crank_deg[1] = 28440.0; must be < 28440, a turn of the output"),
        ("cycle.crank_turns", 5, "cycle.crank_turns = 5; unknown key; it follows from turn"),
        (
            "cycle.rigid_angles",
            237,
            "cycle.rigid_angles = 237; must share no factor with the 79 lobes, or the angles "
            "see 3 phases of their pitch; take 239",
        ),
        ("cycle.crank_deg", [0.0, 0.0], "cycle.crank_deg = [0.0, 0.0]; angles must rise"),
        ("cycle.loaded_angles", 31, "cycle.crank_deg = [0.0, 90.0]; cannot be combined with loaded_angles; keep one"),
        (
            "cycle.rigid_angles",
            180,
            "cycle.rigid_angles = 180; must share no factor with the 80 pins, or the angles "
            "see 9 phases of their pitch; take 181",
        ),
        ("cycle.keep_contacts", "some", "cycle.keep_contacts = \"some\"; must be 'all', or a list"),
        ("cycle.keep_contacts", [51], "cycle.keep_contacts = [51]; samples are numbered 0 to 50"),
        ("cycle.torque_fraction", 0.8, "metrics.rigidity_percent = [50.0, 100.0]; must be <= 80"),
        ("metrics.rigidity_percent", [100.0, 50.0], "metrics.rigidity_percent = [100.0, 50.0]; must rise"),
        (
            "metrics.rigidity_percent",
            [3.0, 50.0],
            "metrics.lost_motion_percent = 3.0; must differ from rigidity_percent",
        ),
        ("reduce.patch_half_width_mm", 0.8, "reduce.patch_half_width_mm = 0.8; must be < 0.8 mm"),
        ("clearence", {}, "clearence = {}; unknown key; did you mean 'clearance'?"),
        ("name", "x", 'name = "x"; unknown key'),
        ("design", 5, "design = 5; must be the name of a design file"),
        (
            "costs.pin_radial",
            {"law": "reciprocal", "cost": 1.0, "tolerance": 4.0},
            "costs.pin_radial.tolerance = 4.0; unknown key; did you mean 'tolerance_um'?",
        ),
        ("design", None, "design is missing; must be the name of a design file"),
        ("reduce", 5, "reduce = 5; must be a section"),
    ],
)
def test_a_wrong_study_names_file_key_value_and_remedy(study_data, key, value, line):
    problems = study_problems(changed(study_data, key, value))
    assert any(problem.startswith(f"s.toml: {line}") for problem in problems), problems


@pytest.mark.parametrize(("turn", "crank_turns"), [("output", 79), ("crank", 1)])
def test_loaded_angles_stand_evenly_over_the_turn_and_see_every_phase_of_the_pins(study_data, turn, crank_turns):
    del study_data["cycle"]["crank_deg"]
    study_data["cycle"]["turn"] = turn
    cycle = parse_study(study_data, "s", "s.toml", read_design).cycle
    turn_deg = 360 * crank_turns
    assert cycle.evenly_loaded
    assert cycle.crank_deg == tuple(turn_deg * k / 31 for k in range(31))
    assert cycle.curve_crank_deg == tuple(turn_deg * k / 31 for k in (0, 7, 15, 23))
    pitches = [360 / 80] + [360 * 79 / 80] * (turn == "output")  # of the pins; a turn of the eccentric in the disk
    for pitch in pitches:
        phases = np.sort(np.mod(np.array(cycle.crank_deg) / pitch + 1e-9, 1))
        np.testing.assert_allclose(np.diff(phases), 1 / 31)
    assert cycle.rigid_crank_deg == tuple(turn_deg * k / 181 for k in range(181))
    assert cycle.even_crank_deg == cycle.rigid_crank_deg
    assert cycle.model_copy(update={"rigid_angles": 30}).even_crank_deg == cycle.crank_deg  # the finer ones
    (problem,) = study_problems(changed(study_data, "cycle.loaded_angles", 32))
    assert problem.endswith("the angles see 2 phases of their pitch; take 33")


def test_a_latin_hypercube_must_fit_into_memory(study_data):
    study_data["samples"] |= {"experiment": "latin_hypercube", "count": 200_000}
    (problem,) = study_problems(study_data)
    assert problem.startswith("s.toml: samples.count = 200000; must be <= 100000")


def test_run_folders_of_other_targets_are_no_study(study_data):
    assert study_problems(study_data, name="bench") == [
        's.toml: file name = "bench"; is the run folder of another target; rename the study file'
    ]


def test_all_problems_of_both_files_come_at_once(study_data, design_data):
    wrong_design = changed(changed(design_data, "disk.thickness_mm", -1.0), "cycloid.pin_radius_mm", 1.1)
    wrong_study = changed(changed(study_data, "samples.count", 0), "tolerances.pin_radial.lower_um", 4.0)
    problems = study_problems(wrong_study, read=lambda name: parse_design(wrong_design, "d.toml"))
    keys = [problem.split(" = ")[0] for problem in problems]
    assert keys == [
        "s.toml: samples.count",
        "s.toml: tolerances.pin_radial.upper_um",
        "d.toml: disk.thickness_mm",
        "d.toml: cycloid.pin_radius_mm",
    ]


def test_cases_state_total_values(study_data):
    del study_data["tolerances"]
    study_data["samples"] = {"experiment": "cases"}
    study_data["cases"] = [{"label": "a", "disk_profile": 5.0}, {"label": "b", "pin_radial": [0.5] * 80}]
    study = parse_study(study_data, "s", "s.toml", read_design)
    assert study.samples.rows == 3
    assert study.cases[1].pin_radial == (0.5,) * 80
    study_data["cases"] += [{"label": "a", "roller_diameter": [1.0] * 39, "ovality_2": -1.0}]
    study_data["samples"]["count"] = 2
    study_data["tolerances"] = {}
    assert study_problems(study_data) == [
        "s.toml: samples.count = 2; must be 3, the number of [[cases]]; or leave it out",
        "s.toml: tolerances; a case states total values; delete the section, or the cases",
        's.toml: cases[2].label = "a"; cases[0] has it already; labels must differ',
        "s.toml: cases[2].ovality_2 = -1.0; must be >= 0",
        's.toml: cases[2].roller_diameter = "list of 39"; must have 40, or be a number',
    ]


def test_a_value_in_a_list_of_a_case_is_named(study_data):
    study_data["cases"] = [{"label": "a", "pin_radial": [1.0, "b"]}]
    assert 's.toml: cases[0].pin_radial = "b"; must be a number' in study_problems(study_data)


def test_missing_files_name_the_nearest(tmp_path):
    with pytest.raises(InputError, match=r"studies = 'papr'; no such file; did you mean 'paper'\?"):
        load_study("papr", ROOT)
    with pytest.raises(InputError, match="designs = 'x.toml'; no such file; data/designs is empty"):
        load_design("x.toml", tmp_path)


def test_another_study_of_the_name_of_one_in_data_would_replace_its_runs(tmp_path):
    kept = (ROOT / "data/studies/quick.toml").read_text()
    (tmp_path / "quick.toml").write_text(kept)
    assert load_study(tmp_path / "quick.toml", ROOT) == load_study("quick", ROOT)
    (tmp_path / "quick.toml").write_text(kept.replace("count = 50", "count = 60"))
    with pytest.raises(InputError, match=r"its runs would replace those of data/studies/quick.toml; rename the file"):
        load_study(tmp_path / "quick.toml", ROOT)


def test_a_design_may_lie_beside_its_study(tmp_path, study_data):
    (tmp_path / "mine.toml").write_text((ROOT / "data/designs/pham2017.toml").read_text().replace("12.0", "13.0"))
    text = (ROOT / "data/studies/quick.toml").read_text().replace('"pham2017"', '"mine.toml"')
    (tmp_path / "s.toml").write_text(text)
    assert load_study(tmp_path / "s.toml", ROOT).design.cycloid.rated_torque_Nm == 13.0
    (tmp_path / "mine.toml").unlink()
    with pytest.raises(InputError, match="s.toml: design = 'mine.toml'; no such file"):
        load_study(tmp_path / "s.toml", ROOT)


def test_a_file_that_is_no_toml(tmp_path):
    (tmp_path / "s.toml").write_text("count = \n")
    with pytest.raises(InputError, match="s.toml: not a TOML file: .*line 1"):
        load_study(tmp_path / "s.toml", ROOT)


def test_drivers_by_variance_need_enough_units_of_a_distribution(study_data):
    (small_case,) = study_problems(changed(study_data, "drivers.base_samples", 29))
    assert "drivers.base_samples = 29; must be 0 (no drivers by variance) or >= 30" in small_case
    listed_study = changed(changed(study_data, "samples.experiment", "cases"), "drivers.base_samples", 100)
    assert any("must be 0 where cases are listed" in problem for problem in study_problems(listed_study))

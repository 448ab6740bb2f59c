"""An RV reducer through the whole chain, and what a study, a unit and the tails of it refuse."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_study import save_named

from pipeline import assembly
from pipeline.config import load_design, parse_design, parse_study
from pipeline.elastic import disk_patches, elastic_disk
from pipeline.engine.runner import Resources, run
from pipeline.errors import InputError
from pipeline.figures import style
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import respond
from pipeline.model.load_history.winkler import secant_compliance, winkler_readings
from pipeline.model.metrics import Quantity
from pipeline.mounting import drive_of
from pipeline.populations.tails import tails_of
from pipeline.report.inputs import reducer_facts
from pipeline.sampling.errors import draw
from stages.chain import STAGES
from stages.sample import columns_of_errors, errors_of_columns
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

ROOT = Path(__file__).parents[2]
DESIGN = tomllib.loads((ROOT / "data/designs/rv_81_two_disks.toml").read_text(encoding="utf-8"))


def small_study(study="rv", own_design=None, **changes):
    data = tomllib.loads((ROOT / f"data/studies/{study}.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 3
    del data["cycle"]["loaded_angles"]
    data["cycle"] |= {"crank_deg": [37.0], "levels_per_branch": 4, "rigid_angles": 1, "keep_contacts": "all"}
    data["reduce"] |= {"flank_edges_per_lobe": 16, "patch_half_width_mm": 0.9, "growth": 0.6, "largest_edge_mm": 5.0}
    for section, values in changes.items():
        data[section] = data.get(section, {}) | values
    return parse_study(data, "rv_small", "rv_small.toml", lambda name: own_design or load_design(name, ROOT))


@pytest.mark.parametrize(("name", "rated"), [pytest.param("rv", 200, marks=pytest.mark.attack), ("rv_two_disks", 400)])
@pytest.mark.long
def test_a_study_of_a_carrier_runs_and_its_contacts_are_in_balance(tmp_path, name, rated):
    study = small_study(name)
    outputs = run(STAGES, study, ["aggregate"], tmp_path, Resources(1, 4))
    reducer, body = assembly.reducer(study.design, 37.0), elastic_disk(study)
    condensed = full_compliance(outputs["reduce"].path(COMPLIANCE_FILE), reducer, 37.0)
    fresh = body.compliance(disk_patches(study, body, reducer)).matrix
    rows = assembly.disk_contacts(reducer)
    np.testing.assert_allclose(condensed[np.ix_(rows, rows)], fresh, atol=1e-9 * fresh.max())
    frames = {table: pd.DataFrame(outputs["hysteresis"].read(table)) for table in ("contacts", "status", "loops")}
    assert set(frames["status"]["status"]) == {"ok"}
    tangential = 40 * 39 / (20 + 40 * 40) * 200e3 / (2 * 45.0)
    assert np.all(frames["loops"]["bearing_force_N"] > tangential)
    contacts = frames["contacts"].merge(pd.DataFrame(outputs["clearance"].read("contacts")))
    contacts["moment_Nm"] = 1e-3 * contacts["force_N"] * contacts["arm_mm"]
    steps = contacts.groupby(["sample", "step", "kind"])
    moment, torque = steps["moment_Nm"].sum().unstack("kind"), steps["torque_Nm"].first().unstack("kind")["pin"]
    assert np.ptp(torque) == 2 * rated
    np.testing.assert_allclose(moment["output"], -torque, atol=1e-5)
    np.testing.assert_allclose(moment["pin"], -torque * 40 * 39 / (20 + 40 * 40), atol=1e-5)
    metrics = pd.DataFrame(outputs["aggregate"].read("metrics"))
    kinematic = pd.DataFrame(outputs["clearance"].read("kinematic"))
    rigid = metrics.merge(kinematic, on=["sample", "crank_deg"])["backlash_arcmin"]
    np.testing.assert_allclose(metrics["clearance_backlash_arcmin"], rigid, rtol=1e-6)


def test_a_clearance_that_acts_through_the_hole_is_one_driver(tmp_path):
    drawn = {"crank_bearing_clearance": {"distribution": "uniform", "lower_um": 0.0, "upper_um": 6.0}}
    study = small_study("rv_two_disks", tolerances=drawn, reduce={"disk": "rigid"}, cycle={"crank_deg": [37.0, 50.0]})
    outputs = run(STAGES, study, ["aggregate"], tmp_path, Resources(1, 4))
    names = set(pd.DataFrame(outputs["aggregate"].read("sensitivity"))["parameter"])
    assert "crank_bearing_clearance_mean_um" in names
    assert not {name for name in names if name.startswith("hole_diameter")}
    assert set(outputs["springs"].read("laws")["crank_deg"]) == set(study.cycle.curve_crank_deg)


def test_each_crank_has_a_bearing_clearance_of_its_own():
    """Equal ones are the clearance of all bearings alike, to the last digits; drawn ones open their rollers."""
    fixed = {"distribution": "fixed", "value_um": 7.0}
    alike = small_study("rv_two_disks", tolerances={"crank_bearing_clearance": fixed})
    together = small_study("rv_two_disks", tolerances={"bearing_clearance": fixed})
    uniform = {"distribution": "uniform", "lower_um": 0.0, "upper_um": 6.0}
    own = small_study("rv_two_disks", tolerances={"crank_bearing_clearance": uniform})
    gap = {}
    for name, study in {"alike": alike, "together": together, "own": own}.items():
        sampled = draw(study, 0, 3)
        loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
        gap[name] = drive_of(study, 37.0, None, assembly.errors(sampled), loose).gap
    np.testing.assert_allclose(gap["alike"], gap["together"], atol=1e-17)
    reducer = assembly.reducer(own.design, 37.0)
    tight = replace(assembly.errors(sampled), hole_diameter=np.zeros((3, 2, own.design.output.cranks)))
    clearance = sampled.crank_bearing_clearance.reshape(3, 2, -1)
    assert np.all(clearance[0] == 0)  # the nominal unit
    assert len(np.unique(clearance[1:])) == clearance[1:].size
    contacts = reducer.contacts
    expected = 1e-3 * clearance[:, reducer.disk_of_contact, contacts.hole] * (contacts.hole >= 0)
    np.testing.assert_allclose(gap["own"] - drive_of(own, 37.0, None, tight, loose).gap, expected, atol=1e-15)
    read_back = errors_of_columns(columns_of_errors(sampled, 0, 1))
    np.testing.assert_array_equal(read_back.crank_bearing_clearance, sampled.crank_bearing_clearance)
    with pytest.raises(InputError, match="crank_bearing_clearance; acts on nothing: it needs cranks in the disks"):
        parse_study(
            tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
            | {"tolerances": {"crank_bearing_clearance": uniform}},
            "quick",
            "quick.toml",
            lambda design: load_design(design, ROOT),
        )


def rv_with_all_errors():
    """Two disks on shafts in loose supports, every dimension of cranks and gears drawn."""
    shaft = {"span_mm": 44.0, "plane_mm": 14.0, "disk_pitch_mm": 15.0, "planet_plane_mm": -8.0, "diameter_mm": 20.0}
    shaft |= {"material": "steel", "support_stiffness_N_per_mm_power": [4e5, 3e5], "support_clearance_um": 1.0}
    data = DESIGN | {"output": DESIGN["output"] | {"crankshaft": shaft, "cranks": 2}}
    data["series"] = {"pillars": {"stiffness_Nm_per_arcmin": 500.0}}
    key = "series.pillars.stiffness_Nm_per_arcmin"
    data["provenance"] = DESIGN["provenance"] | {key: {"status": "chosen", "reason": "a test"}}
    zone = {"distribution": "uniform_in_disc", "radius_um": 3.0}
    size = {"distribution": "uniform", "lower_um": 0.0, "upper_um": 3.0}
    tolerances = dict.fromkeys(("crank_position", "hole_position"), zone)
    tolerances |= dict.fromkeys(("planet_runout", "sun_runout", "planet_backlash", "planet_timing"), size)
    tolerances |= dict.fromkeys(("first_support_clearance", "second_support_clearance"), size)
    tolerances |= dict.fromkeys(("crank_eccentricity", "crank_phase"), size | {"lower_um": -3.0})
    return small_study(
        "rv_two_disks",
        parse_design(data, "rv.toml"),
        tolerances=tolerances,
        reduce={"disk": "rigid"},
        samples={"count": 2},
    ), tolerances


@pytest.mark.long
def test_errors_of_cranks_and_gears_go_through_the_whole_chain(tmp_path):
    study, tolerances = rv_with_all_errors()
    outputs = run(STAGES, study, ["aggregate"], tmp_path, Resources(1, 4))
    assert set(pd.DataFrame(outputs["hysteresis"].read("status"))["status"]) == {"ok"}
    sampled, read_back = draw(study, 0, 3), {}
    for table in ("reducer", "disks", "pins", "lobes", "rollers", "holes", "cranks"):
        read_back[table] = {name: np.asarray(column) for name, column in outputs["sample"].read(table).items()}
    for name, values in vars(errors_of_columns(read_back)).items():
        np.testing.assert_array_equal(values, getattr(sampled, name), err_msg=name)
    for name in tolerances:
        field = name if hasattr(sampled, name) else f"{name}_amplitude"
        assert np.all(getattr(sampled, field)[1:] != 0), name
    loops = pd.DataFrame(outputs["hysteresis"].read("loops")).query("sample == 1")
    stiff = study.model_copy(update={"design": study.design.model_copy(update={"series": {}})})
    of_stiff = run(STAGES, stiff, ["hysteresis"], tmp_path / "stiff", Resources(1, 4))["hysteresis"]
    fixed = pd.DataFrame(of_stiff.read("loops"))
    twist = (loops["high_plus_arcmin"] - fixed.query("sample == 1")["high_plus_arcmin"]).to_numpy()
    np.testing.assert_allclose(twist, 400.0 / 500.0, rtol=1e-9)


def test_a_part_in_series_without_its_origin_is_refused():
    data = DESIGN | {"series": {"pillars": {"stiffness_Nm_per_arcmin": 500.0}}}
    with pytest.raises(InputError, match=r'provenance."series.pillars.stiffness_Nm_per_arcmin" is missing'):
        parse_design(data, "d.toml")


@pytest.mark.parametrize(("name", "disks", "torque"), [("rv", 1, 200.0), ("rv_two_disks", 2, 400.0)])
@pytest.mark.long
def test_forces_life_and_efficiency_of_the_crank_bearings_by_hand(tmp_path, name, disks, torque):
    """Tables and pencil: balance of each rigid disk, ratio of the cranks, ISO 281, friction part by part."""
    study = small_study(
        name, cycle={"turn": "crank", "crank_deg": [360.0 * k / 9 for k in range(9)]}, reduce={"disk": "rigid"}
    )
    outputs = run(STAGES, study, ["aggregate"], tmp_path, Resources(1, 4))
    units = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample")
    assert not len(outputs["aggregate"].read("orders")["order"])  # the cranks do not come back after one of their turns
    bearings, contacts = (pd.DataFrame(outputs["hysteresis"].read(table)) for table in ("bearings", "turn_contacts"))
    assert len(bearings) == 4 * 9 * disks * 2 * 2
    places = pd.DataFrame(outputs["clearance"].read("contacts"))
    pins = contacts.merge(places[places["kind"] == "pin"], on=["contact", "crank_deg"])
    keys = ["sample", "crank_deg", "torque_Nm", "disk"]
    of_disk = bearings.groupby(keys)[["force_x_N", "force_y_N"]].sum()
    for axis in "xy":  # each disk stands between its pins and its bearings
        on_disk = (pins["force_N"] * pins[f"normal_{axis}"]).groupby([pins[key] for key in keys]).sum()
        np.testing.assert_allclose(of_disk[f"force_{axis}_N"], on_disk, atol=1e-6)
    wide = bearings.set_index([*keys, "bearing"])[["force_x_N", "force_y_N"]].unstack("bearing")
    apart = 0.5 * (wide.xs(0, axis=1, level=1) - wide.xs(1, axis=1, level=1))  # tangential on opposite cranks
    at_crank = np.exp(-1j * np.radians(apart.index.get_level_values("crank_deg")) / 39)
    around = np.imag(np.conj(at_crank) * (apart["force_x_N"] + 1j * apart["force_y_N"]))
    sums = pd.Series(around, apart.index).groupby(level=["sample", "crank_deg", "torque_Nm"]).sum()
    senses = np.sign(sums.index.get_level_values("torque_Nm"))
    expected = -senses * torque * 1e3 * 40 * 39 / (20 + 40 * 40) / (2 * 45.0)
    np.testing.assert_allclose(sums, expected, rtol=1e-7)  # T z2 (N-1)/(z1 + z2 N)/(n_c r_c), all disks of a crank

    crank_rpm = 1215.0 * 39 / 81
    in_bearing, output_W = crank_rpm * 40 / 39, torque * 2 * np.pi / 60 * 1215.0 / 81
    bearings["force_N"] = np.hypot(bearings["force_x_N"], bearings["force_y_N"])
    for sample, rows in bearings.groupby("sample"):
        loads = rows.groupby(["disk", "bearing", "torque_Nm"])["force_N"].apply(lambda f: np.mean(f ** (10 / 3)) ** 0.3)
        life = (30_000 / loads.max()) ** (10 / 3) * 1e6 / (60 * in_bearing)
        assert units.loc[sample, "bearing_life_h"] == pytest.approx(life, rel=1e-9)
        efficiencies = []
        for sense in (torque, -torque):
            held = contacts[(contacts["sample"] == sample) & (contacts["torque_Nm"] == sense)]
            in_seats = 0.05 * (held["force_N"] * held["sliding_m_per_s"]).sum() / 9
            forces = rows.loc[rows["torque_Nm"] == sense, "force_N"].sum() / 9
            loss = in_seats + 0.0025 * 11e-3 * forces * in_bearing * 2 * np.pi / 60
            efficiencies.append(100 * output_W / (output_W + loss))
        assert units.loc[sample, "efficiency_percent"] == pytest.approx(min(efficiencies), rel=1e-9)
        assert 85 < min(efficiencies) < 99
    assert np.all(contacts.loc[contacts["contact"] >= 40 * disks, "sliding_m_per_s"] == 0)  # rollers roll
    sliding = contacts.query("contact == 0 and crank_deg == 0 and sample == 0")["sliding_m_per_s"]
    at_root = 1e-3 * crank_rpm * 2 * np.pi / 60 / 39 * (77.5 - 1.5 * 40 - 4.0)  # distance from the pitch point
    np.testing.assert_allclose(sliding, at_root, rtol=1e-9)


def test_friction_of_output_pins_must_be_named():
    data = tomllib.loads((ROOT / "data/designs/two_disks_39.toml").read_text(encoding="utf-8"))
    del data["operation"]["friction"]["output_coefficient"]
    with pytest.raises(InputError, match=r"operation.friction.output_coefficient.* must be given, from 0 to 0.5"):
        parse_design(data, "d.toml")


def test_the_report_tells_cranks_gears_and_their_ratio():
    facts = {name: text.replace("\u00a0", " ") for name, text in reducer_facts(load_design("rv_81", ROOT))}
    words = "carrier with 2 cranks on a circle of radius 45 mm, a sun of 20 and planets of 40 teeth before them"
    assert facts["Output"] == f"{words}: total ratio 81"
    assert "Bearing of each crank" in facts


@pytest.mark.parametrize(
    ("section", "key", "value", "line"),
    [
        ("output", "crank_circle_radius_mm", 60.0, "output.crank_circle_radius_mm = 60.0; the holes reach 75 mm from"),
        ("output", "crank_circle_radius_mm", 34.0, "output.crank_circle_radius_mm = 34.0; the holes reach within 19"),
        ("output", "cranks", 4, "output.cranks = 4; must be <= 3"),
        ("output", "bearing_rollers", 15, "output.bearing_rollers = 15; must be a multiple of 2"),
        ("cycloid", "fixed", "flange", 'cycloid.fixed = "flange"; must be "housing" with a carrier'),
        ("output", "cranks", 3, 'disk.clocking = "same_part"; 3 holes and 39 lobes: no turn by whole holes'),
    ],
)
def test_a_wrong_carrier_names_file_key_value_and_remedy(section, key, value, line):
    data = {**DESIGN, section: {**DESIGN[section], key: value}}
    with pytest.raises(InputError) as error:
        parse_design(data, "d.toml")
    assert any(problem.startswith(f"d.toml: {line}") for problem in error.value.problems), error.value.problems


def test_what_has_no_meaning_with_a_carrier_is_refused():
    with pytest.raises(InputError, match=r"tolerances.roller_diameter; acts on nothing: a carrier has no part"):
        small_study(tolerances={"roller_diameter": {"distribution": "fixed", "value_um": 2.0}})


@pytest.mark.parametrize(("name", "least"), [("rv", 0.99), ("rv_two_disks", 0.95)])
def test_independent_springs_of_the_pins_rank_units_as_equilibria_do(name, least):
    """Which is all that the tails ask of them: shares are counted on load-solved units."""
    study = small_study(name, reduce={"disk": "rigid"}, samples={"count": 60})
    assert [tail.metric for tail in tails_of(study)] == ["peak_pressure_MPa"]
    sampled, definitions = draw(study, 0, 61), assembly.definitions(study)
    loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drive = drive_of(study, 37.0, None, assembly.errors(sampled), loose)
    response = respond(drive, assembly.load_cycle(study, 0))
    solved = loop_readings(response, np.zeros(61), definitions)
    rough = winkler_readings(drive, secant_compliance(drive, response.equilibria.force), definitions)
    widths = [(readings.lost_motion_plus - readings.lost_motion_minus)[1:] for readings in (solved, rough)]
    assert np.corrcoef(widths)[0, 1] > least


@pytest.mark.long
def test_the_page_of_two_disks_on_cranks_speaks_of_them(tmp_path, monkeypatch):
    monkeypatch.setattr(style, "save", save_named())
    outputs = run(STAGES, small_study("rv_two_disks", reduce={"disk": "rigid"}), ["report"], tmp_path, Resources(1, 4))
    page = outputs["report"].path("report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    for said in ("2, each 12 mm thick", "Everything else is rigid.", "Bearing of each crank"):
        assert said in page, said
    for wrong in ("input bearing yield", "disk (1)", "and the disk under it yields"):
        assert wrong not in page, wrong


@pytest.mark.parametrize(
    ("value", "text"), [(315.304, "315"), (31.5034, "31.5"), (0.98412, "0.984"), (-1234.5678, "\u22121235")]
)
def test_numbers_have_three_digits_and_all_before_the_point(value, text):
    assert Quantity("Torsional rigidity", "N m/arcmin", 3).text(value).replace(",", "") == text


def test_rubbing_pins_of_two_disks_on_cranks_open_the_loop(tmp_path):
    study = small_study("rv_two_disks", reduce={"disk": "rigid"})
    design = study.design.model_copy(update={"effects": {"contact_friction": {"coefficient": 0.1}}})
    outputs = run(STAGES, study.model_copy(update={"design": design}), ["hysteresis"], tmp_path, Resources(1, 4))
    curves = pd.DataFrame(outputs["hysteresis"].read("curves"))
    assert pd.DataFrame(outputs["hysteresis"].read("loops"))["solved"].all()
    for _, rows in curves.groupby("sample"):
        middle = rows[(rows["torque_Nm"] - 200.0).abs() < 1e-6].set_index("branch")["angle_arcmin"]
        assert middle["unloading+"] > middle["reloading+"] + 1e-4  # more is left of the way than was on it


def test_order_2_of_the_loaded_error_grows_in_proportion_to_the_torque_in_both_senses():
    """A perfect unit of two unlike cranks by the solver: bearings that press one side only, gears, rigid disks."""
    output = DESIGN["output"] | {"stiffness_of_cranks": [1.0, 0.4]}
    output["first_stage"] = output["first_stage"] | {"backlash_um": 0.0}
    data = DESIGN | {"output": output, "bearing": DESIGN["bearing"] | {"clearance_um": 0.0}}
    study = small_study("rv_two_disks", parse_design(data, "rv.toml"), reduce={"disk": "rigid"})
    sampled = draw(study, 0, 1)
    errors = assembly.errors(sampled)
    errors = replace(errors, lobe=np.zeros_like(errors.lobe))
    torque, turned = 1e3 * np.array([100.0, 200.0, 400.0]), []
    for step in range(16):  # of a turn of a crank against the carrier
        drive = drive_of(study, 360.0 * 39 / 40 * step / 16, None, errors, np.zeros((1, 2)))
        start = np.zeros((1, len(drive.reducer.motions)))
        both = [drive.equilibria(start, sense * torque) for sense in (1, -1)]
        assert all(solved.converged.all() for solved in both)
        turned.append([solved.motion[0, :, drive.reducer.output_motion] for solved in both])
    wave = 2 * np.abs(np.fft.fft(turned, axis=0)[2]) / 16
    np.testing.assert_allclose(wave / wave[:, -1:], [[0.25, 0.5, 1.0]] * 2, rtol=0.05)
    assert np.all(wave[:, -1] > 1e-3 * np.mean(np.abs(turned), axis=0)[:, -1])

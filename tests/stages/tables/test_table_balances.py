"""Balances between the tables: gaps, forces, springs and compliances that belong together."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog
from small_study import run_study

from pipeline import assembly
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.contacts import PIN
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.load_history.response import CycleResponse
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from stages.tables import curves


def test_the_nominal_sample_has_the_allowances_alone(frames):
    for name, values in {
        "reducer": {"disk_profile_um": 10.0, "eccentricity_um": 0.0, "bearing_clearance_um": 0.0},
        "pins": {"radial_um": 0.0, "tangential_um": 0.0, "radius_um": 0.0},
        "lobes": {"profile_um": 0.0},
        "rollers": {"diameter_um": -3.0},
    }.items():
        frame = frames[f"sample/{name}"]
        for column, value in values.items():
            assert np.all(frame.loc[frame["sample"] == 0, column] == value)
    rollers = frames["sample/rollers"]
    assert set(rollers["interface"]) == {0, 1}
    assert set(rollers["roller"]) == set(range(20))
    spread = frames["sample/pins"].query("sample > 0").groupby("sample")["radial_um"].std()
    assert np.all(spread > 0.2)


def test_contacts_join_with_their_place_and_their_gap(frames):
    keys = ["sample", "crank_deg", "contact"]
    contacts = frames["hysteresis/contacts"]
    joined = contacts.merge(frames["clearance/gaps"], on=keys, suffixes=("", "_of_stage"))
    assert len(joined) == len(contacts)
    np.testing.assert_array_equal(joined["clearance_um"], joined["clearance_um_of_stage"])
    places = frames["clearance/contacts"]
    of_pins = places[places["kind"] == PIN]
    assert np.all(of_pins["contact"] < 80)
    at_zero = of_pins[of_pins["crank_deg"] == 0].sort_values("contact")
    angle = np.degrees(
        np.arctan2(at_zero["y_mm"] + 0.8 * -at_zero["normal_y"], at_zero["x_mm"] - 0.8 * at_zero["normal_x"])
    )
    np.testing.assert_allclose(np.cos(np.radians(angle + 4.5 * np.arange(80))), 1)  # clockwise from the eccentric
    assert np.all(places["disk"] == np.where(places["interface"] == 1, -1, 0))  # plate and output touch no disk
    rollers = places[places["kind"] != PIN]
    assert set(rollers["station"]) == set(range(5))
    at_rest = rollers[rollers["crank_deg"] == 0]  # the first slide points along y, its rollers press along x
    for interface, normal_part, transverse in ((0, "y", "x"), (1, "x", "y")):
        rows = at_rest[at_rest["interface"] == interface]
        np.testing.assert_allclose(rows[f"normal_{normal_part}"], 0, atol=1e-12)
        np.testing.assert_allclose(np.abs(rows[f"{normal_part}_mm"]), np.abs(rows["arm_mm"]), atol=1e-12)
        offset = rows[f"{transverse}_mm"] - (
            0.35 if interface == 0 else 0.0
        )  # the disk's slide moves with the eccentric
        np.testing.assert_allclose(offset, 5 * rows[f"normal_{transverse}"], atol=1e-12)
    reach = rollers.groupby("station")["arm_mm"].apply(lambda arm: np.abs(arm).max())
    assert np.all(np.diff(reach) < 0)


def test_steps_run_through_the_branches_with_zero_torque_at_both_ends_of_play(frames):
    for _, loop in frames["hysteresis/curves"].groupby(["sample", "crank_deg"]):
        branch, torque, angle = loop["branch"].to_numpy(), loop["torque_Nm"].to_numpy(), loop["angle_arcmin"].to_numpy()
        assert list(dict.fromkeys(branch)) == list(BRANCHES)
        assert (torque.min(), torque.max()) == (-12, 12)
        rising = {"loading+": 1, "unloading+": -1, "loading-": -1, "unloading-": 1, "reloading+": 1}
        for name, sense in rising.items():
            rows = branch == name
            assert np.all(sense * np.diff(torque[rows]) > 0)
            assert np.all(sense * np.diff(angle[rows]) > 0)
        ends = dict(zip(branch[torque == 0], angle[torque == 0], strict=True))
        assert ends["unloading+"] == ends["reloading+"] == ends["loading+"] > ends["loading-"] == ends["unloading-"]
        assert np.isin(np.array([0.36, 6.0, 12.0]), torque).all()


def test_the_disk_is_in_balance_with_its_bearing(frames, study):
    """Forces of pins and of the disk's own slide on the disk add up to the bearing's stiffness times its deflection."""
    places = frames["clearance/contacts"]
    rows = frames["hysteresis/contacts"].merge(places, on=["contact", "crank_deg"])
    sense = (rows["body_b"] == "disk").astype(float) - (rows["body_a"] == "disk").astype(float)
    keys = ["sample", "crank_deg", "step"]
    curves = frames["hysteresis/curves"].set_index(keys).sort_index()
    stiffness = assembly.bearing(study.design).stiffness
    for axis in "xy":
        force = (
            (sense * rows["force_N"] * rows[f"normal_{axis}"]).groupby([rows[key] for key in keys]).sum().sort_index()
        )
        is_loaded = curves["torque_Nm"] != 0
        np.testing.assert_allclose(
            force[is_loaded], stiffness * curves.loc[is_loaded, f"bearing_{axis}_um"] / 1e3, rtol=1e-8, atol=1e-6
        )
    in_contact = rows["force_N"] > 0
    for kind, column in ((PIN, "pins_in_contact"), ("output", "outputs_in_contact")):
        count = (in_contact & (rows["kind"] == kind)).groupby([rows[key] for key in keys]).sum().sort_index()
        np.testing.assert_array_equal(count, curves[column])


def test_peak_pressure_is_that_of_hertz_at_the_most_loaded_contact(frames, study):
    """p0 = sqrt(p E*/(pi R')) with R' from the curvatures in the table of contacts."""
    rows = frames["hysteresis/contacts"].merge(frames["clearance/contacts"], on=["contact", "crank_deg"])
    design = study.design
    pins = (rows["kind"] == PIN).to_numpy()
    radius = np.where(pins, design.cycloid.pin_radius_mm, design.output.roller_radius_mm)
    length = np.where(pins, design.disk.thickness_mm, design.output.roller_length_mm)
    steel = design.materials["steel"]
    modulus = 0.5 * steel.youngs_modulus_MPa / (1 - steel.poisson_ratio**2)  # plane strain, one material
    curvature = 1 / radius + rows["curvature_per_mm"]
    expected = np.sqrt(rows["force_N"] / length * modulus * curvature / np.pi)
    np.testing.assert_allclose(rows["pressure_MPa"], expected, rtol=1e-9)
    peak = rows.groupby(["sample", "crank_deg"])["pressure_MPa"].max()
    metrics = frames["aggregate/metrics"].set_index(["sample", "crank_deg"])
    np.testing.assert_allclose(metrics["peak_pressure_MPa"], peak[metrics.index], rtol=1e-12)


def test_first_order_gaps_agree_with_exact_ones_away_from_the_roots(frames, study):
    """The stage's table against first-order kinematics computed here from the tables alone."""
    places = frames["clearance/contacts"].query("kind == 'pin'")
    pins = frames["sample/pins"].rename(columns={"pin": "contact"})
    rows = places.merge(pins, on="contact").merge(frames["clearance/gaps"], on=["sample", "crank_deg", "contact"])
    theta, crank = -2 * np.pi * rows["contact"] / 80, np.radians(rows["crank_deg"])
    rows["lobe"] = np.floor(-(theta + crank / 79) / (2 * np.pi / 79)).astype(int) % 79  # between roots, clockwise
    rows = rows.merge(frames["sample/lobes"], on=["sample", "lobe"]).merge(frames["sample/reducer"], on="sample")
    theta, crank = -2 * np.pi * rows["contact"] / 80, np.radians(rows["crank_deg"])
    normal = rows["normal_x"] + 1j * rows["normal_y"]
    outward, eccentric = np.exp(1j * theta), np.exp(1j * crank)
    inwards = -np.real(np.conj(normal) * outward)
    shift = np.real(np.conj(normal) * outward * (rows["radial_um"] + 1j * rows["tangential_um"]))
    first_order = 0.5 * (rows["disk_profile_um"] + rows["profile_um"]) * inwards - shift - rows["radius_um"]
    first_order += np.real(np.conj(normal) * eccentric) * rows["eccentricity_um"]
    misses = np.abs(rows["clearance_um"] - first_order)
    off_root = np.abs(np.angle(np.exp(1j * (theta - crank)))) > np.radians(30)
    assert misses[off_root].max() < 0.1
    nominal = (rows["sample"] == 0) & off_root
    assert misses[nominal].max() < 0.05


def test_spring_tables_are_the_laws_of_their_coefficients(frames, outputs, study):
    coefficients, design = pd.DataFrame(outputs["springs"].read("coefficients")), study.design
    rows = frames["springs/laws"].query("contact >= 0").merge(coefficients, on=["contact", "crank_deg"])
    force, limit = rows["force_N"], rows["force_limit_N"]
    np.testing.assert_array_equal(rows["beyond_limit"], force > limit)
    assert 0 < rows["beyond_limit"].mean() < 0.5
    rows_below_limit = rows[(force > 0) & (force < limit)]
    log = np.log(rows_below_limit["force_N"])
    local = rows_below_limit["force_N"] * (
        rows_below_limit["linear_mm_per_N"] - rows_below_limit["logarithmic_mm_per_N"] * log
    )
    np.testing.assert_allclose(rows_below_limit["local_um"], 1e3 * local, rtol=1e-12)
    compliance = rows_below_limit["linear_mm_per_N"] - rows_below_limit["logarithmic_mm_per_N"] * (1 + log)
    np.testing.assert_allclose(rows_below_limit["stiffness_N_per_um"], 1e-3 / compliance, rtol=1e-12)
    radius, length, depth = design.output.roller_radius_mm, design.output.roller_length_mm, design.output.flat_depth_mm
    pin, thickness, width = design.cycloid.pin_radius_mm, design.disk.thickness_mm, study.reduce.patch_half_width_mm
    modulus, ratio = design.materials["steel"].youngs_modulus_MPa, design.materials["steel"].poisson_ratio
    places = frames["clearance/contacts"][["contact", "crank_deg", "kind", "curvature_per_mm"]]
    rows_below_limit = rows_below_limit.merge(places, on=["contact", "crank_deg"])
    of_pin = rows_below_limit["kind"] == PIN
    load = rows_below_limit["force_N"] / np.where(of_pin, thickness, length)
    relative = 1 / np.where(of_pin, 1 / pin + rows_below_limit["curvature_per_mm"], 1 / radius)
    b = np.sqrt(4 * load * relative / (np.pi * modulus / 2))
    sides = np.where(
        of_pin,
        np.log(4 * pin / b) - 0.5 + np.log(width / b) + 0.25,
        2 * (np.log(4 * radius / b) - 0.5 + np.log(2 * depth / b) - ratio / 2),
    )
    np.testing.assert_allclose(rows_below_limit["local_um"], 1e3 * 2 * load / (np.pi * modulus) * sides, rtol=1e-9)
    bearing = frames["springs/laws"].query("contact == -1")
    stiffness = study.design.bearing.stiffness_N_per_mm_power / 1e3
    np.testing.assert_allclose(bearing["force_N"], stiffness * bearing["local_um"], rtol=1e-12)
    np.testing.assert_allclose(bearing["stiffness_N_per_um"], stiffness)
    assert set(bearing["law"]) == {"bearing"}


def test_compliance_rows_are_those_of_the_matrices_and_deflect_the_contacts(frames, outputs):
    with np.load(outputs["reduce"].path("compliance.npz")) as matrices:
        matrices = {float(name.removeprefix("crank_")): matrices[name] for name in matrices}
    for crank, rows in frames["reduce/contacts"].groupby("crank_deg"):
        matrix = matrices[crank]
        np.testing.assert_array_equal(rows["row"], np.arange(len(matrix)))
        np.testing.assert_array_equal(rows["compliance_um_per_N"], np.diag(matrix))
        contacts = frames["hysteresis/contacts"].query("crank_deg == @crank").set_index(["sample", "step", "contact"])
        force, elastic = (contacts[name].unstack() for name in ("force_N", "elastic_um"))
        np.testing.assert_allclose(elastic[rows["contact"]], force[rows["contact"]] @ matrix, atol=1e-12)
        assert np.all(elastic.drop(columns=rows["contact"]) == 0)  # plate and output are rigid


def test_interfering_cases_and_kept_samples(runs, study):
    """A disk 4 um too large overlaps by what one rotation cannot relieve; samples that are not kept have no rows."""
    cases = (
        {"label": "free", "disk_profile": 4.0, "roller_diameter": -6.0},
        {"label": "tight", "disk_profile": -4.0, "roller_diameter": -6.0, "ovality_2": 4.0},
        {"label": "loose", "disk_profile": 4.0, "roller_diameter": -6.0, "bearing_clearance": 3.0},
    )
    settings = {**study.model_dump(exclude={"tolerances"}), "name": "interfering", "cases": cases}
    settings["samples"] |= {"experiment": "cases", "count": 3, "nominal_first": False}
    settings["cycle"] |= {"keep_contacts": (1,)}
    outputs = run_study(type(study).model_validate(settings), runs)
    kinematic = pd.DataFrame(outputs["clearance"].read("kinematic"))
    np.testing.assert_array_equal(kinematic["preloaded"], kinematic["sample"] == 1)
    np.testing.assert_array_equal(kinematic["overlap_um"] > 0, kinematic["sample"] == 1)
    gap = pd.DataFrame(outputs["clearance"].read("gaps")).query("sample == 1 and contact < 80")
    position = pd.DataFrame(outputs["clearance"].read("contacts")).query("kind == 'pin'")
    rows = gap.merge(position, on=["contact", "crank_deg"])
    for (crank,), pins in rows.groupby(["crank_deg"]):
        minimum = linprog(
            [0, 1], np.column_stack([-pins["arm_mm"], -np.ones(80)]), pins["clearance_um"], bounds=[(None, None)] * 2
        ).fun
        overlap = kinematic[(kinematic["sample"] == 1) & (kinematic["crank_deg"] == crank)]["overlap_um"].item()
        assert overlap == pytest.approx(minimum, rel=1e-9)
    tight = pd.DataFrame(outputs["aggregate"].read("metrics")).query("sample == 1")["clearance_backlash_arcmin"]
    units = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample")
    units = units[[f"clearance_backlash_arcmin_{value}" for value in ("worst", "mean", "best")]]
    assert list(units.loc[1]) == pytest.approx([tight.max(), tight.mean(), tight.min()], rel=1e-3)  # no rigid play
    contacts = pd.DataFrame(outputs["hysteresis"].read("contacts"))
    assert set(contacts["sample"]) == {1}
    backlash = kinematic[kinematic["crank_deg"] == 0].set_index("sample")["backlash_arcmin"]
    assert backlash[2] > backlash[0] + 0.7  # the disk runs to the ends of its clearance, along the first slide
    curves = pd.DataFrame(outputs["hysteresis"].read("curves"))
    ends = curves.query("sample == 2 and crank_deg == 0 and torque_Nm == 0")
    np.testing.assert_allclose(np.hypot(ends["bearing_x_um"], ends["bearing_y_um"]), 3.0, rtol=1e-6)
    assert len(contacts) == 120 * np.count_nonzero(curves["sample"] == 1)
    at_rest = contacts[contacts["torque_Nm"] == 0].groupby(["crank_deg", "step"])["force_N"].max()
    assert np.all(at_rest > 1)  # the preload


def test_numbers_of_a_curve_count_every_contact(study):
    """The largest pressure may be a roller's; contacts beyond their law's range have their share of the moment."""
    reducer = assembly.reducer(study.design, 0.0)
    laws = assembly.contact_laws(study, reducer)
    force = np.zeros((1, 2, len(laws)))
    force[0, 0, [1, 2, 100]] = 1.1 * laws.force_limit[1], 10.0, 1e4
    force[0, 1, [2, 3]] = 1.0
    motion = np.arange(2.0 * len(reducer.motions)).reshape(1, 2, -1)
    states = Equilibria(motion, force, np.array([[3, 4]]), np.zeros((1, 2)), np.ones((1, 2), bool))
    drive = replace(drive_of(study, 0.0, None, assembly.errors(draw(study, 1, 2)), np.zeros(1), laws), reducer=reducer)
    response = CycleResponse(
        np.zeros(2, int),
        np.zeros(2),
        np.zeros(2),
        np.zeros((1, 2)),
        np.arange(2),
        states,
        np.zeros((1, 2)),
        np.ones(1, bool),
    )
    values = curves._curve_values(curves.Solved(0.0, drive, response, {}))
    assert values["peak_pressure_MPa"][0, 0] == laws.pressure[100] * 100
    moment = np.abs(reducer.pins.arm[1:3]) * force[0, 0, 1:3]
    np.testing.assert_allclose(values["beyond_limit_share"], [[moment[0] / moment.sum(), 0.0]])
    np.testing.assert_array_equal(values["pins_in_contact"], [[2, 2]])
    np.testing.assert_array_equal(values["outputs_in_contact"], [[1, 0]])
    np.testing.assert_array_equal(values["bearing_y_um"], 1e3 * motion[..., 1])
    np.testing.assert_array_equal(values["iterations"], [[3, 4]])

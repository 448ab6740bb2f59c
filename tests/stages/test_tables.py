"""The contract of the tables for users of pandas: columns, types, keys, joins; and balances between the tables."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import run_study
from scipy.optimize import linprog

from pipeline import assembly
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.contacts import PIN
from pipeline.model.load_history.load_cycle import BRANCHES
from pipeline.model.load_history.response import CycleResponse, respond
from pipeline.model.metrics import library
from pipeline.mounting import drive_of
from pipeline.sampling import draw
from stages import hysteresis
from stages.tables import curves
from stages.tables.convergence import convergence_rows
from stages.tables.turn import Turn

CONTRACT = {
    "sample/reducer": ("sample", "eccentricity_um disk_profile_um bearing_clearance_um"),
    "sample/pins": ("sample pin", "radial_um tangential_um radius_um"),
    "sample/lobes": ("sample disk lobe", "profile_um"),
    "sample/rollers": ("sample interface roller", "diameter_um"),
    "clearance/contacts": (
        "contact crank_deg",
        "kind body_a body_b disk interface face end station label x_mm y_mm arm_mm normal_x normal_y curvature_per_mm",
    ),
    "clearance/gaps": ("sample crank_deg contact", "clearance_um"),
    "clearance/kinematic": ("sample crank_deg", "backlash_arcmin overlap_um preloaded"),
    "springs/laws": ("contact crank_deg law force_N", "local_um stiffness_N_per_um beyond_limit"),
    "reduce/contacts": ("row crank_deg", "contact patch_half_width_mm"),
    "hysteresis/curves": (
        "sample crank_deg step",
        "branch torque_Nm angle_arcmin bearing_x_um bearing_y_um pins_in_contact outputs_in_contact "
        "iterations residual",
    ),
    "hysteresis/contacts": (
        "sample crank_deg step contact",
        "torque_Nm clearance_um penetration_um elastic_um local_um force_N pressure_MPa",
    ),
    "hysteresis/status": ("sample crank_deg", "status"),
    "aggregate/metrics": (
        "sample crank_deg",
        "clearance_backlash_arcmin zero_torque_width_arcmin lost_motion_arcmin torsional_rigidity_Nm_per_arcmin "
        "hysteresis_loss_arcmin preloaded peak_pressure_MPa status",
    ),
    "hysteresis/loops": (
        "sample crank_deg",
        "limit_minus_arcmin limit_plus_arcmin zero_falling_arcmin zero_rising_arcmin peak_pressure_MPa bearing_force_N",
    ),
    "aggregate/units": ("sample", "lost_motion_arcmin_worst lost_motion_arcmin_mean lost_motion_arcmin_best status"),
    "aggregate/convergence": ("metric n_angles", "worst_mean yield extrapolated worst_mean_settled yield_settled"),
    "aggregate/sample_convergence": ("metric statistic n", "value ci_low ci_high"),
    "aggregate/distributions": ("metric over crank_deg statistic", "value ci_low ci_high n n_angles"),
    "aggregate/sensitivity": ("metric over parameter kind", "index ci_low ci_high n"),
}
"""Key and further columns of each table, from the design of the outputs; more columns may be added."""
INTEGERS = {
    "sample", "pin", "lobe", "disk", "interface", "roller", "contact", "face", "end", "station", "row", "step",
    "pins_in_contact", "outputs_in_contact", "iterations", "n", "n_angles", "n_rigid_angles",
}  # fmt: skip
LABELS = {
    "kind", "body_a", "body_b", "label", "law", "branch", "status", "metric", "statistic", "parameter", "over",
}  # fmt: skip
TRUTHS = {"preloaded", "beyond_limit", "extrapolated", "solved"}
UNITS = {"um": "um", "mm": "mm", "Nm": "N m", "N": "N", "MPa": "MPa", "arcmin": "arcmin", "deg": "deg", "rad": "rad"}


def path_of(runs, table):
    return runs / "quick" / f"{table}.parquet"


@pytest.fixture(scope="session")
def frames(outputs, runs):
    """Every table as pandas reads it from the path that the contract names."""
    return {table: pd.read_parquet(path_of(runs, table)) for table in CONTRACT}


@pytest.mark.parametrize("table", CONTRACT)
def test_columns_types_and_units_are_those_of_the_contract(outputs, runs, table):
    path = path_of(runs, table)
    schema = pq.read_schema(next(iter(sorted(path.glob("part-*.parquet"))), path))
    key, type_name = (names.split() for names in CONTRACT[table])
    assert set(key + type_name) <= set(schema.names)
    assert schema.metadata[b"row_per"]
    for name in schema.names:
        expected = (
            pa.int32() if name in INTEGERS
            else pa.dictionary(pa.int32(), pa.string()) if name in LABELS
            else pa.bool_() if name in TRUTHS or name.endswith("_valid")
            else pa.float64()
        )  # fmt: skip
        assert schema.field(name).type == expected, name
        unit = schema.field(name).metadata[b"unit"].decode()
        named_effects = UNITS.get(name.rsplit("_", 1)[-1])
        if named_effects and "_per_" not in name:
            assert unit == named_effects, name


@pytest.mark.parametrize("table", CONTRACT)
def test_keys_are_unique_and_sorted_by_sample(frames, table):
    key, frame = CONTRACT[table][0].split(), frames[table]
    assert len(frame) > 0
    assert not frame.duplicated(key).any()
    if "sample" in frame:
        assert frame["sample"].is_monotonic_increasing
        assert sorted(frame["sample"].unique()) == list(range(9))  # the nominal reducer and 8 samples


def test_every_table_holds_every_combination_of_its_key(frames):
    samples, cranks, contacts, steps = 9, 2, 120, 68
    for table, rows in {
        "sample/pins": samples * 80,
        "sample/lobes": samples * 79,
        "sample/rollers": samples * 40,
        "clearance/contacts": cranks * contacts,
        "clearance/gaps": samples * cranks * contacts,
        "clearance/kinematic": samples * 182,  # 181 of the turn and the one loaded angle that is not among them
        "hysteresis/loops": samples * cranks,
        "aggregate/units": samples,
        "springs/laws": cranks * (contacts + 1) * 200,
        "reduce/contacts": cranks * 100,
        "hysteresis/curves": samples * cranks * steps,
        "hysteresis/contacts": samples * cranks * steps * contacts,
        "hysteresis/status": samples * cranks,
        "aggregate/metrics": samples * cranks,
    }.items():
        assert len(frames[table]) == rows, table


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
    modulus = 0.5 * design.materials["steel"].youngs_modulus_MPa  # plane stress, one material
    curvature = 1 / radius + rows["curvature_per_mm"]
    expected = np.sqrt(rows["force_N"] / length * modulus * curvature / np.pi)
    np.testing.assert_allclose(rows["pressure_MPa"], expected, rtol=1e-9)
    peak = rows.groupby(["sample", "crank_deg"])["pressure_MPa"].max()
    metrics = frames["aggregate/metrics"].set_index(["sample", "crank_deg"])
    np.testing.assert_allclose(metrics["peak_pressure_MPa"], peak[metrics.index], rtol=1e-12)


def test_statistics_leave_the_nominal_sample_out(frames):
    metrics, table = frames["aggregate/metrics"], frames["aggregate/distributions"]
    counted = metrics[metrics["sample"] > 0]
    table = table.set_index(["metric", "crank_deg", "statistic"])
    name = "lost_motion_arcmin"
    for crank, part in counted.groupby("crank_deg"):
        assert table.loc[(name, crank, "mean"), "value"] == pytest.approx(part[name].mean(), rel=1e-12)
        assert table.loc[(name, crank, "p50"), "value"] == pytest.approx(part[name].median(), rel=0.05)
        assert table.loc[(name, crank, "mean"), "n"] == 8
    worst = counted.groupby("sample")["torsional_rigidity_Nm_per_arcmin"].min().mean()
    of_worst = frames["aggregate/distributions"].query("over == 'worst' and statistic == 'mean'").set_index("metric")
    assert of_worst.loc["torsional_rigidity_Nm_per_arcmin", "value"] == pytest.approx(worst, rel=1e-12)
    assert of_worst.loc[name, "value"] == pytest.approx(counted.groupby("sample")[name].max().mean(), rel=1e-12)


def test_values_over_the_turn_are_the_extremes_of_what_the_tables_hold(frames):
    """By pandas from the tables alone; between the loaded angles the backlash is that of rigid bodies."""
    units = frames["aggregate/units"].set_index("sample")
    metrics, kinematic = frames["aggregate/metrics"], frames["clearance/kinematic"]
    by_sample = metrics.groupby("sample")
    for name in ("lost_motion_arcmin", "peak_pressure_MPa"):
        for statistic, extreme in {"worst": by_sample[name].max(), "best": by_sample[name].min()}.items():
            np.testing.assert_array_equal(units[f"{name}_{statistic}"], extreme)
        np.testing.assert_allclose(units[f"{name}_mean"], by_sample[name].mean(), rtol=1e-12)
    rigidity = by_sample["torsional_rigidity_Nm_per_arcmin"]
    assert list(units["torsional_rigidity_Nm_per_arcmin_worst"]) == list(rigidity.min())
    assert list(units["torsional_rigidity_Nm_per_arcmin_best"]) == list(rigidity.max())
    play = kinematic[~kinematic["preloaded"]].groupby("sample")["backlash_arcmin"]
    free = units.index[~units["preloaded"]]
    np.testing.assert_allclose(units["clearance_backlash_arcmin_worst"][free], play.max()[free], atol=1e-6)
    np.testing.assert_allclose(units["clearance_backlash_arcmin_best"][free], play.min()[free], atol=1e-6)
    step = kinematic["crank_deg"] * 181 / 360
    even_rows = kinematic[np.isclose(step, step.round())].groupby("sample")["backlash_arcmin"]
    np.testing.assert_allclose(units["clearance_backlash_arcmin_mean"][free], even_rows.mean()[free], atol=1e-4)
    assert np.all(units["clearance_backlash_arcmin_worst"] >= by_sample["clearance_backlash_arcmin"].max())


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


def test_yield_is_the_share_within_the_limits(frames, study):
    metrics, table = frames["aggregate/metrics"].query("sample > 0"), frames["aggregate/distributions"]
    shares = table.query("crank_deg == 90 and statistic == 'yield'").set_index("metric")["value"]
    rows, limits = metrics[metrics["crank_deg"] == 90], study.limits
    passes = {
        "clearance_backlash_arcmin": rows["clearance_backlash_arcmin"] <= limits.clearance_backlash_arcmin,
        "lost_motion_arcmin": rows["lost_motion_arcmin"] <= limits.lost_motion_arcmin,
        "torsional_rigidity_Nm_per_arcmin": rows["torsional_rigidity_Nm_per_arcmin"]
        >= limits.torsional_rigidity_Nm_per_arcmin,
        "peak_pressure_MPa": rows["peak_pressure_MPa"] <= limits.peak_pressure_MPa,
    }
    for name, tolerance_range in passes.items():
        assert shares[name] == pytest.approx(tolerance_range.mean()), name
    assert shares["all_limits"] == pytest.approx(np.logical_and.reduce(list(passes.values())).mean())
    assert np.all(metrics["hysteresis_loss_arcmin"] == 0)  # no friction
    np.testing.assert_array_equal(metrics["zero_torque_width_arcmin"], metrics["clearance_backlash_arcmin"])


def test_a_number_without_meaning_is_no_unit_beyond_the_limit(study):
    """Of four units one has no lost motion; of the three others two keep its limit, whatever the number of angles."""
    values = {name: np.full((4, 12), limit) for name, limit in study.limits.of_metrics.items()}
    for name in library():
        values.setdefault(name, np.ones((4, 12)))
    values["lost_motion_arcmin"][:2] = [[np.nan], [9.0]]
    turns = {name: Turn(values[name], np.full(12, True)) for name in library()}
    rows = pd.DataFrame(convergence_rows(study, turns, {4: {}, 2: {}, 1: {}}, np.full(4, True))).set_index("metric")
    assert list(rows.loc["lost_motion_arcmin", "yield"]) == pytest.approx([2 / 3] * 4)
    assert list(rows.loc["all_limits", "yield"]) == pytest.approx([2 / 3] * 4)
    assert list(rows.loc["clearance_backlash_arcmin", "yield"]) == [1.0] * 4
    no_effect = {**turns, "lost_motion_arcmin": Turn(np.full((4, 12), np.nan), np.full(12, True))}
    rows = pd.DataFrame(convergence_rows(study, no_effect, {4: {}, 2: {}, 1: {}}, np.full(4, True))).set_index("metric")
    assert rows.loc[["lost_motion_arcmin", "all_limits"], "yield"].isna().all()


def test_a_failed_sample_keeps_its_row_and_is_in_no_statistic(outputs, frames, runs, study, monkeypatch):
    """Sample 5 finds no equilibrium at one state of the second crank angle; all others are as before."""
    failed_steps = []

    def spoiled(*arguments):
        response = respond(*arguments)
        failed_steps.append(response)
        if len(failed_steps) == 2:
            response.equilibria.converged[5, [3, 9]] = False
            response.equilibria.residual[5, 3] = 0.02
            response.converged[5] = False
        return response

    monkeypatch.setattr(hysteresis, "respond", spoiled)
    failed = run_study(study.model_copy(update={"name": "failing"}), runs)
    assert failed["hysteresis"].record["failed"] == 1
    status = pd.DataFrame(failed["hysteresis"].read("status")).set_index(["sample", "crank_deg"])["status"]
    bad = (5, 90.0)
    torque = assembly.load_cycle(study, study.cycle.levels_per_branch).state_torque[3] / 1e3
    assert status[bad] == f"no equilibrium at {torque:.4g} N m or before: residual 2.0e-02"
    assert set(status.drop(bad)) == {"ok"}
    assert len(failed["hysteresis"].read("curves")["step"]) == len(frames["hysteresis/curves"])
    keys = ["sample", "crank_deg"]
    metrics = pd.DataFrame(failed["aggregate"].read("metrics")).set_index(keys)
    assert metrics.loc[bad, list(library())].isna().all()
    assert not metrics.loc[bad].filter(like="_valid").any()
    expected = frames["aggregate/metrics"].set_index(keys)
    pd.testing.assert_frame_equal(metrics.drop(bad), expected.drop(bad), check_categorical=False)
    table = pd.DataFrame(failed["aggregate"].read("distributions")).query("statistic == 'mean'")
    rows = table[table["metric"] == "lost_motion_arcmin"]
    assert list(rows.query("over == 'angle'").set_index("crank_deg")["n"].loc[[0.0, 90.0]]) == [8, 7]
    assert list(rows.query("over != 'angle'")["n"]) == [7, 7, 7]
    units = pd.DataFrame(failed["aggregate"].read("units")).set_index("sample")
    assert units.loc[5].filter(like="_worst").isna().all()
    assert units.loc[5, "status"] == status[bad]


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
    units = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample").filter(like="clearance_backlash")
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
        np.zeros(2, int), np.zeros(2), np.zeros((1, 2)), np.arange(2), states, np.zeros((1, 2)), np.ones(1, bool)
    )
    values = curves._curve_values(curves.Solved(0.0, drive, response, {}))
    assert values["peak_pressure_MPa"][0, 0] == laws.pressure[100] * 100
    moment = np.abs(reducer.pins.arm[1:3]) * force[0, 0, 1:3]
    np.testing.assert_allclose(values["beyond_limit_share"], [[moment[0] / moment.sum(), 0.0]])
    np.testing.assert_array_equal(values["pins_in_contact"], [[2, 2]])
    np.testing.assert_array_equal(values["outputs_in_contact"], [[1, 0]])
    np.testing.assert_array_equal(values["bearing_y_um"], 1e3 * motion[..., 1])
    np.testing.assert_array_equal(values["iterations"], [[3, 4]])

"""The whole chain of a drive with pins in holes: balances, joins, limits, and a report that speaks of output pins."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_study import save_named

from pipeline import assembly, elastic
from pipeline.config import load_design, parse_study
from pipeline.engine.runner import Resources, run
from pipeline.figures import style
from stages.chain import STAGES

ROOT = Path(__file__).parents[2]


def small_study(name, **changes):
    """The committed study with few samples and a coarse mesh; ``changes`` update its sections."""
    data = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 6
    del data["cycle"]["loaded_angles"]
    data["cycle"] |= {"crank_deg": [0.0, 37.0, 211.0], "levels_per_branch": 4, "keep_contacts": "all"}
    data["cycle"] |= {"rigid_angles": 31}
    data["reduce"] |= {"flank_edges_per_lobe": 16, "patch_half_width_mm": 0.9, "growth": 0.6, "largest_edge_mm": 5.0}
    data["springs"]["table_points"] = 16
    for section, values in changes.items():
        data[section] = values if isinstance(values, str) else data.get(section, {}) | values
    return parse_study(data, name, f"{name}.toml", lambda design: load_design(design, ROOT))


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def outputs(runs):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "save", save_named("output_loads"))
        return run(STAGES, small_study("holes"), ["report"], runs, Resources(1, 4))


def frame(outputs, stage, table):
    return pd.DataFrame(outputs[stage].read(table))


def test_contacts_have_names_places_and_patches(outputs):
    contacts = frame(outputs, "clearance", "contacts")
    pins = contacts[contacts["kind"] == "output"]
    assert len(pins) == 3 * 10
    assert (pins["label"] == [f"output pin {k}" for k in pins["station"]]).all()
    assert set(zip(pins["body_a"], pins["body_b"], strict=True)) == {("disk", "output")}
    assert (pins["interface"] == 0).all()
    np.testing.assert_allclose(pins["curvature_per_mm"], -1 / 7.205)
    rows = frame(outputs, "reduce", "contacts")
    assert rows.groupby("crank_deg")["contact"].apply(list).tolist() == [list(range(50))] * 3
    of_holes = rows["contact"] >= 40
    assert (rows.loc[of_holes, "patch_half_width_mm"] == 0.6).all()
    assert (rows.loc[~of_holes, "patch_half_width_mm"] == 0.9).all()


def test_gaps_are_those_of_clearance_diameter_and_eccentricity(outputs):
    gaps, sampled = frame(outputs, "clearance", "gaps"), frame(outputs, "sample", "rollers")
    eccentricity = frame(outputs, "sample", "reducer")["eccentricity_um"].to_numpy()
    of_pins = gaps[gaps["contact"] >= 40]["clearance_um"].to_numpy().reshape(7, 3, 10)
    diameter = sampled["diameter_um"].to_numpy().reshape(7, 1, 10)
    np.testing.assert_allclose(of_pins, np.broadcast_to(5 - diameter / 2 - eccentricity[:, None, None], (7, 3, 10)))
    assert np.ptp(eccentricity) > 1


def test_output_pins_and_pins_carry_the_torque(outputs):
    forces = frame(outputs, "hysteresis", "contacts").merge(frame(outputs, "clearance", "contacts"))
    forces["moment_Nm"] = 1e-3 * forces["force_N"] * forces["arm_mm"]
    steps = forces.groupby(["sample", "crank_deg", "step", "kind"])
    moment = steps["moment_Nm"].sum().unstack("kind")
    torque = steps["torque_Nm"].first().unstack("kind")["pin"]
    assert np.ptp(torque) == 800
    for kind in ("pin", "output"):
        np.testing.assert_allclose(moment[kind], -torque, atol=1e-6)
    assert set(frame(outputs, "hysteresis", "status")["status"]) == {"ok"}


def test_loop_is_as_wide_at_zero_torque_as_the_rigid_play(outputs):
    metrics, kinematic = frame(outputs, "aggregate", "metrics"), frame(outputs, "clearance", "kinematic")
    assert not kinematic["preloaded"].any()
    rigid = metrics.merge(kinematic, on=["sample", "crank_deg"])["backlash_arcmin"]
    np.testing.assert_allclose(metrics["clearance_backlash_arcmin"], rigid, rtol=1e-6)
    assert (kinematic["backlash_arcmin"] > 0.5).all()


def test_report_speaks_of_output_pins(outputs):
    page = (outputs["report"].folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert (outputs["report"].folder / "figures" / "output_loads.svg").is_file()
    assert "Forces on the output pins" in page
    assert "10 output pins of radius 6 mm on a circle of radius 45 mm, in holes of the disk of radius 7.205 mm" in page
    assert "output rollers" not in page.replace("output rollers or pins", "")
    assert "sliding plate" not in page


@pytest.mark.long
def test_the_numbers_of_a_fixed_flange_are_read_at_the_housing(outputs, runs):
    ratio = 40 / 39
    study = small_study("housing", samples={"count": 2}, cycle={"crank_deg": [37.0]})
    cycloid = study.design.cycloid.model_copy(update={"fixed": "flange", "rated_torque_Nm": 400.0 * ratio})
    design = study.design.model_copy(update={"cycloid": cycloid})
    housing_outputs = run(STAGES, study.model_copy(update={"design": design}), ["aggregate"], runs, Resources(1, 4))
    keys = ["sample", "crank_deg"]
    of_housing = frame(housing_outputs, "aggregate", "metrics").set_index(keys)
    of_flange = frame(outputs, "aggregate", "metrics").set_index(keys).loc[of_housing.index]
    for metric, factor in (
        ("clearance_backlash_arcmin", 1 / ratio),
        ("lost_motion_arcmin", 1 / ratio),
        ("torsional_rigidity_Nm_per_arcmin", ratio**2),
        ("peak_pressure_MPa", 1),
    ):
        np.testing.assert_allclose(of_housing[metric], factor * of_flange[metric], rtol=1e-7, err_msg=metric)


@pytest.mark.parametrize("law", ["palmgren", "hertz"])
def test_the_laws_of_output_pins_are_those_of_a_cylinder_in_its_hole(law):
    study = small_study("law", springs={"law": law})
    reducer = assembly.reducer(study.design, 37.0)
    laws = assembly.contact_laws(study, reducer)[reducer.n_pins :]
    force = np.array([1.0, 100.0, 3000.0])[:, None] * np.ones(10)
    if law == "palmgren":
        whole = 3.84e-5 * force**0.9 / 15**0.8
        mesh_part = 2 * force / (np.pi * 206e3 * 15) * (np.log(2 * 6 / 0.6) - 0.25 - 0.15)
        np.testing.assert_allclose(laws.deflection(force), whole - mesh_part)
    else:
        line, modulus, radius = force / 15, 206e3, 6 * 7.205 / 1.205
        b = np.sqrt(4 * line * radius / (np.pi * modulus / 2))
        expected = 2 * line / (np.pi * modulus) * (np.log(4 * 6 / b) - 0.5 + np.log(0.6 / b) + 0.25)
        np.testing.assert_allclose(laws.deflection(force), expected)
        np.testing.assert_allclose(laws.peak_pressure(force), 2 * line / (np.pi * b * np.sqrt(0.91)))  # plane strain
        assert np.all(np.sqrt(laws.force_limit / force[0]) * b[0] <= 3.0 * (1 + 1e-12))  # half of the pin's radius


@pytest.mark.attack
def test_stiffness_of_the_whole_drive_hardly_depends_on_the_width_of_the_patches(runs):
    """One law and one mesh for every patch: what the narrower patch yields more, the law yields less.

    Of a cylinder between flats and of holes alone that is in make test: ``test_verify.py``, ``test_perforation.py``.
    """
    rigidity = []
    for width in (0.4, 0.8):
        reduce = {"roller_patch_half_width_mm": width}
        study = small_study(f"width{int(10 * width)}", reduce=reduce, cycle={"crank_deg": [37.0]})
        metrics = pd.DataFrame(run(STAGES, study, ["aggregate"], runs, Resources(1, 4))["aggregate"].read("metrics"))
        rigidity.append(metrics["torsional_rigidity_Nm_per_arcmin"].to_numpy())
    np.testing.assert_allclose(rigidity[0], rigidity[1], rtol=3e-3)


@pytest.fixture(scope="module")
def perforated():
    study = small_study("arms")
    return study, elastic.elastic_disk(study)


@pytest.mark.parametrize("crank", [0.0, 90.0, 123.4])
def test_patches_carry_unit_forces_with_the_arms_of_their_contacts(perforated, crank):
    study, disk = perforated
    reducer = assembly.reducer(study.design, crank)
    patches = elastic.disk_patches(study, disk, reducer)
    resultant = disk.rigid_motions.T @ disk.loads(patches).toarray()
    side = np.where(reducer.contacts.kind == "output", -1, 1)
    turn = np.exp(1j * np.radians(crank) / study.design.cycloid.lobes)
    np.testing.assert_allclose(resultant[0] + 1j * resultant[1], side * reducer.contacts.normal * turn, atol=1e-12)
    np.testing.assert_allclose(resultant[2], side * reducer.contacts.arm, atol=0.02)
    tangent = 1j * reducer.contacts.normal * turn
    spread = np.real(np.conj(tangent)[:, None] * (patches.points - patches.points @ patches.weights[:, None]))
    widths = np.where(reducer.contacts.kind == "output", 0.6, 0.9)
    np.testing.assert_allclose(spread.max(axis=1), widths, rtol=2e-3)

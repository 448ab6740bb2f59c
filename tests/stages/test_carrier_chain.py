"""An RV reducer through the whole chain, and what a study, a unit and the tails of it refuse."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import assembly
from pipeline.config import load_design, load_study, parse_design, parse_study
from pipeline.elastic import disk_patches, elastic_disk
from pipeline.engine.runner import Resources, run
from pipeline.errors import InputError
from pipeline.population.tails import tails_of
from pipeline.report.inputs import reducer_facts
from stages.chain import STAGES
from stages.tables.condensed import COMPLIANCE_FILE, full_compliance

ROOT = Path(__file__).parents[2]
DESIGN = tomllib.loads((ROOT / "data/designs/rv_81_two_disks.toml").read_text(encoding="utf-8"))


def small_study(study="rv", **changes):
    data = tomllib.loads((ROOT / f"data/studies/{study}.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 3
    data["cycle"] |= {"crank_deg": [37.0], "levels_per_branch": 4, "rigid_angles": 1, "keep_contacts": "all"}
    data["reduce"] |= {"flank_edges_per_lobe": 16, "patch_half_width_mm": 0.9, "growth": 0.6, "largest_edge_mm": 5.0}
    for section, values in changes.items():
        data[section] = data.get(section, {}) | values
    return parse_study(data, "rv_small", "rv_small.toml", lambda design: load_design(design, ROOT))


@pytest.mark.parametrize(("name", "rated"), [("rv", 200), ("rv_two_disks", 400)])
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
    assert frames["loops"]["bearing_force_N"].isna().all()
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


def test_the_report_tells_cranks_gears_and_their_ratio():
    facts = {name: text.replace("\u00a0", " ") for name, text in reducer_facts(load_design("rv_81", ROOT))}
    words = "carrier with 2 cranks on a circle of radius 45 mm, a sun of 20 and planets of 40 teeth before them"
    assert facts["Output"] == f"{words}: total ratio 81"
    assert "Bearing of each crank" in facts


@pytest.mark.parametrize(
    ("section", "key", "value", "line"),
    [
        ("output", "crank_circle_radius_mm", 60.0, "output.crank_circle_radius_mm = 60.0; the holes reach 75 mm from"),
        (
            "output",
            "crank_circle_radius_mm",
            34.0,
            "output.crank_circle_radius_mm = 34.0; the holes reach within 19",
        ),
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
    with pytest.raises(InputError, match="the rough model of the tails holds the disk's centre"):
        tails_of(load_study("rv", ROOT))

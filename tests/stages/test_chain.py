"""The chain of stages on the paper's reducer: what every row must satisfy, and what no setting may change."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from small_study import LAST, run_study, small_study

from pipeline import assembly
from pipeline.engine.fingerprint import used_settings
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from pipeline.model.equilibrium.solve import ACCEPTED_RESIDUAL, ElasticReducer, solve
from pipeline.model.load_history.load_cycle import ARCMIN
from stages import hysteresis
from stages.chain import STAGES
from stages.springs import laws_of_columns

Outputs = dict[str, Output]


def frame(outputs: Outputs, stage: str, table: str) -> pd.DataFrame:
    return pd.DataFrame(outputs[stage].read(table))


@pytest.mark.long
def test_every_stage_writes_its_tables_with_units_in_the_metadata(outputs: Outputs, runs: Path) -> None:
    outputs = run(STAGES, small_study(), [stage.name for stage in STAGES[:-1]], runs, Resources(1, 100))
    for stage in STAGES[:-1]:
        for table in stage.tables:
            path = runs / "quick" / stage.name / f"{table.name}.parquet"
            part = next(path.iterdir()) if path.is_dir() else path
            schema = pq.read_schema(part)
            assert schema.names == [column.name for column in table.columns]
            for column in table.columns:
                assert schema.field(column.name).metadata[b"unit"].decode() == column.unit
                assert schema.field(column.name).metadata[b"meaning"]
            assert len(pd.read_parquet(path)) == outputs[stage.name].record["tables"][table.name]["rows"]


def test_force_is_the_laws_and_penetration_is_elastic_plus_local(outputs: Outputs) -> None:
    contacts = frame(outputs, "hysteresis", "contacts")
    coefficients = outputs["springs"].read("coefficients")
    for crank, rows in contacts.groupby("crank_deg"):
        laws = laws_of_columns(coefficients, crank)
        local = rows["local_um"].to_numpy().reshape(-1, len(laws)) / 1e3
        force = rows["force_N"].to_numpy().reshape(local.shape)
        np.testing.assert_allclose(laws.force(local), force, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(contacts["penetration_um"], contacts["elastic_um"] + contacts["local_um"], atol=1e-12)
    in_contact = contacts[contacts["force_N"] > 0]
    np.testing.assert_allclose(
        in_contact["approach_um"], in_contact["clearance_um"] + in_contact["penetration_um"], atol=1e-7
    )
    opening = contacts[(contacts["force_N"] == 0) & (contacts["torque_Nm"] != 0)]
    assert np.all(opening["approach_um"] - opening["clearance_um"] <= opening["elastic_um"] + 1e-9)
    assert len(in_contact) > 1000
    assert np.all(contacts["force_N"] >= 0)


@pytest.mark.parametrize("part", ["pin", 0, 1])
def test_every_part_of_the_chain_carries_the_torque(outputs: Outputs, part: str | int) -> None:
    contacts = frame(outputs, "hysteresis", "contacts")
    places = frame(outputs, "clearance", "contacts")[["contact", "crank_deg", "interface", "kind", "arm_mm"]]
    rows = contacts.merge(places, on=["contact", "crank_deg"])
    rows = rows[rows["kind"] == "pin"] if part == "pin" else rows[rows["interface"] == part]
    keys = ["sample", "crank_deg", "step"]
    moment = (rows["force_N"] * rows["arm_mm"]).groupby([rows[key] for key in keys]).sum()
    torque = rows.groupby(keys)["torque_Nm"].first()
    np.testing.assert_allclose(-moment, 1e3 * torque, rtol=1e-8, atol=1e-8)


def test_loop_is_as_wide_at_zero_torque_as_the_rigid_play(outputs: Outputs) -> None:
    metrics, kinematic = frame(outputs, "aggregate", "metrics"), frame(outputs, "clearance", "kinematic")
    kinematic = kinematic[kinematic["crank_deg"].isin(metrics["crank_deg"])]
    free = ~kinematic["preloaded"].to_numpy(bool)
    assert np.count_nonzero(free) >= 16
    width = metrics["zero_torque_width_arcmin"].to_numpy()[free]
    np.testing.assert_allclose(width, kinematic["backlash_arcmin"].to_numpy()[free], atol=1e-6)
    assert np.all(width > 0.5)
    assert set(metrics["status"]) == {"ok"}


def test_loaded_solution_tends_to_the_rigid_play(outputs: Outputs, runs: Path) -> None:
    study = small_study()
    curves = frame(outputs, "hysteresis", "curves")
    n = study.samples.rows
    gap = outputs["clearance"].read("gaps")["clearance_um"].reshape(n, len(study.cycle.crank_deg), -1) / 1e3
    coefficients = outputs["springs"].read("coefficients")
    for k, crank in enumerate(study.cycle.crank_deg):
        reducer = assembly.reducer(study.design, crank)
        laws = laws_of_columns(coefficients, crank)
        compliance = hysteresis.full_compliance(outputs["reduce"].path("compliance.npz"), reducer, crank)
        width = np.zeros(n)
        for sense, branch in ((1, "loading+"), (-1, "loading-")):
            torque = np.array([sense * 1e-6 * 12_000.0])
            start = np.zeros((n, len(reducer.motions)))
            elastic = ElasticReducer(reducer, assembly.bearing(study.design), laws, compliance)
            loaded_states = solve(elastic, gap[:, k], np.zeros(n), start, torque)
            assert np.all(loaded_states.residual <= ACCEPTED_RESIDUAL)
            end = curves[(curves["crank_deg"] == crank) & (curves["branch"] == branch) & (curves["torque_Nm"] == 0)]
            width += sense * (
                ARCMIN * loaded_states.motion[:, 0, reducer.output_motion] - end["angle_arcmin"].to_numpy()
            )
        assert np.all((width > 0) & (width < 1e-4))


def test_metrics_are_those_of_the_curves(outputs: Outputs) -> None:
    curves, metrics = frame(outputs, "hysteresis", "curves"), frame(outputs, "aggregate", "metrics")
    keys = ["sample", "crank_deg"]
    rising = curves[curves["branch"].isin(["loading+", "loading-"])].assign(torque=curves["torque_Nm"].round(9))
    angle = rising.pivot_table(index=keys, columns=["branch", "torque"], values="angle_arcmin", observed=True)
    loading_branch, unloading = angle["loading+"], angle["loading-"]
    metrics = metrics.set_index(keys)
    lost_motion, rigid = metrics["lost_motion_arcmin"], metrics["torsional_rigidity_Nm_per_arcmin"]
    np.testing.assert_allclose(lost_motion, loading_branch[0.36] - unloading[-0.36], rtol=1e-12)
    np.testing.assert_allclose(
        rigid, 3 / (loading_branch[12.0] - loading_branch[6.0]) + 3 / (unloading[-6.0] - unloading[-12.0]), rtol=1e-12
    )
    assert np.all(lost_motion > metrics["clearance_backlash_arcmin"])


@pytest.mark.parametrize(("jobs", "chunk"), [(1, 100), (2, 3)])
@pytest.mark.long
def test_values_depend_on_no_jobs_and_chunks(outputs: Outputs, runs: Path, jobs: int, chunk: int) -> None:
    study = small_study()
    repeat = run_study(study.model_copy(update={"name": f"again-{jobs}-{chunk}"}), runs, jobs, chunk)
    assert {name: output.hashes for name, output in repeat.items()} == {
        name: output.hashes for name, output in outputs.items()
    }


@pytest.mark.long
def test_a_sample_does_not_depend_on_how_many_follow(outputs: Outputs, runs: Path) -> None:
    fewer = run_study(small_study(count=5).model_copy(update={"name": "fewer"}), runs)
    for stage, table in (("sample", "pins"), ("clearance", "gaps"), ("hysteresis", "curves")):
        longer = frame(outputs, stage, table)
        pd.testing.assert_frame_equal(
            frame(fewer, stage, table), longer[longer["sample"] <= 5], check_exact=True, check_categorical=False
        )


@pytest.mark.long
def test_zero_tolerance_has_no_backlash_and_uniform_tolerance_the_published_share(runs: Path) -> None:
    study = small_study(experiment="cases", count=2, nominal_first=False)
    cases = ({"label": "none"}, {"label": "disk", "disk_profile": 5.0})
    settings = {**study.model_dump(exclude={"tolerances"}), "name": "cases", "cases": cases}
    outputs = run_study(type(study).model_validate(settings), runs)
    backlash = frame(outputs, LAST, "metrics").groupby("sample")["clearance_backlash_arcmin"]
    assert backlash.max()[0] < 1e-6
    assert 5 * 0.0631 < backlash.min()[1] <= backlash.max()[1] < 5 * 0.0633


def test_the_page_depends_on_the_name_of_its_study_and_no_table_does() -> None:
    """A run that is copied to another name keeps its tables; its page names the study in sentences and commands."""
    study = small_study()
    named = {stage.name for stage in STAGES if "name" in used_settings(stage, study)}
    assert named == {"report"}

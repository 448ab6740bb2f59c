"""Effects of a design in the stages: friction opens the loop by what it must, the rest reaches gaps and laws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_study import ROOT, run_study, small_study

from pipeline import assembly
from pipeline.config import Study, load_design, parse_study
from pipeline.config.designs.problems import study_effect_problems
from pipeline.config.reading import parse_design, read_toml
from pipeline.engine.cache import Cache
from pipeline.engine.fingerprint import source_hashes
from pipeline.engine.stage import Job
from pipeline.engine.store import Output
from pipeline.errors import InputError
from pipeline.model.contact.friction_elements import output_sliders
from pipeline.model.effects import library
from pipeline.model.elements import Friction
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.friction.frictional_cycle import refined_cycle, solve_frictional_cycle
from pipeline.model.load_history.load_cycle import LoadCycle, solve_cycle
from pipeline.mounting import drive_of
from pipeline.report.inputs import design_numbers, reducer_facts
from pipeline.sampling.errors import draw
from stages.hysteresis import prepare

Outputs = dict[str, Output]
ENDS = 1e-4
"""Angle [arcmin] between +-1e-5 of the rated torque, which stand for no torque."""


def with_design_effects(study: Study, **effects: dict[str, float]) -> Study:
    return study.model_copy(update={"design": study.design.model_copy(update={"effects": effects})})


def run_with(runs: Path, name: str, **effects: dict[str, float]) -> Outputs:
    """Three units at the study's two crank angles; of rigid bodies at three more."""
    study = with_design_effects(small_study(count=3), **effects)
    cycle = study.cycle.model_copy(update={"rigid_angles": 3})
    return run_study(study.model_copy(update={"name": name, "cycle": cycle}), runs)


def metrics(outputs: Outputs) -> pd.DataFrame:
    return pd.DataFrame(outputs["aggregate"].read("metrics"))


def curve_at(outputs: Outputs, branch: str, torque: float) -> np.ndarray:
    curves = pd.DataFrame(outputs["hysteresis"].read("curves"))
    rows = curves[(curves["branch"] == branch) & np.isclose(curves["torque_Nm"], torque)]
    return rows["angle_arcmin"].to_numpy()


@pytest.fixture(scope="module")
def bare_run(runs: Path) -> Outputs:
    return run_with(runs, "plain")


@pytest.fixture(scope="module")
def rubbing(runs: Path) -> Outputs:
    return run_with(runs, "rubbing", coulomb={"torque_Nm": 1.0})


def test_constant_friction_opens_the_loop_by_the_frictionless_curve_between_plus_and_minus_it(
    bare_run: Outputs, rubbing: Outputs
) -> None:
    """With the friction M the output stands at T = 0 where the frictionless one stands at +-M."""
    exact = curve_at(bare_run, "unloading+", 1.0) - curve_at(bare_run, "loading-", -1.0)
    result = metrics(rubbing)
    np.testing.assert_allclose(result["zero_torque_width_arcmin"], exact, atol=ENDS)
    backlash = metrics(bare_run)["clearance_backlash_arcmin"]
    np.testing.assert_allclose(result["clearance_backlash_arcmin"], backlash, atol=1e-6)
    np.testing.assert_array_equal(
        result["hysteresis_loss_arcmin"], result["zero_torque_width_arcmin"] - result["clearance_backlash_arcmin"]
    )
    assert np.all(result["hysteresis_loss_arcmin"] > 0.1)
    assert not result["lost_motion_arcmin_valid"].any()  # its 0.36 N m are less than the friction


def test_branches_part_by_the_friction_at_load(bare_run: Outputs, rubbing: Outputs) -> None:
    np.testing.assert_allclose(curve_at(rubbing, "unloading+", 4.0), curve_at(bare_run, "loading+", 5.0), atol=1e-6)
    np.testing.assert_allclose(curve_at(rubbing, "reloading+", 5.0), curve_at(bare_run, "loading+", 4.0), atol=1e-6)


def test_state_at_zero_torque_is_one_on_both_branches_where_the_output_sticks(rubbing: Outputs) -> None:
    np.testing.assert_allclose(curve_at(rubbing, "unloading+", 0.0), curve_at(rubbing, "loading-", 0.0), atol=ENDS)


@pytest.mark.long
def test_width_grows_with_the_friction_of_the_pins_and_forces_keep_their_laws(runs: Path, bare_run: Outputs) -> None:
    """One unit and the nominal one at one crank angle: every contact rubs, so that a path is slow."""
    first_metrics = metrics(bare_run).query("sample <= 1 and crank_deg == 0")
    widths, parts = [first_metrics["zero_torque_width_arcmin"].to_numpy()], []
    study = small_study(count=1)
    cycle = study.cycle.model_copy(update={"crank_deg": (0.0,), "rigid_angles": 3, "levels_per_branch": 6})
    for number, coefficient in enumerate((0.01, 0.04)):
        rubbing_pins = with_design_effects(study, contact_friction={"coefficient": coefficient})
        outputs = run_study(rubbing_pins.model_copy(update={"name": f"pins{number}", "cycle": cycle}), runs)
        assert set(metrics(outputs)["status"]) == {"ok"}
        parts.append(curve_at(outputs, "unloading+", 6.0) - curve_at(outputs, "reloading+", 6.0))
        widths.append(metrics(outputs)["zero_torque_width_arcmin"].to_numpy())
        contacts = pd.DataFrame(outputs["hysteresis"].read("contacts"))
        closing_values = contacts[contacts["force_N"] > 1e-3]
        np.testing.assert_allclose(
            closing_values["approach_um"], closing_values["clearance_um"] + closing_values["penetration_um"], atol=1e-6
        )
    assert np.all(parts[0] > 0)
    assert np.all(parts[1] > 2 * parts[0])
    np.testing.assert_allclose(widths[1], widths[0], atol=2e-2)  # no load, no friction: the play alone


@pytest.mark.long
def test_torsion_of_the_output_adds_its_angle_to_every_step_and_no_force(runs: Path, bare_run: Outputs) -> None:
    twisted = run_with(runs, "twisted", output_torsion={"compliance_arcmin_per_Nm": 0.25})
    curves_before, curves_after = (
        pd.DataFrame(outputs_of_run["hysteresis"].read("curves")) for outputs_of_run in (bare_run, twisted)
    )
    np.testing.assert_allclose(
        curves_after["angle_arcmin"], curves_before["angle_arcmin"] + 0.25 * curves_before["torque_Nm"], atol=1e-9
    )
    forces = [outputs_of_run["hysteresis"].read("contacts")["force_N"] for outputs_of_run in (bare_run, twisted)]
    np.testing.assert_array_equal(*forces)


@pytest.mark.long
def test_clearance_of_the_bearing_and_preload_reach_the_backlash(runs: Path, bare_run: Outputs) -> None:
    loose = metrics(run_with(runs, "loose", bearing_clearance={"clearance_um": 20.0}))["clearance_backlash_arcmin"]
    tight = metrics(run_with(runs, "tight", preload={"interference_um": 2.0}))["clearance_backlash_arcmin"]
    curves_before = metrics(bare_run)["clearance_backlash_arcmin"]
    assert np.all(loose >= curves_before)
    assert np.all(loose[::2] > curves_before[::2] + 1)  # crank at 0
    assert np.all(tight < curves_before - 0.05)


@pytest.mark.long
def test_softer_seats_lower_the_rigidity_in_series(runs: Path, bare_run: Outputs) -> None:
    soft = metrics(run_with(runs, "soft", seat_compliance={"compliance_um_per_N": 0.05}))
    curves_before = metrics(bare_run)["torsional_rigidity_Nm_per_arcmin"]
    assert np.all(soft["torsional_rigidity_Nm_per_arcmin"] < 0.98 * curves_before)
    np.testing.assert_allclose(
        soft["clearance_backlash_arcmin"], metrics(bare_run)["clearance_backlash_arcmin"], atol=1e-6
    )


def test_friction_above_the_torque_of_a_definition_leaves_no_number(runs: Path, bare_run: Outputs) -> None:
    """0.5 N m of friction holds the output at 0.36 N m: a lost motion of 0.24 arcmin, below the play, passed once."""
    stuck = run_with(runs, "stuck", coulomb={"torque_Nm": 0.5})
    table = metrics(stuck)
    assert not table["lost_motion_arcmin_valid"].any()
    assert table["lost_motion_arcmin"].isna().all()
    assert set(table["status"]) == {"friction holds the output at the torque of its definition (lost motion not valid)"}
    remaining = ["clearance_backlash_arcmin", "torsional_rigidity_Nm_per_arcmin", "hysteresis_loss_arcmin"]
    assert table[remaining].notna().all(axis=None)
    np.testing.assert_allclose(
        table["clearance_backlash_arcmin"], metrics(bare_run)["clearance_backlash_arcmin"], atol=1e-6
    )
    assert np.all(table["hysteresis_loss_arcmin"] > 0)
    distributions = pd.DataFrame(stuck["aggregate"].read("distributions"))
    assert "lost_motion_arcmin" not in set(distributions["metric"])
    assert "all_limits" not in set(distributions["metric"])  # no unit is known to keep the limit on the lost motion
    assert {"clearance_backlash_arcmin", "torsional_rigidity_Nm_per_arcmin"} <= set(distributions["metric"])
    assert stuck["hysteresis"].record["failed"] == 0


@pytest.mark.parametrize("name", library())
def test_gaps_of_no_effect_depend_on_the_bodies_that_yield(study: Study, name: str) -> None:
    """So that the stage clearance may take rigid ones."""
    effect = library()[name]
    crank = study.cycle.crank_deg[0]
    sampled = draw(study, 0, 2)
    errors = assembly.errors(sampled)
    loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    bare = drive_of(study, crank, None, errors, loose)
    soft = 1e-5 * np.eye(bare.gap.shape[1])
    values = {
        parameter.name: low + 0.3 * (high - low)
        for parameter, (low, high) in zip(effect.parameters, effect.bounds(bare), strict=True)
    }
    variant = with_design_effects(study, **{name: values})
    rigid, elastic = (drive_of(variant, crank, bodies, errors, loose) for bodies in (None, soft))
    np.testing.assert_array_equal(rigid.gap, elastic.gap)
    np.testing.assert_array_equal(rigid.bearing_clearance, elastic.bearing_clearance)


def _drive(study: Study, outputs: Outputs) -> Drive:
    """Two samples at the first crank angle, on the disk and the laws of the stages."""
    shared = prepare(Job(study, 1, ROOT, outputs, Cache(ROOT, "")))
    errors = assembly.errors(draw(study, 1, 3))
    crank, springs = study.cycle.crank_deg[0], (shared.compliances[0], errors, np.zeros(2), shared.laws[0])
    return drive_of(study, crank, *springs)


def test_work_of_constant_friction_is_its_torque_times_the_way(study: Study, outputs: Outputs) -> None:
    torque, cycle = 700.0, LoadCycle.evenly(12e3, 300, 1.0, (0.03, 0.5, 1.0))
    drive = _drive(study, outputs)
    reducer = drive.reducer
    drive = replace(drive, elements=(Friction(output_sliders(reducer, np.array([torque]), np.array([1e-7]))),))
    path = solve_frictional_cycle(drive, cycle, solve_cycle(drive, refined_cycle(cycle))).equilibria
    branch, state = cycle.steps
    loop = branch > 0
    angle, load = path.motion[:, loop, reducer.output_motion], cycle.state_torque[state][loop]
    work = np.trapezoid(np.broadcast_to(load, angle.shape), angle, axis=1)
    np.testing.assert_allclose(work, 2 * torque * np.ptp(angle, axis=1), rtol=2e-3)


def test_path_without_sliders_is_the_frictionless_cycle(study: Study, outputs: Outputs) -> None:
    drive = _drive(study, outputs)
    cycle = assembly.load_cycle(study, study.cycle.levels_per_branch)
    weak = replace(drive, elements=(Friction(output_sliders(drive.reducer, np.array([1e-6]), np.array([1e-5]))),))
    path_found = solve_frictional_cycle(weak, cycle, solve_cycle(weak, refined_cycle(cycle))).equilibria
    states = solve_cycle(drive, cycle)
    _, state = cycle.steps
    is_loaded = cycle.state_torque[state] != 0
    assert np.all(path_found.converged)
    np.testing.assert_allclose(
        path_found.force[:, is_loaded], states.force[:, state][:, is_loaded], rtol=1e-6, atol=1e-6
    )


def design_with(effects: object) -> dict:
    return {**read_toml(ROOT / "data/designs/pham2017.toml"), "effects": effects}


def test_mistakes_in_effects_are_all_answered_with_what_is_allowed() -> None:
    with pytest.raises(InputError) as error:
        parse_design(design_with({"colomb": {}, "coulomb": {"torque": 1.0}, "preload": {"interference_um": "3"}}), "d")
    lines = list(error.value.problems)
    assert any("effects.preload.interference_um" in line and "number" in line for line in lines)
    with pytest.raises(InputError) as error:
        parse_design(design_with({"colomb": {}, "coulomb": {"torque": 1.0}}), "d")
    lines = list(error.value.problems)
    assert any(line.startswith("d: effects.colomb") and "coulomb" in line and "preload" in line for line in lines)
    assert any("effects.coulomb.torque = 1.0" in line and "coulomb has torque_Nm" in line for line in lines)
    assert any("effects.coulomb.torque_Nm is missing" in line and "N m" in line for line in lines)


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [
        ("creep", {"compliance_arcmin_per_Nm": 0.1, "time_s": 3.0}, "has no time"),
        ("thermal_growth", {"difference_um_per_m_K": 10.0}, "at the temperature of the drawing"),
    ],
)
def test_what_a_study_cannot_show_is_refused_with_the_reason(name: str, values: dict, reason: str) -> None:
    design = parse_design(design_with({name: values}), "d")
    with pytest.raises(InputError, match=reason):
        parse_study(read_toml(ROOT / "data/studies/quick.toml"), "quick", "quick.toml", lambda _: design)


def test_every_other_effect_changes_a_study(study: Study) -> None:
    """An effect that a study accepts moves the gaps, the springs or the friction of its drives."""
    crank, n = study.cycle.crank_deg[0], 2
    sampled = draw(study, 1, 1 + n)
    settings = study, crank, None, assembly.errors(sampled), np.zeros(n)
    bare = drive_of(*settings)
    for name, effect in library().items():
        values = {
            parameter.name: low + 0.7 * (high - low)
            for parameter, (low, high) in zip(effect.parameters, effect.bounds(bare), strict=True)
        }
        variant = with_design_effects(study, **{name: values})
        if list(study_effect_problems({name: values}, 0.0)):
            continue
        drive = drive_of(variant, *settings[1:])
        is_same = (
            np.array_equal(drive.gap, bare.gap)
            and np.array_equal(drive.bearing_clearance, bare.bearing_clearance)
            and np.array_equal(drive.compliance, bare.compliance)
            and np.array_equal(drive.laws.linear, bare.laws.linear)
            and drive.bearing == bare.bearing
            and not drive.elements
        )
        assert not is_same, name


def test_the_page_tells_effects_by_title_quantity_and_unit() -> None:
    values = {
        "output_torsion": {"compliance_arcmin_per_Nm": 0.05},
        "load_friction": {"coefficient": 0.1},
        "seat_compliance": {"compliance_um_per_N": 0.01},
    }
    design = with_design_effects(small_study(count=1), **values).design
    told = dict(reducer_facts(design))["Effects"]
    assert "compliance 0.05 ′/(N m)" in told
    assert "(coefficient 0.1)" in told
    (rows,) = [numbers for section, numbers in design_numbers(design) if section == "effects"]
    assert {(row.name, row.unit) for row in rows} == {
        (f"{library()['output_torsion'].title}, compliance", "′/(N m)"),
        (f"{library()['load_friction'].title}, coefficient", ""),
        (f"{library()['seat_compliance'].title}, compliance", "µm/N"),
    }


def test_effects_are_sources_of_the_stages_that_honour_them_and_of_no_mesh() -> None:
    effects = "pipeline/model/effects/friction.py"
    assert effects in source_hashes("stages.hysteresis")
    assert effects in source_hashes("stages.clearance")
    assert effects not in source_hashes("stages.reduce")


def test_a_design_without_effects_says_so() -> None:
    assert load_design("pham2017", ROOT).effects == {}


@pytest.mark.parametrize("name", ["thermal_growth", "modulus_temperature"])
def test_an_effect_of_the_temperature_runs_where_the_design_states_a_rise(name):
    effect = library()[name]
    values = {parameter.name: 0.01 for parameter in effect.parameters}
    assert list(study_effect_problems({name: values}, 0.0))
    assert not list(study_effect_problems({name: values}, 12.0))

"""What the page says of the turn, against runs with twice as many crank angles and against brute force."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog

from pipeline import assembly
from pipeline.config import Study, load_design, parse_study
from pipeline.config.designs.sections import FrictionSection, Operation, Rating
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from pipeline.model.geometry.clearance import gaps
from pipeline.sampling.errors import draw
from stages.chain import STAGES
from stages.tables.convergence import continuation

ROOT = Path(__file__).parents[2]
HEADLINES = ("clearance_backlash_arcmin", "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin")


def turned(angles: int) -> Study:
    """Fifty units of the paper's reducer with a rigid disk on its springs, loaded at so many angles."""
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = 50
    data["cycle"] = {"turn": "crank", "loaded_angles": angles, "levels_per_branch": 0, "curve_angles": 1}
    data["reduce"] = {"disk": "rigid"}
    data["springs"]["table_points"] = 16
    data["limits"]["peak_pressure_MPa"] = 4200.0  # which some units keep over the turn
    return parse_study(data, f"turn-{angles}", "turn.toml", lambda design: load_design(design, ROOT))


@pytest.fixture(scope="module")
def outputs(new_runs: Callable[[], Path]) -> dict[int, dict[str, Output]]:
    """A run at 31 angles and one at 63."""
    runs = new_runs()
    return {angles: run(STAGES, turned(angles), ["aggregate"], runs, Resources(1, 100)) for angles in (31, 63)}


@pytest.fixture(scope="module")
def tables(outputs: dict[int, dict[str, Output]]) -> dict[int, pd.DataFrame]:
    """Their tables of convergence."""
    return {angles: pd.DataFrame(stages["aggregate"].read("convergence")) for angles, stages in outputs.items()}


@pytest.mark.long
def test_the_worst_of_twice_as_many_angles_is_what_the_run_expects(tables: dict[int, pd.DataFrame]) -> None:
    expected = tables[31][tables[31]["extrapolated"]].set_index("metric")
    actual = tables[63][tables[63]["n_angles"] == 63].set_index("metric")
    own_rows = tables[31][tables[31]["n_angles"] == 31].set_index("metric")
    for metric in HEADLINES[1:]:
        current, as_far, settled = (
            rows.loc[metric, column]
            for rows, column in (
                (own_rows, "worst_mean"),
                (expected, "worst_mean"),
                (expected, "worst_mean_settled"),
            )
        )
        shifted = actual.loc[metric, "worst_mean"] - current
        assert shifted * (as_far - current) > 0
        slack = 0.001 * current
        low, high = sorted((as_far - current, settled - current))
        assert low - slack <= shifted <= high + slack
    slack = 0.02  # one of the fifty units
    low, high = expected.loc["all_limits", ["yield", "yield_settled"]]
    assert low - slack <= actual.loc["all_limits", "yield"] <= high + slack
    assert high < own_rows.loc["all_limits", "yield"]


def test_a_sequence_is_continued_as_far_again_and_by_a_quarter() -> None:
    assert continuation(np.array([1.0, 1.5, 1.7])) == pytest.approx((1.9, 1.75))
    assert continuation(np.array([1.0, 0.9, 0.7])) == pytest.approx((0.5, 0.65))
    assert continuation(np.array([2.0, 2.0, 2.0])) == (2.0, 2.0)


def test_the_peak_of_a_smooth_curve_is_missed_by_a_quarter_where_the_angles_double() -> None:
    """The mean worst over all phases of a wave, by quadrature: each doubling leaves a quarter of what is missed."""
    phases = np.linspace(0, 2 * np.pi, 4001)[:-1]
    worst = np.array(
        [np.mean(np.max([np.cos(phases + 2 * np.pi * k / n) for k in range(n)], axis=0)) for n in (8, 16, 32, 64)]
    )
    assert np.diff(worst)[1:] / np.diff(worst)[:-1] == pytest.approx(0.25, abs=0.01)
    assert continuation(worst[:-1])[1] == pytest.approx(worst[-1], abs=1e-4)


def test_backlash_over_the_turn_by_a_general_linear_program(tmp_path: Path) -> None:
    """Of the nominal reducer and two units at 13 of the angles, each by HiGHS in the motions of disk and output."""
    study = turned(31)
    sampled = draw(study, 0, 3)
    profile, errors = assembly.profile(study.design), assembly.errors(sampled)
    cranks = [360 * k / 181 for k in range(0, 181, 15)]
    angles = np.zeros((2, 3, len(cranks)))
    for k, crank in enumerate(cranks):
        reducer = assembly.reducer(study.design, crank)
        gap = 1e3 * gaps(profile, reducer, errors, **dict(study.clearance))  # um
        motions = reducer.contact_jacobian[:, 2:]  # the disk's centre is held: the bearing has no clearance
        for unit in range(3):
            ends = [
                linprog(sense * np.eye(motions.shape[1])[-1], motions, gap[unit], bounds=(None, None)).x[-1]
                for sense in (-1, 1)
            ]
            angles[:, unit, k] = np.array(ends) * 1e-3 * 180 * 60 / np.pi
    small_study = study.model_copy(update={"samples": study.samples.model_copy(update={"count": 2})})
    outputs = run(STAGES, small_study, ["clearance"], tmp_path, Resources(1, 100))
    kinematic = pd.DataFrame(outputs["clearance"].read("kinematic"))
    for unit in range(3):
        rows = kinematic[kinematic["sample"] == unit].set_index("crank_deg").loc[cranks]
        np.testing.assert_allclose(rows["backlash_arcmin"], angles[0, unit] - angles[1, unit], rtol=1e-6)
        np.testing.assert_allclose(rows["angle_plus_arcmin"], angles[0, unit], rtol=1e-6)
        np.testing.assert_allclose(rows["angle_minus_arcmin"], angles[1, unit], rtol=1e-6)


def test_the_error_of_a_unit_is_the_range_of_its_output_angle_over_the_turn(
    outputs: dict[int, dict[str, Output]],
) -> None:
    """Peak to peak from the tables of loops and play, its orders by a fit of waves to the table of the error."""
    aggregate = outputs[31]["aggregate"]
    units = pd.DataFrame(aggregate.read("units")).set_index("sample")
    loops = pd.DataFrame(outputs[31]["hysteresis"].read("loops")).groupby("sample")
    play = pd.DataFrame(outputs[31]["clearance"].read("kinematic")).groupby("sample")
    loaded_ranges = pd.concat([loops[name].agg(np.ptp) for name in ("high_plus_arcmin", "high_minus_arcmin")], axis=1)
    free = pd.concat([play[name].agg(np.ptp) for name in ("angle_plus_arcmin", "angle_minus_arcmin")], axis=1)
    np.testing.assert_allclose(units["transmission_error_arcsec"], 60 * loaded_ranges.max(axis=1), rtol=1e-12)
    roomy = ~play["preloaded"].any()
    assert roomy.sum() > 45
    np.testing.assert_allclose(
        units["unloaded_transmission_error_arcsec"][roomy], 60 * free.max(axis=1)[roomy], rtol=1e-9
    )
    errors, waves = (pd.DataFrame(aggregate.read(name)) for name in ("transmission", "orders"))
    of_unit = errors.query("sample == 7 and sense == '-' and torque_Nm == -12")
    crank = np.radians(of_unit["crank_deg"].to_numpy())
    columns = [wave(order * crank) for order in range(1, 16) for wave in (np.cos, np.sin)]
    fit = np.linalg.lstsq(np.column_stack([np.ones(31), *columns]), of_unit["error_arcsec"].to_numpy(), rcond=None)[0]
    amplitude = waves.query("sample == 7 and sense == '-' and torque_Nm == -12")["amplitude_arcsec"]
    np.testing.assert_allclose(amplitude, np.hypot(fit[1::2], fit[2::2]), rtol=1e-9)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, dict[str, Output]]:
    """Two units of the paper's reducer with a floating plate, a speed, friction and a rated bearing."""
    study = turned(9)
    output = study.design.output.model_copy(update={"plate": "floats"})
    operation = Operation(
        input_speed_rpm=1500.0,
        pins="fixed",
        friction=FrictionSection(
            pin_coefficient=0.05, output_coefficient=0.02, bearing_coefficient=0.002, bearing_bore_mm=12.0
        ),
        rating=Rating(kind="roller", dynamic_load_N=9000.0),
    )
    study = study.model_copy(
        update={
            "design": study.design.model_copy(update={"output": output, "operation": operation}),
            "samples": study.samples.model_copy(update={"count": 2}),
            "cycle": study.cycle.model_copy(update={"keep_contacts": "all"}),
        }
    )
    return study, run(STAGES, study, ["aggregate"], tmp_path_factory.mktemp("running"), Resources(1, 100))


@pytest.mark.long
def test_life_and_efficiency_from_the_contacts_of_a_turn(running: tuple[Study, dict[str, Output]]) -> None:
    """By the tables and pencil: power of friction pin by pin, mean of the 10/3rd power of the bearing's force."""
    study, outputs = running
    units = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample")
    contacts = pd.DataFrame(outputs["hysteresis"].read("turn_contacts"))
    bearings = pd.DataFrame(outputs["hysteresis"].read("bearings"))
    assert len(contacts) == 3 * 9 * 2 * 120
    assert np.all(contacts.loc[contacts["contact"] >= 80, "sliding_m_per_s"] == 0)
    speed, ratio = 1500 * 2 * np.pi / 60, 79
    s = np.hypot(1 - 0.35 * 80 / 32.5 * np.cos(0.0), 0)  # the pin on the eccentric's line at crank angle 0
    sliding = contacts.query("contact == 0 and crank_deg == 0")["sliding_m_per_s"]
    np.testing.assert_allclose(sliding, 1e-3 * speed / ratio * (32.5 * s - 0.8), rtol=1e-9)
    for sample in range(3):
        own_rows = contacts[contacts["sample"] == sample]
        pressure_speed = (own_rows["pressure_MPa"] * own_rows["sliding_m_per_s"]).max()
        assert units.loc[sample, "pressure_speed_MPa_m_per_s"] == pytest.approx(pressure_speed, rel=1e-12)
        assert units.loc[sample, "subsurface_shear_MPa"] == pytest.approx(
            0.3 * own_rows["pressure_MPa"].max(), rel=1e-12
        )
        assert units.loc[sample, "shear_depth_um"] == pytest.approx(own_rows["shear_depth_um"].max(), rel=1e-12)
        lives, efficiencies = [], []
        for torque in (12.0, -12.0):
            held_rows = own_rows[own_rows["torque_Nm"] == torque]
            force = bearings.query("sample == @sample and torque_Nm == @torque")
            force = np.hypot(force["force_x_N"], force["force_y_N"]).to_numpy()
            at_pins = 0.05 * (held_rows["force_N"] * held_rows["sliding_m_per_s"]).sum() / 9
            at_bearing = 0.002 * 6e-3 * force.mean() * speed * 80 / 79
            output = 12 * speed / ratio
            efficiencies.append(100 * (1 - (at_pins + at_bearing) / (output + at_pins + at_bearing)))
            lives.append((9000 / np.mean(force ** (10 / 3)) ** 0.3) ** (10 / 3) * 1e6 / (60 * 1500 * 80 / 79))
        assert units.loc[sample, "efficiency_percent"] == pytest.approx(min(efficiencies), rel=1e-12)
        assert units.loc[sample, "bearing_life_h"] == pytest.approx(min(lives), rel=1e-12)
        assert 80 < min(efficiencies) < 99

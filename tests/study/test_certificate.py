"""The certificate of a unit: its band holds units with the measured dimensions, compensation removes their error."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_study
from pipeline.config.dimensions import dimension_library
from pipeline.config.reading import load_case
from pipeline.decisions import certificate as certificates
from pipeline.decisions.certificate import (
    certificate,
    compensation,
    gauged_values,
    limit_sentence,
    measured_values,
    write_certificate,
)
from pipeline.decisions.play_bounds import ATTAINED_BOUND, LEAST_FOUND
from pipeline.errors import InputError
from pipeline.library.decisions import loaded_units
from pipeline.library.lots import certificate as certified_unit
from pipeline.library.lots import whole_loops
from pipeline.report.decisions.certificate import compensation_sentence, unit_next_step
from pipeline.sampling.errors import draw, draw_with_parts
from pipeline.statistics.intervals import Estimate
from stages import hysteresis

ROOT = Path(__file__).parents[2]
CRANKS = (0.0, 40.0, 90.0)


def rigid_study(**effects: dict[str, float]):
    """The quick study with a rigid disk at three crank angles."""
    study = load_study("quick", ROOT)
    return study.model_copy(
        update={
            "reduce": study.reduce.model_copy(update={"disk": "rigid"}),
            "cycle": study.cycle.model_copy(update={"crank_deg": CRANKS, "loaded_angles": None, "curve_angles": 3}),
            "design": study.design.model_copy(update={"effects": effects}),
        }
    )


def shared_of(study):
    reducers = [assembly.reducer(study.design, crank) for crank in study.cycle.crank_deg]
    laws = tuple(assembly.contact_laws(study, reducer) for reducer in reducers)
    rigid = tuple(np.zeros((len(entry), len(entry))) for entry in laws)
    curve, brief = (assembly.load_cycle(study, levels) for levels in (study.cycle.levels_per_branch, 0))
    return hysteresis.Shared(study, study.cycle.crank_deg, curve, brief, laws, rigid)


@pytest.fixture(scope="module")
def measured_file(tmp_path_factory) -> Path:
    """A unit of which the disk, the crank and all pins but their tangential position were measured."""
    rng = np.random.default_rng(1)
    radial, radius = rng.normal(0, 1, 80).round(2).tolist(), rng.uniform(-1, 0, 80).round(2).tolist()
    path = tmp_path_factory.mktemp("unit") / "unit17.toml"
    path.write_text(f"disk_profile = 12.0\neccentricity = 0.5\npin_radial = {radial}\npin_radius = {radius}\n")
    return path


@pytest.fixture(scope="module")
def certified(measured_file):
    study = rigid_study()
    shared, case = shared_of(study), load_case(measured_file, study)
    return certificate(study, case, partial(loaded_units, shared), partial(whole_loops, shared), 60)


def stated_dimensions(study, unit) -> str:
    """A file of the dimensions of the first unit that vary in a study; ovalities are in the places of the pins."""
    lines = []
    for name, dimension in dimension_library().items():
        if getattr(study.tolerances, name).varies and not dimension.acts_on:
            lines.append(f"{name} = {getattr(unit, dimension.field)[0].tolist()}")
    return "\n".join(lines)


def unit_like(measured_file, study, number: int):
    """Another unit with the measured dimensions of the file, its other dimensions drawn anew."""
    case = load_case(measured_file, study)
    known = measured_values(case)
    samples = study.samples.model_copy(update={"seed": 77, "count": 200, "nominal_first": False})
    return draw_with_parts(study.model_copy(update={"samples": samples}), known, number, number + 1)


@pytest.mark.long
def test_the_band_holds_19_of_20_units_with_the_measured_dimensions(measured_file, certified):
    study = certified.study
    shared = shared_of(study)
    table = certified.metrics.set_index("metric")
    inside = []
    for number in range(24):
        values = loaded_units(shared, unit_like(measured_file, study, number))[1]
        inside.append([table.low[name] <= values[name][0] <= table.high[name] for name in table.index[:3]])
    assert np.mean(inside) > 0.85
    assert np.mean(inside) <= 1.0


def test_bounds_hold_every_unit_that_the_measured_one_may_be(certified):
    bounds = {bound.quantity: bound.value for bound in certified.bounds}
    zero = len(certified.loops.torque) // 2
    play = certified.loops.angle[:, 0, 0, zero] - certified.loops.angle[:, 0, 0, zero - 1]
    assert bounds[LEAST_FOUND] < bounds[ATTAINED_BOUND]
    assert np.all(play > bounds[LEAST_FOUND])  # play and the deflection at the smallest torques


def test_measured_dimensions_narrow_the_band(certified):
    study = certified.study
    shared = shared_of(study)
    nothing = load_case_of(study, "")
    wide = certificate(study, nothing, partial(loaded_units, shared), partial(whole_loops, shared), 60)
    name = "clearance_backlash_arcmin"
    widths = [(c.metrics.set_index("metric").high - c.metrics.set_index("metric").low)[name] for c in (wide, certified)]
    assert widths[1] < 0.85 * widths[0]


def test_a_unit_that_probably_fails_is_not_sent_to_the_controller(certified):
    chances = certified.metrics.assign(probability=0.9)
    chances.loc[chances["metric"] == "lost_motion_arcmin", "probability"] = 0.005
    failing, passing, unlimited = (
        replace(certified, metrics=chances, meets_all=share)
        for share in (Estimate(0.005, 0.0, 0.03, 200), Estimate(0.95, 0.91, 0.98, 200), None)
    )
    assert "it probably fails, first on lost motion (met with a probability of 0.5 %)" in unit_next_step(failing)
    assert "compensation.csv" not in unit_next_step(failing)
    assert unit_next_step(passing) == unit_next_step(unlimited)
    assert "a metric that has a limit has no value" in unit_next_step(replace(failing, metrics=chances[:0]))
    assert unit_next_step(passing).startswith("Load compensation.csv into the controller, for the crank angles")
    assert "at the 3 crank angles that were solved" in limit_sentence(passing)


def test_loops_beyond_the_model_count_nowhere(certified):
    three = replace(certified.loops, angle=certified.loops.angle[:3])
    kept = certificates._valid_loops(three, np.array([True, False, True]))
    np.testing.assert_array_equal(kept.angle, three.angle[[0, 2]])


def test_a_unit_beyond_the_model_has_no_compensation(tmp_path):
    """400 um off the flank: the metrics have none of these units, and no table may send their loops to a controller."""
    study = rigid_study()
    shared = shared_of(study)
    case = load_case_of(study, "disk_profile = 400.0\n")
    unit = certificate(study, case, partial(loaded_units, shared), partial(whole_loops, shared), 8)
    frames = write_certificate(unit, tmp_path)
    assert not len(frames["metrics"])
    assert frames["compensation"]["error_arcmin"].isna().all()
    assert json.loads((tmp_path / "compensation.json").read_text())["error_arcmin"] is None
    assert "no draw is within the model's range" in unit_next_step(unit)
    assert "There is no compensation table" in compensation_sentence(unit, None)


def load_case_of(study, text: str):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "unknown.toml"
        path.write_text(text)
        return load_case(path, study)


def test_compensation_leaves_the_undeclared_effect_alone(measured_file, certified):
    """A generated unit has 0.2 N m of friction that the study does not declare: the table removes what it knows."""
    study = rigid_study(coulomb={"torque_Nm": 0.2})
    loops = whole_loops(shared_of(study), unit_like(measured_file, study, 3))
    cranks, senses, torques = np.meshgrid(loops.crank_deg, [True, False], loops.torque, indexing="ij")
    rows = (cranks.ravel(), senses.ravel(), torques.ravel())
    position = np.repeat(np.arange(3), loops.angle[0, 0].size)
    result = compensation(certified, *rows, loops.angle[0].ravel(), position)
    assert result.after_arcmin < 0.35 * result.before_arcmin
    without = whole_loops(shared_of(certified.study), unit_like(measured_file, certified.study, 3))
    alone = compensation(certified, *rows, without.angle[0].ravel(), position)
    assert alone.after_arcmin < result.after_arcmin


def test_senses_agree_without_friction_and_differ_by_it_with_friction(measured_file, certified):
    """Both senses hold the same torques; a friction torque shifts the loop along the torque by its size."""
    loops = certified.loops
    assert loops.torque == pytest.approx(-loops.torque[::-1])
    assert loops.angle[:, :, 0] == pytest.approx(loops.angle[:, :, 1], abs=1e-9)
    study = rigid_study(coulomb={"torque_Nm": 0.5})
    rubbing = whole_loops(shared_of(study), unit_like(measured_file, study, 3)).angle[0, 0]
    frictionless = whole_loops(shared_of(rigid_study()), unit_like(measured_file, study, 3)).angle[0, 0, 0]
    loaded = np.flatnonzero(loops.torque > 3.0)[:-1]
    for sense, sign in ((0, -1), (1, 1)):  # rising torque turns the output less, falling torque more
        expected = np.interp(loops.torque[loaded] + sign * 0.5, loops.torque, frictionless)
        assert rubbing[sense][loaded[:-3]] == pytest.approx(expected[:-3], abs=0.02)


def test_the_table_is_the_median_at_its_own_points_and_missing_beyond(certified):
    loops = certified.loops
    median = np.median(loops.angle, axis=0)
    torque = loops.torque[[0, 5, -1]]
    found = certified.predicted_angle(np.full(3, 40.0), np.array([True] * 3), torque)
    assert found == pytest.approx(median[1, 0, [0, 5, -1]])
    beyond = certified.predicted_angle(np.array([40.0, 200.0]), np.array([True] * 2), np.array([100.0, 1.0]))
    assert np.all(np.isnan(beyond))


def test_the_error_of_a_gauge_moves_all_elements_together_and_each_alone():
    read = {
        "pin_radius": np.full((1, 80), -0.5),
        "eccentricity": np.array([[1.0]]),
        "bearing_clearance": np.zeros((1, 1)),
    }
    read |= {"ovality_2": np.array([[3.0]]), "ovality_2_phase": np.array([[1.0]])}
    true = gauged_values(read, 0.3, 4000, 1)
    means = true["pin_radius"].mean(axis=1)
    assert np.std(means) == pytest.approx(0.3 * np.sqrt(1 + 1 / 80), rel=0.05)
    assert np.std(true["pin_radius"] - means[:, None]) == pytest.approx(0.3, rel=0.05)
    assert np.std(true["eccentricity"]) == pytest.approx(0.3, rel=0.05)
    assert true["bearing_clearance"].min() == 0
    assert np.std(true["ovality_2"]) == pytest.approx(0.3, rel=0.1)
    assert np.std(true["ovality_2_phase"]) == pytest.approx(0.1, rel=0.1)


def test_a_gauge_with_an_uncertainty_leaves_a_band_and_one_without_tells_each_limit(certified):
    study = rigid_study()
    shared = shared_of(study)
    text = stated_dimensions(study, draw(study, 1, 2))
    solve = partial(loaded_units, shared), partial(whole_loops, shared)
    sharp, blurred = (
        certificate(study, load_case_of(study, f"{text}\n{key}"), *solve, 20) for key in ("", "measured_to_um = 0.3")
    )
    assert sharp.is_determined
    assert len(sharp.loops.angle) == 1
    assert [blurred.is_determined, certified.is_determined] == [False, False]
    assert "met by" in limit_sentence(sharp)
    assert "% CI" not in limit_sentence(sharp)
    assert "20 draws of the other dimensions and of the error of the gauge" in limit_sentence(blurred)
    assert "The uncertainty of the gauge, 0.3 um, is in it." in limit_sentence(blurred)
    assert "gauge is not in it" in limit_sentence(certified)
    assert "has no band" in compensation_sentence(sharp, None)
    low, median, high = (
        blurred.metrics.set_index("metric")[name]["lost_motion_arcmin"] for name in ("low", "median", "high")
    )
    assert low < median < high
    missed = replace(sharp, meets_all=Estimate(0.0, 0.0, 0.0, 1), metrics=sharp.metrics.assign(probability=0.0))
    assert "does not meet every limit" in limit_sentence(missed)
    assert "it misses the limit of the" in unit_next_step(missed)


def test_a_fault_in_the_dimensions_names_file_and_key():
    with pytest.raises(InputError, match="unknown.toml: disk_profil"):
        load_case_of(rigid_study(), "disk_profil = 3.0\n")
    with pytest.raises(InputError, match="measured_to_um = -0.3; must be >= 0"):
        load_case_of(rigid_study(), "measured_to_um = -0.3\n")
    with pytest.raises(InputError, match="pin_radius"):
        load_case_of(rigid_study(), "pin_radius = [1.0, 2.0]\n")


def test_without_draws_there_is_no_certificate():
    with pytest.raises(InputError, match="--draws = 0; must be at least 1"):
        certified_unit("unit.toml", rigid_study(), draws=0)


def test_it_says_why_the_play_has_no_bounds(certified):
    study = rigid_study()
    bounds, why_not = certificates._bounds(study, {"disk_profile": np.array([-300.0])}, certified.loops)
    assert bounds == ()
    assert "jam" in why_not
    everything = {name: np.zeros(1) for name, tolerance in study.tolerances if tolerance.varies}
    bounds, why_not = certificates._bounds(study, everything, certified.loops)
    assert bounds == ()
    assert "Every dimension that varies was measured" in why_not
    assert certified.why_no_bounds == ""

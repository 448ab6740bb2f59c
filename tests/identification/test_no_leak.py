"""Nothing that is fitted knows anything of held-out rows."""

import numpy as np
import pandas as pd
import pytest
from synthetic_unit import CRANKS, ROOT, Bench, make_unit

from pipeline.identification.fitting.build import build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.statements.verdict import judge

HELD_OUT = '[held_out]\nby = "position"\ntrain = [0.0, 40.0]\n'
STRETCH = 1.4
TRIED = ("coulomb", "output_torsion", "angle_drift")  # the bounds of a drift are of the range of the angle


def selected(folder, condensed):
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    visible = measurement.training_cells
    compliances = condensed(measurement.unit.study, measurement.rows.cranks.tolist())
    problem = build_problem(measurement, compliances, visible)
    selector = Selector(Fitter(problem), visible)
    selector.testable = {name: selector.testable[name] for name in TRIED}
    selection = selector.select(visible)
    return measurement, problem, selection, judge(selector.fitter, selection, visible), visible


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory, condensed):
    """A selection on two of three positions, as measured and with the third stretched."""
    folder = tmp_path_factory.mktemp("leak") / "u"
    bench = Bench(cranks=CRANKS, more=HELD_OUT, rows=40, known=False, noise=0.01)
    make_unit(folder, {"coulomb": [0.3]}, bench, condensed)
    run_before = selected(folder, condensed)
    rows = pd.read_csv(folder / "rows.csv")
    held_out = rows["crank_deg"] == CRANKS[2]
    rows.loc[held_out, "angle_arcmin"] *= STRETCH
    rows.loc[held_out, "time_s"] *= STRETCH
    rows.to_csv(folder / "rows.csv", index=False)
    return run_before, selected(folder, condensed)


@pytest.mark.long
def test_every_fitted_number_is_the_same_to_the_last_digit_whatever_held_out_rows_are(two_runs):
    (measured, problem, selection, verdict, visible), (_, variant, repeat, trial_result, _) = two_runs
    assert problem.data.noise == variant.data.noise
    np.testing.assert_array_equal(problem.data.sigma[visible], variant.data.sigma[visible])
    assert problem.met_needs == variant.met_needs
    assert (problem.span, problem.hours, problem.record) == (variant.span, variant.hours, variant.record)
    for pair in zip(problem.modes, variant.modes, strict=True):
        np.testing.assert_array_equal(*pair)
    assert selection.promised_misfits == repeat.promised_misfits
    assert list(selection.trials) == list(repeat.trials)
    for name, trial in {"": selection.base, **selection.trials}.items():
        twin = repeat.trials[name] if name else repeat.base
        np.testing.assert_array_equal(trial.fit.unknowns.flat, twin.fit.unknowns.flat)
        assert trial.evidence.value == twin.evidence.value
    assert verdict == trial_result
    assert "coulomb" in verdict.named_effects


@pytest.mark.long
def test_the_stretch_shows_where_all_rows_are_seen(two_runs):
    """The noise of all rows moves: what the training rows alone hold still would otherwise be no test."""
    (measured, problem, *_), (stretched, variant, *_) = two_runs
    all_cells = np.ones(len(problem.data), bool)
    noise = [item.noise_of(all_cells).within_branch.value for item in (measured, stretched)]
    assert noise[1] != noise[0]
    assert variant.trained_on(all_cells).span > 1.2 * problem.trained_on(all_cells).span


@pytest.mark.long
def test_noise_of_some_positions_is_that_of_a_unit_that_has_no_others(two_runs, tmp_path):
    (measured, _, _, _, visible), _ = two_runs
    folder = tmp_path / "u"
    folder.mkdir()
    for file in measured.unit.folder.iterdir():
        (folder / file.name).write_text(file.read_text())
    rows = pd.read_csv(folder / "rows.csv")
    rows[rows["crank_deg"] != CRANKS[2]].to_csv(folder / "rows.csv", index=False)
    isolated = Measurement.read(load_measured_unit(folder, ROOT)).repeatability
    subset = measured.noise_of(visible)
    for name in ("repeats", "random", "within_branch", "between_positions"):
        assert getattr(subset, name).value == pytest.approx(getattr(isolated, name).value, rel=1e-12, nan_ok=True)
    assert subset.torque_noise_Nm == pytest.approx(isolated.torque_noise_Nm)


@pytest.mark.long
def test_a_fold_of_two_positions_refits_an_effect_over_the_crank_angle(two_runs):
    """It was a KeyError: two positions cannot test what three have named."""
    (_, problem, *_), _ = two_runs
    all_cells = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem.trained_on(all_cells)), all_cells)
    fold = selector.trained_on(problem.data.position != 2)
    assert "ovality_2" in fold.testable
    assert fold.testable == selector.testable
    assert fold.problem.data.noise == problem.data.noise


@pytest.mark.long
def test_filters_limits_and_courses_of_training_rows_know_nothing_of_the_others(two_runs, tmp_path, condensed):
    """Other torque, time, noise and outliers where nothing is fitted: what a fit starts from is the same bit by bit."""
    (measured, problem, _, _, visible), _ = two_runs
    folder = tmp_path / "u"
    folder.mkdir()
    for file in measured.unit.folder.iterdir():
        (folder / file.name).write_text(file.read_text())
    rows, rng = pd.read_csv(folder / "rows.csv"), np.random.default_rng(4)
    held_out = rows["crank_deg"] == CRANKS[2]
    rows.loc[held_out, "torque_Nm"] = 1.03 * rows.loc[held_out, "torque_Nm"] + 0.05 * rng.standard_normal(
        held_out.sum()
    )
    rows.loc[rng.choice(np.flatnonzero(held_out), 2, replace=False), "angle_arcmin"] += 30.0
    rows.loc[held_out, "time_s"] -= 1e6
    rows.to_csv(folder / "rows.csv", index=False)
    variant = Measurement.read(load_measured_unit(folder, ROOT))
    assert (variant.torque_noise, variant.angle_step) == (measured.torque_noise, measured.angle_step)
    np.testing.assert_array_equal(variant.usable[variant.is_fitted], measured.usable[measured.is_fitted])
    seen_again = variant.training_cells
    repeat = build_problem(variant, condensed(variant.unit.study, CRANKS), seen_again)
    for name in ("torque", "angle", "count", "sigma", "row_error", "branch"):
        np.testing.assert_array_equal(
            getattr(repeat.data, name)[seen_again], getattr(problem.data, name)[visible], name
        )
    np.testing.assert_array_equal(repeat.forward.shares, problem.forward.shares)
    for position in np.unique(problem.data.position[visible]):
        for name, values in vars(problem.forward.courses[position]).items():
            np.testing.assert_array_equal(getattr(repeat.forward.courses[position], name), values, name)
    for pair in zip(problem.modes, repeat.modes, strict=True):
        np.testing.assert_array_equal(*pair)
    assert (repeat.span, repeat.hours, repeat.record, repeat.met_needs) == (
        *(problem.span, problem.hours),
        *(problem.record, problem.met_needs),
    )

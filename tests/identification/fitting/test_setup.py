"""From files to the problem: what the data offer, and how its cells are weighted."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from measured_bench import measured, write_unit
from reducers import MICROMETRE
from synthetic_unit import ROOT, Bench, make_unit, problem_of

from pipeline import assembly
from pipeline.assembly import contact_laws
from pipeline.config import load_study
from pipeline.config.studies.study import LAW_FACTORS
from pipeline.config.studies.tolerances import Tolerances
from pipeline.errors import InputError
from pipeline.identification.fitting import build
from pipeline.identification.fitting.build import _refuse_paths, build_problem
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.offered import rate_changes
from pipeline.identification.fitting.parameters import values_at_shares
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.model.effects import library
from pipeline.model.effects.effect import CRANKS, CYCLES, LOOPS, RATE, STILL, TIME


@pytest.mark.parametrize("locked", ["input", "output"])
def test_a_locked_output_lets_the_crank_turn_beyond_the_pins_pitch(locked, tmp_path, condensed):
    """Six arcmin of twist are 8 degrees of the crank at the ratio 79, and half a pitch of 80 pins is 2.25."""
    problem = problem_of(make_unit(tmp_path / "u", {}, Bench(locked=locked), condensed), condensed)
    why_not = problem.why_not(candidates()["contact_friction"])
    assert (STILL in problem.met_needs) == (locked == "input")
    assert why_not == "" if locked == "input" else "load_friction" in why_not


def test_cells_of_more_rows_are_known_better_by_the_noise_of_their_rows(tmp_path, condensed):
    """Of independent rows the variance of a cell goes with one over their number."""
    bench = Bench(cycles=4, rows=200, noise=0.05)
    data = problem_of(make_unit(tmp_path / "u", {}, bench, condensed), condensed).data
    calm = np.abs(data.torque) > 3.0  # beyond the play, where the noise of the torque plays no part
    many_rows, few_rows = calm & (data.count >= 12), calm & (data.count <= 8)
    ratio = np.median(data.sigma[few_rows] ** 2 * data.count[few_rows]) / np.median(
        data.sigma[many_rows] ** 2 * data.count[many_rows]
    )
    assert many_rows.sum() > 5
    assert few_rows.sum() > 5
    assert 0.7 < ratio < 1.4
    assert np.median(data.sigma[few_rows]) > 1.2 * np.median(data.sigma[many_rows])


def paced(folder, second=1.0, dwell=0.0, held=1, noise=0.0):
    """Two cycles whose torque goes at one rate, the second ``second`` times as fast, with a dwell [s] at its top.

    Each torque is read ``held`` times, with noise [N m].
    """
    table = measured(positions=(0.0,), cycles=2, per_branch=60)
    table = table.loc[np.repeat(table.index, held)].reset_index(drop=True)
    torque = table["torque_Nm"].to_numpy()
    step = np.abs(np.diff(torque, prepend=0.0)) / np.where(table["cycle"] == 1, second, 1.0)
    step[np.flatnonzero((table["cycle"] == 1) & (torque == torque.max()))] += dwell
    table["time_s"] = np.cumsum(np.maximum(step, 0.05))
    table["torque_Nm"] += noise * np.random.default_rng(1).standard_normal(len(table))
    measurement = Measurement.read(load_measured_unit(write_unit(folder, {"rows.csv": table}), ROOT))
    return rate_changes(measurement, np.ones(len(measurement.cells), bool))


def test_creep_is_told_from_hysteresis_by_another_rate_or_a_dwell(tmp_path):
    """At one rate a delay and a hysteresis that knows no rate open the same loops."""
    assert not paced(tmp_path / "even")
    assert not paced(tmp_path / "hardly", second=1.2)
    assert paced(tmp_path / "fast", second=2.0)
    assert paced(tmp_path / "dwell", dwell=20.0)
    assert paced(tmp_path / "staircase", held=4, noise=0.02)
    assert not paced(tmp_path / "noisy", noise=0.2)
    assert RATE in candidates()["creep"].needs
    assert RATE not in candidates()["rayleigh"].needs


@pytest.mark.parametrize(("name", "record"), [("creep", TIME), ("run_in", CYCLES)])
def test_time_constants_lie_within_what_the_record_resolves(name, record, tmp_path, condensed):
    """Of shorter ones 95 % is over at the second reading; nothing beyond the record is described, let alone claimed."""
    problem = problem_of(make_unit(tmp_path / "u", {}, Bench(cycles=3, rows=40), condensed), condensed)
    low, high = problem.bounds(candidates()[name])[1]
    time = problem.forward.courses[0].time
    expected = (np.median(np.diff(time)), np.ptp(time)) if record == TIME else (1.0, 3.0)
    assert (low * np.log(20), high) == pytest.approx(expected, rel=0.05)
    fitter = Fitter(problem)
    model = Model((candidates()[name],))
    for share in (-1.0, 0.0, 1.0, 2.0):
        unknowns = fitter.start(model, [0.1, share])
        (_, value) = values_at_shares(fitter.bounds(model), unknowns.like(unknowns.flat).shares)
        assert low <= value * (1 + 1e-9)
        assert value <= high * (1 + 1e-9)


@pytest.mark.parametrize("angles", ["measured", "unknown"])
def test_crank_angles_that_nobody_knows_predict_no_difference_between_positions(angles, tmp_path, condensed):
    bench = Bench(cranks=(0.0, 40.0, 95.0), known=False, more=f'crank_angles = "{angles}"')
    unit = load_measured_unit(make_unit(tmp_path / "u", {}, bench, condensed), ROOT)
    measurement = Measurement.read(unit)
    np.testing.assert_array_equal(measurement.drive_cranks, (0.0, 40.0, 95.0) if angles == "measured" else (0.0,) * 3)
    problem = build_problem(measurement, condensed(unit.study, measurement.drive_cranks.tolist()))
    fitter = Fitter(problem)
    angle = fitter.predict(Model(), fitter.start(Model())).angle
    positions = [angle[problem.data.position == number] for number in range(3)]
    differences = [np.std(curve - positions[0]) for curve in positions[1:]]
    assert (max(differences) > 0.05) == (angles == "measured")
    assert (min(differences) < 0.02) == (angles == "unknown")  # cells of noisy torques lie a little apart
    assert (CRANKS in problem.met_needs) == (angles == "measured")


def test_what_was_measured_is_off_by_the_instrument_in_common_and_at_each_element():
    """Positions are off in both directions alike."""
    study = load_study("pin_in_hole", ROOT)
    exact = study.model_copy(update={"tolerances": Tolerances()})
    measured_names = SimpleNamespace(model_fields_set={"pin_radial", "eccentricity", "output_pin_position"})
    units = build._indistinguishable_errors(build._population(exact), measured_names, 0.8)
    unit, pins = 0.8 * MICROMETRE, units.pin_radial
    for part in (units.pin_off_hole.real, units.pin_off_hole.imag):
        assert np.std(part.mean(axis=1)) == pytest.approx(np.sqrt(1 + 1 / part.shape[1]) * unit, rel=0.15)
        assert np.std(part - part.mean(axis=1, keepdims=True)) == pytest.approx(unit, rel=0.15)
    assert np.std(units.eccentricity) == pytest.approx(np.sqrt(units.eccentricity.ndim) * unit, rel=0.15)
    assert np.std(pins.mean(axis=1)) == pytest.approx(np.sqrt(1 + 1 / pins.shape[1]) * unit, rel=0.15)
    assert np.std(pins - pins.mean(axis=1, keepdims=True)) == pytest.approx(unit, rel=0.15)
    assert not np.any(units.pin_radius)


def test_a_study_has_the_laws_of_the_fit_that_it_is_written_from(tmp_path, condensed):
    """Factors of the deflections of pins and output, and of the curvature of all contacts."""
    folder = make_unit(tmp_path / "u", {}, Bench(), condensed)
    problem, study = problem_of(folder, condensed), load_measured_unit(folder, ROOT).study
    factors = dict(zip((factor.key for factor in LAW_FACTORS), (1.3, 0.8, 2.0, 1.2), strict=True))
    written = study.model_copy(update={"springs": study.springs.model_copy(update=factors)})
    drive = problem.drives((1.0,) * len(problem.calibrated_keys) + tuple(factors.values()), 0)
    laws = contact_laws(written, drive.reducer)
    force = np.array([[0.5], [5.0], [50.0]]) * np.ones(len(laws))
    np.testing.assert_allclose(laws.deflection(force), drive.laws.deflection(force), rtol=1e-12)
    declared = contact_laws(study, drive.reducer).deflection(force)
    n = drive.reducer.n_pins
    for kind in (slice(None, n), slice(n, None)):
        share = laws.deflection(force)[:, kind] / declared[:, kind]
        assert np.all(share[0] > share[2] * 1.05)  # a larger curvature: more at small forces, less at large ones


def test_a_study_with_factors_of_its_own_is_fitted_about_them(tmp_path, condensed):
    """A corrected study may be refitted. A factor stays within what is plausible of it as a whole."""
    unit = load_measured_unit(make_unit(tmp_path / "u", {}, Bench(), condensed), ROOT)
    factors = dict(zip((factor.key for factor in LAW_FACTORS), (1.3, 0.8, 3.0, 1.2), strict=True))
    study = unit.study.with_section("springs", **factors)
    measurement = Measurement.read(replace(unit, design_study=study))
    problem = build_problem(measurement, condensed(study, measurement.rows.cranks.tolist()))
    drive, force = problem.nominal[0], np.full(len(problem.nominal[0].laws), 20.0)
    expected = contact_laws(study, drive.reducer).deflection(force)
    np.testing.assert_allclose(drive.laws.deflection(force), expected, rtol=1e-12)
    highest = np.exp(problem.scale_range[1, len(problem.calibrated_keys) :]) * list(factors.values())
    np.testing.assert_allclose(highest, [factor.plausible.high for factor in LAW_FACTORS], rtol=1e-12)


def test_a_pin_gives_way_by_the_factor_of_half_a_radius_where_its_contact_has_half_of_its_own():
    """1/R' = 1/r + the curvature of the flank; the contacts of the output stay, and a flat flank would."""
    study = load_study("pin_in_hole", ROOT)
    reducer = assembly.reducer(study.design, 30.0)
    force = np.full(len(reducer.contacts), 20.0)
    factored = contact_laws(study.with_section("springs", half_radius_factor=1.2), reducer)
    ratio = factored.deflection(force) / contact_laws(study, reducer).deflection(force)
    radius = study.design.cycloid.pin_radius_mm
    relative_radius = 1 / (1 / radius + reducer.pins.flank_curvature)
    np.testing.assert_allclose(ratio[: reducer.n_pins], (radius / relative_radius) ** np.log2(1.2), rtol=1e-12)
    np.testing.assert_allclose(ratio[reducer.n_pins :], 1.0, rtol=1e-15)
    assert np.ptp(ratio) > 0.1


def test_laws_of_another_curvature_are_alike_at_the_usual_force_of_the_pins_or_of_the_output():
    """Of n output pins in holes on a circle R, arms |R sin|: half of the torque over their half gives pi T/(2 n R)."""
    study = load_study("pin_in_hole", ROOT)
    reducer, usual = assembly.reducer(study.design, 30.0), assembly.usual_forces(study.design)
    curved = contact_laws(study.with_section("springs", curvature_factor=2.0), reducer)
    np.testing.assert_allclose(curved.deflection(usual), contact_laws(study, reducer).deflection(usual), rtol=1e-12)
    centres = study.design.output.holes(study.design.cycloid).centres
    torque = 1000 * study.design.cycloid.rated_torque_Nm
    expected = np.pi * torque / (2 * len(centres) * np.abs(centres[0]) * study.design.disk.count)
    np.testing.assert_allclose(usual[reducer.n_pins :], expected, rtol=0.04)
    assert np.all(usual[: reducer.n_pins] < 0.5 * expected)


@pytest.mark.parametrize(
    ("status", "is_refitted"), [("calibrated", True), ("chosen", True), ("published", False), ("given", False)]
)
def test_a_bearing_is_refitted_unless_somebody_states_its_stiffness(status, is_refitted):
    design = load_study("pin_in_hole", ROOT).design
    provenance = design.provenance[build.BEARING_STIFFNESS].model_copy(update={"status": status})
    design = design.model_copy(update={"provenance": {**design.provenance, build.BEARING_STIFFNESS: provenance}})
    assert (build.BEARING_STIFFNESS in build.refittable_keys(design)) == is_refitted


@pytest.mark.parametrize(
    ("moves", "turns", "need", "is_refused"),
    [
        ("fixed", False, STILL, False),
        ("follows_angle", False, STILL, True),
        ("follows_angle", False, LOOPS, False),
        ("fixed", True, LOOPS, True),
    ],
)
def test_a_design_may_not_declare_effects_that_a_crank_which_turns_does_not_allow(moves, turns, need, is_refused):
    name = next(name for name, effect in library().items() if need in effect.needs)
    design = SimpleNamespace(effects={name: None})
    settings = SimpleNamespace(crank=SimpleNamespace(moves=moves))
    measurement = TurningMeasurement.__new__(TurningMeasurement) if turns else SimpleNamespace()
    vars(measurement)["unit"] = SimpleNamespace(name="u", settings=settings, study=SimpleNamespace(design=design))
    with pytest.raises(InputError, match=name) if is_refused else nullcontext():
        _refuse_paths(measurement)

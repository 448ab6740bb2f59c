"""Samples of a study: counted, correctly distributed, correlated as asked."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline import assembly
from pipeline.assembly import errors as errors_in_mm
from pipeline.config import load_study
from pipeline.config.dimensions import dimension_library
from pipeline.config.dimensions.pins import oval_shift
from pipeline.config.distributions import library
from pipeline.config.distributions.shipped import Fixed, Normal, Triangular, Uniform
from pipeline.config.studies.tolerances import Case, Tolerances, case_problems
from pipeline.decisions.certificate import measured_values
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.mounting import drive_of
from pipeline.sampling.designs import correlated_numbers, replicates, uniforms
from pipeline.sampling.errors import (
    dimensions,
    draw,
    draw_as_measured,
    draw_with_parts,
    unmeasured_dimensions,
    usual_beside,
)
from stages.sample import columns_of_errors, errors_of_columns

ROOT = Path(__file__).parents[2]

STUDY = load_study("quick", Path(__file__).parents[2])
NAMES = [field.name for field in fields(draw(STUDY, 0, 0))]
EXPERIMENTS = ("monte_carlo", "sobol", "latin_hypercube")


def study(experiment="monte_carlo", count=48, tolerances=None, **samples):
    samples = STUDY.samples.model_copy(update={"experiment": experiment, "count": count, **samples})
    return STUDY.model_copy(update={"samples": samples, "tolerances": tolerances or STUDY.tolerances})


def assert_equal(errors, variant):
    for name in NAMES:
        np.testing.assert_array_equal(getattr(errors, name), getattr(variant, name), err_msg=name)


def rows(errors, part):
    return type(errors)(**{name: getattr(errors, name)[part] for name in NAMES})


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@given(cut=st.tuples(st.integers(0, 49), st.integers(0, 49)).map(sorted), nominal=st.booleans())
@settings(max_examples=25)
def test_a_sample_is_the_same_in_any_division(experiment, cut, nominal):
    whole = study(experiment, nominal_first=nominal)
    start, stop = min(cut[0], whole.samples.rows), min(cut[1], whole.samples.rows)
    assert_equal(draw(whole, start, stop), rows(draw(whole, 0, whole.samples.rows), slice(start, stop)))


@pytest.mark.parametrize("experiment", ["monte_carlo", "sobol"])
def test_a_sample_does_not_depend_on_how_many_follow(experiment):
    assert_equal(draw(study(experiment), 0, 49), draw(study(experiment, count=480), 0, 49))


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_another_seed_gives_other_samples(experiment):
    errors, remaining = draw(study(experiment), 1, 49), draw(study(experiment, seed=1), 1, 49)
    assert np.all(errors.pin_tangential != remaining.pin_tangential)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_a_tolerance_leaves_the_random_numbers_of_the_others_alone(experiment):
    variant = STUDY.tolerances.model_copy(
        update={
            "pin_tangential": Fixed(distribution="fixed", value_um=1.0),
            "bearing_clearance": Uniform(distribution="uniform", lower_um=0.0, upper_um=1.0),
        }
    )
    errors, remaining = draw(study(experiment), 0, 49), draw(study(experiment, tolerances=variant), 0, 49)
    np.testing.assert_array_equal(remaining.pin_tangential[1:], 1.0)
    for name in set(NAMES) - {"pin_tangential", "bearing_clearance"}:
        np.testing.assert_array_equal(getattr(errors, name), getattr(remaining, name), err_msg=name)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_pitch_errors_of_lobes_and_run_out_take_random_numbers_only_where_they_vary(experiment):
    steady = STUDY.tolerances.model_copy(update={"lobe_pitch": Fixed(distribution="fixed", value_um=2.0)})
    varied = {"lobe_pitch": Uniform(distribution="uniform", lower_um=-2.0, upper_um=6.0)}
    assert "lobe_pitch" not in dimensions(STUDY)
    errors, shifted = draw(study(experiment), 0, 49), draw(study(experiment, tolerances=steady), 0, 49)
    np.testing.assert_array_equal(shifted.lobe_pitch[1:], 2.0)
    for name in set(NAMES) - {"lobe_pitch"}:
        np.testing.assert_array_equal(getattr(errors, name), getattr(shifted, name), err_msg=name)
    draws = draw(study(experiment, tolerances=STUDY.tolerances.model_copy(update=varied)), 1, 49).lobe_pitch
    assert draws.shape == (48, 79)
    assert stats.kstest(draws.ravel(), stats.uniform(-2, 8).cdf).pvalue > 0.01
    off_centre = {"bore_runout": Fixed(distribution="fixed", value_um=3.0)}
    rotation = draw(study(experiment, tolerances=STUDY.tolerances.model_copy(update=off_centre)), 1, 49)
    assert stats.kstest(rotation.bore_runout_phase, stats.uniform(0, 2 * np.pi).cdf).pvalue > 0.01
    np.testing.assert_allclose(np.hypot(*errors_in_mm(rotation).bore_runout.T), 3e-3)
    assert not np.any(errors_in_mm(errors).bore_runout)


def test_no_samples_are_no_samples():
    assert [len(draw(study(), k, k)) for k in (0, 5, 49)] == [0, 0, 0]


def test_samples_outside_the_study_are_refused():
    with pytest.raises(ValueError, match="samples 40 to 50 asked of 49"):
        draw(study(), 40, 50)


def test_the_nominal_sample_has_the_allowances_only():
    tolerances = Tolerances(
        disk_profile=Triangular(distribution="triangular", lower_um=0.0, upper_um=4.0, allowance_um=8.0),
        eccentricity=Fixed(distribution="fixed", value_um=2.0, allowance_um=1.0),
        ovality_2=Uniform(distribution="uniform", lower_um=0.0, upper_um=1.0, allowance_um=0.5),
    )
    errors = draw(study(tolerances=tolerances), 0, 2)
    assert (errors.disk_profile[0], errors.eccentricity[0], errors.eccentricity[1]) == (8.0, 1.0, 3.0)
    theta = -2 * np.pi * np.arange(80) / 80
    np.testing.assert_allclose(errors.pin_radial[0], 0.5 * np.cos(2 * theta), atol=1e-12)
    for name in ("pin_tangential", "pin_radius", "lobe_profile", "roller_diameter"):
        assert not np.any(getattr(errors, name)[0])


def test_shapes_and_limits_of_every_error():
    tolerances, errors = STUDY.tolerances, draw(study(count=2000), 1, 2001)
    shapes = {"pin_tangential": 80, "pin_radius": 80, "lobe_profile": 79, "roller_diameter": 40}
    for name, elements in shapes.items():
        assert getattr(errors, name).shape == (2000, elements)
    for name in [*shapes, "disk_profile", "eccentricity"]:
        tolerance, values = getattr(tolerances, name), getattr(errors, name)
        lower, upper = (limit + tolerance.allowance_um for limit in tolerance.limits_um)
        assert lower <= values.min() < lower + 0.2 * (upper - lower)
        assert upper >= values.max() > upper - 0.2 * (upper - lower)


DISTRIBUTIONS = [
    (Uniform(distribution="uniform", lower_um=-1.0, upper_um=3.0), stats.uniform(-1, 4)),
    (Triangular(distribution="triangular", lower_um=-1.0, upper_um=3.0), stats.triang(0.5, -1, 4)),
    (Triangular(distribution="triangular", lower_um=-1.0, upper_um=3.0, mode_um=0.0), stats.triang(0.25, -1, 4)),
    (Triangular(distribution="triangular", lower_um=-1.0, upper_um=3.0, mode_um=3.0), stats.triang(1, -1, 4)),
    (Normal(distribution="normal", lower_um=-1.0, upper_um=3.0), stats.truncnorm(-3, 3, 1, 4 / 6)),
    (
        Normal(distribution="normal", lower_um=-1.0, upper_um=3.0, mean_um=2.0, sigma_um=2.0),
        stats.truncnorm(-1.5, 0.5, 2, 2),
    ),
]


@pytest.mark.parametrize(("tolerance", "exact"), DISTRIBUTIONS)
def test_deviations_are_the_inverse_of_the_distribution_function(tolerance, exact):
    probability = np.linspace(0, 1, 201)
    values = tolerance.deviation(probability)
    np.testing.assert_allclose(exact.cdf(values), probability, atol=1e-12)
    np.testing.assert_allclose(values[[0, -1]], tolerance.limits_um, atol=1e-12)


def test_a_normal_without_spread_is_its_mean():
    steady = Normal(distribution="normal", lower_um=-1.0, upper_um=3.0, mean_um=2.0, sigma_um=0.0)
    np.testing.assert_array_equal(steady.deviation(np.array([0.0, 0.3, 1.0])), 2.0)


@pytest.mark.parametrize("n", [79, 80])
@pytest.mark.parametrize("length", [0.5, 8.0, 200.0, 1e6])
def test_scores_along_the_circle_have_exactly_the_correlation_asked(n, length):
    # The copula is linear in the normal scores: its response to one score at a time is the root of the matrix.
    step = 1e-3
    root = stats.norm.ppf(correlated_numbers(stats.norm.cdf(step * np.eye(n)), 204.0, length)) / step
    distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    arc = 204.0 / n * np.minimum(distance, n - distance)
    np.testing.assert_allclose(root @ root.T, np.exp(-arc / length), atol=1e-9)


@pytest.mark.parametrize(("length", "share"), [(None, 0.8), (8.0, 0.3), (None, 1.0)])
def test_a_share_of_the_variance_is_common_to_all_elements(length, share):
    step, n = 1e-3, 20
    root = stats.norm.ppf(correlated_numbers(stats.norm.cdf(step * np.eye(n)), 204.0, length, share)) / step
    distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    drift = np.exp(-204.0 / n * np.minimum(distance, n - distance) / length) if length else np.eye(n)
    np.testing.assert_allclose(root @ root.T, share + (1 - share) * drift, atol=1e-9)


def test_rollers_of_one_batch_are_alike_within_a_unit_and_as_wide_over_all_units():
    of_rollers = Normal(distribution="normal", lower_um=-3.0, upper_um=3.0)
    apart, batch = (
        draw(study(count=3000, tolerances=Tolerances(roller_diameter=tolerance)), 1, 3001).roller_diameter
        for tolerance in (of_rollers, of_rollers.model_copy(update={"common_share": 0.8}))
    )
    matrix = np.corrcoef(batch.T)
    assert matrix[~np.eye(len(matrix), dtype=bool)] == pytest.approx(0.8, abs=0.03)
    assert batch.std(axis=0) == pytest.approx(apart.std(axis=0).mean(), rel=0.08)
    assert abs(np.corrcoef(apart.T)[0, 1]) < 0.08


def test_correlated_elements_keep_their_own_distribution():
    numbers = correlated_numbers(np.random.default_rng(1).random((4000, 80)), 204.0, 8.0)
    assert stats.kstest(numbers[:, 17], "uniform").pvalue > 0.01
    assert stats.spearmanr(numbers[:, 0], numbers[:, 79])[0] == pytest.approx(
        6 / np.pi * np.arcsin(np.exp(-204 / 80 / 8) / 2),
        abs=0.03,  # Spearman's coefficient of a Gaussian copula
    )


def test_zero_of_a_generator_has_a_finite_score():
    assert np.all(np.isfinite(correlated_numbers(np.array([[0.0, 0.5, 1.0, 0.2]]), 4.0, 1.0)))


def test_drift_of_a_study_runs_along_the_pins():
    lag = np.exp(-2 * np.pi * 32.5 / 80 / 8.0)  # quick.toml: 8 mm on the circle of radius 32.5
    errors = draw(study(count=3000, tolerances=Tolerances(pin_radial=STUDY.tolerances.pin_radial)), 1, 3001)
    neighbours = np.corrcoef(errors.pin_radial[:, :2].T)[0, 1]
    transverse = np.corrcoef(errors.pin_radial[:, [0, 40]].T)[0, 1]
    assert neighbours == pytest.approx(lag, abs=0.04)
    assert transverse == pytest.approx(0.0, abs=0.06)


@pytest.mark.parametrize("order", [2, 3])
def test_an_oval_ring_is_widest_at_its_phase(order):
    # Pin 10 of 80, clockwise, stands at -45 degrees.
    shift = oval_shift(np.array([2.0]), np.array([-np.pi / 4]), order, 80)[0]
    assert np.argmax(shift) in (10, 10 + 80 // order)
    assert shift[10] == pytest.approx(2.0)
    spectrum = np.abs(np.fft.rfft(shift)) / 40
    assert spectrum[order] == pytest.approx(2.0)
    assert np.sum(spectrum) == pytest.approx(2.0)


def test_ovality_adds_to_the_radial_errors_of_the_pins():
    with_oval, without_effect = (
        draw(study(tolerances=STUDY.tolerances.model_copy(update=update)), 0, 49)
        for update in ({}, dict.fromkeys(("ovality_2", "ovality_3"), Fixed(distribution="fixed", value_um=0.0)))
    )
    added = sum(
        oval_shift(getattr(with_oval, f"ovality_{m}_amplitude"), getattr(with_oval, f"ovality_{m}_phase"), m, 80)
        for m in (2, 3)
    )
    np.testing.assert_allclose(with_oval.pin_radial - without_effect.pin_radial, added, atol=1e-12)
    assert np.ptp(with_oval.ovality_2_phase[1:]) > np.pi


def test_latin_hypercube_visits_every_stratum_once_in_each_replicate():
    samples = study("latin_hypercube", count=160).samples
    numbers, replicate = uniforms(samples, 7, 0, 160), replicates(samples, np.arange(1, 161))
    for r in range(8):
        strata = np.sort(np.floor(20 * numbers[replicate == r]), axis=0)
        np.testing.assert_array_equal(strata, np.tile(np.arange(20)[:, None], 7))


def test_each_replicate_of_sobol_is_a_net_and_differs_from_the_others():
    samples = study("sobol", count=8 * 64).samples
    numbers, replicate = uniforms(samples, 5, 0, 512), replicates(samples, np.arange(1, 513))
    for r in range(8):
        strata = np.sort(np.floor(64 * numbers[replicate == r]), axis=0)
        np.testing.assert_array_equal(strata, np.tile(np.arange(64)[:, None], 5))
    assert len(np.unique(numbers, axis=0)) == 512


def test_only_sobol_and_hypercube_come_in_replicates():
    assert replicates(study().samples, np.arange(5)) is None
    np.testing.assert_array_equal(replicates(study("sobol").samples, np.array([1, 2, 8, 9, 10])), [0, 1, 7, 0, 1])
    whole = study("sobol", nominal_first=False).samples
    np.testing.assert_array_equal(replicates(whole, np.array([0, 7, 8])), [0, 7, 0])


def test_cases_are_drawn_as_listed():
    per_pin = tuple(np.arange(80.0) / 10)
    cases = (
        Case(label="a", disk_profile=5.0, roller_diameter=-3.0),
        Case(label="b", pin_radial=per_pin, ovality_2=1.0),
    )
    listed_study = study("cases", count=2).model_copy(update={"cases": cases, "tolerances": Tolerances()})
    errors = draw(listed_study, 0, 3)
    np.testing.assert_array_equal(errors.disk_profile, [0, 5, 0])
    np.testing.assert_array_equal(errors.roller_diameter, np.outer([0, -3, 0], np.ones(40)))
    theta = -2 * np.pi * np.arange(80) / 80
    np.testing.assert_allclose(errors.pin_radial[2], per_pin + np.cos(2 * theta), atol=1e-12)
    assert_equal(draw(listed_study, 2, 3), rows(errors, slice(2, 3)))
    with pytest.raises(ValueError, match="no random numbers"):
        uniforms(listed_study.samples, 3, 0, 1)


def test_every_disk_has_draws_of_its_own_that_the_tables_keep_and_one_disk_draws_none_for_a_second():
    study = load_study("two_disks", ROOT)
    errors = draw(study, 1, 30)
    for name, columns in {"eccentricity": 2, "disk_profile": 2, "eccentric_phase": 2, "lobe_profile": 2 * 39}.items():
        values = getattr(errors, name)
        assert values.shape == (29, columns), name
        assert np.all(np.std(values, axis=0) > 0), name
        assert abs(np.corrcoef(values[:, 0], values[:, -1])[0, 1]) < 0.6, name
    assert errors.roller_diameter.shape == (29, 10)  # an output pin reaches through both disks
    read = errors_of_columns(columns_of_errors(errors, 1, 1))
    for name, values in vars(errors).items():
        np.testing.assert_array_equal(getattr(read, name), values, err_msg=name)
    isolated = dimensions(load_study("pin_in_hole", ROOT))
    assert isolated["eccentric_phase"] == 0
    assert (isolated["eccentricity"], isolated["lobe_profile"]) == (1, 39)


def test_zones_and_pins_out_of_round_have_a_direction_of_each_element():
    study = load_study("pin_in_hole", ROOT)
    zone = {"distribution": "uniform_in_disc", "radius_um": 10.0}
    increment = {
        "output_pin_position": library()["uniform_in_disc"].model_validate(zone),
        "hole_position": library()["normal_in_disc"].model_validate({**zone, "distribution": "normal_in_disc"}),
        "pin_roundness_2": Uniform(distribution="uniform", lower_um=0.0, upper_um=1.0),
    }
    steady = {"hole_diameter": Fixed(distribution="fixed", value_um=2.0)}
    reference, shifted, errors = (
        draw(study.model_copy(update={"tolerances": study.tolerances.model_copy(update=update)}), 1, 401)
        for update in ({}, steady, increment)
    )
    for name in {field.name for field in fields(reference)} - {"hole_diameter"}:
        np.testing.assert_array_equal(getattr(shifted, name), getattr(reference, name), err_msg=name)
    rayleigh = stats.rayleigh(scale=10 / 3)
    of_radius = {
        "output_pin_position": lambda radius: (radius / 10) ** 2,
        "hole_position": lambda radius: rayleigh.cdf(radius) / rayleigh.cdf(10.0),
    }
    for name, tolerance_range in of_radius.items():
        way = getattr(errors, f"{name}_amplitude") * np.exp(1j * getattr(errors, f"{name}_phase"))
        assert way.shape == (400, 10)
        assert stats.kstest(np.abs(way).ravel(), tolerance_range).pvalue > 0.01
        assert stats.kstest(np.angle(way).ravel(), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01
        assert abs(np.corrcoef(way[:, 0].real, way[:, 1].real)[0, 1]) < 0.2
    assert errors.pin_roundness_2_phase.shape == (400, 40)
    assert stats.kstest(errors.pin_roundness_2_phase.ravel(), stats.uniform(0, 2 * np.pi).cdf).pvalue > 0.01
    read = errors_of_columns(columns_of_errors(errors, 1, 1))
    for name, values in vars(errors).items():
        np.testing.assert_array_equal(getattr(read, name), values, err_msg=name)


def test_units_as_measured_have_what_was_measured_and_the_tolerances_elsewhere():
    """An ovality acts through the pins' places: who measured these has measured it."""
    drawn = draw(STUDY, 1, 40)
    measured = Case(label="m", disk_profile=11.0, pin_radial=2.0)
    samples = STUDY.samples.model_copy(update={"nominal_first": False})
    units = draw_as_measured(STUDY.model_copy(update={"samples": samples}), measured, 0, 39)
    assert np.all(units.disk_profile == 11.0)
    assert np.all(units.pin_radial == 2.0)
    np.testing.assert_array_equal(units.pin_tangential, drawn.pin_tangential)
    np.testing.assert_array_equal(units.roller_diameter, drawn.roller_diameter)
    others = {"lobe_profile", "pin_tangential", "pin_radius", "eccentricity", "roller_diameter"}
    assert set(unmeasured_dimensions(STUDY, measured)) == others
    usual = usual_beside(STUDY, measured)
    assert (usual.disk_profile, usual.pin_radial, usual.ovality_2) == (11.0, 2.0, 0.0)
    assert usual.roller_diameter == pytest.approx(-4.0)
    assert usual.pin_radius == pytest.approx(-0.5)


RV = {"planet_runout": 5.0, "planet_runout_direction_deg": (0.0, 180.0)}
"""Two planets whose centres are off to opposite sides, as measured [um]."""


def listed(study, **values):
    """Errors of one unit that a study lists as its case."""
    samples = study.samples.model_copy(update={"experiment": "cases", "count": 1, "nominal_first": False})
    return draw(study.model_copy(update={"samples": samples, "cases": (Case(label="a", **values),)}), 0, 1)


def test_directions_of_a_stated_unit_are_its_own():
    study = load_study("rv", ROOT)
    np.testing.assert_allclose(listed(study, **RV).planet_runout_phase, [[0.0, np.pi]])
    np.testing.assert_allclose(listed(study, planet_runout=5.0).planet_runout_phase, [[0.0, 0.0]])
    counterclockwise = listed(study, planet_runout=5.0, planet_runout_direction_deg=90.0)
    np.testing.assert_allclose(counterclockwise.planet_runout_phase, [[np.pi / 2, np.pi / 2]])
    ring = load_study("quick", ROOT)
    one_oval = listed(ring, ovality_2=3.0)
    turned = listed(ring, ovality_2=3.0, ovality_2_direction_deg=90.0)
    np.testing.assert_allclose(turned.pin_radial, -one_oval.pin_radial, atol=1e-12)  # a quarter turn: the other axis


def test_measured_directions_are_kept_and_others_drawn():
    study, counted = load_study("rv", ROOT), {"planet_runout": np.full((1, 2), 5.0)}
    fixed = draw_with_parts(study, counted | {"planet_runout_phase": np.array([[0.0, np.pi]])}, 0, 3)
    np.testing.assert_allclose(fixed.planet_runout_phase, np.tile([0.0, np.pi], (3, 1)))
    assert np.ptp(draw_with_parts(study, counted, 0, 3).planet_runout_phase) > 0.1
    case = Case(label="a", **RV)
    np.testing.assert_allclose(draw_as_measured(study, case, 0, 2).planet_runout_phase, np.tile([0.0, np.pi], (2, 1)))
    assert set(measured_values(case)) == {"planet_runout", "planet_runout_phase"}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"planet_runout_direction_deg": 90.0}, "planet_runout_direction_deg = 90.0; needs planet_runout"),
        ({"planet_runout": 5.0, "planet_runout_direction_deg": (0.0, 90.0, 180.0)}, "must have 2, or be a number"),
    ],
)
def test_a_direction_without_its_amplitude_or_of_another_count_is_refused(values, message):
    mistakes = list(case_problems({0: Case(label="a", **values)}, load_study("rv", ROOT).design))
    assert [mistake.line("unit.toml") for mistake in mistakes][0].find(message) > 0


def test_opposite_planets_err_more_than_alike_ones():
    """Of opposite planets both meshes open and close together; of alike ones the tighter one decides."""
    study = load_study("rv", ROOT)
    design = study.design
    peak = {}
    for name, directions in (("alike", (0.0, 0.0)), ("opposite", (0.0, 180.0))):
        errors = assembly.errors(
            listed(study, disk_profile=24.0, planet_runout=5.0, planet_runout_direction_deg=directions)
        )
        ends = []
        for crank in 360.0 * np.arange(16) / 16:
            loose = assembly.bearing_clearance(design, np.full((1, 1), design.bearing.clearance_um))
            drive = drive_of(study, crank, None, errors, loose)
            ends.append(rigid_play(drive.reducer, drive.gap, drive.bearing_clearance).ends.ravel())
        peak[name] = np.ptp(np.array(ends)[:, 0])
    assert peak["opposite"] > 1.3 * peak["alike"] > 0


def test_no_two_dimensions_have_one_place_in_the_design_of_experiment():
    """Else a dimension that is added would change the random numbers of another one."""
    columns = [column for dimension in dimension_library().values() for column in dimension.draw_columns]
    assert len(columns) == len(set(columns))

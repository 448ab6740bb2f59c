"""Populations of units against a study: tests with their size, bias and spread, and the tolerance behind a shift."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT
from scipy import stats

from pipeline.config import load_study
from pipeline.errors import InputError
from pipeline.model.metrics import measurable_metrics
from pipeline.model.units import ARCMIN
from pipeline.populations.comparison import load_population, metric_comparisons, metrics_at, permutation_tests
from pipeline.populations.results import comparison_frame, sentence
from pipeline.populations.tolerance_shift import (
    Candidate,
    Closing,
    StudyPopulation,
    closest_shift,
    closing,
    mean_deviations,
    read_population_run,
)
from pipeline.sampling.errors import draw
from pipeline.statistics.intervals import Estimate
from stages.sample import columns_of_errors

WIDTH, LOST, RIGIDITY = measurable_metrics()


def deviations_of(study, count, seed=None):
    """Mean deviations of samples 1 to `count` of a study."""
    if seed is not None:
        study = study.model_copy(update={"samples": study.samples.model_copy(update={"seed": seed})})
    tables = columns_of_errors(draw(study, 1, count + 1), 1, interfaces=2)
    return mean_deviations({name: pd.DataFrame(columns) for name, columns in tables.items()})


def metrics_of(deviations, seed=0):
    """Metrics of a linear reducer whose slopes are known, at two crank angles; the second one is the worse."""
    d = deviations
    rng = np.random.default_rng(seed)
    play = 0.2 + 0.12 * (d["disk_profile"] / 2 - d["pin_radial"]) - 0.1 * d["pin_radius"] + 0.02 * d["eccentricity"]
    values = pd.DataFrame(
        {
            WIDTH: play,
            LOST: play + 0.3 - 0.02 * d["roller_diameter"],
            RIGIDITY: 5.5 - 0.02 * d["disk_profile"] + 0.1 * d["pin_radial"] + 0.01 * rng.standard_normal(len(d)),
        }
    )
    parts = [values.assign(sample=d.index, crank_deg=crank, status="ok") for crank in (0.0, 90.0)]
    parts[0][[WIDTH, LOST]] -= 0.05
    parts[0][RIGIDITY] += 0.05
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def study():
    return load_study("paper", ROOT)  # 10,000 samples to draw from, none solved


@pytest.fixture(scope="module")
def population(study):
    deviations = deviations_of(study, 2000)
    return StudyPopulation(study, metrics_of(deviations), deviations)


def units_of(study, count=40, seed=99):
    over_turn = metrics_at(metrics_of(deviations_of(study, count, seed), seed), None)
    return over_turn.rename_axis("unit").reset_index()


def with_tolerance(study, name, **values):
    tolerance = getattr(study.tolerances, name).model_copy(update=values)
    return study.model_copy(update={"tolerances": study.tolerances.model_copy(update={name: tolerance})})


def test_statistics_are_those_of_scipy():
    rng = np.random.default_rng(1)
    units, samples = rng.normal(0.4, 1.2, 25), rng.normal(0, 1, 300)
    model_value = {test.name: test for test in permutation_tests(units, samples, rng)}
    ks = stats.ks_2samp(units, samples, method="exact")
    assert model_value["kolmogorov_smirnov"].statistic == pytest.approx(ks.statistic)
    assert model_value["kolmogorov_smirnov"].p_value == pytest.approx(ks.pvalue, abs=0.03)
    cvm = stats.cramervonmises_2samp(units, samples)
    assert model_value["cramer_von_mises"].statistic == pytest.approx(cvm.statistic)
    assert model_value["cramer_von_mises"].p_value == pytest.approx(cvm.pvalue, abs=0.03)
    # scipy's statistic is standardised: (A2 - 1) / sigma
    shifted = [permutation_tests(units + shift, samples, rng)[2].statistic for shift in (0.0, 0.1, 0.2)]
    permutation_method = stats.PermutationMethod(n_resamples=2)
    reference_value = [
        stats.anderson_ksamp([units + s, samples], variant="continuous", method=permutation_method).statistic
        for s in (0.0, 0.1, 0.2)
    ]
    assert np.corrcoef(shifted, reference_value)[0, 1] == pytest.approx(1, abs=1e-9)


@pytest.mark.long
def test_tests_keep_their_size():
    rng = np.random.default_rng(2)
    p_values = [
        [test.p_value for test in permutation_tests(rng.gamma(2, size=8), rng.gamma(2, size=60), rng)]
        for _ in range(200)
    ]
    rejected = np.mean(np.array(p_values) < 0.05, axis=0)
    assert np.all(rejected < 0.10)  # 5 % give 20 or more of 200 with a probability of 0.3 %
    assert np.all(rejected > 0.005)


def test_ties_are_one_step():
    tests = permutation_tests(
        np.array([1.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0, 2.0, 1.0, 1.0]), np.random.default_rng(0)
    )
    assert tests[0].statistic == pytest.approx(0.0)
    assert all(test.p_value == 1.0 for test in tests)


@pytest.mark.long
def test_intervals_of_bias_and_spread_cover(monkeypatch):
    monkeypatch.setattr("pipeline.populations.comparison.PERMUTATIONS", 9)
    rng = np.random.default_rng(3)
    hits = np.zeros(2)
    samples = pd.DataFrame({"sample": np.arange(1500), "crank_deg": 0.0, "status": "ok"})
    for name in measurable_metrics():
        samples[name] = rng.uniform(0, 1, len(samples))
    for _ in range(100):
        units = pd.DataFrame({"unit": np.arange(20), WIDTH: rng.uniform(0.5, 2.0, 20)})
        (comparisons,) = metric_comparisons(units, samples)
        hits += [
            comparisons.bias.ci_low < 1.25 - samples[WIDTH].mean() < comparisons.bias.ci_high,
            comparisons.spread_ratio.ci_low
            < 1.5 * np.sqrt(1 / 12) / samples[WIDTH].std()
            < comparisons.spread_ratio.ci_high,
        ]
    assert np.all(hits >= 87)  # 95 % give fewer of 100 with a probability of 0.05 %


def test_units_of_the_study_itself_do_not_differ(study, population):
    comparisons = metric_comparisons(units_of(study), population.metrics)
    assert [comparison.metric for comparison in comparisons] == list(measurable_metrics())
    assert all(min(test.p_value for test in comparison.tests) > 0.01 for comparison in comparisons)
    assert all(comparison.spread_ratio.ci_low < 1 < comparison.spread_ratio.ci_high for comparison in comparisons)
    assert not closing(comparisons, population).takes_an_effect


@pytest.mark.long
@pytest.mark.parametrize(
    ("count", "bench", "declared"), [(1, 0.0, 0.0), (1, 0.02, 0.02), (3, 0.02, 0.02), (5, 0.02, None), (20, 0.02, None)]
)
def test_units_of_the_study_are_told_apart_at_the_level_stated(monkeypatch, study, count, bench, declared):
    """Of 400 comparisons of units of the study 5 % differ; more than 8 % do with a probability of half a percent."""
    monkeypatch.setattr("pipeline.populations.comparison.PERMUTATIONS", 1)
    rng = np.random.default_rng(5)
    deviations = deviations_of(study, 400 * count + 100)
    metrics = metrics_of(deviations, 3).query("crank_deg == 0")
    values = metrics.set_index("sample")[[WIDTH, LOST, RIGIDITY]]
    small_population = StudyPopulation(study, metrics.query("sample > 400 * @count"), deviations.iloc[400 * count :])
    units = values.loc[: 400 * count] * (1 + bench * rng.standard_normal((400 * count, 3)))
    n_different = 0
    for k in range(400):
        group = units.iloc[k * count : (k + 1) * count].rename_axis("unit").reset_index()
        n_different += closing(
            metric_comparisons(group, small_population.metrics), small_population, noise=declared
        ).has_bias
    assert n_different <= 32


def test_the_interval_of_a_shift_holds_it_where_few_units_show_their_own_covariance():
    """In 95 % of draws of six units with three metrics; 90 to 91 % without either part of the variance."""
    rng, slope, holds = np.random.default_rng(3), np.array([1.0, 1.0, 0.2]), 0
    factor = np.linalg.cholesky([[1.0, 0.9, 0.1], [0.9, 1.0, 0.1], [0.1, 0.1, 1.0]])
    for _ in range(1000):
        units = 0.7 * slope + rng.standard_normal((6, 3)) @ factor.T
        scatter = np.cov(units, rowvar=False) / 6, 5
        shift, deviation, _ = closest_shift(units.mean(axis=0), slope, scatter, np.zeros((3, 3)))
        holds += abs(shift - 0.7) <= stats.t.ppf(0.975, 3) * deviation
    assert holds == pytest.approx(950, abs=23)


@pytest.mark.parametrize("name", ["disk_profile", "pin_radius"])
def test_a_shifted_tolerance_is_found(study, population, name):
    shift = {"disk_profile": 1.5, "pin_radius": -0.4}[name]
    tolerance = getattr(study.tolerances, name)
    shifted = with_tolerance(study, name, allowance_um=tolerance.allowance_um + shift)
    closings = closing(metric_comparisons(units_of(shifted), population.metrics), population)
    assert closings.has_bias
    best = {candidate.tolerance: candidate for candidate in closings.candidates}
    assert best[name].closes
    assert best[name].shift_low_um < shift < best[name].shift_high_um
    if name == "disk_profile":
        assert closings.candidates[0].tolerance == name
    assert not closings.takes_an_effect


def test_a_shift_beyond_the_limits_takes_an_effect(study, population):
    shifted = with_tolerance(study, "disk_profile", allowance_um=25.0)
    closings = closing(metric_comparisons(units_of(shifted), population.metrics), population)
    best = {candidate.tolerance: candidate for candidate in closings.candidates}
    assert best["disk_profile"].shift_um == pytest.approx(15.0, abs=1.0)
    assert best["disk_profile"].room_um == pytest.approx(2.0, abs=0.1)
    assert not best["disk_profile"].within_limits
    assert closings.takes_an_effect


def test_a_tolerance_that_drives_nothing_closes_nothing(study):
    """Fifty samples leave its slopes to chance, and a long enough shift would fit any bias."""
    for seed in range(5):
        deviations = deviations_of(study, 50, seed)
        small_population = StudyPopulation(study, metrics_of(deviations, seed), deviations)
        shifted = with_tolerance(study, "disk_profile", allowance_um=11.5)
        closings = closing(metric_comparisons(units_of(shifted), small_population.metrics), small_population)
        idle = [c for c in closings.candidates if c.tolerance in ("ovality_2", "ovality_3", "pin_tangential")]
        assert not any(candidate.closes for candidate in idle)


def test_a_wider_tolerance_widens_the_spread(study, population):
    wider = with_tolerance(study, "disk_profile", lower_um=-6.0, upper_um=10.0)
    comparisons = {
        comparison.metric: comparison for comparison in metric_comparisons(units_of(wider), population.metrics)
    }
    assert comparisons[WIDTH].spread_ratio.ci_low > 1.5
    assert comparisons[WIDTH].tests[2].p_value < 0.05
    probability, model_value, reference_value = comparisons[WIDTH].quantiles.T
    assert np.ptp(reference_value) > 1.5 * np.ptp(model_value)
    assert np.all(np.diff(probability) > 0)


def test_units_measured_at_a_crank_angle_are_compared_there(study, population):
    at_90 = metrics_at(metrics_of(deviations_of(study, 40, 99), 99), 90.0)
    units = at_90[[WIDTH]].rename_axis("unit").reset_index().assign(crank_deg=90.0)
    (comparisons,) = metric_comparisons(units, population.metrics)
    assert comparisons.crank_deg == 90.0
    assert abs(comparisons.bias.value) < 0.03
    with pytest.raises(InputError, match="the study has 0, 90"):
        metric_comparisons(units.assign(crank_deg=45.0), population.metrics)


def test_units_without_a_crank_angle_are_compared_with_the_mean_unless_told(study, population):
    """A bench at one position scatters about the mean over the turn; the worst over the turn lies beyond it."""
    units = units_of(study)
    mean, worst = (metric_comparisons(units, population.metrics, turn_statistic=over)[0] for over in ("mean", "worst"))
    assert (mean.turn_statistic, worst.turn_statistic) == ("mean", "worst")
    assert abs(mean.bias.value) < 0.03
    assert worst.bias.value == pytest.approx(mean.bias.value - 0.025, abs=1e-9)  # half of the step between the angles
    assert comparison_frame([worst])["over"].tolist() == ["worst"]


@pytest.mark.parametrize(("factor", "unit"), [(60.0, "arcsec"), (1 / 60, "deg"), (1 / ARCMIN, "rad")])
def test_values_in_another_unit_are_refused_before_they_are_compared(study, population, factor, unit):
    units = units_of(study)
    units[[WIDTH, LOST]] *= factor
    with pytest.raises(InputError, match=f"lost_motion_arcmin has a median of .* likely in {unit}; convert it"):
        metric_comparisons(units, population.metrics)


def test_exchanged_columns_are_refused(study, population):
    exchanged = units_of(study).rename(columns={WIDTH: RIGIDITY, RIGIDITY: WIDTH})
    with pytest.raises(InputError, match="has the values of .* exchange the columns"):
        metric_comparisons(exchanged, population.metrics)


def test_a_trailing_separator_shifts_no_column(tmp_path):
    path = tmp_path / "units.csv"
    path.write_text(f"unit,{WIDTH},{LOST}\na,1.0,2.0,\nb,1.1,2.1,\n")
    assert load_population(path)[LOST].tolist() == [2.0, 2.1]
    path.write_text(f"unit,{WIDTH},{LOST}\na,1.0,2.0\nb,1.1,2.1,\n")
    with pytest.raises(InputError, match="units.csv:3: 4 fields, its header has 3"):
        load_population(path)


def test_a_metric_without_a_value_is_refused(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text(f"unit,{WIDTH},{LOST}\na,1.0,\nb,1.1,\n")
    with pytest.raises(InputError, match=f"bench.csv: column '{LOST}' has no value; fill it or remove it"):
        load_population(path)


def test_a_failed_sample_counts_nowhere(population):
    metrics = population.metrics.copy()
    metrics.loc[3, "status"] = "not converged"
    assert metrics["sample"][3] not in metrics_at(metrics, None).index
    assert metrics["sample"][3] not in metrics_at(metrics, 90.0).index


def test_two_units_have_a_bias_and_no_test(population):
    units = pd.DataFrame({"unit": ["a", "b"], WIDTH: [0.9, 1.0], LOST: [1.2, np.nan]})
    width, lost_motion = metric_comparisons(units, population.metrics)
    assert np.isfinite(width.bias.ci_high)
    assert width.tests == ()
    assert np.isnan(width.spread_ratio.value)
    assert lost_motion.bias.ci_high == np.inf
    untested = closing([width, lost_motion], population)
    assert not untested.has_bias
    assert "4 units with every metric" in sentence(untested, [width, lost_motion])
    assert "--noise" in sentence(untested, [width, lost_motion])
    exact, noisy = (closing([width, lost_motion], population, noise=noise).p_value for noise in (0.0, 0.1))
    assert exact < 1e-6 < noisy  # 0.2 arcmin between the metrics are 0.3 in the study


def test_a_test_of_all_metrics_does_not_hide_the_bias_of_one():
    """Twelve units may differ in one metric by far more than its interval, and not by all metrics together."""
    values = {"units": np.full(3, 1.2), "samples": np.ones(3)}
    one = SimpleNamespace(metric=LOST, bias=Estimate(0.18, 0.07, 0.29, 12), **values)
    other = SimpleNamespace(metric=WIDTH, bias=Estimate(0.1, -0.1, 0.3, 12), **values)
    text = sentence(Closing(0.062, ()), [one, other])
    assert text.startswith("All metrics together show no difference")
    assert "interval of a single metric excludes zero: lost motion." in text
    assert "single" not in sentence(Closing(0.062, ()), [other])
    assert "Check the unit" not in text
    in_seconds = SimpleNamespace(**{**vars(one), "units": np.full(3, 72.0)})
    assert sentence(Closing(0.062, ()), [in_seconds]).endswith("Check the unit of lost motion (72 times the study's).")


def test_units_csv_with_empty_values(tmp_path):
    path = tmp_path / "units.csv"
    path.write_text(f"unit,{WIDTH},{LOST}\na,1.0,\nb,,2.0\n")
    assert load_population(path)[WIDTH].notna().tolist() == [True, False]


def test_problems_of_units_csv_come_at_once(tmp_path):
    path = tmp_path / "units.csv"
    path.write_text("unit,zero_torque_with_arcmin,lost_motion_arcmin\na,1,2\na,1,-2\nb,1,x\n")
    with pytest.raises(InputError) as error:
        load_population(path)
    lines = "\n".join(error.value.problems)
    assert "did you mean 'zero_torque_width_arcmin'" in lines
    assert "units.csv:3: lost_motion_arcmin = -2" in lines
    assert 'units.csv:4: lost_motion_arcmin = "x"' in lines
    assert 'units.csv:3: unit = "a"; occurs twice' in lines


def test_a_run_on_disk_is_read_without_its_nominal_reducer(tmp_path, study, population):
    run = tmp_path / "runs/paper"
    tables = columns_of_errors(draw(study, 0, 41), 0, interfaces=2)
    for stage in ("sample", "aggregate"):
        (run / stage).mkdir(parents=True)
    for name, columns in tables.items():
        pd.DataFrame(columns).to_parquet(run / f"sample/{name}.parquet")
    with pytest.raises(InputError, match="run the study first"):
        read_population_run(run, study)
    metrics = metrics_of(mean_deviations({name: pd.DataFrame(columns) for name, columns in tables.items()}))
    metrics.to_parquet(run / "aggregate/metrics.parquet")
    result = read_population_run(run, study)
    assert result.metrics["sample"].min() == 1
    pd.testing.assert_frame_equal(result.deviations, population.deviations.loc[1:40], check_index_type=False)


def test_a_run_of_too_few_samples_is_refused_since_its_slopes_would_explain_anything(tmp_path, study):
    run = tmp_path / "runs/paper"
    tables = {name: pd.DataFrame(columns) for name, columns in columns_of_errors(draw(study, 0, 21), 0, 2).items()}
    for stage in ("sample", "aggregate"):
        (run / stage).mkdir(parents=True)
    for name, table in tables.items():
        table.to_parquet(run / f"sample/{name}.parquet")
    metrics_of(mean_deviations(tables)).to_parquet(run / "aggregate/metrics.parquet")
    with pytest.raises(InputError, match=r"20 samples; a comparison with units takes 35 for 22 tolerances"):
        read_population_run(run, study)


def test_the_answer_says_how_much_of_a_shift_the_limits_allow():
    """A shift whose interval reaches into the limits, while the shift itself does not, is not claimed in full."""
    inside = Candidate("disk_profile", 2.0, 1.0, 3.0, 2.5, True, 0.9, 0.5)
    beyond = dataclasses.replace(inside, tolerance="ovality_3", room_um=1.5)
    assert not inside.is_beyond_room
    assert beyond.is_beyond_room
    assert beyond.closes
    text = sentence(Closing(0.001, (inside, beyond)), [])
    assert "disk profile (whole disk) by +2 µm (95 % interval 1 to 3);" in text
    assert text.endswith("by +2 µm (95 % interval 1 to 3; the limits allow 1.5 µm).")

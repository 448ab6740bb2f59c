"""Measured lots: parameters of drawn lots lie in their intervals, and yields are those of the true distributions."""

import tempfile
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pipeline.config import load_study
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions import library
from pipeline.config.files.table_file import TableFile, read_table
from pipeline.config.studies.study import ALL_LIMITS
from pipeline.decisions.fresh_units import PRELOADED
from pipeline.decisions.lots import dimension_fit as dimension_fits
from pipeline.decisions.lots import lot_yield as lot_yields
from pipeline.decisions.lots.dimension_fit import correlation_length, dimension_fit
from pipeline.decisions.lots.fitted_distribution import fitted_kinds, relative_bic
from pipeline.decisions.lots.lot_yield import limit_passes, lot_yield, study_of_lot
from pipeline.decisions.lots.measured_lot import MeasuredLot, measured_lot, with_separate_ovalities
from pipeline.decisions.lots.results import fit_rows, lot_findings, lot_fits, study_text, write, yield_rows
from pipeline.decisions.selective_assembly import best_assembly
from pipeline.errors import InputError
from pipeline.library.lots import assemble, certificate, lots
from pipeline.model.metrics import library as metrics
from pipeline.report.decisions.certificate import assembly_sentences, assembly_warnings, pairs_next_step
from pipeline.report.decisions.lots import lot_warnings, sentences, unused_columns, zone_warnings
from pipeline.sampling.designs import correlated_numbers
from pipeline.sampling.errors import draw
from pipeline.statistics.intervals import Estimate

ROOT = Path(__file__).parents[2]
STUDY = load_study("quick", ROOT)
DIMENSIONS = dimension_library()


@pytest.fixture(scope="module", autouse=True)
def few_replicates():
    """The ends of a 95 % interval are order statistics 3 and 98 of 99 lots, in place of 10 and 390 of 399.

    Twelve other lots are solved in place of 50.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dimension_fits, "REPLICATES", 99)
        patch.setattr(lot_yields, "SOLVED_LOTS", 12)
        yield


def drawn(kind: str, shape: tuple[int, ...], seed: int, **settings: float) -> tuple[object, np.ndarray]:
    """A distribution and deviations drawn from it."""
    distribution = library()[kind](distribution=kind, **settings)
    probability = np.random.default_rng(seed).random(shape)
    return distribution, distribution.allowance_um + distribution.deviation(probability)


def fit(name: str, values: np.ndarray, seed: int = 0):
    labels = [str(k) for k in range(len(values))]
    return dimension_fit(DIMENSIONS[name], labels, values, getattr(STUDY.tolerances, name), STUDY.design, 0.95, seed)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("normal", {"lower_um": -4.0, "upper_um": 4.0, "sigma_um": 0.5, "mean_um": 0.3}),
        ("uniform", {"lower_um": -1.5, "upper_um": 1.0}),
        ("triangular", {"lower_um": -2.0, "upper_um": 2.0, "mode_um": 1.8}),
    ],
)
def test_the_kind_of_a_large_lot_is_found_with_its_numbers(kind, settings):
    truth, values = drawn(kind, (600,), 5, **settings)
    best = fitted_kinds(values, DIMENSIONS["eccentricity"], STUDY.tolerances.eccentricity)[0].distribution
    assert best.name == kind
    probability = np.linspace(0.02, 0.98, 25)
    difference = best.allowance_um + best.deviation(probability) - truth.deviation(probability)
    assert np.max(np.abs(difference)) < 0.15 * np.std(values)


def test_parts_sorted_at_the_limits_of_the_drawing_are_a_truncated_normal():
    _, values = drawn("normal", (1000,), 1, lower_um=-2.0, upper_um=2.0, sigma_um=1.6)
    best = fitted_kinds(values, DIMENSIONS["eccentricity"], STUDY.tolerances.eccentricity)[0].distribution
    assert (best.name, best.limits_um) == ("normal", (-2.0, 2.0))
    assert best.scale_um == pytest.approx(1.6, rel=0.15)


def test_zones_are_fitted_by_their_radius():
    dimension = DIMENSIONS["hole_position"]
    zone = library()["normal_in_disc"](distribution="normal_in_disc", radius_um=10.0)
    values = zone.deviation(np.random.default_rng(2).random(2000))
    best = fitted_kinds(values, dimension, zone)[0].distribution
    assert (best.name, best.radius_um) == ("normal_in_disc", pytest.approx(10.0, rel=0.03))


@pytest.mark.long
def test_intervals_of_mean_spread_and_capability_hold_the_truth():
    """Of 40 lots 95 % intervals miss on average two; eight misses have a probability below 1e-3."""
    misses = np.zeros(3)
    for seed in range(40):
        truth, values = drawn("normal", (40, 1), seed, lower_um=-4.0, upper_um=4.0, sigma_um=0.6, mean_um=0.5)
        found = fit("eccentricity", values, seed)
        cpk = (2.0 - 0.5) / (3 * 0.6)
        for k, (estimate, true) in enumerate(((found.mean, 0.5), (found.spread, 0.6), (found.cpk, cpk))):
            misses[k] += not estimate.ci_low <= true <= estimate.ci_high
    assert np.all(misses <= 7)


@pytest.mark.parametrize(("parts", "elements", "alike"), [(5, 1, 0.0), (10, 1, 0.0), (10, 80, 0.3), (30, 80, 0.3)])
def test_intervals_of_few_parts_and_of_parts_whose_elements_are_alike_hold_the_truth(parts, elements, alike):
    """Of 200 lots; before, 84 % held the spread of ten parts, and 58 % the mean of parts that differ as wholes."""
    rng, holds = np.random.default_rng(parts + elements), np.zeros(2)
    for _ in range(200):
        values = rng.standard_normal((parts, elements)) + alike * rng.standard_normal((parts, 1))
        mean, spread = dimension_fits._moments(values, 0.95)
        holds += [mean.ci_low < 0 < mean.ci_high, spread.ci_low < np.hypot(1, alike) < spread.ci_high]
    assert np.all(holds >= 178)  # of 200 at 95 %: fewer have a probability below 1e-3


def testmoments_without_each_part_are_those_of_the_other_parts():
    values = 100 + np.random.default_rng(0).standard_normal((6, 4))
    means, spreads = dimension_fits.moments_without_each(values)
    for number in range(6):
        others = np.delete(values, number, axis=0)
        assert (means[number], spreads[number]) == pytest.approx((np.mean(others), np.std(others, ddof=1)))


def test_the_correlation_of_neighbours_is_found_and_its_absence_too():
    circumference = 2 * np.pi * DIMENSIONS["lobe_profile"].elements.radius_mm(STUDY.design)
    rng = np.random.default_rng(4)
    independent = rng.random((40, 79))
    length = correlation_length(correlated_numbers(independent, circumference, 8.0), circumference)
    assert length == pytest.approx(8.0, rel=0.15)
    false_alarms = sum(correlation_length(rng.random((2, 79)), circumference) is not None for _ in range(100))
    assert false_alarms <= 13  # of 100 at a level of 5 %: more than 13 have a probability below 1e-3


@pytest.mark.long
def test_a_drift_and_an_outlier_are_named():
    values = np.random.default_rng(1).normal(0, 0.5, (50, 1))
    assert fit("eccentricity", values).drift.p_value > 0.05
    assert [fit("eccentricity", values[:n]).drift is None for n in (7, 8)] == [True, False]
    alarms = sum(
        fit("eccentricity", np.random.default_rng(k).normal(0, 0.5, (50, 1))).outliers != () for k in range(24)
    )
    assert alarms <= 5  # of 24 at a level of 5 %: more than 5 have a probability below 2e-3
    shifted = values + np.linspace(0, 1.5, 50)[:, None]
    drift = fit("eccentricity", shifted).drift
    assert drift.p_value < 1e-4
    assert drift.change_um.ci_low < 1.5 < drift.change_um.ci_high
    values[17] = 6.0
    assert (17, 0) in fit("eccentricity", values).outliers


def test_the_next_distribution_is_named_however_near_it_is():
    found = fit("eccentricity", np.random.default_rng(2).normal(0, 0.5, (12, 1)))
    rows = fit_rows([SimpleNamespace(lot=SimpleNamespace(name="lot"), fits=[found])])
    (_, first), (second, gap), *_ = sorted(relative_bic(found.kinds).items(), key=lambda kind: kind[1])
    assert first == 0 < gap < 1
    assert rows[["next_distribution", "next_bic"]].values.tolist() == [[second, gap]]


def table(columns: dict[str, list[str]]) -> TableFile:
    """Columns as the reader returns them."""
    rows = [",".join(columns)] + [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lot.csv"
        path.write_text("\n".join(rows) + "\n")
        return read_table(path, "lot.csv", names_in=("part",))


def lot_columns(n: int, seed: int) -> dict[str, list[str]]:
    rng = np.random.default_rng(seed)
    disk = 10.0 + STUDY.tolerances.disk_profile.deviation(rng.random(n)) + 1.0
    columns = {"part": [f"unit {k}" for k in range(n)], "disk_profile_um": [str(value) for value in disk]}
    pins = 1.2 * rng.standard_normal((n, 80))
    return columns | {f"pin_tangential_{k}": [str(value) for value in pins[:, k]] for k in range(80)}


def play_of_few_pins(errors):
    """A stand-in for the load solve: linear in the disk and in the least of the tangential errors."""
    play = 0.2 * errors.disk_profile + 0.05 * errors.pin_tangential.min(axis=1)
    values = {name: np.where(np.isnan(play), np.nan, 0.0) for name in STUDY.limits.of_metrics}
    values |= {"clearance_backlash_arcmin": play, "torsional_rigidity_Nm_per_arcmin": np.full(len(play), 9.0)}
    return {}, values | {PRELOADED: errors.disk_profile < 0}


@pytest.mark.long
def test_the_yield_of_a_lot_is_that_of_its_true_distributions():
    lot = measured_lot("lot", table(lot_columns(200, 3)), STUDY.design)
    fits, skipped = lot_fits(STUDY, lot)
    assert not skipped
    outcome = lot_yield(STUDY, fits, play_of_few_pins, 1500, 1)
    rng = np.random.default_rng(9)
    disk = 11.0 + STUDY.tolerances.disk_profile.deviation(rng.random(20_000))
    pins = 1.2 * rng.standard_normal((20_000, 80)).min(axis=1)
    truth = np.mean(0.2 * disk + 0.05 * pins <= STUDY.limits.clearance_backlash_arcmin)
    share = outcome.as_made[ALL_LIMITS]
    assert 0.2 < truth < 0.98
    assert share.ci_low < truth < share.ci_high
    assert share.ci_high - share.ci_low < 0.2
    assert outcome.costs[0].name == "disk_profile"
    assert outcome.costs[0].gain.ci_low > 0
    assert limit_passes(STUDY, outcome.values).mean() == share.value


@pytest.mark.long
def test_the_interval_of_a_high_yield_holds_the_truth_of_ten_normal_parts(monkeypatch):
    """Of 40 lots; 20 % did while resampled lots were fitted again, whose kinds have no tails."""
    monkeypatch.setattr(lot_yields, "SOLVED_LOTS", 50)
    limit, holds = 10 + 2.326, 0  # 99 % of a disk profile of 10 um with a standard deviation of 1 um
    study = STUDY.model_copy(update={"limits": type(STUDY.limits)(clearance_backlash_arcmin=limit)})
    solve = lambda errors: ({}, {"clearance_backlash_arcmin": errors.disk_profile, PRELOADED: np.zeros(1)})  # noqa: E731
    for seed in range(40):
        found = fit("disk_profile", np.random.default_rng(seed).normal(10, 1, (10, 1)), seed)
        share = lot_yield(study.with_section("samples", seed=seed + 1), [found], solve, 1000, 1).as_made[ALL_LIMITS]
        holds += share.ci_low <= 0.99 <= share.ci_high
    assert holds >= 32  # of 40 at 95 %: fewer have a probability below 1e-4


def test_another_lot_is_moved_stretched_and_normal_unless_another_kind_fits_clearly_better():
    rng = np.random.default_rng(0)
    few, many = (fit("disk_profile", 10 + 2 * rng.random((n, 1))) for n in (10, 300))
    assert few.kinds[0].distribution.name == many.kinds[0].distribution.name == "uniform"
    other = lot_yields.other_lot(few, 1.0, np.log(2.0))
    assert other.name == "normal"
    assert other.allowance_um + other.mean_um == pytest.approx(few.mean.value + 1, abs=1e-3)
    assert other.sigma_um == pytest.approx(2 * np.std(few.values), rel=1e-3)
    wide = lot_yields.other_lot(many, 0.5, np.log(2.0))
    assert wide.name == "uniform"
    assert wide.upper_um - wide.lower_um == pytest.approx(4.0, abs=0.1)
    assert wide.allowance_um + 0.5 * (wide.upper_um + wide.lower_um) == pytest.approx(11.5, abs=0.1)


def test_a_unit_without_a_value_counts_in_neither_yield_of_a_gain():
    """Every other unit has no value where all disks are at the drawing's mean."""
    found = fit("disk_profile", np.random.default_rng(1).normal(11, 0.5, (20, 1)))

    def solve(errors):
        nothing, values = play_of_few_pins(errors)
        if np.ptp(errors.disk_profile) == 0:
            values = {name: np.where(np.arange(len(value)) % 2, np.nan, value) for name, value in values.items()}
        return nothing, values

    (cost,) = lot_yield(STUDY, [found], solve, 100, 1).costs
    assert cost.gain.n == 50


@pytest.mark.parametrize(
    ("mean", "spread", "words"),
    [
        (12.0, 0.5, ""),
        (16.0, 0.5, ""),
        (-12.0, 0.5, "mean of -12 µm, more than its width outside of the drawing's zone, 10 to 14 µm. With the oppo"),
        (0.012, 0.0005, "Times 1000 they would fit: are they in mm?"),
        (12_000.0, 500.0, "Divided by 1000 they would fit: are they in nm?"),
        (2.0, 0.5, "With the allowance of 10 µm they would fit"),
        (64.99, 0.001, "Are they deviations from the nominal size in µm?"),
        (64_987.0, 1.0, "Are they deviations from the nominal size in µm?"),
    ],
)
def test_values_that_cannot_be_meant_as_they_are_read_are_doubted(mean, spread, words):
    values = {"disk_profile": mean + spread * np.linspace(-1, 1, 20)[:, None]}
    texts = zone_warnings(STUDY, "lot", values)
    assert (len(texts) == 1 and words in texts[0]) if words else not texts
    assert "".join(texts).count("they would fit") <= 1


def test_a_zone_about_zero_tells_another_unit_by_the_spread():
    places = np.random.default_rng(0).normal(0, 1, (6, 80))
    assert not zone_warnings(STUDY, "lot", {"pin_radial": places})
    (text,) = zone_warnings(STUDY, "lot", {"pin_radial": 1e-3 * places})
    assert "less than a hundredth of the drawing's zone" in text
    assert "Times 1000 they would fit" in text


def test_a_yield_of_parts_that_interfere_is_not_said_alone():
    """Smaller disks pass the stand-in's limits more often: -12 um in place of 12 is a better lot."""
    sizes = np.linspace(11, 13, 20)
    warnings = []
    for sign in (1, -1):
        lot = measured_lot("lot", table({"disk_profile": [str(sign * size) for size in sizes]}), STUDY.design)
        findings = lot_findings(STUDY, lot, play_of_few_pins, 40, 1)
        assert (findings.outcome.as_made[ALL_LIMITS].value == 1) == (sign == -1)
        assert set(yield_rows([findings])["preloaded"]) == {0.0, float(sign == -1)}
        warnings.append(lot_warnings(STUDY, findings))
    assert not warnings[0]
    assert "the opposite sign" in warnings[1][0]
    assert warnings[1][1].startswith(
        "Warning: 100 % of the units made from the parts of lot are preloaded, of those with the tolerances of the "
        "study 0 %: at some crank angle parts interfere without load."
    )
    assert warnings[1][1].endswith("Check the sign and the unit of the measured values.")
    cranks = measured_lot("cranks", table({"eccentricity": ["0", "1"]}), STUDY.design)
    mixed = measured_lot("disks", table({"disk_profile": ["12", "-12"]}), STUDY.design)
    assembly = best_assembly(STUDY, mixed, cranks, play_of_a_fit, 1)
    *_, text = assembly_warnings(STUDY, assembly)
    assert text.startswith("Warning: 50 % of the units of the assignment are preloaded, of those assembled at random")


def test_parts_of_which_no_unit_has_a_result_are_refused_and_a_lot_without_one_tells_nothing():
    found = fit("disk_profile", np.random.default_rng(1).normal(11, 0.5, (20, 1)))

    def solve(errors, largest):
        nothing, values = play_of_few_pins(errors)
        is_lost = errors.disk_profile > largest
        return nothing, {name: np.where(is_lost, np.nan, value) for name, value in values.items()}

    with pytest.raises(InputError, match="none of 40 units with the measured disk_profile has a result"):
        lot_yield(STUDY, [found], partial(solve, largest=0.0), 40, 1)
    share = lot_yield(STUDY, [found], partial(solve, largest=11.0), 20, 1).as_made[ALL_LIMITS]
    assert share.n < 20
    assert share.ci_low < 0.5


def test_a_line_of_probits_is_found_with_its_error():
    rng = np.random.default_rng(5)
    regressors, number = rng.standard_normal((50, 2)), np.full(50, 100)
    passes = rng.binomial(number, stats.norm.cdf(2.0 + regressors @ [0.5, -0.3]))
    value, factor = lot_yields.probit_line(regressors, passes, number)
    error = np.sqrt(np.diag(factor @ factor.T))
    assert np.all(np.abs(value - [2.0, 0.5, -0.3]) < 3 * error)
    assert np.all(error < 0.1)
    none_fails, _ = lot_yields.probit_line(regressors, number, number)
    assert none_fails[0] > 3


def test_the_study_of_a_lot_runs_from_its_file(tmp_path):
    lot = measured_lot("lot", table(lot_columns(60, 3)), STUDY.design)
    fits, _ = lot_fits(STUDY, lot)
    text = study_text(STUDY, fits, "lot", "made", "pham2017")
    assert "# Its design is pham2017 in the folder of this file: move or copy both together." in text
    (tmp_path / "made.toml").write_text(text)
    made = load_study(tmp_path / "made.toml", ROOT)
    assert made.tolerances == study_of_lot(STUDY, fits).tolerances


def test_one_value_per_part_is_said_to_be_that_of_one_element():
    """Loose pins, one row each; the mean of a set of pins looks alike, and its scatter is not that of pins."""
    shapes = {"pin_radius": (12, 1), "pin_tangential": (12, 80), "disk_profile": (12, 1)}
    fits = [SimpleNamespace(dimension=DIMENSIONS[name], values=np.zeros(shape)) for name, shape in shapes.items()]
    shares = {ALL_LIMITS: Estimate(0.9, 0.8, 1.0, 100)}
    outcome = SimpleNamespace(as_made=shares, as_drawn=shares, costs=())
    _, _, *notes = sentences(SimpleNamespace(lot=SimpleNamespace(name="pins"), fits=fits, outcome=outcome))
    assert len(notes) == 1
    assert "pin_radius has one value per part. Each is taken for one pin by itself" in notes[0]
    assert "If a value is the mean of several pins, the yield does not hold" in notes[0]


def test_repeated_rows_are_the_elements_of_a_part():
    rows = {"part": ["a"] * 80 + ["b"] * 80, "pin_radius": [str(k) for k in range(160)]}
    values = measured_lot("rings", table(rows), STUDY.design).values["pin_radius"]
    assert values.shape == (2, 80)
    assert values[1, 0] == 80


def test_parts_with_numbers_for_names_keep_them_beside_an_empty_line():
    columns = {"part": ["102", "", "007"], "disk_profile": ["1", "", "2"]}
    assert measured_lot("lot", table(columns), STUDY.design).parts == ("102", "007")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"diameter": ["1"]}, "no column is named after a toleranced dimension"),
        ({"disk_profile": ["1", "two"]}, 'disk_profile = "two"'),
        ({"pin_radial_0": ["1"], "pin_radial_1": ["1"]}, "give pin_radial_0 to pin_radial_79"),
        ({"part": ["a", "a", "b"], "pin_radius": ["1", "2", "3"]}, "a part has 80"),
        ({"hole_diameter": ["1"]}, "acts on nothing"),
        (
            {"disk_profile": ["64987", "64988"]},
            r"lot.csv:2: disk_profile = 64987; must be a deviation from the nominal size in um, -1000 to 1000; 2 of 2",
        ),
        ({"disk_profile_mm": ["1"]}, 'lot.csv: column "disk_profile_mm"; write disk_profile_um'),
        ({"Disk_Profile": ["1"], "eccentricity": ["1"]}, 'column "Disk_Profile"; write disk_profile_um'),
        ({"disk profile [µm]": ["1"]}, "write disk_profile_um; values are deviations in um"),
        ({"pin_radial_mm_3": ["1"]}, "write pin_radial_3;"),
        ({"Part": ["a"], "disk_profile": ["1"]}, 'column "Part"; write part'),
        (
            {"part": ["a", "b", "a"], "disk_profile": ["1", "2", "3"]},
            "lot.csv:4: part = a; line 2 has it already, with other parts between",
        ),
        ({"disk_profile": []}, "no part; give a row for each"),
        ({"disk_profile": ["1", "", "2"]}, "lot.csv:3: no value"),
    ],
)
def test_faults_of_a_table_of_parts_are_named(columns, words):
    with pytest.raises(InputError, match=words):
        measured_lot("lot", table(columns), STUDY.design)


def test_columns_that_are_not_used_are_named():
    lot = measured_lot("lot", table({"disk_profile": ["1"], "date": ["monday"], "gauge": ["3"]}), STUDY.design)
    assert unused_columns(lot) == ["lot: columns that are no toleranced dimension and were not used: date and gauge."]
    assert unused_columns(replace(lot, ignored_columns=())) == []


def test_the_largest_deviations_of_a_table_are_fitted():
    """The limits of a normal distribution four standard deviations from the mean are beyond what a file may state."""
    lot = measured_lot("lot", table({"disk_profile": ["995", "1000", "997", "996", "999"]}), STUDY.design)
    (found,), _ = lot_fits(STUDY, lot)
    assert found.tolerance.allowance_um + found.tolerance.limits_um[1] >= 1000


def test_ovalities_are_taken_out_of_measured_pin_circles():
    """Rings of the study: the amplitudes come back, and what is left has the spread of the single pins."""
    radial = draw(STUDY.model_copy(update={"samples": STUDY.samples.model_copy(update={"count": 400})}), 1, 401)
    columns = {f"pin_radial_{k}": radial.pin_radial[:, k] for k in range(80)}
    lot = with_separate_ovalities(measured_lot("rings", table(columns), STUDY.design), STUDY)
    assert np.mean(lot.values["ovality_2"]) == pytest.approx(1.0, abs=0.12)  # uniform from 0 to 2 um
    assert np.mean(lot.values["ovality_3"]) == pytest.approx(0.5, abs=0.12)
    single = STUDY.tolerances.pin_radial.deviation(np.random.default_rng(0).random(100_000))
    assert np.std(lot.values["pin_radial"]) == pytest.approx(np.std(single), rel=0.05)


def test_a_ring_without_any_deviation_has_no_ovality():
    samples = STUDY.samples.model_copy(update={"count": 40})
    radial = draw(STUDY.model_copy(update={"samples": samples}), 0, 41).pin_radial
    assert not radial[0].any()  # the nominal unit
    columns = {f"pin_radial_{k}": radial[:, k] for k in range(80)}
    lot = with_separate_ovalities(measured_lot("rings", table(columns), STUDY.design), STUDY)
    assert not lot.values["pin_radial"][0].any()
    assert not lot.values["ovality_2"][0].any()


def lots_for_assembly(n: int) -> tuple[MeasuredLot, MeasuredLot]:
    rng = np.random.default_rng(6)
    disks = {"disk_profile": rng.uniform(6.0, 14.0, n)}
    cranks = {"eccentricity": rng.uniform(-4.0, 4.0, n)}
    return tuple(measured_lot(name, table(c), STUDY.design) for name, c in (("disks", disks), ("cranks", cranks)))


def play_of_a_fit(errors):
    """A stand-in for the load solve: the two parts compensate each other."""
    size = len(errors.disk_profile)
    play = 2.4 + 0.2 * (np.abs(errors.disk_profile - 10 + errors.eccentricity) - 1.0)
    values = {name: np.zeros(size) for name in STUDY.limits.of_metrics}
    values |= {"clearance_backlash_arcmin": play, "torsional_rigidity_Nm_per_arcmin": np.full(size, 9.0)}
    return {}, values | {PRELOADED: errors.disk_profile < 0}


def test_the_assignment_is_the_best_of_all_and_its_yield_is_verified():
    first, second = lots_for_assembly(6)
    assembly = best_assembly(STUDY, first, second, play_of_a_fit, 1)
    orders = [(np.arange(6), np.array(order)) for order in permutations(range(6))]
    best = max(assembly.passes[order].sum() for order in orders)
    assert assembly.passes[tuple(assembly.pairs.T)].sum() == best
    margins = [np.clip(assembly.margin, -1, 1)[order].sum() for order in orders if assembly.passes[order].sum() == best]
    assert np.clip(assembly.margin, -1, 1)[tuple(assembly.pairs.T)].sum() == pytest.approx(max(margins))
    assert len({*assembly.pairs[:, 1].tolist()}) == 6
    expected = np.abs(first.values["disk_profile"] - 10 + second.values["eccentricity"].T) <= 1.0
    assert np.array_equal(assembly.passes, expected)
    assert assembly.selected_yield.value == pytest.approx(best / 6)


def test_the_random_yield_of_an_assembly_is_that_of_all_pairs_within_its_interval():
    """Units of one permutation are not independent: of 30 intervals about half held the share of all pairs."""
    holds = []
    for seed in range(30):
        first, second = lots_for_assembly(6)
        study = STUDY.with_section("samples", seed=seed)
        random = best_assembly(study, first, second, play_of_a_fit, 1).random
        share = best_assembly(study, first, second, play_of_a_fit, 1).passes.mean()
        holds.append(random.ci_low <= share <= random.ci_high)
    assert sum(holds) >= 26


def test_a_gain_is_claimed_only_where_the_intervals_do_not_overlap():
    first, second = lots_for_assembly(6)
    assembly = best_assembly(STUDY, first, second, play_of_a_fit, 1)
    low, middle, high = (Estimate(share, share - 0.05, share + 0.05, 60) for share in (0.80, 0.88, 0.95))
    shown, overlapping, worse = (
        replace(assembly, random=random, selected_yield=chosen)
        for random, chosen in ((low, high), (low, middle), (high, low))
    )
    assert "The difference is 15 percentage points." in assembly_sentences(shown, None)[0]
    assert pairs_next_step(shown).startswith("Assemble the pairs")
    assert "overlap, so the difference (8 percentage points) is not shown" in assembly_sentences(overlapping, None)[0]
    for other in (overlapping, worse):
        assert pairs_next_step(other).startswith("Assemble at random")


def test_the_share_of_pairs_that_bind_is_that_above_the_force():
    first, second = lots_for_assembly(5)
    force = lambda errors: errors.disk_profile * 10.0  # noqa: E731
    assembly = best_assembly(STUDY, first, second, play_of_a_fit, 1, force)
    limit = float(np.sort(first.values["disk_profile"].ravel())[2] * 10.0)
    assert assembly.binding_share(limit) == pytest.approx(2 / 5)


@pytest.mark.long
def test_two_lots_have_a_table_of_their_differences_and_one_has_none(tmp_path):
    """Disks that are 2 um larger have 0.4 arcmin more of the stand-in's play."""
    deviations = STUDY.tolerances.disk_profile.deviation(np.random.default_rng(3).random(20))
    findings = []

    def solve(errors):
        nothing, values = play_of_a_fit(errors)
        return nothing, {name: values.get(name, np.zeros(len(errors.disk_profile))) for name in (*metrics(), PRELOADED)}

    for name, size in (("small", 13.0), ("large", 15.0)):
        columns = {"part": [str(k) for k in range(20)], "disk_profile_um": [str(size + value) for value in deviations]}
        lot = measured_lot(name, table(columns), STUDY.design)
        findings.append(lot_findings(STUDY, lot, solve, 100, 1))
    assert "differences" not in write(STUDY, findings[:1], tmp_path / "one")
    rows = write(STUDY, findings, tmp_path / "two")["differences"].set_index(["metric", "statistic"])
    mean = rows.loc[("clearance_backlash_arcmin", "mean")]
    assert mean["b"] - mean["a"] == pytest.approx(0.4, abs=0.1)


def test_lots_with_a_common_dimension_are_refused():
    first, _ = lots_for_assembly(5)
    with pytest.raises(InputError, match="both have disk_profile"):
        best_assembly(STUDY, first, first, play_of_a_fit, 1)


def test_two_lots_of_one_name_are_refused(tmp_path):
    """Their rows and the studies that are written for them would be one another's."""
    paths = [tmp_path / folder / "parts.csv" for folder in ("may", "june")]
    for path in paths:
        path.parent.mkdir()
        path.write_text("part,disk_profile_um\n" + "".join(f"{k},{k}.5\n" for k in range(8)))
    with pytest.raises(InputError, match="--csv: parts names two lots; give each file a name of its own"):
        lots(paths, STUDY)


@pytest.mark.parametrize("stem", ["-rings", "two lots", "a" * 61])
def test_a_file_whose_name_cannot_name_results_is_refused_before_anything_is_computed(stem, tmp_path):
    path = tmp_path / f"{stem}.csv"
    path.write_text("part,disk_profile_um\n1,1.0\n")
    with pytest.raises(InputError, match="its name without the ending names results and must be letters"):
        lots([path], STUDY)


@pytest.mark.parametrize(
    "question",
    [
        lambda study: lots(["parts.csv"], study),
        lambda study: assemble("rings.csv", "disks.csv", study),
        lambda study: certificate("unit.toml", study),
    ],
)
def test_a_limit_of_the_turn_is_refused_where_loops_alone_would_leave_it_out(question):
    study = STUDY.with_section("limits", transmission_error_arcsec=60.0)
    with pytest.raises(InputError, match=r"limits\.transmission_error_arcsec: .* uses metrics of a loop"):
        question(study)

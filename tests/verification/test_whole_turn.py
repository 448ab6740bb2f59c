"""The worst over the whole turn of the output: what it rests on, and against every pitch solved."""

import tempfile
import tomllib
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import assembly
from pipeline.config import Study, load_design, parse_study
from pipeline.elastic import disk_patches, elastic_disk
from pipeline.engine.runner import Resources, run
from pipeline.model.elastic.condensed_body import ElasticBody
from pipeline.model.metrics import library
from pipeline.model.units import ARCMIN
from pipeline.populations import turn_search
from pipeline.populations.turn_drives import TurnDrives, Units, full_blocks, turned_blocks
from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_residuals import Correlation, fitted_correlation, upper_bounds
from pipeline.populations.turn_search import audit, lies_elsewhere, search, search_and_audit, train_ranking, worst_at
from pipeline.sampling.errors import draw
from pipeline.statistics.two_phase import audited_distribution, audited_share
from stages.chain import STAGES

ROOT = Path(__file__).parents[2]


def small(name: str, disk: str, count: int, **cycle: object) -> Study:
    """A study of the project with few samples on a very coarse mesh."""
    data = tomllib.loads((ROOT / f"data/studies/{name}.toml").read_text(encoding="utf-8"))
    data["samples"]["count"] = count
    data["cycle"] = {"levels_per_branch": 0, "curve_angles": 1, "audited_units": 10, **cycle}
    data["reduce"] |= {"disk": disk, "flank_edges_per_lobe": 12, "growth": 1.0, "largest_edge_mm": 3.0}
    return parse_study(data, "whole", "whole.toml", lambda design: load_design(design, ROOT))


def fresh(study: Study, disk: ElasticBody, crank: float) -> np.ndarray:
    """Compliance of the one disk at a crank angle, condensed for it alone."""
    reducer = assembly.reducer(study.design, crank)
    return disk.compliance(disk_patches(study, disk, reducer)).matrix


@pytest.mark.long
def test_disks_without_holes_are_those_of_fresh_condensations_at_any_step() -> None:
    study = small("quick", "elastic", 2, loaded_angles=31)
    disk = elastic_disk(study)
    drives = TurnDrives.from_blocks(study, 3, [turned_blocks(study, disk, 4.5 * k / 3) for k in range(3)])
    units = Units.from_errors(study, draw(study, 1, 2))
    for step in (1, 3 * 80 + 2, 3 * 4001):
        expected = fresh(study, disk, float(drives.crank_deg(step)))
        rows = assembly.disk_contacts(assembly.reducer(study.design, 0.0))
        drive = drives.drive(step, units)
        np.testing.assert_allclose(drive.compliance[np.ix_(rows, rows)], expected, atol=1e-8 * expected.max(), rtol=0)
        laws = assembly.contact_laws(study, drive.reducer)
        np.testing.assert_allclose(drive.laws.linear, laws.linear, rtol=1e-9)


@pytest.mark.long
def test_a_disk_with_holes_repeats_after_as_many_pitches_as_it_has_lobes() -> None:
    study = small("printed_drive", "elastic", 2, loaded_angles=11)
    condensed: dict[float, np.ndarray] = {}
    disk = elastic_disk(study)

    def condense(crank: float) -> list[np.ndarray]:
        condensed[crank] = fresh(study, disk, crank)
        return [condensed[crank]]

    drives = TurnDrives.from_blocks(study, 1, [full_blocks(study, 0.0, condense)])
    assert len(condensed) == study.design.cycloid.lobes
    units = Units.from_errors(study, draw(study, 1, 2))
    rows = assembly.disk_contacts(assembly.reducer(study.design, 0.0))
    for pitch in (20, 100):
        expected = fresh(study, disk, float(drives.crank_deg(pitch)))
        result = drives.drive(pitch, units).compliance[np.ix_(rows, rows)]
        np.testing.assert_allclose(result, expected, atol=1e-6 * expected.max(), rtol=0)


def test_gaps_of_the_turn_are_sums_of_what_pins_and_lobes_do() -> None:
    """First order: away from the roots the sum misses the exact gaps by a hundredth of their spread."""
    study = small("quick", "rigid", 4, loaded_angles=31)
    drives = TurnDrives.from_blocks(study, 1, [np.zeros((1, 120, 120))])
    units = Units.from_errors(study, draw(study, 1, 5))
    gaps = SeparateGaps.from_units(drives, units)
    for pitch in (80, 1234, 6000):
        drive = drives.drive(pitch, units)
        by_place = np.empty_like(drive.gap)
        by_place[:, drives.places(pitch)] = drive.gap
        total = gaps.of_pins[:, pitch % 80] + gaps.of_lobes[:, pitch % 79]
        away = np.abs(np.arange(80) - 40) < 36
        difference = (total - by_place[:, :80])[:, away]
        assert np.abs(difference).max() < 0.03 * np.ptp(by_place[:, :80])
        assert difference.std() < 0.01 * by_place[:, :80][:, away].std()


@pytest.mark.parametrize("name", ["quick", "printed_drive", "two_disks"])
@pytest.mark.long
def test_states_that_are_solved_together_are_those_of_their_own_steps(name: str) -> None:
    """The drive repeats, turned in the housing, after as many pitches as there are lobes; round pins and others."""
    study = small(name, "rigid", 4, loaded_angles=11)
    n_contacts = len(assembly.reducer(study.design, 0.0).contacts)
    drives = TurnDrives.from_blocks(study, 1, [np.zeros((1, n_contacts, n_contacts))])
    assert drives.repeats
    units = Units.from_errors(study, draw(study, 1, 5))
    waves = 1e-3 * np.random.default_rng(1).normal(size=(2, *units.errors.pin_roundness.shape))
    units = replace(units, errors=replace(units.errors, pin_roundness=waves[0] + 1j * waves[1]))
    steps, rows = np.array([3, drives.pitches - 2, drives.pitches // 2, 3]), np.array([0, 1, 2, 3])
    alone = [drives.solve_step(int(step), units.some(rows[[k]]))[2].metrics[0] for k, step in enumerate(steps)]
    np.testing.assert_allclose(drives.values_at(steps, rows, units).metrics, alone, rtol=1e-9)
    assert len(np.unique(np.array(alone)[:, 1])) == 4


def test_drives_whose_cranks_turn_by_other_ratios_or_know_their_angle_do_not_repeat() -> None:
    for name, effects in (("rv", {}), ("quick", {"crank_compliance_2": {}})):
        study = small(name, "rigid", 4, loaded_angles=11)
        study = study.model_copy(update={"design": study.design.model_copy(update={"effects": effects})})
        n_contacts = len(assembly.reducer(study.design, 0.0).contacts)
        assert not TurnDrives.from_blocks(study, 1, [np.zeros((1, n_contacts, n_contacts))]).repeats


@pytest.mark.long
def test_misses_of_the_ranking_are_known_from_those_of_other_pitches() -> None:
    """A process of known lengths: they are found again, and bounds are met by a share of a normal distribution."""
    pins, lobes, rng = 14, 13, np.random.default_rng(2)
    every = np.arange(pins * lobes)
    true = Correlation.from_lengths(pins, lobes, 2.0, 10.0, 0.3, 0.02)
    matrix = true.matrix(every[:, None], every) + 0.02 * np.eye(len(every))
    missed = 3.0 + rng.normal(size=(60, len(every))) @ np.linalg.cholesky(matrix).T
    training = np.sort(rng.choice(every, 90, replace=False))
    found = fitted_correlation(pins, lobes, training, missed[:, training])
    np.testing.assert_allclose(found.around_crank, true.around_crank)
    np.testing.assert_allclose(found.along, true.along)
    np.testing.assert_allclose(found.in_disk, true.in_disk)
    others = np.setdiff1d(every, training)
    solved = np.where(np.arange(90) < 80, np.broadcast_to(training, (60, 90)), -1)
    apart = np.broadcast_to(others, (60, len(others)))
    residuals, predicted = missed[None, :, training], np.zeros((1, *apart.shape))
    bounds = upper_bounds([found], solved, residuals, apart, predicted, 2.0)[0]
    assert 0.97 < np.mean(missed[:, others] < bounds) < 0.999  # of normal values 97.7 % or more
    assert found.variance == pytest.approx(np.var(missed[:, training], axis=1).mean(), rel=1e-9)
    assert np.std(missed[:, others] - bounds) < 0.6 * np.std(missed[:, others])
    few, some = np.arange(90) % 9 > 0, residuals[:, :1].copy()  # of one unit, and a pitch that was not solved
    some[0, 0, 1], few[1] = np.nan, False
    known, rest = training[few & (solved[0] >= 0)], some[0, 0, few & (solved[0] >= 0)]
    correlations = found.matrix(known[:, None], known) + found.noise * np.eye(len(known))
    weights = np.linalg.solve(correlations, rest - rest.mean())
    along = found.matrix(others[:, None], known)
    spread = np.sqrt((1 - along.max(axis=1) ** 2 / (1 + found.noise)) * max(rest.var(), found.variance))
    pitches = np.where(few | (np.arange(90) == 1), solved, -1)[:1]
    of_few = upper_bounds([found], pitches, some, apart[:1], predicted[:, :1], 2.0)
    np.testing.assert_allclose(of_few[0, 0], rest.mean() + along @ weights + 2 * spread, rtol=1e-9)
    unknown = upper_bounds([found], np.full((60, 1), -1), np.zeros((1, 60, 1)), apart, predicted + 1, 2.0)
    np.testing.assert_array_equal(unknown, 1.0)  # no pitch is solved yet
    twice = [found, replace(found, variance=9 * found.variance)]
    both = upper_bounds(twice, solved, residuals * [[[1.0]], [[3.0]]], apart, np.repeat(predicted, 2, axis=0), 2.0)
    np.testing.assert_allclose(both, [bounds, 3 * bounds], rtol=1e-12)  # metrics that share a correlation


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, pd.DataFrame]:
    """Units of a drive of 14 pins in all 182 pitches, whose audited units are searched for and solved at all."""
    study = small("printed_drive", "rigid", 30, loaded_angles=11, audited_units=30)
    outputs = run(STAGES, study, ["aggregate"], tmp_path_factory.mktemp("whole"), Resources(1, 100))
    return {
        name: pd.DataFrame(dict(outputs[stage].read(name)))
        for stage, name in (
            ("worst", "audit"),
            ("worst", "found"),
            ("aggregate", "units"),
            ("aggregate", "distributions"),
            ("aggregate", "convergence"),
        )
    }


def test_further_pitches_lie_beside_those_that_are_worse_than_the_ranking_says() -> None:
    """Of a unit that is solved at two pitches, by 3 above the ranking at one and by 3 below it at the other."""
    predicted_values, solved_values = np.zeros((1, 1, 40), np.float32), np.full((1, 1, 40), np.nan, np.float32)
    predicted_values[..., 12], solved_values[..., 12] = -2.5, 0.5
    predicted_values[..., 27], solved_values[..., 27] = 3.4, 0.4
    pool = turn_search._Pool(
        rows=np.array([7]),
        pitches=np.arange(40, dtype=np.int32)[None],
        predicted_values=predicted_values,
        best_columns=np.arange(40, dtype=np.int16)[None, None],
        solved_values=solved_values,
        is_open=np.array([True]),
        numbers=[0],
        correlations=[replace(Correlation.from_lengths(10, 4, 3.5, 1000.0, 0.0, 0.02), variance=0.0)],
        effort=replace(turn_search.RANKED, share=1.0, spreads=0.0),
    )
    promising_pitches, units = pool.promising(1, with_angles=False).T
    assert set(units) == {7}
    assert {11, 13} <= set(promising_pitches)
    assert np.all(np.abs(promising_pitches % 10 - 2) <= 2)  # beside the same pins of ten


@pytest.mark.long
def test_the_search_finds_nearly_the_worst_of_all_pitches(tables: dict[str, pd.DataFrame]) -> None:
    whole = tables["audit"].set_index("sample")
    found = tables["units"].set_index("sample").loc[whole.index]
    assert len(whole) == 30
    assert tables["found"]["n_solved"].max() < 182
    for name in ("lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin", "peak_pressure_MPa"):
        share = (found[f"{name}_worst"] / whole[f"{name}_worst"]).to_numpy()
        beyond = 1 / share - 1 if library()[name].smaller_is_worse else share - 1
        assert np.median(np.abs(beyond)) < 0.0005
        assert beyond.min() > -0.005
        assert (found[f"{name}_at_crank_turn"] == found[f"{name}_at_crank_deg"] // 360).all()


@pytest.mark.long
def test_the_estimate_for_the_whole_turn_is_that_of_all_pitches(tables: dict[str, pd.DataFrame]) -> None:
    """All units are audited here, so that the mean of the whole turn is known."""
    rows = tables["distributions"].query("over == 'whole_turn' and statistic == 'mean'").set_index("metric")
    whole = tables["audit"]
    for name in ("lost_motion_arcmin", "peak_pressure_MPa"):
        found = tables["units"].set_index("sample").loc[whole["sample"], f"{name}_worst"].to_numpy()
        known = np.maximum(whole[f"{name}_worst"].to_numpy(), found).mean()
        assert rows.loc[name, "value"] == pytest.approx(known, rel=1e-9)
        assert rows.loc[name, "ci_low"] < known < rows.loc[name, "ci_high"]


@pytest.mark.long
def test_the_transmission_error_of_the_whole_turn_is_that_of_loops_at_every_pitch(
    tables: dict[str, pd.DataFrame],
) -> None:
    """Of audited units, against a study that loads the same units at five times as many angles as pitches.

    The search finds nearly all of it, of which the angles of the study alone show less.
    """
    at_all = small("printed_drive", "rigid", 5, loaded_angles=911)
    columns = ["transmission_error_arcsec", "unloaded_transmission_error_arcsec"]
    with tempfile.TemporaryDirectory() as folder:
        outputs = run(STAGES, at_all, ["aggregate"], Path(folder), Resources(1, 100))
        dense = pd.DataFrame(dict(outputs["aggregate"].read("units"))).set_index("sample")[columns].loc[1:5]
    audited = tables["audit"].set_index("sample")[columns].loc[1:5]
    searched = tables["units"].set_index("sample")[columns].loc[1:5]
    np.testing.assert_allclose(audited, dense, rtol=0.02)
    assert np.all(searched > 0.9 * audited)
    assert np.all((searched / audited).mean() > 0.95)
    rows = tables["convergence"].query("not extrapolated").set_index("metric")
    of_angles, of_search = rows.loc[columns[0], "worst_mean"].iloc[-2:]
    assert of_angles < 0.95 * of_search
    rows = tables["distributions"].query("over == 'whole_turn' and statistic == 'mean'").set_index("metric")
    found = tables["units"].set_index("sample").loc[tables["audit"]["sample"], columns]
    whole = np.maximum(found, tables["audit"].set_index("sample")[columns]).mean()
    np.testing.assert_allclose(rows.loc[columns, "value"], whole, rtol=1e-9)


@pytest.mark.long
def test_five_times_finer_angles_find_no_more_than_the_bound_of_the_continuous_turn(
    tables: dict[str, pd.DataFrame],
) -> None:
    """25 phases of a pitch in place of 5 beside the worst pitches of the same units."""
    study = small("printed_drive", "rigid", 30, loaded_angles=11, audited_units=30)
    samples = tables["audit"]["sample"].to_numpy()
    contacts = len(assembly.reducer(study.design, 0.0).contacts)
    drives = TurnDrives.from_blocks(study, 25, [np.zeros((1, contacts, contacts))] * 25)
    finer = audit(drives, Units.from_errors(study, draw(study, 0, 31)).some(samples))[1]
    rows = tables["distributions"].query("statistic == 'mean'").set_index(["over", "metric"])["value"]
    added = []
    for name in ("clearance_backlash_arcmin", "lost_motion_arcmin", "peak_pressure_MPa"):
        found = tables["units"].set_index("sample").loc[samples, f"{name}_worst"].to_numpy()
        known = np.maximum(finer.value[name], found).mean()
        estimate, bound = rows["whole_turn", name], rows["continuous_turn", name]
        added.append((known - estimate) / (bound - estimate))
    assert min(added) > 0.3  # it is no empty one either
    assert max(added) < 1.05  # kinks alone would give 1 in the mean


@pytest.mark.parametrize(("factor", "moves"), [(1.1, False), (3.0, True)])
@pytest.mark.long
def test_the_worst_of_other_contacts_lie_where_those_of_the_stated_ones_do_or_elsewhere(factor, moves) -> None:
    """Other forms of the model are looked at there alone, in 8 to 20 of the 182 pitches; against all of them."""
    study = small("printed_drive", "rigid", 20, loaded_angles=11)
    softer = study.model_copy(update={"springs": study.springs.model_copy(update={"pin_deflection_factor": factor})})
    contacts = len(assembly.reducer(study.design, 0.0).contacts)
    units = Units.from_errors(study, draw(study, 1, 21))
    stated, other = (
        TurnDrives.from_blocks(form, 5, [np.zeros((1, contacts, contacts))] * 5) for form in (study, softer)
    )
    found, true = worst_at(other, units, audit(stated, units)[1].best_steps), audit(other, units)[1]
    assert 8 < found.n_solved.mean() < 20
    assert lies_elsewhere(found, true, library()) == moves
    assert lies_elsewhere(found, true, ["transmission_error_arcsec"])
    for name in ("lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin", "peak_pressure_MPa"):
        assert moves or np.mean(np.abs(true.value[name] / found.value[name] - 1)) < 0.001


@pytest.mark.long
def test_finite_motions_are_part_of_what_is_found_and_of_both_audits() -> None:
    """The play at the step of the worst, solved there alone, with what finite motions add."""
    study = small("printed_drive", "rigid", 20, loaded_angles=11)
    contacts = len(assembly.reducer(study.design, 0.0).contacts)
    drives = TurnDrives.from_blocks(study, 5, [np.zeros((1, contacts, contacts))] * 5)
    units, rows = Units.from_errors(study, draw(study, 1, 21)), np.arange(3, 7)
    ranking = train_ranking(drives, units, np.random.SeedSequence(1))
    name = "clearance_backlash_arcmin"
    found = search_and_audit(drives, ranking, units, rows)
    for worst, of_units in zip(found, (np.arange(20), rows, rows), strict=True):
        steps = worst.step[name]
        alone = drives.values_at(steps, of_units, units).metrics[:, list(library()).index(name)]
        change = ARCMIN * drives.backlash_change_at(steps, of_units, units)
        assert np.min(np.abs(change)) > 1e-4
        np.testing.assert_allclose(worst.value[name], alone + change, rtol=1e-9)


@pytest.mark.long
def test_a_second_look_at_angles_adds_a_little_to_the_loaded_transmission_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first pitches say at which few further ones an angle may lie beyond those solved.

    They add some thousandths to the range under load, and nothing without load, where the ranking is exact.
    """
    study = small("pin_in_hole", "rigid", 80, loaded_angles=11)
    contacts = len(assembly.reducer(study.design, 0.0).contacts)
    drives = TurnDrives.from_blocks(study, 5, [np.zeros((1, contacts, contacts))] * 5)
    units = Units.from_errors(study, draw(study, 1, 81))
    ranking = train_ranking(drives, units.some(slice(40)), np.random.SeedSequence(1))
    found = search(drives, ranking, units.some(slice(40, 80)))
    pool = turn_search._Pool
    promising = pool.promising
    monkeypatch.setattr(pool, "promising", lambda self, n_best, _: promising(self, n_best, with_angles=False))
    first_look = search(drives, ranking, units.some(slice(40, 80)))
    assert 1 < np.mean(found.n_solved - first_look.n_solved) < 6
    names = ("transmission_error_arcsec", "unloaded_transmission_error_arcsec")
    loaded, unloaded = (found.of_turn[name] / first_look.of_turn[name] - 1 for name in names)
    assert loaded.min() >= 0
    assert 0.001 < loaded.mean() < 0.02
    np.testing.assert_allclose(unloaded, 0.0, atol=1e-9)


@pytest.mark.long
def test_intervals_of_audited_estimates_hold_the_truth() -> None:
    """Of 120 experiments 89 to 99 %: values of 400 units, 40 of which show a shortfall in a third of the cases."""
    rng = np.random.default_rng(5)

    def shortfall(n: int) -> np.ndarray:
        return np.where(rng.random(n) < 0.33, rng.exponential(0.1, n), 0.0)

    population = rng.normal(size=400_000) + shortfall(400_000)
    truths = {"share": np.mean(population <= 0.5), "mean": population.mean(), "p95": np.quantile(population, 0.95)}
    hits = dict.fromkeys(truths, 0)
    for _ in range(120):
        found, missed = rng.normal(size=400), shortfall(40)
        estimates = audited_distribution(found, missed, 0.95)
        estimates["share"] = audited_share((found <= 0.5 - one for one in missed), 0.95)
        for name, truth in truths.items():
            hits[name] += estimates[name].ci_low <= truth <= estimates[name].ci_high
    assert all(107 <= count <= 119 for count in hits.values()), hits


def test_audited_estimates_of_many_units_hold_no_table_of_all_sums() -> None:
    """Quantiles are those of all sums of a unit and a shortfall; 100,000 units take less than 60 bytes each."""
    rng = np.random.default_rng(6)
    found, missed = rng.normal(size=100_000), np.where(rng.random(40) < 0.5, rng.exponential(0.3, 40), 0.0)
    tracemalloc.start()
    estimates = audited_distribution(found, missed, 0.95)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60 * len(found)
    sums = np.add.outer(found, missed)
    for name, level in (("p05", 0.05), ("p50", 0.5), ("p95", 0.95)):
        assert estimates[name].value == pytest.approx(np.quantile(sums, level), abs=1e-4)
        share = audited_share(np.transpose(sums <= estimates[name].value), 0.95)
        assert share.value == pytest.approx(level, abs=1e-5)
        ends = np.quantile(sums, [share.ci_low, share.ci_high])
        np.testing.assert_allclose([estimates[name].ci_low, estimates[name].ci_high], ends, atol=1e-4)


@pytest.mark.long
def test_the_search_over_a_carriers_turn_falls_little_short_of_all_pitches() -> None:
    """Few contacts of an RV reducer carry: the ranking foretells half of what varies. Four units at all pitches."""
    study = small("rv_80e", "rigid", 20, loaded_angles=11)
    contacts = len(assembly.reducer(study.design, 0.0).contacts)
    drives = TurnDrives.from_blocks(study, 5, [np.zeros((1, contacts, contacts))] * 5)
    units = Units.from_errors(study, draw(study, 1, 21))
    ranking = train_ranking(drives, units.some(slice(4, 20)), np.random.SeedSequence(1))
    assert "zero_torque_width_arcmin" not in ranking.names  # without friction it is the backlash
    found, true = search(drives, ranking, units.some(slice(4))), audit(drives, units.some(slice(4)))[1]
    assert np.all((found.n_solved > 60) & (found.n_solved < 500))
    for name in ranking.names:
        short = np.abs(found.value[name] / true.value[name] - 1)
        assert short.mean() < 0.02
        assert short.max() < 0.04

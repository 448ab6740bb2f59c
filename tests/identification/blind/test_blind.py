"""The generator of blind units, the table of their cases and the rates made of it."""

import json
import tomllib
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from pipeline import assembly, settings
from pipeline.engine.fingerprint import source_hashes
from pipeline.identification.fitting.build import refittable_keys
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection import model_selection
from pipeline.model.effects.effect import TIME
from pipeline.sampling.errors import draw
from tests.validation.__main__ import main
from tests.validation.blind import generate as generating
from tests.validation.blind import run
from tests.validation.blind.bench import draw_bench
from tests.validation.blind.catalogue import CRANKS_A_DESIGN, OFF, PLAUSIBLE, UNCERTAIN, catalogue, condense
from tests.validation.blind.effect_size import amplitude_of, problem_of
from tests.validation.blind.generate import FULL, MEASURING_UM, NONE, RIGID, Maker, generate, kind_of, simulator_of
from tests.validation.blind.outside_effects import OUTSIDE
from tests.validation.blind.rates import lower_bound, rates, write_reports
from tests.validation.blind.true_unit import UnsoundError, true_unit

ROOT = Path(__file__).parents[3]
OFFERED = ("coulomb", "output_torsion", "preload")
"""Effects that may be named where the verdict is not what is asked."""


@pytest.fixture(scope="module")
def smallest(tmp_path_factory):
    """A maker of units of the catalogue's smallest reducer alone."""
    folder = tmp_path_factory.mktemp("blind")
    reducers = tuple(design_reducer for design_reducer in catalogue(ROOT) if design_reducer.name == "holes_19")
    return Maker(reducers, condense(reducers, folder / "condensed", 1), folder, ROOT, seed=5)


def _of_kind(kind: str) -> int:
    return next(case for case in range(100) if kind_of(case) == kind)


def test_every_run_has_the_proportions_of_the_full_one():
    kinds = [kind_of(case) for case in range(60)]
    total = sum(FULL.values())
    for kind, count in FULL.items():
        assert abs(kinds.count(kind) - 60 * count / total) < 1


@pytest.mark.long
def test_a_unit_is_the_same_whatever_was_made_before(smallest, tmp_path):
    case = _of_kind("outside")
    first_result = generate(smallest, case)
    data = (smallest.unit_folder(case) / "data.csv").read_bytes()
    variant = replace(smallest, folder=tmp_path)
    generate(variant, _of_kind("one"))
    second = generate(variant, case)
    assert first_result.truth == second.truth
    assert data == (variant.unit_folder(case) / "data.csv").read_bytes()
    assert data != _data(replace(variant, seed=6), case)


def test_every_other_unit_of_a_kind_is_of_the_second_simulator():
    simulators = [(kind_of(case), simulator_of(case)) for case in range(60)]
    for kind in FULL:
        of_kind = [simulator for unit_kind, simulator in simulators if unit_kind == kind]
        assert abs(of_kind.count(RIGID) - len(of_kind) / 2) <= 0.5


@pytest.mark.long
def test_a_unit_of_the_second_simulator_is_believed_with_a_rigid_disk_and_another_law(smallest):
    case = next(case for case in range(100) if (kind_of(case), simulator_of(case)) == (NONE, RIGID))
    unit = generate(smallest, case)
    study = tomllib.loads((smallest.unit_folder(case) / "study.toml").read_text())
    assert (study["reduce"]["disk"], study["springs"]["law"]) == ("rigid", "hertz")
    assert unit.truth["simulator"] == RIGID
    assert not np.any(unit.believed(unit.unit.study, unit.unit.bench.cranks))
    problem, over_cells = problem_of(load_measured_unit(smallest.unit_folder(case), ROOT), unit.believed)
    fitter, cells = Fitter(problem), np.ones(len(problem.data), bool)
    fit = fitter.fit(Model(), cells, fitter.start(Model()))
    assert np.sqrt(np.mean(((problem.data.angle - fit.predicted_angle) / problem.data.sigma) ** 2)) < 1.25


def _data(maker: Maker, case: int) -> bytes:
    generate(maker, case)
    return (maker.unit_folder(case) / "data.csv").read_bytes()


def test_the_truth_is_not_in_the_units_folder(smallest):
    case = _of_kind("one")
    unit = generate(smallest, case)
    folder = smallest.unit_folder(case)
    assert {path.name for path in folder.iterdir()} <= {
        "data.csv",
        "unit.toml",
        "design.toml",
        "study.toml",
        "dims.toml",
    }
    sealed = smallest.truth_path(case)
    assert json.loads(sealed.read_text())["truth"] == unit.truth["truth"]
    assert folder not in sealed.parents
    words = "".join(path.read_text() for path in folder.glob("*.toml"))
    assert unit.truth["truth"] not in words
    assert not any(effect.name in words for effect in OUTSIDE)


@pytest.mark.long
def test_what_the_model_believes_is_off_as_a_bench_and_a_calibration_are(smallest):
    """Calibrated numbers by 5 to 20 %, inside of their stated ranges; measured dimensions by what measuring leaves."""
    units = [generate(smallest, case) for case in range(9) if kind_of(case) == NONE]
    scales = np.array([list(design_reducer.truth["scales"].values()) for design_reducer in units])
    assert np.all((np.abs(np.log(scales)) >= np.log(OFF[0])) & (np.abs(np.log(scales)) <= np.log(OFF[1])))
    assert OFF[1] < PLAUSIBLE
    offsets = []
    for design_reducer in units:
        folder = smallest.unit_folder(design_reducer.truth["case"])
        if design_reducer.truth["dimensions_known"]:
            written_file = tomllib.loads((folder / "dims.toml").read_text())
            offsets.append(np.array(written_file["pin_radial"]) - design_reducer.dimensions.pin_radial[0])
            design = tomllib.loads((folder / "design.toml").read_text())["provenance"]
            assert all("plausible" in design[key] for key in design_reducer.truth["scales"])
    assert len(offsets) >= 2
    spread = np.std(np.array(offsets) - np.mean(offsets, axis=1, keepdims=True))
    assert 0.7 * MEASURING_UM < spread < 1.4 * MEASURING_UM


def test_the_size_is_what_was_asked_for(smallest):
    truth = generate(smallest, _of_kind("one")).truth
    assert 0.9 <= truth["size_over_noise"] <= 33


def test_no_unit_asks_for_what_no_verdict_may_claim(smallest, monkeypatch):
    """A time constant beyond the record, or a size at the library's bound, supports no claim."""
    creep = candidates()["creep"]
    monkeypatch.setattr(generating, "candidates", lambda: {"creep": creep})
    monkeypatch.setattr(generating, "draw_shape", lambda rng, bounds: (np.array([1.0, 0.0]), np.array([0.0, 0.69])))
    yardstick = SimpleNamespace(
        problem=SimpleNamespace(
            training=None,
            candidates_for=lambda offered, _: offered,
            bounds=lambda _: ((0.0, 1.0), (0.05, 1e4)),
            record={TIME: 100.0},
        ),
        size=lambda change: 1e3,
    )
    draw = generating._Draw(smallest, 1, 0)
    with pytest.raises(UnsoundError, match="no effect reaches its size"):  # 0.05 (2e5)^0.69 = 227 s
        draw._library(yardstick, "one")
    monkeypatch.setattr(generating._Draw, "_sought", lambda *_: (0.95, 4.0))
    monkeypatch.setattr(generating, "draw_shape", lambda rng, bounds: (np.array([1.0, 0.0]), np.array([0.0, 0.5])))
    with pytest.raises(UnsoundError, match="no effect reaches its size"):
        draw._library(yardstick, "one")
    monkeypatch.setattr(generating._Draw, "_sought", lambda *_: (0.85, 4.0))
    _, result = draw._library(yardstick, "one")
    assert result["effects"][0]["values"] == pytest.approx([0.85, 0.05 * 2e5**0.5])


def test_an_amplitude_is_found_where_the_size_grows_and_none_where_it_cannot():
    amplitude, size = amplitude_of(lambda a: 50 * a**1.5, 4.0)
    assert size == pytest.approx(4.0, rel=0.1)
    assert 50 * amplitude**1.5 == pytest.approx(size)
    assert amplitude_of(lambda a: 2 * a, 4.0) is None


def test_without_effect_and_noise_the_models_own_study_is_recovered(smallest, tmp_path):
    """The generator's curves differ from the model's only through what it says: mesh, law and its own numbers."""
    from tests.validation.blind.files import write_unit

    reducer = smallest.reducers[0]
    study, (believed_study, _) = reducer.model, smallest.condensed[reducer.name]
    bench = draw_bench(np.random.default_rng(3), reducer.cranks, study.design.cycloid.rated_torque_Nm)
    bench = replace(bench, torque_noise=0.0, torque_step=1e-9)
    sample = draw(study, 4, 5)
    keys = refittable_keys(study.design)
    unit = true_unit(study, keys, (1.2, 0.95), assembly.errors(sample), 0.0, believed_study(study, bench.cranks), bench)
    write_unit(tmp_path / "u", study, bench, unit.angles(), (0.0, 1e-9), np.random.default_rng(0), sample, 0.0)
    problem, _ = problem_of(load_measured_unit(tmp_path / "u", ROOT), believed_study)
    fitter, all_cells = Fitter(problem), np.ones(len(problem.data), bool)
    fit = fitter.fit(Model(), all_cells, fitter.start(Model()))
    # the cells within the play's jump have a sigma of their own; all others weigh alike
    is_precise = problem.data.sigma < 3 * np.median(problem.data.sigma)
    assert np.sqrt(np.mean((problem.data.angle - fit.predicted_angle)[is_precise] ** 2)) < 1e-3 * problem.span
    assert set(keys) <= set(UNCERTAIN)


def test_an_outside_effect_vanishes_with_its_amplitude(smallest):
    unit = generate(smallest, _of_kind(NONE))
    rng = np.random.default_rng(1)
    reference = unit.unit.angles()
    for effect in OUTSIDE:
        shape = effect.shape(rng)
        tiny_effect, small_effect = (
            unit.unit.angles_outside(effect.at(amplitude, shape)) for amplitude in (1e-9, 0.05)
        )
        # both interpolate the same frictionless curve
        assert np.max(np.abs(np.concatenate(tiny_effect) - np.concatenate(reference))) < 1e-3 * np.ptp(reference[0])
        assert np.max(np.abs(np.concatenate(small_effect) - np.concatenate(reference))) > 2e-3 * np.ptp(reference[0])


def test_effects_of_the_library_change_the_curves(smallest):
    unit = generate(smallest, _of_kind(NONE))
    reference = np.concatenate(unit.unit.angles())
    torsion = candidates()["output_torsion"]
    twisted = np.concatenate(unit.unit.angles([torsion], [0.01]))
    torque = np.concatenate([ramp.torque for ramp in unit.unit.bench.ramps])
    assert twisted - reference == pytest.approx(0.01 * torque, abs=1e-9)
    creep, gain = (
        np.concatenate(unit.unit.angles([candidates()[name]], values))
        for name, values in (("torque_creep", [0.05, 1e-6]), ("torque_gain", [0.05]))
    )
    later = np.concatenate([np.arange(len(ramp.torque)) > 0 for ramp in unit.unit.bench.ramps])
    assert creep[later] == pytest.approx(gain[later], abs=1e-4)  # after the first row a delay of no length is a gain
    assert np.max(np.abs(gain - reference)) > 0.01


@pytest.mark.parametrize(("passes", "findings_of_unit"), [(60, 60), (57, 60), (1, 10), (199, 200)])
def test_bound_is_where_so_many_have_a_chance_of_5_percent(passes, findings_of_unit):
    assert binom.sf(passes - 1, findings_of_unit, lower_bound(passes, findings_of_unit)) == pytest.approx(0.05)


def test_bounds_known_by_name():
    assert lower_bound(0, 12) == 0
    assert lower_bound(60, 60) == pytest.approx(0.05 ** (1 / 60))  # the rule of three: 95.1 %


def test_what_counts_as_right():
    design_reducer, double = frozenset({"coulomb"}), frozenset({"coulomb", "preload"})
    named_sets = [frozenset({"preload"}), frozenset({"coulomb"})]
    four_sets = [frozenset({name}) for name in ("coulomb", "a", "b", "c")]
    assert run.is_correct("none", 0, frozenset({"none"}), [], "adequate")
    assert not run.is_correct("none", 0, frozenset({"none"}), named_sets, "equivalent")
    assert run.is_correct("one", 5, design_reducer, named_sets, "equivalent")
    assert not run.is_correct("one", 5, design_reducer, four_sets, "equivalent")
    assert not run.is_correct(
        "one", 5, design_reducer, [double], "identified"
    )  # a pair claims an effect that is not there
    assert run.is_correct("two", 5, double, [design_reducer], "identified")
    outside_path = frozenset({"outside:stick_slip"})
    assert run.is_correct("outside", 9, outside_path, [], "not explained by the library")
    assert run.is_correct("outside", 2, outside_path, [], "adequate")
    assert not run.is_correct("outside", 9, outside_path, [], "adequate")
    assert not run.is_correct("outside", 2, outside_path, named_sets, "equivalent")


def test_a_class_too_large_to_be_right_has_not_both_effects_of_a_pair():
    true = frozenset({"coulomb", "preload"})
    others = [frozenset({"coulomb", name}) for name in ("ovality_3", "pin_circle_error", "pin_radius_error")]
    assert run.has_both(true, [true, *others[:2]])
    assert not run.has_both(true, [true, *others])
    assert not run.has_both(true, others[:2])


def test_a_case_end_to_end_and_resumed(smallest, tmp_path, monkeypatch):
    monkeypatch.setattr(model_selection, "candidates", lambda: {name: candidates()[name] for name in OFFERED})
    monkeypatch.setattr(run, "catalogue", lambda root: smallest.reducers)
    monkeypatch.setattr(run, "condense", lambda reducers, folder, jobs: smallest.condensed)
    rows = run.blind(range(1), 8, 1, ROOT, tmp_path)
    table = pd.read_csv(tmp_path / "blind" / "cases.csv")
    contract = "case truth size_over_noise verdict named class_size correct oracle_separates rms_declared_arcmin"
    columns = "rms_recalibrated_arcmin rms_after_arcmin noise_floor_arcmin seconds"
    assert [*contract.split(), *columns.split()] == list(table.columns[:13])
    assert list(table["case"]) == [0]
    assert table["rms_recalibrated_arcmin"].notna().all()
    monkeypatch.setattr(run, "one_case", lambda *_: pytest.fail("a finished case was solved again"))
    assert [row.truth for row in run.blind(range(1), 8, 1, ROOT, tmp_path)] == [row.truth for row in rows]
    assert {rate.name for rate in rates(rows)} >= {"no effect: none named"}


def test_cases_of_another_range_stay_in_the_table(smallest, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "catalogue", lambda root: smallest.reducers)
    monkeypatch.setattr(run, "condense", lambda reducers, folder, jobs: smallest.condensed)
    row = run.Row(**{**dict.fromkeys([field.name for field in fields(run.Row)], 0), "seed": 8})
    monkeypatch.setattr(run, "one_case", lambda maker, case, code: replace(row, case=case, code=code))
    assert [row.case for row in run.blind(range(3), 8, 1, ROOT, tmp_path)] == [0, 1, 2]
    assert [row.case for row in run.blind(range(2, 5), 8, 1, ROOT, tmp_path)] == [2, 3, 4]
    assert [row.case for row in run.read_rows(tmp_path / "blind" / "cases.csv")] == [0, 1, 2, 3, 4]


def test_every_reducer_of_the_catalogue_is_drawn_at_its_own_crank_angles():
    for reducer in catalogue(ROOT):
        for study in (reducer.model, reducer.truth, reducer.rigid_model, reducer.rigid_truth):
            assert len(set(study.cycle.crank_deg)) == CRANKS_A_DESIGN
            assert study.cycle.loaded_angles is None


@pytest.mark.long
def test_the_command_starts_at_the_case_it_is_told_and_writes_its_rates(smallest, tmp_path, monkeypatch, capsys):
    case = next(number for number in range(100) if kind_of(number) == NONE and simulator_of(number) == RIGID)
    monkeypatch.setattr(model_selection, "candidates", lambda: {name: candidates()[name] for name in OFFERED})
    monkeypatch.setattr(
        run, "condense", lambda reducers, *_: {name.name: smallest.condensed["holes_19"] for name in reducers}
    )
    monkeypatch.setattr(settings, "RUNS", tmp_path)
    assert main(["blind", "--cases", "1", "--first", str(case), "--jobs", "1"]) == 0
    assert "no effect: none named" in capsys.readouterr().out
    assert [row.case for row in run.read_rows(tmp_path / "blind" / "cases.csv")] == [case]
    assert main(["blind", "--cases", "1", "--first", "-1"]) == 2
    assert "--first = -1; must be at least 0" in capsys.readouterr().err


def test_a_row_depends_on_every_source_and_on_the_catalogues_studies(smallest, monkeypatch):
    sources, hash_before = source_hashes(run.__name__), run.source_hash(smallest.reducers)
    used_names = "assembly mounting sampling/errors identification/identify"
    used_names += " model/effects/creep"
    paths = [*(f"pipeline/{name}.py" for name in used_names.split()), "stages/tables/keys.py", "stages/reduce.py"]
    paths += ["tests/validation/blind/bench.py"]
    assert set(paths) <= set(sources)
    for path in paths:
        monkeypatch.setattr(run, "source_hashes", lambda _, path=path: sources | {path: "edited"})
        assert run.source_hash(smallest.reducers) != hash_before
    monkeypatch.undo()
    assert run.source_hash(smallest.reducers) == hash_before
    reducer = smallest.reducers[0]
    finer = reducer.truth.model_copy(update={"reduce": reducer.model.reduce})
    assert run.source_hash((replace(reducer, truth=finer),)) != hash_before


def test_unit_whose_identification_fails_keeps_its_row_with_the_reason(smallest, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "catalogue", lambda root: smallest.reducers)
    monkeypatch.setattr(run, "condense", lambda reducers, folder, jobs: smallest.condensed)

    def failing(unit, *_, **__):
        raise ArithmeticError(f'no force, "{unit.folder.name}",\nnot anywhere')

    monkeypatch.setattr(run, "identify", failing)
    rows = run.blind(range(2), 8, 1, ROOT, tmp_path)
    assert [(row.verdict, row.correct) for row in rows] == [("failed", False)] * 2
    kept_items = list(run.read_rows(tmp_path / "blind" / "cases.csv"))
    assert kept_items[1].reason == 'ArithmeticError: no force, "0001",\nnot anywhere'
    assert [row.truth for row in kept_items] == [row.truth for row in rows]
    write_reports(kept_items, tmp_path / "report")
    assert "failed" in (tmp_path / "report" / "confusion.csv").read_text()

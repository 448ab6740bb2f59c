"""From a synthetic unit with friction to the files that a user sees, and the corrected study that runs."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from measured_bench import measured, write_unit
from synthetic_unit import EXAMPLE, TRIED, Condensed, problem_of

from pipeline import assembly, cli, settings
from pipeline.cli.identify import parts_left_out
from pipeline.config import load_study
from pipeline.config.changing import toml_of
from pipeline.config.studies.study import LAW_FACTORS
from pipeline.engine.store import Output
from pipeline.identification.fitting.build import one_unit
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.results import corrected_design, tables
from pipeline.identification.results.prediction_errors import LoopError, angle_of_branch
from pipeline.identification.results.residual_signatures import (
    SignatureCells,
    _friction,
    _over_the_angle,
    _over_the_crank,
    _over_time,
    _play,
    _rigidity,
    judged_signature,
    trend,
)
from pipeline.identification.results.write import crank_advice, play_advice
from pipeline.identification.selection.criteria import NAMED_ODDS
from pipeline.identification.selection.held_out import AngleError
from pipeline.identification.selection.statements.remainder import Remainder
from pipeline.identification.selection.statements.verdict import ADEQUATE, UNEXPLAINED, Verdict
from pipeline.report.unit import facts
from pipeline.report.unit.facts import _groups, comparison_sentence, held_crank_sentence, limits_note, rows_facts
from pipeline.report.unit.rows import candidate_row, remainder_cards
from pipeline.sampling.errors import draw
from pipeline.statistics.curve_scatter import CurveScatter

ROOT = Path(__file__).parents[2]


def simulated(
    positions: int = 3, cycles: int = 3, noise: float = 0.01, seed: int = 3, **parts: float
) -> SignatureCells:
    """Cells of loops whose residual holds known parts."""
    rng = np.random.default_rng(seed)
    rows = []
    block = 0
    for position in range(positions):
        for cycle in range(cycles):
            for falling in (-1.0, 1.0):
                torque = -falling * np.linspace(-12, 12, 40)
                rows += [(t, falling, 2 * np.pi * position / positions, cycle, position, block) for t in torque]
                block += 1
    torque, falling, crank, cycle, position, of_block = np.array(rows).T
    angle = torque / 5 + 0.1 * falling
    residual = (
        parts.get("half", 0) * falling
        + parts.get("growth", 0) * falling * np.abs(torque)
        + parts.get("play", 0) * 0.5 * np.sign(torque)
        + parts.get("slope", 0) * torque
        + parts.get("crank", 0) * np.cos(crank) * 0.5 * np.sign(torque)
        + parts.get("cycle", 0) * cycle * 0.5 * np.sign(torque)
        + parts.get("wave", 0) * np.cos(2 * np.pi * angle / 0.7)
        + noise * rng.standard_normal(len(torque))
    )
    hours = np.arange(len(torque)) / 3600
    return SignatureCells(
        residual,
        torque,
        falling,
        crank,
        angle,
        cycle,
        hours,
        np.full(len(torque), np.nan),
        position.astype(int),
        of_block.astype(int),
    )


@pytest.mark.parametrize(
    ("part", "value", "name", "read"),
    [
        ("half", 0.2, "branch_half_difference", _friction),
        ("growth", 0.02, "branch_growth", _friction),
        ("play", 0.3, "play", _play),
        ("slope", 0.05, "compliance", lambda cells: [_rigidity(cells)]),
        ("crank", 0.3, "crank_1_cosine", lambda cells: _over_the_crank(cells, 3)),
        ("cycle", 0.1, "play_per_cycle", _over_time),
    ],
)
def test_a_signature_is_the_part_that_was_put_in(part: str, value: float, name: str, read) -> None:
    (signature,) = [item for item in read(simulated(**{part: value})) if item.name == name]
    assert signature.ci_low < value < signature.ci_high
    assert abs(signature.value - value) < 0.1 * value
    assert signature.significant
    (bare_signature,) = [item for item in read(simulated()) if item.name == name]
    assert abs(bare_signature.value) < 0.1 * value


def test_the_strongest_period_over_the_output_angle_is_found() -> None:
    amplitude, period = _over_the_angle(simulated(wave=0.1))
    assert amplitude.significant
    assert period.value == pytest.approx(0.7, rel=0.05)
    assert amplitude.value == pytest.approx(0.1, rel=0.25)


def test_false_alarms_of_the_signatures_keep_their_level() -> None:
    alarms = [
        item.significant
        for seed in range(20)
        for read in (_friction, _play, _over_time)
        for item in read(simulated(seed=seed))
        if not item.why_not
    ]
    assert np.mean(alarms) < 0.12


@pytest.mark.long
def test_a_coefficient_that_is_not_there_is_seen_in_one_residual_of_twenty() -> None:
    """Of 2,400 drawn, cells of a branch alike in part; 6.1 % without the factor n/(n - 1) of the variance."""
    alarms = []
    for n_blocks in (6, 8, 12):
        rng, block = np.random.default_rng(n_blocks), np.repeat(np.arange(n_blocks), 10)
        torque, falling = np.tile(np.linspace(-1, 1, 10), n_blocks), np.where(block % 2, 1.0, -1.0)
        columns, everything = np.column_stack([falling, falling * np.abs(torque), torque]), np.ones(len(block), bool)
        for number in range(800):
            residual = rng.standard_normal(len(block)) + 0.5 * rng.standard_normal(n_blocks)[block]
            cells = SimpleNamespace(residual=residual, position=np.zeros(len(block), int), block=block)
            alarms.append(judged_signature("", "", "", trend(cells, everything, columns, number % 3)).significant)
    assert np.mean(alarms) == pytest.approx(0.05, abs=0.009)


def test_a_step_across_zero_torque_is_not_shown_by_cells_at_no_torque() -> None:
    """Of one sense, too: a normal matrix of zeros was singular."""
    cells = simulated(half=0.2)
    cells = replace(cells, torque=np.where(np.abs(cells.torque) > 3.1, cells.torque, 0.0))
    rising = replace(cells, falling=np.where(cells.torque == 0, -1.0, cells.falling))
    for play, asymmetry in map(_play, (cells, rising)):
        assert play.why_not == "no cell shows it"
        assert not play.significant
        assert np.isfinite(asymmetry.p_value)


def test_harmonics_that_the_positions_do_not_determine_are_named() -> None:
    reasons = {item.name: item.why_not for item in _over_the_crank(simulated(), 3)}
    assert reasons["crank_1_sine"] == ""
    assert reasons["crank_2_cosine"] == "needs 5 crank positions of known angle, has 3"
    assert reasons["crank_3_cosine"] == "needs 7 crank positions of known angle, has 3"


def test_settings_are_read_back_as_they_were_written() -> None:
    content = {
        "title": 'a "quoted" \\ line',
        "flag": True,
        "list": (1.0, 2.5e-7),
        "effects": {"coulomb": {"torque_Nm": 0.3}},
        "nothing": None,
        "cases": ({"label": "a", "pin_radial": (1.0, 2.0)}, {"label": "b"}),
        "provenance": {"effects.coulomb.torque_Nm": {"status": "chosen", "reason": "x"}},
    }
    read = tomllib.loads(toml_of(content))
    assert read == json.loads(json.dumps({key: value for key, value in content.items() if key != "nothing"}))


CRANKS = (0.0, 40.0, 95.0)
FRICTION = 0.5
"""What is mistaken for it most easily, and an effect that is not testable; ``test_recovery`` has every effect."""


@pytest.mark.parametrize("name", ["paper", "two_disks"])
def test_a_study_of_angles_evenly_over_the_turn_is_written_with_those_of_the_unit(name: str) -> None:
    study = load_study(name, settings.ROOT)
    assert study.cycle.loaded_angles is not None
    unit = SimpleNamespace(name="u", settings=SimpleNamespace(title="U"), dimensions=None, study=study)
    measurement = SimpleNamespace(unit=unit, drive_cranks=np.array([0.0, 65.4545, 425.4545]))
    problem = SimpleNamespace(calibrated_keys=("a",), mean_unit=None, modes_of_errors=lambda modes: SimpleNamespace())
    identification = SimpleNamespace(measurement=measurement, problem=problem)
    unknowns = SimpleNamespace(scales=np.zeros(1 + len(LAW_FACTORS)), modes=np.zeros(0))
    trial = SimpleNamespace(fit=SimpleNamespace(unknowns=unknowns))
    written = tomllib.loads(corrected_design._study_text(identification, trial, corrected_design.BEST_KIND))
    assert written["cycle"]["crank_deg"] == [0.0, 65.4545]
    assert "loaded_angles" not in written["cycle"]


@pytest.mark.parametrize("is_measured", [True, False])
def test_a_written_study_has_the_dimensions_of_its_fit(is_measured: bool, tmp_path: Path, condensed: Condensed) -> None:
    """A measured run-out keeps its direction, and what was fitted of it is added as a vector; so is one of tolerances.

    The file is read again: its one unit has the errors of the mean unit and of the modes.
    """
    shutil.copytree(ROOT / "data/measured" / EXAMPLE, folder := tmp_path / "u")
    settings_file = folder / "unit.toml"
    if is_measured:
        with (folder / "dimensions.toml").open("a") as file:
            file.write("\nbore_runout = 6.0\nbore_runout_direction_deg = 50.0\n")
    else:
        settings_file.write_text(settings_file.read_text().replace('"dimensions.toml"', '"unknown"'))
        study_text = (ROOT / "data/studies/quick.toml").read_text()
        further = '[tolerances.bore_runout]\ndistribution = "uniform"\nlower_um = 0.0\nupper_um = 8.0\n'
        (tmp_path / "runout.toml").write_text(f"{study_text}\n{further}")
        settings_file.write_text(settings_file.read_text().replace('"quick"', '"../runout.toml"'))
    measurement = Measurement.read(load_measured_unit(folder, ROOT))
    problem = problem_of(folder, condensed)
    amounts = np.where(np.arange(problem.n_modes) % 2, -1.0, 1.5)
    fit = SimpleNamespace(unknowns=SimpleNamespace(modes=amounts))
    case = corrected_design.fitted_dimensions(
        SimpleNamespace(problem=problem, measurement=measurement), SimpleNamespace(fit=fit)
    )
    if is_measured:
        assert case.bore_runout == pytest.approx(6.0, abs=1.5)
        assert case.bore_runout_direction_deg == pytest.approx(50.0, abs=12.0)
    written = vars(assembly.errors(draw(one_unit(measurement.unit.study, case), 0, 1)))
    usual, fitted = vars(assembly.errors(problem.mean_unit)), vars(problem.modes_of_errors(amounts))
    assert np.linalg.norm(fitted["bore_runout"]) > 1e-4
    for name, values in fitted.items():
        np.testing.assert_allclose(written[name][0], usual[name][0] + values, atol=3e-7, err_msg=name)
    vectors = np.linalg.norm(usual["bore_runout"][0])
    assert vectors == pytest.approx(6e-3) if is_measured else vectors < 1e-3  # of random directions almost none is left


@pytest.fixture(scope="module", params=[TRIED, pytest.param(tuple(candidates()), marks=pytest.mark.attack)])
def offered(request: pytest.FixtureRequest) -> tuple[str, ...]:
    """Effects that are tried."""
    return request.param


@pytest.fixture(scope="module")
def folder(offered: tuple[str, ...], identified_example: Callable[[Sequence[str]], Path]) -> Path:
    """Results of the README's command on the example with friction, of some effects or all; runs lie beside them."""
    return identified_example(offered)


@pytest.mark.long
def test_a_written_study_has_the_zeros_of_the_angle_of_its_fit(friction_example: Path, condensed: Condensed) -> None:
    """A fit that misses weighs its cells otherwise than by their noise."""
    unit_folder = ROOT / "data/measured" / EXAMPLE
    problem = problem_of(unit_folder, condensed)
    fitter, data = Fitter(problem), problem.data
    weighted = data.sigma * (1 + (data.torque > 0.5 * data.torque.max()) * 9)
    fit = fitter.fit(Model(), np.ones(len(data), bool), fitter.start(Model()), 0)
    measurement = Measurement.read(load_measured_unit(unit_folder, ROOT))
    identification = SimpleNamespace(problem=problem, measurement=measurement)
    path = friction_example / f"corrected-{EXAMPLE}.toml"
    angles = [
        corrected_design.written_study(identification, path, SimpleNamespace(**{**vars(fit), "sigma": sigma})).angle
        for sigma in (data.sigma, weighted)
    ]
    for angle, sigma in zip(angles, (data.sigma, weighted), strict=True):
        left = (data.angle - angle) / sigma**2
        assert max(abs(np.sum(left[group])) for group in data.spans) < 1e-6 * np.sum(np.abs(left))
    assert np.max(np.abs(angles[1] - angles[0])) > 1e-4


@pytest.mark.long
def test_the_friction_that_was_put_in_is_named_with_its_size_and_written_into_the_design(folder: Path) -> None:
    verdict = json.loads((folder / "verdict.json").read_text())
    assert verdict["verdict"] == "identified"
    assert verdict["named"] == ["coulomb"]
    (parameter,) = verdict["parameters"]
    assert parameter["value"] == pytest.approx(FRICTION, rel=0.05)
    written_file = load_study(folder / f"corrected-{EXAMPLE}.toml", ROOT).design.effects
    assert written_file["coulomb"]["torque_Nm"] == pytest.approx(parameter["value"], rel=1e-5)


@pytest.mark.long
def test_the_folder_holds_what_the_contract_says(folder: Path) -> None:
    verdict = json.loads((folder / "verdict.json").read_text())
    for key in ("verdict", "named", "parameters", "sentence", "advice", "noise", "held_out_errors", "loop_errors"):
        assert key in verdict
    assert set(verdict["held_out_errors"]) == {"declared", "recalibrated", "after"}
    assert verdict["noise"]["floor_arcmin"] == pytest.approx(0.02, rel=0.6)
    assert verdict["loop_errors"]["hysteresis_loss_arcmin"]["why_not"]
    for table in (tables.RESIDUAL, tables.SIGNATURES, tables.CANDIDATES):
        schema = pq.read_schema(folder / f"{table.name}.parquet")
        assert schema.names == [column.name for column in table.columns]
        assert all(schema.field(name).metadata[b"meaning"] for name in schema.names)
    text = (folder / "report.html").read_text()
    assert verdict["verdict"] in text
    assert 'src="http' not in text
    n_early = 1635 - len(pd.read_parquet(folder / "residual.parquet"))  # rows of the file, each of them a cell
    assert f"{n_early} rows of the first branches, below 20 %" in text.replace("\u00a0", " ")
    assert len(list((folder / "figures").glob("*.png"))) == len(list((folder / "figures").glob("*.svg"))) == 4


@pytest.mark.long
def test_residuals_and_errors_are_those_of_the_table(folder: Path) -> None:
    verdict = json.loads((folder / "verdict.json").read_text())
    cells = pd.read_parquet(folder / "residual.parquet")
    assert cells["held_out"].all()
    for stage, error in verdict["held_out_errors"].items():
        residual = cells["angle_arcmin"] - cells[f"{stage}_arcmin"]
        np.testing.assert_allclose(cells[f"residual_{stage}_arcmin"], residual)
        assert error["rms_arcmin"] == pytest.approx(float(np.sqrt(np.average(residual**2, weights=cells["rows"]))))
        assert error["by_crank_deg"].keys() == {str(crank) for crank in CRANKS}
        for crank, rms in error["by_crank_deg"].items():
            of_crank = cells["crank_deg"] == float(crank)
            assert rms == pytest.approx(
                float(np.sqrt(np.average(residual[of_crank] ** 2, weights=cells["rows"][of_crank])))
            )
        assert error["max_arcmin"] == pytest.approx(float(residual.abs().max()))
    errors = {stage: error["rms_arcmin"] for stage, error in verdict["held_out_errors"].items()}
    assert errors["after"] < errors["recalibrated"]


@pytest.mark.long
def test_the_written_study_lies_on_the_data_as_the_page_says(folder: Path) -> None:
    """Its friction and numbers come from the files alone; at equal torque it leaves little more than the fits."""
    verdict = json.loads((folder / "verdict.json").read_text())
    cells = pd.read_parquet(folder / "residual.parquet")
    residuals = cells["angle_arcmin"] - cells["written_arcmin"]
    rms = np.sqrt(np.average(residuals**2, weights=cells["rows"]))
    assert verdict["written"]["study"] == f"corrected-{EXAMPLE}.toml"
    assert verdict["written"]["rms_arcmin"] == pytest.approx(rms, rel=1e-9)
    assert rms < 0.25 * verdict["held_out_errors"]["recalibrated"]["rms_arcmin"]
    assert f"leaves {rms:.4f} arcmin" in (folder / "report.html").read_text().replace("\u00a0", " ")


def test_a_unit_whose_nearest_effect_is_not_named_says_what_is_left_of_it() -> None:
    remainder = Remainder(3.0, 0.85, 22.0, 14.0, CurveScatter(18.0, 9.0, 40.0, 3), 2.0)
    baselines = {"replay": AngleError(25.0, 90.0, {}, 12.0, 1.0, 10), "line": AngleError(19.0, 90.0, {}, 9.0, 1.0, 10)}
    cards = remainder_cards(
        SimpleNamespace(
            remainder=remainder,
            baselines=baselines,
            verdict=Verdict("not explained by the library"),
            selection=SimpleNamespace(best_model="coulomb"),
        )
    )
    assert [card[1] for card in cards] == ["85%", "22.0", "14.0", "18.0", "19.0"]
    assert "noise floor of 2.00 arcmin" in cards[1][3]
    assert cards[-1][3] == "line"


@pytest.mark.parametrize(
    ("angles", "cranks", "words"),
    [
        ("unknown", [0.0, 60.0], "0° and 60°, which only distinguish positions: the angles are not known"),
        ("measured", [0.0, 60.0], "0° and 60°"),
        ("measured", [], "–"),  # of files that have none
    ],
)
def test_the_page_says_whether_crank_angles_are_known(angles: str, cranks: list[float], words: str) -> None:
    rows = MagicMock(cranks=np.array(cranks), files=["data.csv"])
    rows.__len__.return_value = 3
    unit = SimpleNamespace(settings=SimpleNamespace(crank_angles=angles))
    measurement = SimpleNamespace(rows=rows, unit=unit, known_cranks=len(cranks) if angles == "measured" else 0)
    assert dict(rows_facts(SimpleNamespace(measurement=measurement)))["Crank angles"] == words


@pytest.mark.parametrize(("refitted", "is_advised"), [(50.0, True), (190.0, False), (320.0, True), (None, False)])
def test_loops_of_another_width_than_the_refitted_model_send_to_the_play_first(
    refitted: float | None, is_advised: bool
) -> None:
    """The printed drive is 201 arcmin wide at no torque, refitted 50; an effect took the place of the play."""
    predicted = {} if refitted is None else {"declared": 37.0, "recalibrated": refitted}
    advice = play_advice({"zero_torque_width_arcmin": LoopError(201.0, predicted, 3)})
    assert ("201 arcmin wide at no torque" in advice) == is_advised
    assert bool(advice) == is_advised
    assert play_advice({"zero_torque_width_arcmin": LoopError(why_not="no loop")}) == ""


@pytest.mark.parametrize(
    ("locked", "moves", "range_arcmin", "turned", "is_warned"),
    [
        ("output", "fixed", 300.0, "65\u00b0", True),
        ("output", "fixed", 50.0, "10.8\u00b0", False),  # less than half a pitch of the pins
        ("output", "follows_angle", 300.0, "", False),
        ("input", "fixed", 300.0, "", False),
    ],
)
def test_the_page_says_that_the_model_holds_a_crank_which_the_data_let_turn(
    locked: str, moves: str, range_arcmin: float, turned: str, is_warned: bool
) -> None:
    """300 arcmin at the output are 65 degrees of the crank of 14 pins and 13 lobes."""
    settings = SimpleNamespace(locked=locked, crank=SimpleNamespace(moves=moves), model_fields_set={"locked"})
    cells = SimpleNamespace(angle_mean=np.array([0.0, range_arcmin, 1e4, 1e4 + 10]), position=np.array([0, 0, 1, 1]))
    unit = SimpleNamespace(study=load_study("printed_drive", ROOT), settings=settings)
    measurement = SimpleNamespace(unit=unit, cells=cells)
    sentence, advice = held_crank_sentence(SimpleNamespace(measurement=measurement)), crank_advice(measurement)
    assert ("states no [crank], so the crank is taken to stand still" in sentence) == bool(turned)
    assert (f"turned by up to {turned} within a position" in sentence) == bool(turned)
    assert ("of another crank angle" in sentence) == is_warned
    assert advice.startswith("State [crank] in unit.toml first") == is_warned == bool(advice)
    assert not is_warned or f"turned by up to {turned}" in advice


def test_the_page_does_not_miss_a_crank_that_the_unit_states(tmp_path: Path) -> None:
    copied = shutil.copytree(ROOT / "data" / "measured" / "base_pccf_runin", tmp_path / "u")
    text = (copied / "unit.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("ratio", "torque_at"))]
    text = "\n".join(lines).replace('moves = "follows_angle"', 'moves = "fixed"')
    (copied / "unit.toml").write_text(text, encoding="utf-8")
    settings = load_measured_unit(copied, ROOT).settings
    cells = SimpleNamespace(angle_mean=np.array([0.0, 300.0]), position=np.zeros(2, int))
    unit = SimpleNamespace(study=load_study("printed_drive", ROOT), settings=settings)
    sentence = held_crank_sentence(SimpleNamespace(measurement=SimpleNamespace(unit=unit, cells=cells)))
    assert "unit.toml says that the crank is fixed" in sentence


@pytest.mark.parametrize(("positions", "folds", "groups"), [(3, 3, ""), (6, 6, ""), (9, 3, "3 groups")])
def test_the_page_says_in_how_many_groups_positions_were_left_out(positions: int, folds: int, groups: str) -> None:
    position = np.repeat(np.arange(positions), 4)
    data = SimpleNamespace(held_out_parts=lambda cells: position)
    problem = SimpleNamespace(data=data, training=np.ones(len(position), bool))
    words = _groups(SimpleNamespace(problem=problem, folds=SimpleNamespace(models=("",) * folds)))
    assert (f"in {groups}" in words) if groups else words == "each predicted by a fit to the others"


def test_the_plan_says_in_how_many_groups_positions_are_left_out() -> None:
    assert parts_left_out(6, "crank positions", True) == "each of 6 crank positions is"
    assert parts_left_out(9, "crank positions", True) == "9 crank positions are left out in 6 groups, each"
    assert parts_left_out(9, "cycles", False) == "9 cycles are left out in 3 groups, each"


def test_page_and_tables_state_the_odds_that_a_name_takes() -> None:
    """They said 5 %."""
    odds = f"{math.exp(NAMED_ODDS):.0f} to 1"
    (column,) = (column for column in tables.CANDIDATES.columns if column.name == "significant")
    assert column.meaning.endswith(odds)
    page = (Path(facts.__file__).parent / "unit.html").read_text(encoding="utf-8")
    assert f"are {odds} against" in page
    assert f"a name takes {NAMED_ODDS:.1f}, {odds}" in page


@pytest.mark.parametrize(
    ("verdict", "odds", "words"),
    [
        (UNEXPLAINED, {}, ("exclude nothing", "named at any size", "in addition to")),
        (ADEQUATE, {"coulomb": NAMED_ODDS + 1}, ("noticed already", "in addition to")),
        (ADEQUATE, {"coulomb": NAMED_ODDS - 1}, ()),
    ],
)
def test_sizes_that_could_hide_are_no_bound_where_something_is_left(
    verdict: str, odds: dict[str, float], words: tuple[str, ...]
) -> None:
    identification = SimpleNamespace(verdict=Verdict(verdict), selection=SimpleNamespace(odds=odds))
    note = limits_note(identification)
    assert bool(note) == bool(words)
    assert all(part in " ".join(note or ()) for part in words)


def test_the_page_says_which_prediction_is_ahead() -> None:
    errors = {
        name: AngleError(floors, 2 * floors, {}, floors, 1.0, 10) for name, floors in (("replay", 4.0), ("line", 8.0))
    }
    for rms, words in ((5.0, "behind the best of them, replay, by a factor of 1.25"), (2.0, "ahead of the best")):
        identification = SimpleNamespace(baselines=errors, errors={"after": AngleError(rms, 9.0, {}, rms, 1.0, 10)})
        assert f"The model is {words}" in comparison_sentence(identification)


@pytest.mark.long
def test_every_effect_stands_in_the_candidates_with_numbers_or_a_reason(folder: Path, offered: tuple[str, ...]) -> None:
    rows = pd.read_parquet(folder / "candidates.parquet")
    assert set(offered) <= set(rows["effect"])
    tested = rows["log_odds"].notna() | (rows["parameters"].astype(str) != "")
    assert np.all(rows.loc[~tested, "why_not"].astype(str) != "")
    assert np.all(rows.loc[tested, "parameters"].astype(str).map(lambda text: bool(json.loads(text))))
    assert rows.set_index("effect").loc["thermal_growth", "why_not"] == "no temperature that varies"


def test_the_gain_of_an_effect_is_what_its_predictions_have_over_those_without_it() -> None:
    def tried(*predictive: float) -> SimpleNamespace:
        fit = SimpleNamespace(model=SimpleNamespace(split=lambda values: []), values=np.zeros(0))
        return SimpleNamespace(evidence=SimpleNamespace(predictive=np.array(predictive), value=0.0), rms=1.0, fit=fit)

    selection = SimpleNamespace(
        trials={"coulomb": tried(-1.0, -2.0)}, base=tried(-4.0, -3.0), promised_misfits={}, reasons={}, odds={}
    )
    verdict = SimpleNamespace(named_effects=())
    rows = tables.candidate_rows(SimpleNamespace(selection=selection, why_not={}, verdict=verdict))
    assert rows["log_score_gain"].tolist() == [4.0]


@pytest.mark.long
def test_the_corrected_study_runs_the_written_model(folder: Path) -> None:
    design = tomllib.loads((folder / "design.toml").read_text())
    study = load_study(folder / f"corrected-{EXAMPLE}.toml", ROOT)
    assert study.cycle.crank_deg == CRANKS
    assert study.design.effects == design.get("effects", {})
    verdict = json.loads((folder / "verdict.json").read_text())
    original = load_study("quick", ROOT).design
    for key, factor in verdict["calibrated"].items():
        section, name = key.split(".")
        section_before, section_after = (
            getattr(getattr(variant, section), name) for variant in (original, study.design)
        )
        assert section_after == pytest.approx(factor * section_before, rel=1e-5)
        assert EXAMPLE in study.design.provenance[key].reason
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settings, "RUNS", folder.parent.parent)
        path = folder / f"corrected-{EXAMPLE}.toml"
        assert cli.main(["run", "hysteresis", "--study", str(path), "--jobs", "1"]) == 0
    output = Output.open(folder.parent.parent / f"corrected-{EXAMPLE}" / "hysteresis")
    assert output is not None
    assert output.record["failed"] == 0


def test_data_without_a_verdict_leave_the_page_and_the_faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = measured(positions=(0.0,), cycles=1)
    table["angle_arcmin"] *= -1
    unit = write_unit(tmp_path / "turned", {"rows.csv": table})
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    assert cli.main(["identify", "--unit", str(unit)]) == 0
    folder = tmp_path / "runs" / "identify" / "turned"
    verdict = json.loads((folder / "verdict.json").read_text())
    assert verdict["verdict"] == "data fault"
    assert verdict["corrected"] == []
    assert any(fault["kind"] == "sign" for fault in verdict["data_faults"])
    assert "falls with rising torque" in (folder / "report.html").read_text()
    assert not (folder / "residual.parquet").exists()


def test_an_unknown_unit_is_answered_in_one_line(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["identify", "--unit", "base_pccf_run"]) == 2
    assert "base_pccf_runin" in capsys.readouterr().err


FITTED = {
    "title": "constant friction",
    "effect": "coulomb",
    "parameters": '{"coulomb": {"torque_Nm": 0.5}}',
    "misfit_before": 5.0,
    "misfit_after": 2.0,
    "log_odds": 1.0,
    "log_score_gain": 3.0,
    "significant": False,
    "member_of_class": False,
    "why_not": "",
}


@pytest.mark.parametrize(
    ("changes", "judgement"),
    [
        ({}, "no effect is not rejected"),
        ({"why_not": "coulomb: its interval reaches zero"}, "coulomb: its interval reaches zero"),
        ({"significant": True}, "less probable than what is named"),
        ({"significant": True, "effect": "coulomb+coulomb"}, "not clearly more probable than what is named"),
        ({"significant": True, "member_of_class": True}, "named"),
    ],
)
def test_judgement_of_a_fitted_effect(changes, judgement):
    assert candidate_row({**FITTED, **changes}, {})["judgement"] == judgement


def test_cells_at_one_torque_of_a_staircase_count_as_their_mean():
    """Two readings a step of a line of slope 2: between two cells of one torque there is no slope."""
    torque = np.repeat([1.0, 2.0, 3.0], 2)
    angle = 2 * torque + np.tile([-0.1, 0.1], 3)
    with np.errstate(all="raise"):
        np.testing.assert_allclose([angle_of_branch(torque, angle, level)[0] for level in (1.0, 1.5, 2.0)], [2, 3, 4])
        np.testing.assert_allclose(angle_of_branch(-torque, -angle, -1.5), [-3])
    assert np.isnan(angle_of_branch(torque, angle, 4.0)).all()
    assert np.isnan(angle_of_branch(torque[:4], angle[:4], 1.5)).all()

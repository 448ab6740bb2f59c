"""Loaded transmission error of a turning crank: read, judged, named from records that another simulator made."""

import html
import json
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from turning_unit import GEAR, HELD, INTERVALS, ROOT, Record, table, write_record

from pipeline.errors import InputError
from pipeline.identification.bench.course import slid_torque
from pipeline.identification.fitting import build
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.identify import identify
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import read_measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.results.write import findings, write
from pipeline.identification.selection import model_selection
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.load_history.friction.output_path import output_path
from pipeline.report.unit.page import write_page
from tests.validation.blind.catalogue import no_compliance

OFFERED = ("coulomb", "encoder_eccentricity", "ovality_2")


def read(folder, record, rows=None):
    return read_measurement(load_measured_unit(write_record(folder, record, rows), ROOT))


def answer(folder, record, offered=OFFERED, rows=None):
    """The identification of a record, over a few effects of the library."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_selection, "candidates", lambda: {name: candidates()[name] for name in offered})
        return identify(load_measured_unit(write_record(folder, record, rows), ROOT), no_compliance)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The measurement of a record with noise alone."""
    return read(tmp_path_factory.mktemp("plain") / "u", Record())


def test_turns_are_read_by_torque_sense_and_cycle(plain):
    assert [fault.kind for fault in plain.faults] == ["coarse intervals"]
    assert plain.fatal == ()
    np.testing.assert_allclose(plain.motion.levels, [-HELD, HELD])
    blocks = plain.branches
    assert len(blocks) == 8
    assert len(np.unique(np.column_stack([blocks.kind, blocks.cycle]), axis=0)) == 8
    np.testing.assert_array_equal(np.bincount(plain.cells.block), np.full(8, INTERVALS))
    np.testing.assert_allclose(plain.rows.cranks, 360 / INTERVALS * (np.arange(INTERVALS) + 0.5))


def test_the_output_slides_against_the_crank(plain):
    """The disk turns back by 1/lobes of the crank: forward its friction pushes towards positive angles."""
    first = plain.cells.direction[plain.cells.first_row == plain.cells.first_row.min()]
    assert plain.motion.sense[plain.cells.first_row.min()] == 1
    np.testing.assert_array_equal(first, [-1])


def test_a_cell_is_the_mean_of_its_rows_taken_to_the_middle(plain):
    rows = table(Record())
    chosen = rows[(rows["cycle"] == 1) & (rows["torque_Nm"] == HELD)].iloc[: 4 * INTERVALS]  # forward
    cells = (plain.cells.cycle == 1) & (plain.cells.direction < 0) & (plain.level == 1)
    means = chosen["angle_arcmin"].to_numpy().reshape(-1, 4).mean(axis=1)
    bent = np.roll(means, 1) - 2 * means + np.roll(means, -1)
    np.testing.assert_allclose(plain.cells.angle_mean[cells], means - bent / 24)


def test_waves_of_low_orders_keep_their_amplitude(tmp_path):
    """A wave that is 6.5 % smaller in the mean over 36 degrees: sin(x)/x at x = 36 degrees; 1 % is left of that."""
    rows = table(Record(per_pitch=2, torques=(HELD,), senses=(1,), cycles=2))
    wave = np.cos(2 * np.radians(rows["crank_deg"]) + 0.4)
    measurement = read(tmp_path / "u", Record(), rows.assign(angle_arcmin=wave))
    middles = np.cos(2 * np.radians(measurement.rows.cranks[measurement.cells.position]) + 0.4)
    np.testing.assert_allclose(measurement.cells.angle_mean, middles, atol=0.015)


def test_noise_of_repeated_turns_is_that_put_in(plain):
    """Four rows a cell: half of a row's noise; the transmission error itself is no noise."""
    repeats = plain.repeatability.repeats
    assert repeats.value == pytest.approx(0.02 / 2, rel=0.25)
    assert repeats.n == 4 * INTERVALS
    assert plain.repeatability.within_branch.value > 1.5 * repeats.value


def test_an_absolute_angle_is_that_of_the_output(tmp_path, plain):
    absolute = read(tmp_path / "u", Record(angle="absolute"))
    np.testing.assert_allclose(absolute.cells.angle_mean, plain.cells.angle_mean, atol=1e-9)


@pytest.mark.long
def test_a_crank_counted_from_zero_to_a_turn_is_counted_on(tmp_path):
    record = Record(cycles=1, turns=3, torques=(HELD,), senses=(1,), per_pitch=2)
    rows = table(record)
    counted = read(tmp_path / "a", record, rows)
    wrapped = read(tmp_path / "b", record, rows.assign(crank_deg=np.mod(rows["crank_deg"], 360)))
    np.testing.assert_allclose(wrapped.rows.cranks, counted.rows.cranks)
    np.testing.assert_allclose(wrapped.cells.angle_mean, counted.cells.angle_mean)
    assert counted.held_out_by == "revolution"


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (lambda rows: rows.assign(angle_arcmin=rows["angle_arcmin"] - 60 * rows["crank_deg"] / GEAR.lobes), "unit"),
        (lambda rows: rows.assign(torque_Nm=-rows["torque_Nm"]), "sign"),
        (lambda rows: rows.assign(crank_deg=30.0), "standing crank"),
        (lambda rows: rows.iloc[::5], "too few points"),
        (lambda rows: rows.assign(torque_Nm=HELD * np.cos(np.radians(rows["crank_deg"]))), "torque not held"),
    ],
)
def test_faults_of_a_record_are_told(tmp_path, change, kind):
    measurement = read(tmp_path / "u", Record(), change(table(Record())))
    assert kind in [fault.kind for fault in measurement.faults]
    assert measurement.fatal


def test_a_row_without_a_torque_is_told_by_that(tmp_path):
    rows = table(Record())
    rows.loc[7, "torque_Nm"] = np.nan
    messages = [fault.message for fault in read(tmp_path / "u", Record(), rows).faults if fault.kind == "not a number"]
    assert len(messages) == 1
    assert messages[0].startswith("torque_Nm is no number")


def test_a_record_without_its_crank_is_a_data_fault_with_a_page(tmp_path):
    folder = write_record(tmp_path / "u", Record(), table(Record()).drop(columns="crank_deg"))
    faulty = identify(load_measured_unit(folder, ROOT), no_compliance)
    written = write(faulty, tmp_path / "out")
    write_page(faulty, *written, tmp_path / "out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "verdict.json").read_text())["verdict"] == "data fault"
    assert "no column 'crank_deg'" in html.unescape((tmp_path / "out" / "report.html").read_text())


def test_a_plan_that_cannot_be_is_refused(tmp_path):
    plans = (
        ('crank_angles = "unknown"', "drawing's zero"),
        ('[held_out]\nby = "position"\ntrain = [1.0]', 'must be "cycle", "torque" or "sense"'),
    )
    for number, (text, reason) in enumerate(plans):
        with pytest.raises(InputError, match=reason):
            read(tmp_path / str(number), Record(settings=text))


def test_a_turning_crank_under_loops_is_told_how_to_be_read(tmp_path):
    folder = write_record(tmp_path / "u", Record())
    text = (folder / "unit.toml").read_text().replace('"neither"', '"input"')
    (folder / "unit.toml").write_text(text)
    (fault,) = (f for f in Measurement.read(load_measured_unit(folder, ROOT)).faults if f.kind == "turning crank")
    assert 'locked = "neither"' in fault.message


@pytest.fixture(scope="module")
def oval(tmp_path_factory):
    """Identification, verdict, page and residuals of a drive in a housing of two lobes."""
    home = tmp_path_factory.mktemp("oval")
    identification = answer(home / "u", Record(effects={"ovality_2": [6.0, 4.0]}), ("coulomb", "ovality_2"))
    findings_of_unit = findings(identification)
    written = write(findings_of_unit, home)
    write_page(findings_of_unit, *written, home, home)
    verdict = json.loads((home / "verdict.json").read_text())
    return identification, verdict, (home / "report.html").read_text(), pd.read_parquet(home / "residual.parquet")


@pytest.mark.long
def test_an_oval_housing_is_the_nearest_effect_with_its_amplitudes(oval):
    """Ten intervals leave orders above five, which the model folds back in full: nothing is named beside that."""
    identification, verdict, _, _ = oval
    assert (verdict["verdict"], verdict["named"]) == ("not explained by the library", [])
    selection = identification.selection
    assert selection.nearest_model == "ovality_2"
    assert selection.reasons["ovality_2"] == "replay of the training turns predicts unused data better"
    np.testing.assert_allclose(selection.answer.fit.values, (6.0, 4.0), rtol=0.15)
    before, after = selection.base.rms, selection.answer.rms
    assert after < 0.12 * before
    assert not identification.folds.in_sample


@pytest.mark.long
def test_what_needs_a_loop_is_not_testable_by_name(oval):
    _, verdict, _, _ = oval
    assert {"presliding", "rayleigh", "creep", "contact_friction", "motor_cogging"} <= set(verdict["not_testable"])
    assert "all pins slide on" in verdict["not_testable"]["contact_friction"]
    assert not {"coulomb", "ovality_2", "run_in", "output_torsion"} & set(verdict["not_testable"])


@pytest.mark.long
def test_orders_of_the_turn_are_those_of_the_rows(oval):
    """Order 2 by a sum over the middles of ten even intervals, mean over the senses and torques."""
    _, verdict, _, cells = oval
    turns = cells.groupby(["torque_Nm", "direction", "crank_deg"])["angle_arcmin"].mean()
    wave = turns * np.exp(-2j * np.radians(turns.index.get_level_values("crank_deg")))
    amplitudes = wave.groupby(level=["torque_Nm", "direction"]).mean().abs() * 2
    measured = verdict["loop_errors"]["order_2_arcmin"]["measured"]
    assert measured == pytest.approx(amplitudes.mean(), rel=1e-3)
    assert verdict["loop_errors"]["order_2_arcmin"]["recalibrated"]["value"] < 0.5 * measured
    assert verdict["loop_errors"]["lost_motion_arcmin"]["why_not"] == "a crank that turns draws no loop"


@pytest.mark.long
def test_sentence_and_page_say_what_the_residuals_hold(oval):
    _, verdict, page, cells = oval
    for stage in ("recalibrated", "after"):
        residual = cells[f"residual_{stage}_arcmin"]
        rms = np.sqrt(np.average(residual**2, weights=cells["rows"]))
        assert verdict["held_out_errors"][stage]["rms_arcmin"] == pytest.approx(rms)
        assert f"{rms:.3g} arcmin" in verdict["sentence"]
    text = html.unescape(re.sub(r"<[^>]*>", "", page))
    assert verdict["sentence"].replace(" arcmin", "\u00a0arcmin") in text
    assert "10 intervals of 36.0°" in text
    assert "all that slides has slid" in text
    assert verdict["corrected"] == ["design.toml", "corrected-u.toml"]


@pytest.mark.parametrize(
    ("record", "verdict", "named"),
    [
        (Record(), "adequate", ()),
        (Record(outside=lambda crank: 0.3 * np.cos(4 * crank + 0.3)), "not explained by the library", ()),
        (Record(encoder=(0.5, 0.3), turns=2, cycles=1), "identified", ("encoder_eccentricity",)),
        pytest.param(Record(friction=1.5), "identified", ("coulomb",), marks=pytest.mark.attack),
    ],
    ids=["nothing", "ripple outside", "encoder", "friction"],
)
@pytest.mark.long
def test_verdicts_of_records_of_known_cause(tmp_path, record, verdict, named):
    offered = (*named, "coulomb") if named else ("coulomb", "ovality_2")
    identification = answer(tmp_path / "u", record, offered)
    assert (identification.verdict.verdict, identification.verdict.named_effects) == (verdict, named)
    truth = {"coulomb": [record.friction], "encoder_eccentricity": record.encoder} | record.effects
    for parameter, value in zip(identification.verdict.parameters, truth.get("".join(named), ()), strict=True):
        assert parameter.ci_low < value < parameter.ci_high


def test_repeats_of_one_cycle_are_left_out_in_turn(tmp_path, plain):
    measurement = read(tmp_path / "u", Record(), table(Record()).assign(cycle=4))
    assert measurement.held_out_by == "repeat"
    np.testing.assert_array_equal(measurement.parts, plain.cells.cycle)
    assert measurement.repeatability.repeats == plain.repeatability.repeats


def test_temperature_is_that_of_a_turn_at_all_intervals_of_the_crank(tmp_path):
    """It rises by 10 K over the record, and goes up and down within each turn: an interval has no drive of its own."""
    rows = table(Record())
    warming = np.linspace(20.0, 30.0, len(rows)) + 3.0 * np.sin(np.radians(rows["crank_deg"]))
    states, conditions = build._states(read(tmp_path / "u", Record(), rows.assign(temperature_C=warming)))
    assert all(np.array_equal(np.unique(state), [0, 1]) for state in states)
    assert np.ptp([condition.temperature_rise for condition in conditions], axis=0).max() == 0.0
    assert conditions[0].temperature_rise[1] > conditions[0].temperature_rise[0] + 1.0


@pytest.mark.long
def test_fewer_than_eight_turns_claim_nothing(tmp_path):
    identification = answer(tmp_path / "u", Record(cycles=1, effects={"ovality_2": [6.0, 4.0]}), ("ovality_2",))
    assert len(np.unique(identification.problem.data.block)) == 4
    assert identification.verdict.named_effects == ()
    assert identification.selection.members == ()


@pytest.mark.long
def test_one_turn_is_described_in_sample(tmp_path):
    identification = answer(tmp_path / "u", Record(cycles=1, torques=(HELD,), senses=(1,)))
    findings_of_unit = findings(identification)
    written = write(findings_of_unit, tmp_path / "out")
    write_page(findings_of_unit, *written, tmp_path / "out", tmp_path / "out")
    assert identification.folds.in_sample
    assert "One turn, fitted in sample" in identification.statement.sentence
    assert identification.verdict.named_effects == ()
    assert identification.why_not["coulomb"] == "the crank turns in one sense alone"
    assert identification.why_not["output_torsion"] == "a single torque is held"
    assert identification.why_not["encoder_eccentricity"] == "the angle of a position has no range"


@pytest.mark.long
def test_held_out_torques_change_nothing_that_is_fitted(tmp_path):
    """One of three torques is kept back; its angles stretched by 1.4 leave noise and fit as they are."""
    settings = f'[held_out]\nby = "torque"\ntrain = [{-HELD}, {HELD}]'
    record = Record(torques=(-HELD, 0.5 * HELD, HELD), settings=settings, cycles=1)
    rows = table(record)
    held_out = rows["torque_Nm"] == 0.5 * HELD
    stretched = rows.assign(angle_arcmin=np.where(held_out, 1.4, 1.0) * rows["angle_arcmin"])
    plain, changed = (
        answer(tmp_path / name, record, ("coulomb",), part) for name, part in (("a", rows), ("b", stretched))
    )
    np.testing.assert_array_equal(plain.selection.base.fit.unknowns.flat, changed.selection.base.fit.unknowns.flat)
    assert plain.problem.data.noise == changed.problem.data.noise
    cells = plain.folds.cells
    np.testing.assert_array_equal(cells, plain.measurement.level == 1)
    assert plain.errors["recalibrated"].rms_arcmin < changed.errors["recalibrated"].rms_arcmin


@pytest.mark.parametrize("sense", [1, -1])
def test_a_slid_output_carries_what_a_long_way_leaves_it(sense):
    """Constant friction of 2 and a share of 0.1: the path of a loop between +-50, far from where it turned."""
    zeros, friction, share = np.zeros((2, 1)), np.array([2.0, 0.0]), np.array([0.0, 0.1])
    sliders = Sliders(zeros, np.full(2, 1e6), friction, share, np.array([-1, -1]))
    nodes = np.linspace(-60.0, 60.0, 13)
    path = output_path(sense * np.array([0.0, -50.0, 50.0]), nodes, 1e-3 * nodes, sliders)
    leg = slice(*(path.turns[1:] + [0, 1]))
    order = np.argsort(path.corners[0, leg])
    torque = np.linspace(-30, 30, 13)
    followed = np.interp(torque, path.corners[0, leg][order], path.corners[2, leg][order])
    carried, slope = slid_torque(torque[:, None], np.full(13, sense), sliders)
    np.testing.assert_allclose(carried[:, 0], followed, atol=1e-3)
    np.testing.assert_allclose(torque, carried[:, 0] + sense * (2 + 0.1 * np.abs(carried[:, 0])))
    assert slope[torque > 2.5] == pytest.approx(1 / (1 + 0.1 * sense))


def test_turns_of_the_crank_are_counted_from_its_angle():
    cells = SimpleNamespace(crank=np.array([0.0, 359.0, 361.0, 725.0]))
    assert TurningData.revolution.fget(cells).tolist() == [0, 0, 1, 2]

"""Several states of one drive: on generated series, moved by their angle, whose truth is known."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, write_unit
from scipy import stats

import pipeline
from pipeline import settings
from pipeline.errors import InputError
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_units
from pipeline.identification.selection.statements.verdict import EQUIVALENT, IDENTIFIED, UNEXPLAINED
from pipeline.identification.series import shared_effects
from pipeline.identification.series.answer import (
    NOT_SHARED,
    effect_sizes,
    identify_measurements,
    state_errors,
    trend_sentence,
    trend_words,
)
from pipeline.identification.series.folds import Folds
from pipeline.identification.series.states import Trend, _p_of_states, series_of, trends_of

TEXT = """
title = "A state"
locked = "output"
offset = "per_position"
[generic]
ratio = 13.0
rated_torque_Nm = 20.0
[crank]
moves = "follows_angle"
ratio = -13.0
torque_at = "input"
[state]
values = {{grease_g = 2.0, turns = {turns}}}
"""
TURNED = 2 * np.pi * 13 / 21600
"""Crank angle by the reading [rad/arcmin]."""
TOP, ROWS = 20.0, 16


def followed(
    friction: float, play: float, runout: complex, crank: float, rows: int = ROWS
) -> tuple[np.ndarray, np.ndarray]:
    """Torque at the motor and angle of two cycles, driven by the angle: friction is the difference of the two senses.

    T_motor = T(a - te) (1 - te'), with the spring at rest within the play.
    """

    def torque(angle):
        phi = crank + TURNED * angle
        error = (runout * np.exp(-1j * phi)).real
        slope = TURNED * (runout * -1j * np.exp(-1j * phi)).real
        strain = angle - error
        spring = np.sign(strain) * np.maximum(np.abs(strain) - play / 2, 0.0) / 5.0
        return spring * (1 - slope) + 0.02 * strain  # a little stiffness within the play keeps the torque monotone

    def reached(level, start, sense):
        grid = start + sense * np.linspace(0.0, 600.0, 12_001)
        past = sense * (torque(grid) + sense * friction) >= TOP - 1e-12 if level else np.zeros(len(grid), bool)
        return grid[: np.argmax(past) + 1]

    torques, angles, place = [np.zeros(1)], [np.zeros(1)], 0.0
    for sense in (1, -1, 1, -1, 1):
        path = reached(True, place, sense)
        load = torque(path) + sense * friction
        levels = np.linspace(load[0], load[-1], rows)
        order = np.argsort(load) if sense > 0 else np.argsort(-load)
        points = np.interp(sense * levels, sense * load[order], path[order])
        stuck = np.linspace(torques[-1][-1], load[0], 6)[1:-1]
        torques += [stuck, levels]
        angles += [np.full(len(stuck), path[0]), points]
        place = float(path[-1])
    return np.concatenate(torques), np.concatenate(angles)


def write_series(
    folder: Path, frictions, plays, runout: complex = 0.0, cranks=(20.0, 110.0, 200.0, 290.0), seed=1, rows=ROWS
):
    """A state for each friction and play, with 2 % of scatter by mounting and 0.3 arcmin of noise."""
    rng = np.random.default_rng(seed)
    for number, (friction, play) in enumerate(zip(frictions, plays, strict=True)):
        parts = []
        for crank in cranks:
            mounted = 1 + 0.02 * rng.standard_normal(2)
            torque, angle = followed(friction * mounted[0], play * mounted[1], runout, np.radians(crank), rows)
            angle = angle + 0.3 * rng.standard_normal(len(angle))
            cycle = np.repeat([0, 1], [len(torque) // 2, len(torque) - len(torque) // 2])
            columns = {"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}
            parts.append(pd.DataFrame(columns))
        write_unit(folder / f"state{number}", {"rows.csv": pd.concat(parts)}, TEXT.format(turns=float(number)))
    return [Measurement.read(unit) for unit in load_measured_units(folder, ROOT)]


RUNOUT = 20.0 + 15.0j
EIGHT_CRANKS = tuple(np.arange(20.0, 360.0, 45.0))


EFFECTS = shared_effects.CRANK_EFFECTS


@pytest.fixture(scope="module", autouse=True)
def few_effects():
    """One effect in place of eight: each costs a fit of every fold."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shared_effects, "SOFT", {})
        patch.setattr(shared_effects, "CRANK_EFFECTS", {"pin_circle_runout": EFFECTS["pin_circle_runout"]})
        yield


@pytest.fixture(scope="module")
def answer(few_effects, tmp_path_factory):
    """Two states that share a run-out, beside which another effect is tried; friction differs."""
    with pytest.MonkeyPatch.context() as patch:
        names = ("pin_circle_runout", "compliance_once")
        patch.setattr(shared_effects, "CRANK_EFFECTS", {name: EFFECTS[name] for name in names})
        return identify_measurements(
            write_series(tmp_path_factory.mktemp("drive"), [1.0, 1.7], [40.0, 40.0], RUNOUT)
        )


@pytest.mark.long
def test_a_runout_that_all_states_share_is_found_with_its_size_and_states_keep_their_own(answer):
    assert answer.verdict in (IDENTIFIED, EQUIVALENT)
    best = answer.effects.classes[0][0]
    assert best.name == "pin_circle_runout"
    value, low, high, unit = effect_sizes(best)["amplitude"]
    assert unit == "arcmin"
    assert value == pytest.approx(abs(RUNOUT), rel=0.2)
    assert low < value < high
    errors = {name: np.sqrt(np.nanmean(loss)) for name, loss in answer.errors.items()}
    assert errors["after"] < 0.5 * errors["refitted"] < errors["before"]
    friction = [values["friction_Nm"] for values in answer.effects.final_folds.final.values]
    np.testing.assert_allclose(friction, [1.0, 1.7], rtol=0.2)  # the play has a hard stop, the model a knee


@pytest.mark.long
def test_without_a_shared_effect_none_is_claimed_and_no_trend(tmp_path):
    answer = identify_measurements(write_series(tmp_path, [1.0] * 3, [40.0] * 3, 0.0, (20.0, 140.0, 260.0), seed=5))
    assert answer.verdict == NOT_SHARED
    assert "No effect that all states share is shown" in answer.sentence
    assert not any(trend.is_shown for trend in answer.trends)


@pytest.mark.long
def test_of_few_positions_the_other_states_show_the_class_with_its_size_and_control(tmp_path):
    """Three positions in each of three states: folds over positions train on two, the other states hold the wave."""
    answer = identify_measurements(
        write_series(tmp_path, [1.0, 1.3, 1.8], [40.0] * 3, RUNOUT, (20.0, 140.0, 260.0), seed=3)
    )
    (members,) = answer.effects.classes
    assert members[0].name == "pin_circle_runout"
    assert members[0].left_out == "states"
    value, low, high, _ = effect_sizes(members[0])["amplitude"]
    assert value == pytest.approx(abs(RUNOUT), rel=0.2)
    assert low < value < high
    assert members[0].folds.rms() < 0.3 * answer.effects.folds_without.rms() < 0.3 * members[0].control
    assert np.all(np.isfinite(members[0].folds.loss).sum(axis=1) == 1)  # a unit trains on two of three by default
    assert "with its sign reversed" in answer.sentence


@pytest.mark.long
def test_one_state_of_eight_positions_shows_the_runout_with_its_control_and_a_page(tmp_path, monkeypatch):
    write_series(tmp_path / "drive", [1.0], [40.0], RUNOUT, EIGHT_CRANKS, seed=4)
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    answer = pipeline.identify(tmp_path / "drive" / "state0")
    (members,) = answer.result.effects.classes
    assert members[0].name == "pin_circle_runout"
    value, low, high, _ = effect_sizes(members[0])["amplitude"]
    assert low < value < high
    assert value == pytest.approx(abs(RUNOUT), rel=0.2)  # of a model with a rounded play, as in the tests above
    errors = {name: np.sqrt(np.nanmean(loss)) for name, loss in answer.result.errors.items()}
    assert 2 * errors["after"] < errors["refitted"] < members[0].control
    assert f"{members[0].control:.3g} with its sign reversed" in answer.sentences[0]
    cells = pd.read_parquet(answer.report.parent / "cells.parquet")
    position_means = (cells["residual_after_arcmin"] ** 2).groupby(cells["position"], observed=True).mean()
    assert np.sqrt(position_means.mean()) == pytest.approx(errors["after"], rel=0.2)
    assert "Residual over the crank angle" in answer.report.read_text()


def test_one_state_without_an_effect_names_none(tmp_path):
    answer = identify_measurements(write_series(tmp_path, [1.0], [40.0], 0.0, EIGHT_CRANKS, seed=6))
    assert answer.verdict == UNEXPLAINED
    assert "No effect of the crank angle" in answer.sentence


@pytest.mark.long
def test_two_positions_claim_no_shared_effect(tmp_path):
    answer = identify_measurements(write_series(tmp_path, [1.0, 1.5], [40.0] * 2, 0.0, (20.0, 110.0)))
    assert not answer.effects.classes
    assert all("too few" in effect.note for effect in answer.effects.tried_effects)


def test_a_slope_that_states_mounted_anew_may_have_is_judged_by_their_scatter_about_a_line():
    """Student's p of a line; 69 % of such series had a trend at 1 % by the scatter over the positions alone."""
    values, rng = np.array([0.0, 1.0, 2.0, 4.0, 7.0]), np.random.default_rng(2)
    levels = rng.standard_normal((5, 400))
    p = _p_of_states(values - values.mean(), levels)
    assert p[0] == pytest.approx(stats.linregress(values, levels[:, 0]).pvalue)
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.isnan(_p_of_states(np.array([-0.5, 0.5]), levels[:2])).all()


@pytest.mark.parametrize(("p_states", "is_told"), [(0.01, False), (0.2, True), (np.nan, True)])
def test_a_trend_that_is_not_beyond_the_scatter_of_the_states_is_told_so(p_states, is_told):
    number = SimpleNamespace(
        kind=SimpleNamespace(positive=True, grows="friction grows", falls="friction falls"),
        size=SimpleNamespace(label="10 N m"),
    )
    trend = Trend(
        number=number,
        levels=np.zeros(4),
        low=np.zeros(4),
        high=np.zeros(4),
        slope=0.3,
        slope_low=0.2,
        slope_high=0.4,
        p=1e-4,
        p_family=1e-3,
        p_states=p_states,
        p_differ=0.01,
        p_bent=0.5,
    )
    assert ("states mounted anew may differ as much" in trend_words(trend, "turns")) == is_told


def test_play_that_closes_over_the_variable_is_a_trend(tmp_path):
    measurements = write_series(tmp_path, [1.0] * 4, [60.0, 48.0, 38.0, 30.0], rows=60)
    series = series_of(measurements)
    assert series.variable == "turns"
    trends = {trend.number.kind.name: trend for trend in trends_of(series)[0]}
    assert trends["play"].is_shown
    assert trends["play"].slope == pytest.approx(0.5 ** (1 / 3) - 1, abs=0.04)
    assert trends["play"].p_differ < 0.01
    assert not trends["compliance"].is_shown


@pytest.mark.long
def test_what_the_distance_of_the_torques_makes_is_no_trend_and_what_is_real_is(tmp_path):
    """Of few torques play and stiffness move with the friction, alike at all positions: without scatter, and wrong."""
    frictions = [1.0, 1.3, 1.7, 2.5]
    for rows, shown in ((ROWS, set()), (40, {"friction"})):
        series = series_of(write_series(tmp_path / str(rows), frictions, [40.0] * 4, rows=rows))
        trends, table = trends_of(series)
        assert {trend.number.kind.name for trend in trends if trend.is_shown} == shown
        sentence = trend_sentence("turns", trends)
        assert ("measure at more torques about zero" in sentence) == (not shown)
        assert ("friction grows by +" in sentence and "for each 1 of turns" in sentence) == bool(shown)
    (trend,) = (trend for trend in trends if trend.number.kind.name == "friction")
    assert trend.slope == pytest.approx(2.5 ** (1 / 3) - 1, rel=0.1)
    by_scatter_alone = table.layout.contrast([-1.0, 0.0, 0.0, 1.0]).family.p
    assert table.numbers[-1].kind.name == "torque_zero"
    assert by_scatter_alone[-1] < 1e-3


def test_a_variable_that_a_state_lacks_is_asked_for_by_name(tmp_path):
    measurements = write_series(tmp_path, [1.0] * 2, [40.0] * 2)
    with pytest.raises(InputError, match="state0, state1: no 'cycles'; add values"):
        series_of(measurements, "cycles")
    with pytest.raises(InputError, match="2 or more states"):
        pipeline.identify_series(tmp_path / "state0")


def test_the_library_function_writes_a_page_that_says_what_the_verdict_says(tmp_path, monkeypatch):
    write_series(tmp_path / "drive", [1.0, 1.4], [40.0] * 2, 0.0, (20.0, 140.0, 260.0))
    monkeypatch.setattr(settings, "RUNS", tmp_path / "runs")
    answer = pipeline.identify_series(tmp_path / "drive")
    folder = tmp_path / "runs" / "series" / "drive"
    verdict = json.loads((folder / "verdict.json").read_text())
    page = (folder / "report.html").read_text().replace("\u00a0", " ")
    assert verdict["states"] == ["state0", "state1"]
    assert answer.report == folder / "report.html"
    assert answer.sentences[0].startswith(verdict["verdict"])
    assert verdict["trends"].split(" ")[0] in page
    errors = pd.read_parquet(folder / "errors.parquet")
    assert len(errors) == 6
    mean = np.sqrt((errors["refitted_arcmin"] ** 2).mean())
    assert verdict["errors_arcmin"]["refitted"] == pytest.approx(mean, rel=1e-9)
    states = pd.read_parquet(folder / "states.parquet")
    assert set(states["source"]) == {"loops", "fit"}


@pytest.mark.long
def test_errors_of_states_have_intervals_over_positions(answer):
    for _, errors in state_errors(answer):
        value, low, high = errors["refitted"]
        assert low < value < high


def test_a_class_has_the_twins_that_help_as_much_and_no_other_effect():
    """Twins of the best with the same loss, of which one is not significant by itself, one is worse, one is no twin."""
    noise = 1 + 0.05 * np.random.default_rng(3).standard_normal((2, 9))
    loss = {"pin_circle_runout": 1.0, "encoder_once": 1.001, "flank_runout": 4.5, "play_once": 2.5, "asymmetry": 1.1}
    notes = {"encoder_once": shared_effects.NO_GAIN, "flank_runout": shared_effects.NO_GAIN}
    tried = [
        shared_effects.TriedEffect(
            name=name,
            companions=(),
            folds=Folds((), (), None, size * noise**k),
            p=0.01,
            p_left_out=0.01,
            note=notes.get(name, ""),
        )
        for k, (name, size) in enumerate(loss.items())
    ]
    members = shared_effects.class_of(tried, Folds((), (), None, 4.0 * noise))
    assert [effect.name for effect in members] == ["pin_circle_runout", "encoder_once"]
    assert shared_effects.class_of(tried[1:3], Folds((), (), None, 4.0 * noise)) == ()


@pytest.mark.parametrize("pause", [0.0, 40.0])
def test_creep_is_tried_where_the_torque_dwells(tmp_path, pause):
    """Rows at a constant rate of the torque, but for a pause in the middle of each position."""
    write_series(tmp_path, [1.0, 1.3], [40.0, 40.0], 0.0, (20.0, 110.0), rows=40)
    for path in tmp_path.glob("*/rows.csv"):
        rows = pd.read_csv(path)
        travel = rows.groupby("crank_deg")["torque_Nm"].transform(lambda torque: torque.diff().abs().cumsum().fillna(0))
        half = rows.groupby("crank_deg").cumcount() > len(rows) / 4
        rows.assign(time_s=travel + pause * half).to_csv(path, index=False)
    series = series_of([Measurement.read(unit) for unit in load_measured_units(tmp_path, ROOT)])
    testable, untestable = shared_effects.candidates(series)
    assert ("creep" in testable) == (pause > 0)
    assert ("creep" in untestable) == (pause == 0)
    loops = series.loops[0]
    assert all(np.all(np.diff(loops.time[loops.position == p].ravel()) >= 0) for p in (0, 1))

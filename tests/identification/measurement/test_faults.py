"""Each fault of the data is found, with its rows; sound data have none."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from measured_bench import ROOT, UNIT, loop, measured, path_of, write_unit

from pipeline.errors import InputError
from pipeline.identification.bench.instrument_effects import instrument_effects
from pipeline.identification.measurement.faults.data_faults import _turning_crank
from pipeline.identification.measurement.faults.fault import Fault, linear_algebra_faults
from pipeline.identification.measurement.faults.shape_faults import DELAYED_SHARE, gains_energy
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.statements.statement import fault_statement


def judged(folder, tables, text=UNIT):
    unit = load_measured_unit(write_unit(folder / "u", tables, text), ROOT)
    measurement = Measurement.read(unit)
    return {
        fault.kind: fault for fault in reversed(measurement.faults)
    }, measurement.usable  # the first of a kind stays


def without_torque(table):
    """Rows at no torque: the first of each position, and every hold of one row or two."""
    return np.abs(table["torque_Nm"].to_numpy()) < 1e-9


def test_sound_data_have_no_fault(tmp_path):
    table = measured().assign(time_s=lambda t: np.arange(len(t)) // 7 * 0.016)
    faults, usable = judged(tmp_path, {"rows.csv": table})
    assert faults == {}
    np.testing.assert_array_equal(~usable, without_torque(table))


def edited(change):
    table = measured()
    change(table)
    return table


def set_at(column, rows, value):
    def change(table):
        table[column] = table[column].astype(float)
        table.loc[rows, column] = value

    return change


def reverse_time(table):
    table["time_s"] = np.arange(len(table)) * 0.01
    table.loc[50, "time_s"] = 0.1


def interleave(table):
    table.loc[100:120, "cycle"] = 1


CASES = {
    "missing column": (lambda t: t.pop("angle_arcmin"), "fatal", ()),
    "not a number": (set_at("torque_Nm", [7], np.inf), "note", ("rows.csv:9",)),
    "decreasing time": (reverse_time, "fatal", ("rows.csv:52",)),
    "disordered rows": (interleave, "fatal", ("rows.csv:123", "rows.csv:243")),
    "constant column": (set_at("torque_Nm", slice(None), 3.0), "fatal", tuple(f"rows.csv:{i}" for i in range(2, 7))),
    "encoder jump": (
        lambda t: t.__setitem__("angle_arcmin", t["angle_arcmin"] + 40.0 * (t.index == 99)),
        "note",
        ("rows.csv:101",),
    ),
    "sign": (lambda t: t.__setitem__("angle_arcmin", -t["angle_arcmin"]), "fatal", ()),
    "mixed offsets": (
        lambda t: t.__setitem__(
            "angle_arcmin", t["angle_arcmin"] + 50.0 * ((t["cycle"] == 2) & (t["crank_deg"] == 90))
        ),
        "fatal",
        tuple(f"rows.csv:{i}" for i in range(1208, 1213)),
    ),
}


@pytest.mark.parametrize("kind", CASES)
def test_a_fault_is_found_with_its_rows(tmp_path, kind):
    change, severity, rows = CASES[kind]
    faults, _ = judged(tmp_path, {"rows.csv": edited(change)})
    assert faults[kind].severity == severity
    assert faults[kind].rows == rows


def test_rows_that_are_left_out(tmp_path):
    table = edited(set_at("angle_arcmin", [7, 300], np.nan))
    _, usable = judged(tmp_path, {"rows.csv": table})
    assert np.flatnonzero(~usable & ~without_torque(table)).tolist() == [7, 300]


def test_many_values_that_are_no_numbers_are_fatal(tmp_path):
    faults, _ = judged(tmp_path, {"rows.csv": edited(set_at("angle_arcmin", range(0, 2000, 20), np.nan))})
    assert faults["not a number"].severity == "fatal"
    assert faults["not a number"].count == 100


def test_a_cycle_that_is_no_whole_number(tmp_path):
    faults, _ = judged(tmp_path, {"rows.csv": edited(set_at("cycle", [5], 0.5))})
    assert "whole number" in faults["not a number"].message


@pytest.mark.parametrize(
    ("column", "factor", "unit"),
    [("torque_Nm", 1000.0, '"N mm"'), ("angle_arcmin", 1 / 21600, '"rev"'), ("angle_arcmin", 1 / 3437.7, '"rad"')],
)
def test_an_implausible_unit_names_the_unit_that_would_fit(tmp_path, column, factor, unit):
    faults, _ = judged(tmp_path, {"rows.csv": measured().assign(**{column: lambda t: t[column] * factor})})
    assert faults["unit"].severity == "fatal"
    assert unit in faults["unit"].message


def test_a_file_that_repeats_another_is_a_fault(tmp_path):
    item = measured((0.0,)).drop(columns="crank_deg")
    text = UNIT + '[[files]]\npath="a.csv"\ncrank_deg=0.0\n[[files]]\npath="b.csv"\ncrank_deg=90.0\n'
    faults, _ = judged(tmp_path, {"a.csv": item, "b.csv": item}, text)
    assert faults["duplicate file"].message.startswith("b.csv repeats a.csv")
    assert faults["duplicate file"].count == len(item)


def clipped(with_command, level=8.0):
    """Cycles whose torque goes no further than `level`, with noise before the limit."""
    rng = np.random.default_rng(3)
    torque = np.concatenate([path_of([0, 12, -12, 0], 100)] * 3)
    table = pd.DataFrame({"cycle": np.repeat([0, 1, 2], 301), "crank_deg": 0.0, "angle_arcmin": loop(torque)})
    table["torque_Nm"] = np.clip(torque + 0.05 * rng.standard_normal(torque.size), -level, level)
    if with_command:
        table["command_torque_Nm"] = torque
    return table, np.abs(torque) >= level


@pytest.mark.parametrize("with_command", [False, True])
def test_saturated_rows_are_left_out(tmp_path, with_command):
    table, truth = clipped(with_command)
    faults, usable = judged(tmp_path, {"rows.csv": table})
    assert faults["saturation"].severity == "note"
    assert np.mean(~usable == truth) > 0.98
    assert not usable[truth].any() or usable[truth].mean() < 0.02


def test_a_declared_saturation_cuts_there(tmp_path):
    text = UNIT + "[instrument]\ntorque_saturation_Nm = 10.0\n"
    table = measured()
    faults, usable = judged(tmp_path, {"rows.csv": table}, text)
    is_beyond = table["torque_Nm"].abs().to_numpy() >= 10
    np.testing.assert_array_equal(~usable, is_beyond | without_torque(table))
    assert faults["saturation"].count == is_beyond.sum()


def test_a_hold_at_the_peak_is_no_saturation(tmp_path):
    torque = np.concatenate([path_of([0, 12], 80), np.full(40, 12.0), path_of([12, -12, 0], 80)[1:]])
    table = pd.DataFrame({"cycle": 0, "crank_deg": 0.0, "torque_Nm": torque, "angle_arcmin": loop(torque)})
    for column in ("extra", "command_torque_Nm"):
        faults, _ = judged(tmp_path / column, {"rows.csv": table.assign(**{column: torque})})
        assert "saturation" not in faults


def test_missing_cycles_one_sense_and_too_few_points(tmp_path):
    table = measured((0.0,), 4)
    faults, _ = judged(tmp_path / "gap", {"rows.csv": table[table["cycle"] != 2]})
    assert "cycle 2" in faults["missing cycle"].message
    faults, _ = judged(tmp_path / "half", {"rows.csv": table[(table["cycle"] != 3) | (table["torque_Nm"] > 0)]})
    assert "cycle 3" in faults["one sense"].message
    faults, _ = judged(tmp_path / "few", {"rows.csv": table[table["cycle"] == 0]})
    assert faults["too few points"].severity == "note"
    assert "no effect can be accepted" in faults["too few points"].message
    unit = load_measured_unit(write_unit(tmp_path / "v", {"rows.csv": measured((0.0,), 1, per_branch=3)}), ROOT)
    small_case = [fault for fault in Measurement.read(unit).faults if fault.kind == "too few points"]
    assert [fault.severity for fault in small_case] == ["note", "fatal"]
    assert small_case[0].rows == tuple(f"rows.csv:{line}" for line in range(2, 7))
    assert small_case[0].count == 10


def test_data_that_do_not_tell_their_noise_support_no_verdict(tmp_path):
    """Four loops of some fifteen rows, none repeated: errors would be counted in steps of the file's last digit."""
    few = measured((0.0, 90.0, 180.0, 270.0), 1, per_branch=7)
    faults, _ = judged(tmp_path / "few", {"rows.csv": few})
    fault = faults["too few points"]
    assert fault.severity == "fatal"
    assert "no branch has the 9 rows that its scatter takes" in fault.message
    faults, _ = judged(tmp_path / "more", {"rows.csv": measured((0.0, 90.0, 180.0, 270.0), 1, per_branch=12)})
    assert all(fault.severity == "note" for fault in faults.values())


def gains(torque, angle, cycle=None):
    """Of rows that are one cycle unless their cycles are said."""
    return gains_energy(torque, angle, np.zeros(len(torque), int) if cycle is None else cycle)


def test_exchanged_columns_are_found_where_no_row_is_near_zero():
    """The angle jumps through the play: once it is taken for the torque, one row alone is near zero, by its noise."""
    torque = np.tile(np.concatenate([np.linspace(a, b, 41)[1:] for a, b in ((0, 12), (12, -12), (-12, 0))]), 2)
    net = torque - 0.5 * np.sign(np.gradient(torque))
    angle = net / 5 + 0.5 * np.tanh(2 * net)
    angle[np.abs(angle) < 0.2] = 0.3
    assert not gains(torque, angle)
    assert gains(angle, torque)


def read_late(torque, share):
    """The torque (n,) that a creeping sensor reads in evenly timed rows: a share of it comes later, over 20 rows."""
    late = np.zeros(len(torque))
    for k in range(1, len(torque)):
        late[k] = late[k - 1] + (torque[k] - late[k - 1]) * (1 - np.exp(-1 / 20))
    return torque + share * (late - torque)


@pytest.mark.parametrize("share", [0.05, 0.1, DELAYED_SHARE])
def test_a_delay_of_the_torque_does_less_work_than_is_allowed_for_it(share):
    """An elastic drive with play: the loop runs the other way round, as no drive's does."""
    torque = np.tile(np.concatenate([np.linspace(a, b, 41)[1:] for a, b in ((0, 12), (12, -12), (-12, 0))]), 2)
    angle, one_cycle = torque / 50 + 0.5 * np.tanh(4 * torque), np.zeros(len(torque), int)
    read, time = read_late(torque, share), np.arange(len(torque), dtype=float)
    assert gains_energy(read, angle, one_cycle)
    assert not gains_energy(read, angle, one_cycle, time)
    net = torque - 2 * np.sign(np.gradient(torque))
    rubbing = net / 50 + 0.5 * np.tanh(4 * net)
    assert not gains_energy(torque, rubbing, one_cycle, time)
    for known in (np.ones(len(time), bool), time != 50):
        assert gains_energy(rubbing, torque, one_cycle, np.where(known, time, np.nan))


def test_a_torque_that_is_read_late_is_a_fault_only_where_no_time_is_told(tmp_path):
    table = measured().assign(angle_arcmin=lambda t: t["torque_Nm"] / 50 + 0.5 * np.tanh(4 * t["torque_Nm"]))
    table["torque_Nm"] = read_late(table["torque_Nm"].to_numpy(), DELAYED_SHARE)
    faults, _ = judged(tmp_path / "a", {"rows.csv": table})
    assert "give the column time_s" in faults["swapped columns"].message
    timed = table.assign(time_s=np.arange(len(table), dtype=float))
    assert "swapped columns" not in judged(tmp_path / "b", {"rows.csv": timed})[0]


def test_the_delay_that_is_no_fault_is_that_which_can_be_named():
    assert instrument_effects()["torque_creep"].bounds(12.0, 3.0, 1.0, (4.0, 8.0))[0] == (-DELAYED_SHARE, DELAYED_SHARE)


def test_an_angle_that_is_likely_in_another_unit_is_noted(tmp_path):
    """Degrees read as minutes are 1/60 of the angle, minutes read as degrees sixtyfold: a tenth of what can be."""
    table = measured()
    for factor, expected in ((1.0, []), (60.0, ["unit"])):
        scaled = table.assign(angle_arcmin=factor * table["angle_arcmin"])
        faults, _ = judged(tmp_path / f"{factor:g}", {"rows.csv": scaled})
        assert [kind for kind in faults if kind == "unit"] == expected


def test_positions_with_their_own_offset_under_a_common_one(tmp_path):
    table = measured().assign(angle_arcmin=lambda t: t["angle_arcmin"] + t["crank_deg"])
    faults, _ = judged(tmp_path / "a", {"rows.csv": table})
    assert faults == {}
    faults, _ = judged(tmp_path / "b", {"rows.csv": table}, UNIT.replace("per_position", "common"))
    assert "per_position" in faults["mixed offsets"].message


def test_exchanged_columns_are_a_fault_and_so_is_no_plain_loop(tmp_path):
    table = measured()
    faults, _ = judged(tmp_path / "a", {"rows.csv": table})
    assert "swapped columns" not in faults
    swapped = table.rename(columns={"torque_Nm": "angle_arcmin", "angle_arcmin": "torque_Nm"})
    faults, _ = judged(tmp_path / "b", {"rows.csv": swapped})
    assert faults["swapped columns"].severity == "fatal"


def test_rows_at_the_ends_of_the_angles_range_are_a_fault(tmp_path):
    table = measured()
    middle = table.groupby("crank_deg")["angle_arcmin"].transform("mean")
    cut = table.assign(angle_arcmin=(table["angle_arcmin"] - middle).clip(-1.8, 1.8))
    faults, usable = judged(tmp_path / "a", {"rows.csv": cut})
    assert faults["clipped angle"].severity == "fatal"
    is_beyond = (table["angle_arcmin"] - middle).abs() > 1.85
    assert usable[is_beyond.to_numpy()].sum() < 3  # a row alone at the end is noise
    small_range = table.assign(angle_arcmin=(table["angle_arcmin"] - middle).clip(-2.4, 2.4))
    faults, _ = judged(tmp_path / "b", {"rows.csv": small_range})
    assert faults.keys() <= {"clipped angle"}


def test_an_angle_that_no_drive_of_the_design_has(tmp_path):
    table = measured().assign(angle_arcmin=lambda t: 1000 * t["angle_arcmin"] / np.ptp(t["angle_arcmin"]) * 1.5)
    faults, _ = judged(tmp_path, {"rows.csv": table})
    assert faults["unit"].severity == "fatal"
    assert "a drive of this design has" in faults["unit"].message
    assert '"arcsec"' in faults["unit"].message


def test_the_position_that_stands_out_is_named(tmp_path):
    table = measured()
    loose = (table["crank_deg"] == 90.0) * 1.5 * np.sign(table["torque_Nm"])
    faults, _ = judged(tmp_path / "a", {"rows.csv": table.assign(angle_arcmin=table["angle_arcmin"] + loose)})
    assert faults["position stands out"].severity == "note"
    assert "crank 90 deg" in faults["position stands out"].message
    scattered = 0.3 * np.sign(table["torque_Nm"]) * np.cos(np.radians(table["crank_deg"] + 20))
    faults, _ = judged(tmp_path / "b", {"rows.csv": table.assign(angle_arcmin=table["angle_arcmin"] + scattered)})
    assert "position stands out" not in faults


@pytest.mark.long
def test_noise_of_the_torque_turns_no_branch_and_a_note_is_told_once(tmp_path):
    rng, table = np.random.default_rng(8), measured(cycles=2, per_branch=1000)
    chatter = np.convolve(rng.standard_normal(len(table) + 8), np.ones(9) / 3, "valid")  # alike in nine rows
    faults, _ = judged(tmp_path / "a", {"rows.csv": table.assign(torque_Nm=table["torque_Nm"] + 0.8 * chatter)})
    unit = load_measured_unit(tmp_path / "a/u", ROOT)
    assert Measurement.read(unit).branches.direction.tolist() == [1, -1, 1] * 6
    small_case = measured(cycles=20, per_branch=4)
    faults_found = Measurement.read(
        load_measured_unit(write_unit(tmp_path / "b", {"rows.csv": small_case}), ROOT)
    ).faults
    (fault,) = [
        fault_of_file for fault_of_file in faults_found if fault_of_file.kind == "too few points" and fault_of_file.rows
    ]
    assert "and" in fault.message
    assert fault.count > 100


def test_semicolons_and_a_decimal_comma_are_guessed(tmp_path):
    table = measured()
    folder = write_unit(tmp_path / "u", {})
    table.to_csv(folder / "rows.csv", index=False, sep=";", decimal=",")
    read = Measurement.read(load_measured_unit(folder, ROOT))
    assert read.faults == ()
    np.testing.assert_allclose(read.rows.angle, table["angle_arcmin"])


def test_repeats_are_matched_by_sense_however_the_cycles_are_cut(tmp_path):
    """Two cycles of a bench that goes on from where it stands: the first has a branch more."""
    cuts = {0: [0.0, 12.0, -12.0, 12.0], 1: [12.0, -12.0, 12.0]}
    parts = []
    for number, turns in cuts.items():
        torque = path_of(turns, 80)
        angle = loop(torque) + 0.02 * np.random.default_rng(number).standard_normal(torque.size)
        parts.append(pd.DataFrame({"cycle": number, "crank_deg": 0.0, "torque_Nm": torque, "angle_arcmin": angle}))
    unit = load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": pd.concat(parts)}), ROOT)
    floor = Measurement.read(unit).repeatability.repeats
    assert floor.blocks == 2
    assert floor.value == pytest.approx(0.02, rel=0.2)  # a cell is a row


def test_linear_algebra_that_fails_is_a_fault_with_a_reason():
    with (
        pytest.raises(InputError, match="u: fault: undetermined: the data do not determine .*Singular matrix"),
        linear_algebra_faults("u"),
    ):
        np.linalg.solve(np.ones((2, 2)), np.ones(2))


def test_a_long_list_of_faults_is_cut(tmp_path):
    """Each cycle with an offset of its own is a fault of its own; an answer has at most twenty lines."""
    table = measured(positions=(0.0,), cycles=40, per_branch=20)
    table["angle_arcmin"] += 50.0 * (table["cycle"] % 2)
    summary = Measurement.read(load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": table}), ROOT)).summary
    assert len(summary) == 21
    assert "more faults" in summary[-1]


def test_a_loop_with_play_that_begins_without_torque_takes_work_or_none():
    """0, +T, -T, +T through play without friction: the first loading is no part of the cycle."""
    torque = np.concatenate([np.linspace(0, 10, 50), np.linspace(10, -10, 100), np.linspace(-10, 10, 100)])
    angle = 2.0 * np.sign(torque) + 0.1 * torque
    assert not gains(torque, angle)
    rubbing = angle - 0.3 * np.sign(np.gradient(torque))  # rising torque turns the output less
    assert not gains(torque, rubbing)
    assert gains(torque, angle + 0.3 * np.sign(np.gradient(torque)))


def test_a_drift_that_goes_on_over_the_cycles_is_no_gain_of_energy():
    """A small loop stays at negative torque, where a rising angle gives work back; friction is small."""
    legs = [(0, -12), (-12, -6), (-6, -12), *3 * [(-12, 12), (12, -12)]]
    torque = np.concatenate([np.linspace(*leg, 200) for leg in legs])
    sense = np.repeat([np.sign(end - start) for start, end in legs], 200)
    for drift in (-0.002, 0.002):
        moved = drift * np.arange(len(torque))
        angle = 5.0 * np.tanh((torque - 0.05 * sense) / 3.0)
        assert not gains(torque, angle + moved)
        assert gains(torque, 5.0 * np.tanh((torque + 0.3 * sense) / 3.0) + moved)


def loops(*turns, rows=200):
    """Torques of rows between turning points, none of them at no torque."""
    legs = zip(turns[:-1], turns[1:], strict=True)
    return np.concatenate([np.linspace(*leg, rows) for leg in legs]) + 1e-3


def test_where_an_angle_rests_within_the_play_is_no_drift():
    """At no torque it lies anywhere in the play, which of few loops looks like a drift of half of it."""
    torque = loops(4, -12, 12, -12, 12)
    for seed in range(20):
        rest = np.random.default_rng(seed).uniform(-2.0, 2.0, len(torque))
        angle = np.where(np.abs(torque) < 0.1, rest, 2.0 * np.sign(torque)) + 0.1 * torque
        assert not gains(torque, angle), seed


def test_a_play_that_closes_with_warmth_is_no_gain_of_energy():
    """The ends of the loop drift towards each other under load: work that the warmth does."""
    torque = loops(0, *4 * [12, -12], 0)
    closing = 2.0 - 1.0 * np.arange(len(torque)) / len(torque)
    angle = closing * np.tanh(5.0 * torque) + 0.1 * torque
    assert not gains(torque, angle)
    rubbing = 1.5 * np.sign(np.gradient(torque))
    assert gains(torque, closing * np.tanh(5.0 * torque) + 0.1 * (torque + rubbing))


@pytest.mark.parametrize("plays", [(2.0, 1.6, 1.5, 0.5), (0.5, 0.6, 1.4, 2.0)])
def test_a_play_that_warmth_changes_between_cycles_is_no_gain_of_energy(plays):
    """Cycles begin and end under load: there the angle jumps by what the pause changed."""
    torque = loops(-12, *4 * [12, -12])
    cycle = np.repeat(np.arange(4), len(torque) // 4)
    play = np.array(plays)[cycle]
    sense = np.sign(np.gradient(torque))
    assert not gains(torque, play * np.tanh(5.0 * torque) + 0.1 * torque, cycle)
    assert not gains(torque, play * np.tanh(5.0 * torque) + 0.1 * (torque - 1.5 * sense), cycle)
    assert gains(torque, play * np.tanh(5.0 * torque) + 0.1 * (torque + 1.5 * sense), cycle)


def test_noise_of_the_angle_is_no_gain_of_energy():
    """A twelfth of the range of the angle, of few rows: in a third of the records the work is beyond a hundredth."""
    torque = loops(0, 12, -12, 12, -12, 0, rows=40)
    draws = np.random.default_rng(3)
    clean_angle = 2.0 * np.sign(torque) + 0.1 * torque
    assert not any(gains(torque, clean_angle + 0.5 * draws.standard_normal(len(torque))) for _ in range(200))


def test_a_record_that_ends_at_another_load_is_judged_by_its_closed_loops():
    """The way from its end back to its start is none that was measured: it took work from a loop with friction."""
    legs = [(0, 12), (12, -12), (-12, 12), (12, -12)]
    torque = np.concatenate([np.linspace(*leg, 200) for leg in legs])
    sense = np.repeat([np.sign(end - start) for start, end in legs], 200)
    angle = 5.0 * np.tanh((torque - 0.3 * sense) / 3.0)
    assert not gains(torque, angle)
    assert gains(torque[::-1], angle[::-1])


def test_a_table_without_a_good_row_says_nothing_of_a_turning_crank():
    rows = SimpleNamespace(cranks=np.array([0.0, 90.0, 180.0]))
    assert list(_turning_crank(rows, np.zeros(9, bool))) == []
    assert [fault.kind for fault in _turning_crank(rows, np.ones(3, bool))] == ["turning crank"]


def test_an_encoder_that_starts_again_is_a_fault_of_its_own(tmp_path):
    """The zero of the angle lies near the end of the encoder's turn: no unit of the angle explains the jumps."""
    table = measured()
    angle = table["angle_arcmin"] + 10_799.5
    table["angle_arcmin"] = angle - 21_600.0 * (angle > 10_800.0)
    faults, _ = judged(tmp_path, {"rows.csv": table})
    assert faults["wrapped angle"].severity == "fatal"
    jumps = np.flatnonzero((np.abs(np.diff(table["angle_arcmin"])) > 1e4) & (np.diff(table["crank_deg"]) == 0))
    assert faults["wrapped angle"].rows[0] == f"rows.csv:{jumps[0] + 3}"
    assert not {"unit", "sign", "swapped columns"} & set(faults)


def test_missing_readings_that_a_logger_wrote_as_a_number_are_no_other_unit(tmp_path):
    faults, _ = judged(tmp_path, {"rows.csv": edited(set_at("angle_arcmin", [30, 500, 900], -9999.0))})
    assert faults["encoder jump"].severity == "note"
    assert "unit" not in faults


def test_an_angle_that_is_far_too_small_for_the_design_is_noted(tmp_path):
    table = edited(lambda t: t.__setitem__("angle_arcmin", t["angle_arcmin"] / 60))
    faults, _ = judged(tmp_path, {"rows.csv": table})
    assert faults["unit"].severity == "note"
    assert "at least" in faults["unit"].message


def test_a_crank_angle_whose_reading_jitters_is_said_to(tmp_path):
    table, rng = measured(), np.random.default_rng(0)
    table["crank_deg"] += 0.01 * np.round(rng.normal(0, 20, len(table)))
    faults, _ = judged(tmp_path, {"rows.csv": table})
    assert "jitters" in faults["turning crank"].message


def test_a_verdict_on_faulty_data_says_each_kind_once():
    faults = [Fault("a", f"first {k}", "fatal") for k in range(50)] + [Fault("b", "second", "fatal")]
    assert fault_statement(faults).sentence.endswith("verdict: first 0; second")

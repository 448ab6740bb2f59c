"""The noise floor against noise that was put in."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_bench import ROOT, UNIT, measured, write_unit
from scipy.signal import lfilter

from pipeline.identification.measurement.estimate import counted_step, high_frequency_scatter
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.repeated_branches import Branch, angle_difference
from pipeline.identification.measurement.unit_file import load_measured_unit

REAL = ROOT.parent / "shared/data/anti_backlash_actuator"


def noise_of(folder, table):
    unit = load_measured_unit(write_unit(folder / "u", {"rows.csv": table}), ROOT)
    measurement = Measurement.read(unit)
    return measurement.repeatability, measurement.cells


@settings(max_examples=25)
@given(st.floats(0.01, 10), st.floats(-5, 5), st.integers(0, 50))
def test_scatter_of_a_ramp_with_noise(sigma, slope, seed):
    values = slope * np.arange(4000) + sigma * np.random.default_rng(seed).standard_normal(4000)
    assert high_frequency_scatter(values, [slice(0, 2000), slice(2000, 4000)]) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("readings", [2, 3, 4, 6])
@pytest.mark.parametrize("step", [8.0, 40.0])
def test_scatter_of_a_staircase_is_that_of_its_readings_and_not_its_steps(readings, step):
    rng = np.random.default_rng(readings)
    values = np.repeat(step * np.arange(600), readings) + rng.standard_normal(600 * readings)
    is_kept = rng.random(values.size) > 0.05
    assert high_frequency_scatter(values[is_kept], [slice(None)]) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("step", [0.0, 8.0, 40.0])
@pytest.mark.parametrize("resolution", [0.3, 1.0])
def test_scatter_of_rounded_values_is_that_of_noise_and_rounding(resolution, step):
    values = np.repeat(step * np.arange(600), 2) + np.random.default_rng(3).standard_normal(1200)
    rounded = resolution * np.round(values / resolution)
    expected = np.hypot(1.0, resolution / np.sqrt(12))
    assert high_frequency_scatter(rounded, [slice(None)]) == pytest.approx(expected, rel=0.15)


def test_scatter_of_a_staircase_is_no_less_than_its_rounding():
    values = np.repeat(80.0 * np.arange(600), 2) + np.random.default_rng(3).standard_normal(1200)
    rounded = 4.0 * np.round(values / 4.0)
    assert high_frequency_scatter(rounded, [slice(None)]) == pytest.approx(4.0 / np.sqrt(12), rel=0.3)


def test_floor_of_independent_noise_is_that_of_the_cells(tmp_path):
    noise, averaged = noise_of(tmp_path, measured(cycles=8, per_branch=400, noise=0.2))
    expected = 0.2 * np.sqrt(np.mean(1 / averaged.count))
    outside_path = 0.2 * np.sqrt(np.mean(1 / averaged.count[np.abs(averaged.torque_mean) > 1.5]))  # the steep play
    assert noise.repeats.value == pytest.approx(outside_path, rel=0.15)
    assert noise.random.value == pytest.approx(outside_path, rel=0.15)
    assert noise.repeats.ci_low < noise.repeats.value < noise.repeats.ci_high
    assert noise.within_branch.value == pytest.approx(expected, rel=0.25)
    assert noise.row_scatter_arcmin == pytest.approx(0.2, rel=0.1)
    assert noise.between_positions.value < 0.6 * expected * np.sqrt(2)


def straight(noise, seed, positions=(0.0, 90.0, 180.0), cycles=8, rows=200):
    """Cycles on a spring alone, their rows at other torques each time, with independent noise of the angle [arcmin]."""
    rng, parts = np.random.default_rng(seed), []
    for crank in positions:
        for cycle in range(cycles):
            legs = [np.sort(rng.uniform(*ends)) for ends in ((0, 12, rows), (-12, 12, 2 * rows), (-12, 0, rows))]
            torque = np.concatenate([[0.0], legs[0], [12.0], legs[1][::-1], [-12.0], legs[2], [0.0]])
            angle = torque / 5 + noise * rng.standard_normal(torque.size)
            parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    return pd.concat(parts, ignore_index=True)


@pytest.mark.long
def test_floor_and_random_are_the_noise_of_a_cell_where_repeats_are_at_other_torques(tmp_path):
    ratios = []
    for seed in range(4):
        noise, averaged = noise_of(tmp_path / str(seed), straight(0.002, seed))
        expected = 0.002 * np.sqrt(np.mean(1 / averaged.count))
        ratios.append([noise.repeats.value / expected, noise.random.value / expected])
    np.testing.assert_allclose(ratios, 1.0, atol=0.15)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.04)


@pytest.mark.parametrize("noise", [0.1, pytest.param(0.5, marks=pytest.mark.attack), 2.0])
@pytest.mark.long
def test_noise_that_looks_steep_is_not_left_out_of_its_floor(tmp_path, noise):
    ratios = []
    for seed in range(3):
        result, averaged = noise_of(tmp_path / str(seed), straight(noise, seed))
        expected = noise * np.sqrt(np.mean(1 / averaged.count))
        ratios.append([result.repeats.value / expected, result.random.value / expected])
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.08)


def test_a_play_that_is_crossed_within_a_wide_cell_is_no_noise(tmp_path):
    """25 rows a branch, at other torques in each cycle: which row is the first beyond the play is chance."""
    rng, parts = np.random.default_rng(6), []
    for crank in (0.0, 90.0, 180.0):
        for cycle in range(4):
            levels = np.linspace(-12, 12, 25)
            torque = np.concatenate([levels, levels[::-1]]) + rng.uniform(-0.3, 0.3, 50)
            angle = torque / 5 + 2 * np.sign(torque) + 0.02 * rng.standard_normal(50)
            parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    noise, averaged = noise_of(tmp_path, pd.concat(parts, ignore_index=True))
    assert noise.floor.value == pytest.approx(0.02 * np.sqrt(np.mean(1 / averaged.count)), rel=0.25)


@pytest.mark.long
def test_drift_between_cycles_is_in_the_floor_alone(tmp_path):
    table = measured(cycles=4, per_branch=400, noise=0.02)
    drifting = table.assign(angle_arcmin=table["angle_arcmin"] * (1 + 0.2 * table["cycle"]))
    steady, _ = noise_of(tmp_path / "a", table)
    drifted, _ = noise_of(tmp_path / "b", drifting)
    assert drifted.repeats.value > 5 * steady.repeats.value
    assert drifted.within_branch.value < 2 * steady.within_branch.value
    assert drifted.random.value < 1.5 * steady.random.value
    of_position = 1 + 0.2 * drifting["cycle"] * np.where(drifting["crank_deg"] == 90, -1, 1)
    scaled, _ = noise_of(tmp_path / "c", table.assign(angle_arcmin=table["angle_arcmin"] * of_position))
    assert scaled.random.value > 5 * steady.random.value


def warmed(table, part, temperature):
    """The table with `part` times the temperature rise added to its angle, and a column of temperatures."""
    per_cycle = np.random.default_rng(7).uniform(0, 20, (3, 4))
    rise = per_cycle[(table["crank_deg"] // 90).astype(int), table["cycle"]]
    message = {"rise": rise, "shuffled": per_cycle[:, ::-1][(table["crank_deg"] // 90).astype(int), table["cycle"]]}
    table_made = table.assign(angle_arcmin=table["angle_arcmin"] + part(table["torque_Nm"]) * rise)
    return table_made if temperature is None else table_made.assign(temperature_C=20.0 + message[temperature])


PARTS = {"even": lambda torque: 0.01 * np.abs(torque), "odd": lambda torque: 0.01 * torque}


@pytest.mark.parametrize("part", ["even", "odd"])
@pytest.mark.long
def test_what_goes_with_the_temperature_is_no_random_noise(tmp_path, part):
    table = measured(cycles=4, per_branch=400, noise=0.02)
    steady, _ = noise_of(tmp_path / "still", table)
    result = {
        message: noise_of(tmp_path / str(message), warmed(table, PARTS[part], message))[0]
        for message in ("rise", "shuffled", None)
    }
    assert all(noise.repeats.value > 5 * steady.repeats.value for noise in result.values())
    assert result["rise"].random.value == pytest.approx(steady.random.value, rel=0.2)
    assert result["shuffled"].random.value > 5 * steady.random.value
    assert result[None].random.value > 5 * steady.random.value


def test_one_position_has_a_floor_and_no_random_noise(tmp_path):
    noise, _ = noise_of(tmp_path, measured((90.0,), 4))
    assert noise.repeats.value > 0
    assert np.isnan([noise.random.value, noise.random.ci_low, noise.random.ci_high]).all()
    assert noise.random.n == noise.random.blocks == 0


def test_the_offset_of_a_cycle_is_no_noise(tmp_path):
    table = measured(cycles=4, per_branch=400)
    shifted = table.assign(angle_arcmin=table["angle_arcmin"] + 0.4 * table["cycle"])
    steady, _ = noise_of(tmp_path / "a", table)
    shifted_value, _ = noise_of(tmp_path / "b", shifted)
    assert shifted_value.repeats.value == pytest.approx(steady.repeats.value, rel=1e-6)


def test_one_position_and_one_cycle_have_no_floor_but_a_scatter(tmp_path):
    noise, _ = noise_of(tmp_path, measured((0.0,), 1))
    assert np.isnan(noise.repeats.value)
    assert noise.repeats.n == 0
    assert np.isnan(noise.between_positions.value)
    assert noise.within_branch.value > 0


def test_positions_that_differ_scatter_more_than_repeats(tmp_path):
    table = measured(cycles=3, per_branch=400)
    wider = table.assign(angle_arcmin=table["angle_arcmin"] * (1 + 0.3 * (table["crank_deg"] == 90)))
    noise, _ = noise_of(tmp_path, wider)
    assert noise.between_positions.value > 10 * noise.repeats.value


PRINTED = (
    UNIT.replace("pham2017", "printed_drive").replace("quick", "printed_drive")
    + """
[columns.cycle]
name = "test_nr"
[columns.angle_arcmin]
name = "POSITION"
unit = "rev"
[columns.torque_Nm]
name = "TORQUE"
[columns.command_torque_Nm]
name = "CONTROL_TORQUE"
"""
)
RAMPS = """
[[files]]
path = "{file}"
crank_deg = {crank}
where = {{ test_nr = [100, 101, 102] }}
"""


@pytest.mark.skipif(not REAL.is_dir(), reason="the measured drives are not at hand")
@pytest.mark.parametrize(("name", "low", "high"), [("base_pccf_runin", 2.0, 9.0), ("conic_onyx_preload5", 2.0, 12.0)])
def test_noise_of_the_printed_drives_lies_where_their_repeats_do(tmp_path, name, low, high):
    files = enumerate(sorted((REAL / name).glob("*.csv.gz")))
    text = PRINTED + "".join(RAMPS.format(file=file, crank=90.0 * number) for number, file in files)
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path / name, {}, text), ROOT))
    noise = measurement.repeatability
    assert measurement.branches.direction.tolist() == [1, -1, 1] * 9
    assert low < noise.repeats.value < high
    assert noise.torque_noise_Nm == pytest.approx(0.2, abs=0.03)
    assert {fault.kind for fault in measurement.faults} <= {"saturation"}


def test_reduced_drive_of_the_project_has_the_noise_of_all_its_rows():
    """2.36 arcmin (1.5 to 3.0) of all 76,831 rows, of which 6,404 are kept; and the same saturation."""
    measurement = Measurement.read(load_measured_unit("base_pccf_runin", ROOT))
    assert measurement.branches.direction.tolist() == [1, -1, 1] * 9
    assert measurement.repeatability.repeats.value == pytest.approx(2.36, rel=0.12)
    assert 1 - measurement.is_readable.mean() == pytest.approx(0.375, abs=0.02)
    assert measurement.fatal == ()


def noisy_loops(kind, seed, cycles, positions=(0.0, 120.0, 240.0), rows=150):
    """Cycles on a spring with a play, whose cells have 3 to 20 rows, and the noise of their rows (n_rows,) [arcmin].

    ``kind``: white; "wander", a first-order autoregression that forgets within five rows; or white with an offset of
    each cycle, which is no noise.
    """
    rng, torques, cycle, crank = np.random.default_rng(seed), [], [], []
    for place in positions:
        for number in range(cycles):
            parts = [np.linspace(*ends) for ends in ((0, 12, rows), (12, -12, 2 * rows), (-12, 0, rows))]
            torques.append(np.concatenate(parts) + 0.02 * rng.standard_normal(4 * rows))
            cycle += [number] * (4 * rows)
            crank += [place] * (4 * rows)
    torque = np.concatenate(torques)
    noise = 0.05 * rng.standard_normal(len(torque))
    if kind == "wander":
        noise = lfilter([np.sqrt(1 - 0.8**2)], [1.0, -0.8], noise)
    offset = np.repeat(0.5 * rng.standard_normal(len(torques)), 4 * rows) if kind == "offsets" else 0.0
    angle = torque / 5 + 3 * np.clip(torque / 0.8, -1, 1) + noise + offset
    table = pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle})
    return table, noise


@pytest.mark.parametrize(
    ("kind", "cycles"),
    [
        *[("white", 2), ("wander", 3), ("offsets", 6)],
        *(
            pytest.param(*case, marks=pytest.mark.attack)
            for case in product(("white", "wander", "offsets"), (2, 3, 6))
        ),
    ],
)
@pytest.mark.long
def test_floor_is_the_noise_of_all_cells_on_average(tmp_path, kind, cycles):
    """Of drawn units: its mean square is that of the noise which the cells have, those in the play included.

    Of noise that neighbouring cells share the offset of a pair of cycles takes more than one degree of freedom.
    """
    floors, noise_of_cells = [], []
    for seed in range(32 // cycles):
        table, noise = noisy_loops(kind, seed, cycles)
        folder = write_unit(tmp_path / f"{seed}", {"rows.csv": table})
        measurement = Measurement.read(load_measured_unit(folder, ROOT))
        floors.append(measurement.repeatability.floor.value)
        noise_of_cells.append(np.sqrt(np.mean(measurement.over_cells(noise) ** 2)))
    assert np.mean(np.array(floors) / noise_of_cells) == pytest.approx(1.0, abs=0.05 if kind == "wander" else 0.03)


def test_few_rows_on_a_bent_loop_do_not_raise_the_noise(tmp_path):
    """A branch of 25 rows on a ramp that starts and ends gently: the curve and the torque are bent over a cell."""
    turns = np.cos(np.pi * (np.arange(25) + 0.5) / 25)
    rng, parts = np.random.default_rng(5), []
    for crank in (0.0, 90.0, 180.0):
        for cycle in range(4):
            torque = 12 * np.concatenate([turns, -turns]) + 0.01 * rng.standard_normal(50)
            angle = np.sign(torque) * 4 * np.abs(torque / 12) ** (2 / 3) + 0.02 * rng.standard_normal(50)
            parts.append(pd.DataFrame({"cycle": cycle, "crank_deg": crank, "torque_Nm": torque, "angle_arcmin": angle}))
    noise, averaged = noise_of(tmp_path, pd.concat(parts, ignore_index=True))
    assert noise.torque_noise_Nm == pytest.approx(0.01, rel=0.4)
    assert noise.floor.value == pytest.approx(0.02 * np.sqrt(np.mean(1 / averaged.count)), rel=0.2)


@pytest.mark.long
def test_few_torques_share_their_offset_and_the_random_noise_counts_it(tmp_path):
    """The mean of a loop over n torques is taken off: it leaves n - 1 of n parts of the noise, two thirds here."""
    legs = [np.linspace(*ends, endpoint=False) for ends in ((0, 12, 6), (12, -12, 12), (-12, 0, 6))]
    cycles, rows, rng = 100, 24, np.random.default_rng(0)
    torque, of_cycle = np.tile(np.concatenate(legs), 3 * cycles), np.arange(cycles).repeat(rows)
    shared = np.tile(torque[:rows], cycles) * 0.002 * rng.standard_normal(cycles).repeat(rows)
    columns = {"cycle": np.tile(of_cycle, 3), "crank_deg": np.repeat([0.0, 120.0, 240.0], cycles * rows)}
    angle = torque / 5 + np.tile(shared, 3) + 0.05 * rng.standard_normal(len(torque))
    table = pd.DataFrame({**columns, "torque_Nm": torque, "angle_arcmin": angle})
    noise, averaged = noise_of(tmp_path, table)
    assert noise.is_shared
    assert noise.random.value == pytest.approx(0.05 * np.sqrt(np.mean(1 / averaged.count)), rel=0.08)


def branch_that_jumps_beyond(torque):
    """Twelve rows in four cells, on a slope with a way through the play beyond a torque."""
    rows = np.arange(12) - 5.5
    angle = 0.2 * rows + 2.0 * (rows > torque)
    means = (values.reshape(4, 3).mean(axis=1) for values in (rows, angle))
    return Branch(*means, np.full(4, 3), rows, angle, 0.0, 0.0)


def test_a_cell_that_holds_the_jump_of_its_own_branch_is_not_compared():
    """The other branch jumps between the next two rows: no row of the cell lies between them."""
    difference = angle_difference(branch_that_jumps_beyond(1.5), branch_that_jumps_beyond(2.5))
    np.testing.assert_allclose(difference.angle, np.zeros(3), atol=1e-12)


def test_an_encoder_that_counts_is_found_by_its_readings():
    """Counts of 0.2 arcmin, read in degrees with six decimals; a few values are multiples of a step by chance."""
    angle = np.random.default_rng(0).normal(0, 3, 400)
    counts = 60 * np.round(0.2 * np.round((angle + 0.07) / 0.2) / 60, 6)
    assert counted_step(counts + 1.23) == pytest.approx(0.2, abs=1e-3)
    assert counted_step(angle) == 0
    assert counted_step(np.round(angle, 4)) < 1e-3
    assert counted_step(np.array([0.0, 0.3, 0.9, 2.1])) == 0
    assert counted_step(np.zeros(50)) == 0


def test_the_floor_of_an_encoder_that_counts_is_that_of_its_counts(tmp_path):
    table = measured(cycles=3, per_branch=80, noise=0.0)
    noise, _ = noise_of(tmp_path, table.assign(angle_arcmin=0.2 * np.round(table["angle_arcmin"] / 0.2)))
    assert noise.floor.value == pytest.approx(0.2 / np.sqrt(12))
    assert noise.floor.words == "resolution of the angle"

"""The torque at which the play is crossed, where the angle jumps through it within a cell."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from measured_bench import measured, path_of, write_unit
from scipy.special import ndtr
from synthetic_unit import ROOT, Bench, make_unit, problem_of

from pipeline.identification.fitting import build
from pipeline.identification.fitting.cells_in_noise import (
    PLACE,
    STEP_SCATTER,
    _lies_beyond,
    _slopes,
    data_of,
    jumps_between,
    place_errors,
    side_errors,
)
from pipeline.identification.fitting.data import Data
from pipeline.identification.fitting.fitter import OPEN_SHARE, Fitter
from pipeline.identification.fitting.measured_loops import rows_within, within_cells
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.selection.covariance import Covariance, parts_of
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.model_selection import Selector
from pipeline.identification.selection.statements.verdict import IDENTIFIED, judge

ZERO = 0.06
"""[N m] half a percent of the largest torque, two rows of the torque: less than the cell in which the angle jumps."""


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5, 0.9])
def test_scatter_of_a_step_about_its_line_is_that_of_its_rows(share):
    """By least squares over many rows; in the middle 90 % of the cell the height follows from one number."""
    position = (np.arange(20000) + 0.5) / 20000
    step = (position > share).astype(float)
    residual = step - np.polyval(np.polyfit(position, step, 1), position)
    assert np.std(residual) == pytest.approx(STEP_SCATTER, rel=0.3)


@pytest.mark.long
def test_a_zero_of_the_torque_within_the_cell_of_the_jump_is_named(tmp_path, condensed):
    """It was never tried: the scatter of the jump was taken for the error of its place, 50 times too much."""
    folder = make_unit(tmp_path / "u", {"torque_zero": [ZERO]}, Bench(rows=400), condensed)
    problem = problem_of(folder, condensed)
    visible = np.ones(len(problem.data), bool)
    selector = Selector(Fitter(problem), visible)
    selector.testable = {name: selector.testable[name] for name in ("torque_zero", "pin_radius_error", "coulomb")}
    selection = selector.select(visible)
    verdict = judge(selector.fitter, selection, visible)
    assert (verdict.verdict, verdict.named_effects) == (IDENTIFIED, ("torque_zero",))
    (zero,) = verdict.parameters
    assert zero.ci_low < ZERO < zero.ci_high
    assert zero.value == pytest.approx(ZERO, abs=0.25 * ZERO)  # half a row: between two rows all zeros fit as well


def test_a_zero_of_the_torque_is_as_uncertain_as_the_place_of_the_jump_between_two_rows(tmp_path, condensed):
    """All branches of a sense have their rows at the same torques, so that more of them do not tell it any better.

    The fit is off by a third of a row: beyond 2.2 standard deviations if cells beside the jumps erred apart.
    """
    zero = 0.5 * ZERO
    folder = make_unit(tmp_path / "u", {"torque_zero": [zero]}, Bench(rows=401, cycles=6), condensed)
    problem = problem_of(folder, condensed)
    fitter, visible = Fitter(problem), np.ones(len(problem.data), bool)
    model = Model((candidates()["torque_zero"],))
    fit = fitter.fit_from_best(model, visible, [fitter.start(model, np.array([share])) for share in (0.49, 0.51)])
    ((low, high),) = fitter.bounds(model)

    def error_in_deviations(data: Data) -> float:
        covariance = Covariance(data, visible, parts_of(data, visible))
        evidence = Evidence(covariance, fitter, fit)
        mean, spread = evidence.unknowns[0], OPEN_SHARE * (high - low)
        place = len(fit.unknowns.scales)
        return abs(spread * mean[place] - zero) / ((high - low) * evidence.deviations[place])

    assert error_in_deviations(problem.data) < 2
    assert error_in_deviations(replace(problem.data, row_error=np.zeros(len(visible)))) > 2.2


def cells_of(torque, angle, block, direction, count):
    """Cells of one position."""
    whole = np.zeros(len(torque), np.int64)
    nothing = np.zeros(len(torque))
    return Cells(
        block=block,
        position=whole,
        cycle=whole,
        direction=whole + direction,
        torque_mean=torque,
        angle_mean=angle,
        count=whole + count,
        angle_spread=nothing,
        time_mean=nothing,
        temperature_mean=nothing,
        first_row=count * np.arange(len(torque)),
    )


def two_falling_branches():
    """Cells of two branches on which the torque falls; within the second cell of the first one the angle jumps."""
    torque = np.array([8.0, 2.7, -5.4, 3.5, 1.4, 0.4])
    angle = np.where(torque > 0, 2.0, -2.0) - np.array([0, 1, 0, 0, 0, 0])
    return cells_of(torque, angle, np.array([0, 0, 0, 1, 1, 1]), -1, 4)


def rows_alone(torque, angle, block, direction=1):
    """Rows that are cells of their own, of branches on which the torque rises or falls."""
    return cells_of(torque, angle, np.asarray(block, np.int64), direction, 1)


@pytest.mark.parametrize(
    ("torque", "beyond"),
    [(9.0, [0, 3]), (4.0, [3]), (3.1, [3]), (2.0, []), (1.0, []), (0.8, [5]), (0.0, [5]), (-5.0, [2, 5])],
)
def test_a_torque_lies_beyond_the_end_of_a_branch_from_within_a_row_of_it(torque, beyond):
    is_beyond = _lies_beyond(two_falling_branches(), torque, row_interval=0.5)
    assert np.flatnonzero(is_beyond).tolist() == beyond


def test_a_record_that_ends_where_another_branch_jumps_within_a_cell_is_as_uncertain():
    """Its last cell reaches half a row beyond its last row; the scatter there, a little more than usual, is no jump."""
    cells = two_falling_branches()
    errors, row_errors = place_errors(cells, np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.01]), 0.0)
    np.testing.assert_allclose(errors, [0, 0, 0, 0, 0, 4.0 * PLACE / 4], rtol=1e-12)
    np.testing.assert_allclose(row_errors, errors)


def test_the_far_ends_of_branches_of_few_rows_are_known_as_well_as_ever(tmp_path):
    """Five cells a branch: those where the torque turns lie within 1.5 cells of the jump, and not beside it."""
    rng, table = np.random.default_rng(5), measured(cycles=4, per_branch=19, noise=0.0)
    torque = table["torque_Nm"].to_numpy()
    angle = np.where(torque > -0.4, 20.0, -20.0) + torque / 5 + 0.02 * rng.standard_normal(len(torque))
    unit = write_unit(tmp_path, {"rows.csv": table.assign(angle_arcmin=angle)})
    measurement = Measurement.read(load_measured_unit(unit, ROOT))
    data = data_of(measurement, np.ones(len(measurement.cells), bool))
    is_far = np.abs(data.torque) > 0.6 * np.max(np.abs(data.torque))
    assert np.count_nonzero(is_far) > 0.3 * len(is_far)
    assert np.max(data.sigma[is_far]) < 2 * data.noise
    assert np.max(data.sigma[~is_far]) > 5 * data.noise


def test_rows_within_a_cell_keep_their_order_and_their_angles_lie_on_a_line(tmp_path):
    rng, table = np.random.default_rng(5), measured(cycles=2, per_branch=240, noise=0.0)
    torque = table["torque_Nm"].to_numpy()
    there_and_back = torque + 0.5 * np.sin(3 * torque)  # goes back where the sine falls
    angle = torque / 5 + 0.004 * rng.standard_normal(len(torque))
    table = table.assign(angle_arcmin=angle, torque_Nm=there_and_back, time_s=np.arange(len(table), dtype=float))
    unit = write_unit(tmp_path, {"rows.csv": table})
    measurement = Measurement.read(load_measured_unit(unit, ROOT))
    cells = measurement.cells
    torques, angles, times = rows_within(measurement, np.arange(len(cells)))
    np.testing.assert_allclose(angles.mean(axis=1), cells.angle_mean)
    assert np.all(np.diff(angles, axis=1) > -0.01)  # rising, on branches of both senses
    assert np.median(np.abs(torques - 5 * angles - 0.5 * np.sin(15 * angles))) < 0.05
    assert np.any(np.diff(torques, axis=1) < -0.02)
    assert np.all(np.diff(within_cells(measurement, np.arange(len(cells))), axis=1) >= 0)
    assert np.all(np.diff(times, axis=1) * cells.direction[:, None] > 0)
    np.testing.assert_allclose(times.mean(axis=1), cells.time_mean)


def misfit_of_model(measurement, data):
    """What the mean over its cells of a spring behind a play of 40 arcmin misses [arcmin]."""
    fine = np.linspace(0, 1, 401)
    edges = within_cells(measurement, np.arange(len(data)))
    followed = np.stack([np.interp(fine, np.linspace(0, 1, edges.shape[1]), edge) for edge in edges])
    return np.mean(np.where(followed > 0, 20.0, -20.0) + followed / 5, axis=1) - data.angle


def jumping(folder, scatter, cycles=6):
    """Data of a spring behind a play of 40 arcmin; where each branch crosses it scatters [N m]."""
    rng, table = np.random.default_rng(3), measured(cycles=cycles, per_branch=200)
    for _, rows in table.groupby(["crank_deg", "cycle"]):
        torque = path_of([0.0, 12.0, -12.0, 0.0], 200)
        crossed = np.where(torque + 0.021 + scatter * rng.standard_normal() > 0, 20.0, -20.0)
        table.loc[rows.index, "angle_arcmin"] = crossed + torque / 5 + 0.02 * rng.standard_normal(len(torque))
    measurement = Measurement.read(load_measured_unit(write_unit(folder, {"rows.csv": table}), ROOT))
    return measurement, data_of(measurement, np.ones(len(measurement.cells), bool))


def test_error_of_a_jump_is_what_its_repeats_scatter_by(tmp_path):
    """Beside it half a row; as a torque, that of the draws."""
    errors = []
    for scatter in (0.0, 0.05):
        measurement, data = jumping(tmp_path / str(scatter), scatter)
        spread = measurement.cells.angle_spread
        steep = np.flatnonzero(spread > 2.0)
        assert steep.size >= 6
        half_a_row = 0.5 * spread[steep] / STEP_SCATTER / data.count[steep]
        assert np.all(data.sigma[steep] > 0.9 * half_a_row)
        errors.append(np.median(data.sigma[steep] / spread[steep]))
    assert errors[0] < 0.6
    assert errors[1] > 1.1 * errors[0]


def test_a_jump_that_nothing_repeats_is_as_uncertain_as_its_rows_scatter(tmp_path):
    measurement, data = jumping(tmp_path, 0.0, cycles=1)
    spread = measurement.cells.angle_spread
    steep = spread > 2.0
    assert np.all(data.sigma[steep] > 0.9 * spread[steep])


@pytest.mark.parametrize("torque_noise", [0.0, 0.02])
def test_a_jump_between_two_cells_is_known_to_a_part_of_a_row(tmp_path, torque_noise):
    """Cycles that begin and end at no torque, as a counter of loops has them: the cells on both sides have no jump.

    What the model reads is the mean of the same curve over the cells. Noise of the torque mixes the rows there; a
    record that ends at no torque does not go on through the play.
    """
    rng, table = np.random.default_rng(5), measured(cycles=3, per_branch=199)
    torque = np.concatenate([path_of([0.0, 12.0, -12.0, 0.0], 199)] * 9)
    torque += np.concatenate([[0.01], np.full(len(torque) - 1, 0.0)]) - 0.03 * np.sign(np.gradient(torque))
    table["angle_arcmin"] = np.where(torque > 0, 20.0, -20.0) + torque / 5 + 0.02 * rng.standard_normal(len(torque))
    table["torque_Nm"] = torque + torque_noise * rng.standard_normal(len(torque))
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path, {"rows.csv": table}), ROOT))
    data = data_of(measurement, np.ones(len(measurement.cells), bool))
    misfit = misfit_of_model(measurement, data)
    beside = np.abs(data.torque) < 0.6
    assert np.count_nonzero(beside) > 30
    assert np.max(np.abs(misfit[beside])) > 10 * data.noise
    assert np.sqrt(np.mean((misfit / data.sigma)[beside] ** 2)) < 1.2
    assert np.median(data.sigma[~beside]) < 2 * data.noise


@pytest.mark.parametrize("direction", [1, -1])
def test_a_row_read_right_before_the_play_is_not_taken_for_one_beyond_it(tmp_path, direction):
    """Benches that hold no torque near zero: one row 0.05 N m before the play, and the next 1.2 N m behind it."""
    one_way = direction * np.concatenate([np.linspace(12.0, 1.2, 181), [0.05], np.linspace(-1.2, -12.0, 181)])
    torque = np.tile(np.concatenate([one_way, -one_way[1:-1]]), 9)
    number = np.repeat(np.arange(9), len(torque) // 9)
    table = pd.DataFrame({"cycle": number % 3, "crank_deg": 90.0 * (number // 3), "torque_Nm": torque})
    uneven = table.assign(angle_arcmin=np.where(torque > 0, 20.0, -20.0) + torque / 5)
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path, {"rows.csv": uneven}), ROOT))
    assert np.all(measurement.cells.count > 1)
    data = data_of(measurement, np.ones(len(measurement.cells), bool))
    assert np.max(np.abs(misfit_of_model(measurement, data))) < 0.1


def test_cells_cut_short_where_the_torque_turns_have_the_mean_torque_of_their_rows(tmp_path):
    """To a fiftieth of the distance between rows: half of a row's surroundings left out moved it by a tenth."""
    measurement = Measurement.read(
        load_measured_unit(write_unit(tmp_path, {"rows.csv": measured(per_branch=60)}), ROOT)
    )
    cells, edges = measurement.cells, within_cells(measurement, np.arange(len(measurement.cells)))
    step = np.ptp(measurement.rows.torque) / 120
    assert np.max(np.abs(edges)) < 12.0 + 0.25 * step
    middles = 0.5 * (edges[:, 1:] + edges[:, :-1]).mean(axis=1)
    np.testing.assert_allclose(middles, cells.torque_mean, atol=0.02 * step)


def test_the_noise_of_the_torque_that_repeats_show_is_counted_once(tmp_path):
    table = measured(cycles=4, per_branch=150, noise=1e-4)
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(table))
    unit = load_measured_unit(
        write_unit(tmp_path / "u", {"rows.csv": table.assign(torque_Nm=table["torque_Nm"] + noise)}), ROOT
    )
    measurement = Measurement.read(unit)
    data = data_of(measurement, np.ones(len(measurement.cells), bool))
    assert np.median(data.sigma) == pytest.approx(data.noise, rel=0.1)
    assert np.max(data.sigma) > 3 * data.noise
    assert data.torque_noise == pytest.approx(0.05 / np.sqrt(np.median(data.count)), rel=0.2)


@pytest.mark.parametrize("direction", [1, -1])
def test_rows_by_themselves_err_by_the_chance_to_lie_on_the_wrong_side_of_the_play(direction):
    """Noise of 0.1 N m puts every second row read at 1 N m on the other side of a jump at 1 N m.

    Ten jumps tell the place: five rows read there lie before it, five behind it.
    """
    read, block = np.tile(direction * np.arange(-5.0, 6.0), 10), np.repeat(np.arange(10), 11)
    true = read + 0.1 * (-1.0) ** block
    alone = rows_alone(read, np.where(true > 1, 2.0, -2.0) + 0.01 * read, block, direction)
    errors = side_errors(alone, np.ones(len(alone), bool), 0.1)
    at_jump = read == 1
    place = np.linspace(-5, 5, 2001)  # from 1 N m, in the noise
    density = (ndtr(place) * ndtr(-place)) ** 5
    wrong_side = np.average(ndtr(-np.abs(place)), weights=density)
    np.testing.assert_allclose(errors[at_jump], 4.0 * np.sqrt(wrong_side), rtol=0.01)
    assert np.all(errors[~at_jump] < 0.01)


def test_rows_whose_torque_is_known_are_on_their_side_of_the_play():
    """The play is crossed anywhere between the rows at 0 and 1 N m, but neither of them is on its wrong side."""
    read = np.arange(-5.0, 6.0)
    alone = rows_alone(read, np.where(read > 0.5, 2.0, -2.0) + 0.01 * read, np.zeros(11))
    assert np.all(side_errors(alone, np.ones(len(alone), bool), 0.0) < 0.1)
    assert not np.any(side_errors(alone, np.zeros(len(alone), bool), 0.0))


def test_rows_at_the_weights_of_a_staircase_are_on_their_side_of_the_play():
    """Between weights of 5 N m the place is known to 10 N m only; by a normal density 4 % of rows were wrong."""
    rng = np.random.default_rng(2)
    read = np.tile(np.repeat([-10.0, -5.0, 5.0, 10.0], 4), 10) + 0.1 * rng.standard_normal(160)
    alone = rows_alone(read, 2.0 * np.sign(read) + 0.01 * read, np.repeat(np.arange(10), 16))
    errors = side_errors(alone, np.ones(len(alone), bool), 0.1)
    assert np.median(errors[np.abs(read) < 7]) < 0.1
    assert np.max(errors) < 0.5


def test_a_row_within_a_jump_makes_it_two_jumps():
    read = np.arange(-5.0, 6.0)
    alone = rows_alone(read, 2.0 * np.sign(read) + 0.01 * read, np.zeros(11))
    heights = jumps_between(alone, np.zeros(len(alone)), 0.0)
    np.testing.assert_allclose(heights[heights > 0], 2.0, rtol=0.01)
    np.testing.assert_array_equal(np.flatnonzero(heights), [4, 5])


@pytest.mark.parametrize("seed", range(6))
def test_a_torque_that_is_held_hides_no_jump_and_makes_no_slope(seed):
    """Three rows at each of eleven torques: between the rows of one torque, noise over noise says nothing."""
    rng = np.random.default_rng(seed)
    held = np.repeat(np.arange(-5.0, 6.0) + 0.5, 3)
    read = held + 0.05 * rng.standard_normal(33)
    staircase = rows_alone(read, 2.0 * np.sign(held) + 0.03 * rng.standard_normal(33), np.zeros(33))
    heights = jumps_between(staircase, np.zeros(33), 0.05)
    np.testing.assert_array_equal(np.flatnonzero(heights), [14])
    assert heights[14] == pytest.approx(4.0, rel=0.15)
    away = np.abs(held) > 1.0
    assert np.all(0.05 * _slopes(staircase, 0.05)[0][away] < 0.15)


def test_cells_of_a_held_torque_are_known_as_well_as_others(tmp_path):
    """Slopes between rows of one torque would give three in ten cells an error of more than three floors.

    Taken over at least one standard deviation of the torque, they would still take a quarter of what the rows tell.
    """
    table = measured(cycles=3, per_branch=30, noise=0.0)
    staircase = table.loc[np.repeat(table.index, 3)].reset_index(drop=True)
    rng = np.random.default_rng(0)
    staircase["torque_Nm"] += 0.05 * rng.standard_normal(len(staircase))
    staircase["angle_arcmin"] += 0.02 * rng.standard_normal(len(staircase))
    measurement = Measurement.read(load_measured_unit(write_unit(tmp_path / "u", {"rows.csv": staircase}), ROOT))
    data = data_of(measurement, np.ones(len(measurement.cells), bool))
    loaded = np.abs(data.torque) > 3.0
    assert np.mean(data.sigma[loaded] > 3 * data.noise) < 0.05
    assert np.mean((data.noise / data.sigma[loaded]) ** 2) > 0.82


def states_of(folder, table):
    """State of each cell at the first position, conditions of the states, and the measurement."""
    measurement = Measurement.read(load_measured_unit(write_unit(folder, {"rows.csv": table}), ROOT))
    states, conditions = build._states(measurement)
    return states[0], conditions[0], measurement


def test_wear_and_temperature_go_on_within_a_cycle(tmp_path):
    """Cycles 0, 12, -12, 0 N m, a way of 48 N m each, while the temperature nears 50 C."""
    table = measured(positions=(0.0,), per_branch=100)
    way = np.append(0.0, np.cumsum(np.abs(np.diff(table["torque_Nm"])))) / 48
    warm = 50 - 30 * np.exp(-way)
    noise = 0.1 * np.random.default_rng(1).standard_normal(len(table))
    state, conditions, measurement = states_of(tmp_path, table.assign(temperature_C=warm + noise))
    cycles, rise = (
        np.interp(state, np.arange(len(values)), values) for values in (conditions.cycle, conditions.temperature_rise)
    )
    middle = measurement.cells.first_row + 0.5 * (measurement.cells.count - 1)
    expected = np.interp(middle, np.arange(len(way)), way)
    np.testing.assert_allclose(np.exp(-cycles / 0.7), np.exp(-expected / 0.7), atol=0.01)
    unit = measurement.unit.settings.environment.temperature_C
    np.testing.assert_allclose(rise, np.interp(middle, np.arange(len(way)), warm) - unit, atol=0.4)
    assert len(conditions.cycle) < 15


def test_a_temperature_of_each_cycle_is_followed_to_its_step(tmp_path):
    table = measured(positions=(0.0,), per_branch=100)
    warm = np.array([20.0, 45.0, 30.0])[table["cycle"]]
    state, conditions, measurement = states_of(tmp_path, table.assign(temperature_C=warm))
    rise = np.interp(state, np.arange(len(conditions.cycle)), conditions.temperature_rise)
    expected = warm[measurement.cells.first_row] - measurement.unit.settings.environment.temperature_C
    np.testing.assert_allclose(rise, expected, atol=0.5)


def test_a_temperature_that_was_read_at_some_rows_is_taken_between_them(tmp_path):
    table = measured(positions=(0.0,), per_branch=40)
    warm = np.linspace(20.0, 40.0, len(table))
    state, conditions, measurement = states_of(
        tmp_path, table.assign(temperature_C=np.where(np.arange(len(table)) % 7, np.nan, warm))
    )
    rise = np.interp(state, np.arange(len(conditions.cycle)), conditions.temperature_rise)
    expected = warm[measurement.cells.first_row] - measurement.unit.settings.environment.temperature_C
    np.testing.assert_allclose(rise, expected, atol=1.0)


def test_a_position_without_cells_has_one_state():
    state, conditions = build._piecewise_linear(np.zeros((0, 2)))
    assert (state.shape, conditions.tolist()) == ((0,), [[0.0], [0.0]])


def test_a_record_of_one_cell_has_one_state():
    state, conditions = build._piecewise_linear(np.array([[0.5, 3.0]]))
    assert (state.tolist(), conditions.tolist()) == ([0.0], [[0.5], [3.0]])

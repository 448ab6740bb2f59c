"""The baselines against data that they describe exactly, and what they may not see."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import linear_data

from pipeline.identification.selection.baselines import METHODS, Cycles, baselines

OFFSETS = np.array([5.0, -3.0, 1.0])
PLAY, SPRING, KNEE, COULOMB, SHARE = 2.0, 0.3, 0.24, 0.8, 0.1


def measured():
    """Cells of a drive with play, a spring and friction, followed row by row, at three positions of other zeros."""
    data = linear_data(positions=3, cycles=2, branches=2, cells=60, sigma=0.05)
    unloading = np.linspace(12, -12, 60)
    torque = np.tile(np.concatenate([unloading[::-1], unloading]), 6)
    net, carried_torque = [], 0.0
    for k, load in enumerate(torque):
        carried_torque = 0.0 if k % 240 == 0 else carried_torque
        rising, falling = load - COULOMB, load + COULOMB  # T = c + Tc + mu |c| and T = c - Tc - mu |c|
        rising, falling = rising / (1 + SHARE * np.sign(rising)), falling / (1 - SHARE * np.sign(falling))
        carried_torque = min(max(carried_torque, rising), falling)
        net.append(carried_torque)
    net = np.array(net)
    angle = 0.5 * PLAY * np.sign(net) * (1 - np.exp(-np.abs(net) / KNEE)) + SPRING * net
    is_first_branch = np.isin(data.block, np.unique(data.block)[::4])  # the first branch of a position
    direction = np.where(data.block % 2 == 0, 1, -1)
    kind = np.where(is_first_branch, 0, np.where(direction > 0, 2, 1))
    return replace(data, torque=torque, angle=angle + OFFSETS[data.position]), Cycles(direction, kind)


def offsets(data):
    def of(angle, exact_unit, sigma):
        values = np.zeros(len(data))
        for position in range(3):
            in_position = data.position == position
            values[in_position] = np.nanmean((data.angle - angle)[in_position])
        return values

    return of


def folds(data):
    return [(data.position != position, data.position == position) for position in range(3)]


def test_a_drive_of_play_and_friction_is_predicted_by_the_baseline_of_its_form():
    data, cycles = measured()
    errors = baselines(data, cycles, folds(data), offsets(data))
    title = next(title for title in METHODS if title.startswith("play"))
    assert np.sqrt(np.mean((data.angle - errors[title]) ** 2)) < 0.02 * PLAY


def test_positions_that_repeat_each_other_are_replayed():
    data, cycles = measured()
    errors = baselines(data, cycles, folds(data), offsets(data))
    title = next(title for title in METHODS if title.startswith("replay"))
    np.testing.assert_allclose(errors[title], data.angle, atol=0.02)


def test_a_polynomial_is_fitted_by_the_polynomial():
    data, cycles = measured()
    shape = np.where(cycles.direction > 0, 0.02, -0.01) * data.torque**3 + 0.3 * data.torque
    data = replace(data, angle=shape + OFFSETS[data.position])
    title = next(title for title in METHODS if title.startswith("polynomial"))
    np.testing.assert_allclose(baselines(data, cycles, folds(data), offsets(data))[title], data.angle, atol=1e-6)


@pytest.mark.parametrize("title", METHODS)
def test_held_out_angles_move_a_prediction_by_its_offset_alone(title):
    data, cycles = measured()
    split = folds(data)[1:2]
    errors_before = baselines(data, cycles, split, offsets(data))[title]
    variant = replace(data, angle=np.where(data.position == 1, 1.4 * data.angle + data.torque, data.angle))
    errors_after = baselines(variant, cycles, split, offsets(variant))[title]
    in_position = data.position == 1
    assert np.ptp((errors_after - errors_before)[in_position]) < 1e-9

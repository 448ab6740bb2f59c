"""The baselines against data that they describe exactly, and what they may not see."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import linear_data

from pipeline.identification.selection.baselines import METHODS, Cycles, baselines

OFFSETS = np.array([5.0, -3.0, 1.0])
PLAY, SPRING, SOFTENING, COULOMB, SHARE = 2.0, 0.3, 0.01, 0.8, 0.1


def measured():
    """Cells of a drive with play, softening and friction, followed row by row, at three positions of other zeros."""
    data = linear_data(positions=3, cycles=2, branches=2, cells=60, sigma=0.05)
    down = np.linspace(12, -12, 60)
    torque = np.tile(np.concatenate([down[::-1], down]), 6)
    net, carried = [], 0.0
    for k, load in enumerate(torque):
        carried = 0.0 if k % 240 == 0 else carried
        half = COULOMB + SHARE * abs(load)
        carried = min(max(carried, load - half), load + half)
        net.append(carried)
    net = np.array(net)
    angle = 0.5 * PLAY * np.clip(net / 0.24, -1, 1) + SPRING * net + SOFTENING * net * np.abs(net)
    first = np.isin(data.block, np.unique(data.block)[::4])  # the first branch of a position
    direction = np.where(data.block % 2 == 0, 1, -1)
    kind = np.where(first, 0, np.where(direction > 0, 2, 1))
    return replace(data, torque=torque, angle=angle + OFFSETS[data.position]), Cycles(direction, kind)


def offsets(data):
    def of(angle, known, sigma):
        out = np.zeros(len(data))
        for position in range(3):
            mine = data.position == position
            out[mine] = np.nanmean((data.angle - angle)[mine])
        return out

    return of


def folds(data):
    return [(data.position != position, data.position == position) for position in range(3)]


def test_a_drive_of_play_and_friction_is_predicted_by_the_baseline_of_its_form():
    data, cycles = measured()
    found = baselines(data, cycles, folds(data), offsets(data))
    title = next(title for title in METHODS if title.startswith("play"))
    assert np.sqrt(np.mean((data.angle - found[title]) ** 2)) < 0.02 * PLAY


def test_positions_that_repeat_each_other_are_replayed():
    data, cycles = measured()
    found = baselines(data, cycles, folds(data), offsets(data))
    title = next(title for title in METHODS if title.startswith("replay"))
    np.testing.assert_allclose(found[title], data.angle, atol=0.02)


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
    before = baselines(data, cycles, split, offsets(data))[title]
    other = replace(data, angle=np.where(data.position == 1, 1.4 * data.angle + data.torque, data.angle))
    after = baselines(other, cycles, split, offsets(other))[title]
    mine = data.position == 1
    assert np.ptp((after - before)[mine]) < 1e-9

"""What of a misfit is expected to come again, against drawn processes and the covariance of their values."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of

from pipeline.identification.selection import carried_over
from pipeline.identification.selection.carried_over import expected_misfit
from pipeline.identification.selection.held_out import _angle_with_systematic_part

N_POSITIONS = 6
LEVELS = np.linspace(-12, 12, 16)
TORQUE = np.tile(LEVELS, 2 * N_POSITIONS)
SENSE = np.tile(np.repeat([1.0, -1.0], len(LEVELS)), N_POSITIONS)
POSITION = np.repeat(np.arange(N_POSITIONS), 2 * len(LEVELS))
SIGMA = np.full(len(TORQUE), 0.1)
SIZE, REACH = 2.0, 3.0


def covariance(share: float) -> np.ndarray:
    correlation = np.exp(-0.5 * ((TORQUE[:, None] - TORQUE) / REACH) ** 2) * (SENSE[:, None] == SENSE)
    return SIZE**2 * correlation * (share + (1 - share) * (POSITION[:, None] == POSITION))


@cache
def root(share: float) -> np.ndarray:
    """A square root of the covariance."""
    values, vectors = np.linalg.eigh(covariance(share))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def drawn(share: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return root(share) @ rng.standard_normal(len(TORQUE)) + SIGMA * rng.standard_normal(len(TORQUE))


def errors(share: float, trained: int, seeds=range(80)) -> np.ndarray:
    """Mean squares (3,) at positions not trained on, of no misfit: nothing, what is expected, a replay."""
    losses = []
    for seed in seeds:
        misfit = drawn(share, seed)
        training = np.less(POSITION, trained)
        expected = expected_misfit(TORQUE, SENSE, POSITION, misfit, SIGMA, training)
        replay = misfit[training].reshape(trained, -1).mean(axis=0)
        for number in range(trained, N_POSITIONS):
            judged = np.equal(POSITION, number)
            curves = (np.zeros_like(replay), expected.mean[judged], replay)
            losses.append([np.var(misfit[judged] - curve) for curve in curves])
    return np.mean(losses, axis=0)


@pytest.mark.parametrize("share", [*(pytest.param(share, marks=pytest.mark.attack) for share in (0.3, 0.7)), 0.5])
@pytest.mark.long
def test_half_of_a_single_position_is_better_than_none_of_it_and_than_all_of_it(share):
    nothing, expected, replay = errors(share, trained=1)
    assert expected < min(nothing, replay)
    assert expected / nothing == pytest.approx(1.25 - share, rel=0.08)
    assert replay / nothing == pytest.approx(2 * (1 - share), rel=0.1)


@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.attack), 0.5, 1.0])
@pytest.mark.long
def test_several_positions_tell_the_share(share):
    nothing, expected, replay = errors(share, trained=4, seeds=range(6))
    assert expected < 1.05 * min(nothing, replay) + SIGMA[0] ** 2
    shares = [
        expected_misfit(TORQUE, SENSE, POSITION, drawn(share, seed), SIGMA, POSITION < 4).common_share
        for seed in range(6)
    ]
    assert np.mean(shares) == pytest.approx(np.clip(share, 0.1, 0.9), abs=0.15)


def test_a_process_of_known_numbers_has_the_mean_and_variance_of_its_normal_distribution(monkeypatch):
    share, training, misfit = 0.3, POSITION < 2, drawn(0.3, 1)
    sigma = SIGMA * np.where(np.arange(len(TORQUE)) % 3, 1.0, 2.0)
    monkeypatch.setattr(carried_over, "SHARES", (share,))
    monkeypatch.setattr(carried_over, "SIZES", (SIZE / SIGMA[0],) * 2)
    monkeypatch.setattr(carried_over, "REACHES", (REACH / 12,) * 2)
    monkeypatch.setattr(carried_over, "SIZES_TRIED", 1)
    monkeypatch.setattr(carried_over, "REACHES_TRIED", 1)
    expected = expected_misfit(TORQUE, SENSE, POSITION, misfit, sigma, training)
    of_all = covariance(share)
    wide = 1e5 * (POSITION[:, None] == POSITION)  # a flat prior of each position's zero
    inverse = np.linalg.inv((of_all + wide)[np.ix_(training, training)] + np.diag(sigma[training] ** 2))
    zeros = (POSITION[training, None] == np.arange(2)).astype(float)
    solved = np.linalg.inv(of_all[np.ix_(training, training)] + np.diag(sigma[training] ** 2))
    levels = np.linalg.solve(zeros.T @ solved @ zeros, zeros.T @ solved @ misfit[training])
    weights = of_all[:, training] @ solved
    np.testing.assert_allclose(expected.mean, weights @ (misfit[training] - zeros @ levels), atol=1e-6)
    np.testing.assert_allclose(
        weights @ (misfit[training] - zeros @ levels), of_all[:, training] @ inverse @ misfit[training], atol=1e-3
    )
    variance = SIZE**2 - np.einsum("ij,ji->i", weights, of_all[training])
    np.testing.assert_allclose(expected.deviation**2, variance, atol=1e-6)


def test_noise_alone_carries_nothing_over():
    noise = SIGMA * np.random.default_rng(2).standard_normal(len(TORQUE))
    expected = expected_misfit(TORQUE, SENSE, POSITION, noise, SIGMA, POSITION < 3)
    assert np.sqrt(np.mean(expected.mean**2)) < 0.3 * SIGMA[0]


def test_cells_that_are_held_out_are_not_read():
    misfit, training = drawn(0.5, 3), POSITION < 2
    stretched = np.where(training, misfit, np.nan)
    noise = np.where(training, SIGMA, np.nan)
    reference = expected_misfit(TORQUE, SENSE, POSITION, misfit, SIGMA, training)
    assert np.array_equal(expected_misfit(TORQUE, SENSE, POSITION, stretched, noise, training).mean, reference.mean)


def test_a_held_out_position_gets_half_of_what_the_trained_one_misses_about_a_zero_of_its_own():
    """The second position has the first one's misfit at the upper half of its torques, five arcmin off."""
    data = linear_data(positions=2, cycles=2, branches=2, cells=40)
    rising = np.linspace(-12, 12, 40)
    torque = np.concatenate([np.tile([rising, -rising], (2, 1)), np.tile([6 + rising / 2, 6 - rising / 2], (2, 1))])
    misfit = 0.5 * torque.ravel() + 4 * np.sin(torque.ravel() / 4)
    design = np.random.default_rng(5).normal(size=(len(data), 1))
    trained = np.equal(data.position, 0)
    angle = 0.5 * design[:, 0] + misfit + np.where(trained, 0.0, 5.0)
    data = replace(data, torque=torque.ravel(), angle=angle)
    fitter = LinearFitter(data, design)
    fit = fitter.fit(model_of(1), trained, fitter.start(model_of(1), [0.4]))
    prediction, deviation, share = _angle_with_systematic_part(fitter, fit, trained)
    error = (data.angle - prediction)[~trained]
    assert abs(np.mean(error)) < 1e-9
    assert share == pytest.approx(0.5, abs=0.01)
    unaided = (data.angle - fit.predicted_angle)[~trained]
    assert np.std(error) / np.std(unaided) == pytest.approx(0.5, abs=0.1)
    assert 0.3 < np.sqrt(np.mean(error**2) / np.mean(deviation[~trained] ** 2)) < 3

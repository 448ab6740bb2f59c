"""Losses of cells that a fit has not seen: identities of the Gaussian distribution on a linear unit."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of, stood

from pipeline.identification.fitting.fitter import OPEN_SHARE
from pipeline.identification.fitting.parameters import Vector
from pipeline.identification.selection.cross_validation import (
    FAILED,
    LEAST_LOSS,
    Trial,
    block_losses,
    trial,
)
from pipeline.identification.selection.held_out import splits_of

DATA = linear_data(positions=3, cells=6)
TIGHT = (0.05, 0.2)
"""Prior standard deviations of the scales, below ``OPEN_SHARE``."""


def unit(seed=0, spread=TIGHT, n_modes=0, sigma=None):
    """A fitter of two scales, two shares and some modes; a fit of it that stands beside the truth."""
    rng = np.random.default_rng(seed)
    sigma = rng.uniform(0.05, 0.5, len(DATA)) if sigma is None else sigma
    design = rng.normal(size=(len(DATA), len(spread) + 2 + n_modes))
    data = replace(DATA, sigma=sigma, angle=rng.normal(0, 0.8, len(DATA)))
    fitter = LinearFitter(data, design, spread, n_modes)
    shares = np.array([0.4, 0.7])
    unknowns = Vector(0.03 * rng.normal(size=len(spread)), shares, 0.3 * rng.normal(size=n_modes))
    return fitter, stood(fitter, model_of(2), unknowns, sigma)


def dense(fitter, fit, prior, is_left_out):
    """Mahalanobis distance per cell of the cells left out, and their mean given all but the modes, by dense algebra.

    The fold's optimum is that of the linear problem itself.
    """
    data, visible, jacobian = fitter.problem.data, ~is_left_out, fit.jacobian
    offsets = (data.position[:, None] == np.unique(data.position)).astype(float)
    design = np.column_stack([jacobian, offsets])
    precision = np.diag(np.concatenate([prior**-2.0, np.full(offsets.shape[1], 1e-6)]))
    current = np.concatenate([fit.unknowns.flat, np.zeros(offsets.shape[1])])
    offsets_away = fit.unknowns.flat - fitter.centre(fit.model, fit.unknowns)
    pull = np.concatenate([fitter.penalty(fit.unknowns) ** 2 * offsets_away, np.zeros(offsets.shape[1])])
    weighted = design[visible].T / data.sigma[visible] ** 2
    covariance = np.linalg.inv(weighted @ design[visible] + precision)
    residual = data.angle - fit.predicted
    step = covariance @ (weighted @ residual[visible] - pull)
    residuals = (residual - design @ step)[is_left_out]
    spread = design[is_left_out] @ covariance @ design[is_left_out].T
    expected_losses = np.linalg.solve(np.diag(data.sigma[is_left_out] ** 2) + spread, residuals)
    assert len(current) == len(step)
    return residuals @ expected_losses / is_left_out.sum()


@pytest.mark.parametrize(
    ("positions", "lots"), [(2, [[0], [1]]), (6, [[k] for k in range(6)]), (7, [[0, 3, 6], [1, 4], [2, 5]])]
)
def test_many_positions_are_left_out_in_lots_that_hold_each_once(positions, lots):
    data = linear_data(positions=positions, cells=6)
    everything = np.ones(len(data), bool)
    splits = splits_of(data, everything)
    assert [np.unique(data.position[judged]).tolist() for _, judged in splits] == lots
    assert all(np.array_equal(training, ~judged) for training, judged in splits)
    first = data.position == 0
    assert [mask.tolist() for mask in splits_of(data, first)[0]] == [first.tolist(), (~first).tolist()]


@pytest.mark.parametrize("n_modes", [0, 2])
@pytest.mark.parametrize("seed", range(3))
def test_losses_are_the_mahalanobis_distance_under_the_covariance_of_the_prediction(seed, n_modes):
    """At the optimum of all cells, each position left out in turn."""
    fitter, start = unit(seed, n_modes=n_modes)
    data = fitter.problem.data
    noise = 0.3 * data.sigma * np.random.default_rng(seed).standard_normal(len(data))
    fitter = LinearFitter(replace(data, angle=start.predicted + noise), fitter.design, TIGHT, n_modes)
    all_cells = np.ones(len(DATA), bool)
    fit = fitter.fit(start.model, all_cells, start.unknowns)
    trial_result = trial(fitter, fit, all_cells)
    prior = np.concatenate([TIGHT, [OPEN_SHARE] * 2, np.ones(n_modes)])
    for position in range(3):
        is_held_out = DATA.position == position
        own_cells = [
            k for k, block in enumerate(np.unique(DATA.block)) if DATA.position[DATA.block == block][0] == position
        ]
        counts = np.array([(DATA.block == block).sum() for block in np.unique(DATA.block)])[own_cells]
        selection = np.average(trial_result.losses[own_cells], weights=counts)
        assert selection == pytest.approx(dense(fitter, fit, prior, is_held_out), rel=2e-2)


def test_losses_are_means_by_block_and_a_failed_cell_counts_as_far():
    data = linear_data(positions=2, cycles=1, branches=2, cells=2, sigma=0.5)
    data = replace(data, angle=np.array([1.0, 2.0, 3.0, 4.0, 9.0, 9.0, 0.0, 0.0]))
    predicted = np.array([1.0, 2.5, 3.0, 4.0, 9.0, np.nan, 1.0, -1.0])
    strain = np.array([0.0, 0.0, 3.0, 1.0, 0.0, 7.0, 0.0, 0.0])
    cells = np.ones(8, bool)
    np.testing.assert_allclose(block_losses(data, predicted, strain, cells), [0.5, 2.0, FAILED**2 / 2, 4.0])
    np.testing.assert_allclose(block_losses(data, predicted, strain, data.position == 1), [FAILED**2 / 2, 4.0])
    trial_result = Trial(None, np.array([0.5, 1.5]))
    assert trial_result.rms == pytest.approx(1.0)
    np.testing.assert_allclose(trial_result.scores, np.log([0.5 + LEAST_LOSS, 1.5 + LEAST_LOSS]))


def test_losses_of_the_true_model_are_one_and_those_of_too_small_a_model_are_not():
    """Expected square of a residual under the covariance of its prediction: 1, if nothing but noise is left."""
    data, result = linear_data(positions=3, cells=12), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        design = rng.normal(size=(len(data), 2))
        angle = design @ [0.3, 0.6] + np.array([5.0, -3.0, 1.0])[data.position] + 0.1 * rng.normal(size=len(data))
        all_cells = np.ones(len(data), bool)
        losses_found = []
        for columns in (2, 1):
            fitter = LinearFitter(replace(data, angle=angle), design[:, :columns])
            model = model_of(columns)
            fit = fitter.fit(model, all_cells, fitter.start(model))
            trial_result = trial(fitter, fit, all_cells)
            losses_found.append(trial_result.rms)
        result.append(losses_found)
    right, wrong = np.mean(result, axis=0)
    assert right == pytest.approx(1.0, abs=0.05)
    assert wrong > 4.0

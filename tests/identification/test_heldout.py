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


def dense(fitter, fit, prior, out):
    """Mahalanobis distance per cell of the cells left out, and their mean given all but the modes, by dense algebra.

    The fold's optimum is that of the linear problem itself.
    """
    data, seen, jacobian = fitter.problem.data, ~out, fit.jacobian
    offsets = (data.position[:, None] == np.unique(data.position)).astype(float)
    design = np.column_stack([jacobian, offsets])
    precision = np.diag(np.concatenate([prior**-2.0, np.full(offsets.shape[1], 1e-6)]))
    now = np.concatenate([fit.unknowns.flat, np.zeros(offsets.shape[1])])
    away = fit.unknowns.flat - fitter.centre(fit.model, fit.unknowns)
    pull = np.concatenate([fitter.penalty(fit.unknowns) ** 2 * away, np.zeros(offsets.shape[1])])
    weighted = design[seen].T / data.sigma[seen] ** 2
    covariance = np.linalg.inv(weighted @ design[seen] + precision)
    residual = data.angle - fit.predicted
    moved = covariance @ (weighted @ residual[seen] - pull)
    left = (residual - design @ moved)[out]
    spread = design[out] @ covariance @ design[out].T
    known = np.linalg.solve(np.diag(data.sigma[out] ** 2) + spread, left)
    assert len(now) == len(moved)
    return left @ known / out.sum()


@pytest.mark.parametrize("n_modes", [0, 2])
@pytest.mark.parametrize("seed", range(3))
def test_losses_are_the_mahalanobis_distance_under_the_covariance_of_the_prediction(seed, n_modes):
    """At the optimum of all cells, each position left out in turn."""
    fitter, start = unit(seed, n_modes=n_modes)
    data = fitter.problem.data
    noise = 0.3 * data.sigma * np.random.default_rng(seed).standard_normal(len(data))
    fitter = LinearFitter(replace(data, angle=start.predicted + noise), fitter.design, TIGHT, n_modes)
    everything = np.ones(len(DATA), bool)
    fit = fitter.fit(start.model, everything, start.unknowns)
    judged = trial(fitter, fit, everything)
    prior = np.concatenate([TIGHT, [OPEN_SHARE] * 2, np.ones(n_modes)])
    for position in range(3):
        out = DATA.position == position
        mine = [k for k, block in enumerate(np.unique(DATA.block)) if DATA.position[DATA.block == block][0] == position]
        counts = np.array([(DATA.block == block).sum() for block in np.unique(DATA.block)])[mine]
        found = np.average(judged.losses[mine], weights=counts)
        assert found == pytest.approx(dense(fitter, fit, prior, out), rel=2e-2)


def test_losses_are_means_by_block_and_a_failed_cell_counts_as_far():
    data = linear_data(positions=2, cycles=1, branches=2, cells=2, sigma=0.5)
    data = replace(data, angle=np.array([1.0, 2.0, 3.0, 4.0, 9.0, 9.0, 0.0, 0.0]))
    predicted = np.array([1.0, 2.5, 3.0, 4.0, 9.0, np.nan, 1.0, -1.0])
    strain = np.array([0.0, 0.0, 3.0, 1.0, 0.0, 7.0, 0.0, 0.0])
    cells = np.ones(8, bool)
    np.testing.assert_allclose(block_losses(data, predicted, strain, cells), [0.5, 2.0, FAILED**2 / 2, 4.0])
    np.testing.assert_allclose(block_losses(data, predicted, strain, data.position == 1), [FAILED**2 / 2, 4.0])
    judged = Trial(None, np.array([0.5, 1.5]))
    assert judged.rms == pytest.approx(1.0)
    np.testing.assert_allclose(judged.scores, np.log([0.5 + LEAST_LOSS, 1.5 + LEAST_LOSS]))


def test_losses_of_the_true_model_are_one_and_those_of_too_small_a_model_are_not():
    """Expected square of a residual under the covariance of its prediction: 1, if nothing but noise is left."""
    data, found = linear_data(positions=3, cells=12), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        design = rng.normal(size=(len(data), 2))
        angle = design @ [0.3, 0.6] + np.array([5.0, -3.0, 1.0])[data.position] + 0.1 * rng.normal(size=len(data))
        everything = np.ones(len(data), bool)
        one = []
        for columns in (2, 1):
            fitter = LinearFitter(replace(data, angle=angle), design[:, :columns])
            model = model_of(columns)
            fit = fitter.fit(model, everything, fitter.start(model))
            judged = trial(fitter, fit, everything)
            one.append(judged.rms)
        found.append(one)
    right, wrong = np.mean(found, axis=0)
    assert right == pytest.approx(1.0, abs=0.05)
    assert wrong > 4.0

"""Descent of one fit on a linear unit: what the form of the model misses, steps, bounds, stale derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of, stood
from scipy.optimize import lsq_linear

from pipeline.identification.fitting.fitter import OPEN_SHARE
from pipeline.identification.fitting.least_squares import FIRST_DAMPING, damped_step
from pipeline.identification.fitting.parameters import Vector

SIGMA = 0.1


def everything(data):
    return np.ones(len(data), bool)


def missing(data, size):
    """Data with residuals of ``size`` sigmas in turn up and down, which no offset takes up."""
    return replace(data, angle=size * data.sigma * (-1.0) ** np.arange(len(data)))


def fit_of_form(data):
    """A fit whose one parameter changes nothing."""
    fitter = LinearFitter(data, np.zeros((len(data), 1)))
    return fitter.fit(model_of(1), everything(data), fitter.start(model_of(1)))


@pytest.mark.parametrize("size", [1.5, 4.0, 30.0])
def test_form_of_the_model_makes_the_mean_square_one(size):
    data = missing(linear_data(cycles=1, sigma=SIGMA), size)
    fit = fit_of_form(data)
    np.testing.assert_allclose(fit.sigma, size * SIGMA, rtol=1e-6)
    assert fit.cost == pytest.approx(len(data) * size**2)  # in sigmas of the noise alone


@pytest.mark.parametrize("cycles", [2, 5])
def test_repeated_branches_count_once(cycles):
    data = missing(linear_data(cycles=cycles, sigma=SIGMA), 4.0)
    np.testing.assert_allclose(fit_of_form(data).sigma ** 2, SIGMA**2 * (1 + cycles * 15.0), rtol=1e-6)


def test_only_the_cycles_fitted_are_repeats():
    data = missing(linear_data(positions=1, cycles=4, sigma=SIGMA), 4.0)
    fitter = LinearFitter(data, np.zeros((len(data), 1)))
    fit = fitter.fit(model_of(1), data.cycle < 2, fitter.start(model_of(1)))
    np.testing.assert_allclose(fit.sigma[data.cycle < 2] ** 2, SIGMA**2 * (1 + 2 * 15.0), rtol=1e-6)


def test_form_is_the_same_for_every_row_of_the_cells():
    rng = np.random.default_rng(0)
    count = rng.integers(3, 40, 40)
    data = missing(linear_data(cycles=1, sigma=rng.uniform(0.5, 2, 40) * SIGMA, count=count), 3.0)
    fit = fit_of_form(data)
    form = (fit.sigma**2 - data.sigma**2) * count
    np.testing.assert_allclose(form, form[0], rtol=1e-9)
    fitter = LinearFitter(data, np.zeros((40, 1)))
    residual = (data.angle - fitter.offsets(np.zeros(40), everything(data), fit.sigma)) / fit.sigma
    assert np.mean(residual**2) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("size", [0.2, 1.0])
def test_a_model_within_the_noise_misses_nothing(size):
    data = missing(linear_data(cycles=3, sigma=SIGMA), size)
    np.testing.assert_array_equal(fit_of_form(data).sigma, data.sigma)


def orthogonal(data, columns, seed=0):
    """Design (n_cells, columns) of orthonormal columns without a mean over any position."""
    values = np.random.default_rng(seed).normal(size=(len(data), columns))
    for item in np.unique(data.position):
        values[data.position == item] -= values[data.position == item].mean(axis=0)
    return np.linalg.qr(values)[0]


def test_one_step_solves_a_linear_problem_but_for_its_damping():
    data = linear_data(sigma=1e-4)  # beside which the prior of the parameters is nothing
    design, truth = orthogonal(data, 2), np.array([0.8, 0.3])
    fitter = LinearFitter(replace(data, angle=design @ truth + np.array([3.0, -40.0])[data.position]), design)
    start = fitter.start(model_of(2), [0.5, 0.5])
    fit = fitter.fit(model_of(2), everything(data), start, 1)
    precision, prior = 1 / fit.sigma[0] ** 2, 1 / OPEN_SHARE**2
    step = (precision * (truth - 0.5) - prior * 0.5) / ((precision + prior) * (1 + FIRST_DAMPING))
    np.testing.assert_allclose(fit.unknowns.shares, 0.5 + step, rtol=1e-6)
    settled = fitter.fit(model_of(2), everything(data), start)
    np.testing.assert_allclose(settled.values, truth, atol=1e-6)
    np.testing.assert_allclose(settled.predicted_angle, fitter.problem.data.angle, atol=1e-6)


def test_scales_parameters_and_modes_settle_at_the_optimum_with_their_priors():
    data, spread = linear_data(sigma=SIGMA), np.array([1.1, 0.05])
    rng = np.random.default_rng(1)
    design = rng.normal(size=(len(data), 5)) * [1.0, 1.0, 1.0, 0.02, 0.02]
    truth = np.array([0.3, -0.1, 0.6, 1.0, -1.5])
    angle = design @ truth + 5.0 * data.position + 0.7 * SIGMA * rng.normal(size=len(data))
    fitter = LinearFitter(replace(data, angle=angle), design, spread, n_modes=2)
    fit = fitter.fit(model_of(1), everything(data), fitter.start(model_of(1)))
    np.testing.assert_array_equal(fit.sigma, data.sigma)
    offsets = (data.position[:, None] == [0, 1]).astype(float)
    rows = np.vstack([np.hstack([design, offsets]) / SIGMA, np.diag([*(1 / spread), 1 / OPEN_SHARE, 1, 1, 0, 0])])
    right = np.concatenate([angle / SIGMA, np.zeros(7)])
    best = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(fit.unknowns.flat, best[:5], atol=2e-3)
    minimum = np.sum((rows @ best - right) ** 2)
    assert minimum * (1 - 1e-12) <= fit.cost < minimum + 1e-3


def test_an_unknown_at_its_bound_stays_there_and_the_others_settle_beside_it():
    data = linear_data(sigma=SIGMA)
    values = np.random.default_rng(3).normal(size=(len(data), 2)) @ [[1.0, 0.6], [0.0, 0.8]]  # correlated
    for item in (0, 1):
        values[data.position == item] -= values[data.position == item].mean(axis=0)
    angle = values @ [1.4, 0.2]
    fitter = LinearFitter(replace(data, angle=angle), values)
    for start_share in (0.5, 1.0):
        fit = fitter.fit(model_of(2), everything(data), fitter.start(model_of(2), [start_share, 0.9]))
        rows = np.vstack([values / fit.sigma[:, None], np.eye(2) / OPEN_SHARE])
        bounded = lsq_linear(rows, np.append(angle / fit.sigma, [0.0, 0.0]), (0.0, 1.0)).x
        assert bounded[0] == pytest.approx(1.0)
        assert bounded[1] > 0.3
        assert fit.unknowns.shares[0] == 1.0
        assert fit.unknowns.shares[1] == pytest.approx(bounded[1], abs=1e-3)
    precise = replace(data, sigma=1e-3 * data.sigma)
    inward = LinearFitter(replace(precise, angle=values @ [0.4, 0.2]), values)
    fit = inward.fit(model_of(2), everything(data), inward.start(model_of(2), [1.0, 0.0]))
    np.testing.assert_allclose(fit.values, [0.4, 0.2], atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_step_that_meets_bounds_is_the_best_within_them(seed):
    rng = np.random.default_rng(seed)
    rows, right = rng.normal(size=(30, 4)) @ rng.normal(size=(4, 4)), rng.normal(size=30)
    low, high = -np.array([0.02, 0.5, 10.0, 10.0]), np.array([0.02, 0.5, 10.0, 10.0])
    step = damped_step(rows.T @ rows, rows.T @ right, np.ones(4, bool), 0.0, (low, high))
    best = lsq_linear(rows, right, (low, high), tol=1e-12).x
    assert np.any(np.isin(best.round(6), [-0.02, 0.02]))
    np.testing.assert_allclose(step, best, atol=1e-6)


def test_bounds_that_are_met_do_not_end_the_way():
    """Two tolerances that would go far beyond what a drawing allows, and a scale that must follow them there."""
    data = linear_data(sigma=SIGMA)
    design = 0.5 * orthogonal(data, 3) @ np.array([[1.0, 0.9, 0.9], [0.0, 0.5, 0.1], [0.0, 0.0, 0.5]])
    fitter = LinearFitter(replace(data, angle=design @ [2.0, 9.0, -9.0]), design, (10.0,), n_modes=2)
    fit = fitter.fit(model_of(0), everything(data), fitter.start(model_of(0)))
    assert np.all(np.abs(fit.unknowns.modes) <= 3.0)
    rows = design / fit.sigma[:, None]
    penalty = np.diag([0.1, 1.0, 1.0])
    best = lsq_linear(
        np.vstack([rows, penalty]),
        np.concatenate([fitter.problem.data.angle / fit.sigma, np.zeros(3)]),
        ([-4.4, -3, -3], [4.4, 3, 3]),
        tol=1e-12,
    ).x
    np.testing.assert_allclose(fit.unknowns.flat, best, atol=0.02)


def test_a_fit_that_stands_at_its_optimum_predicts_nothing_more():
    data = linear_data(sigma=SIGMA)
    design = 5 * orthogonal(data, 2)
    fitter = LinearFitter(replace(data, angle=design @ [0.8, 0.3]), design)
    fit = fitter.fit(model_of(2), everything(data), fitter.start(model_of(2), [0.5, 0.5]))
    fitter.looks = 0
    fitter.fit(model_of(2), everything(data), fit.unknowns)
    assert fitter.looks == 1 + 2  # as it stands, and by each parameter


def stale_unit(change):
    """A unit of one scale; a fit of it before anything is known, its derivatives ``change`` times the right ones."""
    data = linear_data(sigma=SIGMA)
    design = 5 * orthogonal(data, 1)
    fitter = LinearFitter(replace(data, angle=0.04 * design[:, 0]), design, (10.0,))
    bare_model = model_of(0)
    base_fit = stood(fitter, bare_model, Vector(np.zeros(1), np.zeros(0), np.zeros(0)), data.sigma)
    fitter.looks = 0
    return fitter, replace(base_fit, jacobian=change * design)


@pytest.mark.parametrize("change", [-1.0, 1.0])
def test_stale_derivatives_that_lead_nowhere_are_taken_anew(change):
    fitter, stale_fit = stale_unit(change)
    fit = fitter.fit(stale_fit.model, everything(fitter.problem.data), stale_fit.unknowns, base_fit=stale_fit)
    assert fit.unknowns.scales[0] == pytest.approx(0.04, rel=1e-2)
    np.testing.assert_allclose(fit.jacobian, fitter.design, atol=1e-6)


def test_derivatives_are_kept_while_scales_hardly_move():
    fitter, stale_fit = stale_unit(0.9)
    fitter.fit(stale_fit.model, everything(fitter.problem.data), stale_fit.unknowns, 1, stale_fit)
    looks_before = fitter.looks
    fitter, stale_fit = stale_unit(0.9)
    fitter.fit(stale_fit.model, everything(fitter.problem.data), stale_fit.unknowns, 1)
    assert fitter.looks > looks_before

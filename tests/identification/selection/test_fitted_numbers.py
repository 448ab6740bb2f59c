"""Intervals of fitted parameters, refitted numbers, and how likely fitted tolerances are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_problem import BOUNDS, fitter_at
from scipy.stats import chi2, halfnorm, norm

from pipeline.identification.fitting.parameters import Vector
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection.criteria import FORM, Trial
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.fitted_numbers import calibrated_numbers, intervals, refit_with_free_numbers

COULOMB = Model((candidates()["coulomb"],))
WIDTH = BOUNDS[1] - BOUNDS[0]


def estimated(truth, deviation=0.01, bounds=None):
    """The interval of one parameter, its standard deviation as a share of its bounds."""
    fitter = fitter_at(truth)
    fitter.bounds = lambda model: bounds or [BOUNDS] * model.n_parameters
    fit = fitter.fit(COULOMB)
    return intervals(fitter, Trial(fit, SimpleNamespace(deviations=np.array([1.0, deviation])), 1.0))[0]


@pytest.mark.parametrize("truth", [2.0, -1.5])
def test_an_interval_holds_the_posterior_and_what_the_form_of_the_model_may_miss(truth):
    result = estimated(truth)
    half = norm.ppf(0.975) * np.hypot(0.01 * WIDTH, FORM * result.value)
    assert result.ci_high - result.value == pytest.approx(half, rel=1e-6)
    assert result.value - result.ci_low == pytest.approx(half, rel=1e-6)


def test_the_interval_of_a_size_that_cannot_be_negative_never_reaches_zero():
    result = estimated(-3.8, deviation=0.012, bounds=[(0.0, 10.0)])
    assert 0 < result.ci_low < result.value
    assert result.ci_high / result.value == pytest.approx(result.value / result.ci_low, rel=1e-6)


@pytest.mark.parametrize("truth", [0.2, -0.2])
def test_the_interval_of_the_only_size_of_an_effect_never_reaches_zero(truth):
    """Of a size of either sign, too: its effect would not be named if zero were possible."""
    result = estimated(truth, deviation=0.03)
    near, far = sorted((result.ci_low, result.ci_high), key=abs)
    assert far - result.value == pytest.approx(np.sign(truth) * norm.ppf(0.975) * 0.03 * WIDTH, rel=1e-3)
    assert near / result.value == pytest.approx(np.exp(1 - far / result.value), rel=1e-6)


def test_one_of_two_sizes_of_an_effect_may_be_zero():
    bounds, unknowns = [(0.0, 0.5)] * 2, Vector(np.zeros(0), np.array([0.02, 0.4]), np.zeros(0))
    fit = SimpleNamespace(model=Model((candidates()["directional_load_friction"],)), unknowns=unknowns)
    trial = Trial(fit, SimpleNamespace(deviations=np.array([0.05, 0.05])), 1.0)
    loading, unloading = intervals(SimpleNamespace(bounds=lambda model: bounds), trial)
    assert loading.ci_low == 0.0
    assert loading.ci_high == pytest.approx(0.5 * (0.02 + norm.ppf(0.975) * 0.05), rel=1e-3)
    assert 0.1 < unloading.ci_low < 0.2


def test_a_size_that_cannot_be_negative_and_is_zero_has_an_interval_from_zero_up():
    bounds, unknowns = [(0.0, 0.5)] * 2, Vector(np.zeros(0), np.array([0.0, 0.4]), np.zeros(0))
    fit = SimpleNamespace(model=Model((candidates()["directional_load_friction"],)), unknowns=unknowns)
    trial = Trial(fit, SimpleNamespace(deviations=np.array([0.05, 0.05])), 1.0)
    loading, _ = intervals(SimpleNamespace(bounds=lambda model: bounds), trial)
    assert (loading.value, loading.ci_low, loading.note) == (0.0, 0.0, "")
    assert loading.ci_high == pytest.approx(0.5 * halfnorm.ppf(0.95, scale=0.05), rel=1e-6)


def test_an_interval_reaches_over_other_solutions_that_are_nearly_as_probable():
    near, far = (estimated(truth) for truth in (2.0, 3.0))
    fitter, evidence = fitter_at(2.0), SimpleNamespace(deviations=np.array([1.0, 0.01]))
    trials = [Trial(fitter_at(truth).fit(COULOMB), evidence, 1.0) for truth in (2.0, 3.0)]
    (result,) = intervals(fitter, replace(trials[0], other_solutions=(trials[1],)))
    assert (result.value, result.ci_low, result.ci_high) == pytest.approx((near.value, near.ci_low, far.ci_high))


def test_a_parameter_at_its_bound_has_no_interval_and_says_so():
    result = estimated(9.0)
    assert result.value == BOUNDS[1]
    assert np.isnan(result.ci_low)
    assert "bound" in result.note


def number(scale, deviation, reach=2.0):
    fitter = fitter_at(1.0)
    scales = Vector(np.array([scale]), np.zeros(0), np.zeros(0), np.array([[-reach], [reach]]))
    evidence = SimpleNamespace(deviations=np.array([deviation]), unknowns=(np.zeros(1), np.eye(1)))
    (result,) = calibrated_numbers(fitter, SimpleNamespace(unknowns=scales), evidence)
    return result


def test_a_refitted_number_is_a_factor_with_its_interval():
    result = number(np.log(1.2), 0.1)
    assert result.factor == pytest.approx(1.2)
    assert result.ci_high == pytest.approx(1.2 * np.exp(norm.ppf(0.975) * 0.1))
    assert (result.leaves, result.note) == (False, "")
    assert "its range alone holds it" in number(0.0, 0.8).note
    assert number(2.0, 0.1).leaves


def test_numbers_are_released_only_from_the_ends_of_their_ranges():
    refits = []
    fitter = SimpleNamespace(
        fit=lambda model, cells, start: refits.append(start) or SimpleNamespace(sound=True, cost=1.0)
    )
    for scale, released_range in ((0.5, False), (2.0, True)):
        unknowns = Vector(np.array([scale]), np.zeros(0), np.zeros(0), np.array([[-2.0], [2.0]]))
        refit = refit_with_free_numbers(fitter, SimpleNamespace(model=None, unknowns=unknowns), None)
        assert (refit is not None) == released_range
    assert refits[0].reach.tolist() == [[-4.4], [4.4]]


@pytest.mark.parametrize("modes", [[0.0, 0.0], [1.5, -1.0], [5.0, 4.0]])
def test_tolerances_are_as_likely_as_the_chi_square_of_their_posterior_mean(modes):
    def share(n_modes):
        fit = SimpleNamespace(unknowns=SimpleNamespace(modes=np.ones(n_modes)))
        evidence = SimpleNamespace(fit=fit, unknowns=(np.array([7.0, *modes]), None))
        return Evidence.tolerance_share.fget(evidence)

    assert share(2) == pytest.approx(chi2.sf(np.sum(np.square(modes)), 2))
    assert share(0) == 1.0


def test_scales_within_a_thousandth_of_an_end_stand_at_it():
    scales, reach = np.array([1.0, 1.5, 500.0, 998.5, 999.0]), np.array([[0.0], [1000.0]])
    vector = Vector(scales, np.zeros(0), np.zeros(0), reach)
    assert vector.at_reach.tolist() == [True, False, False, False, True]

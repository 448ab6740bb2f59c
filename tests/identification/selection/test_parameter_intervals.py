"""Cover of the intervals of a linear problem, and parameters that support no claim."""

import numpy as np
import pytest
from linear_problem import BLOCKS, BOUNDS, CELLS, EVERYTHING, LinearFitter, fitter_at
from scipy.stats import norm
from scipy.stats import t as student

from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection import parameter_intervals
from pipeline.identification.selection.parameter_intervals import (
    CONFIDENCE,
    FORM,
    STRUCTURE,
    _positive,
    determined,
    intervals,
    unsupported,
)

COULOMB = Model((candidates()["coulomb"],))


DRAWS = 2000
"""Linear problems drawn: their share of cover is known to 0.5 %, so that intervals of 0.92 times the width are seen."""


def covered(problem, truth: float) -> tuple[float, float]:
    """Share of drawn problems whose interval holds the truth, and the mean width."""
    results = []
    for seed in range(DRAWS):
        fitter = problem(seed)
        results += intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
    assert all(result.ci_low < result.value < result.ci_high for result in results)
    share = np.mean([result.ci_low <= truth <= result.ci_high for result in results])
    return float(share), float(np.mean([result.ci_high - result.ci_low for result in results]))


@pytest.mark.parametrize("truth", [2.0, -1.5])
def test_intervals_cover_the_truth_as_often_as_they_say(truth, monkeypatch):
    """In closed form: Student's t of 24 branches times the error of least squares, cells of a branch being alike.

    Branches have leverages of their own, so that the degrees of freedom are fewer than 23: cover of 94 to 95 %.
    """
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)  # the form of this model is right
    share, width = covered(lambda seed: fitter_at(truth, seed=seed), truth)
    assert 0.935 < share < 0.96
    error = 0.1 * np.sqrt(1.25 / (BLOCKS * CELLS))
    assert width == pytest.approx(2 * student.ppf(0.975, BLOCKS - 1) * error, rel=0.015)


def test_intervals_hold_what_a_calibrated_number_may_be(monkeypatch):
    """Its truth is drawn from its prior, which alone tells it from the parameter."""
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)
    truth = 1.0

    def problem(seed: int) -> LinearFitter:
        rng = np.random.default_rng(1000 + seed)
        return LinearFitter(truth, 0.1, rng, confused=0.5, scale=rng.standard_normal())

    share, width = covered(problem, truth)
    assert 0.94 < share < 0.97
    assert width == pytest.approx(2 * student.ppf(0.975, BLOCKS - 1) * 0.5, rel=0.04)


@pytest.mark.parametrize("factor", [0.92, 1.15])
def test_intervals_of_another_width_would_be_seen(factor, monkeypatch):
    """The two tests above can fail: widths that are off by a tenth leave their bands."""
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)
    usual = parameter_intervals.tails
    monkeypatch.setattr(parameter_intervals, "tails", lambda steps, n_blocks: factor * usual(steps, n_blocks))
    share, _ = covered(lambda seed: fitter_at(2.0, seed=seed), 2.0)
    assert not 0.935 < share < 0.96


def test_intervals_hold_what_the_form_of_the_model_may_miss():
    fitter = fitter_at(2.0)
    fit = fitter.fit(COULOMB)
    (reference,), (wide,) = intervals(fitter, fit, EVERYTHING, 0.0), intervals(fitter, fit, EVERYTHING, 8.0)
    rows = np.vstack([fit.jacobian / fit.sigma[:, None], np.eye(1, 2)])
    variance = np.linalg.inv(rows.T @ rows)[1, 1]
    form = norm.ppf(0.975) * FORM * 8.0 * np.sqrt(CELLS * variance) * (BOUNDS[1] - BOUNDS[0])
    assert np.sqrt(STRUCTURE**2 - 1) > FORM * 8.0  # beyond, most of it would be left in the residual
    for narrow_end, wide_end in ((reference.ci_low, wide.ci_low), (reference.ci_high, wide.ci_high)):
        assert abs(wide_end - reference.value) == pytest.approx(np.hypot(narrow_end - reference.value, form), rel=1e-6)
    (wide_end,), (type_name,) = intervals(fitter, fit, EVERYTHING, 50.0), intervals(fitter, fit, EVERYTHING, 500.0)
    assert (wide_end.ci_low, wide_end.ci_high) == (type_name.ci_low, type_name.ci_high)


def test_intervals_hold_a_share_of_what_an_effect_is_itself():
    """The form of the model may scale an effect: however many cells there are, its number is no better known."""
    fitter = fitter_at(4.0, noise=1e-4)
    (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
    assert result.ci_high - result.value == pytest.approx(norm.ppf(0.975) * FORM * 4.0, rel=0.02)


def test_parameter_at_its_bound_has_no_interval_and_says_so():
    fitter = fitter_at(9.0)
    (result,) = intervals(fitter, fitter.fit(COULOMB), EVERYTHING, 0.0)
    assert result.value == BOUNDS[1]
    assert np.isnan(result.ci_low)
    assert "bound" in result.note


@pytest.mark.parametrize(
    ("effect", "truth", "reason"),
    [
        ("coulomb", [2.0], ""),
        ("coulomb", [-1.0], ""),
        ("coulomb", [0.003], "the interval of torque_Nm reaches zero"),
        ("coulomb", [9.0], "torque_Nm = 6 is at a bound"),
        ("ovality_2", [2.0, 0.0], ""),  # one amplitude may be zero
        ("ovality_2", [0.004, -0.003], "joint interval of its amplitudes reaches zero"),
        ("creep", [1.0, 2.0], ""),
        ("creep", [1.0, 4.0], "time_s = 4 is longer than the record"),
        ("run_in", [1.0, 2.5], "cycles = 2.5 is longer than the record"),
    ],
)
def test_parameters_that_support_no_claim(effect, truth, reason):
    fitter = fitter_at(truth, effects=len(truth))
    fit = fitter.fit(Model((candidates()[effect],)))
    result = unsupported(fitter, fit, EVERYTHING, 0.0)
    assert (reason in result) if reason else not result


def test_an_effect_that_was_tested_against_its_absence_may_have_a_size_that_is_open():
    """Of a size and a time constant that trade in a valley the size is open upwards, and never zero."""
    fitter = fitter_at([0.003])
    fit = fitter.fit(COULOMB)
    assert "reaches zero" in unsupported(fitter, fit, EVERYTHING, 0.0)
    assert not unsupported(fitter, fit, EVERYTHING, 0.0, present=True)
    shares, ends = np.array([0.2, 0.2, 0.5]), (np.array([0.1, -0.2, -0.1]), np.array([0.3, 0.6, 1.1]))
    low, high = _positive([(0.0, 5.0), (0.0, 5.0), (-5.0, 5.0)], shares, ends)
    np.testing.assert_allclose(low, [0.1, 0.2 * np.exp(-2), -0.1])
    np.testing.assert_allclose(high, [0.3, 0.2 * np.exp(2), 1.1])


def refitted_ends(fitter, fit, rng, resamples=2000):
    """Ends of the intervals, as shares of the bounds: every resample of the branches and the prior is fitted anew."""
    data = fitter.problem.data
    rows, k = fit.jacobian / fit.sigma[:, None], fit.jacobian.shape[1]
    start = -BOUNDS[0] / (BOUNDS[1] - BOUNDS[0])
    optima = []
    for _ in range(resamples):
        drawn = rng.integers(0, BLOCKS, BLOCKS)
        cells = (data.branch[:, None] == drawn).nonzero()
        order = cells[0][np.argsort(cells[1], kind="stable")]
        stacked = np.vstack([rows[order], np.eye(1, k)])
        right = np.append((data.angle / fit.sigma)[order], rng.standard_normal())
        optima.append(start + np.linalg.lstsq(stacked, right, rcond=None)[0][1:])
    widening = student.ppf(0.5 * (1 + CONFIDENCE), BLOCKS - 1) / norm.ppf(0.5 * (1 + CONFIDENCE))
    widening *= np.sqrt(BLOCKS / (BLOCKS - 1))
    low, high = np.percentile(optima, [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)], axis=0)
    middle = np.median(optima, axis=0)
    return fit.unknowns.shares - widening * (middle - low), fit.unknowns.shares + widening * (high - middle)


@pytest.mark.parametrize("truth", [(1.0, 2.0), (5.8, 1.0), (1.0, 5.8), (-3.95, 1.0), (1.0, -3.2), (5.2, 1.0)])
def test_an_effect_is_determined_where_no_refit_of_resampled_branches_reaches_a_bound(truth, monkeypatch):
    """Presliding has a limit case; a bound that the interval of Coulomb friction reaches decides nothing."""
    monkeypatch.setattr(parameter_intervals, "FORM", 0.0)
    presliding = Model((candidates()["presliding"],))
    fitter = fitter_at(list(truth), noise=3.0, effects=2)
    fit = fitter.fit(presliding)
    low, high = refitted_ends(fitter, fit, np.random.default_rng(5))
    margin = np.minimum(low, 1 - high)
    assert np.abs(margin).min() > 0.1 * (high - low).max()  # of the bootstrap's own error
    assert determined(fitter, fit, EVERYTHING, 0.0) == bool(np.all(margin > 0))


@pytest.mark.parametrize(
    ("truth", "known"), [((5.99, 1.0, 2.0), True), ((1.0, 5.99, 2.0), False), ((1.0, 2.0, -3.99), False)]
)
def test_only_effects_with_a_limit_case_must_be_determined(truth, known):
    fitter = fitter_at(list(truth), effects=3)
    fit = fitter.fit(Model((candidates()["coulomb"], candidates()["presliding"])))
    assert determined(fitter, fit, EVERYTHING, 0.0) is known

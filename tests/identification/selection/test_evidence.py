"""Evidence of a linear model against the density of the multivariate normal distribution, by dense algebra."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of
from scipy.linalg import block_diag
from scipy.special import gammaincinv, log_ndtr, logsumexp, ndtr
from scipy.stats import multivariate_normal, norm

from pipeline.identification.fitting.fitter import OPEN_SHARE
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection.covariance import (
    CORRELATIONS,
    OFFSET,
    REACHES,
    SIZES,
    Correlation,
    Covariance,
    Structure,
    _whitening,
    known_torques,
    parts_of,
)
from pipeline.identification.selection.evidence import FIRST, PRIOR_WIDTHS, Evidence

SIGMA = 0.1
WHITE = CORRELATIONS[0]
DATA = replace(
    linear_data(positions=3, cycles=2, branches=2, cells=8, sigma=SIGMA),
    torque=np.tile(np.concatenate([np.linspace(-5, 5, 8), np.linspace(5, -5, 8)]), 6),
)
EVERYTHING = np.ones(len(DATA), bool)
SPREAD = 0.3
COVARIANCE = Covariance(DATA, EVERYTHING, parts_of(DATA, EVERYTHING))


def fitted(angle, design, columns=2):
    """A fit of one scale and one size, or of the scale alone, and its evidence."""
    fitter = LinearFitter(replace(DATA, angle=angle), design[:, :columns], (SPREAD,))
    model = model_of(columns - 1)
    return fitter, fitter.fit(model, EVERYTHING, fitter.start(model))


def drawn(seed=0, size=0.4):
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(len(DATA), 2))
    return design, design @ [0.1, size] + SIGMA * rng.standard_normal(len(DATA))


def alike_over(reach):
    """Correlation of cells of one sense whose torques are within a reach."""
    centres = np.arange(-1 - reach, 1 + 1.5 * reach, reach)
    bumps = np.exp(-(((DATA.torque[:, None] / 5.0 - centres) / reach) ** 2))
    bumps /= np.linalg.norm(bumps, axis=1)[:, None]
    return (bumps @ bumps.T) * (DATA.senses[:, None] == DATA.senses)


def dense(structure, design, columns=2, width=1.0):
    """Covariance of the cells: priors, that of the size narrowed, zeros, structure and correlated noise."""
    unit = np.median(DATA.sigma)
    prior = np.array([SPREAD, width * OPEN_SHARE])[:columns]
    zero = OFFSET * unit * (DATA.position[:, None] == np.unique(DATA.position))
    alike = alike_over(structure.reach)
    same, same_cycle = (number[:, None] == number for number in (DATA.position, DATA.cycle))
    free = design[:, :columns] * prior
    sizes = unit**2 * (structure.common**2 * alike + structure.own_size**2 * alike * same)
    sizes += (unit * structure.cycle_size) ** 2 * alike_over(max(REACHES)) * same_cycle
    return free @ free.T + zero @ zero.T + sizes + noise(structure.correlation)


def noise(correlation):
    steps = np.abs(np.arange(len(DATA))[:, None] - np.arange(len(DATA)))
    of_process = np.where(DATA.block[:, None] == DATA.block, correlation.of_neighbours**steps, 0.0)
    return SIGMA**2 * (correlation.share * of_process + (1 - correlation.share) * np.eye(len(DATA)))


@pytest.mark.parametrize(
    "structure",
    [
        Structure(0.4, 0.8, 0.15, WHITE),
        Structure(1.6, 1e-3, 0.5, Correlation(1.0, 0.6), 0.8),
        Structure(0.8, 0.1, 0.15, Correlation(0.3, 0.9), 0.4),
    ],
)
def test_value_is_the_density_of_the_cells_under_one_covariance(structure):
    design, angle = drawn()
    fitter, fit = fitted(angle, design)
    evidence = Evidence(COVARIANCE, fitter, fit)
    expected = multivariate_normal.logpdf(angle, cov=dense(structure, design)) - evidence.cost_of_widths
    assert evidence._value(structure) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("size", "narrowest", "widest"), [(0.4, 1 / 4, 1.0), (0.05, 1 / 64, 1 / 4), (0.0, 0.0, 1 / 64)]
)
def test_the_prior_of_a_size_has_several_widths_that_are_equally_probable(size, narrowest, widest):
    """By dense algebra: the mean of the densities of the cells, each over the sizes above zero."""
    design, angle = drawn(size=size)
    evidence, values = Evidence(COVARIANCE, *fitted(angle, design)), []
    for width in PRIOR_WIDTHS:
        prior, covariance = np.array([SPREAD, width * OPEN_SHARE]), dense(evidence.structure, design, 2, width)
        of_cells = covariance - (design * prior) @ (design * prior).T
        posterior = np.linalg.inv(np.diag(prior**-2) + design.T @ np.linalg.solve(of_cells, design))
        mean = posterior @ design.T @ np.linalg.solve(of_cells, angle)
        above_zero = 2 * ndtr(mean[1] / np.sqrt(posterior[1, 1]))
        values.append(multivariate_normal.logpdf(angle, cov=covariance) + np.log(above_zero))
        if width == evidence.widths[1]:
            np.testing.assert_allclose(evidence.most_probable, mean, atol=1e-5)
            np.testing.assert_allclose(evidence.deviations**2, np.diag(posterior), rtol=1e-3)
    assert evidence.value == pytest.approx(logsumexp(values) - np.log(len(values)), abs=1e-4)
    assert evidence.widths[1] == PRIOR_WIDTHS[np.argmax(values)]
    assert narrowest <= evidence.widths[1] <= widest
    assert evidence.widths[0] == 1.0


@pytest.mark.parametrize("size", [0.1, 0.02])
def test_a_range_that_is_wider_or_narrower_costs_an_effect_next_to_nothing(size):
    """Without the choice of widths four times the range costs log 4."""
    design, angle = drawn(size=size)
    values = []
    for share in (0.5, 1.0, 2.0):
        fitter, fit = fitted(angle, design * [1.0, share])
        values.append(Evidence(COVARIANCE, fitter, fit).value)
    assert np.ptp(values) < 0.4 < np.log(4)


def test_without_promise_it_is_laplaces_integral_about_the_unknowns_of_the_fit():
    """By dense algebra: density of cells and unknowns there, times the volume of the posterior."""
    design, angle = drawn()
    fitter, fit = fitted(angle, design)
    there = fitter.fit_at(fit, fit.unknowns.flat + [0.05, -0.02], EVERYTHING)
    evidence = Evidence(COVARIANCE, fitter, there)
    prior, values = np.array([SPREAD, OPEN_SHARE]), there.unknowns.flat
    of_cells = dense(evidence.structure, design) - (design * prior) @ (design * prior).T
    posterior = np.linalg.inv(np.diag(prior**-2) + design.T @ np.linalg.solve(of_cells, design))
    expected = multivariate_normal.logpdf(angle, design @ values, of_cells)
    expected += multivariate_normal.logpdf(values, np.zeros(2), np.diag(prior**2))
    expected += 0.5 * np.linalg.slogdet(2 * np.pi * posterior)[1]
    at_fit = evidence.without_promise()
    most_probable = fitter.fit_at(fit, evidence.most_probable, EVERYTHING)
    gain = evidence.log_density(most_probable) - evidence.log_density(there)
    assert gain == pytest.approx(evidence.promise, rel=1e-6)
    assert at_fit.value - at_fit._positive == pytest.approx(expected - evidence.cost_of_widths, abs=1e-4)
    assert evidence.value - at_fit.value > 1.0
    assert at_fit.without_promise().value == at_fit.value
    assert at_fit.log_evidence_up_to(np.inf, np.inf) == at_fit.value
    evidence.structure = at_fit.structure = replace(evidence.structure, common=SIZES[-1])  # larger than is allowed
    assert evidence.log_evidence_up_to(1.0, np.inf) - at_fit.log_evidence_up_to(1.0, np.inf) > 1.0


def test_away_from_the_data_evidence_at_the_fit_has_the_structure_that_is_most_probable_there():
    """What the linear problem would explain away is a discrepancy at the fit, and costs as one."""
    design, angle = drawn()
    fitter, fit = fitted(angle, design)
    far = Evidence(COVARIANCE, fitter, fitter.fit_at(fit, fit.unknowns.flat + [0.0, 0.3], EVERYTHING))
    of_linear_problem = far.unknowns[1]
    at_fit = far.without_promise()
    assert far.promised_value == at_fit.promised_value == far.value
    assert at_fit.structure.square > 20 * far.structure.square
    assert at_fit.value > far.value - far.promise + 50
    assert at_fit.value == pytest.approx(
        max(at_fit._value(replace(at_fit.structure, own_size=size)) for size in SIZES) + at_fit._positive
    )
    np.testing.assert_array_equal(at_fit.unknowns[0], at_fit._unknowns_beside(at_fit.structure)[0])
    assert np.all(np.diag(at_fit.unknowns[1]) > 1.5 * np.diag(of_linear_problem))
    structure, parts = at_fit.predicting_structure, COVARIANCE.parts
    whole, *others = (far._log_evidence(structure, parts != part) for part in (-1, *np.unique(parts)))
    np.testing.assert_allclose(at_fit.predictive, whole - np.array(others))


def test_unknowns_are_drawn_from_the_posterior():
    design, angle = drawn()
    evidence = Evidence(COVARIANCE, *fitted(angle, design))
    unknowns = evidence.drawn(4000)
    covariance = evidence.unknowns[1] * np.outer(evidence.spread, evidence.spread)
    assert unknowns.shape == (4000, len(covariance))
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(unknowns.mean(axis=0), evidence.most_probable, atol=0.07 * deviations.min())
    np.testing.assert_allclose(np.cov(unknowns.T), covariance, atol=0.07 * np.outer(deviations, deviations).max())
    np.testing.assert_array_equal(unknowns, evidence.drawn(4000))


def test_unused_cells_are_scored_by_their_density_given_all_others():
    design, angle = drawn()
    fitter, fit = fitted(angle, design)
    evidence = Evidence(COVARIANCE, fitter, fit)
    assert evidence.predicting_structure.common == SIZES[0]
    covariance = dense(evidence.predicting_structure, design)
    for score, position in zip(evidence.predictive, range(3), strict=True):
        out = DATA.position == position
        gain = covariance[np.ix_(out, ~out)] @ np.linalg.inv(covariance[np.ix_(~out, ~out)])
        rest = covariance[np.ix_(out, out)] - gain @ covariance[np.ix_(~out, out)]
        expected = multivariate_normal.logpdf(angle[out], gain @ angle[~out], 0.5 * (rest + rest.T))
        assert score == pytest.approx(expected, abs=1e-4)


def test_the_nearest_of_several_balances_costs_the_logarithm_of_their_number():
    """Each is as probable, so that the density of a cell is that about its own balance over their number."""
    fitter, fit = fitted(*drawn()[::-1])
    balances = np.where(DATA.position == 1, 3.0, 1.0)
    one, several = (Evidence(COVARIANCE, fitter, replace(fit, balances=values)) for values in (fit.balances, balances))
    in_three = np.log(3) * np.sum(DATA.position == 1)
    assert several.value == pytest.approx(one.value - in_three)
    np.testing.assert_allclose(several.predictive, one.predictive - np.array([0, in_three, 0]))


def test_a_size_that_cannot_be_negative_takes_the_share_of_its_posterior_above_zero():
    design, angle = drawn(size=0.01)
    fitter, fit = fitted(angle, design)
    evidence = Evidence(COVARIANCE, fitter, fit)
    mean, covariance = evidence.unknowns
    share = log_ndtr(mean[1] / np.sqrt(covariance[1, 1])) + np.log(2)
    assert evidence.value == pytest.approx(evidence._value(evidence.structure) + share)
    assert abs(share) > 0.01
    far = Evidence(COVARIANCE, fitter, fitter.fit_at(fit, fit.unknowns.flat + [0.0, 0.3], EVERYTHING))
    at_fit = far.without_promise()
    assert at_fit._positive == at_fit._log_share_above_zero()
    assert abs(at_fit._positive - far._positive) > 1e-3


def test_the_distance_of_a_size_from_zero_is_in_radii_of_its_region():
    design, angle = drawn(size=0.1)
    fitter, fit = fitted(angle, design)
    evidence = Evidence(COVARIANCE, fitter, fit)
    mean, deviation = evidence.unknowns[0][1] * OPEN_SHARE, evidence.deviations[1]
    assert evidence.distance("coulomb") == pytest.approx(mean / deviation / np.sqrt(2 * gammaincinv(0.5, 0.95)))
    assert mean == pytest.approx(0.1, abs=4 * deviation)


@pytest.mark.parametrize("size", [0.1, 0.02])
def test_of_a_linear_size_the_density_at_zero_follows_from_the_model_without_it(size):
    """Where the misfit without the effect is larger than derivatives say, by that much more."""
    design, angle = drawn(size=size)
    with_effect, without = (Evidence(COVARIANCE, *fitted(angle, design, columns)) for columns in (2, 1))
    linear = with_effect.distance("coulomb")
    assert with_effect.distance("coulomb", without) == pytest.approx(linear, rel=1e-4)
    at_fit = with_effect.without_promise()
    at_fit.of_fit = at_fit.of_fit + 0.05
    with_promise = at_fit._log_evidence(at_fit.structure, at_fit._everything)
    assert with_promise - at_fit._value(at_fit.structure) > 0.01
    assert at_fit.distance("coulomb", without) < linear < with_effect.distance("coulomb", without) + 1e-3
    without._known_values = {with_effect.structure: without._value(with_effect.structure) - 4.0}
    radius = 2 * gammaincinv(0.5, 0.95)
    assert with_effect.distance("coulomb", without) == pytest.approx(np.sqrt(linear**2 + 8.0 / radius), rel=1e-4)


def test_a_shape_is_held_where_the_size_that_it_trades_with_is_compared_with_zero():
    """A size and a shape with a correlation of 0.99: with the shape held a 7th of the deviation of the size is left."""
    evidence = Evidence.__new__(Evidence)
    deviations, correlation = np.array([0.2, 0.5, 0.4]), 0.99
    of_effect = np.array([[1.0, correlation], [correlation, 1.0]])
    covariance = np.outer(deviations, deviations) * block_diag(1.0, of_effect)
    fit = SimpleNamespace(model=Model((candidates()["presliding"],)), unknowns=SimpleNamespace(scales=np.zeros(1)))
    vars(evidence).update(fit=fit, bounds=[(0.0, 70.0), (0.1, 10.0)], unknowns=(np.array([0.0, 0.5, 0.2]), covariance))
    expected = 0.5 / (0.5 * np.sqrt(1 - correlation**2)) / np.sqrt(2 * gammaincinv(0.5, 0.95))
    assert evidence.distance("presliding") == pytest.approx(expected)
    assert evidence._sizes_by_effect() == [[1]]  # a shape has the prior of its range
    mean, of_effect = evidence.unknowns[0][1:], covariance[1:, 1:]
    width = 0.25
    at_zero = multivariate_normal.logpdf([0.0, mean[1]], mean, of_effect)
    of_prior = norm.logpdf(0.0, scale=width) + norm.logpdf(mean[1])
    without = SimpleNamespace(_value=lambda structure: at_zero - of_prior - 0.3, cost_of_widths=0.3)
    evidence._value, evidence.cost_of_widths = lambda structure: -0.7, 0.7
    vars(evidence).update(structure=FIRST, widths=np.array([1.0, width, 1.0]))
    assert evidence.distance("presliding", without) == pytest.approx(expected)  # Savage and Dickey


def test_structure_is_found_where_it_is():
    """Cells that are alike at all positions, at each or in each cycle, in their noise; and nothing in white noise."""
    design, angle = drawn()
    rng = np.random.default_rng(5)
    bump = SIGMA * 5 * np.cos(DATA.torque)
    own = bump * np.array([2.0, -1.0, -1.0])[DATA.position]
    walk = np.zeros(len(DATA))
    for k in range(len(DATA)):
        first = k == 0 or DATA.block[k] != DATA.block[k - 1]
        walk[k] = rng.standard_normal() if first else 0.6 * walk[k - 1] + 0.8 * rng.standard_normal()
    found = {}
    by_cycle = bump * np.array([1.0, -1.0])[DATA.cycle]
    for name, change in {"none": 0.0, "common": bump, "own": own, "cycle": by_cycle}.items():
        fitter, fit = fitted(angle + change, design)
        found[name] = Evidence(COVARIANCE, fitter, fit).structure
    assert found["none"].size <= 0.5
    assert max(found[name].cycle_size for name in ("none", "common", "own")) <= 0.2
    assert found["cycle"].cycle_size > 2 > found["cycle"].size
    assert found["common"].common > 2 > found["common"].own_size
    assert found["own"].own_size > 2 > found["own"].common
    fitter, fit = fitted(design @ [0.1, 0.4] + SIGMA * walk, design)
    correlation = Evidence(COVARIANCE, fitter, fit).structure.correlation
    assert correlation.share * correlation.of_neighbours >= 0.18


def test_white_noise_beside_one_that_wanders_is_no_difference_between_cycles():
    """As of a bench whose angle wanders by as much as it is rounded: no single correlation describes both."""
    rng, cells = np.random.default_rng(6), 60
    data = linear_data(positions=2, cycles=4, branches=2, cells=cells, sigma=SIGMA)
    data = replace(data, torque=np.tile(np.concatenate([np.linspace(-5, 5, cells), np.linspace(5, -5, cells)]), 8))
    everything = np.ones(len(data), bool)
    covariance = Covariance(data, everything, parts_of(data, everything))
    wander = rng.standard_normal(len(data))
    for k in np.flatnonzero(np.diff(data.block, prepend=-1) == 0):
        wander[k] = 0.93 * wander[k - 1] + np.sqrt(1 - 0.93**2) * wander[k]
    angle = SIGMA * (np.sqrt(0.6) * rng.standard_normal(len(data)) + np.sqrt(0.4) * wander)
    design = rng.normal(size=(len(data), 1))
    fitter = LinearFitter(replace(data, angle=angle), design, (SPREAD,))
    evidence = Evidence(covariance, fitter, fitter.fit(Model(), everything, fitter.start(Model())))
    assert evidence.structure.correlation.share < 1
    assert evidence.structure.cycle_size <= 0.2
    of_one_process = [replace(evidence.structure, correlation=one, cycle_size=0.4) for one in CORRELATIONS[:4]]
    assert evidence.value > max(evidence._value(one) for one in of_one_process) + 10


@pytest.mark.parametrize(("wave", "reach"), [(0.15, REACHES[0]), (0.6, REACHES[1]), (3.0, REACHES[2])])
def test_the_reach_found_is_that_of_what_the_model_misses(wave, reach):
    """Waves of a length in largest torques: a discrepancy competes with a ripple that is as fine."""
    rng = np.random.default_rng(4)
    data = linear_data(positions=2, cycles=1, branches=2, cells=80, sigma=SIGMA)
    data = replace(data, torque=np.tile(np.concatenate([np.linspace(-5, 5, 80), np.linspace(5, -5, 80)]), 2))
    covariance = Covariance(data, np.ones(len(data), bool), parts_of(data, np.ones(len(data), bool)))
    design = rng.normal(size=(len(data), 1))
    missed = SIGMA * (2 * np.sin(2 * np.pi * data.torque / (5 * wave)) + rng.standard_normal(len(data)))
    fitter = LinearFitter(replace(data, angle=missed), design, (SPREAD,))
    structure = Evidence(covariance, fitter, fitter.fit(Model(), covariance.cells, fitter.start(Model()))).structure
    assert structure.reach == reach
    assert structure.size > 1


def test_noise_of_the_torque_at_the_weights_of_a_staircase_is_no_discrepancy():
    """The angle stays where the weight holds it, whatever torque is read: over that the residual is a steep line."""
    rng, weights = np.random.default_rng(4), np.linspace(-5, 5, 8)
    torque = np.tile(np.concatenate([np.repeat(weights, 4), np.repeat(weights[::-1], 4)]), 12)
    error = 0.02 * rng.standard_normal(len(torque))
    data = replace(linear_data(positions=3, cycles=4, branches=2, cells=32, sigma=SIGMA), torque_noise=0.02)
    angle = SIGMA * rng.standard_normal(len(data)) - 10 * error
    data = replace(data, torque=torque + error, sigma=np.full(len(data), np.hypot(SIGMA, 0.2)))
    everything, design = np.ones(len(data), bool), rng.normal(size=(len(data), 1))
    fitter = LinearFitter(replace(data, angle=angle), design, (SPREAD,))
    fit, gain = fitter.fit(Model(), everything, fitter.start(Model())), {}
    for noise in (0.02, 0.0):
        covariance = Covariance(replace(data, torque_noise=noise), everything, parts_of(data, everything))
        evidence = Evidence(covariance, fitter, fit)
        fine = replace(evidence.structure, common=12.8, reach=REACHES[0])
        gain[noise] = evidence._value(fine) - evidence._value(replace(fine, common=SIZES[0]))
    assert gain[0.02] < 0 < gain[0.0] - 30


@pytest.mark.parametrize("correlation", CORRELATIONS)
def test_noise_of_branches_of_any_length_is_made_white(correlation):
    block = np.repeat([3, 5, 6], [4, 9, 2])
    steps = np.abs(np.arange(len(block))[:, None] - np.arange(len(block)))
    of_process = np.where(block[:, None] == block, correlation.of_neighbours**steps, 0.0)
    whitening = _whitening(block, correlation).toarray()
    covariance = correlation.share * of_process + (1 - correlation.share) * np.eye(len(block))
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(len(block)), atol=1e-12)


@pytest.mark.parametrize("number", ["common", "own_size", "cycle_size"])
def test_what_may_be_left_up_to_a_bound_is_as_large_as_the_bound(number):
    """The bound lies between two of the sizes that are tried; at the smaller one the data are less probable."""
    design, angle = drawn()
    signs = {"common": [1.0], "own_size": [2.0, -1.0, -1.0], "cycle_size": [1.0, -1.0]}[number]
    of_cells = DATA.position if number == "own_size" else DATA.cycle % len(signs)
    change = 5 * SIGMA * np.cos(DATA.torque) * np.array(signs)[of_cells]
    evidence = Evidence(COVARIANCE, *fitted(angle + change, design))
    values, start = [], replace(evidence.structure, reach=REACHES[0])
    for bound in (0.4, 0.7):
        bounds = (np.inf, bound) if number == "cycle_size" else (bound, 0.1)
        structure = evidence.best_structure(evidence._value, start, *bounds)
        assert getattr(structure, number) == bound
        assert evidence._value(structure) == max(evidence._value(replace(structure, reach=one)) for one in REACHES)
        values.append(evidence.log_evidence_up_to(*bounds))
    assert values[1] > values[0] + 1


@pytest.mark.parametrize("best", [(SIZES[3], SIZES[0]), (SIZES[0], SIZES[3])])
def test_what_may_be_left_is_bounded_as_a_whole(best):
    """All of it may be alike at all positions, or each position's own; from halves of both no step leads to either."""
    design, angle = drawn()
    evidence = Evidence(COVARIANCE, *fitted(angle, design))
    start = Structure(SIZES[5], SIZES[5], REACHES[1], WHITE)
    beyond = {(SIZES[3], SIZES[1]): 9.0, (SIZES[1], SIZES[3]): 9.0}
    values = {best: 1.0, (SIZES[2], SIZES[2]): 0.0, **beyond}

    def value(structure):
        return values.get((structure.common, structure.own_size), -1.0)

    found = evidence.best_structure(value, start, largest_size=0.41)
    assert (found.common, found.own_size) == best


def test_torques_are_known_as_far_as_their_noise_allows():
    weights = np.repeat([-10.0, -5.0, 5.0, 10.0], 20)
    read = weights + 0.05 * np.random.default_rng(1).standard_normal(80)
    np.testing.assert_allclose(known_torques(read, 0.05), weights, atol=0.05)
    assert len(np.unique(known_torques(read, 0.05))) == 4
    np.testing.assert_array_equal(known_torques(read, 0.0), read)
    sweep = np.linspace(-10, 10, 200)
    np.testing.assert_array_equal(known_torques(sweep, 0.05), sweep)
    np.testing.assert_allclose(known_torques(np.array([1.0, 1.1, 1.3, 10.0]), 0.05), [1.05, 1.05, 1.3, 10.0])
    for sense in (1.0, -1.0):  # half of the shortest reach is 0.25
        creeping = sense * np.array([*[1.0] * 20, 1.1, 1.2, 1.3, 1.4, 10.0])
        np.testing.assert_array_equal(known_torques(creeping, 0.05), creeping)


def test_information_is_the_inverse_covariance_of_an_amount():
    design, angle = drawn()
    fitter, fit = fitted(angle, design, columns=1)
    evidence = Evidence(COVARIANCE, fitter, fit)
    change = np.random.default_rng(8).normal(size=(len(DATA), 2))
    inverse = np.linalg.inv(dense(evidence.structure, design, columns=1))
    np.testing.assert_allclose(evidence.information(change), change.T @ inverse @ change, rtol=1e-5)
    larger = replace(evidence.structure, common=1.6)
    inverse_of_larger = np.linalg.inv(dense(larger, design, columns=1))
    np.testing.assert_allclose(evidence.information(change, larger), change.T @ inverse_of_larger @ change, rtol=1e-5)
    scores = change.T @ inverse @ noise(evidence.structure.correlation) @ inverse @ angle
    np.testing.assert_allclose(evidence.scores(change).sum(axis=0), scores, rtol=1e-4)


def test_scores_scatter_by_the_information_wherever_the_numbers_of_the_model_are():
    design, angle = drawn()
    change, scatter = np.random.default_rng(8).normal(size=(len(DATA), 40)), {}
    for scale in (0.0, 2.0):
        fitter, fit = fitted(angle + scale * design[:, 0], design)
        evidence = Evidence(COVARIANCE, fitter, fit)
        scatter[scale] = np.sum(evidence.scores(change) ** 2, axis=0) / np.diag(evidence.information(change))
    assert 0.5 < np.mean(scatter[0.0]) < 1.5
    np.testing.assert_allclose(scatter[2.0], scatter[0.0], rtol=0.2)


def test_what_all_positions_miss_alike_is_no_prediction():
    """Two positions show a bump that the third has, too: a model without it is not ahead by what it learns of it."""
    design, angle = drawn()
    bump = SIGMA * 5 * np.cos(DATA.torque)
    fitter, fit = fitted(angle + bump, design)
    missing = Evidence(COVARIANCE, fitter, fit)
    fitter, fit = fitted(angle, design)
    assert missing.structure.common > 2
    assert np.all(Evidence(COVARIANCE, fitter, fit).predictive > missing.predictive + 10)


def test_correlation_and_size_that_stand_in_for_each_other_are_found_together():
    """From neither of them alone a step leads to the best: the value falls off a ridge between two of their numbers."""
    design, angle = drawn()
    evidence = Evidence(COVARIANCE, *fitted(angle, design))
    best = Structure(1.6, SIZES[0], REACHES[0], CORRELATIONS[2])

    def value(structure):
        place = SIZES.index(structure.common), CORRELATIONS.index(structure.correlation)
        off_ridge = abs(place[0] - 2 * place[1])
        return min(place[1], 2) - 10.0 * off_ridge - (structure.reach != best.reach) - structure.own_size

    for size, reach, correlation in ((0, 0, 0), (4, 1, 2)):
        start = Structure(SIZES[size], SIZES[0], REACHES[reach], CORRELATIONS[correlation])
        found = evidence.best_structure(value, start)
        assert (SIZES.index(found.common), found.correlation) == (4, CORRELATIONS[2])


@pytest.mark.parametrize(("kept", "possible"), [(0.0, (0,)), (0.6, (0, 1, 2, 4, 5)), (0.9, (0, 1, 2, 3, 4, 5))])
def test_repeats_bound_the_correlation_of_the_noise_whatever_the_model_misses(kept, possible):
    data = linear_data(positions=4, cycles=4, branches=2, cells=20, sigma=SIGMA)
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(len(data))
    for k in np.flatnonzero(np.diff(data.block, prepend=-1) == 0):
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept**2) * noise[k]
    missed = 30 * np.cos(np.arange(len(data)) % 20)  # alike in every cycle
    data = replace(data, angle=SIGMA * (noise + missed))
    everything, correlations = np.ones(len(data), bool), tuple(CORRELATIONS[k] for k in possible)
    assert Covariance(data, everything, parts_of(data, everything)).correlations == correlations
    single = data.cycle == 0
    assert Covariance(data, single, parts_of(data, single)).correlations == CORRELATIONS

"""The cheapest tolerances of a linear chain against the closed form, and what a chain cannot do."""

import numpy as np
import pytest
from scipy.stats import norm, qmc

from pipeline.decisions.cheapest import LinearUnits, _meeting, cheapest

RATE = np.array([4.0, 1.0, 9.0, 2.0])
"""Cost of tolerance i is RATE_i / t_i."""
SENSITIVITY = np.array([1.0, -2.0, 0.5, 1.5])
TARGET, LIMIT = 0.99, 1.0
Z = 2.3263479
LOW, HIGH = np.full(4, 1e-3), np.full(4, 10.0)


def chain(power=15):
    """y = sum s_i t_i x_i with normal x_i of sigma 1/3, one upper limit."""
    x = norm.ppf(qmc.Sobol(4, rng=np.random.default_rng(1)).random_base2(power)) / 3
    slope = (x * SENSITIVITY)[:, None, :]
    start = np.full(4, 0.3)
    return LinearUnits(start, slope @ start - LIMIT, slope)


def costs(rate=RATE):
    return [lambda scale, item=item: item / scale for item in rate]


def closed_form():
    """t_i ~ (A_i/s_i^2)^(1/3), by Lagrange under z sqrt(sum (s t/3)^2) = limit."""
    t = (RATE / SENSITIVITY**2) ** (1 / 3)
    return t * LIMIT / (Z * np.sqrt(np.sum((SENSITIVITY * t / 3) ** 2)))


def test_reciprocal_costs_of_a_chain_meet_the_closed_form():
    units = chain()
    scale = cheapest(units, costs(), TARGET, LOW, HIGH).scale
    assert units.pass_share(scale) == pytest.approx(TARGET, abs=5e-5)
    assert np.sum(RATE / scale) == pytest.approx(np.sum(RATE / closed_form()), rel=0.01)
    np.testing.assert_allclose(scale, closed_form(), rtol=0.02)
    equal = LIMIT / (Z * np.sqrt(np.sum((SENSITIVITY / 3) ** 2)))
    assert np.sum(RATE / scale) < 0.93 * np.sum(RATE / equal)


@pytest.mark.parametrize("factor", [0.8, 1.4])
def test_one_factor_brings_scales_to_the_yield_from_either_side(factor):
    scale = _meeting(chain(), factor * closed_form(), TARGET, LOW, HIGH)
    np.testing.assert_allclose(scale, closed_form(), rtol=0.01)


def test_bounds_are_kept_and_what_costs_nothing_to_loosen_is_loosened():
    units = chain(12)
    harmless = LinearUnits(units.scale, units.value, units.slope * np.array([1.0, 1.0, 0.0, 1.0]))
    scale = cheapest(harmless, costs(), TARGET, LOW, np.array([0.2, 10.0, 7.0, 10.0])).scale
    assert scale[0] == pytest.approx(0.2)
    assert scale[2] == pytest.approx(7.0)


def test_an_impossible_yield_comes_as_near_as_it_can():
    best = cheapest(chain(12), costs(), TARGET, np.full(4, 1.0), HIGH)
    assert not best.meets_yield
    np.testing.assert_allclose(best.scale, 1.0)

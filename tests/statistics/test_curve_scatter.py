"""The scatter of curves between groups against processes of known size and the analysis of variance."""

import numpy as np
import pytest

from pipeline.statistics.curve_scatter import curve_scatter

TORQUE = np.linspace(-12, 12, 40)
REACH, NOISE = 4.0, 0.1


def drawn(seed: int, groups: int, size: float, alike: bool = False) -> tuple[np.ndarray, ...]:
    """Cells of two branches in two cycles: a shared curve, departures of a size, a zero of each group, noise."""
    rng = np.random.default_rng(seed)
    covariance = np.exp(-0.5 * ((TORQUE[:, None] - TORQUE) / REACH) ** 2)
    parts = []
    for group in range(groups):
        departures = rng.multivariate_normal(np.zeros(len(TORQUE)), covariance, size=2, method="eigh")
        departures = departures[[0, 0]] if alike else departures
        zero = 5 * rng.standard_normal()
        for branch in (0, 1, 0, 1):
            shared = 3 * np.sin(TORQUE / 3 + branch) + zero + NOISE * rng.standard_normal(len(TORQUE))
            parts.append((TORQUE, branch, group, shared + size * departures[branch]))
    columns = (np.concatenate([np.broadcast_to(part[k], len(TORQUE)) for part in parts]) for k in range(4))
    torque, branch, group, values = columns
    return torque, branch, group, values, np.full(len(values), NOISE)


def visible(size: float, alike: bool) -> float:
    """Size of departures beside the zero of their group."""
    correlation = np.exp(-0.5 * ((TORQUE[:, None] - TORQUE) / REACH) ** 2)
    return size * float(np.sqrt(1 - correlation.mean() * (1.0 if alike else 0.5)))


@pytest.mark.parametrize(
    ("groups", "size", "alike"),
    [
        *((3, 0.3, False), (3, 2.0, True)),
        *(
            pytest.param(*case, marks=pytest.mark.attack)
            for case in ((3, 0.3, True), (3, 2.0, False), (6, 2.0, False), (6, 2.0, True))
        ),
    ],
)
def test_a_size_is_found_and_lies_in_its_interval(groups, size, alike):
    many = [curve_scatter(*drawn(seed, groups, size, alike)) for seed in range(30)]
    truth = visible(size, alike)
    assert np.median([one.size for one in many]) == pytest.approx(truth, rel=0.2)
    assert sum(one.ci_low <= truth <= one.ci_high for one in many) >= 26  # of 95 % of 30, 1 in 100 has fewer
    assert all(one.groups == groups for one in many)


def test_groups_alike_show_no_scatter():
    many = [curve_scatter(*drawn(seed, 3, 0.0)) for seed in range(40)]
    assert sum(one.significant_size > 0 for one in many) <= 3
    assert max(one.ci_high for one in many) < NOISE


def test_of_one_difference_a_group_it_is_the_analysis_of_variance():
    rng = np.random.default_rng(1)
    groups, repeats = 7, 5
    difference = rng.normal(0, 2.0, groups)
    group, branch = (index.ravel() for index in np.indices((groups, 2, repeats))[:2])
    values = np.where(branch == 1, 0.5, -0.5) * difference[group] + 0.1 * rng.standard_normal(len(group))
    sigma = np.full(len(values), 0.1)
    found = curve_scatter(np.ones(len(values)), branch, group, values, sigma, bins=1)
    means = np.array([[values[(group == g) & (branch == b)].mean() for b in (0, 1)] for g in range(groups)])
    within = np.mean([values[(group == g) & (branch == b)].var(ddof=1) for g in range(groups) for b in (0, 1)])
    between = np.var(means[:, 1] - means[:, 0], ddof=1)
    expected = between / 4 - max(within, 0.1**2) / repeats / 2
    assert found.size**2 == pytest.approx(expected, rel=0.02)


def test_what_one_group_alone_has_cannot_be_compared():
    torque, branch, _, values, sigma = drawn(0, 1, 1.0)
    assert curve_scatter(torque, branch, np.zeros(len(values), int), values, sigma) is None


def test_a_common_zero_makes_offsets_scatter():
    torque, branch, group, values, sigma = drawn(3, 4, 0.0)
    assert curve_scatter(torque, branch, group, values, sigma).significant_size == 0.0
    assert curve_scatter(torque, branch, group, values, sigma, own_zero=False).significant_size > 1.0


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_size_is_in_the_unit_of_the_values(unit):
    torque, branch, group, values, sigma = drawn(4, 3, 0.3)
    found = curve_scatter(torque, branch, group, values, sigma)
    scaled = curve_scatter(torque, branch, group, unit * values, unit * sigma)
    expected = [unit * size for size in (found.size, found.ci_low, found.ci_high)]
    assert (scaled.size, scaled.ci_low, scaled.ci_high) == pytest.approx(tuple(expected))

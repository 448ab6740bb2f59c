"""How likely fitted tolerances are: chi-square of their modes, widened by what the form of the model misses."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of, stood
from scipy.stats import chi2

from pipeline.identification.selection.parameter_intervals import FORM, STRUCTURE
from pipeline.identification.selection.recalibration import UNLIKELY, declared_rms, tolerance_share

SIGMA, MODES = 0.1, 3
DATA = linear_data(positions=3, cycles=1, branches=4, cells=10, sigma=SIGMA)
EVERYTHING = np.ones(len(DATA), bool)
STEPS = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / SIGMA
"""Each mode moves each branch of its position as a whole, by so many sigmas as a cell has."""
MOVED = SIGMA * np.array([STEPS[k][DATA.branch % 4] * (DATA.position == k) for k in range(MODES)]).T
RIPPLE = np.tile([1.0, -1.0], len(DATA) // 2)
"""An effect that no mode follows."""
DESIGN = np.column_stack([RIPPLE, SIGMA * MOVED])


def share_of(modes, effect=0.0, left=0.0):
    """Share of a fit whose modes are given, beside an effect; ``left`` [sigmas] stays in every other cell."""
    fitter = LinearFitter(replace(DATA, angle=DESIGN @ [effect, *modes] + left * SIGMA * RIPPLE), DESIGN, n_modes=MODES)
    unknowns = replace(fitter.start(model_of(1)), shares=np.array([effect]), modes=np.asarray(modes, float))
    return fitter, tolerance_share(fitter, stood(fitter, model_of(1), unknowns, DATA.sigma), EVERYTHING)


def form_variance(size):
    """Of each mode by an error of so many sigmas, alike in a branch: (k / (k + 1))^2 size^2 n / k, of n cells a branch.

    k = 4 n: what the cells of its position tell of a mode.
    """
    cells = len(DATA) // 12
    told = 4 * cells
    return size**2 * cells * told / (1 + told) ** 2


def test_modes_of_a_unit_that_is_as_declared_are_chi_square():
    _, share = share_of(np.zeros(MODES))
    assert share == 1.0
    modes = np.array([1.5, -1.0, 0.5])
    fitter, share = share_of(modes)
    size = FORM * declared_rms(fitter, EVERYTHING)
    assert share == pytest.approx(chi2.sf(np.sum(modes**2) / (1 + form_variance(size)), MODES), rel=1e-6)
    assert share == pytest.approx(chi2.sf(np.sum(modes**2), MODES), rel=0.01)


def test_what_the_form_misses_of_all_that_is_explained_widens_the_modes():
    """Up to what is left of it: a mean square above that of the noise, STRUCTURE of it at least."""
    modes, effect = np.array([5.0, 4.0, 3.0]), 400 * SIGMA
    for left in (0.0, 4.0):
        fitter, share = share_of(modes, effect, left)
        assert declared_rms(fitter, EVERYTHING) > 400
        size = np.sqrt(max(STRUCTURE, left) ** 2 - 1)
        assert share == pytest.approx(chi2.sf(np.sum(modes**2) / (1 + form_variance(size)), MODES), rel=1e-6)
    assert share_of(modes)[1] < UNLIKELY < share_of(modes, effect, 12.0)[1]


def test_declared_error_is_that_of_no_effect_and_no_tolerance():
    fitter, _ = share_of(np.zeros(MODES), effect=7 * SIGMA)
    assert declared_rms(fitter, EVERYTHING) == pytest.approx(7.0)

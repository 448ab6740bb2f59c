"""The detection limit against draws of noise, and against a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of

from pipeline.identification.fitting.problem import Model
from pipeline.identification.selection.cross_validation import trial
from pipeline.identification.selection.parameter_intervals import STRUCTURE
from pipeline.identification.selection.statements.detection import detection_limits, needed_square

DATA = linear_data(positions=3, cycles=3, branches=2, cells=20, sigma=0.1)
EVERYTHING = np.ones(len(DATA), bool)
EFFECT = model_of(1).effects[0]


def fitted(angle, design):
    fitter = LinearFitter(replace(DATA, angle=angle), design)
    fit = fitter.fit(Model(), EVERYTHING, fitter.start(Model()))
    return fitter, trial(fitter, fit, EVERYTHING)


@pytest.mark.parametrize("strength", [0.5, 3.0])
def test_an_effect_of_the_limits_size_shows_in_95_percent_of_draws(strength):
    rng = np.random.default_rng(1)
    design = strength * rng.normal(size=(len(DATA), 1))
    shown_part = []
    for _ in range(60):
        noise = 0.1 * rng.standard_normal(len(DATA))
        fitter, base = fitted(noise, design)
        (limit,) = detection_limits(fitter, base, EVERYTHING, {EFFECT.name: EFFECT})
        fresh_noise = 0.1 * rng.standard_normal(len(DATA))
        _, with_effect = fitted(fresh_noise + design[:, 0] * limit.value, design)
        shown_part.append(with_effect.rms > STRUCTURE)
    assert 0.85 <= np.mean(shown_part) <= 1.0


def test_an_effect_that_hides_is_below_its_limit():
    """Of units whose effect adds nearly what shows: where they are found adequate, the limit is no smaller than it."""
    rng = np.random.default_rng(4)
    design = rng.normal(size=(len(DATA), 1))
    size, hidden = np.sqrt(1.2**2 - 1) * 0.1, 0
    for _ in range(20):
        fitter, base = fitted(0.1 * rng.standard_normal(len(DATA)) + size * design[:, 0], design)
        (limit,) = detection_limits(fitter, base, EVERYTHING, {EFFECT.name: EFFECT})
        if base.rms <= STRUCTURE:
            hidden += 1
            assert limit.value >= size
    assert hidden > 5


def test_the_limit_is_that_of_the_closed_form():
    rng = np.random.default_rng(2)
    design = rng.normal(size=(len(DATA), 1))
    fitter, base = fitted(0.1 * rng.standard_normal(len(DATA)), design)
    (limit,) = detection_limits(fitter, base, EVERYTHING, {EFFECT.name: EFFECT})
    position = DATA.position[:, None] == np.arange(3)
    centred = design[:, 0] - position @ (design[:, 0] @ position / position.sum(axis=0))
    expected = np.sqrt(needed_square(base.losses) / np.mean((centred / DATA.sigma) ** 2))
    assert limit.value == pytest.approx(expected, rel=0.03)


def test_an_effect_that_no_bound_would_show_has_no_limit():
    rng = np.random.default_rng(3)
    design = 1e-3 * rng.normal(size=(len(DATA), 1))
    fitter, base = fitted(0.1 * rng.standard_normal(len(DATA)), design)
    (limit,) = detection_limits(fitter, base, EVERYTHING, {EFFECT.name: EFFECT})
    assert np.isnan(limit.value)

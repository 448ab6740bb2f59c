"""Contacts on a part of the width: softer than any law of line contacts, and no effect."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from synthetic_unit import Bench, make_unit, problem_of, with_angles

from pipeline.config.studies.study import FORCE_LAW, SHORT_CONTACT
from pipeline.identification import identify
from pipeline.identification.fitting.fitter import Fitter
from pipeline.identification.fitting.problem import Model
from pipeline.identification.identify import _best_selection, _is_held_by_range
from pipeline.identification.selection.model_selection import Selector


def deflection_of_crown(force, radius, crown):
    """Approach [mm] of steel in Hertz' point contact with two relative radii [mm] (Johnson 1985, 4.2)."""
    modulus = 206e3 / (2 * (1 - 0.3**2))

    def integrals(log_ratio):
        square = 1 - np.exp(-2 * log_ratio)  # of the eccentricity, for semi-axes a = e^log_ratio b
        return ellipk(square), ellipe(square), np.exp(2 * log_ratio)

    def excess(log_ratio):
        k, e, axes = integrals(log_ratio)
        return np.log((axes * e - k) / (k - e)) - np.log(crown / radius)

    log_ratio = brentq(excess, 1e-3, 10.0)
    k, e, axes = integrals(log_ratio)
    shorter = np.exp(-log_ratio)
    mean_axis = (4 / (np.pi * (1 - shorter**2))) ** (1 / 3) * shorter**0.5 * ((axes * e - k) * (k - e)) ** (1 / 6)
    sphere = (9 * force**2 / (16 * modulus**2 * np.sqrt(radius * crown))) ** (1 / 3)
    return sphere * 2 / np.pi * shorter**0.5 / mean_axis * k


def test_the_range_of_short_contacts_holds_crowned_pins():
    """Over Palmgren's contact of the whole width, of a small and of a large drive; near a sphere the closed form."""
    sphere = (9 * 100.0**2 / (16 * (206e3 / 1.82) ** 2 * 5.0)) ** (1 / 3)
    assert deflection_of_crown(100.0, 5.0, 5.03) == pytest.approx(sphere, rel=0.01)
    for force, radius, width in ((466.0, 2.0, 10.0), (2000.0, 5.0, 25.0)):
        line = 3.84e-5 * force**0.9 / width**0.8
        factors = [deflection_of_crown(force, radius, crown) / line for crown in (100.0, 1000.0)]
        assert FORCE_LAW < factors[1] < factors[0] < 1.15 * SHORT_CONTACT
        assert factors[0] > 0.75 * SHORT_CONTACT


def selected_with_softer_contacts(factor, folder, condensed):
    """The selection on a unit whose contacts give way ``factor`` times as far, and the problem before it."""
    problem = problem_of(make_unit(folder / "u", {}, Bench(), condensed), condensed)
    free = np.where(np.arange(problem.scale_range.shape[1]) < len(problem.calibrated_keys), 1e-3, 1.0)
    problem = replace(problem, scale_range=free * problem.scale_range, short_range=free * problem.short_range)
    fitter = Fitter(problem.with_short_contacts())
    start = fitter.start(Model())
    scales = start.scales.copy()
    of_laws = slice(len(problem.calibrated_keys), len(problem.calibrated_keys) + 2)
    scales[of_laws] = np.log(factor)
    angle = fitter.predict(Model(), replace(start, scales=scales)).angle
    noise = np.random.default_rng(3).normal(scale=problem.data.sigma)
    cells = np.ones(len(noise), bool)
    return problem, *_best_selection(Selector(Fitter(with_angles(problem, angle + noise)), cells), cells)


@pytest.mark.parametrize(
    ("factor", "are_short"),
    [(1.3, False), *(pytest.param(factor, True, marks=pytest.mark.long) for factor in (2.8, 4.5))],
)
def test_contacts_on_a_part_of_the_width_are_tried_where_they_explain_more(factor, are_short, tmp_path, condensed):
    """Contacts that give way 2.8 or 4.5 times as far, where another law of line contacts allows 1.65 times.

    Within the range of line contacts a torsion of the output is named in their place.
    """
    problem, selector, selection = selected_with_softer_contacts(factor, tmp_path, condensed)
    expected_range = problem.short_range if are_short else problem.scale_range
    np.testing.assert_array_equal(selector.problem.scale_range, expected_range)
    assert selection.members == ()


@pytest.mark.long
def test_they_are_tried_before_a_name_even_if_no_range_holds_the_fit(tmp_path, condensed, monkeypatch):
    """Beside a compliance that is named the laws may be as declared: it takes the place of their softness."""
    monkeypatch.setattr(identify, "_is_held_by_range", lambda *_: False)
    monkeypatch.setattr(identify, "LARGEST_GAIN", np.inf)
    problem, selector, selection = selected_with_softer_contacts(2.8, tmp_path, condensed)
    np.testing.assert_array_equal(selector.problem.scale_range, problem.short_range)
    assert selection.members == ()


def test_a_part_of_the_data_has_the_ranges_of_the_whole(tmp_path, condensed):
    problem = problem_of(make_unit(tmp_path / "u", {}, Bench(), condensed), condensed).with_short_contacts()
    fold = problem.trained_on(problem.data.position == 0)
    np.testing.assert_array_equal(fold.scale_range, problem.short_range)


@pytest.mark.parametrize(
    ("factors", "is_held"),
    [((1.0, 1.0, 3.9), False), ((1.5, 1.0, 1.0), False), ((1.64, 1.0, 1.0), True), ((1.4, 1.4, 1.0), True)],
)
def test_other_ranges_are_tried_where_the_ranges_hold_the_laws(factors, is_held, tmp_path, condensed):
    """Of the deflections of pins and output: the curvature has one range."""
    problem = problem_of(make_unit(tmp_path / "u", {}, Bench(), condensed), condensed)
    fitter = Fitter(problem)
    start = fitter.start(Model())
    scales = np.concatenate([np.zeros(len(problem.calibrated_keys)), np.log(factors), [0.0]])
    assert len(scales) == len(start.scales)
    fit = fitter.fit(Model(), np.ones(len(problem.data), bool), replace(start, scales=scales), 0)
    assert _is_held_by_range(problem, fit) == is_held

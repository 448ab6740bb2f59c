"""Sizes that would be noticed and named, against draws of the whole rule."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from linear_unit import LinearFitter, linear_data, model_of
from scipy.stats import norm

from pipeline.identification import identify
from pipeline.identification.fitting.problem import Model, candidates
from pipeline.identification.selection.covariance import Covariance, parts_of
from pipeline.identification.selection.criteria import NAMED_ODDS, Judge, Trial
from pipeline.identification.selection.evidence import Evidence
from pipeline.identification.selection.statements import detection
from pipeline.identification.selection.statements.detection import DetectionLimit, detection_limits
from pipeline.identification.selection.statements.verdict import ADEQUATE, UNEXPLAINED, Verdict
from pipeline.statistics.resampling import CONFIDENCE

DATA = linear_data(positions=3, cycles=3, branches=2, cells=20, sigma=0.1)
EVERYTHING = np.ones(len(DATA), bool)
NAMES = ("coulomb", "output_torsion", "torque_zero", "torque_gain", "preload")


class ByName(LinearFitter):
    """Each effect has a column of its own."""

    def __init__(self, data, columns):
        super().__init__(data, np.zeros((len(data), 1)))
        self.columns, self.problem.record = columns, {}

    def predict(self, model, unknowns, positions=None, modes=False):
        names = [effect.name for effect in model.effects]
        self.design = np.column_stack([self.columns[name] for name in names]) if names else np.zeros((len(DATA), 0))
        self.shares = len(names)
        return super().predict(model, unknowns, positions, modes)


def unit(angle, columns):
    """The fitter of a unit, and the evidence of it without effects and with each of them."""
    fitter = ByName(replace(DATA, angle=angle), columns)
    covariance = Covariance(fitter.problem.data, EVERYTHING, parts_of(DATA, EVERYTHING))
    trials = {}
    for name in ("", *columns):
        model = Model((candidates()[name],)) if name else model_of(0)
        fit = fitter.fit(model, EVERYTHING, fitter.start(model))
        trials[name] = Trial(fit, Evidence(covariance, fitter, fit), 1.0)
    return fitter, trials.pop(""), trials


def draws_of(alike):
    """Columns of effects; those after the second are the first one but for a share."""
    rng = np.random.default_rng(1)
    columns = {name: rng.normal(size=len(DATA)) for name in NAMES}
    for name in NAMES[2:]:
        columns[name] = alike * columns["coulomb"] + np.sqrt(1 - alike**2) * columns[name]
    return columns, rng


@pytest.mark.parametrize(("draws", "least"), [pytest.param(25, 0.85, marks=pytest.mark.attack), (8, 0.75)])
@pytest.mark.parametrize("alike", [0.0, 0.9])
def test_an_effect_of_either_size_is_noticed_or_named_in_at_least_90_percent_of_draws(alike, draws, least):
    columns, rng = draws_of(alike)
    effects = {name: candidates()[name] for name in NAMES}
    noticed, named, ratios = [], [], []
    for _ in range(draws):
        fitter, base, _ = unit(0.1 * rng.standard_normal(len(DATA)), columns)
        limit = detection_limits(fitter, base, effects)[0]
        ratios.append(limit.named / limit.noticed)
        for size, found in ((limit.noticed, noticed), (limit.named, named)):
            angle = 0.1 * rng.standard_normal(len(DATA)) + size * columns["coulomb"]
            fitter, base, trials = unit(angle, columns)
            selection = Judge(fitter, EVERYTHING, len(NAMES)).select(base, trials, {})
            right = "coulomb" in selection.members and len(selection.members) <= 3
            found.append(right if found is named else bool(selection.best_model))
    assert np.mean(noticed) >= least
    assert np.mean(named) >= least
    assert (np.mean(ratios) > 1.2) == (alike > 0.5)


def test_an_effect_that_no_bound_would_show_has_no_limit():
    columns, rng = draws_of(0.0)
    columns["coulomb"] = 1e-3 * columns["coulomb"]
    fitter, base, _ = unit(0.1 * rng.standard_normal(len(DATA)), columns)
    limit = detection_limits(fitter, base, {name: candidates()[name] for name in NAMES})[0]
    assert np.isnan(limit.noticed)
    assert np.isnan(limit.named)


def test_a_usual_size_is_noticed_earlier_by_a_prior_that_is_not_as_wide_as_its_range(monkeypatch):
    columns, rng = draws_of(0.0)
    fitter, base, _ = unit(0.1 * rng.standard_normal(len(DATA)), columns)
    effects = {name: candidates()[name] for name in NAMES}
    with_all = detection_limits(fitter, base, effects)[0].noticed
    monkeypatch.setattr(detection, "PRIOR_WIDTHS", (1.0,))
    assert with_all < 0.995 * detection_limits(fitter, base, effects)[0].noticed


class Jumping(ByName):
    """As its base, but a single row changes by what does not depend on the size once that is large enough."""

    def predict(self, model, unknowns, positions=None, modes=False):
        prediction = super().predict(model, unknowns, positions, modes)
        angle = prediction.angle.copy()
        angle[7] += 5.0 * np.any(unknowns.shares > 0.2)
        return prediction._replace(angle=angle)


def test_a_row_that_jumps_at_some_size_makes_no_smaller_one_noticed():
    """The jump is 50 times the noise: a pattern that grew in proportion would be noticed at a tenth of its size."""
    columns, rng = draws_of(0.0)
    columns["coulomb"] = 1e-3 * columns["coulomb"]
    fitter, base, _ = unit(0.1 * rng.standard_normal(len(DATA)), columns)
    jumping = Jumping(fitter.problem.data, columns)
    limit = detection_limits(jumping, base, {name: candidates()[name] for name in NAMES})[0]
    assert 0.2 <= limit.noticed < 0.5
    assert limit.named >= limit.noticed


def test_a_name_takes_the_odds_over_a_rival_that_costs_less_and_over_all_but_two():
    sought = object.__new__(detection._Sought)
    sought.effect, sought.grows, sought.bounds = candidates()["coulomb"], 0, ((0.0, 6.0),)
    sought.amplitude, sought.scatter, sought.is_noticed = 0.5, 1.0, True
    sought.structure, sought.least_share = None, 0.0
    sought._needed_share = lambda _: 0.01

    def size(odds, information):
        return 3.0 * (np.sqrt(2 * odds) + norm.ppf(CONFIDENCE)) / np.sqrt(information)

    assert sought.limit([(NAMED_ODDS - 0.1, 400.0)]).named == pytest.approx(0.03)
    assert sought.limit([(20.0, 400.0)]).named == pytest.approx(size(20.0 - NAMED_ODDS, 400.0))
    rivals = [(0.0, 400.0), (0.0, 100.0), (0.0, 25.0)]
    assert sought.limit(rivals).named == pytest.approx(size(NAMED_ODDS, 400.0))


@pytest.mark.parametrize(("verdict", "is_promised"), [(UNEXPLAINED, False), (ADEQUATE, True)])
def test_no_size_would_be_named_beside_structure_that_is_left(monkeypatch, verdict, is_promised):
    """Friction of 6.5 N m beside a play that the model lacks was not named, where 0.27 N m was promised."""
    limit = DetectionLimit("coulomb", "torque_Nm", "N m", 0.2, 0.3)
    monkeypatch.setattr(identify, "detection_limits", lambda *of_unit: (limit,))
    (stated,) = identify._sizes_that_could_hide(MagicMock(), MagicMock(), Verdict(verdict))
    assert stated.noticed == 0.2
    assert stated.named == 0.3 if is_promised else np.isnan(stated.named)

"""Far tails of a study: the metrics are those of the chain, and few solved units tell what all of them do."""

import numpy as np
import pytest

from pipeline.cli.tails import over_turn
from pipeline.config.study import Limits
from pipeline.engine.cache import Cache
from pipeline.engine.stage import Job
from pipeline.errors import InputError
from pipeline.population import tails
from pipeline.sampling import draw
from stages import hysteresis

LOST_MOTION, RIGIDITY = "lost_motion_arcmin", "torsional_rigidity_Nm_per_arcmin"
UNITS = 4000


def limited(study, **limits):
    return study.model_copy(update={"limits": Limits(**limits)})


def of_play(study, sampled):
    """Lost motion that follows the play up to the radius of one pin; a rigidity that has nothing to do with it."""
    stray = sampled.pin_radius[:, 5] + 0.5
    return {LOST_MOTION: tails.worst_play(study, sampled) + 0.1 * stray, RIGIDITY: 5 + sampled.pin_tangential[:, 7]}


@pytest.fixture(scope="module")
def one_angle(study):
    return study.model_copy(update={"cycle": study.cycle.model_copy(update={"crank_deg": (0.0,)})})


@pytest.fixture(scope="module")
def every(one_angle):
    """Every unit's metrics, without the sampling."""
    return of_play(one_angle, draw(tails.population(one_angle, UNITS), 0, UNITS))


def rows_of(study, budget):
    rows = tails.far_tails(study, UNITS, budget, lambda sampled: of_play(study, sampled))
    return {(row.metric, row.statistic): row for row in rows}


def test_metrics_are_those_of_the_chain(study, outputs, runs):
    """Unit k here is sample k + 1 there: the first is the nominal reducer."""
    shared = hysteresis.prepare(Job(study, 1, runs, outputs, Cache(runs / ".cache", "")))
    found = over_turn(shared, draw(tails.population(study, 50), 0, 7))
    units = outputs["aggregate"].read("units")
    for name in (LOST_MOTION, RIGIDITY, "peak_pressure_MPa"):
        np.testing.assert_allclose(found[name], units[f"{name}_worst"][1:8], rtol=1e-9)


def test_all_units_solved_are_counted(one_angle, every):
    limit = float(np.quantile(every[LOST_MOTION], 0.99))
    rows = rows_of(limited(one_angle, **{LOST_MOTION: limit}), UNITS)
    assert rows[LOST_MOTION, "beyond"].value == np.mean(every[LOST_MOTION] > limit)
    assert rows[LOST_MOTION, "beyond"].solved == UNITS
    exact = np.quantile(every[LOST_MOTION], 0.9973, method="hazen")
    assert rows[LOST_MOTION, "p99.73"].value == pytest.approx(exact)


def test_few_solved_units_tell_what_all_do(one_angle, every):
    """400 of 4,000: the share beyond is right within its own interval, which is that of five times as many."""
    limit = float(np.quantile(every[LOST_MOTION], 0.99))
    row = rows_of(limited(one_angle, **{LOST_MOTION: limit}), 400)[LOST_MOTION, "beyond"]
    assert row.solved == pytest.approx(400, abs=60)
    assert row.ci_low < np.mean(every[LOST_MOTION] > limit) < row.ci_high
    assert row.effective > 5 * row.solved
    assert row.ci_high - row.ci_low < 0.01


def test_a_metric_that_the_play_does_not_tell_has_no_interval(one_angle, every):
    rows = rows_of(limited(one_angle, **{RIGIDITY: float(np.quantile(every[RIGIDITY], 0.002))}), 400)
    assert (rows[RIGIDITY, "beyond"].ci_low, rows[RIGIDITY, "beyond"].ci_high) == (0.0, 1.0)
    assert rows[RIGIDITY, "p0.27"].ci_low == -np.inf
    assert rows[RIGIDITY, "p0.27"].value < np.median(every[RIGIDITY])  # the lower tail is the bad one


def test_what_has_no_tail_is_refused(study):
    with pytest.raises(InputError, match="limits"):
        tails.tails_of(limited(study, clearance_backlash_arcmin=2.0))
    cases = study.model_copy(update={"samples": study.samples.model_copy(update={"experiment": "cases"})})
    with pytest.raises(InputError, match="cases"):
        tails.tails_of(cases)

"""A linear metric's stack against its closed form, and C_pk where it means something and where it does not."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, truncnorm

from pipeline.config import load_study
from pipeline.config.distributions.shipped import Fixed
from pipeline.decisions.bounds import WORST_FOUND, WORST_OF_VALID
from pipeline.decisions.box import Box, capability, stack
from pipeline.decisions.play_bounds import BY_PROGRAM
from pipeline.figures.labels import METRICS
from pipeline.report.decisions.bounds import bounds_sentence, square_sentence

ROOT = Path(__file__).parent.parent.parent.parent


@pytest.mark.long
def test_a_linear_metric_has_the_spread_of_its_tolerances():
    """3 um of eccentricity's zone and a two-lobed ovality's component: truncated normal, and uniform times a cosine."""
    study = load_study("quick", ROOT)
    box = Box.from_study(study)
    column, (amplitude, phase) = int(box.free_columns["eccentricity"][0]), box.waves["ovality_2"][0]

    def metric(points):
        return 5 + 3 * (points[:, column] - 0.5) + points[:, amplitude] * np.cos(2 * np.pi * points[:, phase])

    numbers = np.random.default_rng(1).random((20_000, box.n_columns))
    result = stack(study, box, metric, numbers)
    eccentricity = 9 * truncnorm(-3, 3).var() / 36  # zone of six sigma
    variances = {"eccentricity": eccentricity, "ovality_2": 1 / 6}  # E a^2 E cos^2 = 1/3 1/2
    assert result.middle == pytest.approx(5)
    assert result.rss == pytest.approx(np.sqrt(sum(variances.values())), rel=0.02)
    for name, share in result.shares.items():
        assert share == pytest.approx(variances.get(name, 0.0) / sum(variances.values()), abs=0.02)
    np.testing.assert_allclose(result.values.std(ddof=1), result.rss, rtol=0.02)
    assert result.values.mean() == pytest.approx(5, abs=0.03)


def test_capability_of_normal_values_is_their_yield_and_of_others_is_not():
    values = norm.ppf((np.arange(5000) + 0.5) / 5000)
    result = capability("lost_motion_arcmin", values, 2.0, 0.95)
    assert result.cpk == pytest.approx(2 / 3, rel=1e-3)
    assert result.yield_if_normal == pytest.approx(norm.cdf(2.0), rel=1e-4)
    assert result.is_normal_plausible
    lower = capability("torsional_rigidity_Nm_per_arcmin", -values, -2.0, 0.95)
    assert lower.cpk == pytest.approx(result.cpk)
    assert capability("lost_motion_arcmin", values + 5, 7.0, 0.95).cpk == pytest.approx(result.cpk)
    assert not capability(
        "lost_motion_arcmin", np.exp(2 * values), float(np.exp(2 * norm.ppf(0.98))), 0.95
    ).is_normal_plausible


def test_the_page_opens_with_the_worst_case_of_each_metric_at_any_angle():
    bounds = pd.DataFrame(
        [
            ("clearance_backlash_arcmin", 0.0, BY_PROGRAM, 3.0),
            ("clearance_backlash_arcmin", 90.0, BY_PROGRAM, 3.2),
            ("torsional_rigidity_Nm_per_arcmin", 0.0, WORST_FOUND, 4.5),
            ("torsional_rigidity_Nm_per_arcmin", 90.0, WORST_OF_VALID, 4.4),
        ],
        columns=["metric", "crank_deg", "what", "value"],
    )
    rows = [("clearance_backlash_arcmin", *row) for row in (("far", 2.5), ("far", 2.4), ("std", 9.0))]
    text = bounds_sentence(bounds, pd.DataFrame(rows, columns=["metric", "statistic", "full"]))
    backlash, rigidity = (METRICS[name] for name in ("clearance_backlash_arcmin", "torsional_rigidity_Nm_per_arcmin"))
    worst, far = (f"{backlash.text(value)} arcmin" for value in (3.2, 2.5))
    assert f"clearance backlash {worst} (99.73 % of drawn units at any one of these angles: at most {far})." in text
    assert f"where a search may miss worse cases, is torsional rigidity {rigidity.text(4.4)}" in text
    assert "lead beyond where the model is valid" in text
    assert "crank angles looked at (0°, 90°)" in text


def test_the_page_says_that_places_of_the_housings_pins_fill_a_square():
    """sqrt(2) of the limits, which are sqrt(3)/2 of the radius if uniform."""
    study = load_study("quick", ROOT)
    assert "with a uniform one its corners lie at 1.22 times the circle's radius" in square_sentence(study)
    fixed = Fixed(distribution="fixed", value_um=0.0)
    assert not square_sentence(study.with_section("tolerances", pin_tangential=fixed))

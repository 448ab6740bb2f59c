"""Yields by likelihood ratios: densities, a chain whose yield is known, the floor of effective units, and refusals."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats

from pipeline.config import Study, load_study
from pipeline.config.distributions.distribution import library
from pipeline.decisions.fresh_units import fresh_yields
from pipeline.decisions.reweighting import (
    effective_units,
    kept_of_one,
    moved_tolerances,
    reweighted_yields,
    weighted_share,
)
from pipeline.decisions.run_comparison import ComparedRun
from pipeline.errors import InputError
from pipeline.sampling.errors import Errors, draw

ROOT = Path(__file__).parent.parent.parent.parent
BACKLASH = "clearance_backlash_arcmin"
LIMIT = 1.5


def study_of(name: str = "wide", count: int = 4000, **tolerances: dict) -> Study:
    """The quick study with one limit, some of its tolerances changed."""
    quick = load_study("quick", ROOT)
    update = {key: getattr(quick.tolerances, key).model_copy(update=values) for key, values in tolerances.items()}
    limits = type(quick.limits)(**{BACKLASH: LIMIT})
    return quick.model_copy(
        update={
            "name": name,
            "samples": quick.samples.model_copy(update={"count": count}),
            "tolerances": quick.tolerances.model_copy(update=update),
            "limits": limits,
        }
    )


def chain(study: Study, start: int, stop: int) -> np.ndarray:
    """A linear chain: the eccentricity's deviation plus half of the disk's size less its allowance [um]."""
    return of_chain(draw(study, start, stop))


def of_chain(errors: Errors) -> np.ndarray:
    return errors.eccentricity + 0.5 * (errors.disk_profile - 10.0)


def run_of(study: Study) -> ComparedRun:
    values = pd.Series(chain(study, 0, study.samples.count + 1)).drop(0)  # the nominal reducer is no unit
    return ComparedRun(study, pd.DataFrame({BACKLASH: values}), pd.DataFrame())


def exact_yield(study: Study) -> float:
    """P(e + d/2 <= LIMIT) of a truncated normal e and a triangular d, by quadrature with SciPy's own laws."""
    e, d = study.tolerances.eccentricity, study.tolerances.disk_profile
    scale = (e.upper_um - e.lower_um) / 6
    normal = stats.truncnorm(-3, 3, (e.lower_um + e.upper_um) / 2, scale)
    triangle = stats.triang(0.5, d.lower_um, d.upper_um - d.lower_um)
    return integrate.quad(lambda x: normal.cdf(LIMIT - x / 2) * triangle.pdf(x), d.lower_um, d.upper_um)[0]


NARROW = {"eccentricity": {"lower_um": -1.5, "upper_um": 1.5}, "disk_profile": {"lower_um": 0.5, "upper_um": 3.0}}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("uniform", {}),
        ("triangular", {"mode_um": -1.0}),
        ("triangular", {"mode_um": 0.5}),
        ("triangular", {}),
        ("normal", {"sigma_um": 0.7, "mean_um": 0.2}),
        ("normal", {}),
    ],
)
def test_a_density_is_the_slope_of_its_own_distribution(name: str, settings: dict) -> None:
    law = library()[name](distribution=name, lower_um=-1.0, upper_um=2.0, **settings)
    probability = np.linspace(0.01, 0.99, 99)
    ends = law.deviation(probability - 1e-6), law.deviation(probability + 1e-6)
    np.testing.assert_allclose(law.density(law.deviation(probability)), 2e-6 / (ends[1] - ends[0]), rtol=1e-3)
    assert np.all(law.density(np.array([-1.1, 2.1])) == 0)


def test_wide_runs_know_the_yield_of_a_narrow_study() -> None:
    """Eight runs against the exact yield, and fresh units of the narrow study itself."""
    narrow = study_of("narrow", **NARROW)
    truth, shares = exact_yield(narrow), []
    for seed in range(8):
        wide = study_of(count=1500)
        wide = wide.model_copy(update={"samples": wide.samples.model_copy(update={"seed": seed})})
        answer = reweighted_yields(run_of(wide), narrow)
        shares.append(answer.yields[BACKLASH])
        assert set(answer.keeps) == set(NARROW)
        assert answer.units == 1500
        assert answer.effective == pytest.approx(np.prod(list(answer.keeps.values())) * answer.units, rel=0.1)
    width = np.mean([share.ci_high - share.ci_low for share in shares])
    assert abs(truth - exact_yield(wide)) > 2 * width  # the weights do it
    assert sum(share.ci_low < truth < share.ci_high for share in shares) >= 6
    mean = np.mean([share.value for share in shares])
    assert mean == pytest.approx(truth, abs=3 * width / (2 * 1.96 * np.sqrt(len(shares))))
    fresh = fresh_yields(narrow, 4000, 2000, lambda variant: ({}, {BACKLASH: of_chain(variant)}), 1)[BACKLASH]
    assert fresh.n == 2000
    assert fresh.value == pytest.approx(truth, abs=4 * np.sqrt(truth * (1 - truth) / fresh.n))


def test_its_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng, covered = np.random.default_rng(4), []
    for _ in range(400):
        x = rng.normal(size=800)
        weight = stats.norm.pdf(x, scale=0.7) / stats.norm.pdf(x)
        share = weighted_share(x < 0.9, weight, 0.95)
        covered.append(share.ci_low < stats.norm.cdf(0.9 / 0.7) < share.ci_high)
    assert np.mean(covered) > 0.92  # 0.95 within three standard errors


def test_equal_weights_have_jeffreys_interval_of_their_number() -> None:
    share = weighted_share(np.arange(50) < 40, np.full(50, 0.3), 0.95)
    assert (share.value, share.n) == (pytest.approx(0.8), 50)
    assert (share.ci_low, share.ci_high) == pytest.approx(tuple(stats.beta.ppf([0.025, 0.975], 40.5, 10.5)))
    half = weighted_share(np.array([True, False] * 50), np.repeat([1.0, 3.0], 50), 0.95)
    assert half.n == 80  # 0.25 over sum w^2 0.25 / (sum w)^2, with 50 weights of 1 and 50 of 3


def test_a_ring_keeps_next_to_nothing_and_is_refused() -> None:
    """One of 80 normal elements at 0.8 sigma keeps 1/E(w^2) = 0.8 sqrt(2 - 0.64) = 93 %, all of them 0.4 %."""
    normal = library()["normal"]
    wide = normal(distribution="normal", lower_um=-8.0, upper_um=8.0, sigma_um=1.0)
    narrow = normal(distribution="normal", lower_um=-8.0, upper_um=8.0, sigma_um=0.8)
    assert kept_of_one(wide, narrow) == pytest.approx(0.8 * np.sqrt(2 - 0.8**2), rel=1e-3)
    assert kept_of_one(wide, narrow) ** 80 == pytest.approx(0.004, abs=2e-4)
    box = library()["uniform"](distribution="uniform", lower_um=-1.0, upper_um=1.0)
    wedge = library()["triangular"](distribution="triangular", lower_um=-1.0, upper_um=1.0, mode_um=1.0)
    assert kept_of_one(box, wedge) == pytest.approx(0.75, rel=1e-7)  # E(w^2) of w = 2p is 4/3
    ring = study_of("ring", pin_tangential={"lower_um": -2.4, "upper_um": 2.4})
    with pytest.raises(InputError, match=r"moves 80 elements at once, .* keep 0\.\d+ % .*make compare"):
        moved_tolerances(study_of(), ring)


def test_too_few_effective_units_are_refused() -> None:
    tight = study_of("tight", eccentricity={"lower_um": 1.2, "upper_um": 2.0})
    with pytest.raises(InputError, match="fewer than 100 .*eccentricity keeps"):
        reweighted_yields(run_of(study_of(count=400)), tight)
    assert effective_units(np.zeros(3)) == 0


def test_what_no_unit_of_the_wide_run_has_is_refused() -> None:
    wider = study_of("wider", eccentricity={"lower_um": -3.0})
    with pytest.raises(InputError, match=r"tolerances\.eccentricity: wider reaches from -3 to 2 um, wide from -2 to 2"):
        moved_tolerances(study_of(), wider)
    variant = study_of("other").model_copy(
        update={"metrics": study_of().metrics.model_copy(update={"confidence": 0.9})}
    )
    with pytest.raises(InputError, match="metrics.confidence differs"):
        moved_tolerances(study_of(), variant)

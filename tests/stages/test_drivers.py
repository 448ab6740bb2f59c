"""The units of the drivers on a real run of a tiny study: solved like the study's own, and what is made of them."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.config import Study, load_design, parse_study
from pipeline.engine.runner import Resources, run
from pipeline.sampling.pick_freeze import error_groups
from stages.chain import STAGES

ROOT = Path(__file__).parents[2]
N, COUNT = 30, 12
METRIC = "torsional_rigidity_Nm_per_arcmin"


def tiny_study(name: str, count: int, base_samples: int, experiment: str = "monte_carlo") -> Study:
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"] |= {"count": count, "experiment": experiment}
    data["cycle"] = {"crank_deg": [0.0, 90.0], "rigid_angles": 7, "curve_angles": 1, "levels_per_branch": 2}
    data["reduce"] |= {"flank_edges_per_lobe": 12, "patch_half_width_mm": 0.3, "growth": 1.0, "largest_edge_mm": 3.0}
    data["drivers"] = {"base_samples": base_samples}
    return parse_study(data, name, f"{name}.toml", lambda design: load_design(design, ROOT))


@pytest.fixture(scope="module")
def runs(new_runs) -> Path:
    """Three runs that share the condensed disk: with drivers, with as many samples instead, and a Sobol' study."""
    folder = new_runs()
    for study, chunk in (
        (tiny_study("few", COUNT, N), 50),
        (tiny_study("many", 2 * N, 0), 100),
        (tiny_study("sobol", 8, N, "sobol"), 170),
    ):
        run(STAGES, study, ["aggregate"], folder, Resources(1, chunk))
    return folder


def units(runs: Path, study: str, stage: str) -> pd.DataFrame:
    return pd.read_parquet(runs / study / stage / "units.parquet")


def over_turn(table: pd.DataFrame) -> pd.DataFrame:
    return table[[name for name in table if name.endswith(("_worst", "_mean", "_best"))]]


def test_the_units_of_the_design_are_there_but_for_those_that_the_study_has(runs):
    groups = error_groups(tiny_study("few", COUNT, N))
    table, no_effect = units(runs, "few", "drivers"), units(runs, "many", "drivers")
    assert len(no_effect) == 0
    assert list(no_effect) == list(table)
    np.testing.assert_array_equal(table["unit"], np.arange(COUNT, (2 + len(groups)) * N))
    np.testing.assert_array_equal(table["base_sample"], table["unit"] % N)
    assert table["set"].value_counts(sort=False).to_dict() == {
        "base": N - COUNT,
        "other": N,
        **dict.fromkeys(groups, N),
    }
    assert set(table["status"]) == {"ok"}


@pytest.mark.parametrize("column", ["lost_motion_arcmin_worst", "clearance_backlash_arcmin_mean", f"{METRIC}_worst"])
def test_a_unit_has_the_metrics_that_it_has_as_a_sample_of_a_larger_study(runs, column):
    extra, samples = units(runs, "few", "drivers"), units(runs, "many", "aggregate")
    draws = extra[extra["unit"] < 2 * N]
    expected = samples.set_index("sample").loc[draws["unit"] + 1, column]  # sample 0 is the nominal reducer
    np.testing.assert_allclose(draws[column], expected, rtol=1e-9)
    assert np.ptp(expected) > 0


def test_units_of_a_sobol_study_are_those_of_a_monte_carlo_study(runs):
    """Points of a Sobol' sequence depend on each other; the sets of the design must not, in any study."""
    monte_carlo, sobol = (units(runs, name, "drivers").set_index("unit") for name in ("few", "sobol"))
    assert len(sobol) == len(monte_carlo) + COUNT
    columns = list(over_turn(monte_carlo))
    np.testing.assert_allclose(sobol.loc[monte_carlo.index, columns], monte_carlo[columns], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("statistic", ["worst", "mean"])
def test_indices_are_those_of_the_tables_units(runs, statistic):
    """By covariances over the units as pandas reads them, another form of the same estimators."""
    samples, extra = units(runs, "few", "aggregate"), units(runs, "few", "drivers")
    column = f"{METRIC}_{statistic}"
    base = np.concatenate([samples[column][1:], extra.loc[extra["set"] == "base", column]])
    variant = extra.loc[extra["set"] == "other", column].to_numpy()
    table = pd.read_parquet(runs / "few" / "aggregate" / "sensitivity.parquet")
    index = table.query("metric == @METRIC and over == @statistic").set_index(["kind", "parameter"])
    variance, centre = np.var([base, variant]), np.mean([base, variant])
    for group in error_groups(tiny_study("few", COUNT, N)):
        mixed = extra.loc[extra["set"] == group, column].to_numpy()
        numerator = np.dot(variant - centre, mixed) / N - np.dot(variant - centre, base) / N
        np.testing.assert_allclose(index.loc[("first_order", group), "index"], numerator / variance, atol=1e-9)
        np.testing.assert_allclose(index.loc[("total", group), "index"], np.mean((base - mixed) ** 2) / 2 / variance)
    assert np.all(index.loc["total", "n"] == N)
    shares = index.loc[["first_order", "total"]]
    assert np.all(shares["ci_low"] <= shares["ci_high"])


def test_a_study_without_drivers_has_rank_correlations_alone(runs):
    kinds = pd.read_parquet(runs / "many" / "aggregate" / "sensitivity.parquet")["kind"]
    assert set(kinds) == {"rank_correlation"}

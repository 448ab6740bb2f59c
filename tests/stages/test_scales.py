"""The yield against the scale of each tolerance: exact for known changes, near the load-solved units of a real run."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.config import Study, load_design, load_study, parse_study
from pipeline.config.studies.study import ALL_LIMITS
from pipeline.decisions.fresh_units import PRELOADED
from pipeline.engine.cache import Cache
from pipeline.engine.runner import Resources, run
from pipeline.engine.stage import Job
from pipeline.library.decisions import loaded_units
from pipeline.model.metrics import library
from pipeline.populations.scaled_tolerances import (
    AS_STATED,
    SCALES,
    removed_variances,
    scaled_tolerances,
    scaled_yields,
)
from pipeline.sampling.errors import draw
from pipeline.statistics.intervals import Estimate
from stages import hysteresis
from stages.chain import STAGES
from stages.clearance import rigid_plays
from stages.scales import FEWEST, LOOPS, units_solved

ROOT = Path(__file__).parents[2]
COUNT = 120
METRIC = "peak_pressure_MPa"


def coarse_study(**changes: object) -> Study:
    data = tomllib.loads((ROOT / "data/studies/quick.toml").read_text(encoding="utf-8"))
    data["samples"] |= {"count": COUNT}
    data["cycle"] = {"crank_deg": [0.0, 90.0], "rigid_angles": 7, "curve_angles": 1, "levels_per_branch": 2}
    data["reduce"] |= {"flank_edges_per_lobe": 12, "patch_half_width_mm": 0.3, "growth": 1.0, "largest_edge_mm": 3.0}
    data |= changes
    return parse_study(data, "coarse", "coarse.toml", lambda design: load_design(design, ROOT))


def test_more_tolerances_have_fewer_units_for_the_same_time():
    few, many = load_study("quick", ROOT), load_study("rv_80e", ROOT)
    assert units_solved(few) == LOOPS // (55 * len(few.cycle.crank_deg))
    assert 1 + len(SCALES) * len(scaled_tolerances(many)) == 103
    assert len(many.cycle.crank_deg) == 323  # of which every eleventh is solved
    assert units_solved(many) == LOOPS // (3 * 103 * 30) > FEWEST  # of carriers
    cycle = many.cycle.model_copy(update={"crank_deg": many.cycle.crank_deg[:11]})
    assert units_solved(many.model_copy(update={"cycle": cycle})) == LOOPS // (3 * 103 * 11)


@pytest.fixture(scope="module")
def finished(new_runs):
    folder, study = new_runs(), coarse_study()
    return study, folder, run(STAGES, study, ["scales"], folder, Resources(1, 60))


def test_yields_are_those_of_studies_with_the_scaled_tolerance(finished):
    """Pins that scatter along the circle decide the pressure, and no mean over the pins tells it."""
    study, folder, outputs = finished
    shared = hysteresis.prepare(Job(study, 1, folder, outputs, Cache(folder / ".cache", "")))
    rows = pd.DataFrame(outputs["scales"].read("yields")).set_index(["tolerance", "scale", "metric"])
    units = pd.DataFrame(outputs["scales"].read("units")).set_index(["tolerance", "scale"])
    stated = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample")
    for tolerance, scale in (("pin_tangential", 2.0), ("pin_radial", 0.25)):
        scaled = getattr(study.tolerances, tolerance).scaled_by(scale)
        tolerances = study.tolerances.model_copy(update={tolerance: scaled})
        scaled_study = study.model_copy(update={"tolerances": tolerances})
        errors = draw(scaled_study, 1, COUNT + 1)
        _, values = loaded_units(replace(shared, study=scaled_study), errors)
        interfering = [play.preloaded for _, _, play in rigid_plays(scaled_study, errors)]
        np.testing.assert_array_equal(values[PRELOADED], np.any(interfering, axis=0))
        found = units.loc[tolerance, scale].set_index("sample")
        for name in (METRIC, "clearance_backlash_arcmin"):  # which rigid bodies know between the loaded angles
            np.testing.assert_allclose(found[name], values[name], rtol=1e-9)
        estimate, truth = rows.loc[tolerance, scale, METRIC], np.mean(values[METRIC] <= 4000.0)
        assert abs(truth - np.mean(stated.loc[1:, f"{METRIC}_worst"] <= 4000.0)) > 0.01  # a change to be found
        assert estimate["value"] == pytest.approx(truth)
        assert estimate["ci_low"] <= truth <= estimate["ci_high"]
        assert estimate["n"] == COUNT
    removed = pd.DataFrame(outputs["scales"].read("variances")).set_index(["tolerance", "metric"])
    before, after = (variance(stated.loc[1:, f"{METRIC}_worst"]), variance(values[METRIC]))
    assert removed.loc[("pin_radial", METRIC), "value"] == pytest.approx(1 - after / before)
    assert removed.xs(METRIC, level="metric")["value"].idxmax() in ("pin_tangential", "pin_radial")
    here = units.loc[AS_STATED, 1.0].set_index("sample")
    np.testing.assert_allclose(here[METRIC], stated.loc[1:, f"{METRIC}_worst"], rtol=1e-9)


def variance(values: np.ndarray) -> float:
    return float(np.var(values))


def test_a_tightened_tolerance_removes_its_share_of_the_variance():
    """Of independent parts; units without a value at one scale are left out, and a constant metric has no variance."""
    rng, n = np.random.default_rng(1), 4000
    a, b = 3 * rng.standard_normal(n), 4 * rng.standard_normal(n)
    values = {(AS_STATED, 1.0): a + b, ("pin_radial", 0.25): 0.25 * a + b, ("pin_radial", 2.0): 2 * a + b}
    units = scaled_units({key: metric.tolist() for key, metric in values.items()})
    units = units.assign(**{name: 1.0 for name in library() if name != METRIC})
    units.loc[(units["scale"] == 0.25) & (units["sample"] <= 100), METRIC] = np.nan
    (row,) = removed_variances(units, 0.95)
    assert (row.tolerance, row.metric, row.n) == ("pin_radial", METRIC, n - 100)
    assert row.ci_low < 9 / 25 * (1 - 1 / 16) < row.ci_high
    assert row.ci_high - row.ci_low < 0.06
    assert list(removed_variances(units[units["sample"] < 10], 0.95)) == []


def test_every_tolerance_that_varies_has_all_scales(finished):
    study, _, outputs = finished
    rows = pd.DataFrame(outputs["scales"].read("yields"))
    of_all = rows[rows["metric"] == ALL_LIMITS]
    assert set(map(tuple, of_all[["tolerance", "scale"]].to_numpy())) == {
        (name, scale) for name in scaled_tolerances(study) for scale in SCALES
    }
    assert "pin_tangential" in scaled_tolerances(study)


def scaled_units(values: dict[tuple[str, float], list[float]]) -> pd.DataFrame:
    parts = [
        pd.DataFrame({"sample": np.arange(1, len(rows) + 1), "tolerance": name, "scale": scale, METRIC: rows})
        for (name, scale), rows in values.items()
    ]
    return pd.concat(parts)


def test_a_yield_moves_by_the_units_that_cross_the_limit():
    study = coarse_study(limits={METRIC: 10.0})
    solved = pd.DataFrame({METRIC: [8.0, 9.0, 11.0, 12.0]}, index=[1, 2, 3, 4])
    rows = scaled_units({(AS_STATED, 1.0): [7.0, 8.0, 10.0, 11.0], ("pin_radial", 2.0): [9.5, 10.5, 9.5, 13.0]})
    stated = {METRIC: Estimate(0.6, 0.5, 0.7, 1000), ALL_LIMITS: Estimate(0.6, 0.5, 0.7, 1000)}
    for row in scaled_yields(study, rows, solved, stated):  # units at 10.5, 11.5, 10.5 and 14: none passes, two did
        assert (row.tolerance, row.scale, row.n) == ("pin_radial", 2.0, 4)
        assert row.value == pytest.approx(0.1)
        assert row.ci_low <= 0.1 <= row.ci_high
        assert row.ci_high - row.ci_low > 0.2  # wider than the interval of the study


def test_a_scale_that_moves_no_unit_over_the_limit_keeps_the_yield_and_widens_its_interval():
    """Of three units none moved; a few of the others may."""
    study = coarse_study(limits={METRIC: 10.0})
    solved = pd.DataFrame({METRIC: [8.0, 9.0, 11.0]}, index=[1, 2, 3])
    rows = scaled_units({(AS_STATED, 1.0): [1.0, 2.0, 3.0], ("pin_radial", 0.5): [1.1, 2.1, 3.1]})
    (row,) = scaled_yields(study, rows, solved, {METRIC: Estimate(0.6, 0.5, 0.7, 1000)})
    assert row.value == pytest.approx(0.6)
    assert row.ci_low < 0.45
    assert row.ci_high > 0.75


def test_units_without_a_value_at_the_scale_are_left_out():
    study = coarse_study(limits={METRIC: 10.0})
    solved = pd.DataFrame({METRIC: [8.0, 9.0, 11.0, np.nan]}, index=[1, 2, 3, 4])
    rows = scaled_units({(AS_STATED, 1.0): [1.0, 2.0, 3.0, 4.0], ("pin_radial", 0.5): [1.0, np.nan, 1.0, 4.0]})
    (row,) = scaled_yields(study, rows, solved, {METRIC: Estimate(0.4, 0.3, 0.5, 1000)})
    assert row.n == 2
    assert row.value == pytest.approx(0.9)
    yields = {METRIC: Estimate(0.4, 0.3, 0.5, 1000)}
    (without,) = scaled_yields(study, rows[rows["sample"] != 2], solved.drop(2), yields)
    assert row.ci_low == pytest.approx(without.ci_low * 2 / 3)  # the third unit has none, and may fail
    assert without.ci_low > 0


def test_without_a_limit_nothing_is_scaled():
    assert scaled_tolerances(coarse_study(limits={})) == []


def test_a_transmission_error_grows_in_proportion_and_a_metric_of_a_loop_by_a_difference():
    """A few angles show 6 of the 9 arcsec of the whole turn: half as much at them is half as much over the turn."""
    study = coarse_study(limits={"transmission_error_arcsec": 5.0, METRIC: 10.0})
    solved = pd.DataFrame({METRIC: [9.0, 9.0], "transmission_error_arcsec": [9.0, 12.0]}, index=[1, 2])
    rows = scaled_units({(AS_STATED, 1.0): [8.0, 8.0], ("pin_radial", 0.5): [8.5, 8.5]})
    rows["transmission_error_arcsec"] = [6.0, 8.0, 3.0, 4.0]  # 4.5 and 6 over the turn; a difference leaves 6 and 8
    stated = {name: Estimate(0.5, 0.4, 0.6, 1000) for name in ("transmission_error_arcsec", METRIC, ALL_LIMITS)}
    yields = {row.metric: row.value for row in scaled_yields(study, rows, solved, stated)}
    assert yields == pytest.approx({"transmission_error_arcsec": 1.0, METRIC: 0.5, ALL_LIMITS: 1.0})


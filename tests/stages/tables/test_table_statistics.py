"""Statistics of the tables: what they are of, and what failed samples and missing numbers leave of them."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_study import run_study

from pipeline import assembly
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.load_history.response import respond
from pipeline.model.metrics import library
from pipeline.sampling.errors import draw
from stages import clearance, hysteresis
from stages.tables.convergence import convergence_rows, worst_of_stride
from stages.tables.distributions import distribution_rows
from stages.tables.turn import Turn


def test_statistics_leave_the_nominal_sample_out(frames):
    metrics, table = frames["aggregate/metrics"], frames["aggregate/distributions"]
    counted = metrics[metrics["sample"] > 0]
    table = table.set_index(["metric", "crank_deg", "statistic"])
    name = "lost_motion_arcmin"
    for crank, part in counted.groupby("crank_deg"):
        assert table.loc[(name, crank, "mean"), "value"] == pytest.approx(part[name].mean(), rel=1e-12)
        assert table.loc[(name, crank, "p50"), "value"] == pytest.approx(part[name].median(), rel=0.05)
        assert table.loc[(name, crank, "mean"), "n"] == 8
    worst = counted.groupby("sample")["torsional_rigidity_Nm_per_arcmin"].min().mean()
    of_worst = frames["aggregate/distributions"].query("over == 'worst' and statistic == 'mean'").set_index("metric")
    assert of_worst.loc["torsional_rigidity_Nm_per_arcmin", "value"] == pytest.approx(worst, rel=1e-12)
    assert of_worst.loc[name, "value"] == pytest.approx(counted.groupby("sample")[name].max().mean(), rel=1e-12)


def test_values_over_the_turn_are_the_extremes_of_what_the_tables_hold(frames):
    """By pandas from the tables alone; between the loaded angles the backlash is that of rigid bodies."""
    units = frames["aggregate/units"].set_index("sample")
    metrics, kinematic = frames["aggregate/metrics"], frames["clearance/kinematic"]
    by_sample = metrics.groupby("sample")
    for name in ("lost_motion_arcmin", "peak_pressure_MPa"):
        for statistic, extreme in {"worst": by_sample[name].max(), "best": by_sample[name].min()}.items():
            np.testing.assert_array_equal(units[f"{name}_{statistic}"], extreme)
        np.testing.assert_allclose(units[f"{name}_mean"], by_sample[name].mean(), rtol=1e-12)
    rigidity = by_sample["torsional_rigidity_Nm_per_arcmin"]
    assert list(units["torsional_rigidity_Nm_per_arcmin_worst"]) == list(rigidity.min())
    assert list(units["torsional_rigidity_Nm_per_arcmin_best"]) == list(rigidity.max())
    has_play = kinematic[~kinematic["preloaded"]]
    play = has_play.groupby("sample")["backlash_arcmin"]
    finite = (has_play["backlash_arcmin"] + has_play["finite_motion_arcmin"]).groupby(has_play["sample"])
    free = units.index[~units["preloaded"]]
    np.testing.assert_allclose(units["clearance_backlash_arcmin_worst"][free], finite.max()[free], atol=1e-6)
    np.testing.assert_allclose(units["clearance_backlash_arcmin_best"][free], play.min()[free], atol=1e-6)
    step = kinematic["crank_deg"] * 31 / 360
    even_rows = kinematic[np.isclose(step, step.round())].groupby("sample")["backlash_arcmin"]
    np.testing.assert_allclose(units["clearance_backlash_arcmin_mean"][free], even_rows.mean()[free], atol=1e-4)
    assert np.all((has_play["finite_motion_arcmin"] != 0).groupby(has_play["sample"]).sum() >= 3)
    whole_play = has_play["backlash_arcmin"] + has_play["finite_motion_arcmin"]
    leading = has_play.loc[whole_play.groupby(has_play["sample"]).idxmax()]
    assert np.all(leading["finite_motion_arcmin"] != 0), "the largest is one that finite motions were looked at for"
    assert np.abs(finite.max() / play.max() - 1).max() > 0.005


def test_yield_is_the_share_within_the_limits(frames, study):
    metrics, table = frames["aggregate/metrics"].query("sample > 0"), frames["aggregate/distributions"]
    shares = table.query("crank_deg == 90 and statistic == 'yield'").set_index("metric")["value"]
    rows, limits = metrics[metrics["crank_deg"] == 90], study.limits
    passes = {
        "clearance_backlash_arcmin": rows["clearance_backlash_arcmin"] <= limits.clearance_backlash_arcmin,
        "lost_motion_arcmin": rows["lost_motion_arcmin"] <= limits.lost_motion_arcmin,
        "torsional_rigidity_Nm_per_arcmin": rows["torsional_rigidity_Nm_per_arcmin"]
        >= limits.torsional_rigidity_Nm_per_arcmin,
        "peak_pressure_MPa": rows["peak_pressure_MPa"] <= limits.peak_pressure_MPa,
    }
    for name, tolerance_range in passes.items():
        assert shares[name] == pytest.approx(tolerance_range.mean()), name
    assert shares["all_limits"] == pytest.approx(np.logical_and.reduce(list(passes.values())).mean())
    assert np.all(metrics["hysteresis_loss_arcmin"] == 0)  # no friction
    np.testing.assert_array_equal(metrics["zero_torque_width_arcmin"], metrics["clearance_backlash_arcmin"])


def test_a_number_without_meaning_is_no_unit_beyond_the_limit(study):
    """Of four units one has no lost motion; of the three others two keep its limit, whatever the number of angles."""
    values = {name: np.full((4, 12), limit) for name, limit in study.limits.of_metrics.items()}
    for name in library():
        values.setdefault(name, np.ones((4, 12)))
    values["lost_motion_arcmin"][:2] = [[np.nan], [9.0]]
    turns = {name: Turn(values[name], values[name], np.full(12, True)) for name in library()}
    strides = {stride: worst_of_stride(turns, stride) for stride in (4, 2, 1)}
    rows = pd.DataFrame(convergence_rows(study, strides, np.full(4, True), {})).set_index("metric")
    assert list(rows.loc["lost_motion_arcmin", "yield"]) == pytest.approx([2 / 3] * 4)
    assert list(rows.loc["all_limits", "yield"]) == pytest.approx([2 / 3] * 4)
    assert list(rows.loc["clearance_backlash_arcmin", "yield"]) == [1.0] * 4
    no_effect = {
        **turns,
        "lost_motion_arcmin": Turn(np.full((4, 12), np.nan), np.full((4, 12), np.nan), np.full(12, True)),
    }
    strides = {stride: worst_of_stride(no_effect, stride) for stride in (4, 2, 1)}
    rows = convergence_rows(study, strides, np.full(4, True), {})
    rows = pd.DataFrame(rows).set_index("metric")
    assert rows.loc[["lost_motion_arcmin", "all_limits"], "yield"].isna().all()


def test_the_largest_backlash_is_one_with_finite_motions(study, monkeypatch):
    """They take a tenth of an arcmin off: then further angles may have the largest, until one of them is looked at."""
    monkeypatch.setattr(clearance, "LARGEST", 1)
    monkeypatch.setattr(Drive, "backlash_change", property(lambda drive: np.full(len(drive.gap), -0.1 / ARCMIN)))
    units = draw(study, 1, 5)
    plays = [play for _, _, play in clearance.rigid_plays(study, units)]
    backlash = np.stack([play.backlash for play in plays], axis=1)
    change = clearance._finite_motion(study, units, plays)
    leading = np.argmax(backlash + change, axis=1)
    assert np.all(change[np.arange(4), leading] < 0)
    assert np.any(np.count_nonzero(change, axis=1) > 1)


def test_units_without_a_result_lower_the_lower_end_of_a_yield(frames, study):
    """Three of eight units have no metrics; the others keep a limit that none reaches. Of one angle none is known."""
    units = frames["aggregate/units"].iloc[1:].copy()
    lost = [f"{name}_{value}" for name in library() for value in ("worst", "mean", "best")]
    units.loc[units.index[:3], lost] = np.nan
    study = study.model_copy(update={"limits": study.limits.model_copy(update={"lost_motion_arcmin": 1e3})})
    no_result = {name: np.full(len(units) + 1, np.nan) for name in (*library(), "preloaded")}
    shortfalls = {"whole_turn": pd.DataFrame(0.0, index=range(2), columns=list(library()))}
    rows = distribution_rows(study, SimpleNamespace(columns_at=lambda _: no_result), units, shortfalls)
    table = pd.DataFrame(rows).query("metric == 'lost_motion_arcmin' and statistic == 'yield'").set_index("over")
    of_five = 0.025 ** (1 / 5)  # Clopper and Pearson, of five that all pass
    for over in ("worst", "whole_turn"):
        row = table.loc[over]
        assert (row["value"], row["n"]) == (1.0, 5)
        assert row["ci_low"] == pytest.approx(of_five * 5 / 8, rel=1e-6), over


@pytest.mark.long
def test_a_failed_sample_keeps_its_row_and_is_in_no_statistic(outputs, frames, runs, study, monkeypatch):
    """Sample 5 finds no equilibrium at one state of the second crank angle; all others are as before."""
    failed_steps = []

    def spoiled(*arguments):
        response = respond(*arguments)
        failed_steps.append(response)
        if len(failed_steps) == 2:
            response.equilibria.converged[5, [3, 9]] = False
            response.equilibria.residual[5, 3] = 0.02
            response.converged[5] = False
        return response

    monkeypatch.setattr(hysteresis, "respond", spoiled)
    failed = run_study(study.model_copy(update={"name": "failing"}), runs)
    assert failed["hysteresis"].record["failed"] == 1
    status = pd.DataFrame(failed["hysteresis"].read("status")).set_index(["sample", "crank_deg"])["status"]
    bad = (5, 90.0)
    torque = assembly.load_cycle(study, study.cycle.levels_per_branch).state_torque[3] / 1e3
    assert status[bad] == f"no equilibrium at {torque:.4g} N m or before: residual 2.0e-02"
    assert set(status.drop(bad)) == {"ok"}
    assert len(failed["hysteresis"].read("curves")["step"]) == len(frames["hysteresis/curves"])
    keys = ["sample", "crank_deg"]
    metrics = pd.DataFrame(failed["aggregate"].read("metrics")).set_index(keys)
    assert metrics.loc[bad, list(library())].isna().all()
    assert not metrics.loc[bad].filter(like="_valid").any()
    expected = frames["aggregate/metrics"].set_index(keys)
    pd.testing.assert_frame_equal(metrics.drop(bad), expected.drop(bad), check_categorical=False)
    table = pd.DataFrame(failed["aggregate"].read("distributions")).query("statistic == 'mean'")
    rows = table[table["metric"] == "lost_motion_arcmin"]
    assert list(rows.query("over == 'angle'").set_index("crank_deg")["n"].loc[[0.0, 90.0]]) == [8, 7]
    assert list(rows.query("over != 'angle'")["n"]) == [7, 7, 7]
    units = pd.DataFrame(failed["aggregate"].read("units")).set_index("sample")
    assert units.loc[5].filter(like="_worst").isna().all()
    assert units.loc[5, "status"] == status[bad]

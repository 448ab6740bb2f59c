"""The bench: its rates are ratios of what it timed, its table is the promised one, and its picture is drawn."""

import csv
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_study
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from tests.validation import bench
from tests.validation.bench import rates
from tests.validation.bench.table import Result

RESULTS = [
    Result("loops_per_second_per_core", 6000.0, "1/s", 100, 1, "68 steps a loop"),
    Result("unloaded_per_second_per_core", 2e6, "1/s", 100, 1, "first_order"),
    Result("stage_seconds_reduce", 9.0, "s", 1, 1, "condensed anew"),
    Result("stage_seconds_reduce", 0.5, "s", 100, 2),
    Result("stage_seconds_hysteresis", 2.0, "s", 100, 2),
]


def test_table_has_the_promised_columns_and_the_picture_is_drawn(tmp_path):
    bench.write(RESULTS, tmp_path)
    rows = list(csv.DictReader((tmp_path / "bench.csv").open()))
    assert list(rows[0]) == ["name", "value", "unit", "samples", "jobs", "note"]
    assert [float(row["value"]) for row in rows] == [item.value for item in RESULTS]
    for suffix in (".png", ".svg"):
        assert (tmp_path / "figures" / "bench").with_suffix(suffix).stat().st_size > 1000


def test_floor_counts_one_solve_per_loaded_equilibrium(monkeypatch):
    monkeypatch.setattr(rates, "seconds_of", lambda action: rates.SOLVES * 1e-6 * len(action.args[1]))
    assert rates._floor_seconds(np.array([27, 27, 10])) == pytest.approx(64e-6)


def test_sizes_are_active_contacts_and_motions_of_loaded_states_only():
    class States:
        force = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 2.0]]])

    assert rates._sizes([States()], 5).tolist() == [7]


def test_preloaded_units_of_the_bench_are_preloaded_and_the_same_with_play_are_not():
    study = load_study("quick", Path(__file__).parents[2])
    sampled = draw(study, 0, 20)
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drawn = drive_of(study, study.cycle.crank_deg[0], None, assembly.errors(sampled), clearance)
    variants = rates.with_preload_and_with_play(drawn)
    assert len(variants[0].gap) == len(variants[1].gap) > 15
    for variant, interferes in zip(variants, (True, False), strict=True):
        play = rigid_play(variant.reducer, variant.gap, variant.bearing_clearance)
        assert np.all(play.preloaded == interferes)
    np.testing.assert_allclose(variants[1].gap - variants[0].gap, 2e-3 * rates.NARROWED, atol=1e-12)

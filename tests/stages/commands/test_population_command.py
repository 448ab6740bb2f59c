"""The command population: units drawn from the study do not differ from it, shifted ones do."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.model.metrics import measurable_metrics


def test_units_of_the_study_agree_with_it_and_shifted_ones_do_not(
    quick_runs: Callable[[], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    runs_folder = quick_runs()
    monkeypatch.setattr(settings, "RUNS", runs_folder)
    metrics = pd.read_parquet(runs_folder / "quick" / "aggregate" / "metrics.parquet")
    rows = metrics[(metrics["sample"] > 0) & (metrics["crank_deg"] == 0)]
    units = rows.iloc[::4][["sample", "crank_deg", *measurable_metrics()]].rename(columns={"sample": "unit"})
    capsys.readouterr()
    for name, shift, words in (("alike", 0.0, "show no difference"), ("wide", 0.5, "The units differ")):
        path = tmp_path / f"{name}.csv"
        units.assign(lost_motion_arcmin=units["lost_motion_arcmin"] + shift).to_csv(path, index=False)
        assert cli.main(["population", "--units", str(path), "--study", "quick", "--jobs", "1"]) == 0
        assert words in capsys.readouterr().out
        folder = runs_folder / "population" / "quick"
        compared = pd.read_csv(folder / "comparison.csv").set_index("metric")
        np.testing.assert_allclose(
            compared["units_mean"]["lost_motion_arcmin"], units["lost_motion_arcmin"].mean() + shift, rtol=1e-6
        )
        assert (compared["anderson_darling_p"]["lost_motion_arcmin"] < 0.01) == (shift > 0)
        assert set(pd.read_csv(folder / "candidates.csv")["tolerance"]) >= {"disk_profile", "eccentricity"}
        assert words in (folder / "population.html").read_text()


def test_a_missing_file_of_units_is_answered_in_one_line(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["population", "--units", "nowhere.csv"]) == 2
    assert "nowhere.csv" in capsys.readouterr().err

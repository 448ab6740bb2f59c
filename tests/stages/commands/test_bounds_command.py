"""The command bounds: its tables hold one another up, and no sample of the study lies beyond a bound."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.decisions import bounds, play_bounds
from pipeline.library.decisions import _at_crank
from pipeline.report.decisions.bounds import invalid_stacks
from pipeline.sampling.errors import draw
from stages.tails import at_angles
from tests.study.test_certificate import rigid_study, shared_of

ROOT = Path(__file__).parent.parent.parent.parent


@pytest.mark.long
def test_no_sample_lies_beyond_its_bounds(
    outputs: dict,
    new_runs: Callable[[], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    folder = new_runs()
    monkeypatch.setattr(settings, "RUNS", folder)
    monkeypatch.setattr(bounds, "UNITS", 100)
    text = (ROOT / "data/studies/quick.toml").read_text()
    text = text.replace("crank_deg = [0.0, 90.0]", "crank_deg = [0.0]\nrigid_angles = 31")
    start, end = text.index("[tolerances.pin_radial]"), text.index("[tolerances.ovality_2]")  # rings make it slow
    study = tmp_path / "few.toml"
    study.write_text(text[:start] + text[end:])
    assert cli.main(["bounds", "--study", str(study), "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert "linear program" in said.out
    assert "bounds  4/4 metrics and angles" in said.err  # of four metrics at one crank angle
    tables = {
        name: pd.read_parquet(folder / f"bounds/few/{name}.parquet") for name in ("bounds", "stacks", "contributions")
    }
    metrics = pd.read_parquet(folder / "few/aggregate/metrics.parquet").iloc[1:]
    bound = {(row.metric, row.what): row.value for row in tables["bounds"].itertuples()}
    backlash = metrics["clearance_backlash_arcmin"]
    assert bound["clearance_backlash_arcmin", play_bounds.LEAST_BOUND] <= backlash.min()
    assert backlash.max() <= bound["clearance_backlash_arcmin", play_bounds.ATTAINED_BOUND]
    assert (
        bound["clearance_backlash_arcmin", play_bounds.ATTAINED_BOUND]
        <= 1.01 * bound["clearance_backlash_arcmin", play_bounds.BY_PROGRAM]
    )
    assert metrics["lost_motion_arcmin"].max() <= bound["lost_motion_arcmin", bounds.WORST_FOUND]
    assert (
        bound["torsional_rigidity_Nm_per_arcmin", bounds.WORST_FOUND]
        <= metrics["torsional_rigidity_Nm_per_arcmin"].min()
    )
    np.testing.assert_allclose(tables["contributions"].groupby("metric", observed=True)["percent"].sum(), 100.0)
    assert (folder / "bounds/few/figures/bounds.png").stat().st_size > 10_000
    assert 'id="figure-bounds"' in (folder / "bounds/few/report.html").read_text()
    page = (folder / "bounds/few/report.html").read_text().replace("\u00a0", " ")
    assert "Yield implied by C<sub>pk</sub>" in page
    assert "rejected (n = 50)" in page
    assert "Means something" not in page
    spread = tables["stacks"][tables["stacks"]["statistic"] == "std"]
    off = spread.loc[(spread["linear"] / spread["full"] - 1).abs() > 0.1, "metric"].unique()
    assert ("not valid for" in page) == (len(off) > 0)


def test_each_of_several_loaded_angles_is_solved_alone() -> None:
    shared = shared_of(rigid_study())
    units = draw(shared.study, 0, 3)
    of_all = at_angles(shared, units)
    for number, crank in enumerate(shared.cranks):
        for name, values in _at_crank(shared, crank, units).items():
            np.testing.assert_array_equal(values, of_all[name][:, number])


def test_the_contributions_to_a_stack_that_is_off_are_marked() -> None:
    stacks = pd.DataFrame(
        [("a", "std", 1.05, 1.0), ("a", "mean", 9.0, 1.0), ("b", "std", 1.2, 1.0), ("c", "std", 0.85, 1.0)],
        columns=["metric", "statistic", "linear", "full"],
    )
    assert invalid_stacks(stacks) == ["b", "c"]


def test_listed_cases_have_no_box(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["bounds", "--study", "paper_tables"]) == 2
    assert "listed cases have no tolerance box" in capsys.readouterr().err

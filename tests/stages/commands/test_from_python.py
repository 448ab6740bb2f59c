"""The package from Python and from a notebook; what a dry run and a summary say."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from pipeline import cli, settings
from pipeline.config import Study
from pipeline.config.studies.optional import Tails
from pipeline.engine import work
from pipeline.engine.fingerprint import used_settings
from pipeline.engine.store import Output
from pipeline.engine.work import expected_seconds
from pipeline.errors import InputError
from pipeline.library import lots
from pipeline.sampling.errors import draw
from stages.hysteresis import HYSTERESIS
from stages.tails import TAILS
from tests.study.test_certificate import stated_dimensions

ROOT = Path(__file__).parent.parent.parent.parent
NOTEBOOK = ROOT / "data/examples/reading_results.ipynb"


@pytest.fixture(scope="module")
def own_runs(quick_runs: Callable[[], Path]) -> Path:
    return quick_runs()


def test_the_package_imports_nothing_before_it_is_asked() -> None:
    script = "import sys, pipeline; print(*sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert not {"numpy", "pydantic", "pipeline.config"} & set(process.stdout.split())
    import pipeline

    with pytest.raises(AttributeError, match="solve_everything"):
        _ = pipeline.solve_everything


def test_the_package_shows_its_names_and_takes_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pipeline

    assert {"run", "identify", "changed", "population", "compare", "allocate", "bounds", "tails"} < set(dir(pipeline))
    assert all(callable(getattr(pipeline, name)) for name in dir(pipeline))
    for name in ("ROOT", "RUNS", "PUBLISHED"):
        monkeypatch.setattr(settings, name, getattr(settings, name))
    pipeline.use_root(tmp_path)
    assert tmp_path / "data" / "runs" == settings.RUNS
    with pytest.raises(InputError, match="no such file"):
        pipeline.load_study("quick")


def test_the_certificate_of_a_unit_measured_in_full_is_the_row_of_its_study(
    outputs: dict[str, Output], study: Study, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the crank angles of the study: finite motions take 0.03 arcmin off its worst backlash."""
    (tmp_path / "first.toml").write_text(stated_dimensions(study, draw(study, 1, 2)))
    monkeypatch.setattr(settings, "RUNS", runs)
    monkeypatch.setattr(lots, "CERTIFIED_CRANKS", study.cycle.crank_deg)
    answer = lots.certificate(tmp_path / "first.toml", study, jobs=1)
    assert "nothing that varies is left to draw. The unit meets every limit at the 2 crank angles" in str(answer)
    assert "nothing is drawn" in (answer.folder / "report.html").read_text()
    found = answer.result.metrics.set_index("metric")
    row = pd.DataFrame(outputs["aggregate"].read("units")).set_index("sample").loc[1]
    value, limit = row["clearance_backlash_arcmin_worst"], study.limits.clearance_backlash_arcmin
    margin = f"clearance backlash {value:.4g} arcmin (limit {limit:g}, met by {limit - value:.2g})"
    assert margin in str(answer)
    for name in found.index:
        expected = pytest.approx(row[f"{name}_worst"], rel=1e-9)
        assert list(found.loc[name, ["low", "median", "high"]]) == [expected] * 3, name


@pytest.mark.long
def test_answers_have_tables_and_drawings_take_axes(
    quick_runs: Callable[[], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Objects of a comparison and a run, drawn on axes of the caller."""
    from matplotlib.figure import Figure

    from pipeline import compare, draw_distribution, draw_drivers, draw_loop, load_study, run

    monkeypatch.setattr(settings, "RUNS", quick_runs())
    study = load_study("quick")
    finished = run(study, ["aggregate"], jobs=1)
    axes = Figure().subplots()
    assert draw_loop(finished, axes) is axes
    assert len(axes.lines) == 1
    assert draw_distribution(finished, "lost_motion_arcmin", Figure().subplots()).get_xlabel() == "Lost motion (arcmin)"
    assert draw_drivers(finished, "lost_motion_arcmin", Figure().subplots()).patches
    with pytest.raises(KeyError, match="no curve of sample 77"):
        draw_loop(finished, axes, sample=77)
    same = compare(study, study.with_({"limits.lost_motion_arcmin": 2.9, "name": "wider"}), jobs=1)
    rows = same.to_frame()
    assert rows is same.table("differences")
    assert (rows.loc[rows["statistic"] == "mean", "difference"] == 0).all()
    assert same.report is not None
    assert same.report.is_file()
    with pytest.raises(KeyError, match="no table 'nothing'"):
        same.table("nothing")


def test_the_notebook_runs_cell_by_cell(
    own_runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Its cells as Python: they use nothing of a kernel, whose packages would be more than all others together."""
    monkeypatch.setattr(settings, "RUNS", own_runs)
    cells = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] for cell in cells)
    names: dict = {}
    for number, cell in enumerate(cells):
        exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    assert len(names["units"]) == 50
    assert set(names["yields"]["metric"]) >= {"all_limits", "lost_motion_arcmin"}
    assert names["loop"]["angle_arcmin"].max() > 1
    assert "disk_profile_um" in capsys.readouterr().out


def test_a_dry_run_says_what_would_run_and_runs_nothing(
    own_runs: Path, study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(settings, "RUNS", own_runs)
    assert cli.main(["run", "aggregate", "--study", "quick", "--jobs", "1"]) == 0
    capsys.readouterr()
    assert cli.main(["run", "--study", "quick", "--dry-run"]) == 0
    message = capsys.readouterr().out.splitlines()
    assert "hysteresis  up to date" in message
    assert [line for line in message if line.startswith("report  would run, ")]
    double_change = tmp_path / "twice.toml"
    double_change.write_text((ROOT / "data/studies/quick.toml").read_text().replace("count = 50", "count = 101"))
    assert cli.main(["run", "aggregate", "--study", str(double_change), "--dry-run"]) == 0
    message = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines() if "  " in line)
    seconds = json.loads((own_runs / "quick/hysteresis/record.json").read_text())["seconds"]
    assert message["hysteresis"] == f"would run, about {seconds * 102 / 51:.3g} s: never run"
    assert not (own_runs / "twice").exists()


def test_tails_of_another_study_are_no_timing_of_one_that_asks_for_none(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asking = study.model_copy(update={"tails": Tails(units=100_000)})
    record = {"seconds": 119.0, "started": "2026", "settings": used_settings(TAILS, asking)}
    (tmp_path / "asking").mkdir()
    monkeypatch.setattr(work.Output, "open", lambda folder: SimpleNamespace(record=record))
    assert expected_seconds(TAILS, asking, tmp_path) == 119.0
    assert expected_seconds(TAILS, study, tmp_path) is None


def test_the_expected_time_of_a_stage_is_in_proportion_to_units_angles_and_pins(study: Study, tmp_path: Path) -> None:
    """By the calibrated time of a unit, and by a record of a run with other numbers of units and angles."""
    per_unit = HYSTERESIS.unit_seconds * study.design.cycloid.pins
    assert expected_seconds(HYSTERESIS, study, tmp_path) == pytest.approx(per_unit * study.samples.rows * 2)
    wide, widest = (
        study.with_({"samples.count": count, "cycle.crank_deg": [0.0, 1.0, 2.0, 3.0]}) for count in (20, 1000)
    )
    settings_of_run = used_settings(HYSTERESIS, study)
    record = {"seconds": 3.0, "started": "2026", "settings": settings_of_run, "items": study.samples.rows}
    (tmp_path / "former").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work.Output, "open", lambda folder: SimpleNamespace(record=record))
        expected, expected_widest = (expected_seconds(HYSTERESIS, item, tmp_path) for item in (wide, widest))
    assert expected == pytest.approx(3.0 * wide.samples.rows / study.samples.rows * 2)
    assert expected_widest == pytest.approx(per_unit * widest.samples.rows * 4)  # a small run is mostly its beginning


def test_a_run_is_summed_up(own_runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(settings, "RUNS", own_runs)
    assert cli.main(["run", "aggregate", "--study", "quick", "--jobs", "1"]) == 0
    assert cli.main(["show", "quick"]) == 0
    message = capsys.readouterr().out
    assert "lost_motion_arcmin  mean 2." in message
    assert "all_limits  yield" in message
    assert "51 units" in message
    assert "zero_torque_width_arcmin" not in message, "it equals the backlash, of which more crank angles are known"
    backlash = next(line for line in message.splitlines() if line.startswith("clearance_backlash_arcmin"))
    assert backlash.endswith("crank angles)")
    assert "for +-1 % on the yield against all limits take " in message
    assert cli.main(["show", "nowhere"]) == 2


def test_a_unit_that_is_not_there_is_an_input_error() -> None:
    from pipeline import identify

    with pytest.raises(InputError, match="no_such_unit"):
        identify("no_such_unit")


@pytest.mark.attack
def test_the_readmes_five_lines_run() -> None:
    readme = (ROOT / "README.md").read_text()
    (snippet,) = [block.split("```")[0] for block in readme.split("```python\n")[1:] if "from pipeline import" in block]
    names: dict = {}
    exec(compile(snippet, "README.md", "exec"), names)
    assert names["unit"].verdict == "identified"

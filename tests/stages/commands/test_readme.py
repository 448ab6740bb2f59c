"""Every command and snippet of the README, as a user would type it."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow.dataset
import pytest

from pipeline import cli, settings
from pipeline.engine.store import Output
from pipeline.identification.results import tables

ROOT = Path(__file__).parent.parent.parent.parent
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_pandas_snippet_runs_on_a_run(
    outputs: dict[str, Output], runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    snippet = blocks("python")[0]
    (runs.parent / "data").mkdir(exist_ok=True)
    link = runs.parent / "data" / "runs"
    link.unlink(missing_ok=True)
    link.symlink_to(runs)
    monkeypatch.chdir(runs.parent)
    exec(compile(snippet, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "crank_deg" in printed
    assert "lost_motion_arcmin_worst" in printed
    rows = pd.DataFrame(outputs["aggregate"].read("sensitivity"))
    ranks = rows[(rows["kind"] == "rank_correlation") & (rows["metric"] == "lost_motion_arcmin")]
    first = ranks.loc[ranks["index"].abs().idxmax()]
    assert first["parameter"] in printed
    assert f"{first['index']:.6f}" in printed


def test_unit_and_meaning_are_read_as_the_readme_says_of_files_and_of_folders(outputs: dict[str, Output]) -> None:
    (expression,) = re.findall(r"`(pyarrow\.dataset\..*?\.metadata)`", README)
    for path in (outputs["aggregate"].folder / "units.parquet", outputs["sample"].folder / "reducer.parquet"):
        assert path.is_dir() == (path.stem == "reducer")
        metadata = eval(expression, {"pyarrow": pyarrow, "path": path, "name": "sample"})
        assert set(metadata) == {b"unit", b"meaning"}


@pytest.mark.long
def test_the_lines_of_other_readers_say_what_pandas_says(
    outputs: dict[str, Output], runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their answers, caught where they are printed, against the same questions asked of pandas."""
    (snippet,) = [block for block in blocks("python") if "duckdb" in block]
    (runs.parent / "data").mkdir(exist_ok=True)
    link = runs.parent / "data" / "runs"
    link.unlink(missing_ok=True)
    link.symlink_to(runs)
    monkeypatch.chdir(runs.parent)
    printed: list = []
    exec(compile(snippet, "README.md", "exec"), {"print": printed.append})
    yields, forces = (relation.df() for relation in printed[:2])
    table = pd.DataFrame(outputs["aggregate"].read("distributions"))
    yield_rows = table[(table["over"] == "worst") & (table["statistic"] == "yield")]
    assert dict(zip(yields["metric"], yields["value"], strict=True)) == dict(
        zip(yield_rows["metric"], yield_rows["value"], strict=True)
    )
    contacts = pd.DataFrame(outputs["hysteresis"].read("contacts")).groupby("sample")["force_N"].max()
    assert forces.set_index("sample")["force_N"].sort_index().to_dict() == contacts.to_dict()
    units = pd.DataFrame(outputs["aggregate"].read("units"))
    asked_units = [name for name in units if name.endswith("_arcmin_worst")]
    assert printed[2].row(0, named=True) == pytest.approx(
        {name: units[name].quantile(0.95, interpolation="nearest") for name in asked_units}
    )


@pytest.mark.long
def test_one_unit_and_the_contacts_of_one_sample(
    quick_runs: Callable[[], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    runs_folder = quick_runs()
    monkeypatch.setattr(settings, "RUNS", runs_folder)
    (line,) = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("printf")]
    dimensions = tmp_path / "unit17.toml"
    dimensions.write_text(shlex.split(line)[1].replace("\\n", "\n"))
    assert cli.main(["unit", "pham2017", "--dimensions", str(dimensions), "--study", "quick", "--jobs", "1"]) == 0
    printed = capsys.readouterr().out
    assert "lost_motion_arcmin" in printed
    assert (runs_folder / "unit-unit17" / "report" / "report.html").exists()
    assert cli.main(["resolve", str(ROOT / "data/studies/quick.toml"), "--sample", "7", "--jobs", "1"]) == 0
    rows = pd.read_parquet(runs_folder / "quick" / "resolved" / "contacts-7.parquet")
    assert set(rows["sample"]) == {7}
    assert rows["force_N"].max() > 1


def test_a_mistake_is_answered_in_one_line_without_a_traceback(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["run", "sampel", "--study", "quick"]) == 2
    assert capsys.readouterr().err.strip().endswith("did you mean sample?")
    assert cli.main(["resolve", "quick", "--sample", "1000"]) == 2
    assert "samples 0 to 50" in capsys.readouterr().err
    assert cli.main(["run", "--study", "quick", "--backend", "dask"]) == 2
    assert "--scheduler" in capsys.readouterr().err


def test_the_snippet_on_a_unit_reads_the_columns_that_its_tables_have() -> None:
    snippet = blocks("python")[-1]
    columns = {column.name for table in (tables.CANDIDATES, tables.RESIDUAL) for column in table.columns}
    names = set(re.findall(r'"([a-z_]+)"', snippet))
    assert names
    assert names <= columns

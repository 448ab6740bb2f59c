"""Tables of a run that is read block by block are those of one that is read whole."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.engine.cache import Cache
from pipeline.engine.stage import Job
from pipeline.report.frames import OK
from stages import aggregate, report


@pytest.fixture
def job(study, outputs, tmp_path: Path) -> Job:
    return Job(study, 1, tmp_path, outputs, Cache(tmp_path / "cache", ""))


def frames_of(job: Job) -> dict[str, pd.DataFrame]:
    """The tables of the stage aggregate."""
    tables = aggregate.AGGREGATE.run(job)
    return {
        name: pd.concat(map(pd.DataFrame, columns)) if isinstance(columns, Iterator) else pd.DataFrame(dict(columns))
        for name, columns in tables.items()
    }


@pytest.mark.parametrize(
    ("constant", "at_once"),
    [("SAMPLES_AT_ONCE", 1), ("SAMPLES_AT_ONCE", 4), ("ROWS_AT_ONCE", 9), ("UNITS_AT_ONCE", 4)],
)
@pytest.mark.long
def test_blocks_of_samples_give_the_tables_of_all_samples(job, monkeypatch, constant: str, at_once: int) -> None:
    whole = frames_of(job)
    assert len(whole["units"]) == 9
    monkeypatch.setattr(aggregate, constant, at_once)
    blocks = aggregate._blocks(job) if constant != "UNITS_AT_ONCE" else aggregate.AGGREGATE.run(job)["units"]
    assert len(list(blocks)) > 1
    for name, frame in frames_of(job).items():
        pd.testing.assert_frame_equal(
            frame.reset_index(drop=True), whole[name].reset_index(drop=True), check_exact=True
        )
    assert list(job.folder.iterdir()) == []  # nothing is left of what was kept in a file


def test_the_page_reads_the_rows_of_metrics_that_it_names(study, outputs, job, monkeypatch) -> None:
    """The first samples, every row that is not sound, and one that shows a hysteresis loss."""
    metrics = pd.DataFrame(outputs["aggregate"].read("metrics"))
    metrics["status"] = metrics["status"].astype(object)
    metrics.loc[metrics["sample"] == 5, "status"] = "no equilibrium"
    metrics.loc[(metrics["sample"] == 6) & (metrics["crank_deg"] == 90.0), list(report.METRICS)] = np.nan
    metrics.loc[metrics["sample"] == 7, "hysteresis_loss_arcmin"] = 0.5
    monkeypatch.setattr(
        Job, "read_items", lambda self, stage, table, a, b: metrics[(metrics["sample"] >= a) & (metrics["sample"] < b)]
    )
    monkeypatch.setattr(report, "ROWS_SHOWN", 2)
    monkeypatch.setattr(report, "SAMPLES_AT_ONCE", 3)
    rows = report._named_metrics(job)
    assert list(zip(rows["sample"], rows["crank_deg"], strict=True)) == [
        (0, 0.0), (0, 90.0), (1, 0.0), (1, 90.0), (5, 0.0), (5, 90.0), (6, 90.0), (7, 0.0),
    ]  # fmt: skip
    assert list(rows["status"] != OK) == [False] * 4 + [True] * 2 + [False] * 2

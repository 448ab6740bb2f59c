"""A run of the tiny study, its page and its tables, once for all tests of the page."""

from pathlib import Path

import pytest
from tiny_pages import frames_of, tiny_study

from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from pipeline.report.frames import Frames
from stages.chain import STAGES


@pytest.fixture(scope="session")
def page_runs(new_runs) -> Path:
    return new_runs()


@pytest.fixture(scope="session")
def page_outputs(page_runs, run_once) -> dict[str, Output]:
    study, resources = tiny_study("tiny"), Resources(1, 7)
    return run_once("tiny", page_runs / "tiny", lambda: run(STAGES, study, ["report"], page_runs, resources))


@pytest.fixture(scope="session")
def page(page_outputs) -> str:
    return (page_outputs["report"].folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")


@pytest.fixture(scope="session")
def frames(page_runs, page_outputs) -> Frames:
    return frames_of(tiny_study("tiny"), page_runs)

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
def page_outputs(page_runs) -> dict[str, Output]:
    return run(STAGES, tiny_study("tiny"), ["report"], page_runs, Resources(1, 7))


@pytest.fixture(scope="session")
def page(page_outputs) -> str:
    return (page_outputs["report"].folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")


@pytest.fixture(scope="session")
def frames(page_runs, page_outputs) -> Frames:
    return frames_of(tiny_study("tiny"), page_runs)

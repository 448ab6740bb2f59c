"""A small study of the paper's reducer, run once for all tests of the stages."""

from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock
from small_study import run_study, small_study

from pipeline.config import Study
from pipeline.engine.store import Output


@pytest.fixture(scope="session")
def runs(new_runs: Callable[[], Path]) -> Path:
    """Folder of all runs: they share the condensed disk."""
    return new_runs()


@pytest.fixture(scope="session")
def study() -> Study:
    return small_study()


@pytest.fixture(scope="session")
def outputs(runs: Path, session_folder: Path) -> dict[str, Output]:
    with FileLock(session_folder / "quick.lock"):  # its disk is condensed by one process
        return run_study(small_study(), runs)

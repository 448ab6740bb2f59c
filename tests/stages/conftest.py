"""A small study of the paper's reducer, run once for all tests of the stages."""

from collections.abc import Callable
from pathlib import Path

import pytest
from small_study import ROOT, run_study, small_study

from pipeline.config import Study, load_study
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from stages.chain import STAGES


@pytest.fixture(scope="session")
def runs(new_runs: Callable[[], Path]) -> Path:
    """Folder of all runs: they share the condensed disk."""
    return new_runs()


@pytest.fixture(scope="session")
def study() -> Study:
    return small_study()


@pytest.fixture(scope="session")
def outputs(runs: Path, run_once: Callable) -> dict[str, Output]:
    return run_once("quick", runs / "quick", lambda: run_study(small_study(), runs))


@pytest.fixture(scope="session")
def quick_runs(outputs: dict[str, Output], new_runs: Callable[[], Path], run_once: Callable) -> Callable[[], Path]:
    """Makes a folder of runs in which the whole quick study is aggregated; its disk is that of the small one."""
    study = load_study("quick", ROOT)

    def new_folder() -> Path:
        folder = new_runs()
        run_once("whole quick", folder / "quick", lambda: run(STAGES, study, ["aggregate"], folder, Resources(1, 250)))
        return folder

    return new_folder

"""A small study of the paper's reducer, run once for all tests of the stages."""

from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from pipeline.config import Study, load_study
from pipeline.engine.runner import Resources, run
from pipeline.engine.store import Output
from stages.chain import STAGES

ROOT = Path(__file__).parent.parent.parent
LAST = "aggregate"


def small_study(**samples: object) -> Study:
    """The quick study with few samples and all contacts kept; ``samples`` change its samples."""
    study = load_study("quick", ROOT)
    return study.model_copy(
        update={
            "samples": study.samples.model_copy(update={"count": 8, **samples}),
            "cycle": study.cycle.model_copy(update={"keep_contacts": "all"}),
        }
    )


def run_study(study: Study, runs: Path, jobs: int = 1, chunk: int = 100) -> dict[str, Output]:
    return run(STAGES, study, [LAST, "tails"], runs, Resources(jobs, chunk))


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

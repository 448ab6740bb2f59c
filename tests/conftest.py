"""What the processes of a test run share: cores and condensed disks, each made by one of them, once."""

import gc
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

os.environ["OPENBLAS_NUM_THREADS"] = "1"
"""Before numpy is imported: threads of two processes on two cores wait for each other, most of the time in vain."""
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
"""Sources are parsed once, not again by every process that a test starts: two thirds of the time of its imports."""

gc.disable()
"""Until all is collected: a tenth of the time of importing 400 files would go to garbage that is not there."""

settings.register_profile("alike", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("alike")  # the same examples everywhere, however slow the machine

BEGUN_FIRST = (
    "test_friction_of_disks",  # compiles all forms of the solver, and what they share once
    *("test_verify", "test_series", "test_kills", "test_turning_drive", "test_results", "test_page_numbers"),
    *("test_whole_turn", "test_browser", "test_changed", "test_registered", "test_lots", "test_blind"),
    *("test_recovery", "test_perforation", "test_dask", "test_compiled", "test_until", "test_generic_drive"),
    *("test_record", "test_drivers_of_turn", "test_effects_of_designs", "test_carrier_chain", "test_turn"),
    *("test_noise", "test_intervals", "test_refitted", "test_chain", "test_names", "test_other_laboratories"),
    *("test_holes_chain", "test_tails", "test_random_designs", "test_page_agrees", "test_damage", "test_population"),
    *("test_wheel", "test_allocate_command", "test_coverage", "test_summary"),
)
"""The longest files, longest first: none of them is begun last, when the other processes would wait for it."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {name: number for number, name in enumerate(BEGUN_FIRST)}
    if missing := set(rank) - {path.stem for path in Path(__file__).parent.rglob("test_*.py")}:
        raise pytest.UsageError(f"tests/conftest.py: BEGUN_FIRST names files that are not there: {sorted(missing)}")
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


def pytest_collection_finish() -> None:
    gc.freeze()  # what is imported and collected stays: it need not be gone through again
    gc.enable()


@pytest.fixture(scope="session")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of all processes of this test run."""
    base_folder = tmp_path_factory.getbasetemp()
    return base_folder.parent if "PYTEST_XDIST_WORKER" in os.environ else base_folder


@pytest.fixture(scope="session")
def new_runs(tmp_path_factory: pytest.TempPathFactory, session_folder: Path) -> Callable[[], Path]:
    """Makes a folder of runs; their cache is that of all processes: a disk is condensed by the first that needs it."""
    cache = session_folder / "cache"
    cache.mkdir(exist_ok=True)

    def new_folder() -> Path:
        folder = tmp_path_factory.mktemp("home") / "runs"
        folder.mkdir()
        (folder / ".cache").symlink_to(cache)
        return folder

    return new_folder


@pytest.fixture(scope="session")
def run_once(session_folder: Path) -> Callable:
    """Calls what runs a study for the first process that asks: the others copy its run and find it up to date."""

    def outputs_of(key: str, run: Path, make: Callable) -> dict:
        """What ``make`` returns; the folder ``run`` is that of its run."""
        stored = session_folder / "finished" / key
        with FileLock(session_folder / f"{key}.lock"):
            if stored.exists():
                shutil.copytree(stored, run, symlinks=True)
            outputs = make()
            if not stored.exists():
                shutil.copytree(run, stored, symlinks=True)
        return outputs

    return outputs_of

"""Compliances of the paper's reducer on the quick study's coarse mesh, condensed once for all tests here."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from small_study import save_named
from synthetic_unit import CRANKS, EXAMPLE, ROOT, TRIED, Condensed

from pipeline import assembly, cli, settings
from pipeline.config import load_study
from pipeline.config.studies.study import Study
from pipeline.engine.runner import Resources, run
from pipeline.figures import style
from pipeline.identification.fitting.problem import candidates
from pipeline.identification.selection import model_selection
from stages.chain import STAGES
from stages.tables.condensed import full_compliance


@pytest.fixture(scope="session")
def identified_example(new_runs: Callable[[], Path], session_folder: Path) -> Callable[[Sequence[str]], Path]:
    """Results of the README's command on the example with friction, of some effects; their first user runs it."""

    def folder_of(offered: Sequence[str]) -> Path:
        finished = session_folder / f"example with {len(offered)} effects"
        with FileLock(f"{finished}.lock"), pytest.MonkeyPatch.context() as patch:
            if not finished.exists():
                runs = new_runs()
                patch.setattr(settings, "RUNS", runs)
                patch.setattr(model_selection, "candidates", lambda: {name: candidates()[name] for name in offered})
                assert cli.main(["identify", "--unit", EXAMPLE, "--jobs", "1"]) == 0
                finished.symlink_to(runs / "identify" / EXAMPLE)
        return finished.resolve()

    return folder_of


@pytest.fixture(scope="session")
def friction_example(identified_example: Callable[[Sequence[str]], Path]) -> Path:
    """The same of ``TRIED`` effects."""
    return identified_example(TRIED)


@pytest.fixture(scope="module", autouse=True)
def figures_left_empty(request: pytest.FixtureRequest) -> Iterator[None]:
    """Figures are made but not printed, half a second each; ``test_results`` prints those of its page."""
    with pytest.MonkeyPatch.context() as patch:
        if request.module.__name__ != "test_results":
            patch.setattr(style, "save", save_named())
        yield


@pytest.fixture(scope="session")
def condensed(new_runs: Callable[[], Path], session_folder: Path) -> Condensed:
    """Compliances of the quick study's design at some of ``CRANKS``."""
    study = load_study("quick", ROOT)
    study = study.model_copy(update={"cycle": study.cycle.model_copy(update={"crank_deg": CRANKS})})
    with FileLock(session_folder / "quick.lock"):  # its disk is condensed by one process
        path = run(STAGES, study, ["reduce"], new_runs(), Resources(1, 100))["reduce"].path("compliance.npz")
    matrices = {crank: full_compliance(path, assembly.reducer(study.design, crank), crank) for crank in CRANKS}

    def at(_: Study, cranks: Sequence[float]) -> list[np.ndarray]:
        return [matrices[crank] for crank in cranks]

    return at

"""The solver compiled in another process while a study's first stages run."""

from pathlib import Path

import psutil
import pytest

from pipeline.library import running


def test_another_process_compiles_the_solver_only_where_none_has_and_ends_with_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = tmp_path / "begun"
    monkeypatch.setattr(running, "COMPILES_SOLVER", f"open({str(begun)!r}, 'w'); import time; time.sleep(600)")
    for compiled in (True, False):
        monkeypatch.setattr(running, "solver_is_compiled", lambda compiled=compiled: compiled)
        before = set(psutil.Process().children())
        with running.solver_compiled_ahead():
            started = set(psutil.Process().children()) - before
            while not compiled and not begun.exists():
                assert all(process.is_running() for process in started)
        assert begun.exists() != compiled
        assert len(started) == (not compiled)
        assert not any(process.is_running() for process in started)

"""The compiler's cache between processes."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from pipeline.model import compiled

ROOT = Path(__file__).parent.parent.parent
ENTRIES = """
import sys
from pathlib import Path
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher
from pipeline import cli
from pipeline import settings
from pipeline.library import running
settings.RUNS = Path(sys.argv[1])
running.solver_is_compiled = lambda: True
for study in sys.argv[2:]:
    assert cli.main(["run", "hysteresis", "--study", study, "--jobs", "1"]) == 0
modules = [module for name, module in sys.modules.items() if name.startswith("pipeline.model")]
compiled = {value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)}
for entry in compiled:
    if not isinstance(entry._cache, NullCache):
        print(entry.__name__, len(entry.signatures))
"""
LOOP = """
import sys
from pipeline.model.compiled import entry
@entry
def tripled(number):
    return 3.0 * number
if __name__ == "__main__":
    print(tripled(1.5), sum(tripled.stats.cache_misses.values()))
"""


class Loop:
    """A small entry point and its own cache; each call is that of a process that has just begun."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
        (folder / "code").mkdir(mode=0o700)
        patch.setattr(compiled, "CACHE", folder / "code")
        patch.setattr(numba.config, "CACHE_DIR", str(folder / "code"))
        (folder / "loop_of_a_test.py").write_text(LOOP)
        self.source, self.capsys = folder / "loop_of_a_test.py", capsys

    def __call__(self) -> tuple[float, int, str]:
        """Its value, the number of loops compiled, and what was said."""
        tripled = runpy.run_path(str(self.source))["tripled"]
        return tripled(1.5), sum(tripled.stats.cache_misses.values()), self.capsys.readouterr().err


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> Loop:
    return Loop(tmp_path, monkeypatch, capsys)


def test_compiled_code_that_was_damaged_is_set_aside_and_compiled_anew(tmp_path: Path, loop: Loop) -> None:
    """Truncated, emptied, a bit flipped anywhere, its manifest gone: nothing of it is unpickled or executed."""
    assert loop() == (4.5, 1, "")
    assert loop() == (4.5, 0, "")
    (index,) = tmp_path.rglob("*.nbi")
    (code,) = index.parent.glob("*.nbc")
    original = {path: path.read_bytes() for path in (index, code, index.with_suffix(".json"))}
    for path in (index, code):
        data = original[path]
        flipped = bytearray(data)
        flipped[len(data) // 2] ^= 1
        for damaged in (data[: len(data) // 2], b"", bytes(flipped)):
            path.write_bytes(damaged)
            value, n_compiled, said = loop()
            assert (value, n_compiled) == (4.5, 1)
            assert f"{path}: not what was written; set aside" in said
    index.with_suffix(".json").unlink()
    assert loop()[1] == 1
    assert loop() == (4.5, 0, "")


def test_a_folder_a_pipe_or_a_link_in_place_of_a_file_is_set_aside(tmp_path: Path, loop: Loop) -> None:
    """Each ended in an error of the system, or waited for the pipe's other end for ever."""
    loop()
    kinds = {".json": Path.mkdir, ".nbi": os.mkfifo, ".nbc": Path.mkdir, ".lock": lambda path: path.symlink_to(path)}
    paths = {ending: next(tmp_path.rglob(f"*{ending}")) for ending in kinds}
    for ending, make in kinds.items():
        paths[ending].unlink()
        make(paths[ending])
        value, _, said = loop()
        assert value == 4.5
        assert f"{paths[ending]}: not what was written; set aside" in said
    assert loop() == (4.5, 0, "")


def started(folder: Path, *options: str) -> subprocess.Popen:
    """A process that runs the script in a folder, with a cache of compiled code in it."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(folder / "script.py"), *options]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.long
def test_a_cache_that_others_may_write_is_not_used(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(LOOP)
    assert started(tmp_path).communicate(timeout=120) == ("4.5 1\n", "")
    (folder,) = (tmp_path / "cache").glob("compiled-*")
    assert folder.stat().st_mode & 0o077 == 0
    folder.chmod(0o777)
    printed, said = started(tmp_path).communicate(timeout=120)
    assert printed == "4.5 1\n"
    assert "cannot be written, or others can" in said


POOLS = """
import multiprocessing
from concurrent.futures import ThreadPoolExecutor
def result(_):
    return tripled(1.5)
if __name__ == "__main__":
    kind = sys.argv[1]
    pool = ThreadPoolExecutor(2) if kind == "threads" else multiprocessing.get_context(kind).Pool(2)
    print(sorted(map(str, pool.map(result, range(4))))[-1])
"""


@pytest.mark.parametrize("kind", ["fork", "spawn", "threads"])
@pytest.mark.long
def test_pools_around_compiled_code_share_its_cache(tmp_path: Path, kind: str) -> None:
    """A lock made on import would be inherited across a fork, which filelock refuses."""
    (tmp_path / "script.py").write_text(LOOP.partition("if __name__")[0] + POOLS)
    process = started(tmp_path, kind)
    printed, said = process.communicate(timeout=120)
    assert (process.returncode, printed.strip()) == (0, "4.5"), said


@pytest.mark.long
def test_processes_that_start_at_once_compile_a_loop_once(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(LOOP)
    printed = [process.communicate()[0].split() for process in [started(tmp_path) for _ in range(2)]]
    assert [value for value, _ in printed] == ["4.5"] * 2
    assert sorted(int(misses) for _, misses in printed) == [0, 1]


@pytest.mark.long
def test_a_loop_is_compiled_once_however_many_samples_studies_have(tmp_path: Path) -> None:
    """Two numbers of samples, gaps exact and of first order: no array comes in another layout."""
    text = (ROOT / "data/studies/quick.toml").read_text().replace("[reduce]", '[reduce]\ndisk = "rigid"')
    studies = []
    for method, count in (("exact", 2), ("exact", 3), ("first_order", 2)):
        studies.append(tmp_path / f"{method}_{count}.toml")
        study = text.replace("count = 50", f"count = {count}").replace('method = "exact"', f'method = "{method}"')
        studies[-1].write_text(study)
    command = [sys.executable, "-c", ENTRIES, tmp_path / "runs", *studies]
    process = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=ROOT, capture_output=True, text=True
    )
    assert process.returncode == 0, process.stderr
    signatures = {name: int(number) for name, number in map(str.split, process.stdout.splitlines())}
    assert {"_solve_batch", "_first_order_gaps", "pin_distances", "_rotation_ends"} <= set(signatures)
    assert {name: number for name, number in signatures.items() if number > 1} == {}
    assert signatures["_solve_batch"] == signatures["_first_order_gaps"] == 1


@pytest.mark.long
def test_where_the_cache_cannot_be_written_it_lasts_as_long_as_the_process(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "file"), "PYTHONPATH": str(ROOT)}
    program = "from pipeline.model.compiled import CACHE; print(CACHE, flush=True)"
    worker = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {program!r}], check=True)"
    process = subprocess.run(
        [sys.executable, "-c", f"{program}; {worker}"], env=environment, capture_output=True, text=True, check=True
    )
    cache, of_worker = process.stdout.split()
    assert cache == of_worker
    assert not Path(cache).parent.exists()
    assert f"{tmp_path}/file/compiled-" in process.stderr
    assert "set NUMBA_CACHE_DIR to a folder that can" in process.stderr

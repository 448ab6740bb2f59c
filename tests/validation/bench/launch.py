"""What comes before any solving: processes that start, and code that is compiled."""

import os
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from tempfile import TemporaryDirectory

from pipeline.config import Study
from pipeline.library.running import COMPILES_SOLVER
from tests.validation.bench.table import Result

COMMANDS = (("--version",), ("keys", "loaded_angles"), ("why", "report"))
"""Commands that compute nothing."""


def child_seconds(command: Sequence[str], environment: Mapping[str, str] | None = None) -> float:
    """Processor time [s] of a process and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def launching(study: Study) -> Iterator[Result]:
    """Start of commands that compute nothing, and compiling the solver where nothing is compiled."""
    for command in COMMANDS:
        of_study = ("--study", study.name) if command[0] == "why" else ()
        seconds = child_seconds([sys.executable, "-m", "pipeline", *command, *of_study])
        yield Result("startup_seconds", seconds, "s", 0, 1, " ".join(("pipeline", *command, *of_study)))
    with TemporaryDirectory() as folder:
        seconds = child_seconds(
            [sys.executable, "-c", COMPILES_SOLVER, str(os.getpid())], os.environ | {"NUMBA_CACHE_DIR": folder}
        )
    yield Result("compile_seconds", seconds, "s", 0, 1, "solver and its start from an interior point, once per version")

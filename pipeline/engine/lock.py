"""One process at a time writes a run."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from pipeline.engine.store import make_way
from pipeline.errors import InputError

LOCK = ".lock"
HOLDER = ".holder"
"""Process that holds the lock: a file of its own, since some systems let nobody read a locked one."""


@contextlib.contextmanager
def lock_run(run: Path) -> Iterator[None]:
    """Hold a run for writing; the lock goes with the process, however it ends.

    Raises
    ------
    InputError
        If another process has it; names that process.
    """
    run.mkdir(parents=True, exist_ok=True)
    lock = FileLock(run / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise InputError(
            f"{run}: process {_holder(run)} is writing this run; one process at a time may; wait for it or stop it"
        ) from None
    try:
        make_way(run / HOLDER)
        (run / HOLDER).write_text(str(os.getpid()))
        yield
    finally:
        lock.release()


def _holder(run: Path) -> str:
    try:
        return (run / HOLDER).read_text().strip() if (run / HOLDER).is_file() else "(unknown)"
    except (OSError, ValueError):
        return "(unknown)"

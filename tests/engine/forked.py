"""Processes of their own for tests that end them, forked from that of the test: nothing is imported again."""

import os
import sys
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

from pipeline.engine.parallel import end_idle_workers


def forked(body: Callable, *arguments: object, said: Path = Path(os.devnull), **variables: str) -> BaseProcess:
    """A process that does what ``body`` does, in a session of its own; its messages go to the file ``said``."""
    process = get_context("fork").Process(target=_leader, args=(body, arguments, said, variables))
    process.start()
    return process


def _leader(body: Callable, arguments: tuple[object, ...], said: Path, variables: dict[str, str]) -> None:
    os.setsid()
    os.environ |= variables
    sys.stderr = said.open("w")
    try:
        body(*arguments)
    finally:
        end_idle_workers()  # nobody calls what is done at the exit of a main process

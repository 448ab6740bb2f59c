"""Calls that are made for what they write, some of them in processes forked off this one.

A fork has all that this process has imported and computed, at no cost: work of tenths of a second is worth one, where
a worker that starts anew would take longer than the work. Only Linux forks safely beside the threads of numpy (macOS
does not, Windows cannot): elsewhere every call is made in this process, with the same result.
"""

import gc
import multiprocessing
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

PATIENCE = 60.0
"""How long forks may still take when all calls are made [s]: each is work of tenths of a second. A fork can inherit
a lock that no thread of its own will ever release."""


class Call(Protocol):
    """Makes a call, here or in a fork."""

    def __call__(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call the function with the arguments."""


def _quietly(function: Callable[..., None], *arguments: Any) -> None:
    """Make a call in a fork; whatever stops it is told where the call is made once more."""
    try:
        function(*arguments)
    except (Exception, KeyboardInterrupt):
        sys.exit(1)


@contextmanager
def forked_calls(jobs: int, patience: float = PATIENCE) -> Iterator[Call]:
    """Within it calls are made in at most ``jobs`` processes, this one among them; after it all of them are finished.

    A call that fails in a fork, or whose fork is ended from outside or never ends, is made once more here and tells its
    own error: it must bear that. What it changes in memory is lost.

    Parameters
    ----------
    jobs : int
        Processes; with one every call is made in this one.
    patience : float
        Time after which a fork that has not ended is killed [s].
    """
    forks: list[tuple[Any, Callable[..., None], tuple[Any, ...]]] = []
    limit = jobs - 1 if sys.platform == "linux" else 0

    def finish(running: int) -> None:
        """Join forks that have ended, or all of them where none may be left running."""
        for fork in list(forks):
            process, function, arguments = fork
            if running and process.is_alive():
                continue
            process.join(patience)
            process.kill()
            process.join()
            forks.remove(fork)
            if process.exitcode:
                function(*arguments)

    def call(function: Callable[..., None], *arguments: Any) -> None:
        finish(limit)
        if len(forks) >= limit:
            function(*arguments)
            return
        process = multiprocessing.get_context("fork").Process(target=_quietly, args=(function, *arguments), daemon=True)
        with warnings.catch_warnings():  # Python 3.12 warns of threads: those of BLAS, which are made for forks
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        forks.append((process, function, arguments))

    gc.freeze()  # else a collection in a fork copies every page that it marks
    try:
        yield call
        finish(0)
    finally:
        gc.unfreeze()
        for process, _, _ in forks:
            process.terminate()

"""Calls that are made for what they write, some of them in processes forked off this one.

A fork has all that this process has imported and computed, at no cost: work of tenths of a second is worth one, where
a worker that starts anew would take longer than the work. Only Linux forks safely beside the threads of numpy (macOS
does not, Windows cannot): elsewhere every call is made in this process, with the same result.

Whoever is free takes the next call. The numbers of those to be made stand in a pipe and those that were made come back
in another one: no lock is shared, and no process that dies leaves more undone than the call that it was making.
"""

import gc
import multiprocessing
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from pipeline.engine.processes.parent import end_with_parent

PATIENCE = 60.0
"""How long forks may still take when no call is left [s]: each is work of tenths of a second. A fork can inherit
a lock that no thread of its own will ever release."""
WIDTH = 2
"""Bytes of a number in a pipe."""
MOST_CALLS = 16_384
"""Their numbers fit into a pipe, which holds 64 KiB."""


def _take(numbers: int) -> int | None:
    """The number of the next call; None if all are taken."""
    entry = os.read(numbers, WIDTH)
    return int.from_bytes(entry) if entry else None


def _work(calls: Sequence[Callable[[], None]], numbers: int, receipts: int, parent: int) -> None:
    """Make calls in a fork; what stops one is told where it is made once more."""
    end_with_parent(parent)
    try:
        while (number := _take(numbers)) is not None:
            with suppress(Exception):
                calls[number]()
                os.write(receipts, number.to_bytes(WIDTH))
    except KeyboardInterrupt:
        sys.exit(1)


@contextmanager
def shared_calls(calls: Sequence[Callable[[], None]], jobs: int, patience: float = PATIENCE) -> Iterator[None]:
    """From its beginning forks make the calls; at its end this process makes them too, and after it all are made.

    A call that fails in a fork, or whose fork is ended from outside or never ends, is made once more here and tells its
    own error: it must bear that. What it changes in memory is lost.

    Parameters
    ----------
    calls : at most `MOST_CALLS`.
    jobs : int
        Processes, this one among them; with one every call is made in this one.
    patience : float
        Time after which a fork that has not ended is killed [s].
    """
    assert len(calls) <= MOST_CALLS
    numbers, numbers_written = os.pipe()
    receipts_read, receipts = os.pipe()
    os.write(numbers_written, b"".join(number.to_bytes(WIDTH) for number in range(len(calls))))
    os.close(numbers_written)
    forks: list[Any] = []
    gc.freeze()  # else a collection in a fork copies every page that it marks
    try:
        may_fork = sys.platform == "linux" and not multiprocessing.current_process().daemon  # a pool's worker may not
        for _ in range(min(jobs, len(calls)) - 1 if may_fork else 0):
            context = multiprocessing.get_context("fork")
            forks.append(context.Process(target=_work, args=(calls, numbers, receipts, os.getpid()), daemon=True))
            with warnings.catch_warnings():  # Python 3.12 warns of threads: those of BLAS, which are made for forks
                warnings.simplefilter("ignore", DeprecationWarning)
                forks[-1].start()
        yield
        owed = set(range(len(calls)))
        while (number := _take(numbers)) is not None:
            calls[number]()
            owed.discard(number)
        for process in forks:
            process.join(patience)
            process.kill()
            process.join()
        os.write(receipts, len(calls).to_bytes(WIDTH))  # behind the last
        while (number := _take(receipts_read)) != len(calls):
            owed.discard(number)
        for number in sorted(owed):
            calls[number]()
    finally:
        gc.unfreeze()
        for process in forks:
            process.terminate()
        for end in (numbers, receipts_read, receipts):
            os.close(end)

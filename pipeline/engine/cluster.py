"""Chunks on the workers of a Dask cluster: who may be asked to solve them, and what happens when one of them dies."""

import ipaddress
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any
from urllib.parse import urlsplit

from pipeline.engine.parallel import Backend, SolvedChunk, Value, try_chunk
from pipeline.engine.stage import Chunk, Stage
from pipeline.errors import ChunkError, InputError

IN_FLIGHT = 4
"""Chunks a thread that are sent before the first comes back: it never waits, and this process holds few."""
PATIENCE = 10
"""Seconds in which a scheduler must answer and a first worker must have joined it."""
AUTHENTICATED_SCHEMES = ("tls", "wss")
"""Transports on which both ends show a certificate."""


@contextmanager
def dask_cluster(scheduler: str, is_trusted: bool = False) -> Iterator[Backend]:
    """The workers of a Dask cluster, connected while the context lasts.

    Parameters
    ----------
    scheduler : str
        Address, as in tls://192.0.2.1:8786.
    is_trusted : bool
        Whether the user says that nobody else reaches an address whose transport authenticates nobody.

    Raises
    ------
    InputError
        If Dask is not installed, the address is open to others than this machine and not trusted, no scheduler answers
        there, or it has no worker.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--backend dask: Dask is not installed; pip install 'distributed'") from None
    if not is_trusted and not _is_authenticated(scheduler):
        raise InputError(
            f"--scheduler = {scheduler}; authenticates nobody: whoever reaches it runs programs on every worker and on "
            "this machine; use tls://, or say --open-scheduler if nobody else can reach it"
        )
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except Exception as error:  # each transport of Dask has errors of its own, of any type
        raise InputError(f"--scheduler = {scheduler}; no Dask scheduler answers there ({error}); start one") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise InputError(f"--scheduler = {scheduler}; has no worker; start one with dask worker") from None
        yield Backend("dask")


def _is_authenticated(scheduler: str) -> bool:
    """Whether an address is on the loopback, which no other machine reaches, or its transport asks for certificates."""
    address = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
    if address.scheme in AUTHENTICATED_SCHEMES:
        return True
    try:
        return address.hostname == "localhost" or ipaddress.ip_address(address.hostname or "").is_loopback
    except ValueError:  # another name
        return False


def solved_on_cluster(
    stage: Stage, shared_value: Any, chunks: Sequence[tuple[int, int]], read: Callable[[int, int], Chunk], code: str
) -> Generator[SolvedChunk]:
    """Solve chunks on the workers of the connected cluster; parameters, result and errors as `solved_chunks`.

    What all chunks share is the result of a task: sent once to a worker, and made again if the only worker that had it
    is lost. So is a chunk that was with a worker that died; after three of them it is given up.
    """
    from distributed import as_completed, get_client

    client = get_client()
    handle = client.submit(Value, shared_value, pure=False)
    waiting = iter(chunks)

    def submit(number: int) -> list[Any]:
        return [
            client.submit(try_chunk, stage, handle, read(start, stop), code, pure=False)
            for start, stop in islice(waiting, number)
        ]

    errors: list[Exception] = []
    running = as_completed(submit(IN_FLIGHT * max(1, sum(client.ncores().values()))))
    for future in running:
        try:
            result = future.result()
        except Exception as error:  # of Dask itself: a task that ended its workers, a worker that lacks the program
            result = ChunkError(f"{stage.name}: the cluster gave a chunk up: {type(error).__name__}: {error}")
        if isinstance(result, Exception):
            errors.append(result)
        else:
            yield result
        if not errors:
            running.update(submit(1))
    if errors:
        raise errors[0]

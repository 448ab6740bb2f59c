"""How the loops of this package are compiled: entry points, and the parts that they are made of.

Parts are always inlined into the entry points, which alone are cached on disk. A part that stayed a function would
exist twice, compiled by itself and within its caller, and which of the two runs would depend on whether the code
was compiled or read from the cache in this process: their sums may be ordered differently, so the last bits may differ.

The compiler's cache knows the file of the entry point alone: it stands in a folder named by the sources of the whole
package, and of other packages that bring parts, so that a changed part is never left out.

A part that is called at one place may be merged into its caller before that is compiled, not after: it is not compiled
by itself then. Parts that look at the types of their arguments cannot; a caller without the algebra has none in them.

Processes that start at once on an empty cache compile each entry point once: the first that comes, while the others
wait for it. Compiled twice at once it would take either of them as long as both.

Divisions are numpy's: by zero they give infinities. Python's, which raise, keep loops from being vectorised.
"""

import atexit
import importlib.metadata
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock
from numba import njit

from pipeline.registry import CONTACT_LAWS

PACKAGE = Path(__file__).parent


def _sources() -> Iterator[Path]:
    """Files that compiled code is made from: this package's, and those of registered ones."""
    yield from sorted(PACKAGE.rglob("*.py"))
    modules = {entry.module.partition(".")[0] for entry in importlib.metadata.entry_points(group=CONTACT_LAWS.group)}
    for spec in filter(None, map(importlib.util.find_spec, sorted(modules))):
        for folder in spec.submodule_search_locations or ():
            yield from sorted(Path(folder).rglob("*.py"))
        if spec.origin and not spec.submodule_search_locations:
            yield Path(spec.origin)


SOURCES = sha256(b"".join(path.read_bytes() for path in _sources())).hexdigest()[:12]


def _writable(folder: Path) -> Path:
    """The folder, or where it cannot be written one that lasts as long as this process and its workers."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass
    else:
        if os.access(folder, os.W_OK):
            return folder
    temporary = Path(tempfile.mkdtemp(prefix="cycloid-compiled-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(temporary)  # of processes that this one starts: they find the same folder in it
    print(
        f"{folder} cannot be written: code is compiled anew in every run, which takes some 20 s; "
        "set NUMBA_CACHE_DIR to a folder that can",
        file=sys.stderr,
    )
    return temporary / folder.name


CACHE = _writable(Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__") / f"compiled-{SOURCES}")  # type: ignore[attr-defined]
numba.config.CACHE_DIR = str(CACHE)  # type: ignore[attr-defined]

ALGEBRA = {"reassoc", "contract", "nsz", "arcp"}
"""What the compiler may assume of sums and products where their order is ours to choose; not that all is finite."""

COMPILED = {"nogil": True, "error_model": "numpy"}
INLINED = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **COMPILED}
"""Parts are called by compiled code alone: doors for Python would take a third of the compiler's time."""
BORROWED = {"_nrt": False}
"""Code that allocates nothing and counts no references: every view of an array would cost two atomic operations."""


def cached_entry(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of an entry point: compiled for the types of its arguments, by one process at a time, and cached."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = njit(cache=True, **COMPILED, **options)(function)  # type: ignore[call-overload]
        from_cache_or_compiled = dispatcher.compile
        lock = FileLock(CACHE / f"{function.__module__}.{function.__qualname__}.lock")

        def compiled(signature: object) -> object:
            CACHE.mkdir(parents=True, exist_ok=True)
            with lock:
                return from_cache_or_compiled(signature)

        dispatcher.compile = compiled
        return dispatcher

    return decorate


def compiled_before(dispatcher: Any) -> bool:
    """Whether a process has compiled an entry point of these sources, for some types."""
    return any(CACHE.glob(f"*/*.{dispatcher.__name__}-*.nbi"))


part = njit(**INLINED)  # type: ignore[call-overload]
entry = cached_entry()
algebraic_part = njit(fastmath=ALGEBRA, **INLINED, **BORROWED)  # type: ignore[call-overload]
merged_part = njit(fastmath=ALGEBRA, inline="always", **COMPILED, **BORROWED)  # type: ignore[call-overload]
borrowing_entry = cached_entry(**BORROWED)

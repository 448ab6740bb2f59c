"""How the loops of this package are compiled: entry points, and the parts that they are made of.

Parts are always inlined into the entry points, which alone are cached on disk. A part that stayed a function would
exist twice, compiled by itself and within its caller, and which of the two runs would depend on whether the code
was compiled or read from the cache in this process: their sums may be ordered differently, so the last bits may differ.

The compiler's cache knows the file of the entry point alone: it stands in a folder named by the sources of the whole
package, and of other packages that bring parts, so that a changed part is never left out.

A part that is called at one place may be merged into its caller before that is compiled, not after: it is not compiled
by itself then. Parts that look at the types of their arguments cannot; a caller without the algebra has none in them.

Arrays are copied element by element. For an assignment to a slice the compiler builds an error message about wrong
shapes, which takes 3 s.

Processes that start at once on an empty cache compile each entry point once: the first that comes, while the others
wait for it. Compiled twice at once it would take either of them as long as both.

Divisions are numpy's: by zero they give infinities. Python's, which raise, keep loops from being vectorised.
"""

import atexit
import glob
import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numba
from filelock import FileLock
from numba import njit, typeof
from numba.core.compiler_lock import global_compiler_lock

from pipeline.registry import CONTACT_LAWS

Function = TypeVar("Function", bound=Callable[..., Any])
PACKAGE = Path(__file__).parent
DAMAGED_SUFFIX = "damaged"
"""Beginning of the names of folders of compiled code that is not what was written."""


def _sources() -> Iterator[Path]:
    """Files that compiled code is made from: this package's, and those of registered ones."""
    yield from sorted(PACKAGE.rglob("*.py"))
    modules = {entry.module.partition(".")[0] for entry in importlib.metadata.entry_points(group=CONTACT_LAWS.group)}
    for spec in filter(None, map(importlib.util.find_spec, sorted(modules))):
        for folder in spec.submodule_search_locations or ():
            yield from sorted(Path(folder).rglob("*.py"))
        if spec.origin and not spec.submodule_search_locations:
            yield Path(spec.origin)


MACHINE = (platform.python_version(), numba.__version__, platform.machine(), platform.system())
SOURCES = sha256(b"".join([*(path.read_bytes() for path in _sources()), repr(MACHINE).encode()])).hexdigest()[:12]
"""Of what is compiled, and of what compiles it; the processor itself is part of the compiler's own keys."""
MANIFEST = ".json"
"""Ending of the list of an entry point's files with their hashes and sizes, beside its index."""


def _writable(folder: Path) -> Path:
    """The folder, or where others can write it or we cannot, one that lasts as long as this process and its workers."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        pass
    else:
        if os.access(folder, os.W_OK) and _is_own(folder):
            return folder
    temporary = Path(tempfile.mkdtemp(prefix="cycloid-compiled-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(temporary)  # of processes that this one starts: they find the same folder in it
    print(
        f"{folder} cannot be written, or others can: code is compiled anew in every run, which takes some 20 s; "
        "set NUMBA_CACHE_DIR to a folder that can",
        file=sys.stderr,
    )
    return temporary / folder.name


def _is_own(path: Path) -> bool:
    """Whether a file or folder is this user's, and nobody else may write it: compiled code is executed as it is."""
    if os.name != "posix":
        return True
    state = path.stat()
    return state.st_uid == os.geteuid() and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


CACHE = _writable(Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__") / f"compiled-{SOURCES}")
numba.config.CACHE_DIR = str(CACHE)

ALGEBRA = {"reassoc", "contract", "nsz", "arcp"}
"""What the compiler may assume of sums and products where their order is ours to choose; not that all is finite."""

COMPILE_OPTIONS = {"nogil": True, "error_model": "numpy"}
INLINE_OPTIONS = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **COMPILE_OPTIONS}
"""Parts are called by compiled code alone: doors for Python would take a third of the compiler's time."""
BORROWED_OPTIONS = {"_nrt": False}
"""Code that allocates nothing and counts no references: every view of an array would cost two atomic operations."""


def _files(index: Path) -> dict[str, list[Any]]:
    """Hash and size of the compiler's files of an entry point, by name: its index and its code; none of a folder."""
    paths = [path for path in index.parent.glob(f"{glob.escape(index.stem)}.*") if path.suffix in (".nbi", ".nbc")]
    return {path.name: _hash_and_size(path) if path.is_file() else [] for path in sorted(paths)}


def _hash_and_size(path: Path) -> list[Any]:
    data = path.read_bytes()
    return [sha256(data).hexdigest(), len(data)]


def _verified_files(index: Path) -> dict[str, list[Any]]:
    """The files of an entry point, if they are what was written; else they are set aside, to be compiled anew.

    The compiler would unpickle and execute them. A hash beside a file finds damage, not malice.
    """
    files, manifest = _files(index), index.with_suffix(MANIFEST)
    try:
        recorded_files = json.loads(manifest.read_bytes()) if manifest.is_file() else {}
    except (OSError, ValueError, RecursionError):
        recorded_files = {}
    if files and files == recorded_files and all(_is_own(index.parent / name) for name in files):
        return files
    _set_aside([*(index.parent / name for name in files), *([manifest] if not manifest.is_file() else [])])
    return {}


def _set_aside(paths: list[Path]) -> None:
    """Move files, or what stands in the place of a file, out of the compiler's way, if they are there."""
    present = [path for path in paths if os.path.lexists(path)]
    if present:
        folder = Path(tempfile.mkdtemp(prefix=f"{DAMAGED_SUFFIX}-", dir=CACHE))
        for path in present:
            path.rename(folder / path.name)
            print(f"{path}: not what was written; set aside in {folder}", file=sys.stderr)


class Decorator(Protocol):
    """What compiles a function, which is called as before."""

    def __call__(self, function: Function, /) -> Function: ...


def cached_entry(**options: Any) -> Decorator:
    """Decorator of an entry point: compiled for the types of its arguments, by one process at a time, and cached."""

    def decorate(function: Function, /) -> Function:
        dispatcher = njit(cache=True, **COMPILE_OPTIONS, **options)(function)
        from_cache_or_compiled = dispatcher.compile

        def compile_entry(signature: object) -> object:
            CACHE.mkdir(mode=0o700, parents=True, exist_ok=True)
            # made when it is used: a lock does not cross a fork; behind the compiler's own, so that threads do not wait
            # for each other
            lock = CACHE / f"{function.__module__}.{function.__qualname__}.lock"
            _set_aside([lock] if lock.is_symlink() or not lock.is_file() else [])
            with global_compiler_lock, FileLock(lock):
                index = Path(dispatcher._cache._cache_file._index_path)
                files_before = _verified_files(index)
                result = from_cache_or_compiled(signature)
                if (files_after := _files(index)) != files_before:
                    temporary = index.with_suffix(f".{os.getpid()}.tmp")
                    temporary.write_text(json.dumps(files_after))
                    temporary.replace(index.with_suffix(MANIFEST))
                return result

        dispatcher.compile = compile_entry
        compiled: Function = dispatcher
        return compiled

    return decorate


def compile_for(dispatcher: Any, *values: object) -> None:
    """Compile an entry point for the types of its arguments' ``values``; it is not called."""
    dispatcher.compile(tuple(map(typeof, values)))


def compiled_before(dispatcher: Any) -> bool:
    """Whether a process has compiled an entry point of these sources, for some types."""
    return any(CACHE.glob(f"*/*.{dispatcher.__name__}-*.nbi"))


part: Decorator = njit(**INLINE_OPTIONS)
entry: Decorator = cached_entry()
algebraic_part: Decorator = njit(fastmath=ALGEBRA, **INLINE_OPTIONS, **BORROWED_OPTIONS)
merged_part: Decorator = njit(fastmath=ALGEBRA, inline="always", **COMPILE_OPTIONS, **BORROWED_OPTIONS)
borrowing_entry: Decorator = cached_entry(**BORROWED_OPTIONS)

"""Computations shared by studies, found by what they depend on and used only if their hashes fit; the lock of a run."""

import contextlib
import hashlib
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from pipeline.engine import progress
from pipeline.engine.store import make_way, read_json, remove, sha256_of, write_json
from pipeline.errors import InputError

BEING_MADE = ".making-"
"""Prefix of the folder in which an entry is made."""
ABANDONED_AFTER_S = 86_400.0
"""Age of such a folder from which the process that made it is taken to have been killed."""
ENTRY = "entry.json"
"""Beside the files of an entry: its key, and each file's hash, size and, of an array, shape."""


def _confirm_all() -> None:
    """Accept every entry, as a cache of one process does."""


@dataclass(frozen=True)
class Cache:
    """Computations shared by studies, found by the hash of their key and of the code that made them.

    Attributes
    ----------
    confirm : raises if the code is not that of ``code`` any more; called before an entry is kept.
    """

    root: Path
    code: str
    confirm: Callable[[], None] = _confirm_all

    def folder(self, key: str, make: Callable[[Path], None]) -> Path:
        """Folder filled by `make(folder)`, called only if no run has done so; it appears whole or not at all.

        An entry whose files are not those that were written is named, discarded and made anew.
        """
        target = self.root / hashlib.sha256(f"{self.code}\n{key}".encode()).hexdigest()
        if os.path.lexists(target) and (fault := self._fault(target, key)):
            progress.say("cache", f"{target / fault}; discarded, made anew")
            remove(target)
        if not os.path.lexists(target):
            self.root.mkdir(parents=True, exist_ok=True)
            self._remove_abandoned()
            with tempfile.TemporaryDirectory(dir=self.root, prefix=BEING_MADE) as temporary:
                new_folder = Path(temporary) / "filled"
                new_folder.mkdir()
                make(new_folder)
                self.confirm()
                files = {path.name: _file_entry(path) for path in sorted(new_folder.iterdir())}
                write_json(new_folder / ENTRY, {"key": key, "code": self.code, "files": files})
                try:
                    new_folder.rename(target)
                except OSError:
                    if not target.exists():  # else another process was first
                        raise
        return target

    def _remove_abandoned(self) -> None:
        """Remove the folders of killed processes; another machine may hold the cache, so that only their age tells."""
        for path in self.root.glob(f"{BEING_MADE}*"):
            with contextlib.suppress(OSError):  # another process may be faster
                if time.time() - path.stat().st_mtime > ABANDONED_AFTER_S:
                    remove(path)

    def _fault(self, target: Path, key: str) -> str:
        """What is wrong with an entry, beginning with the file's name; empty if nothing is."""
        if not target.is_dir():
            return f"{ENTRY}: missing or damaged"
        entry = read_json(target / ENTRY)
        if not isinstance(entry, dict) or not isinstance(entry.get("files"), dict):
            return f"{ENTRY}: missing or damaged"
        if (entry.get("key"), entry.get("code")) != (key, self.code):
            return f"{ENTRY}: of another key"
        present = {path.name for path in target.iterdir()} - {ENTRY}
        for name in sorted(present ^ set(entry["files"])):
            return f"{name}: {'not of this entry' if name in present else 'missing'}"
        for name, file_entry in entry["files"].items():
            if _file_entry(target / name) != file_entry:
                return f"{name}: not what was written ({json.dumps(file_entry)})"
        return ""


def _file_entry(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        return {}
    entry: dict[str, Any] = {"sha256": sha256_of(path), "bytes": path.stat().st_size}
    if path.suffix == ".npy":
        try:
            entry["shape"] = list(np.load(path, mmap_mode="r", allow_pickle=False).shape)
        except (OSError, ValueError):
            entry["shape"] = None
    return entry


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

"""Answers of commands that compute nothing, kept with the size and time stamps of all files that they rest on.

``why``, ``show`` and a study that is up to date answer from files alone. Their answer is kept in the cache of the runs
and given again while no source, package, input or file of the run has another size or time stamp; nothing heavy is
imported to see that. Anything else, a damaged note included, is answered by the command itself.
"""

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline import settings

START_NS = time.time_ns()
"""A file that changed since then may not be the one that was read."""
ANSWERS = "answers"
"""Folder of the notes in the cache of the runs."""
OWN_SOURCES = tuple(settings.PROJECT / name for name in ("pipeline", "stages"))
LEFT_OUT = "__pycache__"


def kept_answer(options: argparse.Namespace) -> tuple[list[str], list[str]] | None:
    """Lines for the output and for the error stream that a command gave before, if it would give them again."""
    try:
        note = json.loads(_note(options).read_bytes())
        content = note["content"]
        if note["seal"] != _digest(content) or content["state"] != _state(content["folders"], content["files"]):
            return None
        return content["output"], content["errors"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def keep_answer(
    options: argparse.Namespace,
    output: Sequence[str],
    errors: Sequence[str],
    run: Path,
    inputs: Iterable[Path],
    sources: Iterable[Path],
) -> None:
    """Keep an answer, unless a source or an input changed while the command ran.

    Parameters
    ----------
    options : of the command.
    output, errors : its lines.
    run : folder of the run that it tells of.
    inputs : design, study, and the files that they name.
    sources : folders and files of other packages that register parts.
    """
    read = [*OWN_SOURCES, *sources], [Path(path).absolute() for path in inputs]
    if any(modified_ns >= START_NS for _, _, *times in _stamps(*read) for modified_ns in times):
        return
    folders, files = sorted({str(path) for path in [*read[0], run.absolute()]}), sorted({str(path) for path in read[1]})
    content = {"folders": folders, "files": files, "state": _state(folders, files)}
    content |= {"output": list(output), "errors": list(errors)}
    path = _note(options)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(json.dumps({"seal": _digest(content), "content": content}))
        temporary.replace(path)
    except OSError:  # runs that cannot be written: the command answers each time
        return


def _note(options: argparse.Namespace) -> Path:
    """File of the answer to a command with its options, from this folder and on these runs."""
    options_text: Mapping[str, Any] = {name: str(value) for name, value in vars(options).items()}
    digest = _digest([options_text, os.getcwd(), str(settings.RUNS.absolute())])
    return settings.RUNS / ".cache" / ANSWERS / f"{digest}.json"


def _state(folders: Iterable[str], files: Iterable[str]) -> str:
    """Hash of the stamps of folders and files, and of the Python that reads them: its version and its packages."""
    packages = [(path, os.stat(path).st_mtime_ns if os.path.exists(path) else 0) for path in sys.path]
    return _digest([sys.version, packages, list(_stamps(folders, files))])


def _stamps(folders: Iterable[str | Path], files: Iterable[str | Path]) -> Iterator[tuple[str, int, int, int]]:
    """Path, size and times of change [ns] of files, and of all in folders but hidden and compiled ones."""
    for path in files:
        yield _stamp(path)
    for folder in folders:
        if os.path.isfile(folder):  # a package of one module
            yield _stamp(folder)
        for place, inner, names in os.walk(folder):
            inner[:] = sorted(name for name in inner if name != LEFT_OUT and not name.startswith("."))
            yield from (_stamp(os.path.join(place, name)) for name in sorted(names) if not name.startswith("."))


def _stamp(path: str | Path) -> tuple[str, int, int, int]:
    try:
        state = os.stat(path)
    except OSError:  # an input that was asked for and is no file, of an earlier command of this process
        return str(path), -1, 0, 0
    return str(path), state.st_size, state.st_mtime_ns, state.st_ctime_ns


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()

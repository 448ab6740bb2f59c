"""The command line: studies and their stages, measured units, and what holds the model against the world.

Here an error becomes lines for the user: where, what was found, what to do; never a traceback.
"""

import argparse
import errno
import gc
import importlib
import re
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.cli.kept_answers import kept_answer
from pipeline.cli.parser import parser
from pipeline.errors import ChunkError, InputError, shortened

USER, OURS, INTERRUPT, PIPE = 2, 1, 130, 141
"""Exit statuses: what the user can mend; a failure of ours; Ctrl-C; nobody reads the output any more."""

MOST_LINES = 20
"""Lines of an answer."""
REMEDIES = {
    errno.ENOSPC: "free some space there; the same command resumes from the finished chunks",
    errno.EDQUOT: "free some of your quota; the same command resumes from the finished chunks",
    errno.EFBIG: "raise the limit of a file's size (ulimit -f); the same command resumes from the finished chunks",
    errno.EROFS: "work in a folder that can be written",
    errno.EACCES: "take a folder and files that you may read and write",
    errno.EPERM: "take a folder and files that you may read and write",
    errno.ENOENT: "give the path of a file or folder that is there",
    errno.ENOTDIR: "a folder is asked for; move the file out of the way",
    errno.EISDIR: "a file is asked for; move the folder out of the way",
    errno.EEXIST: "something else has this name; move it out of the way",
    errno.ELOOP: "a link is in its place; move it out of the way",
    errno.ENAMETOOLONG: "take a shorter name",
    errno.EMFILE: "raise the number of open files (ulimit -n)",
    errno.ENOMEM: "take fewer processes (--jobs 1) or smaller chunks (run.chunk)",
    errno.EIO: "the disk or the network to it fails; check it",
}


@dataclass(frozen=True)
class ErrorAnswer:
    """What a user is told of an error."""

    lines: tuple[str, ...]
    status: int


def answer(error: BaseException) -> ErrorAnswer:
    """What to tell of an error that reached the command line; an unexpected one leaves its traceback in a file."""
    match error:
        case InputError():
            return ErrorAnswer(tuple(map(shortened, _first_problems(error.problems))), USER)
        case ChunkError():
            return ErrorAnswer((shortened(str(error)),), OURS)
        case KeyboardInterrupt():
            return ErrorAnswer(("interrupted; the same command resumes from the finished chunks",), INTERRUPT)
        case BrokenPipeError():
            return ErrorAnswer((), PIPE)
        case OSError():
            return ErrorAnswer((shortened(_of_system(error)),), USER)
        case MemoryError():
            return ErrorAnswer((f"not enough memory; {REMEDIES[errno.ENOMEM]}",), USER)
        case RecursionError():
            return ErrorAnswer(("a file is nested too deeply to be read; flatten it",), USER)
    return ErrorAnswer((_fault_report(error),), OURS)


def _first_problems(problems: Sequence[str]) -> list[str]:
    """Problems, of which a screen shows the first."""
    count_beyond = len(problems) - MOST_LINES + 1
    return [*problems[: MOST_LINES - 1], f"and {count_beyond} more problems"] if count_beyond > 1 else list(problems)


def _of_system(error: OSError) -> str:
    path = next((str(name) for name in (error.filename, error.filename2) if name), "a file")
    reason = error.strerror or str(error) or type(error).__name__
    return f"{path}: {reason}; {REMEDIES.get(error.errno or 0, 'see what the system says of it')}"


def _fault_report(error: BaseException) -> str:
    with tempfile.NamedTemporaryFile("w", prefix="cycloid-", suffix=".txt", delete=False, encoding="utf-8") as file:
        file.write("".join(traceback.format_exception(error)))
    text = re.sub(r"\s+", " ", f"{type(error).__name__}: {error}")
    return shortened(f"unexpected {text}; this is a fault of the program; please report it with {file.name}")


ALLOCATED_OBJECTS = 50_000
"""Objects more than freed after which cycles of them are looked for; the 700 of Python cost 4 % of an identification's
time, as modules and their objects stay alive."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 for what the user can mend, 1 for a failure of ours."""
    return exit_status(_run, parser(), arguments)


def exit_status(
    action: Callable[[argparse.Namespace], None], program: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> int:
    """Exit status of an action on the options of a program; an error is told in lines for the user."""
    gc.set_threshold(ALLOCATED_OBJECTS)
    try:
        action(program.parse_args(arguments))
    except (Exception, KeyboardInterrupt) as error:
        outcome = answer(error)
        for line in outcome.lines:
            print(line, file=sys.stderr)
        return outcome.status
    return 0


def _run(options: argparse.Namespace) -> None:
    if options.opening:
        print(shortened(options.opening.format(**vars(options))), flush=True)  # the imports behind it take seconds
    if former_answer := kept_answer(options):
        for lines, stream in zip(former_answer, (sys.stdout, sys.stderr), strict=True):
            print("".join(f"{line}\n" for line in lines), end="", file=stream)
        return
    from pipeline.engine.progress import Heartbeat  # behind the answers that take a tenth of a second

    module, _, action = options.command.partition(".")
    with Heartbeat(options.name_of_command):
        getattr(importlib.import_module(f"pipeline.cli.{module}"), action)(options)

"""The errors that end a command, each said in full and without a traceback."""

import importlib
import re
from collections.abc import Iterable
from typing import Any

LONGEST_WORD = 160
"""Characters of an echoed value or path, more than a path has: a longer one is cut in its middle."""
LONGEST_LINE = 1200
"""Characters of a message; what is echoed is cut first."""
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that a terminal obeys or that turn a text around; shown by their codes."""


class InputError(Exception):
    """One or more problems with what the user gave: a file, a setting, a name.

    Parameters
    ----------
    problems : str or iterable of str
        Each one line: where; what was found; what is allowed; what to do.

    Attributes
    ----------
    problems : tuple of str
        The same lines. The command line prints them and exits with status 2.
    """

    def __init__(self, problems: str | Iterable[str]) -> None:
        self.problems: tuple[str, ...] = (problems,) if isinstance(problems, str) else tuple(problems)
        super().__init__(self.problems)  # the only argument, so that the error survives the way back from a worker

    def __str__(self) -> str:
        return "\n".join(self.problems)


class ModelError(InputError, ValueError):
    """A reducer, mesh or law that the model cannot represent; says which number to change.

    It is an input error, so that a user reads it as one, and for callers of the library a ValueError.
    """


class ChunkError(RuntimeError):
    """A body failed on a chunk; says stage, items and how to come back to it."""


def import_extra(package: str, extra: str) -> Any:
    """A package that only an extra of this one installs; raises InputError with the command where it is missing."""
    try:
        return importlib.import_module(package)
    except ImportError:
        remedy = f"python -m pip install 'cycloid-tolerance-study[{extra}]'"
        raise InputError(f"{package} is not installed, which this command needs; {remedy}") from None


def shortened(line: str) -> str:
    """A line in which whatever a file or a command line put into it is printable and of a readable length."""
    line = CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), line)
    words = re.sub(rf"\S{{{LONGEST_WORD},}}", lambda word: _cut(word[0], LONGEST_WORD), line)
    return _cut(words, LONGEST_LINE)


def _cut(text: str, length: int) -> str:
    tail = length // 4
    return text if len(text) <= length else f"{text[: length - tail - 3]}...{text[-tail:]}"

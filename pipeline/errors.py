"""The one exception that a user sees: a mistake of his own, said in full and without a traceback."""

from collections.abc import Iterable


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

"""The answer to a question about a study or a measured unit."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

import pandas as pd

Result = TypeVar("Result")


@dataclass(frozen=True)
class Answer(Generic[Result]):
    """What was found, in objects, tables and sentences, and the folder that it was written into.

    Attributes
    ----------
    result : the objects that the tables are made of.
    sentences : what the command prints.
    folder : of the files.
    tables : frames by name, the main one first.
    page : file name of the page, "" where there is none.
    """

    result: Result
    sentences: tuple[str, ...]
    folder: Path
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    page: str = "report.html"

    def __str__(self) -> str:
        return "\n".join(self.sentences)

    def table(self, name: str) -> pd.DataFrame:
        """A table by its name; KeyError if there is none, with the names that there are."""
        if name not in self.tables:
            raise KeyError(f"no table {name!r}; there are {', '.join(self.tables) or 'none'}")
        return self.tables[name]

    def to_frame(self) -> pd.DataFrame:
        """The main table; empty where the data allowed none."""
        return next(iter(self.tables.values()), pd.DataFrame())

    @property
    def report(self) -> Path | None:
        """The page."""
        return self.folder / self.page if self.page else None

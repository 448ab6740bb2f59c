"""What a stage is: its place in the chain, its tables, and its body; what a body is given.

A body takes columns and returns columns. It opens no file of another stage, names no path and starts no process.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.engine.cache import Cache
from pipeline.engine.store import Output
from pipeline.engine.table import Columns, Table

Tables = Mapping[str, Columns]
"""Columns of each table that a body returns, by table name."""
WholeTables = Mapping[str, Columns | Iterator[Columns]]
"""Likewise of a body that does its stage in one piece: a table too large to be held comes in blocks of items."""


@dataclass(frozen=True)
class Chunk:
    """Items `start <= item < stop` of a chunked stage, with the rows of upstream tables that belong to them."""

    start: int
    stop: int
    tables: Mapping[str, Columns] = field(default_factory=dict)
    """Upstream rows by "stage/table", as named in `Stage.chunk_reads`."""


@dataclass(frozen=True)
class Sections:
    """The parts of a study that a stage names, under their own names.

    Whatever else the study holds is out of reach: the stage would not become stale when it changes.
    """

    _study: Any
    _names: tuple[str, ...]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._names:
            return getattr(self._study, name)
        inner = tuple(path.partition(".")[2] for path in self._names if path.startswith(f"{name}."))
        if not inner:
            raise AttributeError(f"{name} is not among the sections that the stage names: {', '.join(self._names)}")
        return Sections(getattr(self._study, name), inner)


@dataclass(frozen=True)
class Job:
    """What the body of a stage is given.

    Attributes
    ----------
    study : Sections
        The sections that the stage names, as attributes; and the study's `name`.
    jobs : int
        Number of processes that the user allows.
    folder : Path
        Where the stage's output is being built.
    """

    study: Any  # Sections; what they hold is the study's own
    jobs: int
    folder: Path
    inputs: Mapping[str, Output]
    cache: Cache

    def read(self, stage: str, table: str, names: Sequence[str] | None = None) -> Columns:
        """All rows of an upstream table, of all columns or those named; raises InputError if its file is damaged."""
        return self._input(stage).read(table, names)

    def read_items(self, stage: str, table: str, start: int, stop: int) -> Columns:
        """Rows of an upstream table with `start <= sample < stop`; raises as `read`."""
        return self._input(stage).read_items(table, start, stop)

    def input_path(self, stage: str, filename: str) -> Path:
        """An extra file that an upstream stage wrote; raises InputError if it is damaged."""
        return self._input(stage).path(filename)

    def path(self, filename: str) -> Path:
        """Where to write an extra file of this stage (a picture, an archive of matrices)."""
        path = self.folder / filename
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def memo(self, key: str, make: Callable[[Path], None]) -> Path:
        """Folder that `make(folder)` filled, now or in an earlier run of any study with this key and these sources."""
        return self.cache.folder(key, make)

    def _input(self, stage: str) -> Output:
        if stage not in self.inputs:
            raise TypeError(f"stage {stage} is read but not named in `reads`; named are {sorted(self.inputs)}")
        return self.inputs[stage]


@dataclass(frozen=True)
class Stage:
    """One stage of a study: either a whole one (`run`) or one that is solved in chunks of items.

    Parameters
    ----------
    name : str
        Name of the stage, of its folder and of its make target.
    reads : tuple of str
        Upstream stages.
    sections : tuple of str
        Parts of the study that the result depends on, as attribute paths ("samples", "design.cycloid").
    tables : tuple of Table
        What it writes.
    module : str
        Module that holds the bodies; it and whatever it imports are the stage's sources.
    unit : str
        What the progress line counts.
    run : callable, optional
        `run(job) -> WholeTables`, for a stage done in one piece: one file a table, or one for each of its blocks.
    items, prepare, solve : callable, optional
        `items(job)`: how many items; `prepare(job)`: once, in the parent, what every chunk shares (picklable);
        `solve(shared, chunk) -> Tables`: rows of the chunk's items, sorted by item. A folder of parts a table.
    chunk_reads : tuple of str
        Upstream "stage/table" whose rows are handed to `solve`.
    failures : callable, optional
        `failures(tables) -> int`: how many items of a chunk have no result, for the progress line and the record.
    chunk_factor : int
        Chunks of a run that are one of this stage, whose work is the less the more items are solved together.
    proportional_to : tuple of str
        Settings that its time is proportional to, beside its items: numbers, or lists by their length.
    unit_seconds : float
        Time of an item (or of the whole) for each unit of these [s]: what is announced where no record of a run is at
        hand; 0 for a stage of a few seconds. Calibrated with the paper's study, 10,001 samples on two cores.

    Raises
    ------
    TypeError
        If the bodies are neither those of a whole nor of a chunked stage, or `chunk_reads` names a stage not read.
    """

    name: str
    reads: tuple[str, ...]
    sections: tuple[str, ...]
    tables: tuple[Table, ...]
    module: str
    unit: str = "rows"
    run: Callable[[Job], WholeTables] | None = None
    items: Callable[[Job], int] | None = None
    prepare: Callable[[Job], Any] | None = None
    solve: Callable[[Any, Chunk], Tables] | None = None
    chunk_reads: tuple[str, ...] = ()
    failures: Callable[[Tables], int] | None = None
    chunk_factor: int = 1
    proportional_to: tuple[str, ...] = ()
    unit_seconds: float = 0.0

    def __post_init__(self) -> None:
        has_chunk_body = [body is not None for body in (self.items, self.prepare, self.solve)]
        if any(has_chunk_body) == (self.run is not None) or any(has_chunk_body) != all(has_chunk_body):
            raise TypeError(f"stage {self.name}: give either run, or items, prepare and solve")
        if len({table.name for table in self.tables}) < len(self.tables):
            raise TypeError(f"stage {self.name}: two tables of one name")
        unread = [name for name in self.chunk_reads if name.partition("/")[0] not in self.reads]
        if unread:
            raise TypeError(f"stage {self.name}: chunk_reads {unread} of stages that it does not read")

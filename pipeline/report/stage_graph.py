"""Where the stages of a run stand in a drawing of what each one reads, with their times and what failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.report.layout import count_text

BOX = 124, 62
"""Width and height of a stage's box [pixels of the drawing]."""
GAP = 40, 18
"""Between boxes, across and down, likewise."""


@dataclass(frozen=True)
class StageNote:
    """A finished stage by its record: what it reads, when it ran, for how long, and how many of its items failed.

    `rows` are those of all its tables.
    """

    name: str
    reads: tuple[str, ...]
    start_time: str
    seconds: float
    items: int
    failed_items: int
    rows: int

    @classmethod
    def from_record(cls, name: str, reads: Sequence[str], record: Mapping[str, Any]) -> StageNote:
        """From the record of the stage's output."""
        items, failed_items = int(record.get("items", 0)), int(record.get("failed", 0))
        rows = sum(table["rows"] for table in record["tables"].values())
        return cls(name, tuple(reads), str(record["started"]), float(record["seconds"]), items, failed_items, rows)

    @property
    def state(self) -> str:
        """What became of it, in a few words."""
        if not self.rows:
            return "nothing asked for"
        if not self.items:
            return "complete"
        return f"{self.items:,} done" if not self.failed_items else f"{self.failed_items:,} of {self.items:,} failed"

    @property
    def ran(self) -> str:
        """When it ran: date and time of day, universal."""
        return self.start_time[:16].replace("T", " ")


@dataclass(frozen=True)
class StageBox:
    """A stage with the corner of its box in the drawing, and the share of the run's time that it took."""

    note: StageNote
    x: float
    y: float
    share: float


@dataclass(frozen=True)
class StageGraph:
    """Boxes of stages and the lines (x0, y0, x1, y1) from what is read to what reads it; all in pixels."""

    boxes: tuple[StageBox, ...]
    lines: tuple[tuple[float, float, float, float], ...]
    width: float
    height: float
    description: str


def stage_graph(notes: Sequence[StageNote]) -> StageGraph:
    """The graph of stages, upstream ones first: each stands right of all that it reads.

    A line is drawn to the stages that read another's tables directly; one that a longer path implies is left out.
    """
    notes_by_name = {note.name: note for note in notes}
    reads = {note.name: [name for name in note.reads if name in notes_by_name] for note in notes}
    upstream: dict[str, set[str]] = {}
    column: dict[str, int] = {}
    for name, sources in reads.items():
        upstream[name] = set(sources).union(*(upstream[source] for source in sources))
        column[name] = max((column[source] + 1 for source in sources), default=0)
    total = sum(note.seconds for note in notes) or 1.0
    places: dict[str, tuple[float, float]] = {}
    for name in notes_by_name:
        row = sum(column[neighbour] == column[name] for neighbour in places)
        places[name] = column[name] * (BOX[0] + GAP[0]), row * (BOX[1] + GAP[1])
    lines = []
    for name, sources in reads.items():
        implied_sources = set().union(*(upstream[source] for source in sources))
        for source in sources:
            if source not in implied_sources:
                (x0, y0), (x1, y1) = places[source], places[name]
                lines.append((x0 + BOX[0], y0 + BOX[1] / 2, x1, y1 + BOX[1] / 2))
    return StageGraph(
        tuple(StageBox(note, *places[note.name], note.seconds / total) for note in notes),
        tuple(lines),
        max(x for x, _ in places.values()) + BOX[0],
        max(y for _, y in places.values()) + BOX[1],
        "; ".join(_stage_text(note, reads[note.name]) for note in notes),
    )


def _stage_text(note: StageNote, sources: Sequence[str]) -> str:
    """A stage in words, for those who do not see the drawing."""
    origin = f" reads {', '.join(sources)}" if sources else ""
    failed_text = f", {count_text(note.failed_items, 'item')} failed" if note.failed_items else ""
    return f"{note.name}{origin}: {note.seconds:.1f} s{failed_text}"

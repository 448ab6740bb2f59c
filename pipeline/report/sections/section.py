"""What a section of the report declares, what it is told, and the library of all."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pipeline.registry import REPORT_SECTIONS
from pipeline.report.explorer import explorer_data
from pipeline.report.frames import Drawing, Frames
from pipeline.report.layout import REPORT, LinkedPicture, environment, one_file, plain_number
from pipeline.report.results import Results


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
    def from_record(cls, name: str, reads: Sequence[str], record: Mapping[str, Any]) -> "StageNote":
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
class TableNote:
    """One table of the run: where it lies, what a row is, how many there are, and its columns."""

    path: str
    row_per: str
    rows: int
    columns: tuple[str, ...]


@dataclass(frozen=True)
class Page:
    """What the page of a study is made from.

    Attributes
    ----------
    frames : the study and its tables.
    pictures : by the name of their drawing; the page leaves out what is not there.
    tables : the tables of the run.
    stages : the stages that it rests on, upstream ones first.
    versions : package -> version.
    """

    frames: Frames
    pictures: Mapping[str, LinkedPicture]
    tables: Sequence[TableNote]
    stages: Sequence[StageNote]
    versions: Mapping[str, str]

    @cached_property
    def results(self) -> Results:
        """The results as text."""
        return Results(self.frames)

    @cached_property
    def explorer(self) -> Mapping[str, object]:
        """What the script of the single units draws; empty without their figure."""
        return explorer_data(self.frames) if "units" in self.pictures else {}


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of the report, with its place among the others.

    Attributes
    ----------
    name : its anchor in the page.
    title : its heading, and its entry in the contents.
    rank : its place; sections stand in ascending order.
    is_collapsed : whether the page shows its heading alone until a reader opens it.
    template : what stands below the heading, in Jinja's language, or the file that holds it. It is told ``study``,
        ``frames``, ``results``, ``pictures``, ``level`` [%] of the intervals, and ``values``; figures come from
        ``macros.html``.
    values : what else the template is told, by name.
    applies : whether the page has the section at all.
    drawings : its figures, each drawn when it is asked for, so that it can be written by another process and forgotten.
    tables : "stage/table" of those tables that it reads, whole, from ``Frames.tables``.
    """

    name: str
    title: str
    rank: int
    template: str | Path
    is_collapsed: bool = False
    values: Callable[[Page], Mapping[str, object]] = lambda page: {}
    applies: Callable[[Frames], bool] = lambda frames: True
    drawings: Callable[[Frames], Iterable[Drawing]] = lambda frames: ()
    tables: tuple[str, ...] = ()

    @property
    def source(self) -> str:
        """The template itself."""
        return self.template if isinstance(self.template, str) else self.template.read_text(encoding="utf-8")


@cache
def library() -> Mapping[str, Section]:
    """All sections by name, in their order: the files beside this one and what packages register."""
    sections = REPORT_SECTIONS.declarations()
    return dict(sorted(sections.items(), key=lambda item: item[1].rank))


def sections_of(frames: Frames) -> list[Section]:
    """The sections of a study's page, in their order."""
    return [section for section in library().values() if section.applies(frames)]


def drawings(frames: Frames) -> Iterable[Drawing]:
    """All figures that the frames have rows for, one after the other."""
    for section in sections_of(frames):
        yield from section.drawings(frames)


def report_page(page: Page) -> str:
    """The report as one self-contained HTML document."""
    templates, study = environment(REPORT), page.frames.study
    shared_values = {
        "study": study,
        "frames": page.frames,
        "results": page.results,
        "pictures": page.pictures,
        "level": plain_number(100 * study.metrics.confidence),
    }

    def content(section: Section) -> Markup:
        source = templates.from_string(f"{section.source}\n")  # a template loses its last line break
        return Markup(source.render(shared_values | dict(section.values(page))))

    parts = [(section, content(section)) for section in sections_of(page.frames)]
    contents = [(section.name, section.title) for section, _ in parts]
    return one_file(templates, "page.html", **shared_values, parts=parts, sections=contents, explorer=page.explorer)

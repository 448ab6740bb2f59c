"""Records: what a stage says of its output, and what must hold before anything that it says is used.

A record names files that are read, hashed and, where damaged, removed. It is therefore held against a schema, its names
must stay in the stage's folder, and its seal must fit: a record that was edited is as good as none.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from pipeline.engine.table import ITEM, Table, content_hash

LAYOUT = 3
"""Of the record; an output with a record of another layout counts as never made."""
PART_FILE = re.compile(r"(?P<table>\w+)\.parquet(/part-(?P<start>\d{9})\.parquet)?")

_INSIDE = r"^([\w+-][\w.+-]*/)*[\w+-][\w.+-]*$"
"""A path below the stage's folder: no part of it begins with a dot, none is empty, and there is no backslash."""
_STRICT = ConfigDict(strict=True, extra="forbid")

Name = Annotated[str, Field(pattern=_INSIDE, max_length=200)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=0)]


@with_config(_STRICT)
class PartRecord(TypedDict):
    """One Parquet file of a table: rows, items at its ends if they are sorted, and hashes of its bytes and values."""

    name: Name
    rows: Count
    first: Count | None
    last: Count | None
    bytes: Count
    modified_ns: Count
    sha256: Digest
    content: Digest


@with_config(_STRICT)
class TableRecord(TypedDict):
    """One table: `by_item` says whether a range of items can be read on its own."""

    rows: Count
    hash: Digest
    by_item: bool
    files: Annotated[list[PartRecord], Field(min_length=1)]


@with_config(_STRICT)
class FileRecord(TypedDict):
    """A file that is no table."""

    hash: Digest
    sha256: Digest
    bytes: Count
    modified_ns: Count


@with_config(_STRICT)
class Record(TypedDict):
    """What stands in a record, and nothing else."""

    layout: Literal[3]
    stage: str
    status: Literal["complete"]
    key: Digest
    settings: dict[str, Any]
    inputs: dict[str, Digest]
    packages: dict[str, str]
    sources: dict[str, Digest]
    tables: dict[str, TableRecord]
    files: dict[Name, FileRecord]
    items: NotRequired[Count]
    failed: NotRequired[Count]
    chunk: NotRequired[Count]
    started: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d")]
    seconds: Annotated[float, Field(ge=0)]
    peak_memory_bytes: Count
    host: dict[str, int | str | None]
    jobs: int
    backend: str
    seal: Digest


@with_config(_STRICT)
class ChunkNote(TypedDict):
    """What is known of a finished chunk of a stage that is being built; `state` is the hash of what it is valid for."""

    state: Digest
    stop: Count
    failed: Count
    parts: dict[str, PartRecord]
    seal: Digest


@with_config(_STRICT)
class Manifest(TypedDict):
    """The stages of a run that are finished, and the seal of each one's record."""

    stages: dict[str, Digest]
    seal: Digest


@with_config(_STRICT)
class SourceMemory(TypedDict):
    """By the hash of a source: the hash of what it does, and the names that it imports; `rules` is of the reader."""

    rules: Digest
    sources: dict[Digest, Annotated[list[str | list[str]], Field(min_length=2, max_length=2)]]
    seal: Digest


_RECORD, _NOTE = TypeAdapter(Record), TypeAdapter(ChunkNote)
_OTHER_SHAPES: dict[type, TypeAdapter[Any]] = {kind: TypeAdapter(kind) for kind in (Manifest, SourceMemory)}


def seal(record: Mapping[str, Any]) -> str:
    """Hash of all that a record says but the seal itself."""
    content = {name: value for name, value in record.items() if name != "seal"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def with_seal(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content with its seal, as it is written."""
    return {**content, "seal": seal(content)}


def valid(raw: object, kind: type) -> dict[str, Any] | None:
    """Content as read, if it has the shape of its kind and its seal fits; else None."""
    return _checked_content(raw, _OTHER_SHAPES[kind])


def _checked_content(raw: object, shape: TypeAdapter[Any]) -> dict[str, Any] | None:
    try:
        shape.validate_python(raw)
    except (ValidationError, RecursionError):
        return None
    assert isinstance(raw, dict)
    return raw if raw["seal"] == seal(raw) else None


def valid_record(raw: object, stage: str) -> dict[str, Any] | None:
    """A record as read, if it is a whole and unchanged one of the stage; else None."""
    record = _checked_content(raw, _RECORD)
    if record is None or record["stage"] != stage:
        return None
    parts = [(file["name"], table) for table, entry in record["tables"].items() for file in entry["files"]]
    return record if all(_is_part(name, table) for name, table in parts) else None


def valid_note(raw: object, start: int, state: str) -> dict[str, Any] | None:
    """The note of the chunk that begins at an item of a stage in a state, if it is a whole one; else None."""
    note = _checked_content(raw, _NOTE)
    if note is None or note["state"] != state:
        return None
    for table, part in note["parts"].items():
        first_item, last_item = part["first"], part["last"]
        is_within = first_item is None or (last_item is not None and start <= first_item <= last_item < note["stop"])
        if not is_within or not _is_part(part["name"], table, start):
            return None
    return note


def _is_part(name: str, table: str, start: int | None = None) -> bool:
    match = PART_FILE.fullmatch(name)
    if match is None or match["table"] != table:
        return False
    return start is None or int(match["start"] or -1) == start


def table_record(table: Table, files: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the record says of a table, from its files in the order of rows."""
    contents: Iterable[int] = (int(file["content"], 16) for file in files)
    return {
        "rows": sum(file["rows"] for file in files),
        "hash": content_hash(table, contents),
        "by_item": ITEM in table.schema.names and all(f["first"] is not None for f in files if f["rows"]),
        "files": list(files),
    }

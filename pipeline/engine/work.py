"""A stage that is being built, beside its old output, and swapped in when it is complete.

A stage is expected to take as long as an earlier run says, else the calibrated time of a unit.
"""

import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.engine.cache import Cache
from pipeline.engine.fingerprint import used_settings
from pipeline.engine.record import LAYOUT, seal, table_record, valid_note, with_seal
from pipeline.engine.stage import Job, Sections, Stage
from pipeline.engine.store import RECORD, Output, read_json, remove, sha256_of, write_atomic, write_json
from pipeline.engine.table import Part, Table

WORK = ".work"


class Work:
    """A stage being built. Chunks that an interrupted process finished are kept if `state` is the same.

    Parameters
    ----------
    run : Path
        Folder of the run.
    stage : str
        Name of the stage.
    state : mapping or None
        What finished chunks are valid for: fingerprint and chunk size. None: keep nothing.

    Attributes
    ----------
    finished_chunks : dict of int to dict
        What is known of each chunk whose files are written, by its first item.
    """

    def __init__(self, run: Path, stage: str, state: Mapping[str, Any] | None) -> None:
        self.target = run / stage
        self.folder = run / WORK / stage
        self.output = self.folder / "output"
        self.replaced_folder = run / WORK / f".replaced-{stage}"
        remove(self.replaced_folder)
        if (run / WORK).is_symlink():
            remove(run / WORK)
        if state is None or _is_foreign(self.folder) or read_json(self.folder / "state.json") != state:
            remove(self.folder)
            self.output.mkdir(parents=True)
            write_json(self.folder / "state.json", state)
        for leftover in self.folder.rglob(".*.tmp"):
            leftover.unlink()
        self.state = seal(state or {})
        self.finished_chunks = dict(self._finished_chunks())
        self._clear({part["name"] for note in self.finished_chunks.values() for part in note["parts"].values()})

    def _clear(self, known: set[str]) -> None:
        """Remove whatever is none of the known files of the output, nor a folder of one, and notes of no chunk."""
        kept = {self.output / name for name in known}
        kept |= {folder for path in kept for folder in path.parents}
        notes = {self.folder / "chunks" / f"{start:09d}.json" for start in self.finished_chunks}
        for path in [*self.output.rglob("*"), *(self.folder / "chunks").glob("*")]:
            if path not in kept | notes and path.parent.is_dir():  # else its folder is removed already
                remove(path)

    def _finished_chunks(self) -> Iterator[tuple[int, dict[str, Any]]]:
        for path in (self.folder / "chunks").glob("*.json"):
            note = valid_note(read_json(path), int(path.stem), self.state) if path.stem.isdecimal() else None
            if note and all(self._is_whole(part) for part in note["parts"].values()):
                yield int(path.stem), note

    def _is_whole(self, part: Mapping[str, Any]) -> bool:
        path = self.output / part["name"]
        return bool(path.is_file() and sha256_of(path) == part["sha256"])

    def keep(self, bounds: Sequence[tuple[int, int]]) -> None:
        """Forget finished chunks that are none of those (start, stop) of the stage, with their files."""
        for start in [start for start, note in self.finished_chunks.items() if (start, note["stop"]) not in bounds]:
            for part in self.finished_chunks.pop(start)["parts"].values():
                (self.output / part["name"]).unlink()

    def write_whole(self, parts: Mapping[str, Part]) -> None:
        """Write each table as one file."""
        self.finished_chunks[0] = {
            "parts": {table: self._write(f"{table}.parquet", part) for table, part in parts.items()}
        }

    def write_block(self, table: str, part: Part) -> None:
        """Write a block of a table that is not held as a whole, named by its first item."""
        start = part.first_item or 0
        file_entry = self._write(f"{table}.parquet/part-{start:09d}.parquet", part)
        self.finished_chunks.setdefault(start, {"parts": {}})["parts"][table] = file_entry

    def write_chunk(self, start: int, stop: int, parts: Mapping[str, Part], failed_items: int) -> None:
        """Write the parts of a chunk, then the note that says it is finished."""
        files = {table: self._write(f"{table}.parquet/part-{start:09d}.parquet", part) for table, part in parts.items()}
        self.finished_chunks[start] = with_seal(
            {"state": self.state, "stop": stop, "failed": failed_items, "parts": files}
        )
        write_json(self.folder / "chunks" / f"{start:09d}.json", self.finished_chunks[start])

    def _write(self, name: str, part: Part) -> dict[str, Any]:
        write_atomic(self.output / name, part.data)
        return {
            "name": name,
            "rows": part.rows,
            "first": part.first_item,
            "last": part.last_item,
            "bytes": len(part.data),
            "modified_ns": (self.output / name).stat().st_mtime_ns,
            "sha256": hashlib.sha256(part.data).hexdigest(),
            "content": f"{part.content:064x}",
        }

    def contents(self, tables: Sequence[Table]) -> dict[str, Any]:
        """The part of the record that describes the tables and extra files."""
        table_entries = {}
        for table in tables:
            parts = [self.finished_chunks[start]["parts"] for start in sorted(self.finished_chunks)]
            files = [part[table.name] for part in parts if table.name in part]
            # a table without rows still says its columns
            files = files or [self._write(f"{table.name}.parquet/part-{0:09d}.parquet", table.part(table.empty()))]
            table_entries[table.name] = table_record(table, files)
        file_names = {file["name"] for entry in table_entries.values() for file in entry["files"]} | {RECORD}
        names = sorted(p.relative_to(self.output).as_posix() for p in self.output.rglob("*") if p.is_file())
        return {
            "tables": table_entries,
            "files": {name: self._file_record(name) for name in names if name not in file_names},
        }

    def _file_record(self, name: str) -> dict[str, Any]:
        digest, state = sha256_of(self.output / name), (self.output / name).stat()
        return {"hash": digest, "sha256": digest, "bytes": state.st_size, "modified_ns": state.st_mtime_ns}

    def publish(self, record: Mapping[str, Any]) -> Output:
        """Write the record and put the output in the place of the old one.

        What is replaced is moved into one folder before any of it is removed: killed at any point, the next run finds
        either the finished chunks or the new output, and a folder to clear.
        """
        record = with_seal({"layout": LAYOUT, **record})
        write_json(self.output / RECORD, record)
        self.replaced_folder.mkdir()
        if os.path.lexists(self.target):
            self.target.rename(self.replaced_folder / "output")
        self.output.rename(self.target)
        self.folder.rename(self.replaced_folder / "work")
        remove(self.replaced_folder)
        return Output(self.target, record)


def _is_foreign(folder: Path) -> bool:
    """Whether a folder is a link, or anything but plain files is where the engine makes files, and folders elsewhere.

    What it builds must not land elsewhere, and a pipe would never end.
    """
    folders = (folder, folder / "chunks", folder / "output")
    if any(path.is_symlink() or (path.exists() and not path.is_dir()) for path in folders):
        return True
    return any(path.is_symlink() or not (path.is_file() or path.is_dir()) for path in folder.rglob("*"))


LEAST_SHARE = 0.1
"""Share of the work that a run must have had for its time to be scaled: a small run is mostly its beginning."""


def expected_seconds(stage: Stage, study: Any, runs: Path) -> float | None:
    """Seconds of a stage by a record of this run, or the latest of any other, in proportion to its items and settings.

    Without a record, by the calibrated time of one unit; None for a stage that has none.
    """
    folders = [runs / study.name, *(path for path in runs.glob("[!.]*") if path.name != study.name)]
    records = [output.record for folder in folders if (output := Output.open(folder / stage.name))]
    records[1:] = sorted(records[1:], key=lambda record: record["started"], reverse=True)
    settings = used_settings(stage, study)
    job = Job(Sections(study, (*stage.sections, "name")), 1, runs, {}, Cache(runs / ".cache", ""))
    units = _units(stage, settings, stage.items(job) if stage.items else 1)
    for record in records:
        former_units = _units(stage, record["settings"], record.get("items", 0) if stage.items else 1)
        is_comparable = former_units and _optional(record["settings"]) == _optional(settings)
        if is_comparable and former_units >= LEAST_SHARE * units:
            return float(record["seconds"]) * units / former_units
    return stage.unit_seconds * units if stage.unit_seconds else None


def _units(stage: Stage, settings: Mapping[str, Any], items: int) -> float:
    """Product of the items and of the settings that the time of a stage is proportional to."""
    sizes = [settings.get(name) for name in stage.proportional_to]
    return float(items * math.prod(len(size) if isinstance(size, Sequence) else size for size in sizes if size))


def _optional(settings: Mapping[str, Any]) -> frozenset[str]:
    """Settings without a value: a run that had none of a section did not do its work."""
    return frozenset(name for name, value in settings.items() if value is None)

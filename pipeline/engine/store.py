"""Files of a run: reading what a stage left, building the next output beside it, swapping it in when complete.

<runs>/<study>/<stage>/            record.json, <table>.parquet (a file, or a folder of part-*.parquet), extra files
<runs>/<study>/.work/<stage>/      the stage being built: state.json, chunks/ (what is finished), output/
<runs>/<study>/.lock               held while a process writes the run
<runs>/.cache/<sha256>/            computations shared by studies
"""

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.engine.table import ITEM, Columns, Part, Table, columns_of, content_hash
from pipeline.errors import InputError

RECORD = "record.json"
LAYOUT = 1
"""Of the record; an output with a record of another layout counts as never made."""


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file so that a killed process leaves it whole or not at all: temporary file in its folder, then rename.

    It is not forced to the disk, which took longer than everything else the engine does with a chunk: if the power
    fails, sizes, hashes and page checksums notice the loss, and the worst of it is to solve again.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_bytes(data)
    temporary.replace(path)


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically."""
    write_atomic(path, (json.dumps(value, indent=1) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read JSON; None if there is no such file or it is no JSON."""
    try:
        return json.loads(path.read_bytes())
    except (FileNotFoundError, ValueError):
        return None


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Output:
    """What a finished stage left: its folder and its record."""

    folder: Path
    record: Mapping[str, Any]

    @classmethod
    def open(cls, folder: Path) -> "Output | None":
        """The output in a folder; None if the stage never finished there."""
        record = read_json(folder / RECORD)
        return cls(folder, record) if record and record.get("layout") == LAYOUT else None

    @cached_property
    def hashes(self) -> dict[str, str]:
        """Content hash of each table and extra file, by name."""
        return {name: entry["hash"] for name, entry in (self.record["tables"] | self.record["files"]).items()}

    @cached_property
    def _files(self) -> dict[str, dict[str, Any]]:
        tables = {file["name"]: file for entry in self.record["tables"].values() for file in entry["files"]}
        return tables | {name: entry | {"name": name} for name, entry in self.record["files"].items()}

    def faults(self) -> list[str]:
        """Files that are missing or of another size than recorded; cheap, so looked at before every use."""
        faults = []
        for name, file in self._files.items():
            try:
                size = (self.folder / name).stat().st_size
            except FileNotFoundError:
                faults.append(f"output file {self.folder.name}/{name} missing")
            else:
                if size != file["bytes"]:
                    faults.append(f"output file {self.folder.name}/{name} has {size} bytes, not {file['bytes']}")
        return faults

    def read(self, table: str) -> Columns:
        """All rows of a table.

        Raises
        ------
        InputError
            If a file is damaged; it is removed, so that the next run makes it again.
        """
        return columns_of(pa.concat_tables(self._decode(file, None) for file in self._table(table)["files"]))

    def read_items(self, table: str, start: int, stop: int) -> Columns:
        """Rows of a table with `start <= sample < stop`, without reading the others; raises as `read`."""
        if not self._table(table)["by_item"]:
            raise TypeError(f"table {self.folder.name}/{table} has no rows sorted by {ITEM}: read it whole")
        files = self._table(table)["files"]
        overlapping = [f for f in files if f["rows"] and f["first"] < stop and f["last"] >= start] or files[:1]
        return columns_of(pa.concat_tables(self._decode(file, (start, stop)) for file in overlapping))

    def path(self, filename: str) -> Path:
        """Path of an extra file, its content verified; raises as `read`."""
        if filename not in self.record["files"]:
            raise TypeError(f"stage {self.folder.name} has no file {filename}; it has {list(self.record['files'])}")
        path = self.folder / filename
        if not path.exists() or sha256_of(path) != self._files[filename]["sha256"]:
            raise self._damaged(filename)
        return path

    def _table(self, name: str) -> dict[str, Any]:
        tables = self.record["tables"]
        if name not in tables:
            raise TypeError(f"stage {self.folder.name} has no table {name}; it has {list(tables)}")
        return tables[name]

    def _decode(self, file: Mapping[str, Any], items: tuple[int, int] | None) -> pa.Table:
        path = self.folder / file["name"]
        try:
            return read_parquet(path, items)
        except (OSError, pa.ArrowException) as error:
            if path.exists() and sha256_of(path) == file["sha256"]:
                raise
            raise self._damaged(file["name"]) from error

    def _damaged(self, name: str) -> InputError:
        (self.folder / name).unlink(missing_ok=True)  # a bad file of the right size would look fresh to the next run
        stage = self.folder.name
        return InputError(f"{self.folder / name}: damaged or missing; removed; run stage {stage} again to make it anew")


def read_parquet(path: Path, items: tuple[int, int] | None = None) -> pa.Table:
    """Rows of one file, page checksums verified; only those of the given items (start, stop), if given.

    Decodes the row groups that hold the items and cuts the range out, which the order of the rows allows.
    """
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        if items is None:
            return file.read()
        column = file.schema_arrow.get_field_index(ITEM)
        bounds = [file.metadata.row_group(g).column(column).statistics for g in range(file.num_row_groups)]
        table = file.read_row_groups([g for g, b in enumerate(bounds) if b.min < items[1] and b.max >= items[0]])
    first, last = np.searchsorted(table[ITEM].to_numpy(), items)
    return table.slice(first, last - first)


def table_record(table: Table, files: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the record says of a table, from its files in the order of rows.

    `by_item` says whether the rows are sorted by item, so that a range of items can be read on its own.
    """
    return {
        "rows": sum(file["rows"] for file in files),
        "hash": content_hash(table, (int(file["content"], 16) for file in files)),
        "by_item": ITEM in table.schema.names and all(f["first"] is not None for f in files if f["rows"]),
        "files": list(files),
    }


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
    finished : dict of int to dict
        What is known of each chunk whose files are written, by its first item.
    """

    def __init__(self, run: Path, stage: str, state: Mapping[str, Any] | None) -> None:
        self.target = run / stage
        self.folder = run / ".work" / stage
        self.output = self.folder / "output"
        if state is None or read_json(self.folder / "state.json") != state:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.output.mkdir(parents=True)
            write_json(self.folder / "state.json", state)
        for leftover in self.folder.rglob(".*.tmp"):
            leftover.unlink()
        notes = {int(path.stem): read_json(path) for path in (self.folder / "chunks").glob("*.json")}
        self.finished = {start: note for start, note in notes.items() if note and self._whole(note)}

    def _whole(self, note: Mapping[str, Any]) -> bool:
        hashes = {self.output / file["name"]: file["sha256"] for file in note["parts"].values()}
        return all(path.exists() and sha256_of(path) == expected for path, expected in hashes.items())

    def write_whole(self, parts: Mapping[str, Part]) -> None:
        """Write each table as one file."""
        self.finished[0] = {"parts": {table: self._write(f"{table}.parquet", part) for table, part in parts.items()}}

    def write_chunk(self, start: int, parts: Mapping[str, Part], failed: int) -> None:
        """Write the parts of a chunk, then the note that says it is finished."""
        files = {table: self._write(f"{table}.parquet/part-{start:09d}.parquet", part) for table, part in parts.items()}
        self.finished[start] = {"failed": failed, "parts": files}
        write_json(self.folder / "chunks" / f"{start:09d}.json", self.finished[start])

    def _write(self, name: str, part: Part) -> dict[str, Any]:
        write_atomic(self.output / name, part.data)
        return {
            "name": name,
            "rows": part.rows,
            "first": part.first,
            "last": part.last,
            "bytes": len(part.data),
            "sha256": hashlib.sha256(part.data).hexdigest(),
            "content": f"{part.content:064x}",
        }

    def contents(self, tables: Sequence[Table]) -> dict[str, Any]:
        """The part of the record that describes the tables and extra files."""
        described = {}
        for table in tables:
            parts = [self.finished[start]["parts"] for start in sorted(self.finished)]
            files = [part[table.name] for part in parts if table.name in part]
            # a table without rows still says its columns
            files = files or [self._write(f"{table.name}.parquet/part-{0:09d}.parquet", table.part(table.empty()))]
            described[table.name] = table_record(table, files)
        written = {file["name"] for entry in described.values() for file in entry["files"]} | {RECORD}
        names = sorted(p.relative_to(self.output).as_posix() for p in self.output.rglob("*") if p.is_file())
        return {"tables": described, "files": {name: self._file_record(name) for name in names if name not in written}}

    def _file_record(self, name: str) -> dict[str, Any]:
        digest = sha256_of(self.output / name)
        return {"hash": digest, "sha256": digest, "bytes": (self.output / name).stat().st_size}

    def publish(self, record: Mapping[str, Any]) -> Output:
        """Write the record and put the output in the place of the old one."""
        record = {"layout": LAYOUT, **record}
        write_json(self.output / RECORD, record)
        if self.target.exists():
            self.target.rename(self.folder / "old")
        self.output.rename(self.target)
        shutil.rmtree(self.folder)
        return Output(self.target, record)


@dataclass(frozen=True)
class Cache:
    """Computations shared by studies, found by the hash of their key and of the code that made them."""

    root: Path
    code: str

    def folder(self, key: str, make: Callable[[Path], None]) -> Path:
        """Folder filled by `make(folder)`, called only if no run has done so; it appears whole or not at all."""
        target = self.root / hashlib.sha256(f"{self.code}\n{key}".encode()).hexdigest()
        if not target.exists():
            self.root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.root, prefix=".making-") as temporary:
                filled = Path(temporary) / "filled"
                filled.mkdir()
                make(filled)
                try:
                    filled.rename(target)
                except OSError:
                    if not target.exists():  # else another process was first
                        raise
        return target


@contextlib.contextmanager
def locked(run: Path) -> Iterator[None]:
    """Hold a run for writing; raises InputError, naming the holder, if another process has it."""
    run.mkdir(parents=True, exist_ok=True)
    with (run / ".lock").open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = file.read().strip()
            raise InputError(
                f"{run}: process {holder} is writing this run; one process at a time may; wait for it or stop it"
            ) from None
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield

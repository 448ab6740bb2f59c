"""Files of a run: writing a file whole or not at all, and reading what a finished stage left.

<runs>/<study>/<stage>/            record.json, <table>.parquet (a file, or a folder of part-*.parquet), extra files
<runs>/<study>/.work/<stage>/      the stage being built: state.json, chunks/ (what is finished), output/
<runs>/<study>/.manifest.json      the seal of each stage's record
<runs>/<study>/.damaged/<stage>/   files that were not what was written, set aside
<runs>/<study>/.lock               held while a process writes the run
<runs>/.cache/<sha256>/            computations shared by studies
"""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.engine import progress
from pipeline.engine.record import valid_record
from pipeline.engine.table import ITEM, Columns, Table, columns_of, columns_of_frame
from pipeline.errors import InputError

RECORD = "record.json"
MANIFEST = ".manifest.json"
"""Of a run: the seal of each stage's record."""
PICTURES = (".png", ".svg")
"""Endings of files that are looked at and never read: a new look of a figure must not run the stages after it."""
DAMAGED_SUFFIX = ".damaged"
"""In a run: files that were not what was written, by stage."""


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file so that a killed process leaves it whole or not at all: temporary file in its folder, then rename.

    It is not forced to the disk, which took longer than everything else the engine does with a chunk: if the power
    fails, sizes, hashes and page checksums notice the loss, and the worst of it is to solve again.
    """
    with name_path_in_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        temporary.write_bytes(data)
        temporary.replace(path)


@contextlib.contextmanager
def name_path_in_errors(path: Path) -> Iterator[None]:
    """Name a path in errors of the system that name none: a full disk is noticed by a write, which knows no name."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically."""
    write_atomic(path, (json.dumps(value, indent=1) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read JSON; None if there is no such file, it is no plain file (a pipe would never end), or it is no JSON."""
    try:
        return json.loads(path.read_bytes()) if path.is_file() else None
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return None


def make_way(path: Path) -> None:
    """Move what is no plain file out of the place of one that the engine writes; named, and nothing of it is lost."""
    if path.is_file() or not os.path.lexists(path):
        return
    aside = Path(tempfile.mkdtemp(prefix=f"{path.name}.aside-", dir=path.parent)) / path.name
    path.rename(aside)
    progress.say(path.name, f"{path}: no plain file; set aside as {aside}")


def remove(path: Path) -> None:
    """Remove a file, a folder with all that is in it, or a link (never what it points to), if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Output:
    """What a finished stage left: its folder and its record."""

    folder: Path
    record: Mapping[str, Any]
    _verified_files: set[str] = field(default_factory=set, compare=False, repr=False)
    """Files whose bytes were compared with their recorded hash, which is done once, before they are used."""

    @classmethod
    def open(cls, folder: Path) -> "Output | None":
        """The output in a folder; None if the stage never finished there, or its record is damaged."""
        record = valid_record(read_json(folder / RECORD), folder.name)
        return None if record is None else cls(folder, record)

    @cached_property
    def hashes(self) -> dict[str, str]:
        """Content hash of each table and extra file, by name."""
        return {name: entry["hash"] for name, entry in (self.record["tables"] | self.record["files"]).items()}

    @cached_property
    def _files(self) -> dict[str, dict[str, Any]]:
        tables = {file["name"]: file for entry in self.record["tables"].values() for file in entry["files"]}
        return tables | {name: entry | {"name": name} for name, entry in self.record["files"].items()}

    def faults(self) -> list[str]:
        """Files that are missing or altered, as far as size and time stamp show; looked at before every use.

        A file of another time stamp, as of a copied run, is compared by its content.
        """
        faults = []
        for name, file in self._files.items():
            if not (self.folder / name).is_file():
                faults.append(f"output file {self.folder.name}/{name} missing")
                continue
            state = (self.folder / name).stat()
            if state.st_size != file["bytes"]:
                faults.append(f"output file {self.folder.name}/{name} has {state.st_size} bytes, not {file['bytes']}")
            elif state.st_mtime_ns != file["modified_ns"] and not self._is_sound(name):
                faults.append(f"output file {self.folder.name}/{name} was altered")
        return faults

    def extra(self) -> list[str]:
        """Names of files in the folder that the record does not name: readers of whole folders would count them."""
        present = (path for path in self.folder.rglob("*") if not path.is_dir() or path.is_symlink())
        return sorted({path.relative_to(self.folder).as_posix() for path in present} - {RECORD, *self._files})

    def _is_sound(self, name: str) -> bool:
        """Whether every byte of a file is as it was written."""
        if name not in self._verified_files:
            path = self.folder / name
            if not path.is_file() or sha256_of(path) != self._files[name]["sha256"]:
                return False
            self._verified_files.add(name)
        return True

    def read(self, table: str, names: Sequence[str] | None = None) -> Columns:
        """All rows of a table: of all columns, or of those of the given names.

        Raises
        ------
        InputError
            If a file is damaged; it is set aside, so that the next run makes it again.
        """
        files = self._table(table)["files"]
        return columns_of(pa.concat_tables(self._decode(file, None, names) for file in files))

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
        return self._sound(filename)

    def verify(self) -> dict[str, str]:
        """What is wrong, by file: "missing", "altered" or "extra"; nothing is written, and every byte is read."""
        wrong_files = {
            name: "altered" if (self.folder / name).is_file() else "missing"
            for name in self._files
            if not self._is_sound(name)
        }
        return wrong_files | dict.fromkeys(self.extra(), "extra")

    def parts(self, table: str) -> list[Path]:
        """Files of a table, those of the record alone: what else lies in its folder is no part of it."""
        return [self.folder / file["name"] for file in self._table(table)["files"]]

    def _table(self, name: str) -> dict[str, Any]:
        tables: dict[str, dict[str, Any]] = self.record["tables"]
        if name not in tables:
            raise TypeError(f"stage {self.folder.name} has no table {name}; it has {list(tables)}")
        return tables[name]

    def _decode(
        self, file: Mapping[str, Any], items: tuple[int, int] | None, names: Sequence[str] | None = None
    ) -> pa.Table:
        return read_parquet(self._sound(file["name"]), items, names)

    def _sound(self, name: str) -> Path:
        """Path of a file of which every byte is as it was written; raises InputError, and sets it aside, if not."""
        path = self.folder / name
        if not self._is_sound(name):
            self.set_aside(name)
            raise InputError(
                f"{path}: damaged or missing; set aside in {DAMAGED_SUFFIX}; "
                f"run stage {self.folder.name} again to make it"
            )
        return path

    def set_aside(self, name: str) -> None:
        """Move a file that is not what was written out of the folder: it would look fresh to the next run.

        It keeps its name below the run's folder `DAMAGED_SUFFIX`; what lay there under that name is lost.
        """
        path = self.folder / name
        if not path.parent.resolve().is_relative_to(self.folder.resolve()) or not (path.exists() or path.is_symlink()):
            return
        target = self.folder.parent / DAMAGED_SUFFIX / self.folder.name / name
        remove(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        path.replace(target)


def content_hashes(outputs: Mapping[str, Output]) -> dict[str, str]:
    """Hashes of all that a stage may read of its inputs: their tables and files, but no pictures."""
    hashes = {f"{stage}/{name}": digest for stage, output in outputs.items() for name, digest in output.hashes.items()}
    return {name: digest for name, digest in hashes.items() if not name.endswith(PICTURES)}


def read_parquet(path: Path, items: tuple[int, int] | None = None, names: Sequence[str] | None = None) -> pa.Table:
    """Rows of one file; only those of the given items (start, stop), or columns of the given names, if given.

    Decodes the row groups that hold the items and cuts the range out, which the order of the rows allows.
    """
    with pq.ParquetFile(path) as file:
        if items is None:
            return file.read(names)
        column = file.schema_arrow.get_field_index(ITEM)
        bounds = [file.metadata.row_group(g).column(column).statistics for g in range(file.num_row_groups)]
        table = file.read_row_groups([g for g, b in enumerate(bounds) if b and b.min < items[1] and b.max >= items[0]])
    start, stop = np.searchsorted(table[ITEM].to_numpy(), items)
    return table.slice(start, stop - start)


def write_tables(
    tables: Mapping[Table, Columns | pd.DataFrame], folder: Path, as_csv: bool = False
) -> dict[str, pd.DataFrame]:
    """Write tables as Parquet, and as CSV if that is wanted, into ``folder``; their frames by name."""
    frames = {table.name: pd.DataFrame(columns) for table, columns in tables.items()}
    for table, columns in tables.items():
        frame = frames[table.name]
        if isinstance(columns, pd.DataFrame):
            columns = columns_of_frame(frame) if len(frame) else table.empty()
        write_atomic(folder / f"{table.name}.parquet", table.part(columns).data)
        if as_csv:
            write_csv(frame, folder / f"{table.name}.csv")
    return frames


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Write a frame as CSV with eight digits."""
    write_atomic(path, frame.to_csv(index=False, float_format="%.8g").encode())

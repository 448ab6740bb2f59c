"""Tables: the contract of one table's columns, its Arrow and Parquet form, and a hash of what it holds.

Inside the program a table is `Columns`: a mapping of column names to one-dimensional arrays of one length. A label
column is a `pandas.Categorical` (a few bytes a row, as cheap as the dictionary column it becomes on disk); an array or
list of strings is accepted where a table is made. A missing float is NaN and a missing label is None or the code -1;
on disk both are null. Integers and booleans are never missing.
"""

import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

Columns = dict[str, Any]
"""What stages exchange: column name -> array (n_rows,), labels as `pandas.Categorical`."""

ITEM = "sample"
"""The column that numbers the items of a chunked stage; rows are sorted by it, so that a range can be cut out."""

ROWS_PER_GROUP = 1 << 16  # a reader of one chunk decodes at most this many rows more than it needs, at each end

_ARROW_TYPES = {
    "int32": pa.int32(),
    "float64": pa.float64(),
    "bool": pa.bool_(),
    "label": pa.dictionary(pa.int32(), pa.string()),
}
_MODULUS = 1 << 256
"""Of the sum of hashes, so that it has the size of one."""
_NUMPY_KINDS = {"int32": "iu", "float64": "fiu", "bool": "b"}


@dataclass(frozen=True)
class Column:
    """One column of a table; `unit` and `meaning` travel with the data, in the field's metadata.

    Raises
    ------
    ValueError
        If it is of a kind that tables have not.
    """

    name: str
    kind: Literal["int32", "float64", "bool", "label"]
    unit: str
    meaning: str

    def __post_init__(self) -> None:
        if self.kind not in _ARROW_TYPES:
            raise ValueError(f"column {self.name}: {self.kind!r}; must be one of {', '.join(_ARROW_TYPES)}")


def interval_columns(unit: str, kind: str = "confidence interval", prefix: str = "") -> tuple[Column, Column]:
    """Ends of an interval of an estimate in the columns ``ci_low`` and ``ci_high``."""
    low, high = (f"{end} end of the {kind}" for end in ("lower", "upper"))
    return Column(f"{prefix}ci_low", "float64", unit, low), Column(f"{prefix}ci_high", "float64", unit, high)


@dataclass(frozen=True)
class Table:
    """The contract of one table: what a row is, and its columns in order.

    Attributes
    ----------
    item : column of the items that chunks cut between; the hash of a table does not depend on where they do.
    """

    name: str
    row_per: str
    columns: tuple[Column, ...]
    item: str = ITEM

    @cached_property
    def schema(self) -> pa.Schema:
        """Arrow schema, with unit and meaning of each field and the meaning of a row in the metadata."""
        fields = [
            pa.field(c.name, _ARROW_TYPES[c.kind], metadata={"unit": c.unit, "meaning": c.meaning})
            for c in self.columns
        ]
        return pa.schema(fields, metadata={"row_per": self.row_per})

    def empty(self) -> Columns:
        """The columns of no rows: what a body returns for a table to which its chunk adds nothing."""
        return columns_of(self.schema.empty_table())

    def frame(self, rows: Sequence[Sequence[Any] | Mapping[str, Any]]) -> pd.DataFrame:
        """Rows, each a sequence in the order of the columns or a mapping, as a frame."""
        return pd.DataFrame(rows, columns=self.schema.names)

    def columns_of_rows(self, rows: Sequence[Sequence[Any] | Mapping[str, Any]]) -> Columns:
        """Rows, likewise, as columns."""
        return columns_of_frame(self.frame(rows)) if rows else self.empty()

    def to_arrow(self, columns: Mapping[str, Any]) -> pa.Table:
        """The columns as an Arrow table in the order of the contract.

        Parameters
        ----------
        columns : mapping of str to array_like (n_rows,)
            Exactly the columns of the contract. Integers are accepted for a float column, not the reverse.

        Returns
        -------
        pyarrow.Table

        Raises
        ------
        TypeError
            If columns are missing, unknown, of different lengths or of the wrong type; names each of them.
        """
        column_names = self.schema.names
        problems = [f"no column {name}" for name in column_names if name not in columns]
        problems += [f"unknown column {name}" for name in columns if name not in column_names]
        arrays = {}
        for column in self.columns:
            if column.name in columns:
                try:
                    arrays[column.name] = _arrow_array(column, columns[column.name])
                except (TypeError, ValueError, pa.ArrowException) as error:
                    problems.append(f"column {column.name}: {error}")
        lengths = {name: len(array) for name, array in arrays.items()}
        if len(set(lengths.values())) > 1:
            problems.append(f"columns of different lengths {lengths}")
        if problems:
            raise TypeError(f"table {self.name}: " + "; ".join(problems))
        return pa.Table.from_arrays([arrays[name] for name in column_names], schema=self.schema)

    def part(self, columns: Mapping[str, Any]) -> "Part":
        """The columns as a Parquet file, with what is known of it; raises as `to_arrow`."""
        table = self.to_arrow(columns)
        sink = io.BytesIO()
        pq.write_table(
            table,
            sink,
            compression="zstd",
            row_group_size=ROWS_PER_GROUP,
            use_dictionary=[c.name for c in self.columns if c.kind in ("int32", "label")],
            use_byte_stream_split=[c.name for c in self.columns if c.kind == "float64"],
            write_page_checksum=True,
        )
        rows = columns_of(table)
        items = rows.get(ITEM, np.empty(0))
        sorted_by_item = items.size > 0 and bool(np.all(items[1:] >= items[:-1]))
        return Part(
            data=sink.getvalue(),
            rows=table.num_rows,
            content=_content(table.schema, rows, self.item),
            first_item=int(items[0]) if sorted_by_item else None,
            last_item=int(items[-1]) if sorted_by_item else None,
        )


@dataclass(frozen=True)
class Part:
    """One Parquet file of a table.

    Attributes
    ----------
    data : bytes
        The file.
    rows : int
        Number of rows.
    content : int
        Hash of the values: the sum modulo 2^256 of the sha256 of each item's rows (raw values, little-endian; a label
        by its text). A table's hash is the sum over its parts, so it depends neither on how items are cut into parts
        nor on the order in which parts are made, nor on compression.
    first_item, last_item : int or None
        Items at the ends, if the rows are sorted by item.
    """

    data: bytes
    rows: int
    content: int
    first_item: int | None
    last_item: int | None


def content_hash(table: Table, contents: Iterable[int]) -> str:
    """Hash of a whole table from the contents of its parts, and its columns' names."""
    return hashlib.sha256(f"{table.schema.names} {sum(contents) % _MODULUS}".encode()).hexdigest()


def _arrow_array(column: Column, values: Any) -> pa.Array:
    if column.kind == "label":
        if not isinstance(values, pd.Categorical):
            return pa.array(values, pa.string()).dictionary_encode()
        codes = pa.array(values.codes.astype(np.int32), mask=values.codes < 0)
        return pa.DictionaryArray.from_arrays(codes, pa.array(values.categories.to_numpy(object), pa.string()))
    array = np.asarray(values)
    if array.ndim != 1:
        raise TypeError(f"has shape {array.shape}, must have one axis")
    if array.dtype.kind not in _NUMPY_KINDS[column.kind]:
        raise TypeError(f"is {array.dtype}, must be {column.kind}")
    if column.kind == "int32" and array.size and not -(2**31) <= array.min() <= array.max() < 2**31:
        raise TypeError("does not fit 32 bits")
    return pa.array(array.astype(column.kind, copy=False), from_pandas=True)


def columns_of(table: pa.Table) -> Columns:
    """The columns of an Arrow table as arrays of their own (writable); null floats as NaN, labels as Categorical."""
    columns: Columns = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_dictionary(column.type):
            array = column.unify_dictionaries().combine_chunks()
            array = array.chunk(0) if isinstance(array, pa.ChunkedArray) else array
            codes = array.indices.fill_null(-1).to_numpy(zero_copy_only=False)
            columns[name] = pd.Categorical.from_codes(codes, categories=array.dictionary.to_pylist())
        else:
            columns[name] = np.require(column.to_numpy(), requirements=["W", "C"])
    return columns


def columns_of_frame(frame: pd.DataFrame) -> Columns:
    """The columns of a frame, labels as Categorical."""
    return {
        name: values.array if isinstance(values.dtype, pd.CategoricalDtype) else values.to_numpy()
        for name, values in frame.items()
    }


def _content(schema: pa.Schema, columns: Columns, item: str) -> int:
    """Sum modulo 2^256 of the sha256 of each item's rows; a table without items counts as one."""
    types = {name: "<i8" if isinstance(v, pd.Categorical) else v.dtype.newbyteorder("<") for name, v in columns.items()}
    rows = np.empty(len(next(iter(columns.values()))), dtype=[(name, types[name]) for name in schema.names])
    if not rows.size:
        return 0
    for name, values in columns.items():
        rows[name] = _label_numbers(values) if isinstance(values, pd.Categorical) else values
    items = columns.get(item, np.zeros(rows.size))
    ends = [*(np.flatnonzero(items[1:] != items[:-1]) + 1), rows.size]
    raw, width, total, start = rows.view(np.uint8).data, rows.itemsize, 0, 0
    for end in ends:
        total += int.from_bytes(hashlib.sha256(raw[start * width : end * width]).digest(), "little")
        start = end
    return total % _MODULUS


def _label_numbers(values: pd.Categorical) -> np.ndarray:
    """Each label as a number that its text alone decides; a missing one is 0, which the code -1 finds at the end."""
    digests = [hashlib.sha256(label.encode()).digest() for label in values.categories]
    numbers = [int.from_bytes(digest[:8], "little", signed=True) for digest in digests]
    of_values: np.ndarray = np.take([*numbers, 0], values.codes)
    return of_values

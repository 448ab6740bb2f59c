"""The one reader of tables that others wrote: every row has the fields of the header, and every fault its line.

`check_text` refuses a file that is no text, or too large, before its name is trusted.
"""

import codecs
import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from pipeline.arrays import Real, Truth, Whole
from pipeline.config.files.section import shown_value
from pipeline.errors import InputError

LARGEST_TEXT = 1 << 30
"""Bytes of a file, unpacked: ten million rows of six columns. A table takes about as much again in memory."""
LARGEST_VALUE = 1e12
"""Of any quantity in its standard unit; what is beyond was never measured, and its square may be no number."""
_AT_ONCE = 1 << 20
"""Bytes that are read at once."""
READ: set[Path] = set()
"""Inputs that this process has read, designs and studies with the files that they name."""
_GZIP = b"\x1f\x8b"
_PACKING_MAGIC = {
    b"PK\x03\x04": "a ZIP archive",
    b"\xfd7zXZ\x00": "packed with xz",
    b"BZh": "packed with bzip2",
    b"\x28\xb5\x2f\xfd": "packed with zstd",
    b"7z\xbc\xaf": "a 7z archive",
}
_PACKED_ENDINGS = (".zip", ".xz", ".bz2", ".zst", ".tar", ".tgz", ".7z", ".lzma")


def check_text(path: Path, name: str) -> str:
    """Encoding of a text, plain or packed with gzip; anything else is refused, in constant memory.

    Parameters
    ----------
    name : of the file in messages.

    Raises
    ------
    InputError : an archive, by its content or its name; a damaged gzip; bytes that are no text; more than
        `LARGEST_TEXT` bytes, unpacked.
    """
    READ.add(path)
    with path.open("rb") as file:
        beginning = file.read(8)
        packing = next((kind for magic, kind in _PACKING_MAGIC.items() if beginning.startswith(magic)), "")
        if packing or path.suffix.lower() in _PACKED_ENDINGS:
            raise InputError(f"{name}: is {packing or 'an archive by its name'}; unpack it to a CSV file, or use gzip")
        if (path.suffix.lower() == ".gz") != beginning.startswith(_GZIP):
            kind = "no gzip file" if path.suffix.lower() == ".gz" else "packed with gzip"
            raise InputError(f"{name}: is {kind}; name a gzip file .csv.gz and a text .csv")
        file.seek(0)
        try:
            return _encoding(gzip.GzipFile(fileobj=file) if path.suffix.lower() == ".gz" else file, name)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise InputError(f"{name}: damaged gzip: {error}; copy or pack it again") from None


def _encoding(file: BinaryIO | gzip.GzipFile, name: str) -> str:
    size, decoder = 0, codecs.getincrementaldecoder("utf-8-sig")()
    encoding = "utf-8-sig"
    while block := file.read(_AT_ONCE):
        if not size and block.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            encoding = "utf-16"
        elif encoding == "utf-8-sig":
            try:
                decoder.decode(block)
            except UnicodeDecodeError:
                encoding = "latin-1"
        if b"\0" in block and encoding != "utf-16":
            raise InputError(f"{name}: no text in UTF-8 or Latin-1: it holds zero bytes; save it as CSV in UTF-8")
        size += len(block)
        if size > LARGEST_TEXT:
            raise InputError(f"{name}: more than {LARGEST_TEXT} bytes, unpacked; thin the rows, or split the file")
    return encoding


def header(columns: Iterable[object], name: str) -> list[str]:
    """Names of columns without blanks around them; raises InputError where two are then equal."""
    names = [str(column).strip() for column in columns]
    duplicates = sorted({column for column in names if names.count(column) > 1})
    if duplicates:
        doubled_text = ", ".join(map(shown_value, duplicates))
        raise InputError(f"{name}: more than one column {doubled_text}, blanks aside; rename one")
    return names


SEPARATORS = ("\t", ";", ",")
"""In the order in which they are tried: a comma may also be a decimal mark, or part of a name."""
GUESSED_BYTES = 1 << 20
"""Beginning of a file by which its separator and decimal mark are guessed; also the longest line."""
GUESSED_LINES = 200
"""Lines of it that are looked at."""
MOST_LINES = 20
"""Lines of an answer on one file."""
BLANK = ("", "NA", "N/A", "NaN", "nan", "null")
"""Cells without a value."""


@dataclass(frozen=True)
class TableFile:
    """A table of text as its file has it.

    Attributes
    ----------
    name : of the file in messages.
    cells : columns by their names; numbers where every cell of a column is one or blank, else text. The index is the
        line of each row in the file (the header has the first that is not blank); blank rows are left out.
    decimal : decimal mark, "." or ",".
    """

    name: str
    cells: pd.DataFrame
    decimal: str

    def numbers(self, column: str) -> Real:
        """The cells of a column as numbers (n,); NaN where there is none."""
        values = self.cells[column]
        if pd.api.types.is_numeric_dtype(values):
            return np.asarray(values.to_numpy(float))
        return np.asarray(pd.to_numeric(_with_point(values, self.decimal), errors="coerce").to_numpy(float))

    def texts(self, column: str) -> list[str]:
        """The cells of a column that was read as names (n,); "" where it is blank."""
        return list(self.cells[column].fillna("").tolist())

    def is_blank(self, column: str) -> Truth:
        """Whether the cells of a column hold nothing (n,)."""
        values = self.cells[column]
        return np.asarray((values.isna() | values.isin(BLANK)).to_numpy(bool))

    def place(self, row: int) -> str:
        """`file:line` of a row."""
        return f"{self.name}:{self.cells.index[row]}"

    def faults(self, column: str, is_wrong: Truth, requirement: str) -> list[str]:
        """One line for each of the first ``is_wrong`` cells (n,) of a column, and how many there are beyond."""
        rows = np.flatnonzero(is_wrong)
        lines = [
            f"{self.place(row)}: {column} = {_cell_text(self.cells[column].iloc[row])}; {requirement}"
            for row in rows[:MOST_LINES]
        ]
        return shortened_list(lines, self.name, len(rows))


def shortened_list(problems: Iterable[str], name: str, count: int = 0) -> list[str]:
    """The first problems of a file, with a last line that says how many of ``count`` there are beyond `MOST_LINES`."""
    lines = list(problems)
    count = max(count, len(lines))
    return lines if count <= MOST_LINES else [*lines[: MOST_LINES - 1], f"{name}: {count - MOST_LINES + 1} more faults"]


def read_table(
    path: Path, name: str, separator: str | None = None, decimal: str = ".", names_in: Container[str] = ()
) -> TableFile:
    """A table of text, in UTF-8, UTF-16 with its mark, or Latin-1, plain or packed with gzip.

    Parameters
    ----------
    name : of the file in messages.
    separator, decimal : as declared; without a separator both are guessed from the first lines.
    names_in : columns of names, which stay text where all are numbers: part 007 is not part 7.

    Raises
    ------
    InputError : no table, or rows that have not as many fields as the header, each with its line.
    """
    encoding = check_text(path, name)
    with _open_file(path) as stream:
        beginning = stream.read(GUESSED_BYTES).decode(encoding, "ignore").splitlines()
    blank_lines = next((number for number, line in enumerate(beginning) if line.strip()), len(beginning))
    lines = [line for line in beginning[blank_lines : blank_lines + GUESSED_LINES] if line.strip()]
    if not lines:
        raise InputError(f"{name}: no table: it holds no text; give a header and a row for each measurement")
    if separator is None:
        separator = _separator(lines)
        decimal = _decimal(lines[1:], separator, decimal)
    if not separator.isascii() or not (separator.isprintable() or separator == "\t"):
        raise InputError(f"{name}: separator = {shown_value(separator)}; must be a printed ASCII character or a tab")
    names = _names(lines, separator, name)
    cells, line = _rows(path, name, encoding, separator, names, blank_lines + 1)
    columns: dict[str, pd.Series] = {}
    for number, column in enumerate(names):
        if column or pc.any(pc.not_equal(cells[number], "")).as_py():
            columns[column or f"column {number + 1}"] = _column(cells[number], decimal, column in names_in)
    frame = pd.DataFrame(columns).set_axis(line)
    return TableFile(name, frame[~np.all(frame.isna().to_numpy(), axis=1)], decimal)


def _open_file(path: Path) -> BinaryIO | gzip.GzipFile:
    return gzip.open(path, "rb") if path.suffix.lower() == ".gz" else path.open("rb")


def _fields(line: str, separator: str) -> list[str]:
    return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _separator(lines: list[str]) -> str:
    """The first separator that divides the header and the row below it into as many fields, else the most frequent."""
    for separator in SEPARATORS:
        counts = [len(_fields(line, separator)) for line in lines[:2]]
        if counts[0] > 1 and len(set(counts)) == 1:
            return separator
    return max(reversed(SEPARATORS), key=lines[0].count)


def _decimal(lines: list[str], separator: str, declared_mark: str) -> str:
    commas, points = (sum(len(re.findall(rf"\d\{mark}\d", line)) for line in lines) for mark in ",.")
    return "," if separator != "," and commas > points else declared_mark


def _names(lines: list[str], separator: str, name: str) -> list[str]:
    """Names of the columns; empty ones for fields beyond the header that the first row has at its end, all blank."""
    try:
        names, first_row = (_fields(line, separator) for line in (lines * 2)[:2])
    except (csv.Error, TypeError, ValueError) as error:
        raise InputError(f"{name}: no table: {error}; correct its header, or its separator") from None
    header([column for column in names if column], name)
    surplus = first_row[len(names) :]
    return names + ([""] * len(surplus) if not any(surplus) else [])


def _rows(
    path: Path, name: str, encoding: str, separator: str, names: list[str], skipped_lines: int
) -> tuple[list[pa.ChunkedArray], Whole]:
    """Cells (n,) of each column without blanks around them, and the line of each row (n,)."""
    unequal: dict[int, int] = {}

    def note(row: arrow_csv.InvalidRow) -> str:
        unequal[row.number] = row.actual_columns if row.text.strip() else 0
        return "skip"

    keys = [str(number) for number in range(len(names))]
    reading = arrow_csv.ReadOptions(
        use_threads=False, encoding=encoding, column_names=keys, skip_rows=skipped_lines, block_size=GUESSED_BYTES
    )
    parsing = arrow_csv.ParseOptions(delimiter=separator, ignore_empty_lines=False, invalid_row_handler=note)
    try:
        with _open_file(path) as stream:
            texts = arrow_csv.ConvertOptions(column_types=dict.fromkeys(keys, pa.string()))
            table = arrow_csv.read_csv(stream, reading, parsing, texts)
    except (pa.ArrowException, ValueError, TypeError, UnicodeError) as error:
        if "Could not skip" in str(error):
            raise InputError(f"{name}: no row below its header") from None
        raise InputError(f"{name}: no table: {error}; correct the file, or its separator") from None
    columns = [pc.utf8_trim_whitespace(table[key]) for key in keys]
    line = np.setdiff1d(np.arange(skipped_lines + 1, skipped_lines + 1 + len(table) + len(unequal)), list(unequal))
    wrong_rows = [(number, count) for number, count in unequal.items() if count]
    if problems := [*_open_quotes(columns, line, name), *_unequal(wrong_rows, len(names), line, separator, name)]:
        raise InputError(problems)
    return columns, line


def _open_quotes(columns: list[pa.ChunkedArray], line: Whole, name: str) -> list[str]:
    """A cell that spans lines: its quotation mark was never closed, and swallowed rows."""
    for column in columns:
        spans = pc.match_substring_regex(column, "[\r\n]").to_numpy(zero_copy_only=False).astype(bool)
        if spans.any():
            return [f"{name}:{line[spans.argmax()]}: a quotation mark is opened and not closed in its line; remove it"]
    return []


def _unequal(wrong_rows: list[tuple[int, int]], fields: int, line: Whole, separator: str, name: str) -> list[str]:
    if not wrong_rows:
        return []
    advice = "give each row one field for each column"
    if len(wrong_rows) > len(line):
        (count, frequency), *_ = Counter(count for _, count in wrong_rows).most_common(1)
        return [
            f"{name}: {frequency} rows have {count} fields, its header {fields}; is the header below other lines? "
            "Remove the lines above it"
        ]
    if all(field_count > fields for _, field_count in wrong_rows) and separator == ",":
        advice += "; if the decimal mark is a comma, separate the fields by another character"
    elif len(wrong_rows) == 1 and wrong_rows[0][0] > line.max(initial=0):
        advice = "the file ends within a row; copy it again, or remove that row"
    lines = [
        f"{name}:{number}: {field_count} fields, its header has {fields}; {advice}"
        for number, field_count in wrong_rows[:MOST_LINES]
    ]
    return shortened_list(lines, name, len(wrong_rows))


def _with_point(values: pd.Series, decimal: str) -> pd.Series:
    """Texts of numbers with a decimal point; where the mark is a comma, a point is no part of a number."""
    if decimal == ".":
        return values
    texts = values.astype(str)
    return texts.where(~texts.str.contains(".", regex=False), "no number").str.replace(decimal, ".")


def _column(cells: pa.ChunkedArray, decimal: str, is_of_names: bool) -> pd.Series:
    """A column as numbers, if all of its cells are numbers or blank; else as text, None where it is blank."""
    blank = pc.is_in(cells, pa.array(BLANK))
    nullable_cells = pc.if_else(blank, pa.scalar(None, pa.string()), cells)
    if is_of_names:
        return nullable_cells.to_pandas()
    texts = nullable_cells
    if decimal == ",":
        has_point = pc.match_substring(nullable_cells, ".")
        texts = pc.if_else(has_point, "no number", pc.replace_substring(nullable_cells, ",", "."))
    try:
        return pd.Series(pc.cast(texts, pa.float64()).to_numpy())
    except pa.ArrowInvalid:
        return nullable_cells.to_pandas()


def _cell_text(value: object) -> str:
    """A cell as it is in the file; one that is no number in quotes."""
    if isinstance(value, float):
        return f"{value:g}"
    try:
        float(str(value))
    except ValueError:
        return shown_value(value)
    return str(value)

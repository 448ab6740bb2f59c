"""Whether a measured file is a text of bearable size, before a reader of tables trusts its name."""

from __future__ import annotations

import codecs
import gzip
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

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

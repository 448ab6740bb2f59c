"""Licences of the packages that this program is installed with, by what each says of itself."""

import importlib.metadata
import re
from dataclasses import dataclass
from pathlib import Path

PINNED = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>\S+)", re.MULTILINE)
LONGEST = 60
"""Characters of a licence's name; some packages put the whole text in its place."""
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Licence:
    """A pinned package: version and licence are `UNKNOWN` where it is not installed, as one of another system is."""

    package: str
    version: str
    licence: str


def licences(constraints: Path) -> list[Licence]:
    """The licence of every package that a constraints file pins."""
    return [_of(match["name"]) for match in PINNED.finditer(constraints.read_text(encoding="utf-8"))]


def _of(package: str) -> Licence:
    try:
        metadata = importlib.metadata.metadata(package)
    except importlib.metadata.PackageNotFoundError:
        return Licence(package, UNKNOWN, UNKNOWN)
    classes = [text.split(" :: ")[-1] for text in metadata.get_all("Classifier") or () if text.startswith("License ::")]
    licence_texts = [text.split("\n")[0] for text in metadata.get_all("License") or ()]
    licence_names = [text for text in classes if text != "OSI Approved"]
    licence_names = licence_names or [text for text in licence_texts if 0 < len(text) <= LONGEST]
    expression = ", ".join(metadata.get_all("License-Expression") or licence_names)
    return Licence(package, metadata["Version"], expression or UNKNOWN)

"""The command new: a commented design, study or measured unit that runs as written, to be changed number by number."""

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from pipeline import settings
from pipeline.cli.keys import describe, file_keys
from pipeline.config.files.section import NAME, NAME_RULE
from pipeline.config.reading import found_file
from pipeline.engine.store import write_atomic
from pipeline.errors import InputError

BASES = {
    "design": "data/designs/pin_in_hole_39.toml",
    "study": "data/studies/pin_in_hole.toml",
    "unit": "data/measured/friction_example",
}
BASE_DESIGN = 'design = "pin_in_hole_39"'
UNIT_DATA = ("rows.csv", "dimensions.toml")
NEXT_STEP = {
    "design": "next: python -m pipeline new study NAME --design {name}",
    "study": "next: make study STUDY={name}",
    "unit": "next: replace rows.csv by your measured rows, then make identify UNIT={name}",
}
SECTION_LINE = re.compile(r"\[([^\]]+)\]")
KEY_LINE = re.compile(r"([A-Za-z_]\w*) = ")
COMMENT_COLUMN = 48
"""Of a line of the written file."""


def write_new(options: argparse.Namespace) -> None:
    """Write a file of a kind under a name and say what comes next.

    Raises
    ------
    InputError
        If the name is none that a file may have, or is taken.
    """
    kind, name = options.kind, options.name
    if not NAME.fullmatch(name):
        raise InputError(f"new {kind} {name!r}; the name {NAME_RULE.partition(';')[0]}")
    base = settings.ROOT / BASES[kind]
    target = base.parent / name / "unit.toml" if kind == "unit" else base.parent / f"{name}.toml"
    if target.exists():
        raise InputError(f"{settings.shown(target)} exists; take another name, or change that file")
    source = base / "unit.toml" if kind == "unit" else base
    text = with_comments(kind, source.read_text(encoding="utf-8"))
    if kind == "study" and options.design:
        found_file(options.design, settings.ROOT, "designs", [Path(), settings.ROOT])  # says what is missing
        text = text.replace(BASE_DESIGN, f'design = "{options.design}"')
    if kind == "unit":
        for file in UNIT_DATA:
            write_atomic(target.parent / file, (base / file).read_bytes())
    write_atomic(target, text.encode())
    print(f"{kind}: {settings.shown(target)}")
    print(NEXT_STEP[kind].format(name=name))


def with_comments(kind: str, text: str) -> str:
    """A file with the type, bounds and default of each key behind its line."""
    return "\n".join(_commented_lines(kind, text)) + "\n"


def _commented_lines(kind: str, text: str) -> Iterator[str]:
    yield f"# A {kind} to start from: it runs as it is. All keys: python -m pipeline keys {kind}"
    known_keys, section = {key.path: key for key in file_keys()[kind]}, ""
    for line in text.splitlines():
        if match := SECTION_LINE.match(line):
            section = re.sub(r"^(tolerances|costs)\.\w+", r"\1.<dimension>", f"{match[1]}.")
            section = re.sub(r"^materials\.\w+", "materials.<name>", section)
        match = KEY_LINE.match(line)
        key = known_keys.get(f"{section}{match[1]}") if match else None
        yield f"{line:{COMMENT_COLUMN}}# {describe(key, '')}" if key and "#" not in line else line

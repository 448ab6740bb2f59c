"""Tables, settings and command lines as a careless hand or a bad copy leaves them: one mutation of a sound one each."""

from __future__ import annotations

import contextlib
import random
import re
from collections.abc import Callable

Mutation = Callable[[random.Random, str], str]

ODD = (
    "",
    "nan",
    "inf",
    "-1",
    "1e400",
    "9" * 40,
    "x",
    "1,5",
    "1.2.3",
    "\ufeff",
    "ü",
    "钢",
    '"',
    "'",
    "\\",
    "$\\frac",
    "%s",
    "=1+1",
)
"""Values in place of a cell or of a setting."""


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def _cell(rng: random.Random, text: str) -> str:
    """One cell of one row is another value."""
    lines = _lines(text)
    row = rng.randrange(1, len(lines))
    cells = lines[row].rstrip("\n").split(",")
    cells[rng.randrange(len(cells))] = rng.choice(ODD)
    lines[row] = ",".join(cells) + "\n"
    return "".join(lines)


def scaled_column(rng: random.Random, text: str) -> str:
    """All numbers of a column times a factor."""
    rows = [line.rstrip("\n").split(",") for line in _lines(text)]
    column, factor = rng.randrange(len(rows[0])), rng.choice([0.0, -1.0, 60.0, 1e-3, 1e6])
    for row in rows[1:]:
        with contextlib.suppress(ValueError):
            row[column] = f"{factor * float(row[column]):g}"
    return "".join(",".join(row) + "\n" for row in rows)


def _column(rng: random.Random, text: str) -> str:
    """All cells of a column are one other value."""
    rows = [line.rstrip("\n").split(",") for line in _lines(text)]
    column, odd = rng.randrange(len(rows[0])), rng.choice(ODD)
    rows[1:] = [[*row[:column], odd, *row[column + 1 :]] for row in rows[1:]]
    return "".join(",".join(row) + "\n" for row in rows)


def _separator_in_row(rng: random.Random, text: str) -> str:
    """A separator more, or one fewer, in one row."""
    lines = _lines(text)
    row = rng.randrange(1, len(lines))
    places = [match.start() for match in re.finditer(",", lines[row])]
    place = rng.choice(places or [0])
    lines[row] = lines[row][:place] + (",," if rng.random() < 0.5 else "") + lines[row][place + 1 :]
    return "".join(lines)


def exchanged_columns(rng: random.Random, text: str) -> str:
    """Two names of the header change places."""
    head, _, rest = text.partition("\n")
    names = head.split(",")
    a, b = rng.sample(range(len(names)), 2) if len(names) > 1 else (0, 0)
    names[a], names[b] = names[b], names[a]
    return ",".join(names) + "\n" + rest


def _header(rng: random.Random, text: str) -> str:
    """A letter of the header is another one, or missing."""
    head, _, rest = text.partition("\n")
    place = rng.randrange(max(len(head), 1))
    return head[:place] + rng.choice(["", "x", " ", ",", '"']) + head[place + 1 :] + "\n" + rest


def _order(rng: random.Random, text: str) -> str:
    """Rows reversed, shuffled, repeated or left out."""
    head, *rows = _lines(text)
    kind = rng.randrange(4)
    if kind == 0:
        rows = rows[::-1]
    elif kind == 1:
        rng.shuffle(rows)
    elif kind == 2:
        rows = rows + rows[: rng.randrange(len(rows) + 1)]
    else:
        rows = rows[:: rng.randrange(2, 40)]
    return head + "".join(rows)


def _cut(rng: random.Random, text: str) -> str:
    """The file ends anywhere."""
    return text[: rng.randrange(len(text))]


def _characters(rng: random.Random, text: str) -> str:
    """Up to five characters are others."""
    characters = list(text)
    for _ in range(rng.randrange(1, 6)):
        characters[rng.randrange(len(characters))] = chr(
            rng.choice([9, 10, 13, 27, 34, 44, 46, 59, 92, 233, 0x4E2D, 48])
        )
    return "".join(characters)


def other_dialect(rng: random.Random, text: str) -> str:
    """Another separator, decimal mark or end of line: sound in itself."""
    separator = rng.choice([";", "\t", ","])
    if separator != ",":
        text = text.replace(",", separator)
        text = text.replace(".", ",") if rng.random() < 0.5 else text
    return text.replace("\n", rng.choice(["\n", "\r\n"]))


TABLE_MUTATIONS: tuple[Mutation, ...] = (
    _cell, _column, scaled_column, _separator_in_row, exchanged_columns, _header, _order, _cut, _characters,
    other_dialect,
)  # fmt: skip


def _setting(rng: random.Random, text: str) -> str:
    """One value of a settings file is another one."""
    lines = _lines(text)
    places = [k for k, line in enumerate(lines) if re.match(r"\s*[\w\".]+\s*=", line)]
    row = rng.choice(places)
    key = lines[row].partition("=")[0]
    value = rng.choice(
        [*ODD, "[]", "{}", "[1, 'a']", "true", "-0.0", "1e-300", "1979-05-27", '""', "'x'", "[[[[]]]]", "0x10"]
    )
    lines[row] = f"{key}= {value}\n"
    return "".join(lines)


def _doubled(rng: random.Random, text: str) -> str:
    """A line stands twice, or is missing."""
    lines = _lines(text)
    row = rng.randrange(len(lines))
    lines[row : row + 1] = [lines[row]] * rng.choice([0, 2])
    return "".join(lines)


SETTINGS_MUTATIONS: tuple[Mutation, ...] = (_setting, _setting, _doubled, _cut, _characters)

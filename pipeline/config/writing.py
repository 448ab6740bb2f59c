"""Settings as a TOML file, for designs and studies that the program makes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_of(content: Mapping[str, object]) -> str:
    """Tables of plain values, lists and tables as TOML; None is left out; provenance is written a line an entry."""
    return "".join(_lines(content, "")).lstrip("\n")


def _lines(content: Mapping[str, object], prefix: str) -> list[str]:
    tables = {key: value for key, value in content.items() if isinstance(value, Mapping)}
    arrays = {key: value for key, value in content.items() if isinstance(value, list | tuple) and _of_tables(value)}
    lines = [
        f"{_key(key)} = {_literal(value)}\n"
        for key, value in content.items()
        if key not in tables and key not in arrays and value is not None
    ]
    for key, table in tables.items():
        name = f"{prefix}{_key(key)}"
        if not table:
            continue
        if key == "provenance":
            lines.append(f"\n[{name}]\n")
            lines += [f"{_key(of)} = {_inline(entry)}\n" for of, entry in table.items()]
            continue
        only_tables = bool(table) and all(isinstance(item, Mapping) for item in table.values())
        lines += [] if only_tables else [f"\n[{name}]\n"]
        lines += _lines(table, f"{name}.")
    for key, entries in arrays.items():
        name = f"{prefix}{_key(key)}"
        for entry in entries:
            lines += [f"\n[[{name}]]\n", *_lines(entry, f"{name}.")]
    return lines


def _of_tables(values: Sequence[object]) -> bool:
    return bool(values) and all(isinstance(value, Mapping) for value in values)


def _key(key: str) -> str:
    return key if BARE_KEY.fullmatch(key) else _literal(key)


def _inline(entry: Mapping[str, object]) -> str:
    return f"{{ {', '.join(f'{_key(key)} = {_literal(value)}' for key, value in entry.items())} }}"


def _literal(value: object) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_literal, value))}]"
    return repr(value)

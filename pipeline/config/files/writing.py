"""Settings as a TOML file, for designs and studies that the program makes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomli_w


def toml_of(content: Mapping[str, object]) -> str:
    """Tables of plain values, lists and tables as TOML, which has no null: a key whose value is None is left out."""
    return tomli_w.dumps(_without_none(content))


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value

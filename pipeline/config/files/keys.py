"""Other values at dotted keys of sections and tables, as "tolerances.pin_radial.upper_um"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from pipeline.config.files.section import key_path


def with_value(tables: Any, key: str, value: Any) -> Any:
    """A copy of a section or mapping with another value at a key, not checked; mappings on the way are made."""
    return _with_value(tables, _new_path(tables, key), value)


def _new_path(tables: Any, key: str) -> tuple[str, ...]:
    """As ``key_path``; below the names that are there, the key is cut at its dots."""
    try:
        return key_path(tables, key)
    except KeyError:
        name, _, further = key.partition(".")
        inner = tables.get(name) if isinstance(tables, Mapping) else getattr(tables, name, None)
        return (name, *(_new_path(inner, further) if further else ()))


def _with_value(tables: Any, path: tuple[str, ...], value: Any) -> Any:
    name, *further = path
    if further:
        inner = tables.get(name, {}) if isinstance(tables, Mapping) else getattr(tables, name)
        value = _with_value(inner if isinstance(inner, Mapping | BaseModel) else {}, tuple(further), value)
    return {**tables, name: value} if isinstance(tables, Mapping) else tables.model_copy(update={name: value})

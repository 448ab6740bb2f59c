"""What all sections of a design or study file share: frozen, strict, no unknown keys; and how a problem reads."""

import contextlib
import difflib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
# Physical bounds: outside of them a value was typed in another unit, or is none of a machine part.
LARGEST_UM = 1000
"""Deviation beyond which it is no tolerance: a millimetre."""
Micrometres = Annotated[float, Field(ge=-LARGEST_UM, le=LARGEST_UM)]
"""A deviation."""
Clearance = Annotated[float, Field(ge=0, le=LARGEST_UM)]
"""A clearance or a standard deviation [um], as a deviation."""
Millimetres = Annotated[float, Field(ge=1e-3, le=1e4)]
"""A length of a part: from a micrometre, below which nothing is machined, to ten metres, above which no reducer is."""

NAME = re.compile(r"\w[\w.+-]{0,59}")
"""Studies, designs and units are named by their files and name folders: no path, nothing hidden, and not too long."""
NAME_RULE = "must be letters, digits, '_', and after the first character '.', '+', '-', at most 60; rename it"
LONGEST_SHOWN = 100
"""Characters of a value that a message echoes."""


@dataclass(frozen=True)
class Derived:
    """Mark of a key whose default follows from others, with the rule in words."""

    rule: str


class Section(BaseModel):
    """A table of a TOML file: immutable, without unknown keys, without silent conversion ("50" is no number)."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def with_section(self, section: str, /, **values: Any) -> Self:
        """These settings with some values of one section in place of its own; they are not checked."""
        return self.model_copy(update={section: getattr(self, section).model_copy(update=values)})


def key_path(section: object, key: str) -> tuple[str, ...]:
    """Names of the sections on the way to a dotted key; a name may hold dots itself, as the material 1.3505.

    Raises
    ------
    KeyError : there is no such key.
    """
    names: Iterable[str] = section if isinstance(section, Mapping) else getattr(type(section), "model_fields", ())
    for name in names:
        if name == key:
            return (name,)
        if key.startswith(f"{name}."):
            value = section[name] if isinstance(section, Mapping) else getattr(section, name)
            with contextlib.suppress(KeyError):
                return (name, *key_path(value, key[len(name) + 1 :]))
    raise KeyError(key)


def number_at(section: object, key: str) -> float:
    """The number at a dotted key of a section or of a mapping; raises as ``key_path``."""
    value: Any = section
    for name in key_path(section, key):
        value = value[name] if isinstance(value, Mapping) else getattr(value, name)
    return float(value)


MISSING = object()
"""Stands for the value of a key that is not in the file."""


@dataclass(frozen=True)
class Mistake:
    """One mistake in a file.

    Parameters
    ----------
    key : dotted key of the value, e.g. "tolerances.pin_radial.sigma_um".
    value : the value as it stands in the file; MISSING without the key; None where the mistake is not the value.
    requirement : what may stand there ("must be >= 0") and, where it is not obvious, what to do.
    """

    key: str
    value: object
    requirement: str

    def line(self, file: str) -> str:
        """The problem in one line: where, what was found, what is allowed."""
        if self.value is MISSING:
            found_text = " is missing"
        else:
            found_text = "" if self.value is None else f" = {shown_value(self.value)}"
        return f"{file}: {self.key}{found_text}; {self.requirement}"


def shown_value(value: object) -> str:
    """A value as it stands in a file, cut where it is long."""
    try:
        text = json.dumps(value, default=str)
    except (ValueError, RecursionError):  # an integer of thousands of digits, tables nested a thousand deep
        text = f"({type(value).__name__} that is too long to show)"
    return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 4]} ..."


def nearest_name(name: str, known_names: Iterable[str]) -> str:
    """The advice for an unknown `name`: the most similar of the `known_names` names, else all of them."""
    names = sorted(known_names)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known names: {', '.join(names)}"


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

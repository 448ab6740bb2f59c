"""Every key of a settings file, read from the sections that validate it: type, unit, default, allowed values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from pipeline.config.files.section import Derived

UNITS = {
    "_Nm_per_arcmin": "N m/arcmin",
    "_N_per_mm_power": "N/mm^n",
    "_N_per_mm": "N/mm",
    "_per_K": "1/K",
    "_arcmin": "arcmin",
    "_arcsec": "arcsec",
    "_percent": "%",
    "_rpm": "1/min",
    "_MPa": "MPa",
    "_deg": "deg",
    "_Nm": "N m",
    "_um": "um",
    "_mm": "mm",
    "_kN": "kN",
    "_C": "deg C",
    "_K": "K",
    "_N": "N",
}
"""Ending of a key -> unit of its value, the longer ones first."""
TYPES = {float: "number", int: "integer", str: "text", bool: "true or false", NoneType: ""}
BOUNDS = (("gt", "> {:g}"), ("ge", ">= {:g}"), ("lt", "< {:g}"), ("le", "<= {:g}"))
REQUIRED_TEXT = "required"
NAME = "<name>"


@dataclass(frozen=True)
class Key:
    """One key of a settings file.

    Attributes
    ----------
    path : dotted; ``<name>`` stands for a name of the user's, ``[]`` for each entry of a list.
    kind : type of the value.
    unit : of the value, empty without one.
    default : value without the key, or "required".
    allowed_values : bounds, or the choices.
    section : docstring of the section that holds it.
    """

    path: str
    kind: str
    unit: str
    default: str
    allowed_values: str
    section: str


def keys_of(model: type[BaseModel], prefix: str = "", placeholders: Mapping[str, str] | None = None) -> Iterator[Key]:
    """Every key below a section.

    Parameters
    ----------
    placeholders : section of many like fields -> what stands for their names: ``{"tolerances": "<dimension>"}``.
    """
    placeholders = placeholders or {}
    for name, field in model.model_fields.items():
        path = f"{prefix}{name}"
        if path in placeholders:
            annotation = next(iter(sections_of(field)[0].model_fields.values()))
            for member in sections_of(annotation):
                yield from keys_of(member, f"{path}.{placeholders[path]}.")
            continue
        models = sections_of(field)
        if not models:
            yield _key(path, field, model)
        for member in models:
            yield from keys_of(member, f"{path}{_separator(field)}.", placeholders)


def wanted_value(path: str, field: FieldInfo, model: type[BaseModel]) -> str:
    """What a key takes, in words: "number [mm], >= 0.001"."""
    key = _key(path, field, model)
    return ", ".join(
        part for part in (f"{key.kind} [{key.unit}]" if key.unit else key.kind, key.allowed_values) if part
    )


def _key(path: str, field: FieldInfo, model: type[BaseModel]) -> Key:
    annotation = field.rebuild_annotation()
    unit = next((unit for ending, unit in UNITS.items() if path.endswith(ending)), "")
    return Key(path, _kind(annotation), unit, _default(field), _allowed_values(annotation), _first_lines(model))


def _default(field: FieldInfo) -> str:
    for mark in field.metadata:
        if isinstance(mark, Derived):
            return mark.rule
    if field.is_required():
        return REQUIRED_TEXT
    value = field.default if field.default is not PydanticUndefined else None
    return "none" if value in (None, (), {}, "") else str(value).lower() if isinstance(value, bool) else str(value)


def _bare(annotation: Any) -> Any:
    return _bare(get_args(annotation)[0]) if get_origin(annotation) is Annotated else annotation


def _members(annotation: Any) -> list[Any]:
    """The alternatives of an annotation without None, each without its bounds."""
    bare = _bare(annotation)
    if get_origin(bare) in (Union, UnionType):
        return [part for member in get_args(bare) for part in _members(member) if part is not NoneType]
    return [bare]


def sections_of(field: FieldInfo) -> list[type[BaseModel]]:
    """Sections that the value of a field may be, or hold."""
    sections = []
    for member in _members(field.rebuild_annotation()):
        position = {dict: -1, tuple: 0}.get(get_origin(member))
        inner = member if position is None else get_args(member)[position]
        sections += [part for part in _members(inner) if isinstance(part, type) and issubclass(part, BaseModel)]
    return sections


def _separator(field: FieldInfo) -> str:
    """What stands between the key of a section and those in it: a name, or the brackets of a list."""
    (member, *_) = _members(field.rebuild_annotation())
    return f".{NAME}" if get_origin(member) is dict else "[]" if get_origin(member) is tuple else ""


def _kind(annotation: Any) -> str:
    kinds = []
    for member in _members(annotation):
        origin = get_origin(member)
        if origin is Literal:
            kinds.append("text")
        elif origin is tuple:
            kinds.append(f"list ({_kind(get_args(member)[0])})")
        elif origin is dict:
            kinds.append("table")
        else:
            kinds.append(TYPES.get(member, getattr(member, "__name__", str(member))))
    return " or ".join(dict.fromkeys(filter(None, kinds)))


def _allowed_values(annotation: Any) -> str:
    """Bounds of the value, or of the entries of a list, and the choices."""
    texts = [text for name, form in BOUNDS for text in _bounds(annotation, name, form)]
    for member in _members(annotation):
        if get_origin(member) is Literal:
            choices = (f'"{value}"' if isinstance(value, str) else str(value) for value in get_args(member))
            texts.append(", ".join(choices))
        elif get_origin(member) is tuple:
            texts.append(_allowed_values(get_args(member)[0]))
    return " and ".join(dict.fromkeys(filter(None, texts)))


def _bounds(annotation: Any, name: str, form: str) -> Iterator[str]:
    if get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        for item in (part for entry in metadata for part in getattr(entry, "metadata", [entry])):
            if (bound := getattr(item, name, None)) is not None:
                yield form.format(bound)
        yield from _bounds(inner, name, form)
    elif get_origin(annotation) in (Union, UnionType):
        for member in get_args(annotation):
            yield from _bounds(member, name, form)


def _first_lines(model: type[BaseModel]) -> str:
    """The first paragraph of the docstring of a section."""
    return " ".join((model.__doc__ or "").strip().partition("\n\n")[0].split())

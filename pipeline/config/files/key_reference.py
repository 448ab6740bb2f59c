"""Every key of a settings file, read from the sections that validate it: type, unit, default, allowed values.

`problems_of` tells pydantic's errors in the words of a design or study file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticUndefined

from pipeline.config.files.section import MISSING, Derived, Mistake, nearest_name

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
BOUNDS = (("gt", "> {:g}"), ("ge", ">= {:g}"), ("lt", "< {:g}"), ("le", "<= {:g}"), ("choices", "{}"))
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


FEW_KEYS = 12
"""Keys of a section that a message about an unknown one lists; more: python -m pipeline keys."""
_REQUIREMENTS = {
    "greater_than": "must be > {gt:g}",
    "greater_than_equal": "must be >= {ge:g}",
    "less_than": "must be < {lt:g}",
    "less_than_equal": "must be <= {le:g}",
    "multiple_of": "must be a multiple of {multiple_of:g}",
    "too_short": "must have at least {min_length}",
    "string_too_short": "must not be empty",
    "int_type": "must be an integer",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "string_type": "must be a text in quotes",
    "finite_number": "must be a finite number",
    "tuple_type": "must be a list",
    "dict_type": "must be a section",
    "model_type": "must be a section",
    "literal_error": "must be {expected}",
}


def problems_of(error: ValidationError, model: type[BaseModel]) -> list[Mistake]:
    """The problems that pydantic found in data for `model`, one per key.

    A value that fails each alternative of a union is one problem whose alternatives are joined by "or".
    """
    problems: dict[str, Mistake] = {}
    for detail in error.errors(include_url=False):
        problem = _problem(detail, model)
        earlier_problem = problems.get(problem.key)
        if earlier_problem and problem.requirement not in earlier_problem.requirement:
            problem = Mistake(
                earlier_problem.key,
                earlier_problem.value,
                f"{earlier_problem.requirement}, or {problem.requirement.removeprefix('must be ')}",
            )
        problems[problem.key] = problem
    return list(problems.values())


def _problem(detail: ErrorDetails, model: type[BaseModel]) -> Mistake:
    key, parent = _key_and_section(detail["loc"], model)
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    name = str(detail["loc"][-1])
    if kind == "missing":
        field = parent.model_fields.get(name) if parent else None
        is_value = field is not None and not sections_of(field)
        value_hint = f": {wanted_value(key, field, parent)}" if parent and field and is_value else ""
        return Mistake(key, MISSING, f"add it{value_hint}")
    if kind == "extra_forbidden":
        names = list(parent.model_fields) if parent else []
        key_hint = f"; allowed here: {', '.join(names)}" if len(names) <= FEW_KEYS else ""
        return Mistake(key, value, f"unknown key; {nearest_name(name, names)}{key_hint}")
    if kind == "union_tag_not_found":
        return Mistake(f"{key}.{context['discriminator'].strip(chr(39))}", MISSING, "add it")
    if kind == "union_tag_invalid":
        tag, choices = context["tag"], context["expected_tags"]
        return Mistake(f"{key}.{context['discriminator'].strip(chr(39))}", tag, f"must be one of {choices}")
    template = _REQUIREMENTS.get(kind)
    return Mistake(key, value, template.format(**context) if template else detail["msg"])


def _key_and_section(loc: tuple[int | str, ...], model: type[BaseModel]) -> tuple[str, type[BaseModel] | None]:
    """The dotted key of pydantic's location, and the section that holds it.

    Pydantic puts the tags of unions into a location; they are no keys of the file and are left out. Inside a union of
    plain values the location is no key either, and the key ends there.
    """
    key, annotation, parent = "", model, None
    for part in loc:
        step = _step(annotation, part)
        if step is None:
            break
        suffix, following = step
        if suffix and isinstance(annotation, type) and issubclass(annotation, BaseModel):
            parent = annotation
        key += suffix
        annotation = _single(following)
    return key.removeprefix("."), parent


def _step(annotation: Any, part: int | str) -> tuple[str, Any] | None:
    name = f'"{part}"' if "." in str(part) else part
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = annotation.model_fields.get(str(part))
        return f".{name}", field.annotation if field else None
    if get_origin(annotation) is dict:
        return f".{name}", get_args(annotation)[1]
    if get_origin(annotation) is tuple:
        return f"[{part}]", get_args(annotation)[0]
    members = [member for member in _members(annotation) if part in _tags(member)]
    return ("", members[0]) if members else None


def _single(annotation: Any) -> Any:
    """`annotation` without Annotated, and without None where one alternative is left."""
    members = _members(annotation)
    return members[0] if len(members) == 1 else _bare(annotation)


def _tags(member: Any) -> tuple[Any, ...]:
    if not (isinstance(member, type) and issubclass(member, BaseModel)):
        return ()
    literals = [f.annotation for f in member.model_fields.values() if get_origin(f.annotation) is Literal]
    return tuple(tag for literal in literals for tag in get_args(literal))

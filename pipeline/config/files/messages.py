"""Pydantic's errors in the words of a design or study file."""

from __future__ import annotations

from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pipeline.config.files.key_reference import sections_of, wanted_value
from pipeline.config.files.section import MISSING, Mistake, nearest_name

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
        annotation = _bare(following)
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
    members = [member for member in get_args(annotation) if part in _tags(member)]
    return ("", members[0]) if members else None


def _bare(annotation: Any) -> Any:
    """`annotation` without Annotated and without None."""
    if get_origin(annotation) is Annotated:
        return _bare(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        members = [member for member in get_args(annotation) if member is not NoneType]
        return _bare(members[0]) if len(members) == 1 else annotation
    return annotation


def _tags(member: Any) -> tuple[Any, ...]:
    if not (isinstance(member, type) and issubclass(member, BaseModel)):
        return ()
    literals = [f.annotation for f in member.model_fields.values() if get_origin(f.annotation) is Literal]
    return tuple(tag for literal in literals for tag in get_args(literal))

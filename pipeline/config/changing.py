"""Designs and studies with other numbers, checked as those of a file, and settings as a TOML file."""

from collections.abc import Mapping
from typing import Any

import tomli_w

from pipeline.config.designs.design import Design
from pipeline.config.files.section import with_value
from pipeline.config.reading import parse_design, parse_study, with_tuples
from pipeline.config.studies.study import Study

OF_DESIGN = "design."


def changed_design(design: Design, changes: Mapping[str, Any]) -> Design:
    """The design with other values at dotted keys.

    Raises
    ------
    InputError : with everything that is wrong with the new values.
    """
    raw = design.model_dump(exclude_unset=True, exclude={"thermal"})
    for key, value in changes.items():
        raw = with_value(raw, key, value)
    design_parsed = parse_design(raw, "design")
    return design_parsed.model_copy(update={"thermal": design.thermal}) if design.thermal else design_parsed


def changed_study(study: Study, changes: Mapping[str, Any]) -> Study:
    """The study with other values at dotted keys; those of its design begin with "design.".

    Temperatures of the file are contained in its numbers already, and stay as they are.

    Raises
    ------
    InputError : with everything that is wrong with the new values.
    """
    of_design = {key.removeprefix(OF_DESIGN): value for key, value in changes.items() if key.startswith(OF_DESIGN)}
    design = changed_design(study.design, of_design) if of_design else study.design
    raw = study.model_dump(exclude_unset=True, exclude={"name", "design"})
    raw["cycle"].pop("crank_turns", None)  # follows from the design
    if "loaded_angles" in raw["cycle"] or "cycle.loaded_angles" in changes:
        raw["cycle"].pop("crank_deg", None)
    if "cycle.crank_deg" in changes:
        raw["cycle"].pop("loaded_angles", None)
    name = str(changes.get("name", study.name))
    for key, value in changes.items():
        if key != "name" and not key.startswith(OF_DESIGN):
            raw = with_value(raw, key, value)
    return parse_study(with_tuples(raw) | {"design": "design"}, name, f"study {name}", lambda _: design)


def study_file(study: Study, name: str, design: str, changes: Mapping[str, Any]) -> str:
    """The file of a study under another name, with other top-level settings; ``design`` names its design.

    Raises
    ------
    InputError : with everything that is wrong with the settings.
    """
    content = study.model_dump(exclude_defaults=True, exclude={"name", "design"}) | dict(changes)
    if study.cycle.loaded_angles:
        content["cycle"].pop("crank_deg", None)
    content = {"design": design, **{key: value for key, value in content.items() if value != {}}}
    parse_study(content, name, f"{name}.toml", lambda _: study.design)
    return toml_of(content)


def toml_of(content: Mapping[str, object]) -> str:
    """Tables of plain values, lists and tables as TOML, which has no null: a key whose value is None is left out."""
    return tomli_w.dumps(_without_none(content))


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value

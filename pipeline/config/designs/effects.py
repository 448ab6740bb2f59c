"""Effects and contact laws of a design against their libraries: names, parameters, stiffnesses that are needed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import Annotated

from pydantic import AfterValidator
from pydantic_core import PydanticKnownError

from pipeline.config.files.section import MISSING, Mistake

Effects = Mapping[str, Mapping[str, float]]


PHYSICAL_RANGE = {
    "um": (-1000.0, 1000.0),
    "N m": (0.0, 1e7),
    "1": (0.0, 1e6),
    "arcmin/(N m)": (0.0, 1e6),
    "arcmin/(N m)2": (0.0, 1e6),
    "arcmin": (0.0, 1e4),
    "1/K": (-0.1, 0.1),
    "s": (0.0, 1e9),
    "um/N": (0.0, 1e6),
    "um/(m K)": (-1000.0, 1000.0),
}
"""What a parameter may be by its unit: deviations of a millimetre, friction and compliance that take energy away, times
of thirty years, twice the expansion of any plastic. Beyond it a value was typed in another unit."""


def effect_problems(effects: Effects) -> Iterator[Mistake]:
    """Effects and parameters that the library has not, and parameters that are missing."""
    if not effects:
        return
    from pipeline.model.effects import library  # the mechanics are slow to import

    available = library()
    for name, values in effects.items():
        if name not in available:
            yield Mistake(f"effects.{name}", None, f"unknown effect; known are {', '.join(available)}")
            continue
        parameters = {parameter.name: parameter for parameter in available[name].parameters}
        allowed_text = ", ".join(parameters)
        for key, value in values.items():
            if key not in parameters:
                yield Mistake(f"effects.{name}.{key}", value, f"unknown parameter; {name} has {allowed_text}")
                continue
            lower, upper = PHYSICAL_RANGE.get(parameters[key].unit, (-inf, inf))
            if not lower <= value <= upper:
                yield Mistake(f"effects.{name}.{key}", value, f"must be {lower:g} to {upper:g} {parameters[key].unit}")
        for key, parameter in parameters.items():
            if key not in values:
                yield Mistake(f"effects.{name}.{key}", MISSING, f"add it ({parameter.unit}: {parameter.meaning})")


def study_effect_problems(effects: Effects, disks: int, temperature_rise: float) -> Iterator[Mistake]:
    """Effects that a load cycle of equilibria cannot show, or not of so many ``disks``, or at no rise [K]."""
    if not effects:
        return
    from pipeline.model.effects import library  # the mechanics are slow to import
    from pipeline.model.effects.effect import TEMPERATURE, TIME

    if {"contact_friction", "directional_load_friction"} <= set(effects):
        requirement = "is not solved beside contact_friction; delete one of both from the design of the study"
        yield Mistake("design.effects.directional_load_friction", None, requirement)
    reasons = {TIME: "a study's load cycle has no time"}
    if not temperature_rise:
        reasons[TEMPERATURE] = (
            "a study is at the temperature of the drawing unless its design states temperature_rise_K"
        )
    for name in effects:
        if name not in library():
            continue
        effect = library()[name]
        if effect.of_one_disk and disks > 1:
            requirement = f"is solved for one disk, not for {disks}; delete it from the design of the study"
            yield Mistake(f"design.effects.{name}", None, requirement)
        for need, reason in reasons.items():
            if need in effect.needs:
                yield Mistake(f"design.effects.{name}", None, f"{reason}; delete it from the design of the study")


def _check_law_name(name: str) -> str:
    from pipeline.model.contact.line_laws import library  # most programs that read a study need no mechanics

    if name not in library():
        raise PydanticKnownError("literal_error", {"expected": " or ".join(repr(law) for law in library())})
    return name


LawName = Annotated[str, AfterValidator(_check_law_name)]


def stiffness_problems(law: str, stiffness: float | None) -> Iterator[Mistake]:
    """A stiffness that the law asks for and is missing, or one that it derives."""
    from pipeline.model.contact.line_laws import library

    takes_stiffness = library()[law].of_stiffness is not None
    if takes_stiffness and stiffness is None:
        yield Mistake("springs.stiffness_N_per_mm", MISSING, f'law = "{law}" needs the stiffness of a contact')
    elif stiffness is not None and not takes_stiffness:
        requirement = f'law = "{law}" derives it from geometry and material; delete it, or take law = "linear"'
        yield Mistake("springs.stiffness_N_per_mm", stiffness, requirement)

"""Impossible reducers: what a design file may say number by number, but no workshop can make.

Effects and contact laws are checked against their libraries: names, parameters, stiffnesses that are needed.
"""

from collections.abc import Iterator, Mapping
from math import inf, pi, sin
from typing import Annotated, Any

from pydantic import AfterValidator
from pydantic_core import PydanticKnownError

from pipeline.config.designs.design import Disk, Housing
from pipeline.config.designs.flank import flank_problems
from pipeline.config.designs.sections import Cycloid, Operation
from pipeline.config.files.section import MISSING, Mistake, nearest_name
from pipeline.config.mechanisms import OutputMechanism
from pipeline.config.mechanisms.crankshaft import Shaft
from pipeline.model.elastic.beam import THICKEST
from pipeline.model.geometry.contacts import clocking
from pipeline.model.geometry.cycloid_profile import CycloidProfile


def geometry_problems(parts: Mapping[str, Any]) -> list[Mistake]:
    """Every impossibility among the valid sections of a design.

    Parameters
    ----------
    parts : the sections that are valid by themselves, by name; a check whose sections are not all there is left out, so
        that the problems of the others are still found.
    """
    problems: list[Mistake] = []
    cycloid, housing, disk, output = (parts.get(name) for name in ("cycloid", "housing", "disk", "output"))
    if cycloid:
        impossible = list(_profile(cycloid))
        problems += impossible
        if parts.get("flank") and not impossible:
            problems += flank_problems(cycloid, parts["flank"])
    if cycloid and housing:
        problems += _housing(cycloid, housing)
    if cycloid and disk:
        problems += _bore(cycloid, disk)
    if output:
        problems += output.problems(cycloid, disk)
    if parts.get("input_shaft"):
        problems += _input_shaft(parts["input_shaft"], disk, output)
    if disk and disk.count > 1:
        problems += _several_disks(disk, cycloid, output)
    if output and output.pins_in_holes and parts.get("operation"):
        problems += _friction(parts["operation"])
    return problems + list(_materials(parts))


def _friction(operation: Operation) -> Iterator[Mistake]:
    if operation.friction and operation.friction.output_coefficient is None:
        requirement = "must be given, from 0 to 0.5: output pins slide in the holes, or their bushes on them"
        yield Mistake("operation.friction.output_coefficient", None, requirement)


def _input_shaft(shaft: Shaft, disk: Disk | None, output: OutputMechanism | None) -> Iterator[Mistake]:
    if output and output.carries_disks:
        requirement = "acts on nothing: the disks run on the cranks of the carrier; write [output.crankshaft]"
        yield Mistake("input_shaft", None, requirement)
    yield from shaft.problems("input_shaft", disk.count if disk else 1)


def _several_disks(disk: Disk, cycloid: Cycloid | None, output: OutputMechanism | None) -> Iterator[Mistake]:
    """Disks that their output cannot take, or that are no one part."""
    if output and output.one_disk_because:
        requirement = f"must be 1 with the output {output.name}: {output.one_disk_because}; take pin_in_hole"
        yield Mistake("disk.count", disk.count, requirement)
    holes = output.holes(cycloid) if output and cycloid else None
    if disk.clocking == "same_part" and cycloid and holes:
        clockings = (clocking(holes.centres, cycloid.lobes, number, disk.count) for number in range(disk.count))
        if any(clocking_of_disk.lobes is None for clocking_of_disk in clockings):
            requirement = (
                f"{len(holes.centres)} holes and {cycloid.lobes} lobes: no turn by whole holes leaves the lobes "
                f"1/{disk.count} of their pitch off, so disks of one part collide with the pins; the number of holes "
                f'over its common divisor with that of the lobes must divide by {disk.count}; or take "own_holes"'
            )
            yield Mistake("disk.clocking", disk.clocking, requirement)


def _profile(cycloid: Cycloid) -> Iterator[Mistake]:
    pitch_ratio = cycloid.eccentricity_mm * cycloid.pins / cycloid.pin_circle_radius_mm
    if pitch_ratio >= 1:
        limit = cycloid.pin_circle_radius_mm / cycloid.pins
        requirement = (
            f"eccentricity x pins / pin circle radius is {pitch_ratio:.4g}, must be < 1 or the flank has loops; "
            f"take an eccentricity below {limit:.4g} mm"
        )
        yield Mistake("cycloid.eccentricity_mm", cycloid.eccentricity_mm, requirement)
    else:
        locus = CycloidProfile(
            cycloid.pins, cycloid.pin_circle_radius_mm, cycloid.pin_radius_mm, cycloid.eccentricity_mm
        ).smallest_convex_locus_radius()
        if cycloid.pin_radius_mm >= locus:
            requirement = (
                f"must be < {locus:.4g} mm, the smallest convex radius of the pin centres' path: "
                "the flank is undercut; take smaller pins or less eccentricity"
            )
            yield Mistake("cycloid.pin_radius_mm", cycloid.pin_radius_mm, requirement)
    pitch = 2 * cycloid.pin_circle_radius_mm * sin(pi / cycloid.pins)
    if pitch <= 2 * cycloid.pin_radius_mm:
        requirement = (
            f"must be < {pitch / 2:.4g} mm, half the pitch of {cycloid.pins} pins on the circle of "
            f"{cycloid.pin_circle_radius_mm:g} mm: neighbouring pins overlap; take smaller or fewer pins"
        )
        yield Mistake("cycloid.pin_radius_mm", cycloid.pin_radius_mm, requirement)
    if cycloid.root_radius_mm <= 0:
        requirement = "must exceed pin radius + eccentricity: nothing is left of the disk; take a larger pin circle"
        yield Mistake("cycloid.pin_circle_radius_mm", cycloid.pin_circle_radius_mm, requirement)


def _housing(cycloid: Cycloid, housing: Housing) -> Iterator[Mistake]:
    reach = 2 * (cycloid.pin_circle_radius_mm + cycloid.pin_radius_mm)
    if housing.outer_diameter_mm <= reach:
        requirement = (
            f"must be > {reach:.4g} mm, the circle around the pins: pins lie outside the housing; "
            "a diameter is asked for, not a radius"
        )
        yield Mistake("housing.outer_diameter_mm", housing.outer_diameter_mm, requirement)
    wall, mean = (0.5 * housing.outer_diameter_mm + sign * cycloid.pin_circle_radius_mm for sign in (-1, 1))
    if housing.ring and wall > THICKEST * 0.5 * mean:
        widest = 2 * cycloid.pin_circle_radius_mm * (1 + THICKEST / 2) / (1 - THICKEST / 2)
        requirement = (
            f"must be <= {widest:.4g} mm with [housing.ring]: a wall of more than {THICKEST:g} mean radii is no thin "
            "ring; correct it, or delete [housing.ring], a rigid housing"
        )
        yield Mistake("housing.outer_diameter_mm", housing.outer_diameter_mm, requirement)


def _bore(cycloid: Cycloid, disk: Disk) -> Iterator[Mistake]:
    if disk.bore_radius_mm >= cycloid.root_radius_mm:
        requirement = (
            f"must be < {cycloid.root_radius_mm:.4g} mm, the radius at the lobes' roots: the bore leaves no disk"
        )
        yield Mistake("disk.bore_radius_mm", disk.bore_radius_mm, requirement)


def _materials(parts: Mapping[str, Any]) -> Iterator[Mistake]:
    materials = parts.get("materials")
    if materials is None:
        return
    sections = {name: parts[name] for name in ("disk", "pins", "input_shaft") if parts.get(name)}
    if parts.get("housing") and parts["housing"].ring:
        sections["housing.ring"] = parts["housing"].ring
    names = {f"{name}.material": section.material for name, section in sections.items()}
    if "output" in parts:
        names |= {f"output.{key}": name for key, name in parts["output"].material_names.items()}
    for key, name in names.items():
        if name not in materials:
            yield Mistake(key, name, f"no such section [materials.{name}]; {nearest_name(name, materials)}")


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


def study_effect_problems(effects: Effects, temperature_rise: float) -> Iterator[Mistake]:
    """Effects that a load cycle of equilibria cannot show, or only where the temperature rises [K]."""
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
        for need, reason in reasons.items():
            if need in effect.needs:
                yield Mistake(f"design.effects.{name}", None, f"{reason}; delete it from the design of the study")


def _check_law_name(name: str) -> str:
    from pipeline.model.contact.line_laws import library  # most programs that read a study need no mechanics

    if name not in library():
        raise PydanticKnownError("literal_error", {"expected": " or ".join(repr(law) for law in library())})
    return name


class _LawNames:
    """The names of the laws, for the reference of keys."""

    @property
    def choices(self) -> str:
        from pipeline.model.contact.line_laws import library

        return ", ".join(f'"{law}"' for law in library())


LawName = Annotated[str, AfterValidator(_check_law_name), _LawNames()]


def stiffness_problems(law: str, stiffness: float | None) -> Iterator[Mistake]:
    """A stiffness that the law asks for and is missing, or one that it derives."""
    from pipeline.model.contact.line_laws import library

    takes_stiffness = library()[law].of_stiffness is not None
    if takes_stiffness and stiffness is None:
        yield Mistake("springs.stiffness_N_per_mm", MISSING, f'law = "{law}" needs the stiffness of a contact')
    elif stiffness is not None and not takes_stiffness:
        requirement = f'law = "{law}" derives it from geometry and material; delete it, or take law = "linear"'
        yield Mistake("springs.stiffness_N_per_mm", stiffness, requirement)

"""Impossible reducers: what a design file may say number by number, but no workshop can make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi, sin
from typing import Any

from pipeline.config.designs.design import Cycloid, Disk, Housing
from pipeline.config.designs.flank import flank_problems
from pipeline.config.designs.operation import Operation
from pipeline.config.files.section import Mistake, nearest_name
from pipeline.config.mechanisms import OutputMechanism
from pipeline.config.mechanisms.crankshaft import Shaft
from pipeline.model.elastic.ring import THICKEST
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
            yield Mistake(
                "disk.clocking",
                disk.clocking,
                f"{len(holes.centres)} holes and {cycloid.lobes} lobes: no turn by whole holes leaves the lobes "
                f"1/{disk.count} of their pitch off, so disks of one part collide with the pins; the number of holes "
                f'over its common divisor with that of the lobes must divide by {disk.count}; or take "own_holes"',
            )


def _profile(cycloid: Cycloid) -> Iterator[Mistake]:
    pitch_ratio = cycloid.eccentricity_mm * cycloid.pins / cycloid.pin_circle_radius_mm
    if pitch_ratio >= 1:
        limit = cycloid.pin_circle_radius_mm / cycloid.pins
        yield Mistake(
            "cycloid.eccentricity_mm",
            cycloid.eccentricity_mm,
            f"eccentricity x pins / pin circle radius is {pitch_ratio:.4g}, must be < 1 or the flank has loops; "
            f"take an eccentricity below {limit:.4g} mm",
        )
    else:
        locus = CycloidProfile(
            cycloid.pins, cycloid.pin_circle_radius_mm, cycloid.pin_radius_mm, cycloid.eccentricity_mm
        ).smallest_convex_locus_radius()
        if cycloid.pin_radius_mm >= locus:
            yield Mistake(
                "cycloid.pin_radius_mm",
                cycloid.pin_radius_mm,
                f"must be < {locus:.4g} mm, the smallest convex radius of the pin centres' path: "
                "the flank is undercut; take smaller pins or less eccentricity",
            )
    pitch = 2 * cycloid.pin_circle_radius_mm * sin(pi / cycloid.pins)
    if pitch <= 2 * cycloid.pin_radius_mm:
        yield Mistake(
            "cycloid.pin_radius_mm",
            cycloid.pin_radius_mm,
            f"must be < {pitch / 2:.4g} mm, half the pitch of {cycloid.pins} pins on the circle of "
            f"{cycloid.pin_circle_radius_mm:g} mm: neighbouring pins overlap; take smaller or fewer pins",
        )
    if cycloid.root_radius_mm <= 0:
        yield Mistake(
            "cycloid.pin_circle_radius_mm",
            cycloid.pin_circle_radius_mm,
            "must exceed pin radius + eccentricity: nothing is left of the disk; take a larger pin circle",
        )


def _housing(cycloid: Cycloid, housing: Housing) -> Iterator[Mistake]:
    reach = 2 * (cycloid.pin_circle_radius_mm + cycloid.pin_radius_mm)
    if housing.outer_diameter_mm <= reach:
        yield Mistake(
            "housing.outer_diameter_mm",
            housing.outer_diameter_mm,
            f"must be > {reach:.4g} mm, the circle around the pins: pins lie outside the housing; "
            "a diameter is asked for, not a radius",
        )
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
        yield Mistake(
            "disk.bore_radius_mm",
            disk.bore_radius_mm,
            f"must be < {cycloid.root_radius_mm:.4g} mm, the radius at the lobes' roots: the bore leaves no disk",
        )


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

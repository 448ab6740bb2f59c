"""Impossible reducers: what a design file may say number by number, but no workshop can make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import hypot, pi, sin
from typing import Any

from pipeline.config.design import Cycloid, Disk, Housing, PinInHole, RollerPlate
from pipeline.config.flank import flank_problems
from pipeline.config.section import Problem, nearest_name
from pipeline.model.geometry.cycloid_profile import CycloidProfile


def geometry_problems(parts: Mapping[str, Any]) -> list[Problem]:
    """Every impossibility among the valid sections of a design.

    Parameters
    ----------
    parts : the sections that are valid by themselves, by name; a check whose sections are not all there is left out, so
        that the problems of the others are still found.
    """
    problems: list[Problem] = []
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
    if isinstance(output, RollerPlate):
        problems += _plate(output, cycloid, disk)
    if isinstance(output, PinInHole) and cycloid:
        problems += _holes(output, cycloid, disk)
    return problems + list(_materials(parts))


def root_radius(cycloid: Cycloid) -> float:
    """Radius of the disk at the roots of its lobes [mm]: pin circle less eccentricity less pin."""
    return cycloid.pin_circle_radius_mm - cycloid.eccentricity_mm - cycloid.pin_radius_mm


def _profile(cycloid: Cycloid) -> Iterator[Problem]:
    pitch_ratio = cycloid.eccentricity_mm * cycloid.pins / cycloid.pin_circle_radius_mm
    if pitch_ratio >= 1:
        limit = cycloid.pin_circle_radius_mm / cycloid.pins
        yield Problem(
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
            yield Problem(
                "cycloid.pin_radius_mm",
                cycloid.pin_radius_mm,
                f"must be < {locus:.4g} mm, the smallest convex radius of the pin centres' path: "
                "the flank is undercut; take smaller pins or less eccentricity",
            )
    pitch = 2 * cycloid.pin_circle_radius_mm * sin(pi / cycloid.pins)
    if pitch <= 2 * cycloid.pin_radius_mm:
        yield Problem(
            "cycloid.pin_radius_mm",
            cycloid.pin_radius_mm,
            f"must be < {pitch / 2:.4g} mm, half the pitch of {cycloid.pins} pins on the circle of "
            f"{cycloid.pin_circle_radius_mm:g} mm: neighbouring pins overlap; take smaller or fewer pins",
        )
    if root_radius(cycloid) <= 0:
        yield Problem(
            "cycloid.pin_circle_radius_mm",
            cycloid.pin_circle_radius_mm,
            "must exceed pin radius + eccentricity: nothing is left of the disk; take a larger pin circle",
        )


def _housing(cycloid: Cycloid, housing: Housing) -> Iterator[Problem]:
    reach = 2 * (cycloid.pin_circle_radius_mm + cycloid.pin_radius_mm)
    if housing.outer_diameter_mm <= reach:
        yield Problem(
            "housing.outer_diameter_mm",
            housing.outer_diameter_mm,
            f"must be > {reach:.4g} mm, the circle around the pins: pins stand outside the housing; "
            "a diameter is asked for, not a radius",
        )


def _bore(cycloid: Cycloid, disk: Disk) -> Iterator[Problem]:
    if disk.bore_radius_mm >= root_radius(cycloid):
        yield Problem(
            "disk.bore_radius_mm",
            disk.bore_radius_mm,
            f"must be < {root_radius(cycloid):.4g} mm, the radius at the lobes' roots: the bore leaves no disk",
        )


def _plate(output: RollerPlate, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Problem]:
    yield from _rollers(output)
    if disk:
        yield from _boss(output, disk)
    if cycloid:
        yield from _rollers_on_disk(output, cycloid)


def _rollers(output: RollerPlate) -> Iterator[Problem]:
    diameter = 2 * output.roller_radius_mm
    length = output.outer_station_mm - output.inner_station_mm
    if output.stations > 1 and length < diameter * (output.stations - 1):
        yield Problem(
            "output.outer_station_mm",
            output.outer_station_mm,
            f"must be >= {output.inner_station_mm + diameter * (output.stations - 1):.4g} mm, or the {output.stations} "
            f"rollers of diameter {diameter:g} mm between the stations overlap; "
            "move the stations apart or take smaller or fewer rollers",
        )
    if output.inner_station_mm < output.roller_radius_mm:
        yield Problem(
            "output.inner_station_mm",
            output.inner_station_mm,
            f"must be >= {output.roller_radius_mm:g} mm, or the innermost rollers of the two ends overlap",
        )


def _boss(output: RollerPlate, disk: Disk) -> Iterator[Problem]:
    if output.face_offset_mm <= disk.bore_radius_mm:
        yield Problem(
            "output.face_offset_mm",
            output.face_offset_mm,
            f"must be > {disk.bore_radius_mm:g} mm, the bore's radius: the boss's face lies inside the bore",
        )


def _rollers_on_disk(output: RollerPlate, cycloid: Cycloid) -> Iterator[Problem]:
    # The eccentric moves the disk under rollers that stand still along the other slide.
    reach = hypot(output.outer_station_mm + output.roller_radius_mm, output.face_offset_mm + output.roller_radius_mm)
    available = root_radius(cycloid) - cycloid.eccentricity_mm
    if reach > available:
        yield Problem(
            "output.outer_station_mm",
            output.outer_station_mm,
            f"the outermost rollers reach {reach:.4g} mm from the axis, the disk ends at {available:.4g} mm "
            "(lobes' roots less eccentricity); move the stations inwards",
        )


def _holes(output: PinInHole, cycloid: Cycloid, disk: Disk | None) -> Iterator[Problem]:
    hole, circle = output.hole_radius_mm(cycloid), output.pin_circle_radius_mm
    what = f"a hole's radius is {hole:.4g} mm: pin, eccentricity and clearance"
    pitch = 2 * circle * sin(pi / output.pins)
    if pitch <= 2 * hole:
        yield Problem(
            "output.pin_radius_mm",
            output.pin_radius_mm,
            f"{what}; must be < {pitch / 2:.4g} mm, half the distance between the {output.pins} holes, which overlap "
            "each other; take thinner or fewer output pins, or a larger circle",
        )
    root = root_radius(cycloid)
    if circle + hole >= root:
        yield Problem(
            "output.pin_circle_radius_mm",
            circle,
            f"{what}; the holes reach {circle + hole:.4g} mm from the disk's centre, must be < {root:.4g} mm, the "
            "radius at the lobes' roots; move them inwards or take thinner output pins",
        )
    if disk and circle - hole <= disk.bore_radius_mm:
        yield Problem(
            "output.pin_circle_radius_mm",
            circle,
            f"{what}; the holes reach within {circle - hole:.4g} mm of the disk's centre, must be > "
            f"{disk.bore_radius_mm:g} mm, the bore's radius; move them outwards, or take thinner output pins or a "
            "smaller bore",
        )


def _materials(parts: Mapping[str, Any]) -> Iterator[Problem]:
    materials = parts.get("materials")
    if materials is None:
        return
    users = [("disk", "material"), ("pins", "material")]
    if "output" in parts:
        users += [("output", key) for key in parts["output"].material_keys]
    for section, key in users:
        if section in parts and getattr(parts[section], key) not in materials:
            name = getattr(parts[section], key)
            yield Problem(
                f"{section}.{key}", name, f"no such section [materials.{name}]; {nearest_name(name, materials)}"
            )

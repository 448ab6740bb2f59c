"""The flank of the disk as drawn, and as measured: the optional section `[flank]` of a design file.

A measured flank may lie in a CSV file, which the design names beside its drawn flank.
"""

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.config.designs.sections import Cycloid
from pipeline.config.files.section import Micrometres, Mistake, Section, nearest_name, shown_value
from pipeline.config.files.table_file import read_table, shortened_list
from pipeline.errors import InputError
from pipeline.model.geometry.cycloid_profile import NOMINAL, CycloidProfile, FlankModification, MeasuredFlank
from pipeline.model.geometry.drawn_flank import drawn_flank, lobe_length, phase_of_arc
from pipeline.model.units import ARCMIN, MM_PER_UM

FEWEST_POINTS = 8
"""Points of a measured lobe below which its shape is not known."""
WIDEST_GAP_DEG = 30.0
"""Of phase between two measured points: a flank is no guess between them."""
CHECKED_POINTS = 2049
"""Of a lobe, at which the flank must go on around the disk's centre."""


class Measured(Section):
    """Deviation of the measured flank from the drawn one along its outward normal: excess of material is positive.

    Points stand at `phase_deg` of a lobe, or at `arc_mm` along the drawn flank, both clockwise from the root at which
    the lobe begins. One list of deviations holds for all lobes, or there is one a lobe, clockwise from lobe 0. `file`
    names where they were read from.
    """

    phase_deg: tuple[Annotated[float, Field(ge=0, lt=360)], ...] | None = None
    arc_mm: tuple[Annotated[float, Field(ge=0)], ...] | None = None
    deviation_um: Annotated[tuple[tuple[Micrometres, ...], ...], Field(min_length=1)]
    file: str = ""

    @property
    def place(self) -> str:
        """Name of the key that says where the points stand."""
        return "arc_mm" if self.phase_deg is None else "phase_deg"

    @property
    def places(self) -> tuple[float, ...]:
        """Where the points stand, in degrees or mm."""
        return (self.arc_mm or ()) if self.phase_deg is None else self.phase_deg

    @property
    def points(self) -> int:
        """Number of points of a lobe."""
        return len(self.places)

    def row(self, lobe: int, point: int) -> str:
        """A point as a message names it: its line in the file, or its place in the lists."""
        k = lobe % len(self.deviation_um)
        return f"{self.file}:{2 + k * self.points + point}" if self.file else f"point {point} of list {k}"


class FlankSection(Section):
    """How the drawing modifies the flank that the reducer's own pins would generate, and what was measured of it.

    `equidistant_um` (dr): the generating roller is larger than a pin; positive takes material off along the normal.
    `moved_distance_um` (dR): the generating pin circle is larger than the reducer's; negative takes material off.
    `rotation_arcmin` (delta): |a| delta off both flanks of every lobe, a being the arm of the normal about the disk's
    centre; nothing at root and tip, where the two flanks meet in the parallel drawn by the others.
    """

    equidistant_um: Micrometres = 0.0
    moved_distance_um: Micrometres = 0.0
    rotation_arcmin: Annotated[float, Field(ge=0, le=60)] = 0.0
    measured: Measured | None = None


def flank_profile(cycloid: Cycloid, flank: FlankSection | None) -> CycloidProfile:
    """The profile of the disk with the modification that the design draws, and the measured deviation."""
    profile = CycloidProfile(cycloid.pins, cycloid.pin_circle_radius_mm, cycloid.pin_radius_mm, cycloid.eccentricity_mm)
    if flank is None:
        return profile
    drawn_profile = CycloidProfile(*profile.numbers, _modification(flank, None))
    flank_measurement = None if flank.measured is None else _measured_flank(flank.measured, drawn_profile)
    return CycloidProfile(*profile.numbers, _modification(flank, flank_measurement))


def _modification(flank: FlankSection, flank_measurement: MeasuredFlank | None) -> FlankModification:
    return FlankModification(
        MM_PER_UM * flank.equidistant_um,
        MM_PER_UM * flank.moved_distance_um,
        flank.rotation_arcmin / ARCMIN,
        flank_measurement,
    )


def _measured_flank(section: Measured, drawn_profile: CycloidProfile) -> MeasuredFlank:
    if section.phase_deg is not None:
        phase = np.radians(section.phase_deg)
    else:
        phase = phase_of_arc(drawn_profile, np.array(section.arc_mm))
    return MeasuredFlank(phase, MM_PER_UM * np.array(section.deviation_um))


def flank_problems(cycloid: Cycloid, flank: FlankSection) -> Iterator[Mistake]:
    """What cannot be made or read of a flank whose nominal form is possible."""
    drawn_profile = flank_profile(cycloid, flank.model_copy(update={"measured": None}))
    generating = drawn_profile.generating
    if generating.pin_radius <= 0 or generating.pin_circle_radius <= 0:
        key = "equidistant_um" if generating.pin_radius <= 0 else "moved_distance_um"
        yield Mistake(f"flank.{key}", getattr(flank, key), "leaves no generating roller; micrometres are asked for")
        return
    if generating.shortening >= 1:
        limit = cycloid.eccentricity_mm * cycloid.pins - cycloid.pin_circle_radius_mm
        requirement = f"must be > {limit / MM_PER_UM:.4g}, or the drawn flank has loops: its pin circle is too small"
        yield Mistake("flank.moved_distance_um", flank.moved_distance_um, requirement)
        return
    locus = generating.smallest_convex_locus_radius()
    if generating.pin_radius >= locus:
        requirement = f"must be < {(locus - cycloid.pin_radius_mm) / MM_PER_UM:.4g}, or the drawn flank is undercut"
        yield Mistake("flank.equidistant_um", flank.equidistant_um, requirement)
        return
    if fold := _fold(drawn_profile):
        requirement = f"the flank folds at a phase of {fold[1]:.3g} deg; take a smaller rotation"
        yield Mistake("flank.rotation_arcmin", flank.rotation_arcmin, requirement)
    elif flank.measured is not None:
        yield from _measured_problems(cycloid, flank, flank.measured, drawn_profile)


def _measured_problems(
    cycloid: Cycloid, flank: FlankSection, section: Measured, drawn_profile: CycloidProfile
) -> Iterator[Mistake]:
    """The problems of a measured flank; of those that make others, the first."""
    for mistakes in (
        _layout(cycloid, section),
        _places(section, lobe_length(drawn_profile)),
        _coverage(section, drawn_profile),
    ):
        if problems := list(mistakes):
            yield from problems
            return
    if fold := _fold(flank_profile(cycloid, flank)):
        lobe, degrees = fold
        phase_index = int(np.searchsorted(np.degrees(_measured_flank(section, drawn_profile).phase), degrees))
        first_row, last_row = (
            section.row(lobe, point) for point in (max(phase_index - 1, 0), min(phase_index, section.points - 1))
        )
        requirement = (
            f"the flank folds or cuts itself at a phase of {degrees:.4g} deg; correct these points, or leave them out"
        )
        yield Mistake(f"flank.measured: {first_row} to {last_row}", None, requirement)


def _layout(cycloid: Cycloid, section: Measured) -> Iterator[Mistake]:
    key, lists = "flank.measured", section.deviation_um
    if (section.phase_deg is None) == (section.arc_mm is None):
        yield Mistake(key, None, "must have phase_deg or arc_mm, one of them: where its points are on a lobe")
    elif section.points < FEWEST_POINTS:
        yield Mistake(f"{key}.{section.place}", f"{section.points} points", f"must be >= {FEWEST_POINTS} of a lobe")
    elif len(lists) not in (1, cycloid.lobes):
        yield Mistake(f"{key}.deviation_um", f"{len(lists)} lists", f"must be 1, or {cycloid.lobes}: one a lobe")
    else:
        for k, values in enumerate(lists):
            if len(values) != section.points:
                requirement = f"must be {section.points}, one for each {section.place}"
                yield Mistake(f"{key}.deviation_um[{k}]", f"{len(values)} values", requirement)


def _places(section: Measured, length: float) -> Iterator[Mistake]:
    key, places = f"flank.measured.{section.place}", section.places
    for k, (place_before, place_after) in enumerate(itertools.pairwise(places)):
        if place_after <= place_before:
            requirement = f"stands after {place_before:g}: points must ascend along a lobe, none twice"
            yield Mistake(f"{key}, {section.row(0, k)} and {section.row(0, k + 1)}", place_after, requirement)
    if section.arc_mm is not None and places[-1] >= length:
        requirement = f"must be < {length:.6g}, the length of a lobe"
        yield Mistake(f"{key}, {section.row(0, section.points - 1)}", places[-1], requirement)


def _coverage(section: Measured, drawn_profile: CycloidProfile) -> Iterator[Mistake]:
    phase = np.degrees(_measured_flank(section, drawn_profile).phase)
    gaps = np.diff(np.append(phase, phase[0] + 360))
    widest = int(np.argmax(gaps))
    if gaps[widest] > WIDEST_GAP_DEG:
        requirement = f"no point in the next {gaps[widest]:.3g} deg of phase, must be one within {WIDEST_GAP_DEG:g}"
        key = f"flank.measured.{section.place}, {section.row(0, widest)}"
        yield Mistake(key, section.places[widest], f"{requirement}; measure the whole lobe")


def _fold(profile: CycloidProfile) -> tuple[int, float] | None:
    """Lobe and phase [deg] at which the flank turns back about the disk's centre; None where it nowhere does."""
    if profile.modification == NOMINAL:
        return None
    flank_measurement = profile.modification.measured_flank
    lobes = np.arange(1 if flank_measurement is None else len(flank_measurement.material))[:, None]
    phase = np.linspace(0, 2 * np.pi, CHECKED_POINTS)
    points = drawn_flank(profile, lobes, phase)
    backward = np.imag(np.conj(points[:, :-1]) * points[:, 1:]) >= 0
    if not backward.any():
        return None
    lobe, point_index = np.argwhere(backward)[0]
    return int(lobe), float(np.degrees(phase[point_index]))


DEVIATION, LOBE, PLACES = "deviation_um", "lobe", ("phase_deg", "arc_mm")
LARGEST_TABLE = 2_000_000
"""Rows: a thousand lobes with two thousand points each."""


def with_flank_file(raw: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The design ``raw`` with the content of the flank file that it names, a path from its own ``folder``.

    Raises
    ------
    InputError : there is no such file, or it is no table of a flank.
    """
    flank = raw.get("flank")
    if not isinstance(flank, Mapping) or not isinstance(flank.get("measured"), str):
        return dict(raw)
    path = folder / flank["measured"]
    if path.suffix.lower() != ".csv" or not path.is_file():
        reason = "is no CSV file" if path.is_file() else "no such file beside the design"
        shown_text = shown_value(flank["measured"])
        raise InputError(
            [f"flank.measured = {shown_text}; {reason}; name a CSV file, its path from the design's folder"]
        )
    return {**raw, "flank": {**flank, "measured": flank_table(path)}}


def flank_table(path: Path) -> dict[str, Any]:
    """The columns of a flank file as the section ``flank.measured`` has them.

    Raises
    ------
    InputError : a column is missing or unknown, rows are no numbers, or lobes are not one after the other.
    """
    name = path.name
    table = read_table(path, name)
    station_column = _checked_columns(list(table.cells), name)
    if not 0 < len(table.cells) <= LARGEST_TABLE:
        raise InputError([f"{name}: {len(table.cells) or 'no'} rows; must be 1 to {LARGEST_TABLE} measured points"])
    numbers = pd.DataFrame({column: table.numbers(column) for column in table.cells}, index=table.cells.index)
    problems = [
        line
        for column in numbers
        for line in table.faults(column, ~np.isfinite(numbers[column].to_numpy(float)), "must be a number")
    ]
    if problems:
        raise InputError(shortened_list(problems, name))
    lists = _lobes(numbers, station_column, name)
    return {station_column: lists[0][0], DEVIATION: tuple(deviation for _, deviation in lists), "file": name}


def _columns() -> str:
    return f"{' or '.join(PLACES)}, {DEVIATION}, and {LOBE} where each lobe was measured"


def _checked_columns(columns: list[str], name: str) -> str:
    places = [column for column in PLACES if column in columns]
    known_columns = (*PLACES, DEVIATION, LOBE)
    for column in columns:
        if column not in known_columns:
            advice = nearest_name(column, known_columns)
            raise InputError([f"{name}: column {shown_value(column)} is unknown; {advice}; columns are {_columns()}"])
    if len(places) != 1 or DEVIATION not in columns:
        raise InputError([f"{name}: columns {', '.join(columns)}; must be {_columns()}"])
    return places[0]


def _lobes(numbers: pd.DataFrame, place_column: str, name: str) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Places and deviations of each lobe."""
    if LOBE not in numbers:
        return [(tuple(numbers[place_column].astype(float)), tuple(numbers[DEVIATION].astype(float)))]
    lobe = numbers[LOBE].to_numpy(float)
    count = int(np.argmax(lobe != lobe[0])) or len(lobe)
    expected_lobe = np.arange(len(lobe)) // count
    if wrong_rows := np.flatnonzero(lobe != expected_lobe).tolist():
        requirement = (
            f"must be {expected_lobe[wrong_rows[0]]}: {count} rows a lobe as of the first, lobes from 0, clockwise"
        )
        raise InputError(
            [f"{name}: lobe = {lobe[wrong_rows[0]]:g} in row {numbers.index[wrong_rows[0]]}; {requirement}"]
        )
    if len(lobe) % count != 0:
        raise InputError([f"{name}: the last lobe has {len(lobe) % count} rows; must have {count} as the first"])
    places, deviations = (numbers[column].to_numpy(float).reshape(-1, count) for column in (place_column, DEVIATION))
    if len(differing := np.argwhere(places != places[0])):
        k, point = differing[0]
        shown_text = f"{place_column} = {places[k, point]:g} in row {numbers.index[k * count + point]}"
        requirement = (
            f"must be {places[0, point]:g} as in row {numbers.index[point]}: all lobes are measured at the same points"
        )
        raise InputError([f"{name}: {shown_text}; {requirement}"])
    return [
        (tuple(stations.tolist()), tuple(deviations_of_lobe.tolist()))
        for stations, deviations_of_lobe in zip(places, deviations, strict=True)
    ]

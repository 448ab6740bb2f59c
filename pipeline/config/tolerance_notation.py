"""Tolerances of a study as a drawing writes them, in place of `lower_um` and `upper_um`.

Limit deviations of a size by its ISO code, as 14H6 or 4h5: the standard's rounded tables.

Source: ISO 286-1:2010, Tables 1 (standard tolerances), 4 and 5 (fundamental deviations of shafts); holes by its general
and special rules.
"""

import re
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from math import isclose, sqrt
from typing import Any

from pipeline.config.designs.design import Design
from pipeline.config.dimensions import Dimension, dimension_library
from pipeline.config.files.section import MISSING, Mistake
from pipeline.model.units import UM_PER_MM

UP_TO_MM = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
"""Ranges of nominal sizes, upper ends included."""
TOLERANCES_UM = {
    3: (2, 2.5, 2.5, 3, 4, 4, 5, 6, 8, 10, 12, 13, 15),
    4: (3, 4, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20),
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
}
"""Width of the zone by grade and range of sizes [um]."""
GRADE_2_UM = (1.2, 1.5, 1.5, 2, 2.5, 2.5, 3, 4, 5, 7, 8, 9, 10)
"""The same of grade 2, which is no grade of a study: holes of grade 3 are moved by what it is narrower."""
DEVIATIONS_UM = {
    "e": (-14, -20, -25, -32, -40, -50, -60, -72, -85, -100, -110, -125, -135),
    "f": (-6, -10, -13, -16, -20, -25, -30, -36, -43, -50, -56, -62, -68),
    "g": (-2, -4, -5, -6, -7, -9, -10, -12, -14, -15, -17, -18, -20),
    "h": (0,) * 13,
    "k": (0, 1, 1, 1, 2, 2, 2, 3, 3, 4, 4, 4, 5),
    "m": (2, 4, 6, 7, 8, 9, 11, 13, 15, 17, 20, 21, 23),
    "n": (4, 8, 10, 12, 15, 17, 20, 23, 27, 31, 34, 37, 40),
    "p": (6, 12, 15, 18, 22, 26, 32, 37, 43, 50, 56, 62, 68),
}
"""Of a shaft's limit next to the nominal size [um]: the upper one of e to h, the lower one of k to p."""
LETTERS = (*"efgh", "js", *"kmnp")
"""Of shafts; holes have them in capitals."""
MIDDLE_GRADES = (4, 7)
"""Grades within which k differs from 0."""
LARGEST_DELTA_GRADE = {"k": 8, "m": 8, "n": 8, "p": 7}
"""Up to these grades a hole is moved by the difference of two grades, so that it fits as the shaft does."""


def grade_width_um(grade: int, size_mm: float) -> float:
    """Width [um] of the tolerance zone of a grade at a nominal size, above 0 and up to 500 mm."""
    return float(TOLERANCES_UM[grade][bisect_left(UP_TO_MM, size_mm)])


def limit_deviations(letter: str, grade: int, size_mm: float) -> tuple[float, float]:
    """Lower and upper limit deviation [um] of a diameter.

    Parameters
    ----------
    letter : of `LETTERS`, in capitals for a hole.
    grade : of `TOLERANCES_UM`.
    size_mm : nominal size, above 0 and up to 500.

    Raises
    ------
    ValueError : the code or the size is not in the tables; with what is.
    """
    if letter.lower() not in LETTERS or not (letter.islower() or letter.isupper()):
        raise ValueError(f"letters are {', '.join(LETTERS)} of shafts, in capitals of holes")
    if grade not in TOLERANCES_UM:
        raise ValueError(f"grades are {min(TOLERANCES_UM)} to {max(TOLERANCES_UM)}")
    if not 0 < size_mm <= UP_TO_MM[-1]:
        raise ValueError(f"sizes are above 0 and up to {UP_TO_MM[-1]} mm")
    size_range = bisect_left(UP_TO_MM, size_mm)
    width = grade_width_um(grade, size_mm)
    if letter.lower() == "js":
        return -width / 2, width / 2
    if letter.islower():
        fundamental_deviation = _shaft(letter, grade, size_range)
        if letter <= "h":
            return fundamental_deviation - width, fundamental_deviation
        return fundamental_deviation, fundamental_deviation + width
    if letter <= "H":
        fundamental_deviation = -float(DEVIATIONS_UM[letter.lower()][size_range])
        return fundamental_deviation, fundamental_deviation + width
    upper = _hole(letter, grade, size_range)
    return upper - width, upper


def _shaft(letter: str, grade: int, size_step: int) -> float:
    if letter == "k" and not MIDDLE_GRADES[0] <= grade <= MIDDLE_GRADES[1]:
        return 0.0
    return float(DEVIATIONS_UM[letter][size_step])


def _hole(letter: str, grade: int, size_step: int) -> float:
    """Upper limit deviation [um] of the holes K, M, N, P: the shaft's mirrored, moved by the difference of two grades.

    Exceptions of the standard: M6 of 250 to 315 mm, N from grade 9 on, and sizes up to 3 mm, which are not moved.
    """
    shaft = letter.lower()
    mirrored_deviation = -float(DEVIATIONS_UM[shaft][size_step])
    if letter == "N" and grade > LARGEST_DELTA_GRADE["n"]:
        return mirrored_deviation if size_step == 0 else 0.0
    if letter == "K" and grade > LARGEST_DELTA_GRADE["k"] and size_step > 0:
        raise ValueError("K of sizes above 3 mm has grades up to 8")
    if letter == "M" and grade == 6 and UP_TO_MM[size_step] == 315:
        return -9.0
    if size_step == 0 or grade > LARGEST_DELTA_GRADE[shaft]:
        return mirrored_deviation
    return mirrored_deviation + TOLERANCES_UM[grade][size_step] - TOLERANCES_UM.get(grade - 1, GRADE_2_UM)[size_step]


LIMITS, ISO, OF_SIZE, POSITION, CONVENTION = "limits_mm", "iso", "of", "position", "convention"
NOTATION = (LIMITS, ISO, OF_SIZE, POSITION, CONVENTION)
READING = "disk_reading"
"""Key of what a deviation of the disk's profile is."""
DRAWING, MATERIAL_OFF = "drawing", "material_off"
"""Signs that limits in mm may have: a larger part positive, or material taken off positive."""
LIMIT_NAMES = ("lower_um", "upper_um")
RADIUS = "radius_um"
IN_DISC = {"uniform": "uniform_in_disc", "normal": "normal_in_disc"}
"""Distributions in a circular zone by the names that the file gives beside one."""
PIN_POSITION = "pin_position"
"""Position of the housing's pins in a zone, which the file may give in place of both of these dimensions."""
PIN_COORDINATES = ("pin_radial", "pin_tangential")
COORDINATE_SHARE = {"normal": 1.0, "uniform": 0.5 * sqrt(3.0)}
"""Limits of either coordinate over the radius of the zone. A normal one has its limits at three standard deviations, as
the zone has; a uniform one has the standard deviation of a point that is uniform in the disc, half of the radius."""
SIZES = ("diameter", "radius")
NUMBER = r"([+-]?\d*\.?\d+)"
PAIR = re.compile(rf"\s*{NUMBER}\s*/\s*{NUMBER}\s*")
EQUAL = re.compile(r"\s*(?:±|\+-|\+/-)\s*(\d*\.?\d+)\s*")
ZONE = re.compile(r"\s*(?:dia|⌀|ø|Ø)\s*(\d*\.?\d+)\s*")
CODE = re.compile(r"\s*(\d*\.?\d+)?\s*([A-Za-z]{1,2})\s*(\d{1,2})\s*")


def with_notation(tolerances: object, design: Design | None) -> tuple[Any, list[Mistake]]:
    """The section ``tolerances`` with limits in um for those that a drawing writes, and what is wrong with them.

    One that is wrong, or whose design could not be read, is left out.
    """
    if not isinstance(tolerances, Mapping):
        return tolerances, []
    tolerance_sections: dict[str, Any] = {}
    problems: list[Mistake] = []
    for name, settings in tolerances.items():
        if name == PIN_POSITION:
            split = _split_zone(settings, [other for other in PIN_COORDINATES if other in tolerances])
            if isinstance(split, Mistake):
                problems.append(split)
            else:
                tolerance_sections |= split
            continue
        dimension = dimension_library().get(name)
        if not isinstance(settings, Mapping) or not set(NOTATION) & set(settings) or dimension is None:
            tolerance_sections[name] = settings
            continue
        if design is None:
            continue
        settings_of_tolerance = (
            _zone(dimension, settings) if POSITION in settings else _named_limits(dimension, settings, design)
        )
        if isinstance(settings_of_tolerance, Mistake):
            problems.append(settings_of_tolerance)
            continue
        remaining = {key: value for key, value in settings.items() if key not in NOTATION}
        tolerance_sections[name] = {**remaining, **settings_of_tolerance}
    return tolerance_sections, problems


def reading_mistakes(tolerances: object, clearance: object) -> list[Mistake]:
    """What is wrong where a profile has limits as on a drawing: they say nothing without the reading of the disk.

    Parameters
    ----------
    tolerances, clearance : sections of the study as they stand in its file.
    """
    if not isinstance(tolerances, Mapping) or (isinstance(clearance, Mapping) and READING in clearance):
        return []
    profiles = [name for name, dimension in dimension_library().items() if dimension.drawing_sign < 0]
    for name in profiles:
        settings = tolerances.get(name)
        if isinstance(settings, Mapping) and LIMITS in settings:
            requirement = (
                f'must stand beside {LIMITS} of {name}: "normal" if they are along the normal of the flank, as a '
                'profile tolerance of ISO 1101 (0.008 on the drawing is "±0.004"); "radial" or "radial_on_diameter" '
                "if they are a radius or a diameter that counts as the pin circle's, which opens the gaps by less"
            )
            return [Mistake(f"clearance.{READING}", MISSING, requirement)]
    return []


def _split_zone(settings: object, stated_beside: Sequence[str]) -> dict[str, Any] | Mistake:
    """Radial and tangential limits of the housing's pins in a circular zone, or what is wrong."""
    key = f"tolerances.{PIN_POSITION}"
    if not isinstance(settings, Mapping) or POSITION not in settings:
        return Mistake(f"{key}.{POSITION}", MISSING, 'must be as "dia 0.02": the diameter of the zone in mm, above 0')
    if stated_beside:
        return Mistake(key, settings[POSITION], f"stands beside {stated_beside[0]}; keep the one or the other")
    zone = _disc(key, settings)
    if isinstance(zone, Mistake):
        return zone
    limit = round(COORDINATE_SHARE[settings["distribution"]] * zone[RADIUS], 9)
    remaining = {name: value for name, value in settings.items() if name != POSITION}
    return {name: {**remaining, "lower_um": -limit, "upper_um": limit} for name in PIN_COORDINATES}


def _zone(dimension: Dimension, settings: Mapping[str, Any]) -> dict[str, Any] | Mistake:
    """Radius of a circular zone [um] and its distribution, or what is wrong."""
    key, text = f"tolerances.{dimension.name}", settings[POSITION]
    if not dimension.zone:
        zone_of_pins = f"[tolerances.{PIN_POSITION}] for both directions, or " * (dimension.name in PIN_COORDINATES)
        return Mistake(
            f"{key}.{POSITION}", text, f"{dimension.title} is no point in a zone; take {zone_of_pins}{LIMITS}"
        )
    return _disc(key, settings)


def _disc(key: str, settings: Mapping[str, Any]) -> dict[str, Any] | Mistake:
    """Radius [um] of the zone of a position and its distribution, or what is wrong."""
    text = settings[POSITION]
    for other_key in (LIMITS, ISO, OF_SIZE, CONVENTION, RADIUS, *LIMIT_NAMES):
        if other_key in settings:
            return Mistake(
                f"{key}.{other_key}", settings[other_key], f"stands beside {POSITION}; keep the one or the other"
            )
    if settings.get("distribution") not in IN_DISC:
        requirement = f"must be {' or '.join(IN_DISC)} with a {POSITION}: in the disc of the zone"
        return Mistake(f"{key}.distribution", settings.get("distribution", MISSING), requirement)
    match = ZONE.fullmatch(text) if isinstance(text, str) else None
    if match is None or float(match[1]) == 0:
        return Mistake(f"{key}.{POSITION}", text, 'must be as "dia 0.02": the diameter of the zone in mm, above 0')
    radius = round(UM_PER_MM * 0.5 * float(match[1]), 9)
    return {"distribution": IN_DISC[settings["distribution"]], RADIUS: radius}


def _named_limits(dimension: Dimension, settings: Mapping[str, Any], design: Design) -> dict[str, float] | Mistake:
    """Limits [um] by their names, or what is wrong."""
    limits = _limits(dimension, settings, design)
    return limits if isinstance(limits, Mistake) else dict(zip(LIMIT_NAMES, limits, strict=True))


def _limits(dimension: Dimension, settings: Mapping[str, Any], design: Design) -> tuple[float, float] | Mistake:
    """Lower and upper limit deviation [um] of the dimension as the model has it, or what is wrong."""
    key = f"tolerances.{dimension.name}"
    stated_keys = [name for name in (LIMITS, ISO, *LIMIT_NAMES) if name in settings]
    if not stated_keys or stated_keys[0] in LIMIT_NAMES:
        extra_key = OF_SIZE if OF_SIZE in settings else CONVENTION
        return Mistake(f"{key}.{extra_key}", settings[extra_key], f"belongs to {LIMITS}; delete it")
    if len(stated_keys) > 1:
        return Mistake(
            f"{key}.{stated_keys[1]}",
            settings[stated_keys[1]],
            f"stands beside {stated_keys[0]}; keep the one or the other",
        )
    if stated_keys[0] == ISO:
        return _by_code(dimension, settings, design)
    pair = _pair(settings[LIMITS])
    if pair is None:
        requirement = 'must be as "+0.000/-0.004" or "±0.002", in mm'
        return Mistake(f"{key}.{LIMITS}", settings[LIMITS], requirement)
    reading = settings.get(OF_SIZE)
    if dimension.measure and reading not in SIZES:
        requirement = 'must be "diameter" or "radius": a drawing may give either'
        return Mistake(f"{key}.{OF_SIZE}", reading, requirement)
    if not dimension.measure and reading is not None:
        return Mistake(f"{key}.{OF_SIZE}", reading, f"{dimension.title} is neither a diameter nor a radius; delete it")
    factor = UM_PER_MM * _share(dimension, str(reading or ""))
    sign = _sign(dimension, settings, pair)
    if isinstance(sign, Mistake):
        return sign
    lower, upper = sorted(round(sign * factor * value, 9) + 0.0 for value in pair)
    return lower, upper


def _sign(dimension: Dimension, settings: Mapping[str, Any], pair: tuple[float, float]) -> int | Mistake:
    """-1 where limits as on a drawing have the other sign than the dimension has here, or what is wrong."""
    key, convention = f"tolerances.{dimension.name}.{CONVENTION}", settings.get(CONVENTION)
    if dimension.drawing_sign > 0:
        requirement = f'must be "{DRAWING}", the only sign that {dimension.title} has; or delete it'
        return 1 if convention in (None, DRAWING) else Mistake(key, convention, requirement)
    if convention in (DRAWING, MATERIAL_OFF):
        return -1 if convention == DRAWING else 1
    low, high = (UM_PER_MM * value for value in pair)
    requirement = (
        f'must be "{DRAWING}" (a larger part is positive: {-high:g} to {-low:g} um of material off, '
        f'{_gap_words(-high, -low)}) or "{MATERIAL_OFF}" (material off is positive: {low:g} to {high:g} um, '
        f"{_gap_words(low, high)})"
    )
    return Mistake(key, MISSING if convention is None else convention, requirement)


def _gap_words(low: float, high: float) -> str:
    """What so much material off [um] does to the gaps."""
    return "opens the gaps" if low >= 0 else "closes the gaps" if high <= 0 else "opens or closes the gaps"


def _pair(text: object) -> tuple[float, float] | None:
    """Lower and upper of two limits in either order, or of equal ones; None where the text is no such."""
    if not isinstance(text, str):
        return None
    if match := EQUAL.fullmatch(text):
        return -float(match[1]), float(match[1])
    if match := PAIR.fullmatch(text):
        lower, upper = sorted((float(match[1]), float(match[2])))
        return lower, upper
    return None


def _share(dimension: Dimension, quantity: str) -> float:
    """What a deviation of 1 of a diameter or radius is of the dimension."""
    if not dimension.measure or quantity == dimension.measure:
        return 1.0
    return 0.5 if quantity == "diameter" else 2.0


def _by_code(dimension: Dimension, settings: Mapping[str, Any], design: Design) -> tuple[float, float] | Mistake:
    key, code = f"tolerances.{dimension.name}.{ISO}", settings[ISO]
    if not dimension.measure or dimension.size_um is None:
        return Mistake(key, code, f"{dimension.title} has no nominal size; take {LIMITS}, or lower_um and upper_um")
    if settings.get(OF_SIZE, "diameter") != "diameter":
        return Mistake(
            f"tolerances.{dimension.name}.{OF_SIZE}",
            settings[OF_SIZE],
            'must be "diameter": an ISO code is of a diameter',
        )
    match = CODE.fullmatch(code) if isinstance(code, str) else None
    if match is None:
        return Mistake(key, code, 'must be as "4h5" or "h5": size in mm, letter and grade of ISO 286')
    nominal = dimension.size_um(design) / UM_PER_MM / _share(dimension, "diameter")
    if match[1] and not isclose(float(match[1]), nominal, rel_tol=1e-6):
        return Mistake(
            key, code, f"its size must be the design's diameter, {nominal:g} mm; correct the one or the other"
        )
    try:
        lower, upper = limit_deviations(match[2], int(match[3]), nominal)
    except ValueError as error:
        return Mistake(key, code, str(error))
    share = _share(dimension, "diameter")
    return share * lower, share * upper

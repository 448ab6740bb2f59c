"""Limit deviations of a size by its ISO code, as 14H6 or 4h5: the standard's rounded tables.

Source: ISO 286-1:2010, Tables 1 (standard tolerances), 4 and 5 (fundamental deviations of shafts); holes by its general
and special rules.
"""

from bisect import bisect_left

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
        return (
            (fundamental_deviation - width, fundamental_deviation)
            if letter <= "h"
            else (fundamental_deviation, fundamental_deviation + width)
        )
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
    if size_step == 0 or grade > LARGEST_DELTA_GRADE[shaft] or grade - 1 not in TOLERANCES_UM:
        return mirrored_deviation
    return mirrored_deviation + TOLERANCES_UM[grade][size_step] - TOLERANCES_UM[grade - 1][size_step]

"""Angles of a record: both encoders counted on over their turns, and the error of the output."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.identification.measurement.rows import Recorded
from pipeline.identification.measurement.turning.motion import TURN_DEG, unwrapped_crank

ARCMIN_A_DEGREE = 60.0
"""Minutes of arc in a degree."""
LEAST_AGREEMENT = 0.5
"""Mean of the unit vectors of an angle from which its rows agree on one direction; 0 of rows that are spread evenly."""


def angles_of(record: Recorded, ratio: float, run: Whole, is_absolute: bool) -> tuple[Real, Real]:
    """Angle of the output by the ideal ratio (n,) [deg], and its error (n,) [arcmin].

    Parameters
    ----------
    ratio : turns of the input per turn of the output; its sign is not asked for: the record shows it.
    run : (n,) number of the file and cycle of each row.
    is_absolute : whether the column of the error holds the angle of the output instead.

    Notes
    -----
    An encoder of one turn jumps by 360 degrees. Within a run it is counted on row by row; between runs the turns of one
    encoder are those that bring it next to the other.
    """
    columns = set(record.table)
    error, output = record.quantity("angle_arcmin"), record.quantity("output_deg")
    turned = record.quantity("input_deg" if "input_deg" in columns else "crank_deg")
    if "angle_arcmin" in columns and not is_absolute and not {"input_deg", "output_deg"} <= columns:
        turned = unwrapped_crank(turned, run) / ratio
        return (turned if np.any(np.isfinite(turned)) else unwrapped_crank(output, run)), error
    output = output if "output_deg" in columns else error / ARCMIN_A_DEGREE
    place, output = _together(turned, output, ratio, run)
    error = ARCMIN_A_DEGREE * (output - place)
    is_known = np.isfinite(error)
    return place, error - (np.median(error[is_known]) if is_known.any() else 0.0)


def _together(turned: Real, output: Real, ratio: float, run: Whole) -> tuple[Real, Real]:
    """Angle of the output (n,) [deg] by the input and by its own encoder, of both counted on."""
    counted_turned, counted_output = unwrapped_crank(turned, run), unwrapped_crank(output, run)
    place = _sense(counted_turned, counted_output, run) * counted_turned / ratio
    if _is_of_one_turn(turned, counted_turned):
        place = place + _whole_turns(counted_output - place, TURN_DEG / ratio)
    elif _is_of_one_turn(output, counted_output):
        counted_output = counted_output - _whole_turns(counted_output - place, TURN_DEG)
    return place, counted_output


def _sense(turned: Real, output: Real, run: Whole) -> float:
    """1.0 where the output turns as the input does, -1.0 where it turns against it."""
    is_known = np.isfinite(turned) & np.isfinite(output)
    turned, output = (np.where(np.diff(run[is_known]), 0.0, np.diff(angle[is_known])) for angle in (turned, output))
    return -1.0 if turned @ output < 0 else 1.0


def _is_of_one_turn(angle: Real, counted_angle: Real) -> bool:
    """Whether an encoder's angle (n,) [deg] stays within a turn although it was counted on beyond one."""
    is_known = np.isfinite(angle)
    return bool(is_known.any() and np.ptp(angle[is_known]) <= TURN_DEG < np.ptp(counted_angle[is_known]))


def _whole_turns(difference: Real, turn: float) -> Real:
    """Whole turns (n,) [deg] by which differences (n,) [deg] lie off the one that they agree on; zeros of none."""
    is_known = np.isfinite(difference)
    mean = np.mean(np.exp(2j * np.pi * difference[is_known] / turn)) if is_known.any() else 0.0
    if abs(mean) < LEAST_AGREEMENT:
        return np.zeros(len(difference))
    middle = turn * float(np.angle(mean)) / (2 * np.pi)
    return turn * np.round((difference - middle) / turn)

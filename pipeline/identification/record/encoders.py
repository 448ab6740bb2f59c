"""Angles of a record: both encoders counted on over their turns, and the error of the output."""

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.measurement.rows import Recorded
from pipeline.identification.measurement.turning.motion import unwrapped_crank
from pipeline.model.units import ARCMIN_A_DEGREE, TURN_DEG

ROUNDED_DEG: Rounding = 0.1
"""Angle by which an encoder of one turn may show more than 360 degrees by its rounding."""
LARGEST_JUMP = 100.0
"""Step of an angle, in its median step, beyond which rows do not follow each other."""
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
        is_of_input = bool(np.any(np.isfinite(turned)))
        return (_counted_on(turned, run) / ratio if is_of_input else _counted_on(output, run)), error
    output = output if "output_deg" in columns else error / ARCMIN_A_DEGREE
    place, output = _together(turned, output, ratio, run)
    error = ARCMIN_A_DEGREE * (output - place)
    is_known = np.isfinite(error)
    return place, error - (np.median(error[is_known]) if is_known.any() else 0.0)


def travel(angle: Real, run: Whole) -> float:
    """Angle [deg] that an encoder turns through within the runs (n,), counted on over its turns."""
    counted_angle = _counted_on(angle, run)
    is_known = np.isfinite(counted_angle)
    steps = np.where(np.diff(run[is_known]), 0.0, np.diff(counted_angle[is_known]))
    return float(np.sum(np.abs(steps)))


def runs_without_jumps(angle: Real, run: Whole) -> Whole:
    """Numbers of runs (n,) that end where an angle jumps, as where the next pass begins at the first angle again."""
    counted_angle = _counted_on(angle, run)
    rows = np.flatnonzero(np.isfinite(counted_angle))
    step = np.abs(np.diff(counted_angle[rows]))
    if not np.any(step > 0):
        return run
    jumps = np.zeros(len(run), np.int64)
    jumps[rows[1:]] = step > max(TURN_DEG, LARGEST_JUMP * float(np.median(step[step > 0])))
    return np.unique(np.column_stack([run, np.cumsum(jumps)]), axis=0, return_inverse=True)[1].ravel()


def _counted_on(angle: Real, run: Whole) -> Real:
    """An angle (n,) [deg], counted on within each run (n,) if it stays within a turn."""
    is_known = np.isfinite(angle)
    is_of_one_turn = is_known.any() and np.ptp(angle[is_known]) <= TURN_DEG + ROUNDED_DEG
    return unwrapped_crank(angle, run) if is_of_one_turn else angle


def _together(turned: Real, output: Real, ratio: float, run: Whole) -> tuple[Real, Real]:
    """Angle of the output (n,) [deg] by the input and by its own encoder, of both counted on."""
    counted_turned, counted_output = _counted_on(turned, run), _counted_on(output, run)
    place = _sense(counted_turned, counted_output, run) * counted_turned / ratio
    if counted_turned is not turned:
        place = place + _whole_turns(counted_output - place, TURN_DEG / ratio)
    elif counted_output is not output:
        counted_output = counted_output - _whole_turns(counted_output - place, TURN_DEG)
    return place, counted_output


def _sense(turned: Real, output: Real, run: Whole) -> float:
    """1.0 where the output turns as the input does, -1.0 where it turns against it."""
    is_known = np.isfinite(turned) & np.isfinite(output)
    turned, output = (np.where(np.diff(run[is_known]), 0.0, np.diff(angle[is_known])) for angle in (turned, output))
    return -1.0 if turned @ output < 0 else 1.0


def _whole_turns(difference: Real, turn: float) -> Real:
    """Whole turns (n,) [deg] by which differences (n,) [deg] lie off the one that they agree on; zeros of none."""
    is_known = np.isfinite(difference)
    mean = np.mean(np.exp(2j * np.pi * difference[is_known] / turn)) if is_known.any() else 0.0
    if abs(mean) < LEAST_AGREEMENT:
        return np.zeros(len(difference))
    middle = turn * float(np.angle(mean)) / (2 * np.pi)
    return turn * np.round((difference - middle) / turn)

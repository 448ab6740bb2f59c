"""Faults in the shape of the loops: exchanged columns, wrong signs, numbers that no drive of this torque has."""

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.config.designs.design import Design
from pipeline.constant_kinds import Fineness, Shown, ShownRange, Unit
from pipeline.identification.measurement.columns import ANGLE_UNITS, TORQUE_UNITS
from pipeline.identification.measurement.enough import BENT, FEWEST_COMPARED, LOADED_SHARE, SURE, UNLOADED_SHARE
from pipeline.identification.measurement.repeated_branches import Loop, loop_distance
from pipeline.model.units import ARCMIN, ARCMIN_A_DEGREE, TURN_DEG

POSSIBLE_TORQUE = (5e-3, 20.0)
"""Times the rated torque: a smaller cycle says nothing about the reducer (torques in kN m lie there), and no reducer
stands a larger one."""
LIKELY_TORQUE: ShownRange = (0.05, 5.0)
"""Times the rated torque, of a bench: by which other units are suggested; smaller loops may be those of the input."""
REVOLUTION = TURN_DEG * ARCMIN_A_DEGREE
"""In minutes of arc; an output that turns further is not held."""
FINEST_ANGLE = 1e-2
"""Span [arcmin] below which no encoder resolves a loop."""
LIKELY_ANGLE: ShownRange = (0.2, 1200.0)
"""Span of a loop [arcmin], by which other units are suggested."""


def implausible_torque(torque: Real, rated_torque: float) -> str:
    """Why torques [N m] cannot be in N m, with the units that they could be in; empty if they can."""
    top = float(np.max(np.abs(torque)))
    if POSSIBLE_TORQUE[0] * rated_torque <= top <= POSSIBLE_TORQUE[1] * rated_torque:
        return ""
    advice = _advice(top, TORQUE_UNITS, (LIKELY_TORQUE[0] * rated_torque, LIKELY_TORQUE[1] * rated_torque), "torque_Nm")
    return f"the largest torque is {top:.4g} N m, the rated torque {rated_torque:g} N m; {advice}"


def implausible_angle(span: float, resolution: float | None, limit: float, unit: str) -> str:
    """Why a loop of height `span` [arcmin] cannot be in arcmin, with the units that it could be in; empty if it can.

    Parameters
    ----------
    resolution : of the instrument [arcmin], None if unknown.
    limit : span [arcmin] that no reducer of the design can have.
    unit : in which the angle is said to be.
    """
    smallest_span = max(FINEST_ANGLE, resolution or 0.0)
    if smallest_span <= span <= min(REVOLUTION, limit):
        return ""
    reason = (
        f"{smallest_span:g} arcmin can be resolved"
        if span < smallest_span
        else f"a drive of this design has {limit:.3g} at most"
    )
    likely = LIKELY_ANGLE[0], min(LIKELY_ANGLE[1], limit)
    advice = _advice(span / ANGLE_UNITS[unit], ANGLE_UNITS, likely, "angle_arcmin")
    return f"the angle spans {span:.4g} arcmin, {reason}; {advice}"


def doubtful_side(top: float, span: float, rated_torque: float, ratio: float) -> str:
    """Why a loop up to ``top`` [N m] and ``span`` [arcmin] may be of the input or in another unit; empty if likely.

    Parameters
    ----------
    rated_torque : torque of the output [N m].
    ratio : input turns per turn of the output.
    """
    if top >= LIKELY_TORQUE[0] * rated_torque and span <= LIKELY_ANGLE[1]:
        return ""
    found_text = f"the loops reach {top:.3g} N m of a rated torque of {rated_torque:g} N m and span {span:.4g} arcmin"
    at_output = LIKELY_TORQUE[0] * rated_torque <= top * ratio <= LIKELY_TORQUE[1] * rated_torque
    if at_output and LIKELY_ANGLE[0] <= span / ratio <= LIKELY_ANGLE[1]:
        return f'{found_text}: if torque and angle are of the input, say side = "input" (ratio {ratio:g})'
    return f"{found_text}, which is unusual: check unit and factor in [columns]"


def _advice(value: float, units: dict[str, float], likely: tuple[float, float], quantity: str) -> str:
    """The units in which `value` would be likely; a unit may already be in use, so that the factor is said too."""
    fitting = [
        f'"{name}" (factor {scale:.6g})' for name, scale in units.items() if likely[0] <= scale * value <= likely[1]
    ]
    if not fitting:
        return f"no unit explains it: is [columns.{quantity}] the right column?"
    return f"[columns.{quantity}] unit = {' or '.join(fitting)} would be likely"


CLOSED_SHARE = 0.02
"""Torque, in parts of its range, up to which a drive counts as unloaded. Half of it, of the range of the angle, is the
work on the way that closes a loop there."""
DELAYED_SHARE = 0.3
"""Share of the torque that a sensor may read with a delay: the range of the library's ``torque_creep``."""
DELAYS: Fineness = 24
"""Time constants from a row to all of a record with which the work of such a sensor is computed."""
OF_MEDIAN_BEND: Unit = 1 / (0.67449 * 6**0.5)
"""Standard deviation of noise over the median size of its second differences from row to row."""
FEWEST_ROWS = 20
"""Rows of a sense below which its shape is not judged."""
DISTANCE_RATIO = 3.0
"""Distance of a position from its nearest neighbour in shape, in the largest distance between the others and in noise
floors, from which it stands out."""
LARGEST_PLAY = 0.5
"""Gap of the pins in parts of their radius that no drive has."""
LARGEST_TWIST = 500.0
"""Twist over T / (E t r^2) of the disk that no drive has: the paper's reducer has about 10, the printed drives 100."""
LEAST_TWIST: Shown = 1.0
"""The same that a drive has at the least: contacts, bearing and output add to the twist of a solid disk of its size."""
LIKELY_TWIST: Shown = 200.0
"""The same that a drive is likely to have at most: twice the printed drives'."""


def largest_span(design: Design, torque: float, twisted: float = LARGEST_TWIST) -> float:
    """Span of the angle [arcmin] that no reducer of a design can have at a torque [N m]: play and twist.

    Parameters
    ----------
    twisted : largest twist over that of the disk, T / (E t r^2).

    Notes
    -----
    The play of a gap g between pins and disk is 2 g / (e z), with e z (eccentricity times lobes) the pitch circle's
    radius, whose lever arm no contact exceeds. The twist is scaled by that of a solid disk of the design.
    """
    gear = design.cycloid
    play = 2 * LARGEST_PLAY * gear.pin_radius_mm / (gear.eccentricity_mm * gear.lobes)
    return float(ARCMIN * play + twisted * _disk_twist(design, torque))


def least_span(design: Design, torque: float) -> float:
    """Span of the angle [arcmin] that a reducer of a design is likely to have at the least at a torque [N m]."""
    return LEAST_TWIST * _disk_twist(design, torque) / design.disk.count


def _disk_twist(design: Design, torque: float) -> float:
    """Span [arcmin] of the twist of a solid disk of the design at a torque [N m] of either sense."""
    arm = design.cycloid.eccentricity_mm * design.cycloid.lobes
    modulus, thickness = design.materials[design.disk.material].youngs_modulus_MPa, design.disk.thickness_mm
    return float(2 * ARCMIN * 1e3 * torque / (modulus * thickness * arm**2))


def columns_exchanged(torque: Real, angle: Real) -> bool:
    """Whether a loop is bent as one of torque over angle is: flat near zero and steep under load."""
    return _bend(torque, angle) < 1 / BENT and _bend(angle, torque) > BENT


def gains_energy(torque: Real, angle: Real, cycle: Whole, time: Real | None = None) -> bool:
    """Whether closed loops of rows in time order give back more work than they take.

    Parameters
    ----------
    torque, angle, cycle : (n,) of the rows of a position; ``cycle`` numbers its cycles.
    time : (n,) [s] of rows whose sensor may read a part of the torque with a delay; None if it may not.

    Notes
    -----
    The work taken is the integral of the torque over the angle, which of a passive drive is not negative over a closed
    cycle. With the columns exchanged, or the rows reversed in time, it has the other sign. Rows before the first and
    after the last visit of no torque, at a row or between two, belong to no closed loop: a record may end under load.
    There the way that closes it does no work, whatever the angle drifts by. A drift does work under load. Whether it
    goes on through the cycles, or in the pauses between them alone, the record does not say: either is taken off, and
    work has to be given back both times. Noise of the angle does work, too, in proportion to the steps of the
    torque, and so does a sensor that reads a part of the torque with a delay. A record without a cycle of half of the
    torque's range is not judged.
    """
    noise = OF_MEDIAN_BEND * float(np.median(np.abs(np.diff(angle, 2)))) if len(angle) > 2 else 0.0
    begins = np.flatnonzero(np.diff(cycle)) + 1
    of_pauses = np.zeros(len(angle))
    of_pauses[begins] = angle[begins] - angle[begins - 1]
    going_on = np.arange(len(angle)) * drift_per_row(torque, angle)
    of_noise = noise * float(np.sqrt(np.sum(np.diff(torque) ** 2) + 2 * np.sum(torque[begins] ** 2)))
    limit = SURE * of_noise + (0.0 if time is None else _work_of_delay(torque, angle, time))
    return all(_gives_back(torque, angle - drift, limit) for drift in (going_on, np.cumsum(of_pauses)))


def _work_of_delay(torque: Real, angle: Real, time: Real) -> float:
    """Largest work, over all delays, of the part of the torque that a sensor reads with a delay at rows (n,).

    The sensor adds c times the delayed torque, c being ``DELAYED_SHARE``. By the torque that it reads this part is
    c / (1 + c) of it, with a shorter delay. Where a time is unknown, none passes.
    """
    steps = np.nan_to_num(np.maximum(np.diff(time, prepend=time[0]), 0.0))
    shortest = max(float(np.median(steps)), np.finfo(float).tiny)
    rates = 1 / np.geomspace(shortest, max(float(np.sum(steps)), shortest), DELAYS)
    late = np.zeros((len(torque), DELAYS))
    for row in range(1, len(torque)):
        late[row] = late[row - 1] + (torque[row] - late[row - 1]) * -np.expm1(-steps[row] * rates)
    works = _loop_work(late.T, angle)
    return DELAYED_SHARE / (1 + DELAYED_SHARE) * float(np.max(np.abs(works)))


def _loop_work(torque: Real, angle: Real) -> Real:
    """Work (...) of torques (..., n) along the angle (n,) of a loop that goes back from its last row to its first."""
    work: Real = 0.5 * np.sum((torque + np.roll(torque, -1, axis=-1)) * (np.roll(angle, -1) - angle), axis=-1)
    return work


def _gives_back(torque: Real, angle: Real, limit: float) -> bool:
    """Whether the closed part of rows without drift gives back more work than a limit, and than what closes it."""
    torque, angle = _with_crossings(torque, angle)
    unloaded_points = np.flatnonzero(torque == 0)
    if len(unloaded_points) < 2:
        unloaded_points = np.flatnonzero(np.abs(torque) <= CLOSED_SHARE * np.ptp(torque))
    closed_part = slice(unloaded_points[0], unloaded_points[-1] + 1) if len(unloaded_points) else slice(None)
    whole_range = float(np.ptp(torque))
    torque, angle = torque[closed_part], angle[closed_part]
    if np.ptp(torque) < 0.5 * whole_range:
        return False
    return float(_loop_work(torque, angle)) < -max(0.5 * CLOSED_SHARE * float(np.ptp(torque) * np.ptp(angle)), limit)


def drift_per_row(torque: Real, angle: Real) -> Real:
    """Drift of the angle from row to row (n,), which may differ between the senses of the torque: warmth closes a play.

    By least squares over the loaded rows of each sense, beside a line over the torque before its turns and another one
    after them. None in a sense that is visited once, where hysteresis looks alike.
    """
    rates = {}
    for sense in (1, -1):
        load = sense * torque
        loaded = np.flatnonzero(load >= LOADED_SHARE * load.max())
        visits = np.split(loaded, np.flatnonzero(np.diff(loaded) > 1) + 1)
        visits = [rows for rows in visits if rows.size and load[rows].max() > 0.5 * (1 + LOADED_SHARE) * load.max() > 0]
        if len(visits) > 1:
            used = np.concatenate(visits)
            is_after = np.concatenate([rows > rows[np.argmax(load[rows])] for rows in visits])
            columns = np.column_stack([np.ones(len(used)), used, load[used], is_after, is_after * load[used]])
            rates[sense] = float(np.linalg.lstsq(columns, angle[used], rcond=None)[0][1])
    if not rates:
        return np.zeros(len(torque))
    above, below = (rates.get(sense, rates.get(-sense, 0.0)) for sense in (1, -1))
    return np.where(torque > 0, above, below)


def _with_crossings(torque: Real, angle: Real) -> tuple[Real, Real]:
    """Torque and angle with the points on the straight lines between rows at which the torque is zero."""
    before = np.flatnonzero(torque[:-1] * torque[1:] < 0)
    share = torque[before] / (torque[before] - torque[before + 1])
    crossed = angle[before] + share * (angle[before + 1] - angle[before])
    return np.insert(torque, before + 1, 0.0), np.insert(angle, before + 1, crossed)


def _bend(load: Real, twist: Real) -> float:
    """Slope of the twist over the load near zero over that under load in both senses; 1 where there are few rows."""
    load = load - 0.5 * (load.max() + load.min())  # an angle has any zero
    top = float(np.max(load))
    parts = [np.abs(load) <= UNLOADED_SHARE * top, load >= LOADED_SHARE * top, load <= -LOADED_SHARE * top]
    if top == 0.0 or min(part.sum() for part in parts) < FEWEST_ROWS:
        return 1.0
    slope_near_zero, *loaded_slopes = (_slope(load[part], twist[part]) for part in parts)
    return float(slope_near_zero / np.mean(loaded_slopes)) if np.mean(loaded_slopes) > 0 else np.inf


def _slope(load: Real, twist: Real) -> float:
    """Least-squares slope; 0 where the load does not vary."""
    from_mean = load - load.mean()
    scatter = float(from_mean @ from_mean)
    return float(from_mean @ twist) / scatter if scatter > 0 else 0.0


def standing_out(loops: list[Loop], floor: float) -> Iterator[tuple[int, float, float]]:
    """Position whose mean loop is far from all others, which are alike; its distance and theirs [arcmin]."""
    n = len(loops)
    if n < FEWEST_COMPARED:
        return
    distances = np.array([[loop_distance(loop, second) for second in loops] for loop in loops])
    for position in range(n):
        remaining = np.delete(np.arange(n), position)
        distance_among_others = float(np.max(distances[np.ix_(remaining, remaining)]))
        nearest_distance = float(np.min(distances[position, remaining]))
        if np.isfinite(nearest_distance + distance_among_others) and nearest_distance > DISTANCE_RATIO * max(
            distance_among_others, np.nan_to_num(floor)
        ):
            yield position, nearest_distance, distance_among_others

"""Crank angles at which the model of a unit stands: one a position, or those that a crank goes through in its loops."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real
from pipeline.constant_kinds import Fineness
from pipeline.errors import InputError
from pipeline.identification.fitting.measured_loops import crank_loops
from pipeline.identification.measurement.measurement import Measurement

STATIONS_A_PITCH: Fineness = 3
"""Stations while the crank turns from one pin to the next, after which an ideal drive repeats."""
FEWEST_STATIONS: Fineness = 3
"""Stations of a position at least, before the distance between them is halved."""
MARGIN = 0.2
"""Share of the turn of the crank that stations reach beyond what was measured, on either side."""
FOLLOWS = 0.05
"""Share of the turn of the crank by which a column of it may differ from what the angle that is read says."""


@dataclass(frozen=True)
class Stations:
    """Where drives are made.

    Attributes
    ----------
    cranks : (n_stations,) [deg].
    of_position : their numbers, by position.
    measured_crank : (n_cells,) crank angle at each cell [rad], or of its position where the crank is held.
    """

    cranks: Real
    of_position: tuple[range, ...]
    measured_crank: Real


def stations_of(measurement: Measurement, halvings: int = 0) -> Stations:
    """The stations of a measurement, the distance between them halved as often as ``halvings`` says.

    Raises
    ------
    InputError : a column of the crank angle does not follow the angle that is read.
    """
    positions = measurement.cells.position
    if measurement.unit.settings.crank.moves == "fixed":
        cranks = measurement.drive_cranks
        single = tuple(range(number, number + 1) for number in range(len(cranks)))
        return Stations(cranks, single, np.radians(cranks)[positions])
    crank = measured_cranks(measurement)
    step = 360.0 / measurement.unit.study.design.cycloid.pins / STATIONS_A_PITCH
    parts: list[Real] = []
    ranges = []
    for number in range(len(measurement.drive_cranks)):
        crank_deg = np.degrees(crank[positions == number])
        reach = MARGIN * np.ptp(crank_deg)
        first_deg, last_deg = np.min(crank_deg) - reach, np.max(crank_deg) + reach
        count = (max(FEWEST_STATIONS, int(np.ceil((last_deg - first_deg) / step)) + 1) - 1) * 2**halvings + 1
        start = sum(map(len, parts))
        parts.append(np.linspace(first_deg, last_deg, count))
        ranges.append(range(start, start + count))
    return Stations(np.concatenate(parts), tuple(ranges), crank)


def measured_cranks(measurement: Measurement) -> Real:
    """Crank angle at each cell (n_cells,) [rad] where the crank turns within the loops of a locked output.

    Raises
    ------
    InputError : a column of it does not follow the angle that is read.
    """
    loops = crank_loops(measurement)
    settings = measurement.unit.settings.crank
    if settings.moves == "follows_angle":
        start = np.radians(measurement.drive_cranks)[loops.position] if not measurement.known_cranks else loops.crank
        return np.asarray(start + loops.crank_per_output * (loops.angle - loops.start))
    output_turn = -loops.ratio * np.pi / 10800 * (loops.angle - loops.start)
    for number in np.unique(loops.position):
        of_position = loops.position == number
        deviation = np.ptp((loops.crank - output_turn)[of_position])
        if deviation > FOLLOWS * np.ptp(output_turn[of_position]):
            raise InputError(
                f'{measurement.unit.name}/unit.toml: crank.column = "{settings.column}"; with a design and a locked '
                f"output it must be the angle that is read times {-loops.ratio:g}; it differs by up to "
                f"{np.degrees(deviation):.3g} deg at position {number}"
            )
    return loops.crank

"""How well turns of the crank repeat."""

from collections.abc import Iterator

import numpy as np

from pipeline.arrays import Real, Whole
from pipeline.constant_kinds import Rounding
from pipeline.identification.measurement.cells import Cells
from pipeline.identification.measurement.enough import FEWEST_COMPARED
from pipeline.identification.measurement.estimate import UNKNOWN_NOISE, rms, robust
from pipeline.identification.measurement.repeatability import Noise
from pipeline.identification.measurement.repeated_branches import Difference, centred_differences
from pipeline.model.units import TURN_DEG

SAME_DEG: Rounding = 1e-6
"""Angles [deg] that differ by less are the same."""


def turning_noise(
    cells: Cells, kind: Whole, crank: Real, revolution: Whole, torque_noise: float, resolution: float
) -> Noise:
    """Noise of the cells of turning records.

    Parameters
    ----------
    kind : (n_cells,) equal for equal held torque and sense.
    crank, revolution : (n_cells,) [deg] over a turn of the output, and the turn of the crank in it.
    torque_noise, resolution : declared noise of a row's torque [N m] and step of the angle [arcmin]; 0 if unknown.

    Notes
    -----
    Repeats are turns over the same crank angles of a turn of the output, one after the other, less their mean
    difference. Where there are none, successive turns of the crank take their place: they meet other lobes, whose
    errors then count as noise.
    """
    place = np.round(crank / SAME_DEG).astype(np.int64)
    repeats = [*_repeats(cells, kind, place, np.zeros(len(cells), np.int64))]
    if not repeats:
        folded_crank = np.round(np.mod(crank, TURN_DEG) / SAME_DEG).astype(np.int64)
        repeats = [*_repeats(cells, kind, folded_crank, revolution)]
    freedom = np.maximum(cells.count - 2, 0)
    row_variance = np.sum(freedom * cells.angle_spread**2) / np.sum(freedom) if freedom.any() else np.nan
    return Noise(
        repeats=rms(repeats, np.sqrt(2)),
        random=UNKNOWN_NOISE,
        is_shared=False,
        within_branch=robust([*_from_neighbours(cells, crank)]),
        between_positions=UNKNOWN_NOISE,
        row_scatter_arcmin=float(np.sqrt(row_variance)),
        torque_noise_Nm=torque_noise,
        resolution_arcmin=resolution / float(np.sqrt(12)),
    )


def _repeats(cells: Cells, kind: Whole, place: Whole, order: Whole) -> Iterator[Real]:
    """Differences of turns of one kind over the same places, each to the next, centred."""
    for number in np.unique(kind):
        blocks = np.unique(cells.block[kind == number])
        for position, block in enumerate(blocks):
            first_cells = np.flatnonzero(cells.block == block)
            for later in blocks[position + 1 :]:
                second = np.flatnonzero(cells.block == later)
                _, rows, repeated_rows = np.intersect1d(place[first_cells], place[second], return_indices=True)
                if len(rows) >= FEWEST_COMPARED and order[first_cells[0]] <= order[second[0]]:
                    angle = cells.angle_mean[second[repeated_rows]] - cells.angle_mean[first_cells[rows]]
                    yield from centred_differences([Difference(angle, np.ones(len(angle)))])
                    break


def _from_neighbours(cells: Cells, crank: Real) -> Iterator[Real]:
    """Per turn, each inner cell's angle less the line through its neighbours, for unit variance of a cell's noise."""
    for block in np.unique(cells.block):
        of_block = np.flatnonzero(cells.block == block)
        of_block = of_block[np.argsort(crank[of_block])]
        angle, place = cells.angle_mean[of_block], crank[of_block]
        if len(of_block) > 2:
            share = (place[1:-1] - place[:-2]) / (place[2:] - place[:-2])
            line = (1 - share) * angle[:-2] + share * angle[2:]
            yield (angle[1:-1] - line) / np.sqrt(1 + share**2 + (1 - share) ** 2)

"""The torques at which each position turned, over all its cycles."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.identification.measurement.branches import BranchBlocks, monotone
from pipeline.identification.measurement.rows import Rows


@dataclass(frozen=True)
class History:
    """Turning torques of each position in time order, over all its cycles, from the first row's torque to the last's.

    Attributes
    ----------
    torque : per position (n_turns + 2,) [N m]; rises and falls in turn.
    leg : (n_blocks,) each block lies between torque[leg] and torque[leg + 1] of its position.
    """

    torque: tuple[Real, ...]
    leg: Whole


def history(rows: Rows, blocks: BranchBlocks) -> History:
    """Turning torques over all cycles of each position: measured ones, smoothed near each end of a branch."""
    torques: list[Real] = []
    leg = np.zeros(len(blocks), np.int64)
    for position in range(len(rows.cranks)):
        turns: list[float] = []
        for block in np.flatnonzero(blocks.position == position).tolist():
            start, end = _end_torques(rows, blocks, block)
            if not turns:
                turns = [start]
            elif abs(turns[-1] - start) > blocks.threshold[position] or _beyond(turns, start):
                _go_on(turns, start)  # between two cycles the bench went elsewhere, or on to the turn
            _go_on(turns, end)
            leg[block] = len(turns) - 2
        torques.append(np.array(turns))
    return History(tuple(torques), leg)


def _beyond(turns: list[float], torque: float) -> bool:
    """Whether a torque lies further on in the sense of the last leg."""
    return len(turns) > 1 and (torque - turns[-1]) * (turns[-1] - turns[-2]) > 0


def _go_on(turns: list[float], torque: float) -> None:
    """Add a torque to the sequence; one further in the same direction takes the place of the last."""
    if _beyond(turns, torque) or (len(turns) > 1 and torque == turns[-1]):
        turns[-1] = torque
    else:
        turns.append(torque)


def _end_torques(rows: Rows, blocks: BranchBlocks, block: int) -> tuple[float, float]:
    """Torque at the first and the last row of a block [N m], by a line through the rows near it."""
    span = blocks.rows[block]
    is_finite = np.isfinite(rows.coordinate[span]) & np.isfinite(rows.torque[span])
    torque = rows.torque[span][is_finite]
    fit = monotone(rows.coordinate[span][is_finite], blocks.direction[block])
    band = blocks.end_band[blocks.position[block]]
    return _at_end(torque[::-1], (np.abs(fit - fit[0]) <= band)[::-1]), _at_end(torque, np.abs(fit - fit[-1]) <= band)


def _at_end(torque: Real, close: Truth) -> float:
    """Torque [N m] at the last row of those ``close`` to it: their mean would fall short by half of the band."""
    rows = np.flatnonzero(close)
    if len(rows) < 2:  # no line goes through them
        return float(np.mean(torque[rows]))
    slope, middle = np.polyfit(rows - rows.mean(), torque[rows], 1)
    return float(middle + slope * (rows[-1] - rows.mean()))

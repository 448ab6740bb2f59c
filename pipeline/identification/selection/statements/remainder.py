"""What a fitted model leaves of a unit: how much, what of it all positions share, and how far they scatter."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.statistics.curve_scatter import CurveScatter, curve_scatter

TORQUE_BINS: Fineness = 12
"""Intervals of the range of the torque, of each sense of loading, over which residuals are compared."""


@dataclass(frozen=True)
class Remainder:
    """Residual of a model in parts.

    Attributes
    ----------
    structure : held-out rms in noise floors.
    removed : share of the recalibrated model's held-out rms that the model removes.
    rms_arcmin : of the cells.
    common_arcmin : rms of the part that all positions have in common at equal torque and sense of loading.
    scatter : by how much a position departs from what they share [arcmin], as a random effect; None with one position.
    noise_arcmin : noise floor of a cell.
    """

    structure: float
    removed: float
    rms_arcmin: float
    common_arcmin: float
    scatter: CurveScatter | None
    noise_arcmin: float


def remainder(data: Data, predicted_angle: Real, cells: Truth, structure: float, base_to_noise: float) -> Remainder:
    """Parts of the residual of a prediction (n_cells,) [arcmin]; ``structure`` and ``base_to_noise`` in noise floors.

    Notes
    -----
    Means over the cells of a position in one interval of the torque and one sense of loading: their mean over the
    positions is common to them. The offset of each position is removed.
    """
    residual = data.angle[cells] - predicted_angle[cells]
    if isinstance(data, TurningData):
        residual, common = _parts_of_turns(data, residual, cells)
    else:
        residual, common = _parts_of_loops(data, residual, cells)
    return Remainder(
        structure,
        1 - structure / base_to_noise,
        float(np.sqrt(np.mean(residual**2))),
        float(np.sqrt(np.mean(common**2))) if common.size else float("nan"),
        position_scatter(data, predicted_angle, cells),
        data.noise,
    )


def _parts_of_loops(data: Data, residual: Real, cells: Truth) -> tuple[Real, Real]:
    """Residuals (n,) of some cells about the offset of each position, and the means that positions have in common."""
    _, position = np.unique(data.position[cells], return_inverse=True)
    residual = residual - (np.bincount(position, residual) / np.bincount(position))[position]
    torque, sense = data.torque[cells], data.senses[cells]
    edges = np.linspace(torque.min(), torque.max(), TORQUE_BINS + 1)
    kind = 2 * np.clip(np.searchsorted(edges, torque, side="right") - 1, 0, TORQUE_BINS - 1) + (sense > 0)
    count = np.zeros((position.max() + 1, 2 * TORQUE_BINS))
    total = count.copy()
    np.add.at(count, (position, kind), 1)
    np.add.at(total, (position, kind), residual)
    mean = total[:, np.all(count > 0, axis=0)] / count[:, np.all(count > 0, axis=0)]
    return residual, mean.mean(axis=0)


def _parts_of_turns(data: TurningData, residual: Real, cells: Truth) -> tuple[Real, Real]:
    """The same of turns: common is what all turns of one sense at one torque share at equal crank angle."""
    residual = residual - residual.mean()
    places = np.column_stack([data.position[cells], data.level[cells], data.direction[cells]])
    place = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    return residual, np.bincount(place, residual) / np.bincount(place)


def position_scatter(data: Data, predicted_angle: Real, cells: Truth) -> CurveScatter | None:
    """How far positions depart from each other [arcmin] beside a prediction (n_cells,), by some cells (n_cells,).

    None of a turning crank, whose positions are neighbours on a turn.
    """
    if isinstance(data, TurningData):
        return None
    finite = cells & np.isfinite(predicted_angle)
    return curve_scatter(
        data.torque[finite],
        (data.senses[finite] > 0).astype(np.int64),
        data.position[finite],
        (data.angle - predicted_angle)[finite],
        data.sigma[finite],
        own_zero=not data.common_offset,
    )

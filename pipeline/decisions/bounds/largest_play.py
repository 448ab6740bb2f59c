"""The largest play of rigid bodies over a tolerance box, where gaps are linear in the errors: one linear program.

Play is the sum of two linear programs whose right-hand sides are the gaps, so that it is concave in the gaps and rises
with each; errors and both poses are therefore found together. A bearing's clearance and an ovality are discs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from pipeline.arrays import Real

SIDES = 72
"""Of the polygon about the bearing's disc: it lets the disk 0.1 % of the clearance too far."""


@dataclass(frozen=True)
class LargestPlay:
    """The largest play and the errors that have it.

    Attributes
    ----------
    play : in the unit of a gap over the unit of an arm [rad].
    steps : (n_errors,) each from -1/2 to 1/2 of its zone.
    weights : of each wave (n_waves, n_patterns), of sum at most 1.
    """

    play: float
    steps: Real
    weights: tuple[Real, ...]


def largest_play(
    jacobian: Real, output: int, gap: Real, slopes: Real, patterns: Sequence[Real], radii: Real
) -> LargestPlay:
    """Maximise the rotation of the output between two poses that no contact forbids, over errors and poses.

    Parameters
    ----------
    jacobian : d penetration / d pose (n_contacts, n_motions), the translations of the disks first.
    output : column of the output's rotation.
    gap : (n_contacts,) in the middle of the box, in any unit of length.
    slopes : (n_contacts, n_errors) change of the gaps over the whole zone of each error.
    patterns : of each wave the changes of the gaps (n_contacts, n_patterns) by its full amplitude in each direction.
    radii : (n_disks,) clearance of each input bearing, in the unit of the gaps.

    Raises
    ------
    ArithmeticError
        If no errors leave room, or the play is unbounded.
    """
    n_errors, n_motions, sizes = slopes.shape[1], jacobian.shape[1], [entry.shape[1] for entry in patterns]
    errors = np.hstack([slopes, *patterns])
    nothing_flagged = np.zeros_like(jacobian)
    rows = [np.hstack([-errors, jacobian, nothing_flagged]), np.hstack([-errors, nothing_flagged, jacobian])]
    limits = [gap, gap]
    width, first_column = errors.shape[1] + 2 * n_motions, n_errors
    for size in sizes:
        row = np.zeros((1, width))
        row[0, first_column : first_column + size] = 1.0
        rows.append(row)
        limits.append(np.ones(1))
        first_column += size
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    for pose in (0, n_motions):
        for disk, radius in enumerate(radii):
            polygon = np.zeros((SIDES, width))
            start = errors.shape[1] + pose + 2 * disk
            polygon[:, start], polygon[:, start + 1] = np.cos(angle), np.sin(angle)
            rows.append(polygon)
            limits.append(np.full(SIDES, radius))
    objective = np.zeros(width)
    objective[errors.shape[1] + output], objective[errors.shape[1] + n_motions + output] = -1.0, 1.0
    bounds = [(-0.5, 0.5)] * n_errors + [(0.0, 1.0)] * sum(sizes) + [(None, None)] * (2 * n_motions)
    results = linprog(objective, np.vstack(rows), np.concatenate(limits), bounds=bounds, method="highs")
    if not results.success:
        raise ArithmeticError(f"no largest play: {results.message}")
    weights = np.split(results.x[n_errors : errors.shape[1]], np.cumsum(sizes)[:-1]) if sizes else []
    return LargestPlay(-float(results.fun), results.x[:n_errors], tuple(weights))

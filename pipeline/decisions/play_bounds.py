"""Bounds of the rigid play of a study's reducer over its tolerance box at one crank angle, by linear programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.decisions.box import Box, coordinate_search
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN, UM_PER_MM
from pipeline.mounting import drive_of

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


BY_PROGRAM = "largest, gaps linear in the errors: exact, by one linear program"
ATTAINED_BOUND = "largest found, exact gaps: a lower bound of the largest"
LEAST_FOUND = "least found, exact gaps: an upper bound of the least"
LEAST_BOUND = "every gap at its own least: a lower bound of the least"


@dataclass(frozen=True)
class Bound:
    """A number over the tolerance box, and what it is."""

    metric: str
    crank_deg: float
    quantity: str
    value: float


def rigid_drive(box: Box, crank_deg: float, points: Real) -> Drive:
    """Drive of rigid bodies with the errors of points (n, n_columns)."""
    sampled_errors = box.errors(points)
    clearance = assembly.bearing_clearance(box.study.design, sampled_errors.bearing_clearance)
    return drive_of(box.study, crank_deg, None, assembly.errors(sampled_errors), clearance)


def backlash(box: Box, crank_deg: float, points: Real) -> Real:
    """Rigid backlash (n,) [arcmin] of points (n, n_columns); missing where contacts interfere."""
    drive = rigid_drive(box, crank_deg, points)
    play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
    return np.where(play.preloaded, np.nan, ARCMIN * play.backlash)


def play_bounds(box: Box, crank_deg: float, metric: str) -> Iterator[Bound]:
    """Largest and least backlash at one crank angle, each from both sides."""
    centre = box.centre
    middle = rigid_drive(box, crank_deg, centre[None])
    gap = UM_PER_MM * middle.gap[0]
    ends = [
        UM_PER_MM * rigid_drive(box, crank_deg, box.flipped_points(centre, edge_share)).gap for edge_share in (0.0, 1.0)
    ]
    slopes = (ends[1] - ends[0]).T
    patterns = [
        UM_PER_MM * rigid_drive(box, crank_deg, box.rotated_points(centre, wave)).gap.T - gap[:, None]
        for wave in box.all_waves
    ]
    loosest = rigid_drive(box, crank_deg, np.where(np.isin(np.arange(box.n_columns), box.columns), 1.0, centre)[None])
    radii = UM_PER_MM * np.broadcast_to(loosest.bearing_clearance[0], middle.reducer.n_disks)
    results = largest_play(middle.reducer.contact_jacobian, middle.reducer.output_motion, gap, slopes, patterns, radii)
    yield Bound(metric, crank_deg, BY_PROGRAM, ARCMIN * results.play / UM_PER_MM)

    start = centre.copy()
    start[box.columns] = results.steps + 0.5
    for wave, weights in zip(box.all_waves, results.weights, strict=True):
        if weights.sum() > 0.5:
            start[wave] = 1.0, np.argmax(weights) / weights.size
    highest = coordinate_search(box, lambda points: backlash(box, crank_deg, points), start)
    yield Bound(metric, crank_deg, ATTAINED_BOUND, highest.value)
    lowest = coordinate_search(box, lambda points: -np.nan_to_num(backlash(box, crank_deg, points), nan=0.0), centre)
    yield Bound(metric, crank_deg, LEAST_FOUND, -lowest.value)
    tightest = gap - 0.5 * np.abs(slopes).sum(axis=1) + sum(np.minimum(entry.min(axis=1), 0.0) for entry in patterns)
    play = rigid_play(middle.reducer, tightest[None] / UM_PER_MM, middle.bearing_clearance)
    yield Bound(metric, crank_deg, LEAST_BOUND, 0.0 if play.preloaded[0] else float(ARCMIN * play.backlash[0]))

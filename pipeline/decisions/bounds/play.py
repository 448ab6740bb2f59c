"""Bounds of the rigid play of a study's reducer over its tolerance box at one crank angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.decisions.bounds.box import Box, coordinate_search
from pipeline.decisions.bounds.largest_play import largest_play
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN, UM_PER_MM
from pipeline.mounting import drive_of

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
    _, highest_play = coordinate_search(box, lambda points: backlash(box, crank_deg, points), start)
    yield Bound(metric, crank_deg, ATTAINED_BOUND, highest_play)
    _, lowest = coordinate_search(box, lambda points: -np.nan_to_num(backlash(box, crank_deg, points), nan=0.0), centre)
    yield Bound(metric, crank_deg, LEAST_FOUND, -lowest)
    tightest = gap - 0.5 * np.abs(slopes).sum(axis=1) + sum(np.minimum(entry.min(axis=1), 0.0) for entry in patterns)
    play = rigid_play(middle.reducer, tightest[None] / UM_PER_MM, middle.bearing_clearance)
    yield Bound(metric, crank_deg, LEAST_BOUND, 0.0 if play.preloaded[0] else float(ARCMIN * play.backlash[0]))

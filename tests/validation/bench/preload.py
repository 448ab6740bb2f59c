"""Preloaded units: what their equilibria take over those of the same units with play.

Contacts that interfere are many at no load, where units with play have none: what slows them down shows in no other
rate of the bench.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from pipeline import assembly
from pipeline.config import Study
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import solve_cycle
from pipeline.model.units import MM_PER_UM
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw
from stages import hysteresis
from tests.validation.bench.rates import seconds_of
from tests.validation.bench.table import Result

UNITS = 100
"""Units that are solved, preloaded and with play."""
NARROWED = 5.0
"""What gaps are less than drawn [um], or more. Most units are so preloaded, by half of their contacts: the slowest."""


def preload(study: Study, shared: hysteresis.Shared) -> Iterator[Result]:
    """Time of preloaded units over that of the same units with play, for either loop of the first crank angle.

    Nothing without any.
    """
    crank = study.cycle.crank_deg[0]
    sampled = draw(study.model_copy(update={"samples": study.samples.model_copy(update={"count": UNITS})}), 0, UNITS)
    clearance = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drawn = drive_of(study, crank, shared.compliances[0], assembly.errors(sampled), clearance, shared.laws[0])
    tight, loose = with_preload_and_with_play(drawn)
    if not len(tight.gap):
        return
    for kind, cycle in (("curves", shared.curve), ("metrics only", shared.brief)):
        seconds = [seconds_of(partial(solve_cycle, drive, cycle)) for drive in (tight, loose)]
        lost = np.count_nonzero(~np.all(solve_cycle(tight, cycle).converged, axis=1))
        note = f"{kind}: {len(tight.gap)} units with gaps {NARROWED:g} um smaller over the same with as much more"
        yield Result("preload_ratio", seconds[0] / seconds[1], "1", len(tight.gap), 1, f"{note}, {lost} not solved")


def with_preload_and_with_play(drive: Drive) -> tuple[Drive, Drive]:
    """Those states of a drive that smaller gaps preload while larger ones leave them play, with either gaps."""
    added_gap = np.full(drive.gap.shape, MM_PER_UM * NARROWED)
    tight, loose = drive.with_added_gap(-added_gap), drive.with_added_gap(added_gap)
    preloaded, still_preloaded = (
        rigid_play(variant.reducer, variant.gap, variant.bearing_clearance).preloaded for variant in (tight, loose)
    )
    states = np.flatnonzero(preloaded & ~still_preloaded)
    return tight.some(states), loose.some(states)

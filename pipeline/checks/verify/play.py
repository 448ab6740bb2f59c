"""Check of the rigid backlash: the general program of the whole chain against the separated form of its parts."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.specimen import Finding, Specimen, largest_difference, relative
from pipeline.config.designs.design import Design
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, separated_play

SAMPLES = 6
"""Random units; each costs a search of some seconds."""
PIN_SCATTER = 1.5e-3
"""Standard deviation of the pin errors [mm]."""
ALLOWANCE = 12e-3
"""Material off every lobe [mm], which leaves room for the errors and for the bearing's clearance."""
BEARING_CLEARANCE = 2e-3
"""Of a loose bearing [mm]."""
NARROWINGS = 52
"""Golden-section steps a direction: 1e-11 of the clearance."""
GOLDEN = (np.sqrt(5) - 1) / 2
"""Ratio of the golden-section search."""
CRANK_DEG = 37.0
"""An angle without symmetry [deg]."""


def random_gaps(design: Design, reducer: Reducer, allowance: float) -> Real:
    """Gaps (n, n_contacts) [mm] of reducers with random pins and rollers, fixed seed."""
    profile = assembly.profile(design)
    random = np.random.default_rng(20170101)
    shape = (SAMPLES, profile.pins)
    errors = replace(
        Errors.zero(profile.pins, profile.lobes, design.output.contacts, SAMPLES),
        pin_radial=PIN_SCATTER * random.standard_normal(shape),
        pin_tangential=PIN_SCATTER * random.standard_normal(shape),
        pin_radius=PIN_SCATTER * random.standard_normal(shape),
        lobe=np.full((SAMPLES, profile.lobes), allowance),
        eccentricity=PIN_SCATTER * random.standard_normal(SAMPLES),
        roller_diameter=-allowance * random.uniform(0.5, 1.0, (SAMPLES, design.output.contacts)),
    )
    return gaps(profile, reducer, errors, method="exact", disk_reading="radial", roller_reading="half_diameter")


def _searched_end(reducer: Reducer, gap: Real, clearance: float, sense: float) -> Real:
    """Largest output rotation (n,) in one sense: the separated form, maximised over the bearing's disc.

    With the disk centre held, the parts separate; the end of play is a concave function of the centre, so two nested
    golden-section searches over the disc find its largest value.
    """

    def end(x: Real, y: Real) -> Real:
        shifted_gap = gap - x[:, None] * reducer.contact_jacobian[:, 0] - y[:, None] * reducer.contact_jacobian[:, 1]
        play = separated_play(reducer, shifted_gap)
        pose = play.pose_plus if sense > 0 else play.pose_minus
        return sense * pose[:, play.output_motion]

    def over_y(x: Real) -> Real:
        reach = np.sqrt(np.maximum(clearance**2 - x**2, 0.0))
        return _golden(lambda y: end(x, y), -reach, reach)

    edge = np.full(len(gap), clearance)
    return sense * _golden(over_y, -edge, edge)


def _golden(function: Callable[[Real], Real], low: Real, high: Real) -> Real:
    """Largest value (n,) of concave functions on [low, high], each entry its own search."""
    lower, upper = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_lower, at_upper = function(lower), function(upper)
    for _ in range(NARROWINGS):
        rises = at_lower < at_upper
        low, high = np.where(rises, lower, low), np.where(rises, high, upper)
        trial = np.where(rises, low + GOLDEN * (high - low), high - GOLDEN * (high - low))
        at_new = function(trial)
        lower, upper = np.where(rises, upper, trial), np.where(rises, trial, lower)
        at_lower, at_upper = np.where(rises, at_upper, at_new), np.where(rises, at_new, at_lower)
    return np.maximum(at_lower, at_upper)


def check_rigid_backlash(specimen: Specimen) -> Iterator[Finding]:
    """Rigid backlash: general program against the separated form."""
    for plate in ("rotates", "floats"):
        design = specimen.study.design.with_section("output", plate=plate)
        reducer = assembly.reducer(design, CRANK_DEG)
        gap = random_gaps(design, reducer, ALLOWANCE)
        no_clearance = np.zeros(len(gap))
        yield relative(
            f"backlash, plate {plate}, bearing fixed [rad]",
            separated_play(reducer, gap).backlash,
            general_play(reducer, gap, no_clearance).backlash,
            1e-9,
        )
        first_gaps = gap[:2]
        searched_ends = [_searched_end(reducer, first_gaps, BEARING_CLEARANCE, sense) for sense in (1.0, -1.0)]
        yield relative(
            f"backlash, plate {plate}, bearing with clearance [rad]",
            searched_ends[0] - searched_ends[1],
            general_play(reducer, first_gaps, np.full(len(first_gaps), BEARING_CLEARANCE)).backlash,
            1e-9,
        )
        gap = random_gaps(design, reducer, 0.0)
        separate_plays, general = separated_play(reducer, gap), general_play(reducer, gap, no_clearance)
        yield relative(
            f"overlap of interfering parts, plate {plate} [mm]", separate_plays.overlap, general.overlap, 1e-9
        )
        yield largest_difference(f"backlash of interfering pins, plate {plate} [rad]", 0.0, general.backlash, 1e-15)

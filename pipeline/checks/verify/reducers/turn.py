"""Check of a turn: no error of a perfect rigid reducer, that of one displaced pin, and a disk turned by its lobes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline import assembly, elastic
from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.checks.verify.findings import Finding, largest_difference, relative, vanishing
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play
from pipeline.populations.output_turn import PHASES
from pipeline.populations.turn_drives import places, turned_blocks
from pipeline.sampling.errors import draw

CRANKS_DEG = 360.0 * np.arange(23) / 23
"""Crank angles [deg], coprime to the usual numbers of pins."""
GAP, INWARDS, DISPLACED_PIN = 8e-3, 5e-3, 3
"""Uniform gap and way of one pin towards the axis [mm], and its number."""
TURNS = (1, 37, 4001)
"""Pitches of the pins after which the turned disk is condensed afresh."""


def check_turn(specimen: Specimen) -> Iterator[Finding]:
    """A turn: rigid bodies without gaps, one displaced pin in closed form, lobe after lobe by symmetry."""
    perfect, displaced_ends, expected_ends = [], [], []
    for crank in CRANKS_DEG:
        perfect.append(_ends(specimen, crank, 0.0, 0.0, "exact"))
        displaced_ends.append(_ends(specimen, crank, GAP, INWARDS, "first_order"))
        expected_ends.append(_closed_form(specimen, np.radians(crank)))
    yield vanishing("transmission error of rigid bodies without gaps [rad]", np.array(perfect), 1e-9)
    quantity = "ends of the play with one displaced pin, over the largest, against the first-order form"
    yield largest_difference(
        quantity, np.array(expected_ends), np.array(displaced_ends), 1e-9, np.max(np.abs(expected_ends))
    )
    errors = [np.ptp(values, axis=0).max() for values in (np.array(expected_ends), np.array(displaced_ends))]
    yield relative("peak to peak of the transmission error by that pin [rad]", errors[0], errors[1], 1e-9)
    yield _by_symmetry(specimen)


def _ends(specimen: Specimen, crank_deg: float, gap: float, inwards: float, method: str) -> Real:
    """Ends (2,) of the disk's rotation among its pins [rad]: uniform material off the flank, one pin inwards [mm]."""
    reducer, profile = assembly.reducer(specimen.study.design, crank_deg), specimen.profile
    sampled_errors = vars(assembly.errors(draw(specimen.study, specimen.sample, specimen.sample + 1)))
    perfect = Errors(**{name: np.zeros_like(values) for name, values in sampled_errors.items()})
    radial = np.where(np.arange(profile.pins) == DISPLACED_PIN, -inwards, 0.0)[None]
    errors = replace(perfect, pin_radial=radial, lobe=np.full((1, profile.lobes), gap))
    readings = {"disk_reading": "normal", "roller_reading": specimen.study.clearance.roller_reading}
    return separated_play(reducer, gaps(profile, reducer, errors, method=method, **readings)).ends[:, 0]


def _closed_form(specimen: Specimen, crank: float) -> Real:
    """The disk turns until the first of gap/arm, with the displaced pin's gap less its approach along the normal.

    Source: arms e Z sin(phi)/S and normals (1 - K cos phi)/S of the pins at phi from the eccentric.
    """
    profile = specimen.profile
    k, phi = profile.shortening, profile.pin_angle() - crank
    s = np.sqrt(1 + k * k - 2 * k * np.cos(phi))
    arm, room = profile.eccentricity * profile.lobes * np.sin(phi) / s, np.full(profile.pins, GAP)
    room[DISPLACED_PIN] -= INWARDS * (1 - k * np.cos(phi[DISPLACED_PIN])) / s[DISPLACED_PIN]
    rotation_to_contact = room / np.maximum(np.abs(arm), 1e-12)
    return np.array([np.min(rotation_to_contact[arm > 0]), -np.min(rotation_to_contact[arm < 0])])


def _by_symmetry(specimen: Specimen) -> Finding:
    """The disk condensed once, its pins some pitches on, against a condensation at that crank angle."""
    study, phase = specimen.study, 1
    body, pins = specimen.disk, specimen.profile.pins
    blocks, differences = turned_blocks(study, body, 360.0 * phase / (PHASES * pins)), []
    for pitches in TURNS:
        reducer = assembly.reducer(study.design, 360.0 * (phase / PHASES + pitches) / pins)
        rows = assembly.disk_contacts(reducer)
        fresh = body.compliance(elastic.disk_patches(study, body, reducer)).matrix
        order = places(study, len(reducer.contacts), pitches)[rows]
        by_symmetry = blocks[pitches % len(blocks)][np.ix_(order, order)]
        differences.append(np.abs(by_symmetry - fresh).max() / np.abs(fresh).max())
    return vanishing("compliance after some pitches by symmetry, off a fresh one, over the largest", differences, 1e-8)
